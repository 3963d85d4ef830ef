"""Mending of seams, edges with too many faces, faces without area, twists and debris."""

from dataclasses import dataclass, field
from typing import NamedTuple

import igl
import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from skfmap._tools.ties import first_of_largest
from skfmap._tools.types import Array, BoolArray, FloatArray, IntArray
from skfmap.geometry.faults import (
    HalfEdges,
    area_and_longest_edge,
    components,
    corner_links,
    degenerate_faces,
    duplicate_faces,
    first_at_place,
    half_edges,
    label_fans,
    repeated_corners,
    vertices_of_many_fans,
)
from skfmap.geometry.orientation import against_the_rest

__all__ = ["Mended", "mend"]

# Vertices along a crack are merged if their distance is at most this fraction of the extent (the
# rounding error of coordinates with four digits in a file) ...
_CRACK = 1e-4
# ... and at most this fraction of the edges there, so that small triangles never collapse.
_CRACK_OF_EDGE = 1e-2
# An open seam consists of at least this many pairs of boundary edges that are too far apart to be
# joined, but whose ends are within this fraction of the edge lengths there.
_OPEN_OF_EDGE, _OPEN_SEAM = 0.2, 4
# A face without area is a needle if its shortest edge is at most this fraction of its longest; two
# of its vertices are then merged. Otherwise it is a cap, whose longest edge is flipped.
_NEEDLE = 1e-6
# Faces that fold onto each other to within half a degree do not continue each other.
_FOLDED = np.cos(np.radians(0.5))
# Maximum number of faces at one edge among which pairs are searched.
_CROWD = 32
# At most this fraction of the area is left out to obtain a consistent winding. A patch with a
# boundary and at most this fraction of the area is a fin.
_FEW = 0.01
# Conflicts that touch more vertices than this are not a local twist.
_MOST_ENDS = 2000
# Each step can create work for an earlier one, but hardly ever more than two or three times.
_ROUNDS = 20


@dataclass
class Mended:
    """A mended surface, and what was done.

    Attributes
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        The given vertices that are used, in their order, followed by copies of some of them.
    faces : ndarray of int, shape (n_faces, 3)
        Faces of one component, with at most two at each edge and one fan at each vertex.
    vertex_map : ndarray of int, shape (n_given,)
        The new index of each given vertex; -1 if it was left out. If there are copies, it is the
        one whose faces have the largest area.
    tally : dict of str to float
        Count of each kind of change; kinds that did not occur are absent.
    edges : HalfEdges or None
        The half-edges of the faces, if already known.
    """

    vertices: FloatArray
    faces: IntArray
    vertex_map: IntArray
    tally: dict[str, float] = field(default_factory=dict)
    edges: HalfEdges | None = None


class _Surface(NamedTuple):
    """Vertices, faces, and the given vertex at each corner of a face, or -1."""

    vertices: FloatArray
    faces: IntArray
    origin: IntArray

    def only(self, kept: BoolArray) -> "_Surface":
        return _Surface(self.vertices, self.faces[kept], self.origin[kept])

    def areas(self) -> FloatArray:
        return area_and_longest_edge(self.vertices, self.faces)[0]


