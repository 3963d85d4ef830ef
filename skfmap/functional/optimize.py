"""Minimise equation (3) over the weights with L-BFGS: first one weight per category, then each."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, minimize

from skfmap._tools.types import FloatArray, IntArray
from skfmap.functional.objective import LearningProblem

__all__ = ["LOG_WEIGHT_BOUND", "Optimum", "optimize_weights"]

LOG_WEIGHT_BOUND = 7.0
"""Weights stay between exp(-7) and exp(7); beyond these a probe is switched off, or the only one.

Squared weights then differ by a factor of at most exp(28) = 1.4e12, which leaves four of sixteen
digits where a probe of small weight decides. Bounds of 5, 9 and 12 reach the same loss on TOSCA's
cats (171.8).
"""

# Coarse weights are only a starting point (docs/speed.rst, "The search for weights"), so they are
# found roughly, within bounds that switch no category off. On the cats, bounds of 2, 5 and 7,
# tolerances of 1e-2 and 1e-4, and 10 or 200 iterations change errors of shapes left out by less
# than 0.0002 and losses by 0.2 % (a tolerance of 1e-2: by 2 %, in 42 evaluations rather than 50; of
# 1e-4: in 60).
_COARSE_BOUND = 3.0
_COARSE_TOL = 1e-3
_COARSE_MAX_ITER = 50

# scipy's status of a search that its callback stopped.
_STOPPED = 99
# Factor on the tolerance if rounding errors end the search before the tolerance is met; never
# varied.
_LENIENCY = 10
# Number of steps that L-BFGS stores: 10, 20, 50 and 100 take 56, 52, 50 and 50 evaluations on the
# cats.
_N_REMEMBERED = 50


@dataclass(frozen=True, eq=False)
class Optimum:
    """The result of the optimisation.

    Attributes
    ----------
    weights : ndarray of shape (m,)
        Diagonal of D, positive.
    loss_curve : list of float
        E(D) at the start and after each iteration.
    n_iter, n_evaluations : int
        Number of iterations, and of evaluations of the loss and its gradient.
    gradient_norm : float
        Largest projected derivative of the loss per shape and function with respect to a
        log-weight.
    converged : bool
        Whether the gradient fell below the tolerance (below ten times the tolerance, if rounding
        errors prevent any further decrease of the loss).
    stopped : bool
        Whether the callback stopped the search.
    message : str
        The message of the optimiser.
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
    coarse: IntArray | None = None,
    start: FloatArray | None = None,
    max_iter: int,
    tol: float,
    callback: Callable[[int, float, FloatArray], bool | None] | None = None,
) -> Optimum:
    """Minimise the loss over one log-weight per group.

    The loss has many local minima. Optimising one weight per category first leads to lower minima,
    and takes fewer evaluations, than optimising all weights at once.

    Parameters
    ----------
    problem : LearningProblem
        Shapes, maps and probes.
    groups : ndarray of int, shape (m,)
        Group of each probe, from `skfmap.functional.weight_groups`; all -1 leaves D = I.
    epsilon : float
        Parameter of the norm (4).
    coarse : ndarray of int, shape (m,), optional
        Groups to begin with, from `skfmap.functional.weighting.coarse_groups`.
    start : ndarray of shape (m,), optional
        Initial weights, equal within a group; the search over coarse groups is then omitted. By
        default all weights start from 1.
    max_iter : int
        Maximum number of iterations, including those over coarse groups.
    tol : float
        The search has converged when the derivative of the loss, divided by the number of singular
        values in it, with respect to each log-weight is at most this.
    callback : callable, optional
        Called after each iteration with its number, the loss and the weights. The search stops if
        it returns True.

    Returns
    -------
    Optimum
        Weights, and how they were found.
    """
    if groups.max() < 0:
        weights = np.ones(len(groups))
        return Optimum(
            weights, [problem.loss(weights, epsilon)], 0, 1, 0.0, True, False, "nothing to learn"
        )
    search = _Search(problem, epsilon, callback)
    if start is not None:
        return search.finish(np.log(start), groups, max_iter, tol)
    first = np.zeros(len(groups))
    if coarse is not None:
        most = min(_COARSE_MAX_ITER, max_iter)
        first, stopped = search.run(first, coarse, _COARSE_BOUND, most, max(tol, _COARSE_TOL))
        if stopped:
            return search.optimum(first, np.nan, False, True, "stopped by the callback")
    return search.finish(first, groups, max_iter, tol)


