"""Faults in the connectivity and the triangles of a mesh."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap._tools.validation import is_finite

__all__ = [
    "HalfEdges",
    "area_and_longest_edge",
    "boundary_pieces",
    "boundary_vertices",
    "components",
    "corner_links",
    "count_components",
    "degenerate_faces",
    "duplicate_faces",
    "duplicate_vertices",
    "edges_of",
    "first_at_place",
    "half_edges",
    "is_wound_consistently",
    "label_fans",
    "nonmanifold_edges",
    "nonmanifold_vertices",
    "repeated_corners",
    "share_of_common_edges",
    "slivers",
    "sound_faces",
    "unreferenced_vertices",
    "vertices_of_many_fans",
]


# A face has no area if the ratio of its area to the squared longest edge (half the height divided
# by that edge) is at most this. Its cotangents of 1e10 leave six of sixteen digits of the numbers
# they are added to. The ratio is 6e-4 or more on TOSCA's cats.
_NO_AREA = 1e-10
# Number of triangles processed at a time, to save memory.
_CHUNK = 2**16


def unreferenced_vertices(faces: IntArray, n_vertices: int) -> IntArray:
    """Return the vertices that no face uses."""
    unused = np.ones(n_vertices, dtype=bool)
    unused[faces.ravel()] = False
    return np.flatnonzero(unused)


def share_of_common_edges(faces: IntArray, others: IntArray) -> float:
    """Return the number of edges common to two lists of faces, as a fraction of the smaller number.

    Examples
    --------
    A square, cut along either diagonal, and the same faces in another order:

    >>> import numpy as np
    >>> from skfmap.geometry.faults import share_of_common_edges
    >>> one = np.array([[0, 1, 2], [0, 2, 3]])
    >>> share_of_common_edges(one, np.array([[0, 1, 3], [1, 2, 3]]))
    0.8
    >>> share_of_common_edges(one, one[::-1, [1, 2, 0]])
    1.0
    """
    base = int(max(faces.max(initial=0), others.max(initial=0))) + 1
    one, other = (_edge_numbers(own, base) for own in (faces, others))
    fewest = min(len(one), len(other))
    return len(np.intersect1d(one, other, assume_unique=True)) / fewest if fewest else 0.0


def _edge_numbers(faces: IntArray, base: int) -> IntArray:
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return np.unique(ends[:, 0].astype(np.int64) * base + ends[:, 1])


def repeated_corners(faces: IntArray) -> IntArray:
    """Return the faces with a repeated vertex."""
    a, b, c = faces.T
    return np.flatnonzero((a == b) | (b == c) | (c == a))


def sound_faces(vertices: FloatArray, faces: IntArray) -> BoolArray:
    """Return which faces have three different vertices that exist and are finite."""
    finite = np.append(is_finite(vertices), False)  # the last entry is for invalid indices
    inside = (faces >= 0) & (faces < len(vertices))
    sound = np.asarray(finite[np.where(inside, faces, -1)].all(axis=1))
    sound[repeated_corners(faces)] = False
    return sound


def degenerate_faces(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Return the faces whose area, relative to the squared longest edge, is zero up to rounding."""
    area, longest = area_and_longest_edge(vertices, faces)
    return np.flatnonzero(area <= _NO_AREA * longest)


