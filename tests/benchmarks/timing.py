"""Routes timed in one run, by turns, so that a noisy machine slows them alike."""

import statistics
import time
from collections.abc import Callable

from threadpoolctl import threadpool_limits


def median_seconds(routes: dict[str, Callable[[], object]], repeats: int = 7) -> dict[str, float]:
    """Call each route once to warm up, then all in turn; return the median time of each."""
    for route in routes.values():
        route()
    seconds: dict[str, list[float]] = {name: [] for name in routes}
    for _ in range(repeats):
        for name, route in routes.items():
            started = time.perf_counter()
            route()
            seconds[name].append(time.perf_counter() - started)
    return {name: statistics.median(values) for name, values in seconds.items()}


def one_thread() -> threadpool_limits:
    """Hold BLAS and OpenMP to one thread, as the library does where it uses the cores itself."""
    return threadpool_limits(limits=1)