def mend(vertices: FloatArray, faces: IntArray) -> Mended:
    """Turn triangles into one connected, manifold surface.

    These steps are repeated, in this order, until there is nothing left to do:

    - Faces are wound like their neighbours.
    - Of faces with the same vertices and the same winding, the first is kept.
    - A face without area is left out if two of its vertices coincide, and the gap is closed;
      otherwise its longest edge is flipped.
    - Faces are glued in pairs. At an edge with more than two faces, those that form the smoothest
      surface are glued, and the others are cut free; at the boundary, faces whose edges coincide
      are glued. Two corners belong to the same vertex if they are connected across glued edges.
      This closes seams and cracks, and separates parts that touch at a point or along an edge.
    - If a patch has no consistent winding, the few faces in conflict are left out.

    Finally the component with the largest area is kept.

    Parameters
    ----------
    vertices : ndarray of shape (n_given, 3)
        Coordinates.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles, each of three different vertices that exist and are finite.

    Returns
    -------
    Mended
        The surface and the changes; it has no faces if none were sound.

    Examples
    --------
    Two halves of a square, each with its own vertices:

    >>> import numpy as np
    >>> from skfmap.geometry.mending import mend
    >>> vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> mended = mend(vertices, np.array([[0, 1, 2], [3, 4, 5]]))
    >>> mended.faces.tolist(), mended.vertex_map.tolist()
    ([[0, 1, 2], [0, 2, 3]], [0, 1, 2, 0, 2, 3])
    >>> mended.tally
    {'seam edges': 1, 'merged vertices': 2}
    """
    n_given = len(vertices)
    surface = _Surface(vertices, faces, faces)
    tally: dict[str, float] = {}
    for _ in range(_ROUNDS):
        before = surface
        surface, edges = _round(surface, tally)
        if surface is before:
            break
    lost = np.ones(n_given + 1, dtype=bool)
    lost[surface.origin.ravel()] = False
    _count_open_seams(surface, edges, tally)
    whole, surface = surface, _largest_piece(surface, tally)
    used = np.zeros(len(surface.vertices), dtype=bool)
    used[surface.faces.ravel()] = True
    number = np.where(used, np.cumsum(used) - 1, -1)
    vertex_map = _found_at(surface, n_given)
    vertex_map = np.where(vertex_map >= 0, number[vertex_map], -1)
    _find_at_the_same_place(vertices, vertex_map, np.flatnonzero(lost[:-1]))
    if used.all() and surface is whole:
        return Mended(surface.vertices, surface.faces, vertex_map, tally, edges)
    return Mended(surface.vertices[used], number[surface.faces], vertex_map, tally)


def _count(tally: dict[str, float], what: str, n: float) -> None:
    if n:
        tally[what] = tally.get(what, 0) + n


def _round(surface: _Surface, tally: dict[str, float]) -> tuple[_Surface, HalfEdges]:
    """Return the surface after one round of all steps; the same object if nothing changed."""
    edges = half_edges(surface.faces)
    for step in (_wind, _drop_twice, _mend_flat, _glue, _part_beyond_two, _untwist):
        after = step(surface, edges, tally)
        if after is not surface:
            surface, edges = after, half_edges(after.faces)
    return surface, edges


def _wind(surface: _Surface, edges: HalfEdges, tally: dict[str, float]) -> _Surface:
    """Wind faces like their neighbours."""
    turned, _ = against_the_rest(edges)
    if not turned.any():
        return surface
    _count(tally, "turned faces", int(turned.sum()))
    return _Surface(
        surface.vertices,
        np.where(turned[:, None], surface.faces[:, [0, 2, 1]], surface.faces),
        np.where(turned[:, None], surface.origin[:, [0, 2, 1]], surface.origin),
    )


