"""What is wrong with the connectivity or the triangles of a mesh."""

import numpy as np
import scipy.sparse as sp

from skfmap._typing import BoolArray, FloatArray, IntArray

__all__ = [
    "boundary_vertices",
    "count_components",
    "degenerate_faces",
    "edges_of",
    "is_wound_consistently",
    "nonmanifold_edges",
    "repeated_corners",
    "unreferenced_vertices",
]


def unreferenced_vertices(faces: IntArray, n_vertices: int) -> IntArray:
    """Return the vertices that no face uses."""
    return np.setdiff1d(np.arange(n_vertices), faces)


def repeated_corners(faces: IntArray) -> IntArray:
    """Return the faces that name one vertex twice."""
    a, b, c = faces.T
    return np.flatnonzero((a == b) | (b == c) | (c == a))


def degenerate_faces(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Return the faces whose area is nil to rounding, against the squared longest edge."""
    corners = vertices[faces]
    edges = np.roll(corners, -1, axis=1) - corners
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    longest = (edges**2).sum(axis=2).max(axis=1)
    return np.flatnonzero(area <= 1e-10 * longest)


def nonmanifold_edges(faces: IntArray) -> IntArray:
    """Return the edges, shape (n, 2), that more than two faces share."""
    edges, counts = _count_edges(np.sort(_half_edges(faces), axis=1))
    return edges[counts > 2]


def count_components(faces: IntArray, n_vertices: int) -> int:
    """Return the number of connected components, isolated vertices included."""
    edges = _half_edges(faces).astype(np.int32)
    links = sp.coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n_vertices, n_vertices))
    return int(sp.csgraph.connected_components(links, directed=False)[0])


def is_wound_consistently(faces: IntArray) -> bool:
    """Return whether no directed edge is used by two faces."""
    _, counts = _count_edges(_half_edges(faces))
    return bool((counts == 1).all())


def boundary_vertices(faces: IntArray, n_vertices: int) -> BoolArray:
    """Return a mask of the vertices on an edge that only one face has."""
    edges, counts = _count_edges(np.sort(_half_edges(faces), axis=1))
    mask = np.zeros(n_vertices, dtype=bool)
    mask[edges[counts == 1]] = True
    return mask


def edges_of(faces: IntArray) -> IntArray:
    """Return the undirected edges, each once, shape (n_edges, 2)."""
    return _count_edges(np.sort(_half_edges(faces), axis=1))[0]


def _half_edges(faces: IntArray) -> IntArray:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _count_edges(edges: IntArray) -> tuple[IntArray, IntArray]:
    """Return the different pairs of vertices in order, and how often each occurs."""
    base = int(edges.max(initial=0)) + 1
    # One number for each pair: sorting numbers is many times faster than sorting rows.
    keys, counts = np.unique(edges[:, 0].astype(np.int64) * base + edges[:, 1], return_counts=True)
    return np.stack(np.divmod(keys, base), axis=1), counts
