"""How far a vertex is off: what matches of training shapes look like where they are good, and where they are not."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from sklearn.isotonic import IsotonicRegression
from sklearn.linear_model import GammaRegressor

from skfmap._caching import cached, hash_of_arrays
from skfmap._matching import Matcher, PointMatch
from skfmap._typing import FloatArray, IntArray
from skfmap.functional.residuals import trusted_functions
from skfmap.geometry.geodesics import edge_graph, farthest_vertices, heat_distances
from skfmap.shapes import JoinedPairs, Mesh, ProbedShape, SpectralShape

__all__ = [
    "TOLERANCE",
    "ErrorModel",
    "Observation",
    "Watch",
    "count_supporting",
    "fit_error_model",
    "observe",
    "vertex_signs",
    "watch_reference",
]

# Vertices of the reference that errors are observed at.
_N_WATCHED = 500
# Width, in sqrt(area), over which errors at neighbouring vertices of the reference are averaged.
_WIDTH = 0.05
# Rounds of averaging over neighbours on the shape.
_ROUNDS = 5
_TINY = 1e-4
# Root mean square difference, in spreads of the training shapes, up to which stable functions support a match.
_SUPPORTED = 2.0

TOLERANCE = 0.1
"""Error, in units of sqrt(area), up to which a vertex counts as matched in `Match.confidence`."""


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """Expected error and confidence from the signs that a match gives of itself.

    A Gamma regression with a logarithmic link on the standardised logarithms of the signs ranks the vertices; isotonic
    regressions turn the rank into an error and into a share of hits.

    Attributes
    ----------
    mean, scale, coefficients : ndarray of shape (n_signs,)
        Of the regression.
    knots : ndarray of shape (n,)
        Ascending values of the regression.
    expected_error : ndarray of shape (n,)
        Mean geodesic error there, in units of sqrt(area); not decreasing.
    confidence : ndarray of shape (n,)
        Share of errors below `TOLERANCE` there; not increasing.
    reference_errors : ndarray of shape (n_vertices_0,)
        Mean error of training shapes around each vertex of the reference.
    cross_validated : bool
        Whether errors are those of shapes that were left out of the learning.
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
        """Return an `embedding_distance` in units of the worst training shape's."""
        return distance / max(self.worst_distance, _TINY)

    def predict(self, signs: FloatArray, p2p: IntArray, misfit: float) -> tuple[FloatArray, FloatArray]:
        """Return expected error and confidence of each vertex; beyond the knots the last value holds.

        Nothing was seen of shapes with a misfit beyond 1. Their errors are raised, and confidences lowered, by its
        square, up to chance: creatures that were stretched, cut and swapped for other animals are off by that.
        """
        columns = np.column_stack([signs, np.log(self.reference_errors[p2p] + _TINY)])
        rank = ((columns - self.mean) / self.scale) @ self.coefficients
        error, hits = np.interp(rank, self.knots, self.expected_error), np.interp(rank, self.knots, self.confidence)
        unseen = max(1.0, misfit) ** 2
        return np.clip(unseen * error, None, np.maximum(error, self.chance)), hits / unseen


class Watch(NamedTuple):
    """Well-spread vertices of the reference, and the distances from each to all, at unit area."""

    vertices: IntArray
    distances: FloatArray


class Observation(NamedTuple):
    """What a training shape showed at the watched vertices: signs, errors, weights, matches and places in the watch."""

    signs: FloatArray
    errors: FloatArray
    weights: FloatArray
    matched: IntArray
    watched: IntArray


def watch_reference(reference: ProbedShape, joins: Sequence[JoinedPairs], memory: Any) -> Watch:
    """Choose the vertices of the reference at which errors are observed, among those with known pairs."""
    mesh = reference.spectral.mesh
    known = np.unique(np.concatenate([join.vertices_0 for join in joins]))
    content_hash = hash_of_arrays(mesh.vertices, mesh.faces, known)
    return Watch(*cached(_distances_from_some, memory)((mesh, known), content_hash))