def area_and_longest_edge(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the area and the squared longest edge of each face."""
    area, longest = np.empty(len(faces)), np.empty(len(faces))
    for begin in range(0, len(faces), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        area[part], longest[part] = _area_and_longest_edge(vertices, faces[part])
    return area, longest


def _area_and_longest_edge(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    a, b, c = (np.ascontiguousarray(vertices[faces[:, j]].T) for j in range(3))
    ab, bc, ca = b - a, c - b, a - c
    normal = np.stack(
        [
            ab[1] * bc[2] - ab[2] * bc[1],
            ab[2] * bc[0] - ab[0] * bc[2],
            ab[0] * bc[1] - ab[1] * bc[0],
        ]
    )
    area = np.sqrt((normal**2).sum(axis=0)) / 2
    longest = np.maximum.reduce([(edge**2).sum(axis=0) for edge in (ab, bc, ca)])
    return np.asarray(area), np.asarray(longest)


def nonmanifold_edges(faces: IntArray) -> IntArray:
    """Return the edges, shape (n, 2), that more than two faces share."""
    edges, counts = _count_edges(_undirected(faces))
    return edges[counts > 2]


def count_components(faces: IntArray, n_vertices: int) -> int:
    """Return the number of connected components, including isolated vertices."""
    return len(np.unique(components(faces, n_vertices)))


def is_wound_consistently(faces: IntArray) -> bool:
    """Return whether no directed edge is used by two faces."""
    edges = _half_edges(faces)
    keys = np.sort(edges[:, 0].astype(np.int64) * (int(faces.max(initial=0)) + 1) + edges[:, 1])
    return not (keys[1:] == keys[:-1]).any()


def boundary_vertices(faces: IntArray, n_vertices: int) -> BoolArray:
    """Return a mask of the vertices on boundary edges."""
    edges, counts = _count_edges(_undirected(faces))
    mask = np.zeros(n_vertices, dtype=bool)
    mask[edges[counts == 1]] = True
    return mask


def edges_of(faces: IntArray) -> IntArray:
    """Return the undirected edges, each once, shape (n_edges, 2)."""
    return _count_edges(_undirected(faces))[0]


def _half_edges(faces: IntArray) -> IntArray:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _undirected(faces: IntArray) -> IntArray:
    """Return the half-edges, each from its lower to its higher vertex."""
    start, end = _half_edges(faces).T
    return np.stack([np.minimum(start, end), np.maximum(start, end)], axis=1)


def _count_edges(edges: IntArray) -> tuple[IntArray, IntArray]:
    """Return the different pairs of vertices in order, and how often each occurs."""
    base = int(edges.max(initial=0)) + 1
    # Encode each pair as one number: sorting numbers is many times faster than sorting rows.
    keys, counts = np.unique(edges[:, 0].astype(np.int64) * base + edges[:, 1], return_counts=True)
    return np.stack(np.divmod(keys, base), axis=1), counts


def duplicate_faces(faces: IntArray) -> IntArray:
    """Return the faces with the same three vertices as an earlier face, in any order."""
    a, b, c = faces.astype(np.int64).T
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    outer, middle = low * (int(high.max(initial=0)) + 1) + high, a + b + c - low - high
    order = np.lexsort((middle, outer))  # stable, so equal faces stay in their order
    outer, middle = outer[order], middle[order]
    again = (outer[1:] == outer[:-1]) & (middle[1:] == middle[:-1])
    return np.sort(order[1:][again])


def duplicate_vertices(vertices: FloatArray) -> IntArray:
    """Return the vertices with the same coordinates as an earlier one."""
    return np.flatnonzero(first_at_place(vertices) != np.arange(len(vertices)))


def first_at_place(vertices: FloatArray) -> IntArray:
    """Return for each vertex the first one with the same coordinates, usually itself."""
    first = np.arange(len(vertices))
    by_x = np.argsort(vertices[:, 0], kind="stable")
    x = vertices[by_x, 0]
    same = np.flatnonzero(x[1:] == x[:-1])
    # Only vertices that share x with another are compared further.
    shared = np.sort(by_x[np.union1d(same, same + 1)])
    order = shared[np.lexsort(vertices[shared].T)]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (vertices[order][1:] != vertices[order][:-1]).any(axis=1)
    first[order] = order[new][np.cumsum(new) - 1]
    return first


def slivers(vertices: FloatArray, faces: IntArray, ratio: float = 1e-3) -> IntArray:
    """Return the faces with a positive area of less than ``ratio`` times the squared longest edge.

    By default their height is less than 0.002 of that edge; the thinnest face of TOSCA's cats has
    0.001.
    """
    area, longest = area_and_longest_edge(vertices, faces)
    return np.flatnonzero((area > _NO_AREA * longest) & (area < ratio * longest))


@dataclass(frozen=True)
class HalfEdges:
    """The half-edges of faces, grouped by edge.

    Half-edge 3 f + j goes from corner j of face f to the next corner; the corner where it starts
    has the same number.
    """

    start: IntArray
    """Vertex where each half-edge starts."""
    end: IntArray
    """Vertex where each half-edge ends."""
    order: IntArray
    """Half-edges sorted by edge, and for each edge in the order of their faces."""
    first: IntArray
    """Position in ``order`` of the first half-edge of each edge."""
    count: IntArray
    """Number of half-edges on each edge."""

    @cached_property
    def twin(self) -> IntArray:
        """The other half-edge if an edge has exactly two, otherwise -1."""
        twin = np.full(len(self.start), -1)
        one = self.first[self.count == 2]
        twin[self.order[one]], twin[self.order[one + 1]] = self.order[one + 1], self.order[one]
        return twin

    @cached_property
    def pairs(self) -> IntArray:
        """The half-edges of edges with exactly two, shape (2, n_pairs); the earlier one first."""
        first = self.first[self.count == 2]
        return np.stack([self.order[first], self.order[first + 1]])

    def on(self, chosen: BoolArray) -> BoolArray:
        """Return which half-edges lie on the chosen edges."""
        mask = np.zeros(len(self.start), dtype=bool)
        mask[self.order] = np.repeat(chosen, self.count)
        return mask

    def alone(self) -> IntArray:
        """Return the half-edges on the boundary, which are alone on their edges."""
        return np.sort(self.order[self.first[self.count == 1]])


def half_edges(faces: IntArray) -> HalfEdges:
    """Sort the half-edges of faces by their edges."""
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    base = int(faces.max(initial=0)) + 1
    # Encode each pair as one number: sorting numbers is many times faster than sorting rows.
    keys = np.minimum(start, end).astype(np.int64) * base + np.maximum(start, end)
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    first = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]])[: len(keys)])
    return HalfEdges(start, end, order, first, np.diff(np.append(first, len(keys))))


def nonmanifold_vertices(faces: IntArray, n_vertices: int) -> IntArray:
    """Return the vertices whose faces form more than one fan, as at the tips of two cones."""
    edges = half_edges(faces)
    suspects = vertices_of_many_fans(edges, n_vertices)
    if not suspects.any():
        return np.flatnonzero(suspects)
    # Corners of neighbouring faces at the two ends of their common edge belong to one fan.
    same = np.ones(len(edges.order), dtype=bool)
    same[edges.first] = False
    later = np.flatnonzero(same)
    pairs = np.stack([edges.order[later - 1], edges.order[later]])
    corners, fan = label_fans(edges, pairs, np.equal(*edges.start[pairs]), suspects)
    vertex, counts = np.unique(edges.start[corners[_first_of_each(fan)]], return_counts=True)
    return vertex[counts > 1]


def _first_of_each(labels: IntArray) -> IntArray:
    return np.unique(labels, return_index=True)[1]


def vertices_of_many_fans(edges: HalfEdges, n_vertices: int) -> BoolArray:
    """Return a mask of vertices that may have more than one fan of faces; most of them do.

    The faces around each vertex are traversed across edges that two consistently wound faces share.
    If not all faces are reached there may be another fan, or an edge of another kind.
    """
    start = edges.start
    twin = np.where(edges.end == start[edges.twin], edges.twin, -1)  # -1 stays -1
    n_corners = len(start)
    corner = np.arange(n_corners)
    after = twin[corner - corner % 3 + (corner + 2) % 3]
    first = np.full(n_vertices, -1)
    first[start] = corner
    rim = np.flatnonzero(twin < 0)  # no face precedes these, so the traversal starts there
    first[start[rim]] = rim
    walker = first[first >= 0]
    vertex = start[walker]
    met = np.zeros(n_vertices, dtype=np.int64)
    origin = walker
    while len(walker):
        met[vertex] += 1
        walker = after[walker]
        going = (walker >= 0) & (walker != origin)
        walker, origin, vertex = walker[going], origin[going], vertex[going]
    return np.asarray(met != np.bincount(start, minlength=n_vertices))


def label_fans(
    edges: HalfEdges, pairs: IntArray, parallel: BoolArray, at: BoolArray
) -> tuple[IntArray, IntArray]:
    """Label the fans of corners that are joined by pairs of glued half-edges.

    Parameters
    ----------
    edges : HalfEdges
        The half-edges.
    pairs : ndarray of int, shape (2, n_pairs)
        Pairs of half-edges that are glued to each other.
    parallel : ndarray of bool, shape (n_pairs,)
        Whether the two start at the same place; otherwise each starts where the other ends.
    at : ndarray of bool, shape (n_vertices,)
        The vertices of interest.

    Returns
    -------
    corners : ndarray of int, shape (n_corners,)
        The corners at these vertices.
    fan : ndarray of int, shape (n_corners,)
        Label of the fan of each corner.
    """
    corners, links, _ = corner_links(edges, pairs, parallel, at)
    n = len(corners)
    _, fan = sp.csgraph.connected_components(
        sp.coo_array((np.ones(links.shape[1]), links), shape=(n, n)), directed=False
    )
    return corners, np.asarray(fan, dtype=np.int64)


def corner_links(
    edges: HalfEdges, pairs: IntArray, parallel: BoolArray, at: BoolArray
) -> tuple[IntArray, IntArray, IntArray]:
    """Return which corners meet at the two ends of pairs of glued half-edges.

    Parameters
    ----------
    edges, pairs, parallel, at
        As in `label_fans`.

    Returns
    -------
    corners : ndarray of int, shape (n_corners,)
        The corners at these vertices.
    links : ndarray of int, shape (2, n_links)
        Positions in ``corners`` of two corners that meet.
    pair : ndarray of int, shape (n_links,)
        The pair of half-edges at which they meet.
    """
    corners = np.flatnonzero(at[edges.start])
    number = np.full(len(edges.start), -1)
    number[corners] = np.arange(len(corners))
    near = np.flatnonzero((at[edges.start[pairs]] | at[edges.end[pairs]]).any(axis=0))
    (one, other), parallel = pairs[:, near], parallel[near]
    after_one, after_other = (half - half % 3 + (half + 1) % 3 for half in (one, other))
    links = np.concatenate(
        [
            np.stack([one, np.where(parallel, other, after_other)]),
            np.stack([after_one, np.where(parallel, after_other, other)]),
        ],
        axis=1,
    )
    links, pair = number[links], np.concatenate([near, near])
    known = (links >= 0).all(axis=0)
    return corners, links[:, known], pair[known]


def components(faces: IntArray, n_vertices: int) -> IntArray:
    """Return the label of the component of each vertex; isolated vertices have their own."""
    # Two edges of a triangle connect its three vertices.
    edges = np.concatenate([faces[:, :2], faces[:, 1:]]).astype(np.int32)
    links = sp.coo_array(
        (np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])),
        shape=(n_vertices, n_vertices),
    )
    return np.asarray(sp.csgraph.connected_components(links, directed=False)[1], dtype=np.int64)


def boundary_pieces(faces: IntArray) -> list[IntArray]:
    """Return the connected pieces of the boundary: holes, or the rim of an open surface.

    Each is an array of boundary edges, shape (n_edges, 2), directed as in their face.
    """
    edges = half_edges(faces)
    alone = edges.alone()
    if len(alone) == 0:
        return []
    alone = alone[np.argsort(alone % 3, kind="stable")]
    rim = np.stack([edges.start[alone], edges.end[alone]], axis=1)
    vertices, numbers = np.unique(rim, return_inverse=True)
    numbers = numbers.reshape(rim.shape)
    piece = components(numbers[:, [0, 1, 1]], len(vertices))[numbers[:, 0]]
    order = np.argsort(piece, kind="stable")
    return np.split(rim[order], np.flatnonzero(np.diff(piece[order])) + 1)
