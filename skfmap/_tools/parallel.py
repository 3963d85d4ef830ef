"""Work on many shapes: joblib over them, one thread within each, one result for every n_jobs."""

import numbers
import os
import sys
import threading
from collections.abc import Callable, Iterable
from itertools import chain, islice
from types import TracebackType
from typing import Any, TypeVar

from joblib import Parallel, cpu_count, delayed, effective_n_jobs
from threadpoolctl import threadpool_limits

__all__ = ["map_shapes", "single_threaded", "tell", "threads_within"]

_Result = TypeVar("_Result")


class _OneThread:
    """One BLAS and one OpenMP thread while anybody in this process is inside.

    The limit belongs to the process, not to a thread: the first to enter sets it, the last to leave
    lifts it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._n_inside = 0
        self._limits: Any = None

    def __enter__(self) -> None:
        with self._lock:
            if self._n_inside == 0:
                self._limits = threadpool_limits(limits=1)
            self._n_inside += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with self._lock:
            self._n_inside -= 1
            if self._n_inside == 0:
                self._limits.restore_original_limits()


_ONE_THREAD = _OneThread()
_WITHIN = threading.local()


def map_shapes(
    function: Callable[..., _Result],
    arguments: Iterable[tuple[object, ...]],
    *,
    n_jobs: int | None,
    verbose: int,
    prefer: str | None = None,
) -> list[_Result]:
    """Return ``function(*a)`` for each tuple of ``arguments``, in their order.

    No backend is fixed, so that ``joblib.parallel_config`` can spread the work over a cluster.
    ``prefer="threads"`` is a hint for work that is matrix products for the most part: nothing is
    copied to other processes then.
    """
    if n_jobs is not None and (
        not isinstance(n_jobs, numbers.Integral) or isinstance(n_jobs, bool) or n_jobs == 0
    ):
        raise ValueError(
            f"n_jobs must be None or an integer other than 0 (-1: all cores); got {n_jobs!r}."
        )
    if not isinstance(verbose, numbers.Integral):
        raise ValueError(f"verbose must be an integer; got {verbose!r}.")
    # Where there are fewer shapes than jobs, some are left; a cluster's workers are not threads.
    most, waiting = min(effective_n_jobs(n_jobs), cpu_count()), iter(arguments)
    first = list(islice(waiting, most))
    n_threads = most // max(1, len(first))
    calls = (delayed(_call)(os.getpid(), n_threads, function, *a) for a in chain(first, waiting))
    with _ONE_THREAD:
        return list(Parallel(n_jobs=n_jobs, verbose=verbose, prefer=prefer)(calls))


def single_threaded(
    function: Callable[..., _Result], *arguments: object, **keywords: object
) -> _Result:
    """Call with one BLAS and one OpenMP thread, so that sums are the same to the last bit."""
    with _ONE_THREAD:
        return function(*arguments, **keywords)


def tell(message: str) -> None:
    """Write one line of progress to standard error."""
    sys.stderr.write(message + "\n")
    sys.stderr.flush()


def threads_within() -> int:
    """Return how many threads the work on one shape may use: more than 1 if jobs are left over."""
    return getattr(_WITHIN, "n_threads", 1)


def _call(
    parent: int, n_threads: int, function: Callable[..., _Result], *arguments: object
) -> _Result:
    """Call within the parent's limit, or in another process within a limit of its own."""
    before, _WITHIN.n_threads = threads_within(), n_threads
    try:
        if os.getpid() == parent:
            return function(*arguments)
        return single_threaded(function, *arguments)
    finally:
        _WITHIN.n_threads = before
