"""Gaussian and mean curvature at vertices."""

import igl
import numpy as np

from skfmap._typing import FloatArray, IntArray, SparseMatrix
from skfmap.geometry.faults import boundary_vertices, degenerate_faces
from skfmap.geometry.normals import vertex_normals

__all__ = ["clip_by_area", "gaussian_curvature", "log_magnitude", "mean_curvature"]


def gaussian_curvature(vertices: FloatArray, faces: IntArray, mass: FloatArray) -> FloatArray:
    """Return the angle defect over the area of each vertex, shape (n_vertices,).

    It is 0 on the boundary, where there is none, and at faces without area, whose angles are unknown. By the theorem of
    Gauss and Bonnet its integral over a sound closed surface is 2 pi times the Euler characteristic.
    """
    flat = degenerate_faces(vertices, faces)
    defect = np.asarray(igl.gaussian_curvature(vertices, np.delete(faces, flat, axis=0)))
    defect[faces[flat]] = 0.0
    defect[boundary_vertices(faces, len(vertices))] = 0.0
    return defect / mass


def mean_curvature(vertices: FloatArray, faces: IntArray, stiffness: SparseMatrix, mass: FloatArray) -> FloatArray:
    """Return half the normal part of the Laplacian of the position, shape (n_vertices,); 0 on the boundary.

    Positive where the surface is convex (1 / r on a sphere of radius r), given faces wound outwards.
    """
    laplacian = (stiffness @ vertices) / mass[:, None]
    normals = vertex_normals(vertices, faces)
    curvature = np.asarray((laplacian * normals).sum(axis=1) / 2)
    curvature[boundary_vertices(faces, len(vertices))] = 0.0
    return curvature


def clip_by_area(values: FloatArray, mass: FloatArray, percentile: float) -> FloatArray:
    """Clip a function to its area-weighted percentiles ``percentile`` and ``100 - percentile``.

    Weighting by area keeps a patch of small triangles from deciding what is extreme.
    """
    order = np.argsort(values, kind="stable")
    below = np.cumsum(mass[order]) - mass[order] / 2
    share = np.array([percentile, 100 - percentile]) / 100 * mass.sum()
    low, high = np.interp(share, below, values[order])
    return np.asarray(np.clip(values, low, high))


def log_magnitude(values: FloatArray, floor: float) -> FloatArray:
    """Return log(max(abs(values), floor)): weight on flat areas, finite where the curvature is nil."""
    return np.log(np.maximum(np.abs(values), floor))