def _drop_twice(surface: _Surface, edges: HalfEdges, tally: dict[str, float]) -> _Surface:
    """Drop duplicate faces.

    Duplicates with opposite windings at crowded edges are kept: they are the two sides of a wall
    without thickness.
    """
    faces = surface.faces
    # All three edges of a duplicate have another face; only such faces are considered.
    crowded = edges.on(edges.count > 2).reshape(-1, 3).all(axis=1)
    a, b, c = (edges.twin.reshape(-1, 3) // 3).T
    suspects = np.flatnonzero(crowded | ((a >= 0) & (a == b) & (b == c)))
    if len(suspects) == 0:
        return surface
    few = faces[suspects]
    a, b, c = few.T
    odd = np.asarray((a > b) ^ (b > c) ^ (c > a))  # equal for faces with the same winding
    kept = np.ones(len(faces), dtype=bool)
    for winding in (odd, ~odd):
        one = suspects[winding]
        kept[one[duplicate_faces(faces[one])]] = False
    later = suspects[duplicate_faces(few)]
    kept[np.setdiff1d(later, np.flatnonzero(crowded))] = False
    _count(tally, "faces twice", int((~kept).sum()))
    return surface if kept.all() else surface.only(kept)


def _tolerance(surface: _Surface) -> float:
    used = np.zeros(len(surface.vertices), dtype=bool)
    used[surface.faces.ravel()] = True
    points = surface.vertices[used]
    return _CRACK * float(np.linalg.norm(np.ptp(points, axis=0)))


def _mend_flat(
    surface: _Surface,
    edges: HalfEdges,  # noqa: ARG001
    tally: dict[str, float],
) -> _Surface:
    """Drop needles, whose gaps are later closed like cracks; flip the longest edges of caps."""
    flat = degenerate_faces(surface.vertices, surface.faces)
    if len(flat) == 0:
        return surface
    _count(tally, "flat faces", len(flat))
    # A face that shares an edge with one of these shares two vertices with it.
    touched = np.zeros(len(surface.vertices), dtype=bool)
    touched[surface.faces[flat].ravel()] = True
    near = np.flatnonzero(touched[surface.faces].sum(axis=1) >= 2)
    faces, origin = surface.faces[near], surface.origin[near]
    for _ in range(_ROUNDS):
        if not _flip_caps(surface.vertices, faces, origin):
            break
    rest = near[degenerate_faces(surface.vertices, faces)]
    faces, origin = _put(surface.faces, near, faces), _put(surface.origin, near, origin)
    kept = np.ones(len(faces), dtype=bool)
    kept[rest] = False
    return _Surface(surface.vertices, faces, origin).only(kept)


def _put(array: IntArray, where: IntArray, values: IntArray) -> IntArray:
    array = array.copy()
    array[where] = values
    return array


def _flip_caps(vertices: FloatArray, faces: IntArray, origin: IntArray) -> int:
    """Flip the longest edges of caps in place, if the face on the other side has an area."""
    flat = degenerate_faces(vertices, faces)
    corners = vertices[faces[flat]]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    cap = lengths.min(axis=1, initial=np.inf) > _NEEDLE * lengths.max(axis=1, initial=0)
    half = (3 * flat + lengths.argmax(axis=1))[cap] if len(flat) else flat
    edges = half_edges(faces)
    twin = edges.twin[half]
    is_flat = np.zeros(len(faces), dtype=bool)
    is_flat[flat] = True
    fine = (twin >= 0) & (edges.end[half] == edges.start[twin]) & ~is_flat[twin // 3]
    half, twin = half[fine], twin[fine]
    known = {(int(u), int(v)) for u, v in zip(edges.start, edges.end, strict=True)}
    done: set[int] = set()
    for h, t in zip(half.tolist(), twin.tolist(), strict=True):
        f, g = h // 3, t // 3
        a, b, c = (3 * f + (h + k) % 3 for k in range(3))  # corners: c lies on the edge from a to b
        d = 3 * g + (t - 3 * g + 2) % 3
        tip, beyond = int(faces.flat[c]), int(faces.flat[d])
        if g in done or f in done or {(tip, beyond), (beyond, tip)} & known:
            continue
        done |= {f, g}
        known |= {(tip, beyond), (beyond, tip)}
        for array in (faces, origin):
            at_a, at_b, at_c, at_d = (array.flat[corner] for corner in (a, b, c, d))
            array[f], array[g] = (at_c, at_a, at_d), (at_d, at_b, at_c)
    return len(done)


def _glue(surface: _Surface, edges: HalfEdges, tally: dict[str, float]) -> _Surface:
    """Merge corners into one vertex if, and only if, glued edges connect them."""
    n = len(surface.vertices)
    touched = vertices_of_many_fans(edges, n)
    rim = edges.alone()
    glued, parallel = [edges.pairs], [np.equal(*edges.start[edges.pairs])]
    if (edges.count > 2).any():
        tally.setdefault("crowded edges", int((edges.count > 2).sum()))
        half, group = _crowded(edges)
        touched[edges.start[half]] = touched[edges.end[half]] = True
        glued.append(pairs := _best_pairs(surface, edges, half, group, np.arange(n)))
        parallel.append(np.equal(*edges.start[pairs]))
        rim = np.concatenate([rim, np.setdiff1d(half, pairs)])
    place = np.arange(n)
    n_seam = 0
    for near in (0.0, _tolerance(surface)) if len(rim) else ():
        ends = np.unique(np.concatenate([edges.start[rim], edges.end[rim]]))
        place[ends] = _one_place(surface, edges, rim, ends, near)
        half, group = _at_one_place(edges, rim, place)
        if len(half) == 0:
            continue
        glued.append(pairs := _best_pairs(surface, edges, half, group, place, at_seam=True))
        parallel.append(np.equal(*place[edges.start[pairs]]))
        touched[edges.start[pairs]] = touched[edges.end[pairs]] = True
        rim = np.setdiff1d(rim, pairs)
        n_seam += pairs.shape[1]
    if not touched.any():
        return surface
    pairs, together = np.concatenate(glued, axis=1), np.concatenate(parallel)
    corners, fan = label_fans(edges, pairs, together, touched)
    return _number_anew(surface, edges, corners, fan, n_seam, tally)


def _crowded(edges: HalfEdges) -> tuple[IntArray, IntArray]:
    """Return the half-edges of edges with more than two, and the indices of these edges."""
    crowded = np.repeat(edges.count > 2, edges.count)
    return edges.order[crowded], np.repeat(np.arange(len(edges.count)), edges.count)[crowded]


def _patches(surface: _Surface, edges: HalfEdges) -> tuple[IntArray, BoolArray]:
    """Return the patch of each face, and whether the patch is a fin.

    A patch is a set of faces that are connected across edges with two faces. A fin is a small patch
    with a boundary.
    """
    one, other = edges.pairs // 3
    patch = components(np.stack([one, other, other], axis=1), len(edges.start) // 3)
    area = surface.areas()
    small = np.bincount(patch, area) <= _FEW * area.sum()
    with_rim = np.zeros(len(small), dtype=bool)
    with_rim[patch[edges.alone() // 3]] = True
    return patch, (small & with_rim)[patch]


def _count_open_seams(surface: _Surface, edges: HalfEdges, tally: dict[str, float]) -> None:
    """Count boundary edges that run along another one but are not joined to it."""
    rim = edges.alone()
    if len(rim) == 0:
        return
    place = np.arange(len(surface.vertices))
    ends = np.unique(np.concatenate([edges.start[rim], edges.end[rim]]))
    place[ends] = _one_place(surface, edges, rim, ends, np.inf, _OPEN_OF_EDGE)
    half, _ = _at_one_place(edges, rim, place)
    if len(half) >= 2 * _OPEN_SEAM:
        _count(tally, "open seam edges", len(half) // 2)


def _one_place(
    surface: _Surface,
    edges: HalfEdges,
    rim: IntArray,
    ends: IntArray,
    near: float,
    near_of_edge: float = _CRACK_OF_EDGE,
) -> IntArray:
    """Return for each vertex of the boundary the first one that coincides with it, or nearly so.

    Two vertices nearly coincide if their distance is at most ``near``, and at most the fraction
    ``near_of_edge`` of the longest boundary edges there.
    """
    points = surface.vertices[ends]
    place = first_at_place(points)
    if near == 0:
        return ends[place]
    first = np.unique(place)
    number = np.full(len(surface.vertices), -1)
    number[ends] = place
    lengths = np.linalg.norm(
        surface.vertices[edges.start[rim]] - surface.vertices[edges.end[rim]], axis=1
    )
    longest = np.zeros(len(ends))
    np.maximum.at(longest, number[edges.start[rim]], lengths)
    np.maximum.at(longest, number[edges.end[rim]], lengths)
    near = min(near, near_of_edge * float(lengths.max(initial=0)))
    pairs = first[cKDTree(points[first]).query_pairs(near, output_type="ndarray")]
    distance = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    pairs = pairs[distance <= near_of_edge * longest[pairs].min(axis=1)]
    label = components(np.concatenate([pairs, pairs[:, 1:]], axis=1), len(ends))[place]
    _, first, number = np.unique(label, return_index=True, return_inverse=True)
    return ends[first[number.ravel()]]


def _at_one_place(edges: HalfEdges, rim: IntArray, place: IntArray) -> tuple[IntArray, IntArray]:
    """Return the boundary half-edges that coincide with another, and the index of their place."""
    start, end = place[edges.start[rim]], place[edges.end[rim]]
    keys = np.minimum(start, end) * len(place) + np.maximum(start, end)
    _, group, count = np.unique(keys, return_inverse=True, return_counts=True)
    shared = (count[group] > 1) & (start != end)
    order = np.lexsort((rim[shared], group[shared]))
    return rim[shared][order], group[shared][order]


def _best_pairs(
    surface: _Surface,
    edges: HalfEdges,
    half: IntArray,
    group: IntArray,
    place: IntArray,
    at_seam: bool = False,
) -> IntArray:
    """Choose the pairs of faces at each edge that form the smoothest surface.

    Faces of the same patch with opposite windings are not paired, except at a seam of exactly two
    faces. Fins are paired last.

    Parameters
    ----------
    surface, edges
        The surface and its half-edges.
    half, group : ndarray of int, shape (n,)
        Half-edges, and the index of the edge of each, in ascending order.
    place : ndarray of int, shape (n_vertices,)
        Index of the place of each vertex; coinciding vertices have the same.
    at_seam : bool, default=False
        Whether the edges are boundary edges that have not been joined yet.

    Returns
    -------
    pairs : ndarray of int, shape (2, n_pairs)
        The half-edges of each pair; the best pair of each edge comes first.
    """
    start, end = place[edges.start[half]], place[edges.end[half]]
    patch, fin = _patches(surface, edges)
    low, high = surface.vertices[np.minimum(start, end)], surface.vertices[np.maximum(start, end)]
    tip = surface.vertices[edges.end[half - half % 3 + (half + 1) % 3]]
    along, into = _unit(high - low), tip - low
    into = _unit(into - (into * along).sum(axis=1, keepdims=True) * along)
    forward = start < end
    size = np.bincount(group, minlength=int(group.max()) + 1)[group]
    rank = np.arange(len(group)) - np.searchsorted(group, group)
    i, j = [], []
    for k in range(1, min(int(size.max()), _CROWD)):
        first = np.flatnonzero((rank + k < size) & (rank + k < _CROWD))
        i.append(first)
        j.append(first + k)
    one, other = np.concatenate(i), np.concatenate(j)
    bend = (into[one] * into[other]).sum(axis=1)  # -1 if one face smoothly continues the other
    alike = forward[one] != forward[other]
    fits = alike | (patch[half[one] // 3] != patch[half[other] // 3])
    fits |= at_seam & (size[one] == 2)
    fits &= (bend < _FOLDED) & (half[one] // 3 != half[other] // 3)
    one, other, bend, alike = one[fits], other[fits], bend[fits], alike[fits]
    fins = fin[half[one] // 3].astype(int) + fin[half[other] // 3]
    # Ties up to rounding are broken by the order of the faces.
    order = np.lexsort((other, one, np.round(bend, 9), fins, ~alike, group[one]))
    one, other = one[order], other[order]
    taken = np.zeros(len(half), dtype=bool)
    chosen = []
    while len(one):
        best = np.unique(group[one], return_index=True)[1]
        chosen.append(best_pairs := np.stack([one[best], other[best]]))
        taken[best_pairs.ravel()] = True
        free = ~(taken[one] | taken[other])
        one, other = one[free], other[free]
    return half[np.concatenate([np.empty((2, 0), dtype=np.int64), *chosen], axis=1)]


def _rounded(areas: Array) -> Array:
    """Round areas, so that areas that are equal up to rounding keep their order."""
    return np.round(areas / (areas.max() or 1), 9)


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0, length, 1))


def _number_anew(
    surface: _Surface,
    edges: HalfEdges,
    corners: IntArray,
    fan: IntArray,
    n_seam: int,
    tally: dict[str, float],
) -> _Surface:
    """Give each fan of corners one vertex: the first of its vertices, or a copy of it."""
    n, n_fans = len(surface.vertices), int(fan.max()) + 1
    vertex = np.full(n_fans, n)
    np.minimum.at(vertex, fan, edges.start[corners])
    area = np.bincount(fan, surface.areas()[corners // 3], minlength=n_fans)
    order = np.lexsort((np.arange(n_fans), -_rounded(area), vertex))
    copy = np.zeros(n_fans, dtype=bool)
    copy[order[1:]] = vertex[order][1:] == vertex[order][:-1]
    copies = order[copy[order]]
    number = vertex.copy()
    number[copies] = n + np.arange(len(copies))
    if n_seam == 0 and len(copies) == 0:
        return surface
    faces = surface.faces.copy()
    faces.flat[corners] = number[fan]
    _count(tally, "seam edges", n_seam)
    _count(tally, "merged vertices", len(np.unique(edges.start[corners])) - len(np.unique(vertex)))
    crowded = np.zeros(n + 1, dtype=bool)
    for ends in (edges.start, edges.end):
        crowded[ends[edges.on(edges.count > 2)]] = True
    _count(tally, "touching vertices", len(np.unique(vertex[copies][~crowded[vertex[copies]]])))
    vertices = np.concatenate([surface.vertices, surface.vertices[vertex[copies]]])
    glued = _Surface(vertices, faces, surface.origin)
    kept = np.ones(len(faces), dtype=bool)
    kept[repeated_corners(faces)] = False  # faces that collapsed when a crack was closed
    return glued if kept.all() else glued.only(kept)


def _part_beyond_two(surface: _Surface, edges: HalfEdges, tally: dict[str, float]) -> _Surface:
    """Insert a vertex in the middle of an edge that two sheets still share, for one of them.

    The sheets share such an edge if the fans at both of its ends include both sheets.
    """
    if not (edges.count > 2).any():
        return surface
    half, group = _crowded(edges)
    pairs = _best_pairs(surface, edges, half, group, np.arange(len(surface.vertices)))
    group_of = np.full(len(edges.start), -1)
    group_of[half] = group
    rest = np.setdiff1d(half, pairs)
    sheets = [*pairs.T.tolist(), *([single] for single in rest.tolist())]
    keeps: set[int] = set()  # edges that are assigned to their best sheet
    done: set[int] = set()
    vertices, faces, origin = surface.vertices, surface.faces.copy(), surface.origin.copy()
    n = len(vertices)
    new_faces: list[IntArray] = []
    new_origin: list[IntArray] = []
    middles: list[FloatArray] = []
    for sheet in sheets:
        edge = int(group_of[sheet[0]])
        if edge not in keeps:
            keeps.add(edge)
            continue
        if done & {one // 3 for one in sheet}:
            continue  # handled in the next round
        done |= {one // 3 for one in sheet}
        for one in sheet:
            face, a = divmod(one, 3)
            b, middle = (a + 1) % 3, n + len(middles)
            for array, new, number in ((faces, new_faces, middle), (origin, new_origin, -1)):
                half_face = array[face].copy()
                half_face[a] = number
                new.append(half_face)
                array[face, b] = number
        middles.append(vertices[edges.start[sheet[0]]] / 2 + vertices[edges.end[sheet[0]]] / 2)
    _count(tally, "parted edges", len(middles))
    return _Surface(
        np.concatenate([surface.vertices, np.reshape(middles, (-1, 3))]),
        np.concatenate([faces, np.reshape(new_faces, (-1, 3)).astype(np.int64)]),
        np.concatenate([origin, np.reshape(new_origin, (-1, 3)).astype(np.int64)]),
    )


def _untwist(surface: _Surface, edges: HalfEdges, tally: dict[str, float]) -> _Surface:
    """Drop a few faces if a patch can then be wound consistently."""
    turned, twisted = against_the_rest(edges)
    if not twisted.any():
        return _wind(surface, edges, tally) if turned.any() else surface
    area = surface.areas()
    pairs = edges.pairs // 3
    against = np.equal(*edges.start[edges.pairs]) & twisted[pairs[0]]
    swept = (igl.bfs_orient(surface.faces)[0] != surface.faces).any(axis=1) & twisted
    few: IntArray | None = None
    for turned in (np.zeros(len(twisted), dtype=bool), swept):
        conflict = _fewest_conflicts(pairs, against, turned.copy())
        most = int(_FEW * twisted.sum()) + 1
        for curve in (conflict, _shortest_twisted_way(edges, conflict)):
            dropped = _cover(pairs[:, curve], area, most)
            if dropped is not None and (few is None or area[dropped].sum() < area[few].sum()):
                few = dropped
    if few is None or area[few].sum() > _FEW * area[twisted].sum():
        return surface
    _count(tally, "twisted faces", len(few))
    _count(tally, "twisted area", float(area[few].sum() / area.sum()))
    kept = np.ones(len(area), dtype=bool)
    kept[few] = False
    return surface.only(kept)


def _shortest_twisted_way(edges: HalfEdges, conflict: BoolArray) -> IntArray:
    """Find a short closed path along edges that reverses orientation.

    Parameters
    ----------
    edges : HalfEdges
        The half-edges.
    conflict : ndarray of bool, shape (n_pairs,)
        Which pairs of faces are wound inconsistently. They form curves, and every path that
        reverses orientation meets one of them.

    Returns
    -------
    way : ndarray of int
        The pairs of faces on both sides of the path, or the pairs in conflict if these are fewer.
    """
    n = int(edges.start.max()) + 1
    ends = np.unique(np.stack([edges.start, edges.end])[:, edges.pairs[0, conflict]])
    if len(ends) > _MOST_ENDS:
        return np.flatnonzero(conflict)
    at = np.zeros(n, dtype=bool)
    at[ends] = True
    mirrored = _mirrored_corners(edges, conflict, at)
    corner = np.arange(len(edges.start))
    changed = mirrored ^ mirrored[corner - corner % 3 + (corner + 1) % 3]
    # Each vertex occurs twice, as v and v + n, once for each side of the surface.
    rows = np.concatenate([edges.start, edges.start + n])
    columns = np.concatenate([edges.end + n * changed, edges.end + n * ~changed])
    # Graph routines of older scipy versions only accept 32-bit indices.
    ends_of = rows.astype(np.int32), columns.astype(np.int32)
    graph = sp.csr_array((np.ones(len(rows)), ends_of), shape=(2 * n, 2 * n))
    shortest, start = int(conflict.sum()), -1
    for vertex in ends:
        length = sp.csgraph.dijkstra(
            graph, directed=False, indices=np.array([vertex]), unweighted=True, limit=shortest - 1
        )[0, vertex + n]
        if length < shortest:
            shortest, start = int(length), int(vertex)
    if start < 0:
        return np.flatnonzero(conflict)
    _, before = sp.csgraph.dijkstra(
        graph, directed=False, indices=np.array([start]), return_predecessors=True, unweighted=True
    )
    way = [start + n]
    while way[-1] != start:
        way.append(int(before[0, way[-1]]))
    vertices = np.array(way) % n
    keys = np.minimum(vertices[1:], vertices[:-1]) * n + np.maximum(vertices[1:], vertices[:-1])
    low, high = np.sort(np.stack([edges.start, edges.end])[:, edges.pairs[0]], axis=0)
    return np.flatnonzero(np.isin(low * n + high, keys))


def _mirrored_corners(edges: HalfEdges, conflict: BoolArray, at: BoolArray) -> BoolArray:
    """Return which corners have the opposite winding to the first corner of their vertex.

    Windings are compared across the faces around the vertex.
    """
    parallel = np.equal(*edges.start[edges.pairs])
    corners, (a, b), pair = corner_links(edges, edges.pairs, parallel, at)
    against = conflict[pair]
    n = len(corners)
    rows = np.concatenate([a, a + n])
    columns = np.concatenate([b + n * against, b + n * ~against])
    _, sheet = sp.csgraph.connected_components(
        sp.coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * n, 2 * n)), directed=False
    )
    _, first, vertex = np.unique(edges.start[corners], return_index=True, return_inverse=True)
    mirrored = np.zeros(len(edges.start), dtype=bool)
    mirrored[corners] = sheet[:n] != sheet[first[vertex.ravel()]]
    return mirrored


def _fewest_conflicts(pairs: IntArray, against: BoolArray, turned: BoolArray) -> BoolArray:
    """Flip faces that conflict with most of their neighbours; return the remaining conflicts."""
    one, other = pairs
    n = len(turned)
    degree = np.bincount(pairs.ravel(), minlength=n)
    while True:
        conflict = against ^ turned[one] ^ turned[other]
        count = np.bincount(pairs[:, conflict].ravel(), minlength=n)
        better = 2 * count > degree
        if not better.any():
            return np.asarray(conflict)
        # Of two neighbours only the first is flipped; flipping both would change nothing.
        both = better[one] & better[other]
        better[np.maximum(one, other)[both]] = False
        turned ^= better


def _cover(pairs: IntArray, area: FloatArray, most: int) -> IntArray | None:
    """Choose faces that cover all pairs, preferring faces in many pairs, and small ones."""
    one, other = pairs
    if len(one) > 3 * most:  # a face has three neighbours
        return None
    chosen: list[int] = []
    while len(one):
        face, count = np.unique(np.concatenate([one, other]), return_counts=True)
        worst = face[count == count.max()]
        chosen.append(int(worst[area[worst].argmin()]))
        left = (one != chosen[-1]) & (other != chosen[-1])
        one, other = one[left], other[left]
        if len(chosen) > most:
            return None
    return np.array(chosen, dtype=np.int64)


def _largest_piece(surface: _Surface, tally: dict[str, float]) -> _Surface:
    """Keep the component with the largest area; of equal ones, the first."""
    if len(surface.faces) == 0:
        return surface
    piece = components(surface.faces, len(surface.vertices))[surface.faces[:, 0]]
    if (piece == piece[0]).all():
        return surface
    _, piece = np.unique(piece, return_inverse=True)
    areas = surface.areas()
    sizes = np.asarray(np.bincount(piece, areas), dtype=np.float64)
    largest = first_of_largest(sizes)
    _count(tally, "pieces", len(sizes))
    _count(tally, "debris", float(1 - sizes[largest] / max(sizes.sum(), 1e-300)))
    # Components around or inside it are counted separately.
    first = np.unique(piece, return_index=True)[1]
    points = surface.vertices[surface.faces[piece == largest].ravel()]
    low, high = points.min(axis=0), points.max(axis=0)
    middle = surface.vertices[surface.faces[first]].mean(axis=1)
    around = ((middle >= low) & (middle <= high)).all(axis=1)
    around[largest] = False
    _count(tally, "pieces around", int(around.sum()))
    _count(tally, "area around", float(sizes[around].sum() / max(sizes.sum(), 1e-300)))
    return surface.only(piece == largest)


def _found_at(surface: _Surface, n_given: int) -> IntArray:
    """Return the vertex that each given one became; of several, the one with the largest area."""
    origin, vertex = surface.origin.ravel(), surface.faces.ravel()
    known = origin >= 0
    found = np.full(n_given, -1)
    found[origin[known]] = vertex[known]
    split = np.zeros(n_given + 1, dtype=bool)
    split[origin[known & (found[origin] != vertex)]] = True
    corner = np.flatnonzero(split[origin] & known)
    if len(corner) == 0:
        return found
    keys, pair = np.unique(
        np.stack([origin[corner], vertex[corner]], axis=1), axis=0, return_inverse=True
    )
    area = np.bincount(pair.ravel(), surface.areas()[corner // 3])
    order = np.lexsort((-keys[:, 1], _rounded(area), keys[:, 0]))  # the last one is kept
    found[keys[order, 0]] = keys[order, 1]
    return found


def _find_at_the_same_place(vertices: FloatArray, vertex_map: IntArray, lost: IntArray) -> None:
    """Map given vertices without faces, in place, to a coinciding vertex that has faces."""
    if len(lost) == 0:
        return
    place = first_at_place(vertices)
    found = np.flatnonzero(vertex_map >= 0)[::-1]
    at = np.full(len(vertices), -1)
    at[place[found]] = vertex_map[found]  # the first vertex is written last, and so is kept
    vertex_map[lost] = at[place[lost]]
