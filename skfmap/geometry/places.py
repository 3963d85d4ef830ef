"""Nearest places on a surface that respect the two sides of thin walls."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.spatial import KDTree

from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import is_finite
from skfmap.geometry.normals import vertex_normals

__all__ = ["Places", "Surface", "places_after_collapse", "surface_of_places"]

# Normals agree if the cosine of the angle between them is at least this: 60 degrees.
_AGREES = 0.5

# Penalty for a smaller cosine, relative to squared distances in mean edges: the other side of a
# wall counts as 2.4 edges away, however near it is, and a face at a right angle as 1.4.
_DISAGREES = 4.0

# Number of columns of a frame; see `_frames`.
_FRAME = 15

# A place is on the outer rim of the faces around a vertex if the weight of the vertex is at most
# this.
_ON_THE_RIM = 1e-9

# Number of point-triangle pairs processed at a time, few enough to stay in the cache.
_CHUNK = 2**16


class Places(NamedTuple):
    """Places of points on a surface.

    Attributes
    ----------
    face : ndarray of int32, shape (n_points,)
        The face of each place; -1 for points without a place.
    coordinates : ndarray of float32, shape (n_points, 2)
        Weights of the second and third corner of the face; NaN without a place.
    distance : ndarray of shape (n_points,)
        Distance between each point and its place; NaN without a place.
    """

    face: npt.NDArray[np.int32]
    coordinates: npt.NDArray[np.float32]
    distance: FloatArray


def places_after_collapse(
    points: FloatArray,
    normals: FloatArray,
    vertices: FloatArray,
    faces: IntArray,
    vertex_map: IntArray,
) -> Places:
    """Return the places of given vertices on the thinned mesh.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Coordinates of the given vertices.
    normals : ndarray of shape (n_points, 3)
        Their unit normals, from `skfmap.geometry.normals.vertex_normals`.
    vertices, faces : ndarray
        The thinned mesh.
    vertex_map : ndarray of int, shape (n_points,)
        The thinned vertex that each was collapsed into; -1 for those without a place.

    Returns
    -------
    Places
        Places in faces within two rings of the thinned vertex; see `Surface.around`.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.normals import vertex_normals
    >>> from skfmap.geometry.places import places_after_collapse
    >>> from skfmap.geometry.sphere import subdivided_octahedron
    >>> from skfmap.geometry.thinning import thin
    >>> vertices, faces = subdivided_octahedron(4)
    >>> thinned = thin(vertices, faces, 200)
    >>> places = places_after_collapse(vertices, vertex_normals(vertices, faces), *thinned)
    >>> bool((places.face >= 0).all()), float(places.distance.max().round(2))
    (True, 0.01)
    """
    return Surface(vertices, faces).around(points, normals, vertex_map)


def surface_of_places(
    given_faces: IntArray, places: Places, vertices: FloatArray, faces: IntArray
) -> "Surface":
    """Return a given mesh with its vertices moved to their places on another mesh.

    This gives the inverse map: `Surface.locate` then finds the given face, and the place in it, for
    points of the other mesh.

    Parameters
    ----------
    given_faces : ndarray of int, shape (n_given_faces, 3)
        Triangles of the given mesh.
    places : Places
        Places of its vertices on the other mesh.
    vertices, faces : ndarray
        The other mesh.

    Returns
    -------
    Surface
        The surface with vertices at their places, and the normals of the faces that contain them.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.normals import vertex_normals
    >>> from skfmap.geometry.places import places_after_collapse, surface_of_places
    >>> from skfmap.geometry.sphere import subdivided_octahedron
    >>> from skfmap.geometry.thinning import thin
    >>> vertices, faces = subdivided_octahedron(4)
    >>> thinned = thin(vertices, faces, 200)
    >>> places = places_after_collapse(vertices, vertex_normals(vertices, faces), *thinned)
    >>> surface = surface_of_places(faces, places, thinned.vertices, thinned.faces)
    >>> back = surface.locate(thinned.vertices, vertex_normals(thinned.vertices, thinned.faces))
    >>> there = vertices[faces[back.face, 0]]
    >>> bool((np.linalg.norm(there - thinned.vertices, axis=1) < 0.2).all())
    True
    """
    has_place = places.face >= 0
    face = places.face[has_place]
    second, third = places.coordinates[has_place].T.astype(np.float64)
    a, b, c = (vertices[faces[face, j]] for j in range(3))
    positions = np.full((len(places.face), 3), np.nan)
    positions[has_place] = a + second[:, None] * (b - a) + third[:, None] * (c - a)
    normals = np.zeros((len(places.face), 3))
    normals[has_place] = _unit(np.cross(b - a, c - a))
    return Surface(positions, given_faces, normals)


class Surface:
    """A triangle mesh on which places are searched.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates; faces with vertices that are not finite contain no places.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles.
    normals : ndarray of shape (n_vertices, 3), optional
        Unit normals at vertices; face normals are then means over corners. By default they are the
        normals of the mesh.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.places import Surface
    >>> vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    >>> surface = Surface(vertices, np.array([[0, 1, 2], [3, 2, 1]]))
    >>> places = surface.locate(np.array([[0.25, 0.5, 0.1]]), np.array([[0, 0, 1.0]]))
    >>> places.face.tolist(), places.coordinates.tolist(), places.distance.round(6).tolist()
    ([0], [[0.25, 0.5]], [0.1])
    """

    def __init__(
        self, vertices: FloatArray, faces: IntArray, normals: FloatArray | None = None
    ) -> None:
        finite = is_finite(vertices)
        self._vertices = vertices
        self._vertex_normals = normals
        self._used = np.flatnonzero(finite[faces[:, 0]] & finite[faces[:, 1]] & finite[faces[:, 2]])
        self._corners = faces if len(self._used) == len(faces) else faces[self._used]
        low, high = vertices[finite].min(axis=0), vertices[finite].max(axis=0)
        self._centre = (low + high) / 2
        self._scale = float((high - low).max()) / 2 or 1.0
        self._edge = _mean_edge(vertices, self._corners) / self._scale
        n_used = len(self._used)
        self._star = sp.csr_array(  # which faces each vertex is in
            (
                np.ones(3 * n_used, dtype=np.int32),
                (self._corners.ravel(), np.repeat(np.arange(n_used), 3)),
            ),
            shape=(len(vertices), n_used),
        )
        self._star.sort_indices()
        # Computed for a face when it is first needed.
        self._frames = np.empty((n_used, _FRAME))
        self._has_frame = np.zeros(n_used, dtype=bool)

    def around(
        self,
        points: FloatArray,
        normals: FloatArray,
        nearby: IntArray,
        *,
        agreeing: bool = False,
    ) -> Places:
        """Return the places of points within two rings of faces around vertices.

        The place of a point is the nearest point on the faces around its vertex whose normals are
        within 60 degrees of its own. If that is on the outer rim of these faces, or if no normal
        agrees, the faces around the neighbouring vertices are searched as well. A face whose normal
        does not agree is used only if it is nearer than all others by more than one or two mean
        edges, depending on the angle. This happens for single vertices with odd normals, but not
        across walls.

        Parameters
        ----------
        points, normals : ndarray of shape (n_points, 3)
            Coordinates and unit normals. For a normal of zero all faces are equally good.
        nearby : ndarray of int, shape (n_points,)
            A vertex near each point; -1 for points without a place.
        agreeing : bool
            Whether a point has no place if the normal of the face does not agree.

        Returns
        -------
        Places
            The place of each point.
        """
        n = len(points)
        face = np.full(n, -1, dtype=np.int64)
        weights = np.full((n, 2), np.nan)
        squared = np.full(n, np.nan)
        asked = np.flatnonzero(nearby >= 0)
        asked = asked[np.argsort(nearby[asked], kind="stable")]  # for locality in memory
        scaled = (points - self._centre) / self._scale

        def look(rings: sp.csr_array, rows: IntArray, asked: IntArray) -> IntArray:
            """Search rows of faces, and return the points that need a wider search."""
            self._prepare(rings[np.unique(rows)].indices.astype(np.int64))
            further = []
            for part in _parts(np.diff(rings.indptr)[rows]):
                which = asked[part]
                found, agrees, *place = self._nearest(
                    scaled[which], normals[which], rings, rows[part]
                )
                face[which], weights[which], squared[which] = found, *place
                corner = self._corners[found] == nearby[which, None]
                second, third = place[0].T
                own = (corner * np.column_stack([1 - second - third, second, third])).sum(axis=1)
                further.append(which[(own <= _ON_THE_RIM) | ~agrees])
            return np.concatenate([*further, np.empty(0, dtype=np.int64)])

        asked = asked[np.diff(self._star.indptr)[nearby[asked]] > 0]
        further = look(self._star, nearby[asked], asked)
        centres, rows = np.unique(nearby[further], return_inverse=True)
        look(self._two_rings(centres), rows, further)
        has_place = face >= 0
        if agreeing:
            cosines = _dot(normals[has_place], self._frames[face[has_place], 9:12])
            has_place[has_place] = cosines >= _AGREES
            face[~has_place], weights[~has_place], squared[~has_place] = -1, np.nan, np.nan
        face[has_place] = self._used[face[has_place]]
        return Places(
            face.astype(np.int32), weights.astype(np.float32), self._scale * np.sqrt(squared)
        )

    def locate(self, points: FloatArray, normals: FloatArray, *, agreeing: bool = False) -> Places:
        """Return the places of points around the vertices nearest in position and normal.

        The distance to a vertex includes the difference of the normals times the mean edge, so that
        the other side of a thin wall counts as two edges away.

        Parameters
        ----------
        points, normals : ndarray of shape (n_points, 3)
            Coordinates and unit normals; points that are not finite have no place.
        agreeing : bool
            Whether a point has no place if the normal of the face does not agree.

        Returns
        -------
        Places
            The place of each point; see `around`.
        """
        tree, numbers = self._tree
        scaled = (points - self._centre) / self._scale
        asked = is_finite(points)
        nearby = np.full(len(points), -1)
        there = np.column_stack([scaled, self._edge * normals])[asked]
        nearby[asked] = numbers[tree.query(there)[1]]
        return self.around(points, normals, nearby, agreeing=agreeing)

    @cached_property
    def _tree(self) -> tuple[KDTree, IntArray]:
        """Return a tree of positions and normals, and the vertices in it."""
        used = np.flatnonzero(np.diff(self._star.indptr))
        normals = self._vertex_normals
        if normals is None:
            normals = vertex_normals(self._vertices, self._corners)
        scaled = (self._vertices[used] - self._centre) / self._scale
        return KDTree(np.column_stack([scaled, self._edge * normals[used]])), used

    def _two_rings(self, centres: IntArray) -> sp.csr_array:
        """Return one row per vertex with the faces around it and around its neighbours."""
        corners = sp.csr_array(
            (self._star.data, self._corners.ravel(), 3 * np.arange(len(self._used) + 1)),
            shape=self._star.shape[::-1],
        )
        rings = sp.csr_array(self._star[centres] @ corners @ self._star)
        rings.sort_indices()
        return rings

    def _prepare(self, faces: IntArray) -> None:
        """Compute the frames of faces that have none yet."""
        wanted = np.zeros(len(self._used), dtype=bool)
        wanted[faces] = True
        new = np.flatnonzero(wanted & ~self._has_frame)
        corners = self._corners[new]
        a, b, c = ((self._vertices[corners[:, j]] - self._centre) / self._scale for j in range(3))
        frames = _frames(a, b, c)
        if self._vertex_normals is not None:
            frames[:, 9:12] = _unit(self._vertex_normals[corners].sum(axis=1))
        # In this order, because another thread may read them.
        self._frames[new] = frames
        self._has_frame[new] = True

    def _nearest(
        self, points: FloatArray, normals: FloatArray, rings: sp.csr_array, rows: IntArray
    ) -> tuple[IntArray, npt.NDArray[np.bool_], FloatArray, FloatArray]:
        """Return the best face for each point, whether it agrees, weights and squared distance."""
        counts = np.diff(rings.indptr)[rows]
        starts = np.cumsum(counts) - counts
        owner = np.repeat(np.arange(len(rows)), counts)
        steps = np.arange(len(owner)) - starts[owner]
        face = rings.indices[rings.indptr[rows][owner] + steps]
        frames = self._frames[face]
        second, third, squared = _nearest_points(points[owner], frames)
        cosine = _dot(normals[owner], frames[:, 9:12])
        cost = squared + _DISAGREES * self._edge**2 * np.maximum(_AGREES - cosine, 0.0)
        best = np.minimum.reduceat(cost, starts)
        hit = np.flatnonzero(cost == best[owner])
        _, first = np.unique(owner[hit], return_index=True)
        hit = hit[first]
        weights = np.column_stack([second[hit], third[hit]])
        return face[hit], cosine[hit] >= _AGREES, weights, squared[hit]


def _parts(counts: IntArray) -> list[slice]:
    """Split points with these numbers of candidate faces into parts of about equal work."""
    part = np.cumsum(counts) // _CHUNK
    cuts = np.flatnonzero(np.diff(part, prepend=-1))
    ends = np.append(cuts[1:], len(counts))[: len(cuts)]
    return [slice(start, end) for start, end in zip(cuts, ends, strict=True)]


def _mean_edge(vertices: FloatArray, corners: IntArray) -> float:
    lengths = [
        np.linalg.norm(vertices[corners[:, j]] - vertices[corners[:, j - 1]], axis=1).mean()
        for j in range(3)
    ]
    return float(np.mean(lengths))


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", a, b))


def _unit(vectors: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(lengths > 0, lengths, 1.0))


def _frames(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return a frame for each triangle, given its corners.

    The columns are the first corner; the directions of x (along the first edge), of y (in the plane
    of the triangle) and of the normal; x of the second corner; x and y of the third corner.
    """
    along = _unit(np.where((b == a).all(axis=1, keepdims=True), c - a, b - a))
    normal = _unit(np.cross(b - a, c - a))
    across = np.cross(normal, along)
    planar = np.column_stack([_dot(b - a, along), _dot(c - a, along), _dot(c - a, across)])
    return np.concatenate([a, along, across, normal, planar], axis=1)


