"""What a match shows at each vertex without knowing the truth."""

import numpy as np
import scipy.sparse as sp

from skfmap._tools.types import FloatArray, IntArray, SparseMatrix
from skfmap.functional.residuals import trusted_functions
from skfmap.geometry.geodesics import edge_graph
from skfmap.learner.matcher import Matcher
from skfmap.refinement import PointMatch
from skfmap.shapes import ProbedShape, SpectralShape

__all__ = ["TINY", "count_supporting", "vertex_signs"]

# Rounds of averaging over neighbours on the shape. On cats left out, expected errors rank points
# by 0.43 without (correlation with true ones), 0.47 after 2, 0.485 after 5, 0.49 after 10 and 20.
_ROUNDS = 5

# Where a logarithm is taken of a sign that may be nil, in sqrt(area): a hundredth of an edge.
TINY = 1e-4

# Root mean square difference, in spreads of the training shapes, up to which stable functions
# support a match: two standard deviations.
_SUPPORTED = 2.0


def vertex_signs(
    matcher: Matcher, shape: ProbedShape, match: PointMatch, *, refined: bool
) -> FloatArray:
    """Return logarithms of what a match shows at each vertex without knowing the truth.

    The array has shape (n_vertices_i, n_signs).

    The distance between matched points of the embedding; how far a vertex comes back when it is
    matched to the reference and from there to the shape; how much the match stretches the edges
    around it; in a refined match, also the distance among the functions that were learned. Each
    once at the vertex, once averaged over its surroundings.
    """
    spectral, spectral_0 = shape.spectral, matcher.reference.spectral
    vertices, edges = spectral.vertices, edge_graph(spectral.vertices, spectral.mesh.faces)
    signs = [
        np.linalg.norm(match.points_i - match.points_0[match.p2p], axis=1),
        np.linalg.norm(vertices - vertices[match.inverse[match.p2p]], axis=1),
        _stretch(edges, spectral_0, match.p2p),
    ]
    if refined:
        signs.append(_learned_distance(matcher, shape, match))
    columns = np.stack(signs, axis=1)
    return np.log(np.hstack([columns, _averaged(edges, columns)]) + TINY)


def _learned_distance(matcher: Matcher, shape: ProbedShape, match: PointMatch) -> FloatArray:
    k, functions = len(match.learned_map), trusted_functions(matcher.residual_covariance)
    points_i = shape.spectral.evecs[:, :k] @ (match.learned_map @ functions)
    points_0 = matcher.reference.spectral.evecs[:, :k] @ functions
    return np.asarray(np.linalg.norm(points_i - points_0[match.p2p], axis=1))


def _stretch(edges: SparseMatrix, spectral_0: SpectralShape, p2p: IntArray) -> FloatArray:
    """Return how much the match stretches the edges around each vertex, as a logarithm."""
    a, b = edges.tocoo().coords
    n, images = len(p2p), spectral_0.vertices[p2p]
    lengths = np.linalg.norm(images[a] - images[b], axis=1)
    before, after = (np.bincount(a, x, n) + np.bincount(b, x, n) for x in (edges.data, lengths))
    return np.asarray(np.abs(np.log((after + TINY) / (before + TINY))))


def _averaged(edges: SparseMatrix, columns: FloatArray) -> FloatArray:
    neighbours = ((edges + edges.T) > 0).astype(np.float64)
    average = sp.diags_array(1 / neighbours.sum(axis=1)) @ neighbours
    for _ in range(_ROUNDS):
        columns = (columns + average @ columns) / 2
    return columns


def count_supporting(matcher: Matcher, shape: ProbedShape, match: PointMatch) -> IntArray:
    """Return how many stable functions, the most stable first, support each match.

    They agree as long as the root mean square of their differences, in units of what the training
    shapes showed, is at most 2.
    """
    k, Y = len(match.learned_map), matcher.stable_basis
    spreads = np.sqrt(np.maximum(np.einsum("ij,ik,kj->j", Y, matcher.residual_covariance, Y), 0.0))
    points_i = shape.spectral.evecs[:, :k] @ (match.learned_map @ Y)
    points_0 = matcher.reference.spectral.evecs[:, :k] @ Y
    differences = (points_i - points_0[match.p2p]) / np.maximum(
        spreads, 1e-6 * max(float(spreads.max()), 1e-300)
    )
    constant = spreads <= 1e-6 * spreads.max()
    differences[:, constant] = 0.0
    mean_squares = np.cumsum(np.square(differences), axis=1) / np.arange(1, k + 1)
    return np.asarray(np.cumprod(mean_squares <= _SUPPORTED**2, axis=1).sum(axis=1), dtype=np.int64)