def _distances_from_some(where: tuple[Mesh, IntArray], content_hash: str) -> tuple[IntArray, FloatArray]:  # noqa: ARG001
    mesh, known = where
    at_unit_area = mesh.vertices / np.sqrt(mesh.area)
    chosen, edge_paths = farthest_vertices(at_unit_area, mesh.faces, known, _N_WATCHED)
    order = np.argsort(chosen)
    return chosen[order], heat_distances(at_unit_area, mesh.faces, chosen[order], edge_paths[order])


def observe(
    matcher: Matcher, shape: ProbedShape, join: JoinedPairs, areas: FloatArray, match: PointMatch, watch: Watch
) -> Observation:
    """Return signs and errors at the pairs of a training shape that lead to watched vertices and have an area."""
    rows = np.flatnonzero(np.isin(join.vertices_0, watch.vertices) & (areas > 0))
    at = join.vertices_i[rows]
    watched = np.searchsorted(watch.vertices, join.vertices_0[rows])
    matched = match.p2p[at]
    signs = vertex_signs(matcher, shape, match)[at]
    return Observation(signs, watch.distances[watched, matched], join.weights[rows], matched, watched)


def vertex_signs(matcher: Matcher, shape: ProbedShape, match: PointMatch) -> FloatArray:
    """Return logarithms of what a match shows at each vertex without knowing the truth, shape (n_vertices_i, n_signs).

    The distance between matched points of the embedding; how far a vertex comes back when it is matched to the
    reference and from there to the shape; how much the match stretches the edges around it; in a refined match, also
    the distance among the functions that were learned. Each once at the vertex, once averaged over its surroundings.
    """
    spectral, spectral_0 = shape.spectral, matcher.reference.spectral
    vertices = spectral.vertices
    signs = [
        np.linalg.norm(match.points_i - match.points_0[match.p2p], axis=1),
        np.linalg.norm(vertices - vertices[match.inverse[match.p2p]], axis=1),
        _stretch(spectral, spectral_0, match.p2p),
    ]
    if match.refined_map is not None:
        signs.append(_learned_distance(matcher, shape, match))
    columns = np.stack(signs, axis=1)
    return np.log(np.hstack([columns, _averaged(spectral.mesh, columns)]) + _TINY)


def _learned_distance(matcher: Matcher, shape: ProbedShape, match: PointMatch) -> FloatArray:
    k, functions = len(match.learned_map), trusted_functions(matcher.residual_covariance)
    points_i = shape.spectral.evecs[:, :k] @ (match.learned_map @ functions)
    points_0 = matcher.reference.spectral.evecs[:, :k] @ functions
    return np.asarray(np.linalg.norm(points_i - points_0[match.p2p], axis=1))


def _stretch(spectral: SpectralShape, spectral_0: SpectralShape, p2p: IntArray) -> FloatArray:
    """Return the absolute logarithm of how much longer the edges around each vertex are on the reference."""
    edges = edge_graph(spectral.vertices, spectral.mesh.faces).tocoo()
    a, b = edges.coords
    n, images = spectral.mesh.n_vertices, spectral_0.vertices[p2p]
    lengths = np.linalg.norm(images[a] - images[b], axis=1)
    before, after = (np.bincount(a, x, n) + np.bincount(b, x, n) for x in (edges.data, lengths))
    return np.asarray(np.abs(np.log((after + _TINY) / (before + _TINY))))


def _averaged(mesh: Mesh, columns: FloatArray) -> FloatArray:
    edges = edge_graph(mesh.vertices, mesh.faces)
    neighbours = ((edges + edges.T) > 0).astype(np.float64)
    average = sp.diags_array(1 / neighbours.sum(axis=1)) @ neighbours
    for _ in range(_ROUNDS):
        columns = (columns + average @ columns) / 2
    return columns