def _nearest_points(
    points: FloatArray, frames: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the nearest points on triangles: two weights, and the squared distance."""
    away = points - frames[:, :3]
    x, y = _dot(away, frames[:, 3:6]), _dot(away, frames[:, 6:9])
    height = _dot(away, away) - x**2 - y**2
    b, c, d = frames[:, 12], frames[:, 13], frames[:, 14]  # corners (0, 0), (b, 0), (c, d)
    third = _divide(y, d)
    second = _divide(x - third * c, b)
    outside = (second < 0) | (third < 0) | (second + third > 1) | (d == 0) | (b == 0)
    squared = np.zeros(len(points))

    at = np.flatnonzero(outside)
    x, y, b, c, d = x[at], y[at], b[at], c[at], d[at]
    on_ab = np.clip(_divide(x, b), 0.0, 1.0)
    on_ac = np.clip(_divide(x * c + y * d, c**2 + d**2), 0.0, 1.0)
    on_bc = np.clip(_divide((x - b) * (c - b) + y * d, (c - b) ** 2 + d**2), 0.0, 1.0)
    to_ab = (x - on_ab * b) ** 2 + y**2
    to_ac = (x - on_ac * c) ** 2 + (y - on_ac * d) ** 2
    to_bc = (x - b - on_bc * (c - b)) ** 2 + (y - on_bc * d) ** 2
    is_ab = (to_ab <= to_ac) & (to_ab <= to_bc)
    is_ac = ~is_ab & (to_ac <= to_bc)
    second[at] = np.where(is_ab, on_ab, np.where(is_ac, 0.0, 1.0 - on_bc))
    third[at] = np.where(is_ab, 0.0, np.where(is_ac, on_ac, on_bc))
    squared[at] = np.minimum(np.minimum(to_ab, to_ac), to_bc)
    return second, third, squared + np.maximum(height, 0.0)


def _divide(over: FloatArray, under: FloatArray) -> FloatArray:
    """Divide; the result of a division by zero is 0."""
    return np.divide(over, under, out=np.zeros_like(over), where=under != 0)
