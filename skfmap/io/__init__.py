"""Reading and writing meshes and landmarks."""

from skfmap.io.landmarks import read_landmarks, write_landmarks
from skfmap.io.meshes import (
    MESH_SUFFIXES,
    READ_SUFFIXES,
    as_arrays,
    as_far_as_sound,
    as_mesh,
    as_meshes,
    check_meshes,
    n_vertices_of,
    named,
    open_given,
    read_arrays,
    read_mesh,
    write_mesh,
)
from skfmap.io.meshes import MeshLike as MeshLike

__all__ = [
    "MESH_SUFFIXES",
    "READ_SUFFIXES",
    "as_arrays",
    "as_far_as_sound",
    "as_mesh",
    "as_meshes",
    "check_meshes",
    "n_vertices_of",
    "named",
    "open_given",
    "read_arrays",
    "read_landmarks",
    "read_mesh",
    "write_landmarks",
    "write_mesh",
]
