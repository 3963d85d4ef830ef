"""Thinning of meshes to fewer vertices, with a map from given to thinned vertices."""

import threading
from typing import NamedTuple

import fast_simplification
import igl
import numpy as np
from scipy.spatial import KDTree

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.geometry.faults import (
    count_components,
    is_wound_consistently,
    nonmanifold_edges,
    nonmanifold_vertices,
)
from skfmap.geometry.normals import vertex_normals

__all__ = ["Thinned", "ThinningReport", "check_thinned", "thin"]

# The fast quadric stage stops at this many times the requested number of vertices. Shortest-edge
# collapses do the rest, because they leave evenly spaced vertices, which eigenfunctions need. See
# the notes of `thin`.
_FIRST_STAGE = 10

# Weight of the position after the collapse, relative to squared distances from the planes of the
# faces around: enough to hold vertices in flat regions.
_STAY = 1e-2

# Weight of walls along the boundary, where each edge competes with many faces.
_WALL = 1e2

# A vertex is not moved if this rotates a face so that the cosine is below the first value, or
# leaves twice its area divided by its squared longest edge below the second. Steps smaller than
# this fraction of the full step are not tried.
_TURNED = 0.2
_FLAT = 0.02
_SMALL_STEP = 0.1

# Number of attempts to reach the requested number of vertices, which depends on how many are on the
# boundary, and the fraction of it that is close enough.
_TRIES = 8
_NEARLY = 0.99

# Normals on the two sides of a wall are opposite if their cosine is below this: 120 degrees.
_OPPOSITE = -0.5

# The library keeps its mesh in global variables across the four calls of one simplification.
_ONE_AT_A_TIME = threading.Lock()


class Thinned(NamedTuple):
    """A thinned mesh, and the vertex that each given vertex was collapsed into.

    Attributes
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates, in the units of the given mesh.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles, wound like the given ones.
    vertex_map : ndarray of int, shape (n_given,)
        The thinned vertex that each given vertex was collapsed into.
    """

    vertices: FloatArray
    faces: IntArray
    vertex_map: IntArray


def thin(vertices: FloatArray, faces: IntArray, n_vertices: int) -> Thinned:
    """Thin a mesh by collapsing edges.

    Parameters
    ----------
    vertices : ndarray of shape (n_given, 3)
        Coordinates.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles of a connected, manifold, consistently wound surface, with or without boundary,
        that uses every vertex.
    n_vertices : int
        Maximum number of vertices to keep.

    Raises
    ------
    ValueError
        If the faces are not wound consistently.

    Returns
    -------
    Thinned
        A connected, manifold surface, wound like the given one; this is the given mesh itself if it
        has at most ``n_vertices`` vertices. There are more only if every further collapse would
        change the topology.

    Notes
    -----
    Large meshes are first reduced to a few times ``n_vertices`` by a fast quadric collapse [1]_,
    which does not preserve the topology: pairs of faces that it folds onto each other are removed,
    and if it pinches off a neck, it is repeated with more vertices. Then the shortest edge is
    collapsed repeatedly as long as this preserves the topology. This leaves evenly spaced vertices
    but shrinks curved regions; each vertex is therefore moved to the point nearest to the planes of
    the faces that it represents, and to walls along the boundary.

    All steps have a fixed order, so that equal meshes are thinned equally.

    References
    ----------
    .. [1] M. Garland and P. S. Heckbert, "Surface Simplification Using Quadric Error Metrics",
       SIGGRAPH 1997.

    Examples
    --------
    >>> from skfmap.geometry.sphere import subdivided_octahedron
    >>> from skfmap.geometry.thinning import thin
    >>> vertices, faces = subdivided_octahedron(4)
    >>> thinned = thin(vertices, faces, 100)
    >>> [array.shape for array in (vertices, *thinned)]
    [(1026, 3), (100, 3), (196, 3), (1026,)]
    """
    n_given = len(vertices)
    faces = np.ascontiguousarray(faces, dtype=np.int64)
    if n_given <= n_vertices:
        return Thinned(vertices, faces, np.arange(n_given))
    if not is_wound_consistently(faces):  # the libraries would not terminate
        raise ValueError("its faces have no consistent winding, or more than two share an edge")
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    centre, scale = (low + high) / 2, float((high - low).max()) / 2
    dense = Thinned((vertices - centre) / scale, faces, np.arange(n_given))
    sparse = dense
    n_rim = _count_rim(faces, n_given)
    n_first = _FIRST_STAGE * n_vertices + n_rim  # quadrics keep the boundary
    while 1.5 * n_first < n_given and sparse is dense:
        candidate = _by_quadrics(dense, n_first)
        if _is_manifold(candidate) and count_components(candidate.faces, len(candidate[0])) == 1:
            sparse = candidate
        n_first *= 2
    rim_left = n_rim * (n_vertices / n_given) ** 0.5  # the boundary is thinned like a curve
    thinned = _by_shortest_edges(sparse, n_vertices, rim_left)
    placed = _on_the_surface(thinned, sparse)
    return Thinned(placed * scale + centre, thinned.faces, thinned.vertex_map[sparse.vertex_map])


