"""Gaussian and mean curvature at vertices."""

import igl
import numpy as np

from skfmap._tools.types import BoolArray, FloatArray, IntArray, SparseMatrix
from skfmap.geometry.faults import boundary_vertices, degenerate_faces, edges_of
from skfmap.geometry.normals import vertex_normals

__all__ = ["clip_by_area", "gaussian_curvature", "log_magnitude", "mean_curvature"]


def gaussian_curvature(vertices: FloatArray, faces: IntArray, mass: FloatArray) -> FloatArray:
    """Return the angle defect divided by the area of each vertex, shape (n_vertices,).

    On the boundary, where it is undefined, and at faces without area, whose angles are unknown, it
    is the mean of the neighbours, so that a missing face at the tip of a limb does not make the tip
    flat. By the Gauss-Bonnet theorem, the integral over a sound closed surface is 2 pi times the
    Euler characteristic.
    """
    flat = degenerate_faces(vertices, faces)
    defect = np.asarray(igl.gaussian_curvature(vertices, np.delete(faces, flat, axis=0)))
    unknown = boundary_vertices(faces, len(vertices))
    unknown[faces[flat]] = True
    return _from_neighbours(defect / mass, unknown, faces)


def mean_curvature(
    vertices: FloatArray, faces: IntArray, stiffness: SparseMatrix, mass: FloatArray
) -> FloatArray:
    """Return half the normal component of the Laplacian of the position, shape (n_vertices,).

    On the boundary, where it is undefined, it is the mean of the neighbours. It is positive where
    the surface is convex (1 / r on a sphere of radius r) if faces are wound outwards.
    """
    laplacian = np.asarray(stiffness @ vertices) / mass[:, None]
    normals = vertex_normals(vertices, faces)
    curvature = np.asarray((laplacian * normals).sum(axis=1) / 2)
    return _from_neighbours(curvature, boundary_vertices(faces, len(vertices)), faces)


def _from_neighbours(values: FloatArray, unknown: BoolArray, faces: IntArray) -> FloatArray:
    """Replace unknown values by the mean of their known neighbours, or by 0 if there are none."""
    if not unknown.any():
        return values
    edges = edges_of(faces)
    ends = np.concatenate([edges, edges[:, ::-1]])
    ends = ends[unknown[ends[:, 0]] & ~unknown[ends[:, 1]]]
    sums, counts = (
        np.bincount(ends[:, 0], w, len(values)) for w in (values[ends[:, 1]], np.ones(len(ends)))
    )
    return np.where(unknown, sums / np.maximum(counts, 1), values)


def clip_by_area(values: FloatArray, mass: FloatArray, percentile: float) -> FloatArray:
    """Clip a function to its area-weighted percentiles ``percentile`` and ``100 - percentile``.

    Without weights, a region of small triangles would dominate the percentiles.
    """
    order = np.argsort(values, kind="stable")
    below = np.cumsum(mass[order]) - mass[order] / 2
    share = np.array([percentile, 100 - percentile]) / 100 * mass.sum()
    low, high = np.interp(share, below, values[order])
    return np.asarray(np.clip(values, low, high))


def log_magnitude(values: FloatArray, floor: float) -> FloatArray:
    """Return log(max(abs(values), floor)), which is finite where the curvature is zero."""
    return np.log(np.maximum(np.abs(values), floor))
