"""One evaluation of equation (3) and its gradient against the textbook's, in one run.

    python tests/benchmarks/objective.py

Needs no data: the shapes are the package's own creatures. Prints medians and ratios, the
floating-point operations of our route, and what share that is of the rate at which this machine
multiplies matrices. One thread, then two for ours.
"""

import time
from dataclasses import replace
from functools import partial

import numpy as np
import textbook
from problems import learning_arrays
from timing import median_seconds, one_thread

from skfmap.functional import (
    LearningProblem,
    epsilon_by_rule,
    penalty_of,
    penalty_quadratic,
    scale_by,
)

SIZES = [(10, 50, 50), (10, 50, 310), (30, 50, 50), (10, 100, 50), (100, 100, 50)]


def problem_of(arrays, regularizer="laplacian", alpha=0.01, n_threads=1):
    """Return the problem that `learn_functional_maps` would set up."""
    g_0 = arrays["probes_0"]
    return LearningProblem(
        scale_by(g_0, g_0, "shape"),
        np.stack([scale_by(g_0, g, "shape") for g in arrays["probes"]]),
        np.stack([penalty_of(e, arrays["evals_0"], alpha, regularizer) for e in arrays["evals"]]),
        arrays["maps"],
        np.ones(len(arrays["maps"])),
        penalty_quadratic(arrays["evals"], arrays["evals_0"], alpha, regularizer),
        n_threads,
    )


def flops(n_shapes, k, m):
    """Return the floating-point operations of one evaluation, to leading order.

    For each shape: right-hand side, two products for the gradient's factors and one for X G_0, 8
    n^2 m; for each of two solves, two applications of the decomposition, 8 n^3 each, and two
    residuals, 2 n^3 each; the norm, an inverse (2 n^3) and four products (2 n^3 each). Once: the
    eigen-decomposition of size 2 n, about 25 (2 n)^3, and an inverse of complex numbers, 8 (2 n)^3.
    """
    n = k - 1
    per_shape = 8 * n**2 * m + 2 * (16 + 4) * n**3 + 10 * n**3
    return n_shapes * per_shape + 33 * (2 * n) ** 3


def disagreement(ours, theirs):
    """Return the largest relative difference of loss and gradient."""
    (loss, gradient), (loss_t, gradient_t) = ours, theirs
    return max(
        abs(loss / loss_t - 1), np.abs(gradient - gradient_t).max() / np.abs(gradient_t).max()
    )


def product_rate(size=1500, repeats=7):
    """Return the rate of a matrix product, in floating-point operations a second."""
    A = np.random.default_rng(0).standard_normal((size, size))
    seconds = median_seconds({"product": lambda: A @ A}, repeats)["product"]
    return 2 * size**3 / seconds


def main():
    with one_thread():
        rate = product_rate()
    print(
        f"matrix products on one thread: {rate / 1e9:.0f} GFlop/s; times in ms; ratio of the "
        "textbook to ours"
    )
    heads = {
        "textbook": 10,
        "numpy solve": 13,
        "ours": 9,
        "two threads": 13,
        "ratio": 7,
        "two": 6,
        "of the rate": 13,
    }
    heads |= {"agree to": 10}
    print(
        f"{'N':>4}{'k':>5}{'m':>5}" + "".join(f"{name:>{width}}" for name, width in heads.items())
    )
    for n, k, m in SIZES:
        problem = problem_of(learning_arrays("creatures", n, k, m))
        weights = np.exp(0.5 * np.random.default_rng(0).standard_normal(m))
        epsilon = epsilon_by_rule(problem.differences(np.ones(m)))
        routes = {
            "textbook": partial(textbook.loss_gradient, problem, weights, epsilon),
            "numpy": partial(textbook.loss_gradient, problem, weights, epsilon, np.linalg.solve),
            "ours": partial(problem.loss_gradient, weights, epsilon),
            "two": partial(replace(problem, n_threads=2).loss_gradient, weights, epsilon),
        }
        with one_thread():
            seconds = median_seconds(routes, 3 if n * k > 5000 else 7)
            agreement = disagreement(routes["ours"](), routes["textbook"]())
        cells = "".join(
            f"{1e3 * seconds[name]:>{width}.1f}"
            for name, width in zip(routes, (10, 13, 9, 13), strict=True)
        )
        ratios = [seconds["textbook"] / seconds[name] for name in ("ours", "two")]
        share = flops(n, k, m) / seconds["ours"] / rate
        print(
            f"{n:>4}{k:>5}{m:>5}{cells}{ratios[0]:>7.1f}{ratios[1]:>6.1f}{share:>13.0%}{agreement:>10.0e}",
            flush=True,
        )


if __name__ == "__main__":
    started = time.perf_counter()
    main()
    print(f"{time.perf_counter() - started:.0f} s in all")
