"""How far a vertex is off, as the training shapes showed it."""

from dataclasses import dataclass

import numpy as np
from sklearn.isotonic import IsotonicRegression

from skfmap._typing import FloatArray

__all__ = ["TOLERANCE", "ErrorModel", "fit_error_model"]

TOLERANCE = 0.1
"""Error, in units of sqrt(area), up to which a vertex counts as matched in `Match.confidence`."""


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """Expected error and confidence as monotone functions of the distance between matched embeddings.

    Attributes
    ----------
    residuals : ndarray of shape (n,)
        Knots: distance of a vertex of S_i from its match among the stable functions, ascending.
    expected_error : ndarray of shape (n,)
        Mean geodesic error there, in units of sqrt(area); not decreasing.
    confidence : ndarray of shape (n,)
        Share of errors below `TOLERANCE` there; not increasing.
    """

    residuals: FloatArray
    expected_error: FloatArray
    confidence: FloatArray

    def predict(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return expected error and confidence at each residual; beyond the knots the last value holds."""
        return (
            np.interp(residuals, self.residuals, self.expected_error),
            np.interp(residuals, self.residuals, self.confidence),
        )


def fit_error_model(residuals: FloatArray, errors: FloatArray, weights: FloatArray) -> ErrorModel:
    """Fit by isotonic regression, on at most 50 knots.

    Parameters
    ----------
    residuals, errors : ndarray of shape (n_samples,)
        Distances among the stable functions, and geodesic errors, of vertices of training shapes.
    weights : ndarray of shape (n_samples,)
        Share of each, positive.

    Returns
    -------
    ErrorModel
        What to expect on a new shape.
    """
    knots = np.unique(np.quantile(residuals, np.linspace(0, 1, 50)))
    error = IsotonicRegression(increasing=True, out_of_bounds="clip").fit(residuals, errors, weights)
    hit = IsotonicRegression(increasing=False, out_of_bounds="clip").fit(residuals, errors <= TOLERANCE, weights)
    return ErrorModel(knots, np.asarray(error.predict(knots)), np.asarray(hit.predict(knots)))
