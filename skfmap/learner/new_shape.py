"""Matching of one new shape."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from sklearn.neighbors import NearestNeighbors

from skfmap._tools.types import FloatArray, IntArray, SparseMatrix
from skfmap.functional.subvertex import nearest_by_lengths, squared_edges
from skfmap.learner.confidence import Confidence
from skfmap.learner.given_answers import (
    GivenReference,
    on_given_meshes,
    point_map_on_given,
)
from skfmap.learner.matcher import Matcher, Solution
from skfmap.learner.signs import count_supporting
from skfmap.refinement import PointMatch
from skfmap.registration import Quality, Registration
from skfmap.shapes import Match, ProbedShape, SkippedShape, SpectralShape

__all__ = [
    "INTERPOLATIONS",
    "MatchedShape",
    "blank_match",
    "images_between",
    "match_shape",
    "match_working_mesh",
    "no_match",
    "place_matrix",
    "point_map",
]

INTERPOLATIONS = (None, "barycentric", "soft")

# Number of vertices of the reference in a row of a soft match, about a vertex and its ring.
_N_SHARED = 8
# Number of vertices of S_i processed at a time, which bounds the memory for candidate triangles.
_CHUNK = 2000


class MatchedShape(NamedTuple):
    """A match, and the solution of equation (2) that it came from.

    ``misfit`` is the quality of a registration that does not fit the shape, otherwise None.
    """

    match: Match
    solution: Solution
    misfit: Quality | None = None


def point_map(matcher: Matcher, shape: ProbedShape, target: GivenReference) -> IntArray:
    """Return the given vertex of S_0 for each given vertex of S_i."""
    after = matcher.match_points(shape, matcher.solve(shape).C)[1]
    if target.is_working and shape.spectral.prolongation is None:
        return after.p2p
    images = images_between(shape.spectral, matcher.reference.spectral, after)
    return point_map_on_given(shape.spectral, after.p2p, images, target)


def match_shape(
    matcher: Matcher,
    confidence: Confidence | None,
    shape: ProbedShape,
    interpolate: str | None,
    refined: bool,
    target: GivenReference,
) -> MatchedShape:
    """Match one shape, and assess how far to trust each vertex.

    Answers are at the vertices of the given mesh. ``refined`` says whether the matcher's refinement
    is the one that ``confidence`` was fitted with.
    """
    found, after = match_working_mesh(matcher, confidence, shape, interpolate, refined)
    if target.is_working and shape.spectral.prolongation is None:
        return found
    images = images_between(shape.spectral, matcher.reference.spectral, after, interpolate)
    match = on_given_meshes(found.match, shape.spectral, images, target, interpolate)
    return found._replace(match=match)


def match_working_mesh(
    matcher: Matcher,
    confidence: Confidence | None,
    shape: ProbedShape,
    interpolate: str | None,
    refined: bool,
) -> tuple[MatchedShape, PointMatch]:
    """Match one shape as `match_shape` does, but between working meshes.

    Also return the point match after refinement, with the points in the embedding.
    """
    solution = matcher.solve(shape, mirrored=True)
    before, after = matcher.match_points(shape, solution.C)
    match = Match(
        p2p=after.p2p,
        expected_error=None,
        confidence=None,
        functional_map=solution.C,
        reduced_map=solution.C @ matcher.stable_basis[:, : matcher.settings.n_stable],
        name=shape.name,
        reference_name=matcher.reference.name,
        refined_map=after.refined_map,
        n_supporting=count_supporting(matcher, shape, after),
        matrix=place_matrix(after, matcher.reference.spectral, interpolate),
        inverse=after.inverse,
        reference_hash=matcher.reference.spectral.given_hash,
    )
    if confidence is not None:
        trust = confidence.assess(matcher, shape, solution, before, after, refined=refined)
        match = replace(match, **trust._asdict())
    misfit = None
    if isinstance(matcher.refinement, Registration):
        quality, fits = matcher.refinement.quality_of(matcher, shape.spectral, after)
        match = replace(match, familiar=fits and match.familiar is not False)
        misfit = None if fits else quality
    return MatchedShape(match, solution, misfit), after


def no_match(shape: SkippedShape, matcher: Matcher, *, assessed: bool) -> Match:
    """Return the answer for a shape that cannot be used: -1 and NaN."""
    spectral_0 = matcher.reference.spectral
    return replace(
        blank_match(matcher, shape.n_vertices, spectral_0.n_given, assessed=assessed),
        name=shape.name,
        reference_name=matcher.reference.name,
        reference_hash=spectral_0.given_hash,
    )


def blank_match(matcher: Matcher, n_i: int, n_0: int, *, assessed: bool) -> Match:
    """Return a match between ``n_i`` and ``n_0`` vertices without answers: -1 and NaN."""
    k, p = len(matcher.stable_basis), matcher.settings.n_stable
    unknown = np.full(n_i, np.nan) if assessed else None
    return Match(
        p2p=np.full(n_i, -1),
        expected_error=unknown,
        confidence=unknown,
        functional_map=np.full((k, k), np.nan),
        reduced_map=np.full((k, p), np.nan),
        n_supporting=np.zeros(n_i, dtype=np.int64),
        matrix=sp.csr_array((n_i, n_0)),
        inverse=np.full(n_0, -1),
    )


def images_between(
    spectral: SpectralShape,
    spectral_0: SpectralShape,
    match: PointMatch,
    interpolate: str | None = None,
) -> SparseMatrix:
    """Return the place of each working vertex of S_i on the working mesh of S_0.

    Places are between vertices if ``interpolate`` says so, or if the given meshes are finer.
    """
    coarse = spectral.keeps_vertices and spectral_0.keeps_vertices
    return place_matrix(match, spectral_0, interpolate if coarse else "barycentric")


def place_matrix(
    match: PointMatch, spectral_0: SpectralShape, interpolate: str | None
) -> SparseMatrix:
    """Return the match as a sparse array of shape (n_vertices_i, n_vertices_0).

    Its rows sum to 1.
    """
    n_i, n_0 = len(match.points_i), len(match.points_0)
    if interpolate == "barycentric":
        columns, weights = _barycentric(match, spectral_0.mesh.faces)
    elif interpolate == "soft":
        columns, weights = _soft(match)
    else:
        columns, weights = match.p2p[:, None], np.ones((n_i, 1))
    rows = np.repeat(np.arange(n_i), columns.shape[1])
    matrix = sp.coo_array((weights.ravel(), (rows, columns.ravel())), shape=(n_i, n_0)).tocsr()
    matrix.eliminate_zeros()
    return matrix


def _soft(match: PointMatch) -> tuple[IntArray, FloatArray]:
    """Return nearest vertices, with Gaussian weights as wide as the distance to the first."""
    n_shared = min(_N_SHARED, len(match.points_0))
    distances, columns = (
        NearestNeighbors(n_neighbors=n_shared, algorithm="brute")
        .fit(match.points_0)
        .kneighbors(match.points_i)
    )
    width = np.maximum(distances[:, :1], 1e-12)
    weights = np.exp(-(np.square(distances) - np.square(width)) / (2 * np.square(width)))
    return columns, weights / weights.sum(axis=1, keepdims=True)


def _barycentric(match: PointMatch, faces: IntArray) -> tuple[IntArray, FloatArray]:
    """Return the nearest point on the triangles around each match, in the embedding."""
    order = np.argsort(faces, axis=None, kind="stable")
    n_0, edges = len(match.points_0), squared_edges(match.points_0[faces])
    start = np.searchsorted(faces.ravel()[order], np.arange(n_0 + 1))
    best_face, best = np.zeros(len(match.p2p), dtype=np.int64), np.zeros((len(match.p2p), 3))
    for first in range(0, len(match.p2p), _CHUNK):
        rows = np.arange(first, min(first + _CHUNK, len(match.p2p)))
        begin, counts = start[match.p2p[rows]], np.diff(start)[match.p2p[rows]]
        owner = np.repeat(np.arange(len(rows)), counts)
        within = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        around = order[np.repeat(begin, counts) + within] // 3
        # Triangles around a vertex share corners, so each distance is computed once.
        keys = owner[:, None] * n_0 + faces[around]
        pairs, back = np.unique(keys.ravel(), return_inverse=True)
        differences = match.points_i[rows[pairs // n_0]] - match.points_0[pairs % n_0]
        to_corners = np.einsum("ij,ij->i", differences, differences)[back].reshape(-1, 3)
        coordinates, squared = nearest_by_lengths(to_corners, edges[around])
        by_distance = np.lexsort((squared, owner))
        nearest = by_distance[np.searchsorted(owner[by_distance], np.arange(len(rows)))]
        best_face[rows], best[rows] = around[nearest], coordinates[nearest]
    return faces[best_face], best
