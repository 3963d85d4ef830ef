"""Triangulation of implicit surfaces with libigl's marching cubes and edge collapse."""

import igl
import numpy as np

from skfmap._tools.types import FloatArray, IntArray

__all__ = ["decimate", "marching_cubes"]


def marching_cubes(values: FloatArray, points: FloatArray) -> tuple[FloatArray, IntArray]:
    """Triangulate the zero level set of a function given on a grid.

    Parameters
    ----------
    values : ndarray of shape (nx, ny, nz)
        Values on the grid, negative inside and positive outside.
    points : ndarray of shape (nx, ny, nz, 3)
        Coordinates of the grid points. The grid may be rotated, but not mirrored.

    Returns
    -------
    vertices : ndarray of shape (n_vertices, 3)
        Points where edges of the grid cross the level set, in the units of ``points``.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles, wound with their normals towards positive values.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.isosurface import marching_cubes
    >>> axis = np.linspace(-2.0, 2.0, 9)
    >>> points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    >>> vertices, faces = marching_cubes(np.linalg.norm(points, axis=-1) - 1.1, points)
    >>> len(faces) == 2 * len(vertices) - 4  # a closed surface of genus 0
    True
    """
    x_fastest = values.transpose(2, 1, 0).ravel()
    corners = points.transpose(2, 1, 0, 3).reshape(-1, 3)
    vertices, faces, _ = igl.marching_cubes(x_fastest, corners, *values.shape, 0.0)
    return vertices, faces


def decimate(vertices: FloatArray, faces: IntArray, n_vertices: int) -> tuple[FloatArray, IntArray]:
    """Collapse the shortest edges of a closed surface of genus 0 to reduce its vertices.

    Parameters
    ----------
    vertices : ndarray of shape (n_given, 3)
        Coordinates.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles of a closed, manifold surface of genus 0.
    n_vertices : int
        Number of vertices to keep, at least 4.

    Returns
    -------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates; there are more than ``n_vertices`` if no further edge can be collapsed.
    faces : ndarray of int, shape (2 * n_vertices - 4, 3)
        Triangles.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.isosurface import decimate
    >>> vertices = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.5]])
    >>> upper = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    >>> lower = np.array([[1, 0, 5], [2, 1, 5], [3, 2, 5], [0, 3, 5]])
    >>> faces = np.concatenate([upper, lower])
    >>> [len(array) for array in decimate(vertices, faces, 5)]
    [5, 6]
    """
    out_vertices, out_faces, _, _ = igl.decimate(vertices, faces, 2 * n_vertices - 4)
    return np.ascontiguousarray(out_vertices), np.asarray(out_faces, dtype=np.int64)
