"""How far a vertex is off, as the training shapes showed it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.isotonic import IsotonicRegression

from skfmap._caching import cached, hash_of_arrays
from skfmap._matching import nearest_points
from skfmap._parallel import map_shapes
from skfmap._typing import FloatArray, IntArray
from skfmap.geometry.geodesics import farthest_vertices, heat_distances
from skfmap.shapes import JoinedPairs, Mesh, ProbedShape

__all__ = ["TOLERANCE", "ErrorModel", "calibrate", "fit_error_model"]

# Vertices of the reference that errors are observed at.
_N_OBSERVED = 200

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


def calibrate(
    shapes: Sequence[ProbedShape],
    reference: ProbedShape,
    joins: Sequence[JoinedPairs],
    maps: FloatArray,
    functions: FloatArray,
    share: FloatArray,
    *,
    memory: Any,
    n_jobs: int | None,
) -> ErrorModel:
    """Relate residuals to errors at well-spread vertices of the reference, on the training shapes.

    Parameters
    ----------
    shapes, reference : sequence of ProbedShape, ProbedShape
        Training shapes, and S_0.
    joins : sequence of JoinedPairs
        Known pairs of vertices of each shape and of S_0.
    maps : ndarray of shape (n_shapes, k, k)
        Learned maps X_i(D).
    functions : ndarray of shape (k, p)
        What points are matched in.
    share : ndarray of shape (n_shapes,)
        Weight of each shape; one of weight 0 is left out.
    memory : None, str or joblib.Memory
        Where distances are cached.
    n_jobs : int or None
        Shapes at a time.

    Returns
    -------
    ErrorModel
        What to expect on a new shape.
    """
    used = [i for i in range(len(shapes)) if share[i] > 0]
    mesh = reference.spectral.mesh
    known = np.unique(np.concatenate([joins[i].vertices_0 for i in used]))
    chosen, distances = cached(_distances_from_some, memory)(
        (mesh, known), hash_of_arrays(mesh.vertices, mesh.faces, known)
    )
    arguments = ((shapes[i], reference, joins[i], (maps[i], functions), (chosen, distances)) for i in used)
    observed = map_shapes(_observe_errors, arguments, n_jobs=n_jobs, verbose=0)
    weights = [share[i] * own for i, (_, _, own) in zip(used, observed, strict=True)]
    residuals, errors = (np.concatenate([part[j] for part in observed]) for j in range(2))
    return fit_error_model(residuals, errors, np.concatenate(weights))


def _distances_from_some(where: tuple[Mesh, IntArray], content_hash: str) -> tuple[IntArray, FloatArray]:  # noqa: ARG001
    """Return well-spread vertices among the known ones, and the distances from each to all, at unit area."""
    mesh, known = where
    chosen = np.sort(farthest_vertices(mesh.vertices, mesh.faces, known, _N_OBSERVED))
    return chosen, heat_distances(mesh.vertices / np.sqrt(mesh.area), mesh.faces, chosen)


def _observe_errors(
    shape: ProbedShape,
    reference: ProbedShape,
    join: JoinedPairs,
    maps: tuple[FloatArray, FloatArray],
    known: tuple[IntArray, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return residuals, errors and weights at the pairs of a training shape whose true vertex has known distances."""
    C, functions = maps
    chosen, distances = known
    rows = np.flatnonzero(np.isin(join.vertices_0, chosen))
    if len(rows) == 0:
        return np.empty(0), np.empty(0), np.empty(0)
    evecs_i = shape.spectral.evecs[join.vertices_i[rows]]
    p2p, residuals = nearest_points(evecs_i, reference.spectral.evecs, C, functions)
    return residuals, distances[np.searchsorted(chosen, join.vertices_0[rows]), p2p], join.weights[rows]