class ThinningReport(NamedTuple):
    """How well a thinned mesh represents the given one.

    Attributes
    ----------
    hausdorff : tuple of float
        The largest distance of a given vertex from the thinned surface, and of a thinned vertex
        from the given surface, divided by the square root of the given area.
    n_pieces : int
        Number of components of the thinned mesh.
    manifold : bool
        Whether its faces form one consistently wound sheet at each edge and vertex.
    thin_wall_share : float
        Fraction of its area where the other side of the wall is less than a mean edge away.
    """

    hausdorff: tuple[float, float]
    n_pieces: int
    manifold: bool
    thin_wall_share: float


def check_thinned(
    vertices: FloatArray, faces: IntArray, thinned: Thinned, distances: FloatArray
) -> ThinningReport:
    """Measure how well a thinned mesh represents the given one.

    Parameters
    ----------
    vertices, faces : ndarray
        The given mesh.
    thinned : Thinned
        The result of `thin`.
    distances : ndarray of shape (n_given,)
        Distances between given vertices and their places, from
        `skfmap.geometry.places.places_after_collapse`.

    Returns
    -------
    ThinningReport
        The report. Its second distance is measured to the given faces around the vertices that were
        collapsed into the thinned one, never through a wall.

    Examples
    --------
    >>> from skfmap.geometry.normals import vertex_normals
    >>> from skfmap.geometry.places import places_after_collapse
    >>> from skfmap.geometry.sphere import subdivided_octahedron
    >>> from skfmap.geometry.thinning import check_thinned, thin
    >>> vertices, faces = subdivided_octahedron(4)
    >>> thinned = thin(vertices, faces, 200)
    >>> places = places_after_collapse(vertices, vertex_normals(vertices, faces), *thinned)
    >>> report = check_thinned(vertices, faces, thinned, places.distance)
    >>> report.n_pieces, report.manifold, report.thin_wall_share, max(report.hausdorff) < 0.01
    (1, True, 0.0, True)
    """
    n = len(thinned.vertices)
    size = float(_normals(vertices, faces)[1].sum() / 2) ** 0.5
    hausdorff = float(np.nanmax(distances)) / size, _distance_back(vertices, faces, thinned) / size
    n_pieces = count_components(thinned.faces, n)
    return ThinningReport(hausdorff, n_pieces, _is_manifold(thinned), _thin_wall_share(thinned))


def _distance_back(vertices: FloatArray, faces: IntArray, thinned: Thinned) -> float:
    """Return the largest distance between a thinned vertex and the given faces it represents."""
    squared = ((vertices - thinned.vertices[thinned.vertex_map]) ** 2).sum(axis=1)
    order = np.lexsort((squared, thinned.vertex_map))
    _, first = np.unique(thinned.vertex_map[order], return_index=True)
    nearby = np.zeros(len(vertices), dtype=bool)
    nearby[order[first]] = True
    nearby[faces[nearby[faces].any(axis=1)]] = True
    around = faces[nearby[faces].any(axis=1)]
    return (
        float(igl.point_mesh_squared_distance(thinned.vertices, vertices, around)[0].max()) ** 0.5
    )


def _thin_wall_share(mesh: Thinned) -> float:
    """Return the fraction of the area with an opposite vertex behind it, within a mean edge."""
    corners = mesh.vertices[mesh.faces]
    edge = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())
    normals = vertex_normals(mesh.vertices, mesh.faces)
    here, there = KDTree(mesh.vertices).query_pairs(edge, output_type="ndarray").T
    opposite = (normals[here] * normals[there]).sum(axis=1) < _OPPOSITE
    behind = ((mesh.vertices[there] - mesh.vertices[here]) * normals[here]).sum(axis=1) < 0
    on_wall = np.zeros(len(mesh.vertices))
    on_wall[here[opposite & behind]] = on_wall[there[opposite & behind]] = 1.0
    areas = _normals(mesh.vertices, mesh.faces)[1]
    return float((on_wall[mesh.faces].mean(axis=1) * areas).sum() / areas.sum())


