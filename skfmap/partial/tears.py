"""Tears of a match: where neighbours on a scan end far apart on the reference."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.functional.neighbours import nearest

__all__ = ["faces_with_edges", "sizes_of_tears", "stretched_edges", "without_islands"]


def stretched_edges(
    edges: IntArray, lengths: FloatArray, ways: FloatArray, *, stretch: float, apart: float
) -> IntArray:
    """Return the edges whose ends land too far apart.

    Parameters
    ----------
    edges : ndarray of int, shape (n_edges, 2)
        Of the scan.
    lengths, ways : ndarray of shape (n_edges,)
        Of the edges on the scan, and distances between the answers for their ends along the
        reference, in one unit.
    stretch, apart : float
        How many times its length an edge may become, and how much longer than that, for answers
        err.

    Returns
    -------
    ndarray of int, shape (n_torn, 2)
        Some rows of ``edges``.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.partial.tears import stretched_edges
    >>> edges, lengths = np.array([[0, 1], [1, 2]]), np.array([0.02, 0.02])
    >>> stretched_edges(edges, lengths, np.array([0.03, 0.7]), stretch=2, apart=0.2).tolist()
    [[1, 2]]
    """
    return edges[ways > stretch * lengths + apart]


def sizes_of_tears(edges: IntArray, n_vertices: int) -> FloatArray:
    """Return how large the tear is that each torn edge belongs to.

    That is about how many vertices would have to move to mend it: one where a single vertex is
    answered wrongly, however many neighbours it has (the fractional matching number of the graph
    of torn edges).

    Parameters
    ----------
    edges : ndarray of int, shape (n_edges, 2)
        Torn edges, each once. Those that share vertices make one tear.
    n_vertices : int
        Of the scan.

    Returns
    -------
    ndarray of shape (n_edges,)
        Sizes, multiples of one half.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.partial.tears import sizes_of_tears
    >>> sizes_of_tears(np.array([[0, 1], [0, 2], [0, 3], [4, 5], [5, 6], [6, 7]]), 8).tolist()
    [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]
    """
    if not len(edges):
        return np.zeros(0)
    ends = np.concatenate([edges, edges[:, ::-1]])
    graph = sp.csr_array(
        (np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n_vertices, n_vertices)
    )
    tear = connected_components(graph, directed=False)[1]
    is_matched = np.asarray(maximum_bipartite_matching(sp.csr_matrix(graph))) >= 0
    return np.asarray(np.bincount(tear, is_matched / 2)[tear[edges[:, 0]]])


def without_islands(
    vertices: FloatArray,
    areas: FloatArray,
    edges: IntArray,
    is_torn: BoolArray,
    answers: IntArray,
    least_area: float,
) -> IntArray:
    """Return answers in which islands, torn off all around, have those of the shore.

    A few vertices that are answered wrongly leave no tear then; where parts are glued, the shore
    itself is torn, and a tear remains.

    Parameters
    ----------
    vertices, areas : ndarray of shape (n_vertices, 3), ndarray of shape (n_vertices,)
        Of the scan, and areas of its vertices.
    edges, is_torn : ndarray of int, shape (n_edges, 2), ndarray of bool, shape (n_edges,)
        Of the scan, and which are torn.
    answers : ndarray of int, shape (n_vertices,)
        Of the vertices.
    least_area : float
        Pieces below this are islands.
    """
    whole = edges[~is_torn]
    graph = sp.csr_array(
        (np.ones(len(whole)), (whole[:, 0], whole[:, 1])), shape=(len(vertices), len(vertices))
    )
    piece = connected_components(graph, directed=False)[1]
    is_small = (np.bincount(piece, areas) < least_area)[piece]
    across = np.concatenate([edges[is_torn], edges[is_torn][:, ::-1]])
    across = across[is_small[across[:, 0]] & ~is_small[across[:, 1]]]
    filled = answers.copy()
    for island in np.unique(piece[across[:, 0]]):
        own = np.flatnonzero(piece == island)
        shore = np.unique(across[piece[across[:, 0]] == island, 1])
        filled[own] = answers[shore[nearest(vertices[own], vertices[shore])]]
    return filled


def faces_with_edges(faces: IntArray, edges: IntArray, n_vertices: int) -> BoolArray:
    """Return which faces have one of some edges, shape (n_faces,)."""
    own = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
    asked = np.sort(edges, axis=1).astype(np.int64)
    numbers = own[..., 0].astype(np.int64) * n_vertices + own[..., 1]
    return np.asarray(np.isin(numbers, asked[:, 0] * n_vertices + asked[:, 1]).any(axis=1))
