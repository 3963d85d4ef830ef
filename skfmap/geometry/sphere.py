"""A sphere, whose eigenvalues and curvatures are known in closed form."""

import igl
import numpy as np

from skfmap._tools.types import FloatArray, IntArray

__all__ = ["subdivided_octahedron"]


def subdivided_octahedron(n_subdivisions: int) -> tuple[FloatArray, IntArray]:
    """Return a unit sphere with 4^(n + 1) + 2 vertices, and faces wound outwards."""
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array(
        [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    )
    for _ in range(n_subdivisions):
        vertices, faces = igl.upsample(vertices, faces)
        vertices = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    return np.asarray(vertices), np.asarray(faces, dtype=np.int64)
