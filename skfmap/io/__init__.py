"""Reading and writing of meshes and landmarks."""

from skfmap.io.formats import MESH_SUFFIXES, READ_SUFFIXES, WRITTEN_SUFFIXES, unread_formats
from skfmap.io.landmarks import (
    LANDMARK_SUFFIXES,
    WRITTEN_LANDMARK_SUFFIXES,
    read_landmarks,
    write_landmarks,
)
from skfmap.io.meshes import MeshLike as MeshLike
from skfmap.io.meshes import (
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
from skfmap.io.obj import read_uv

__all__ = [
    "LANDMARK_SUFFIXES",
    "MESH_SUFFIXES",
    "READ_SUFFIXES",
    "WRITTEN_LANDMARK_SUFFIXES",
    "WRITTEN_SUFFIXES",
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
    "read_uv",
    "unread_formats",
    "write_landmarks",
    "write_mesh",
]
