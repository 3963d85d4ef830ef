"""Minimise equation (3) over the weights with L-BFGS, from D = I."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from skfmap._typing import FloatArray, IntArray
from skfmap.functional.objective import LearningProblem

__all__ = ["LOG_WEIGHT_BOUND", "Optimum", "optimize_weights"]

LOG_WEIGHT_BOUND = 7.0
"""Weights stay between exp(-7) and exp(7): beyond, a probe is off or alone, and the systems lose definiteness."""

# What scipy calls a search that its callback ended.
_STOPPED = 99


@dataclass(frozen=True, eq=False)
class Optimum:
    """Where the optimiser ended.

    Attributes
    ----------
    weights : ndarray of shape (m,)
        Diagonal of D, positive.
    loss_curve : list of float
        E(D) at the start and after each iteration.
    n_iter, n_evaluations : int
        Iterations, and evaluations of loss and gradient.
    gradient_norm : float
        Largest projected derivative of the loss per shape and function with respect to a log-weight.
    converged : bool
        Whether the gradient fell below the tolerance (ten times it, if rounding keeps any step from lowering the loss).
    stopped : bool
        Whether the callback asked to stop.
    message : str
        The optimiser's own word.
    """

    weights: FloatArray
    loss_curve: list[float]
    n_iter: int
    n_evaluations: int
    gradient_norm: float
    converged: bool
    stopped: bool
    message: str


def optimize_weights(
    problem: LearningProblem,
    groups: IntArray,
    epsilon: float,
    *,
    max_iter: int,
    tol: float,
    callback: Callable[[int, float, FloatArray], object] | None = None,
) -> Optimum:
    """Minimise the loss over one log-weight per group, starting from weights 1.

    Parameters
    ----------
    problem : LearningProblem
        Shapes, maps and probes.
    groups : ndarray of int, shape (m,)
        From `skfmap.functional.weight_groups`; all -1 leaves D = I.
    epsilon : float
        Of the norm (4).
    max_iter : int
        Most iterations.
    tol : float
        The search has converged when no log-weight changes the loss, divided by the number of singular values in it,
        by more than this.
    callback : callable, optional
        Called with the iteration, the loss and the weights after each iteration; stops the search if it returns True.

    Returns
    -------
    Optimum
        Weights and how they were reached.
    """
    n_groups = int(groups.max()) + 1
    if n_groups == 0:
        weights = np.ones(len(groups))
        return Optimum(weights, [problem.loss(weights, epsilon)], 0, 1, 0.0, True, False, "nothing to learn")
    scale = problem.sample_weight.sum() * (problem.maps.shape[2] - 1)

    def scaled_loss_gradient(log_weights: FloatArray) -> tuple[float, FloatArray]:
        weights = np.exp(log_weights)[groups]
        loss, gradient = problem.loss_gradient(weights, epsilon)
        # d(weight^2) / d(log weight) = 2 weight^2
        return loss / scale, np.bincount(groups, 2 * gradient * weights**2, minlength=n_groups) / scale

    curve: list[float] = []

    def record(intermediate_result: Any) -> None:
        curve.append(float(intermediate_result.fun) * scale)
        if callback is not None and callback(len(curve) - 1, curve[-1], np.exp(intermediate_result.x)[groups]) is True:
            raise StopIteration

    start = np.zeros(n_groups)
    curve.append(scaled_loss_gradient(start)[0] * scale)
    result = minimize(
        scaled_loss_gradient,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=[(-LOG_WEIGHT_BOUND, LOG_WEIGHT_BOUND)] * n_groups,
        callback=record,
        options={"maxiter": max_iter, "maxfun": 10 * max_iter, "gtol": tol, "ftol": 0.0, "maxcor": 20},
    )
    if not np.isfinite(result.fun):
        raise ValueError("The loss is not finite; raise alpha or epsilon, or look for extreme probe coefficients.")
    gradient_norm = _projected_gradient_norm(result.x, result.jac)
    return Optimum(
        np.exp(result.x)[groups],
        curve,
        int(result.nit),
        int(result.nfev) + 1,
        gradient_norm,
        gradient_norm <= (tol if result.success else 10 * tol),
        result.status == _STOPPED,
        str(result.message),
    )


def _projected_gradient_norm(log_weights: FloatArray, gradient: FloatArray) -> float:
    moved = np.clip(log_weights - gradient, -LOG_WEIGHT_BOUND, LOG_WEIGHT_BOUND)
    return float(np.abs(moved - log_weights).max())