class _Search:
    """Evaluations, iterations and losses of a search, over one grouping after another."""

    def __init__(
        self,
        problem: LearningProblem,
        epsilon: float,
        callback: Callable[[int, float, FloatArray], bool | None] | None,
    ) -> None:
        self.problem, self.epsilon, self.callback = problem, epsilon, callback
        self.scale = float(problem.sample_weight.sum() * (problem.maps.shape[2] - 1))
        self.curve: list[float] = []
        self.n_evaluations = 0

    def finish(self, start: FloatArray, groups: IntArray, max_iter: int, tol: float) -> Optimum:
        """Search over the requested groups, and return the result."""
        remaining = max_iter - max(len(self.curve) - 1, 0)
        if remaining == 0:
            first, evaluate = self._over(groups, start)
            gradient_norm = _projected_gradient_norm(first, evaluate(first)[1])
            return self.optimum(
                start, gradient_norm, gradient_norm <= tol, False, "max_iter reached"
            )
        result = self._minimize(start, groups, LOG_WEIGHT_BOUND, remaining, tol)
        gradient_norm = _projected_gradient_norm(result.x, result.jac)
        # A search that rounding errors end just above ``tol`` counts as converged.
        converged = gradient_norm <= (tol if result.success else _LENIENCY * tol)
        stopped = result.status == _STOPPED
        return self.optimum(
            result.x[groups], gradient_norm, converged, stopped, str(result.message)
        )

    def run(
        self, start: FloatArray, groups: IntArray, bound: float, max_iter: int, tol: float
    ) -> tuple[FloatArray, bool]:
        """Return the log-weights of probes after a search, and whether the callback stopped it."""
        result = self._minimize(start, groups, bound, max_iter, tol)
        return result.x[groups], result.status == _STOPPED

    def optimum(
        self,
        log_weights: FloatArray,
        gradient_norm: float,
        converged: bool,
        stopped: bool,
        message: str,
    ) -> Optimum:
        """Return the current result of the search."""
        n_iter = len(self.curve) - 1
        weights = np.exp(log_weights)
        return Optimum(
            weights,
            self.curve,
            n_iter,
            self.n_evaluations,
            gradient_norm,
            converged,
            stopped,
            message,
        )

    def _over(
        self, groups: IntArray, start: FloatArray
    ) -> tuple[FloatArray, Callable[[FloatArray], tuple[float, FloatArray]]]:
        """Return the initial log-weight of each group, and the scaled loss and gradient."""
        n_groups = int(groups.max()) + 1
        first = np.zeros(n_groups)
        first[groups] = start  # the members of a group start alike

        def scaled_loss_gradient(log_weights: FloatArray) -> tuple[float, FloatArray]:
            self.n_evaluations += 1
            weights = np.exp(log_weights)[groups]
            loss, gradient = self.problem.loss_gradient(weights, self.epsilon)
            if not self.curve:
                self.curve.append(loss)
            # d(weight^2) / d(log weight) = 2 weight^2
            by_group = np.bincount(groups, 2 * gradient * weights**2, minlength=n_groups)
            return loss / self.scale, by_group / self.scale

        return first, scaled_loss_gradient

    def _minimize(
        self,
        start: FloatArray,
        groups: IntArray,
        bound: float,
        max_iter: int,
        tol: float,
    ) -> OptimizeResult:
        first, scaled_loss_gradient = self._over(groups, start)

        def record(intermediate_result: OptimizeResult) -> None:
            self.curve.append(float(intermediate_result.fun) * self.scale)
            weights = np.exp(intermediate_result.x)[groups]
            told = self.callback is not None and self.callback(
                len(self.curve) - 1, self.curve[-1], weights
            )
            if told is True:
                raise StopIteration

        result = minimize(
            scaled_loss_gradient,
            first,
            jac=True,
            method="L-BFGS-B",
            bounds=[(-bound, bound)] * len(first),
            callback=record,
            options={
                "maxiter": max_iter,
                "maxfun": 10 * max_iter,  # never reached: a step takes one or two evaluations
                "gtol": tol,
                "ftol": 0.0,
                "maxcor": _N_REMEMBERED,
            },
        )
        if not np.isfinite(result.fun):
            raise ValueError(
                "The loss is not finite; raise alpha or epsilon, or check the probes for extreme "
                "coefficients."
            )
        return result


def _projected_gradient_norm(log_weights: FloatArray, gradient: FloatArray) -> float:
    moved = np.clip(log_weights - gradient, -LOG_WEIGHT_BOUND, LOG_WEIGHT_BOUND)
    return float(np.abs(moved - log_weights).max())
