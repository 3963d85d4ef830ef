"""Signs of the quality of a match that can be observed without knowing the truth."""

import numpy as np
import scipy.sparse as sp

from skfmap._tools.types import FloatArray, IntArray, SparseMatrix
from skfmap.functional.residuals import trusted_functions
from skfmap.geometry.geodesics import edge_graph
from skfmap.learner.matcher import Matcher
from skfmap.refinement import PointMatch
from skfmap.shapes import ProbedShape, SpectralShape

__all__ = ["TINY", "count_supporting", "vertex_signs"]

# Rounds of averaging over neighbours on the shape. On cats left out, the rank correlation of
# expected and true errors is 0.43 without, 0.47 after 2, 0.485 after 5, 0.49 after 10 and 20.
_ROUNDS = 5

# Added to signs before the logarithm, because they may be zero; in sqrt(area), a hundredth of an
# edge.
TINY = 1e-4

# Stable functions support a match up to this root mean square difference, in standard deviations
# of the training shapes.
_SUPPORTED = 2.0


def vertex_signs(
    matcher: Matcher, shape: ProbedShape, match: PointMatch, *, refined: bool
) -> FloatArray:
    """Return logarithms of signs of match quality at each vertex, shape (n_vertices_i, n_signs).

    The signs are the distance between matched points in the embedding; how far from itself a vertex
    returns when it is matched to the reference and back; how much the match stretches the edges
    around it; and, for a refined match, the distance in the learned functions. Each occurs twice:
    at the vertex, and averaged over its surroundings.
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
    """Return the number of stable functions, from the most stable on, that support each match.

    Functions support a match as long as the root mean square of their differences, in standard
    deviations of the training shapes, is at most 2.
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
