"""Work on many shapes: joblib over the shapes, one thread within each, the same result for every n_jobs."""

import sys
from collections.abc import Callable, Iterable
from typing import Any

from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

__all__ = ["map_shapes", "single_threaded", "tell"]


def map_shapes(
    function: Callable[..., Any], arguments: Iterable[tuple[Any, ...]], *, n_jobs: int | None, verbose: int
) -> list[Any]:
    """Return ``function(*a)`` for each tuple of ``arguments``, in their order.

    No backend is fixed, so that ``joblib.parallel_config`` can spread the work over a cluster.
    """
    calls = (delayed(single_threaded)(function, *a) for a in arguments)
    return list(Parallel(n_jobs=n_jobs, verbose=verbose)(calls))


def single_threaded(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call with one BLAS and one OpenMP thread: sums come out the same to the last bit wherever the call runs."""
    with threadpool_limits(limits=1):
        return function(*arguments)


def tell(message: str) -> None:
    """Write one line of progress to standard error."""
    sys.stderr.write(message + "\n")
    sys.stderr.flush()
