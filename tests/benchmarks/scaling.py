"""How one evaluation of the loss and its gradient grows with the number of training shapes.

    python tests/benchmarks/scaling.py

Creatures, 50 probes, k = 50 and 100: time on one thread and on two, their ratio, and whether the
results are the same to the last bit. Then the peak memory of a process that holds N = 300, k = 100,
m = 310 and evaluates it.
"""

import multiprocessing
import resource
from dataclasses import replace
from functools import partial

import numpy as np
from objective import flops, problem_of, product_rate
from problems import learning_arrays
from timing import median_seconds, one_thread

N_SHAPES = (10, 30, 100, 300)
N_MOST = max(N_SHAPES)
EPSILON = 0.3


def first_shapes(arrays, n):
    """Return the problem of the first shapes of a collection."""
    return {
        name: value[:n] if name in ("probes", "evals", "maps") else value
        for name, value in arrays.items()
    }


def peak_memory(n, k, m):
    """Print the peak memory of this process after some evaluations."""
    arrays = learning_arrays("creatures", n, k, m)
    loaded = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    problem = problem_of(arrays, n_threads=2)
    with one_thread():
        problem.loss_gradient(np.ones(m), EPSILON)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(
        f"peak memory at N = {n}, k = {k}, m = {m}: {peak / 2**20:.2f} GiB, of which "
        f"{loaded / 2**20:.2f} before"
    )


def main():
    m = 50
    with one_thread():
        rate = product_rate()
    print(f"matrix products on one thread: {rate / 1e9:.0f} GFlop/s")
    print(
        f"{'k':>4}{'N':>6}{'one thread':>13}{'per shape':>12}{'of the rate':>13}{'two':>10}"
        f"{'ratio':>7}  same bits"
    )
    for k in (50, 100):
        arrays = learning_arrays("creatures", N_MOST, k, m)
        weights = np.exp(0.5 * np.random.default_rng(0).standard_normal(m))
        for n in N_SHAPES:
            one = problem_of(first_shapes(arrays, n))
            two = replace(one, n_threads=2)
            routes = {
                1: partial(one.loss_gradient, weights, EPSILON),
                2: partial(two.loss_gradient, weights, EPSILON),
            }
            with one_thread():
                seconds = median_seconds(routes, 5 if n > 100 else 15)
                same = all(
                    np.array_equal(a, b) for a, b in zip(routes[1](), routes[2](), strict=True)
                )
            share = flops(n, k, m) / seconds[1] / rate
            print(
                f"{k:>4}{n:>6}{1e3 * seconds[1]:>10.1f} ms{1e3 * seconds[1] / n:>9.2f} "
                f"ms{share:>13.0%}{1e3 * seconds[2]:>7.1f} ms{seconds[1] / seconds[2]:>7.2f}  "
                f"{same}",
                flush=True,
            )
    process = multiprocessing.get_context("spawn").Process(
        target=peak_memory, args=(N_MOST, 100, 310)
    )
    learning_arrays("creatures", N_MOST, 100, 310)
    process.start()
    process.join()


if __name__ == "__main__":
    main()
