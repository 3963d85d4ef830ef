"""Tears of a match, where neighbours on a scan are matched far apart on the reference."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.functional.neighbours import nearest

__all__ = ["faces_with_edges", "sizes_of_tears", "stretched_edges", "without_islands"]


def stretched_edges(
    edges: IntArray, lengths: FloatArray, ways: FloatArray, *, stretch: float, apart: float
) -> IntArray:
    """Return the edges whose ends are matched too far apart.

    Parameters
    ----------
    edges : ndarray of int, shape (n_edges, 2)
        Edges of the scan.
    lengths, ways : ndarray of shape (n_edges,)
        Lengths of the edges on the scan, and distances between the matches of their ends along
        the reference, in the same units.
    stretch, apart : float
        An edge is torn if ``ways > stretch * lengths + apart``. The second value allows for errors
        of the match.

    Returns
    -------
    ndarray of int, shape (n_torn, 2)
        The torn rows of ``edges``.

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
    """Return the size of the tear that each torn edge belongs to.

    The size is approximately the number of vertices that would have to move to mend the tear. It
    is 1 if a single vertex is matched wrongly, however many neighbours it has (the fractional
    matching number of the graph of torn edges).

    Parameters
    ----------
    edges : ndarray of int, shape (n_edges, 2)
        Torn edges, each once. Edges that share vertices belong to the same tear.
    n_vertices : int
        Number of vertices of the scan.

    Returns
    -------
    ndarray of shape (n_edges,)
        Sizes, which are multiples of 0.5.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.partial.tears import sizes_of_tears
    >>> sizes_of_tears(np.array([[0, 1], [0, 2], [0, 3], [4, 5], [5, 6], [6, 7]]), 8).tolist()
    [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]
    """
    if not len(edges):
        return np.zeros(0)
    # SciPy 1.14 matches graphs with 32-bit indices only.
    ends = np.concatenate([edges, edges[:, ::-1]]).astype(np.int32)
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
    """Return matches in which small islands, torn off all around, take those of their surroundings.

    A few wrongly matched vertices then leave no tear. Where parts are glued, the surroundings
    themselves are torn, and a tear remains.

    Parameters
    ----------
    vertices, areas : ndarray of shape (n_vertices, 3), ndarray of shape (n_vertices,)
        Vertices of the scan, and their areas.
    edges, is_torn : ndarray of int, shape (n_edges, 2), ndarray of bool, shape (n_edges,)
        Edges of the scan, and which of them are torn.
    answers : ndarray of int, shape (n_vertices,)
        Matched vertices of the reference.
    least_area : float
        Components with a smaller area are islands.
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
    """Return which faces contain one of the given edges, shape (n_faces,)."""
    own = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
    asked = np.sort(edges, axis=1).astype(np.int64)
    numbers = own[..., 0].astype(np.int64) * n_vertices + own[..., 1]
    return np.asarray(np.isin(numbers, asked[:, 0] * n_vertices + asked[:, 1]).any(axis=1))
