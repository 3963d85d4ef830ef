"""The search for weights against plain L-BFGS on all log-weights, with the same objective.

    python tests/benchmarks/optimiser.py
    python tests/benchmarks/optimiser.py --creatures

Ten training shapes, k = 50, with 50, 105 and 310 weights. Both searches end by the same gradient
tolerance; how long ours takes to undercut where the plain one ends is printed too. Two threads over
shapes where that pays; BLAS has one.
"""

import argparse
import time
from functools import partial

import numpy as np
from objective import problem_of
from problems import FAMILIES, learning_arrays
from scipy.optimize import minimize
from timing import one_thread

from skfmap.functional import epsilon_by_rule, optimize_weights, weight_groups
from skfmap.functional.optimize import LOG_WEIGHT_BOUND
from skfmap.functional.weighting import coarse_groups

K, N_TRAINING = 50, 10
TOLERANCES = (1e-4, 1e-5)
REPEATS = 3


def plain(problem, epsilon, m, tol):
    """Return loss, evaluations and convergence of L-BFGS, by scipy but for the stopping rule."""
    scale = problem.sample_weight.sum() * (K - 1)

    def loss_gradient(log_weights):
        weights = np.exp(log_weights)
        loss, gradient = problem.loss_gradient(weights, epsilon)
        return loss / scale, 2 * gradient * weights**2 / scale

    result = minimize(
        loss_gradient,
        np.zeros(m),
        jac=True,
        method="L-BFGS-B",
        bounds=[(-LOG_WEIGHT_BOUND, LOG_WEIGHT_BOUND)] * m,
        options={"gtol": tol, "ftol": 0.0, "maxiter": 2000, "maxfun": 20000},
    )
    return result.fun * scale, result.nfev, result.success


def ours(problem, epsilon, categories, tol, until=None):
    """Return the same for our search; ``until`` a loss, if that is given."""
    groups = weight_groups("function", categories)
    optimum = optimize_weights(
        problem,
        groups,
        epsilon,
        coarse=coarse_groups(groups, categories),
        max_iter=2000,
        tol=tol,
        callback=None if until is None else lambda iteration, loss, weights: bool(loss <= until),
    )
    return optimum.loss_curve[-1], optimum.n_evaluations, optimum.converged


def timed(*searches):
    """Return what each search returns and its median time; they take turns."""
    seconds = [[] for _ in searches]
    for _ in range(REPEATS):
        results = []
        for search, own in zip(searches, seconds, strict=True):
            started = time.perf_counter()
            results.append(search())
            own.append(time.perf_counter() - started)
    return zip(results, map(np.median, seconds), strict=True)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--creatures", action="store_true", help="the package's own shapes instead of the cats"
    )
    options = parser.parse_args()
    collection = "creatures" if options.creatures else "cats"
    for m in FAMILIES:
        arrays = learning_arrays(collection, N_TRAINING, K, m)
        problem = problem_of(arrays, n_threads=2)
        epsilon = epsilon_by_rule(problem.differences(np.ones(m)))
        for tol in TOLERANCES:
            with one_thread():
                goal, *_ = plain(problem, epsilon, m, tol)
                searches = {
                    "plain": partial(plain, problem, epsilon, m, tol),
                    "ours": partial(ours, problem, epsilon, arrays["categories"], tol),
                    "ours, until": partial(
                        ours, problem, epsilon, arrays["categories"], 1e-9, goal
                    ),
                }
                rows = dict(zip(searches, timed(*searches.values()), strict=True))
            for name, ((loss, n_evaluations, converged), seconds) in rows.items():
                share = seconds / rows["plain"][1]
                word = (
                    "converged" if converged else ("" if name == "ours, until" else "not converged")
                )
                print(
                    f"{m:>4} weights, tol {tol:g}  {name:<12} loss {loss:>9.3f}{n_evaluations:>5} "
                    f"evaluations{seconds:>7.2f} s  {share:>5.2f} of plain  {word}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