def _by_quadrics(mesh: Thinned, n_vertices: int) -> Thinned:
    """Collapse quickly to about ``n_vertices`` vertices; vertices on the boundary are kept."""
    n_given = len(mesh.vertices)
    n_faces = int(len(mesh.faces) * n_vertices / n_given)
    with _ONE_AT_A_TIME:
        vertices, faces, collapses = fast_simplification.simplify(
            mesh.vertices,
            mesh.faces.astype(np.int32),
            target_count=n_faces,
            return_collapses=True,
            preserve_border=True,
        )
    into = np.arange(n_given)
    into[collapses[:, 1]] = collapses[:, 0]
    while True:
        further = into[into]
        if np.array_equal(further, into):
            break
        into = further
    left = into[mesh.faces]
    left = left[_has_three_corners(left)]
    # The library numbers the remaining vertices in the order of the given ones.
    is_used = np.zeros(n_given, dtype=bool)
    is_used[left] = True
    used = np.flatnonzero(is_used)
    number = np.full(n_given, -1)
    number[used] = np.arange(len(used))
    faces = _without_folds(number[left])
    kept, faces = np.unique(faces, return_inverse=True)
    renumbered = np.full(len(used) + 1, -1)  # the last entry is for vertices without a face
    renumbered[kept] = np.arange(len(kept))
    vertices = vertices[kept]
    vertex_map = _spread(renumbered[number[into]], mesh, vertices)
    return Thinned(vertices, faces.reshape(-1, 3), vertex_map)


def _by_shortest_edges(mesh: Thinned, n_vertices: int, n_rim: float) -> Thinned:
    """Collapse shortest edges to ``n_vertices`` vertices, about ``n_rim`` of them on the rim."""
    n, n_faces = len(mesh.vertices), len(mesh.faces)
    # Euler: n = n_faces / 2 + n_rim / 2 + characteristic, for the given and the thinned mesh.
    characteristic = n - (n_faces + _count_rim(mesh.faces, n)) / 2
    best, too_few, too_many = mesh, 0, n_faces
    for _ in range(_TRIES):
        wanted = int(2 * (n_vertices - characteristic) - n_rim)
        if not too_few < wanted < too_many:
            wanted = max((too_few + too_many) // 2, 1)
        vertices, faces, births, _ = igl.decimate(mesh.vertices, mesh.faces, wanted)
        faces = np.ascontiguousarray(faces, dtype=np.int64)
        n_left = len(vertices)
        if len(best.vertices) > n_vertices or len(best.vertices) < n_left <= n_vertices:
            # The corners of a remaining face are the vertices that its corners were collapsed into.
            onwards = np.full(n, -1)
            onwards[mesh.faces[births]] = faces
            onwards = _spread(onwards, mesh, vertices)
            best = Thinned(np.ascontiguousarray(vertices), faces, onwards)
        if _NEARLY * n_vertices <= n_left <= n_vertices:
            break
        too_few, too_many = (too_few, wanted) if n_left > n_vertices else (wanted, too_many)
        n_rim = _count_rim(faces, n_left) + (n_left > n_vertices)
    return best


def _on_the_surface(thinned: Thinned, mesh: Thinned) -> FloatArray:
    """Return the points nearest to the planes of the faces that each vertex represents."""
    n = len(thinned.vertices)
    matrices, sums, weights = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros(n)

    def add(ends: IntArray, normals: FloatArray, areas: FloatArray, points: FloatArray) -> None:
        """Add planes to the quadrics of the vertices that their ends were collapsed into."""
        offsets = (normals * points).sum(axis=1)
        for j in range(ends.shape[1]):
            first = (ends[:, :j] != ends[:, j, None]).all(axis=1)  # add each plane only once
            vertex, area, normal = ends[first, j], areas[first], normals[first]
            weights[:] += np.bincount(vertex, area, n)
            for row in range(3):
                weighted = area * normal[:, row]
                sums[:, row] += np.bincount(vertex, weighted * offsets[first], n)
                for column in range(3):
                    matrices[:, row, column] += np.bincount(vertex, weighted * normal[:, column], n)

    normals, double_areas = _normals(mesh.vertices, mesh.faces)
    add(thinned.vertex_map[mesh.faces], normals, double_areas, mesh.vertices[mesh.faces[:, 0]])
    rims, sides = _rim(mesh.faces)
    if len(rims):  # walls along the boundary keep it from moving inwards
        along = mesh.vertices[rims[:, 1]] - mesh.vertices[rims[:, 0]]
        walls = np.cross(along, normals[sides])
        lengths = np.linalg.norm(walls, axis=1)
        walls /= np.where(lengths > 0, lengths, 1.0)[:, None]
        add(thinned.vertex_map[rims], walls, _WALL * lengths**2, mesh.vertices[rims[:, 0]])
    weights = _STAY * np.where(weights > 0, weights, 1.0)
    matrices += weights[:, None, None] * np.eye(3)
    sums += weights[:, None] * thinned.vertices
    placed = np.linalg.solve(matrices, sums[:, :, None])[:, :, 0]

    before, _ = _normals(thinned.vertices, thinned.faces)
    steps = np.ones(n)
    while True:  # vertices of faces that flipped move back: by halves, and finally all the way
        moved = thinned.vertices + steps[:, None] * (placed - thinned.vertices)
        after, double_areas = _normals(moved, thinned.faces)
        corners = moved[thinned.faces]
        longest = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2).max(axis=1)
        wrong = ((before * after).sum(axis=1) < _TURNED) | (double_areas < _FLAT * longest)
        back = np.unique(thinned.faces[wrong])
        if not steps[back].any():
            return moved
        steps[back] = np.where(steps[back] > _SMALL_STEP, steps[back] / 2, 0.0)


