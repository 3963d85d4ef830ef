"""Vertex normals."""

import igl
import numpy as np

from skfmap._tools.types import FloatArray, IntArray

__all__ = ["vertex_normals"]


def vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return unit normals at vertices: area-weighted means over faces, shape (n_vertices, 3).

    They are zero where faces have no area, or cancel each other.
    """
    return np.nan_to_num(
        igl.per_vertex_normals(vertices, faces, igl.PER_VERTEX_NORMALS_WEIGHTING_TYPE_AREA)
    )
