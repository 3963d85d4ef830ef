"""The nearest points of a surface in space."""

from typing import Any, NamedTuple

import igl
import numpy as np

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.geometry.normals import vertex_normals

__all__ = ["ClosestPoints", "NearestPoints", "face_normals"]

# Share of a triangle's length within which a point of it is on an edge.
_ON_EDGE = 1e-9


class NearestPoints(NamedTuple):
    """Where points are nearest to a surface.

    Attributes
    ----------
    points : ndarray of shape (n, 3)
        Of the surface.
    normals : ndarray of shape (n, 3)
        There, between those of the vertices: of faces that meet where a point is nearest, rounding
        would choose one. Zero on a face without area.
    distances : ndarray of shape (n,)
        Of the points from them.
    on_rim : ndarray of bool, shape (n,)
        Whether they lie on the boundary of an open surface, beyond which nothing was scanned.
    """

    points: FloatArray
    normals: FloatArray
    distances: FloatArray
    on_rim: BoolArray


class ClosestPoints:
    """A surface that is asked for its nearest points again and again.

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
        """Return which points lie on an edge that only one face has."""
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


def face_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the unit normals of faces, shape (n_faces, 3); zero where a face has no area."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1)[:, None], 1e-300))


def _edges_on_rim(faces: IntArray) -> BoolArray:
    """Return which edges, from each corner to the next, only one face has; shape (n_faces, 3)."""
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, back, counts = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    return np.asarray((counts[back.ravel()] == 1).reshape(-1, 3))