def fit_error_model(
    observations: Sequence[Observation], watch: Watch, *, worst_distance: float, cross_validated: bool
) -> ErrorModel:
    """Fit the model to what training shapes showed, on at most 50 knots.

    Parameters
    ----------
    observations : sequence of Observation
        One for each training shape, weighted by its share.
    watch : Watch
        Where they were made.
    worst_distance : float
        Largest `embedding_distance` of the shapes.
    cross_validated : bool
        Whether the shapes were left out of the learning.

    Returns
    -------
    ErrorModel
        What to expect on a new shape.
    """
    sums, counts = (
        np.stack(part) for part in zip(*(_by_vertex(o, len(watch.vertices)) for o in observations), strict=True)
    )
    near = np.exp(-np.square(watch.distances / _WIDTH) / 2)
    errors_0 = _spread(near, sums.sum(axis=0), counts.sum(axis=0))
    columns = []
    for i, observation in enumerate(observations):
        others = [j for j in range(len(observations)) if j != i] or [i]
        known = _spread(near, sums[others].sum(axis=0), counts[others].sum(axis=0))
        columns.append(np.column_stack([observation.signs, np.log(known[observation.matched] + _TINY)]))
    signs = np.concatenate(columns)
    errors, weights = (np.concatenate([o[j] for o in observations]) for j in (1, 2))
    mean, scale = signs.mean(axis=0), signs.std(axis=0)
    scale = np.where(scale > 1e-9 * np.abs(mean), scale, 1.0)  # what does not differ but for rounding says nothing
    regression = GammaRegressor(alpha=1e-2, max_iter=1000)
    coefficients = regression.fit((signs - mean) / scale, errors + _TINY, sample_weight=weights).coef_
    rank = ((signs - mean) / scale) @ coefficients
    knots = np.unique(np.quantile(rank, np.linspace(0, 1, 50)))
    error = IsotonicRegression(increasing=True, out_of_bounds="clip").fit(rank, errors, weights)
    hit = IsotonicRegression(increasing=False, out_of_bounds="clip").fit(rank, errors <= TOLERANCE, weights)
    expected, confidence = np.asarray(error.predict(knots)), np.asarray(hit.predict(knots))
    overall = float(np.average(errors, weights=weights))
    model = (mean, scale, coefficients, knots, expected, confidence, errors_0, cross_validated, overall)
    return ErrorModel(*model, worst_distance, float(watch.distances.mean()))


def _by_vertex(observation: Observation, n_watched: int) -> tuple[FloatArray, FloatArray]:
    """Return the weighted sum of errors at each watched vertex, and the sum of weights."""
    _, errors, weights, _, watched = observation
    sums, counts = (np.bincount(watched, values, n_watched) for values in (weights * errors, weights))
    return sums.astype(np.float64), counts.astype(np.float64)


def _spread(near: FloatArray, sums: FloatArray, counts: FloatArray) -> FloatArray:
    """Return errors averaged around each vertex of the reference; far from all that was seen, the mean of all."""
    overall = sums.sum() / max(float(counts.sum()), 1e-300)
    return np.asarray((sums @ near + 1e-3 * overall) / (counts @ near + 1e-3))


def count_supporting(matcher: Matcher, shape: ProbedShape, match: PointMatch) -> IntArray:
    """Return how many stable functions, the most stable first, agree that a vertex and its match are the same point.

    They agree as long as the root mean square of their differences, in units of what the training shapes showed, is at
    most 2.
    """
    k, Y = len(match.learned_map), matcher.stable_basis
    spreads = np.sqrt(np.maximum(np.einsum("ij,ik,kj->j", Y, matcher.residual_covariance, Y), 0.0))
    points_i = shape.spectral.evecs[:, :k] @ (match.learned_map @ Y)
    points_0 = matcher.reference.spectral.evecs[:, :k] @ Y
    differences = (points_i - points_0[match.p2p]) / np.maximum(spreads, 1e-6 * max(float(spreads.max()), 1e-300))
    constant = spreads <= 1e-6 * spreads.max()
    differences[:, constant] = 0.0
    mean_squares = np.cumsum(np.square(differences), axis=1) / np.arange(1, k + 1)
    return np.asarray(np.cumprod(mean_squares <= _SUPPORTED**2, axis=1).sum(axis=1), dtype=np.int64)
