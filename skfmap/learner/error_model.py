"""Expected errors at vertices from observable signs of a match."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from sklearn.isotonic import IsotonicRegression
from sklearn.linear_model import GammaRegressor

from skfmap._tools.types import FloatArray, IntArray
from skfmap.learner.observation import Observation, Watch
from skfmap.learner.signs import TINY

__all__ = ["TOLERANCE", "ErrorModel", "fit_error_model"]

# Width, in sqrt(area), over which errors at neighbouring vertices of the reference are averaged.
# On cats left out, 0.02 to 0.2 rank points equally well (correlation with true errors 0.476 to
# 0.485).
_WIDTH = 0.05
# Weight of the overall mean, which decides where there are no observations nearby: a thousandth of
# one observation.
_WEIGHT_OF_ALL = 1e-3
# Ridge penalty of the regression, enough to make it unique if signs are collinear.
_RIDGE = 1e-2
# Number of knots of the curves, so that each step has 2 % of the points.
_N_KNOTS = 50

TOLERANCE = 0.1


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """Model of the expected error and the confidence, given observable signs of a match.

    A Gamma regression with a logarithmic link on the standardised logarithms of the signs ranks the
    vertices; isotonic regressions turn the rank into an error and a fraction of hits.

    Attributes
    ----------
    mean, scale, coefficients : ndarray of shape (n_signs,)
        Mean and scale of the signs, and coefficients of the regression.
    knots : ndarray of shape (n,)
        Values of the regression, ascending.
    expected_error : ndarray of shape (n,)
        Mean geodesic error at the knots, in units of sqrt(area); non-decreasing.
    confidence : ndarray of shape (n,)
        Fraction of errors of at most `TOLERANCE` at the knots; non-increasing.
    reference_errors : ndarray of shape (n_vertices_0,)
        Mean error of training shapes around each vertex of the reference.
    cross_validated : bool
        Whether the errors are those of held-out shapes.
    mean_error : float
        Mean error of the training shapes.
    worst_distance : float
        Largest `embedding_distance` of a training shape, before refinement.
    chance : float
        Mean error of points that are matched at random.
    """

    mean: FloatArray
    scale: FloatArray
    coefficients: FloatArray
    knots: FloatArray
    expected_error: FloatArray
    confidence: FloatArray
    reference_errors: FloatArray
    cross_validated: bool
    mean_error: float
    worst_distance: float
    chance: float

    def misfit(self, distance: float) -> float:
        """Return an `embedding_distance` in units of the largest on training shapes."""
        return distance / max(self.worst_distance, TINY)

    def predict(
        self, signs: FloatArray, p2p: IntArray, misfit: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return the expected error and the confidence of each vertex.

        Beyond the knots the last value is used.

        No training shape had a misfit above 1. Beyond it, errors are multiplied, and confidences
        divided, by the square of the misfit, with errors at most those of chance. This agrees with
        the errors of creatures that were stretched, cut, or replaced by other animals.
        """
        columns = np.column_stack([signs, np.log(self.reference_errors[p2p] + TINY)])
        rank = ((columns - self.mean) / self.scale) @ self.coefficients
        error, hits = (
            np.interp(rank, self.knots, self.expected_error),
            np.interp(rank, self.knots, self.confidence),
        )
        unseen = max(1.0, misfit) ** 2
        return np.clip(unseen * error, None, np.maximum(error, self.chance)), hits / unseen


def fit_error_model(
    observations: Sequence[Observation],
    watch: Watch,
    *,
    worst_distance: float,
    cross_validated: bool,
) -> ErrorModel:
    """Fit the model to observations on training shapes, with at most 50 knots.

    Parameters
    ----------
    observations : sequence of Observation
        One for each training shape, weighted by its share.
    watch : Watch
        The vertices of the reference at which errors were observed.
    worst_distance : float
        Largest `embedding_distance` of the shapes.
    cross_validated : bool
        Whether the shapes were held out.

    Returns
    -------
    ErrorModel
        The fitted model.
    """
    sums, counts = (
        np.stack(part)
        for part in zip(*(_by_vertex(o, len(watch.vertices)) for o in observations), strict=True)
    )
    near = np.exp(-np.square(watch.distances / _WIDTH) / 2)
    errors_0 = _spread(near, sums.sum(axis=0), counts.sum(axis=0))
    columns = []
    for i, observation in enumerate(observations):
        others = [j for j in range(len(observations)) if j != i] or [i]
        known = _spread(near, sums[others].sum(axis=0), counts[others].sum(axis=0))
        columns.append(
            np.column_stack([observation.signs, np.log(known[observation.matched] + TINY)])
        )
    signs = np.concatenate(columns)
    errors, weights = (np.concatenate([o[j] for o in observations]) for j in (1, 2))
    mean, scale = signs.mean(axis=0), signs.std(axis=0)
    scale = np.where(
        scale > 1e-9 * np.abs(mean), scale, 1.0
    )  # a sign that is constant up to rounding carries no information
    regression = GammaRegressor(alpha=_RIDGE, max_iter=1000)
    coefficients = regression.fit(
        (signs - mean) / scale, errors + TINY, sample_weight=weights
    ).coef_
    rank = ((signs - mean) / scale) @ coefficients
    knots = np.unique(np.quantile(rank, np.linspace(0, 1, _N_KNOTS)))
    error = IsotonicRegression(increasing=True, out_of_bounds="clip").fit(rank, errors, weights)
    hit = IsotonicRegression(increasing=False, out_of_bounds="clip").fit(
        rank, errors <= TOLERANCE, weights
    )
    expected, confidence = np.asarray(error.predict(knots)), np.asarray(hit.predict(knots))
    overall = float(np.average(errors, weights=weights))
    model = (
        mean,
        scale,
        coefficients,
        knots,
        expected,
        confidence,
        errors_0,
        cross_validated,
        overall,
    )
    return ErrorModel(*model, worst_distance, float(watch.distances.mean()))


def _by_vertex(observation: Observation, n_watched: int) -> tuple[FloatArray, FloatArray]:
    """Return the weighted sum of errors and the sum of weights at each watched vertex."""
    _, errors, weights, _, watched = observation
    sums, counts = (
        np.bincount(watched, values, n_watched) for values in (weights * errors, weights)
    )
    return sums.astype(np.float64), counts.astype(np.float64)


def _spread(near: FloatArray, sums: FloatArray, counts: FloatArray) -> FloatArray:
    """Return errors averaged around each vertex of the reference.

    Far from all observations this is the overall mean.
    """
    overall = sums.sum() / max(float(counts.sum()), 1e-300)
    return np.asarray((sums @ near + _WEIGHT_OF_ALL * overall) / (counts @ near + _WEIGHT_OF_ALL))
