"""Places on a surface that are nearest to points, without jumping through thin walls."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.spatial import KDTree

from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import is_finite
from skfmap.geometry.normals import vertex_normals

__all__ = ["Places", "Surface", "places_after_collapse"]

# Cosine of the angle up to which normals agree: 60 degrees.
_AGREES = 0.5

# What disagreement costs, against squared distances of points in a box of size two: faces that
# disagree come after all that agree, the less they do so the later, and by distance where equal.
_DISAGREES = 1e3

# Weight of the vertex in the middle up to which a place is on the rim of the faces around it.
_ON_THE_RIM = 1e-9

# Point-triangle pairs looked at in one go: few enough to stay in the cache.
_CHUNK = 2**16


class Places(NamedTuple):
    """Where on a surface points are.

    Attributes
    ----------
    face : ndarray of int32, shape (n_points,)
        The face; -1 for points that have no place.
    coordinates : ndarray of float32, shape (n_points, 2)
        Weights of the face's second and third corner; NaN without a place.
    distance : ndarray of shape (n_points,)
        From the point to its place; NaN without a place.
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
    """Return where given vertices are on the mesh that they were thinned to.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Coordinates of the given vertices.
    normals : ndarray of shape (n_points, 3)
        Their unit normals, as by `skfmap.geometry.normals.vertex_normals`.
    vertices, faces : ndarray
        The thinned mesh.
    vertex_map : ndarray of int, shape (n_points,)
        The thinned vertex that each was collapsed into; -1 for those without a place.

    Returns
    -------
    Places
        Each in a face within two rings of the vertex: see `Surface.around`.

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


class Surface:
    """A triangle mesh on which places are looked for.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates; vertices that are not finite are in no place.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles.
    normals : ndarray of shape (n_vertices, 3), optional
        Unit normals at vertices, and at faces the normalised sums over their corners; by default
        the mesh's own.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.places import Surface
    >>> vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    >>> surface = Surface(vertices, np.array([[0, 1, 2], [3, 2, 1]]))
    >>> places = surface.locate(np.array([[0.25, 0.5, 0.1]]), np.array([[0, 0, 1.0]]))
    >>> places.face.tolist(), places.coordinates.tolist(), places.distance.round(9).tolist()
    ([0], [[0.25, 0.5]], [0.1])
    """

    def __init__(
        self, vertices: FloatArray, faces: IntArray, normals: FloatArray | None = None
    ) -> None:
        usable = is_finite(vertices)
        self.vertices = self._vertices = vertices
        self.faces = self._faces = faces
        self._used = np.flatnonzero(usable[faces].all(axis=1))
        corners = vertices[faces[self._used]]
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        self._centre = (low + high) / 2
        self._scale = float((high - low).max()) / 2 or 1.0
        corners = (corners - self._centre) / self._scale
        n_vertices, n_used = len(vertices), len(self._used)
        self._star = sp.csr_array(  # in which faces vertices are
            (
                np.ones(3 * n_used, dtype=np.int8),
                (faces[self._used].ravel(), np.repeat(np.arange(n_used), 3)),
            ),
            shape=(n_vertices, n_used),
        )
        self._star.sort_indices()
        self._frames, own_normals = _frames(corners)
        if normals is None:
            self._normals = own_normals
            self._vertex_normals = None
        else:
            self._vertex_normals = normals
            self._normals = _unit(normals[faces[self._used]].sum(axis=1))

    def around(self, points: FloatArray, normals: FloatArray, nearby: IntArray) -> Places:
        """Return the places of points within two rings of faces around vertices.

        Of the faces around its vertex, a point gets the nearest point on those whose normals are
        within 60 degrees of its own. Where that lies on the outer rim of these faces, or where
        none agrees, the faces around the neighbours are looked at as well. Where none of these
        agrees either, it gets the nearest point on the face whose normal is the nearest to its own.

        Parameters
        ----------
        points, normals : ndarray of shape (n_points, 3)
            Coordinates, and unit normals (zero where there is none: then every face is as good).
        nearby : ndarray of int, shape (n_points,)
            A vertex near each point; -1 for points without a place.

        Returns
        -------
        Places
            For each point.
        """
        n = len(points)
        face = np.full(n, -1, dtype=np.int64)
        weights = np.full((n, 2), np.nan)
        squared = np.full(n, np.nan)
        asked = np.flatnonzero(nearby >= 0)
        asked = asked[np.argsort(nearby[asked], kind="stable")]  # neighbours share memory
        scaled = (points - self._centre) / self._scale

        def look(rings: sp.csr_array, rows: IntArray, asked: IntArray) -> IntArray:
            """Look in rows of faces, and return which points may be nearer to others."""
            further = []
            for part in _parts(np.diff(rings.indptr)[rows]):
                which = asked[part]
                found, agrees, *place = self._nearest(
                    scaled[which], normals[which], rings, rows[part]
                )
                face[which], weights[which], squared[which] = found, *place
                corner = self._faces[self._used[found]] == nearby[which, None]
                second, third = place[0].T
                own = (corner * np.column_stack([1 - second - third, second, third])).sum(axis=1)
                further.append(which[(own <= _ON_THE_RIM) | ~agrees])
            return np.concatenate([*further, np.empty(0, dtype=np.int64)])

        asked = asked[np.diff(self._star.indptr)[nearby[asked]] > 0]
        further = look(self._star, nearby[asked], asked)
        centres, rows = np.unique(nearby[further], return_inverse=True)
        look(self._two_rings(centres), rows, further)
        has_place = face >= 0
        face[has_place] = self._used[face[has_place]]
        return Places(
            face.astype(np.int32), weights.astype(np.float32), self._scale * np.sqrt(squared)
        )

    def locate(self, points: FloatArray, normals: FloatArray) -> Places:
        """Return the places of points near the vertices that are nearest in position and normal.

        The distance to a vertex has a second term, by how much normals differ times the mean edge:
        the other side of a thin wall is two edges away.

        Parameters
        ----------
        points, normals : ndarray of shape (n_points, 3)
            Coordinates and unit normals.

        Returns
        -------
        Places
            For each point: see `around`.
        """
        tree, numbers, edge = self._tree
        scaled = (points - self._centre) / self._scale
        _, nearest = tree.query(np.column_stack([scaled, edge * normals]))
        return self.around(points, normals, numbers[nearest])

    @cached_property
    def _tree(self) -> tuple[KDTree, IntArray, float]:
        """Return a tree of positions and normals, the vertices in it and the mean edge."""
        used = np.unique(self._faces[self._used])
        normals = self._vertex_normals
        if normals is None:
            normals = vertex_normals(self._vertices, self._faces)
        scaled = (self._vertices[used] - self._centre) / self._scale
        ends = self._faces[self._used]
        steps = (self._vertices[ends] - self._vertices[np.roll(ends, 1, axis=1)]) / self._scale
        edge = float(np.linalg.norm(steps, axis=2).mean())
        return KDTree(np.column_stack([scaled, edge * normals[used]])), used, edge

    def _two_rings(self, centres: IntArray) -> sp.csr_array:
        """Return in a row for each vertex the faces around it and around its neighbours."""
        neighbours = self._star[centres].astype(np.int32) @ self._star.T.astype(np.int32)
        rings = sp.csr_array(neighbours @ self._star.astype(np.int32))
        rings.sort_indices()
        return rings

    def _nearest(
        self, points: FloatArray, normals: FloatArray, rings: sp.csr_array, rows: IntArray
    ) -> tuple[IntArray, npt.NDArray[np.bool_], FloatArray, FloatArray]:
        """Return the best face of a row for each point, whether it agrees, weights, distance."""
        counts = np.diff(rings.indptr)[rows]
        starts = np.cumsum(counts) - counts
        owner = np.repeat(np.arange(len(rows)), counts)
        steps = np.arange(len(owner)) - starts[owner]
        face = rings.indices[rings.indptr[rows][owner] + steps]
        second, third, squared = _nearest_points(points[owner], self._frames, face)
        cosine = (normals[owner] * self._normals[face]).sum(axis=1)
        cost = squared + _DISAGREES * np.where(cosine >= _AGREES, 0.0, 2.0 - cosine)
        best = np.minimum.reduceat(cost, starts)
        hit = np.flatnonzero(cost == best[owner])
        _, first = np.unique(owner[hit], return_index=True)
        hit = hit[first]
        weights = np.column_stack([second[hit], third[hit]])
        return face[hit], cosine[hit] >= _AGREES, weights, squared[hit]


def _parts(counts: IntArray) -> list[slice]:
    """Cut points, with so many faces to look at each, into parts of about equal work."""
    part = np.cumsum(counts) // _CHUNK
    cuts = np.flatnonzero(np.diff(part, prepend=-1))
    ends = np.append(cuts[1:], len(counts))[: len(cuts)]
    return [slice(start, end) for start, end in zip(cuts, ends, strict=True)]


def _unit(vectors: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(lengths > 0, lengths, 1.0))


def _frames(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a frame for each triangle, and its normal.

    Columns of the frames: the first corner; the directions of x, along the first edge, and y, in
    the plane of the triangle; x of the second corner; x and y of the third.
    """
    a, b, c = corners.transpose(1, 0, 2)
    along = _unit(np.where((b == a).all(axis=1, keepdims=True), c - a, b - a))
    normal = _unit(np.cross(b - a, c - a))
    across = np.cross(normal, along)
    x_of_second = ((b - a) * along).sum(axis=1)
    x_of_third, y_of_third = ((c - a) * along).sum(axis=1), ((c - a) * across).sum(axis=1)
    planar = np.column_stack([x_of_second, x_of_third, y_of_third])
    return np.concatenate([a, along, across, planar], axis=1), normal


def _nearest_points(
    points: FloatArray, frames: FloatArray, face: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the points of triangles nearest to points: two weights and the squared distance."""
    frame = frames[face]
    away = points - frame[:, :3]
    x = np.einsum("ij,ij->i", away, frame[:, 3:6])
    y = np.einsum("ij,ij->i", away, frame[:, 6:9])
    height = np.einsum("ij,ij->i", away, away) - x**2 - y**2
    b, c, d = frame[:, 9], frame[:, 10], frame[:, 11]  # corners (0, 0), (b, 0), (c, d)
    third = _divide(y, d)
    second = _divide(x - third * c, b)
    outside = (second < 0) | (third < 0) | (second + third > 1) | (d == 0) | (b == 0)
    squared = np.zeros(len(face))

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
    """Divide, with 0 where that cannot be done."""
    return np.divide(over, under, out=np.zeros_like(over), where=under != 0)