def _normals(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the unit normals of faces (zero without area), and twice their areas."""
    a, b, c = (vertices[faces[:, j]] for j in range(3))
    normals = np.cross(b - a, c - a)
    double_areas = np.linalg.norm(normals, axis=1)
    return normals / np.where(double_areas > 0, double_areas, 1.0)[:, None], double_areas


def _rim(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Return the boundary edges, directed as in their face, and the face of each."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    keys = np.sort(edges, axis=1) @ [int(faces.max()) + 1, 1]
    _, first, counts = np.unique(keys, return_index=True, return_counts=True)
    single = first[counts == 1]
    return edges[single], single % len(faces)


def _without_folds(faces: IntArray) -> IntArray:
    """Remove pairs of coinciding faces, until there are none."""
    while True:
        corners = np.sort(faces, axis=1)
        order = np.lexsort(corners.T)
        same = (corners[order][1:] == corners[order][:-1]).all(axis=1)
        if not same.any():
            return faces
        folded = np.zeros(len(faces), dtype=bool)
        folded[order[1:][same]] = folded[order[:-1][same]] = True
        faces = faces[~folded]


def _spread(vertex_map: IntArray, mesh: Thinned, positions: FloatArray) -> IntArray:
    """Map vertices without a target (-1) to the target of a neighbour.

    Each gets the nearest of its neighbours' targets, ring by ring.
    """
    vertex_map = vertex_map.copy()
    around = mesh.faces[(vertex_map < 0)[mesh.faces].any(axis=1)]
    links = np.concatenate([around[:, [i, j]] for i in range(3) for j in range(3) if i != j])
    while True:
        links = links[vertex_map[links[:, 0]] < 0]
        ready = links[vertex_map[links[:, 1]] >= 0]
        if not len(ready):
            return vertex_map
        vertex, target = ready[:, 0], vertex_map[ready[:, 1]]
        distance = ((mesh.vertices[vertex] - positions[target]) ** 2).sum(axis=1)
        order = np.lexsort((target, distance, vertex))
        vertex, first = np.unique(vertex[order], return_index=True)
        vertex_map[vertex] = target[order][first]


def _is_manifold(mesh: Thinned) -> bool:
    return (
        is_wound_consistently(mesh.faces)
        and not len(nonmanifold_edges(mesh.faces))
        and not len(nonmanifold_vertices(mesh.faces, len(mesh.vertices)))
    )


def _count_rim(faces: IntArray, n_vertices: int) -> int:
    """Return the number of vertices on the boundary, without sorting edges.

    Around an interior vertex, each neighbour follows it in one face and precedes it in another; at
    the boundary this fails for the first and the last neighbour.
    """
    first, second, third = faces.T
    sums = np.zeros(n_vertices)
    for here, after, before in (
        (first, second, third),
        (second, third, first),
        (third, first, second),
    ):
        sums += np.bincount(here, (after - before).astype(np.float64), n_vertices)
    return int(np.count_nonzero(sums))


def _has_three_corners(faces: IntArray) -> BoolArray:
    a, b, c = faces.T
    return (a != b) & (b != c) & (c != a)
