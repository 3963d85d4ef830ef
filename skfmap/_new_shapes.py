"""The match of one new shape, from what was learned."""

import numpy as np
import scipy.sparse as sp
from sklearn.neighbors import NearestNeighbors

from skfmap._confidence import ErrorModel, count_supporting, vertex_signs
from skfmap._matching import UNREFINED, Matcher, PointMatch, embedding_distance, match_points
from skfmap._typing import FloatArray, IntArray, SparseMatrix
from skfmap.functional.subvertex import nearest_on_triangles
from skfmap.shapes import Match, ProbedShape

__all__ = ["INTERPOLATIONS", "match_shape", "point_map"]

INTERPOLATIONS = (None, "barycentric", "soft")

# Vertices of the reference that a soft match is shared among.
_N_SHARED = 8
# Vertices of S_i at a time: memory of the candidate triangles.
_CHUNK = 2000


def point_map(matcher: Matcher, shape: ProbedShape) -> IntArray:
    """Return the vertex of S_0 for each vertex of S_i."""
    return match_points(matcher, shape)[1].p2p


def match_shape(
    matcher: Matcher, error_models: dict[str, ErrorModel], shape: ProbedShape, interpolate: str | None
) -> Match:
    """Match one shape, and say how far to trust each vertex."""
    before, after = match_points(matcher, shape)
    refine = matcher.settings.refine
    unrefined = error_models.get(UNREFINED)  # nothing is calibrated yet while a fit is under way, in a callback
    misfit = np.nan if unrefined is None else unrefined.misfit(embedding_distance(shape, before))
    expected_error, confidence = _expect(error_models, refine, matcher, shape, before, after, misfit)
    stable = matcher.stable_basis[:, : matcher.settings.n_stable]
    return Match(
        after.p2p,
        expected_error,
        confidence,
        after.learned_map,
        after.learned_map @ stable,
        shape.name,
        matcher.reference.name,
        refined_map=after.refined_map,
        n_supporting=count_supporting(matcher, shape, after),
        matrix=_matrix(matcher, after, interpolate),
        inverse=after.inverse,
        reference_hash=matcher.reference.spectral.mesh.content_hash,
        misfit=misfit,
    )


def _expect(
    error_models: dict[str, ErrorModel],
    refine: str | None,
    matcher: Matcher,
    shape: ProbedShape,
    before: PointMatch,
    after: PointMatch,
    misfit: float,
) -> tuple[FloatArray, FloatArray]:
    if not error_models:
        unknown = np.full(len(after.p2p), np.nan)
        return unknown, unknown
    kind, match = (refine, after) if refine in error_models else (UNREFINED, before)
    return error_models[kind].predict(vertex_signs(matcher, shape, match), match.p2p, misfit)


def _matrix(matcher: Matcher, match: PointMatch, interpolate: str | None) -> SparseMatrix:
    """Return the match as a sparse array of shape (n_vertices_i, n_vertices_0), rows summing to 1."""
    n_i, n_0 = len(match.points_i), len(match.points_0)
    if interpolate == "barycentric":
        columns, weights = _barycentric(match, matcher.reference.spectral.mesh.faces)
    elif interpolate == "soft":
        columns, weights = _soft(match)
    else:
        columns, weights = match.p2p[:, None], np.ones((n_i, 1))
    rows = np.repeat(np.arange(n_i), columns.shape[1])
    matrix = sp.coo_array((weights.ravel(), (rows, columns.ravel())), shape=(n_i, n_0)).tocsr()
    matrix.eliminate_zeros()
    return matrix


def _soft(match: PointMatch) -> tuple[IntArray, FloatArray]:
    """Share each vertex among its nearest, by a Gaussian as wide as the distance to the nearest."""
    n_shared = min(_N_SHARED, len(match.points_0))
    distances, columns = (
        NearestNeighbors(n_neighbors=n_shared, algorithm="brute").fit(match.points_0).kneighbors(match.points_i)
    )
    width = np.maximum(distances[:, :1], 1e-12)
    weights = np.exp(-(np.square(distances) - np.square(width)) / (2 * np.square(width)))
    return columns, weights / weights.sum(axis=1, keepdims=True)


def _barycentric(match: PointMatch, faces: IntArray) -> tuple[IntArray, FloatArray]:
    """Return the nearest point on the triangles around each match, in the embedding."""
    order = np.argsort(faces, axis=None, kind="stable")
    start = np.searchsorted(faces.ravel()[order], np.arange(len(match.points_0) + 1))
    best_face, best = np.zeros(len(match.p2p), dtype=np.int64), np.zeros((len(match.p2p), 3))
    for first in range(0, len(match.p2p), _CHUNK):
        rows = np.arange(first, min(first + _CHUNK, len(match.p2p)))
        begin, counts = start[match.p2p[rows]], np.diff(start)[match.p2p[rows]]
        owner = np.repeat(np.arange(len(rows)), counts)
        within = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        around = order[np.repeat(begin, counts) + within] // 3
        coordinates, squared = nearest_on_triangles(match.points_i[rows[owner]], match.points_0[faces[around]])
        by_distance = np.lexsort((squared, owner))
        nearest = by_distance[np.searchsorted(owner[by_distance], np.arange(len(rows)))]
        best_face[rows], best[rows] = around[nearest], coordinates[nearest]
    return faces[best_face], best
