"""Nearest points on a surface in space."""

from typing import Any, NamedTuple

import igl
import numpy as np

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.geometry.faults import sound_faces
from skfmap.geometry.normals import vertex_normals

__all__ = ["ClosestPoints", "NearestPlaces", "NearestPoints", "face_normals", "nearest_places"]

# A point of a triangle is on an edge if it is within this fraction of the edge's length.
_ON_EDGE = 1e-9
# A place is on the opposite edge if the weight of a corner is at most this.
_NO_WEIGHT = 1e-9


class NearestPoints(NamedTuple):
    """Nearest points on a surface.

    Attributes
    ----------
    points : ndarray of shape (n, 3)
        The nearest points.
    normals : ndarray of shape (n, 3)
        Normals at the nearest points, interpolated from the vertices, because a face normal would
        depend on rounding where faces meet. Zero on a face without area.
    distances : ndarray of shape (n,)
        Distances to the nearest points.
    on_rim : ndarray of bool, shape (n,)
        Whether the nearest points are on the boundary of an open surface, beyond which nothing was
        scanned.
    """

    points: FloatArray
    normals: FloatArray
    distances: FloatArray
    on_rim: BoolArray


class NearestPlaces(NamedTuple):
    """Places on the faces of a surface that are nearest to points.

    Attributes
    ----------
    corners : ndarray of int, shape (n, 3)
        Vertices of the face.
    weights : ndarray of shape (n, 3)
        Weights of the corners, non-negative and summing to 1.
    distances : ndarray of shape (n,)
        Distances to the places.
    """

    corners: IntArray
    weights: FloatArray
    distances: FloatArray


class ClosestPoints:
    """A surface prepared for repeated queries of nearest points.

    Parameters
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        A triangle mesh.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.closest import ClosestPoints
    >>> triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> found = ClosestPoints(triangle, np.array([[0, 1, 2]])).of(np.array([[0.2, 0.2, 3.0]]))
    >>> found.distances.tolist(), found.normals.tolist()
    ([3.0], [[0.0, 0.0, 1.0]])
    """

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        self._vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self._faces = np.ascontiguousarray(faces, dtype=np.int64)
        self._tree: Any = igl.AABB()
        self._tree.init(self._vertices, self._faces)
        self._normals = vertex_normals(self._vertices, self._faces)
        self._rims = _edges_on_rim(self._faces)

    def of(self, points: FloatArray) -> NearestPoints:
        """Return the nearest points of the surface.

        Parameters
        ----------
        points : ndarray of shape (n, 3)
            Finite coordinates.
        """
        squared, face, nearest = self._tree.squared_distance(self._vertices, self._faces, points)
        face, nearest = np.ravel(face), np.reshape(nearest, (-1, 3))
        return NearestPoints(
            nearest,
            self._normals_at(face, nearest),
            np.sqrt(np.maximum(np.ravel(squared), 0.0)),
            self._on_rim(face, nearest),
        )

    def _normals_at(self, face: IntArray, nearest: FloatArray) -> FloatArray:
        corners = self._faces[face]
        a, b, c = (np.ascontiguousarray(self._vertices[corners[:, j]]) for j in range(3))
        weights = np.nan_to_num(igl.barycentric_coordinates(np.ascontiguousarray(nearest), a, b, c))
        normals = np.einsum("nc,nca->na", weights, self._normals[corners])
        return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1)[:, None], 1e-300))

    def _on_rim(self, face: IntArray, nearest: FloatArray) -> BoolArray:
        """Return which points lie on a boundary edge."""
        on_rim = np.zeros(len(face), dtype=bool)
        at = np.flatnonzero(self._rims[face].any(axis=1))
        corners = self._vertices[self._faces[face[at]]]
        for a in range(3):
            ahead, to_point = (
                corners[:, (a + 1) % 3] - corners[:, a],
                nearest[at] - corners[:, a],
            )
            off = np.linalg.norm(np.cross(ahead, to_point), axis=1)
            on_edge = off <= _ON_EDGE * np.square(ahead).sum(axis=1) ** 0.5
            on_rim[at] |= on_edge & self._rims[face[at], a]
        return on_rim


def nearest_places(points: FloatArray, vertices: FloatArray, faces: IntArray) -> NearestPlaces:
    """Return the places on the triangles of a mesh that are nearest to points.

    Parameters
    ----------
    points : ndarray of shape (n, 3)
        Finite coordinates.
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        The mesh, with at least one sound face. Faces that are not sound are ignored.

    Returns
    -------
    NearestPlaces
        The place for each point.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.closest import nearest_places
    >>> triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> found = nearest_places(np.array([[0.25, 0.5, 3.0]]), triangle, np.array([[0, 1, 2]]))
    >>> found.weights.tolist(), found.distances.tolist()
    ([[0.25, 0.25, 0.5]], [3.0])
    """
    sound = faces[sound_faces(vertices, faces)]
    used, numbers = np.unique(sound, return_inverse=True)
    numbers = np.ascontiguousarray(numbers.reshape(-1, 3), dtype=np.int64)
    at = np.ascontiguousarray(vertices[used], dtype=np.float64)
    tree: Any = igl.AABB()
    tree.init(at, numbers)
    _, face, nearest = tree.squared_distance(at, numbers, np.ascontiguousarray(points))
    corners = sound[np.ravel(face)]
    weights = _weights_of_corners(np.reshape(nearest, (-1, 3)), vertices[corners])
    there = np.einsum("nc,ncd->nd", weights, vertices[corners])
    return NearestPlaces(corners, weights, np.linalg.norm(points - there, axis=1))


def _weights_of_corners(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return the weights of the corners for points on triangles, shape (n, 3).

    They are computed from areas, or from positions along an edge where that is more accurate, as on
    triangles with hardly any area.
    """
    a, b, c = (np.ascontiguousarray(triangles[:, j]) for j in range(3))
    inside = igl.barycentric_coordinates(np.ascontiguousarray(points), a, b, c)
    tried = [np.where(np.isfinite(inside).all(axis=1)[:, None], inside, 1 / 3)]
    for j in range(3):
        start, ahead = triangles[:, j], triangles[:, (j + 1) % 3] - triangles[:, j]
        length = np.maximum(np.square(ahead).sum(axis=1), 1e-300)
        along = np.clip(np.einsum("nd,nd->n", points - start, ahead) / length, 0.0, 1.0)
        on_edge = np.zeros((len(points), 3))
        on_edge[:, j], on_edge[:, (j + 1) % 3] = 1 - along, along
        tried.append(on_edge)
    weights = np.stack(tried)
    weights = np.where(weights > _NO_WEIGHT, weights, 0.0)
    weights /= weights.sum(axis=2, keepdims=True)
    off = np.linalg.norm(np.einsum("tnc,ncd->tnd", weights, triangles) - points, axis=2)
    off[0] *= 1 - 1e-6  # the first wins ties
    return np.asarray(weights[off.argmin(axis=0), np.arange(len(points))])


def face_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the unit normals of faces, shape (n_faces, 3); zero for a face without area."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1)[:, None], 1e-300))


def _edges_on_rim(faces: IntArray) -> BoolArray:
    """Return which edges, from each corner to the next, are on the boundary; (n_faces, 3)."""
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, back, counts = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    return np.asarray((counts[back.ravel()] == 1).reshape(-1, 3))
