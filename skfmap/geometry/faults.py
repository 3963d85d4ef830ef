"""What is wrong with the connectivity or the triangles of a mesh."""

import numpy as np
import scipy.sparse as sp

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap._tools.validation import is_finite

__all__ = [
    "boundary_pieces",
    "boundary_vertices",
    "components",
    "count_components",
    "degenerate_faces",
    "duplicate_faces",
    "duplicate_vertices",
    "edges_of",
    "is_wound_consistently",
    "nonmanifold_edges",
    "nonmanifold_vertices",
    "repeated_corners",
    "slivers",
    "sound_faces",
    "unreferenced_vertices",
]


# Area over squared longest edge (half the height over that edge) of a face that has none.
# Cotangents of 1e10 leave six of sixteen digits to those that they are added to. TOSCA's cats
# have 6e-4 and more.
_NO_AREA = 1e-10


def unreferenced_vertices(faces: IntArray, n_vertices: int) -> IntArray:
    """Return the vertices that no face uses."""
    return np.setdiff1d(np.arange(n_vertices), faces)


def repeated_corners(faces: IntArray) -> IntArray:
    """Return the faces that name one vertex twice."""
    a, b, c = faces.T
    return np.flatnonzero((a == b) | (b == c) | (c == a))


def sound_faces(vertices: FloatArray, faces: IntArray) -> BoolArray:
    """Return which faces name three different vertices that exist and are finite."""
    finite = np.append(is_finite(vertices), False)  # the last for whatever does not exist
    inside = (faces >= 0) & (faces < len(vertices))
    sound = np.asarray(finite[np.where(inside, faces, -1)].all(axis=1))
    sound[repeated_corners(faces)] = False
    return sound


def degenerate_faces(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Return the faces whose area is nil to rounding, against the squared longest edge."""
    area, longest = _area_and_longest(vertices, faces)
    return np.flatnonzero(area <= _NO_AREA * longest)


def _area_and_longest(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the area and the squared longest edge of each face."""
    corners = vertices[faces]
    edges = np.roll(corners, -1, axis=1) - corners
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    return np.asarray(area), np.asarray((edges**2).sum(axis=2).max(axis=1))


def nonmanifold_edges(faces: IntArray) -> IntArray:
    """Return the edges, shape (n, 2), that more than two faces share."""
    edges, counts = _count_edges(np.sort(_half_edges(faces), axis=1))
    return edges[counts > 2]


def count_components(faces: IntArray, n_vertices: int) -> int:
    """Return the number of connected components, isolated vertices included."""
    return len(np.unique(components(faces, n_vertices)))


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


def duplicate_faces(faces: IntArray) -> IntArray:
    """Return the faces whose three vertices an earlier face has already, in whatever order."""
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return np.setdiff1d(np.arange(len(faces)), first)


def duplicate_vertices(vertices: FloatArray) -> IntArray:
    """Return the vertices that lie exactly where an earlier one does."""
    _, first = np.unique(vertices, axis=0, return_index=True)
    return np.setdiff1d(np.arange(len(vertices)), first)


def slivers(vertices: FloatArray, faces: IntArray, ratio: float = 1e-3) -> IntArray:
    """Return the faces with an area, but less than ``ratio`` times the squared longest edge.

    By default their height is less than 0.002 of that edge; the thinnest of TOSCA's cats has 0.001.
    """
    area, longest = _area_and_longest(vertices, faces)
    return np.flatnonzero((area > _NO_AREA * longest) & (area < ratio * longest))


def nonmanifold_vertices(faces: IntArray, n_vertices: int) -> IntArray:
    """Return the vertices whose faces form more than one fan, as where two cones touch."""
    corner_of = faces.ravel()  # corner c belongs to face c // 3
    edges = np.sort(_half_edges(faces), axis=1)
    # Corners of neighbouring faces at the two ends of their common edge belong to one fan.
    start = np.concatenate([3 * np.arange(len(faces)) + j for j in range(3)])
    end = np.concatenate([3 * np.arange(len(faces)) + (j + 1) % 3 for j in range(3)])
    flipped = corner_of[start] > corner_of[end]
    low, high = np.where(flipped, end, start), np.where(flipped, start, end)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = (edges[order][1:] == edges[order][:-1]).all(axis=1)
    one, other = order[:-1][same], order[1:][same]
    pairs = np.concatenate(
        [np.stack([low[one], low[other]]), np.stack([high[one], high[other]])], axis=1
    )
    n = len(corner_of)
    _, fan = sp.csgraph.connected_components(
        sp.coo_array((np.ones(pairs.shape[1]), pairs), shape=(n, n)), directed=False
    )
    n_fans = np.bincount(
        np.unique(np.stack([corner_of, fan], axis=1), axis=0)[:, 0], minlength=n_vertices
    )
    return np.flatnonzero(n_fans > 1)


def components(faces: IntArray, n_vertices: int) -> IntArray:
    """Return the component of each vertex as a number; isolated vertices have their own."""
    edges = _half_edges(faces).astype(np.int32)
    links = sp.coo_array(
        (np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n_vertices, n_vertices)
    )
    return np.asarray(sp.csgraph.connected_components(links, directed=False)[1], dtype=np.int64)


def boundary_pieces(faces: IntArray) -> list[IntArray]:
    """Return the connected pieces of the boundary: holes, or the rim of an open surface.

    Each is an array of shape (n_edges, 2) of the edges that only one face has, running as they do
    in that face.
    """
    edges = _half_edges(faces)
    undirected, counts = _count_edges(np.sort(edges, axis=1))
    base = int(edges.max(initial=0)) + 1
    keys = np.sort(edges, axis=1) @ [base, 1]
    rim = edges[counts[np.searchsorted(undirected @ [base, 1], keys)] == 1]
    if len(rim) == 0:
        return []
    vertices, numbers = np.unique(rim, return_inverse=True)
    piece = components(numbers.reshape(rim.shape)[:, [0, 1, 1]], len(vertices))[
        numbers.reshape(rim.shape)[:, 0]
    ]
    return [rim[piece == number] for number in np.unique(piece)]
