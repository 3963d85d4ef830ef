"""Calibration of matches of parts, learned from parts of held-out training shapes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from sklearn.linear_model import LogisticRegression

from skfmap._tools.types import BoolArray, FloatArray
from skfmap.partial.body import LaidOnPart, Lesson, Regions
from skfmap.partial.scan import Scan

__all__ = ["PartTrust", "Seen"]

# Added to errors, in sqrt(area), before logarithms are taken, and the ridge penalty.
_LEAST, _RIDGE = 0.005, 1e-2
# Number of bins of vertices by predicted error, in each of which the mean error is taken.
_N_BINS = 15
# Error below which a match counts as right, in sqrt(area), as in `Match.confidence`.
_RIGHT = 0.1
# A scan is unfamiliar if the fraction of it that lies off the reference, or the strain of the
# reference, exceeds this multiple of this quantile over parts of training shapes. The limit of the
# fraction is at least the last value.
_TIMES, _USUAL, _AT_LEAST = 1.5, 0.9, 0.15
# Largest distance from the rim that makes a difference, in sqrt(area).
_REACH = 0.3


class Seen(NamedTuple):
    """A held-out training part, and the reference laid onto it."""

    lesson: Lesson
    laid: LaidOnPart


@dataclass(frozen=True, eq=False, repr=False)
class PartTrust:
    """Calibrated errors, coverage and limits of familiarity.

    Attributes
    ----------
    slopes : ndarray of shape (n_columns,)
        Regression coefficients of the log-error.
    levels, errors, right : ndarray of shape (n_bins,)
        Predicted log-errors, and the mean error and the fraction of right matches at each.
    cover : ndarray of shape (n_signs + 1,)
        Logistic regression coefficients, then the intercept, of the probability that a vertex of
        the reference is covered.
    usual_off, usual_strain : float
        Fraction of a part that lies off the reference, and strain of the reference: quantiles over
        the held-out parts.
    mean_error : float
        Mean error on the held-out parts, in sqrt(area).
    """

    slopes: FloatArray
    levels: FloatArray
    errors: FloatArray
    right: FloatArray
    cover: FloatArray
    usual_off: float
    usual_strain: float
    mean_error: float

    @classmethod
    def learned(cls, seen: Sequence[Seen], regions: Regions) -> Self:
        """Learn from parts of held-out training shapes."""
        columns = [_columns(one.lesson.scan, one.laid) for one in seen]
        errors = [regions.ways(one.lesson.vertices_0, one.laid.p2p) for one in seen]
        X, y = np.concatenate(columns), np.concatenate(errors)
        logarithms = np.log(y + _LEAST)
        penalty = _RIDGE * len(X) * np.eye(X.shape[1])
        penalty[0, 0] = 0.0
        slopes: FloatArray = np.linalg.solve(X.T @ X + penalty, X.T @ logarithms).astype(np.float64)
        levels, means, right = _by_level(X @ slopes, y)
        signs = np.concatenate([one.laid.signs for one in seen])
        covered = np.concatenate([one.lesson.covered for one in seen])
        return cls(
            slopes,
            levels,
            means,
            right,
            _coverage_model(signs, covered),
            float(np.quantile([one.laid.off for one in seen], _USUAL)),
            float(np.quantile([one.laid.strain for one in seen], _USUAL)),
            float(np.mean([error.mean() for error in errors])),
        )

    def assess(self, scan: Scan, laid: LaidOnPart) -> tuple[FloatArray, FloatArray]:
        """Return the expected error and the probability of a right match at each vertex."""
        at = _columns(scan, laid) @ self.slopes
        return np.interp(at, self.levels, self.errors), np.interp(at, self.levels, self.right)

    def coverage(self, laid: LaidOnPart) -> FloatArray:
        """Return the probability that each vertex of the reference is covered."""
        logit = laid.signs @ self.cover[:-1] + self.cover[-1]
        return np.asarray(1 / (1 + np.exp(-logit)))

    def is_familiar(self, laid: LaidOnPart) -> bool:
        """Return whether the reference fits a scan as well as it fits parts of training shapes."""
        off = max(_TIMES * self.usual_off, _AT_LEAST)
        return bool(laid.off <= off and laid.strain <= _TIMES * self.usual_strain)


def is_right(error: FloatArray) -> BoolArray:
    """Return which errors are small enough for a match to count as right."""
    return error < _RIGHT


def _coverage_model(signs: FloatArray, covered: BoolArray) -> FloatArray:
    """Return coefficients of the logit of the probability that a vertex is covered, and intercept.

    Raises
    ------
    ValueError
        If no part lacks anything, or none shows anything.
    """
    if covered.all() or not covered.any():
        what = "nothing of" if covered.all() else "all of"
        raise ValueError(
            f"The cuts removed {what} the training shapes that expected errors are calibrated on. "
            "Give cuts that remove some faces and keep others, or increase n_calibrated."
        )
    model = LogisticRegression().fit(signs, covered)
    return np.append(model.coef_[0], model.intercept_[0])


def _columns(scan: Scan, laid: LaidOnPart) -> FloatArray:
    """Return the regressors of the log-error at each vertex of a scan, with a constant first."""
    n = len(laid.p2p)
    disagreement = np.log(laid.disagreement + 0.02)
    return np.column_stack(
        [
            np.ones(n),
            disagreement,
            np.log(laid.away + _LEAST),
            1 - laid.facing,
            1 - laid.belief,
            np.minimum(scan.from_rim, _REACH) / _REACH,
            np.full(n, disagreement.mean()),
            np.full(n, laid.off),
            np.full(n, 1 - laid.belief.mean()),
            np.full(n, laid.likelihood),
            np.full(n, laid.strain),
        ]
    )


def _by_level(levels: FloatArray, errors: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean errors and fractions of right matches by predicted log-error; both monotonic."""
    order = np.argsort(levels, kind="stable")
    parts = np.array_split(order, min(_N_BINS, len(order)))
    at = np.array([levels[part].mean() for part in parts])
    means = np.maximum.accumulate([errors[part].mean() for part in parts])
    right = np.minimum.accumulate([is_right(errors[part]).mean() for part in parts])
    return at, np.asarray(means), np.asarray(right)
