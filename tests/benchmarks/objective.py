"""One evaluation of equation (3) and its gradient against the textbook's, in one run.

    python tests/benchmarks/objective.py

Needs no data: the shapes are the package's own creatures. Prints medians and ratios, the floating-point operations of
our route, and what share that is of the rate at which this machine multiplies matrices.
"""

import time
from functools import partial

import numpy as np
import textbook
from problems import learning_arrays
from timing import median_seconds, one_thread

from skfmap.functional import LearningProblem, epsilon_by_rule, penalty_of, scale_by

SIZES = [(10, 50, 50), (10, 50, 310), (30, 50, 50), (10, 100, 50), (100, 100, 50)]


def problem_of(arrays, regularizer="laplacian", alpha=0.01):
    """Return the problem that `learn_functional_maps` would set up."""
    g_0 = arrays["probes_0"]
    return LearningProblem(
        scale_by(g_0, g_0, "shape"),
        np.stack([scale_by(g_0, g, "shape") for g in arrays["probes"]]),
        np.stack([penalty_of(e, arrays["evals_0"], alpha, regularizer) for e in arrays["evals"]]),
        arrays["maps"],
        np.ones(len(arrays["maps"])),
    )


def disagreement(ours, theirs):
    """Return the largest relative difference of loss and gradient."""
    (loss, gradient), (loss_t, gradient_t) = ours, theirs
    return max(abs(loss / loss_t - 1), np.abs(gradient - gradient_t).max() / np.abs(gradient_t).max())


def product_rate(size=1500, repeats=7):
    """Return the rate of a matrix product, in floating-point operations a second."""
    A = np.random.default_rng(0).standard_normal((size, size))
    seconds = median_seconds({"product": lambda: A @ A}, repeats)["product"]
    return 2 * size**3 / seconds


def main():
    print(f"{'N':>4}{'k':>5}{'m':>5}   {'textbook':>10}{'numpy solve':>13}{'ours':>10}{'ratio':>7}{'agree to':>10}")
    for n, k, m in SIZES:
        problem = problem_of(learning_arrays("creatures", n, k, m))
        weights = np.exp(0.5 * np.random.default_rng(0).standard_normal(m))
        epsilon = epsilon_by_rule(problem.differences(np.ones(m)))
        routes = {
            "textbook": partial(textbook.loss_gradient, problem, weights, epsilon),
            "numpy": partial(textbook.loss_gradient, problem, weights, epsilon, np.linalg.solve),
            "ours": partial(problem.loss_gradient, weights, epsilon),
        }
        with one_thread():
            seconds = median_seconds(routes, 3 if n * k > 5000 else 7)
            agreement = disagreement(routes["ours"](), routes["textbook"]())
        cells = "".join(f"{1e3 * seconds[name]:>{width}.1f}" for name, width in zip(routes, (10, 13, 10), strict=True))
        ratio = seconds["textbook"] / seconds["ours"]
        print(f"{n:>4}{k:>5}{m:>5}   {cells}{ratio:>7.1f}{agreement:>10.0e}   ms", flush=True)


if __name__ == "__main__":
    started = time.perf_counter()
    main()
    print(f"{time.perf_counter() - started:.0f} s in all")
