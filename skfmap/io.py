"""Reading and writing meshes, vertex order kept."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from skfmap._typing import FloatArray, IntArray
from skfmap._validation import check_samples
from skfmap.exceptions import MeshError
from skfmap.shapes import Mesh

__all__ = ["MESH_SUFFIXES", "as_mesh", "as_meshes", "read_mesh", "write_mesh"]

MESH_SUFFIXES = (".off", ".obj", ".ply", ".stl")


def read_mesh(path: str | Path) -> Mesh:
    """Read an OFF, OBJ, PLY or STL file; vertices keep their number and their order.

    STL files have no vertex numbers: there, corners at exactly one position become one vertex, numbered by first
    appearance.

    Parameters
    ----------
    path : str or Path
        File to read. Its stem becomes the name of the mesh.

    Returns
    -------
    Mesh
        The mesh as stored.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    MeshError
        If the file cannot be read as a triangle mesh, or the reader lost or added vertices.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise MeshError(f"{path} has the suffix {suffix!r}; skfmap reads {', '.join(MESH_SUFFIXES)}.")
    if not path.is_file():
        raise FileNotFoundError(f"There is no mesh file {path}.")
    try:
        loaded = trimesh.load(path, process=False, maintain_order=True, force="mesh")
        vertices, faces = np.asarray(loaded.vertices), np.asarray(loaded.faces)
    except Exception as error:
        raise MeshError(f"{path} cannot be read as a triangle mesh: {type(error).__name__}: {error}.") from error
    if suffix == ".stl":
        vertices, faces = _weld(vertices, faces)
    stored = _stored_count(path, suffix)
    if stored is not None and stored != len(vertices):
        raise MeshError(
            f"{path} stores {stored} vertices, but {len(vertices)} were read, so that correspondences would point at "
            "the wrong ones. Remove texture coordinates and normals, or save it as OFF."
        )
    return Mesh(vertices, faces, name=path.stem)


def write_mesh(mesh: Mesh, path: str | Path) -> None:
    """Write a mesh; the suffix of ``path`` (.off, .obj, .ply, .stl) chooses the format. STL loses the numbering."""
    suffix = Path(path).suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise ValueError(f"{path} has the suffix {suffix!r}; skfmap writes {', '.join(MESH_SUFFIXES)}.")
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)


def as_mesh(item: Any, position: int | None = None) -> Mesh:
    """Return a `Mesh` for whatever a user holds: a Mesh, a trimesh.Trimesh, a (vertices, faces) pair, or a path."""
    if isinstance(item, Mesh):
        return item
    if isinstance(item, (str, Path)):
        return read_mesh(item)
    name = None if position is None else f"shape {position}"
    if isinstance(item, trimesh.Trimesh):
        return Mesh(item.vertices, item.faces, name=item.metadata.get("name") or name)
    if isinstance(item, (tuple, list)) and len(item) == 2:
        return Mesh(item[0], item[1], name=name)
    where = "" if position is None else f"X[{position}] is "
    raise TypeError(
        f"{where}a {type(item).__name__}; a mesh is a skfmap.Mesh, a trimesh.Trimesh, a (vertices, faces) pair or "
        "a path."
    )


def as_meshes(X: Any) -> list[Mesh]:
    """Return the meshes of ``X``; one bare mesh, (vertices, faces) pair or path is a TypeError."""
    if isinstance(X, (Mesh, trimesh.Trimesh, str, Path)) or _is_bare_pair(X):
        raise TypeError(
            f"X must be a sequence of meshes, but it is one mesh ({type(X).__name__}); wrap it in a list: [X]."
        )
    return [as_mesh(item, i) for i, item in enumerate(check_samples(X, "meshes"))]


def _is_bare_pair(X: Any) -> bool:
    """Tell (vertices, faces) from a sequence of two meshes: its second item is a table of whole numbers."""
    if not isinstance(X, Sequence) or isinstance(X, (str, bytes)) or len(X) != 2:
        return False
    if isinstance(X[0], (Mesh, trimesh.Trimesh, str, Path)):
        return False
    try:
        faces = np.asarray(X[1])
    except ValueError:
        return False
    return faces.ndim == 2 and faces.shape[1] == 3 and np.issubdtype(faces.dtype, np.integer)


def _weld(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return vertices[np.sort(first)], rank[inverse.ravel()][faces]


def _stored_count(path: Path, suffix: str) -> int | None:
    """Return how many vertices the file says it holds, or None where it does not say."""
    if suffix == ".stl":
        return None
    text = path.read_bytes()
    if suffix == ".obj":
        return len(re.findall(rb"^[ \t]*v[ \t]", text, flags=re.MULTILINE))
    if suffix == ".ply":
        found = re.search(rb"^element vertex (\d+)", text[:65536], flags=re.MULTILINE)
        return int(found[1]) if found else None
    lines = (line.split(b"#")[0].strip() for line in text[:65536].splitlines())
    numbers = [line.removeprefix(b"OFF").strip() for line in lines if line.removeprefix(b"OFF").strip()]
    head = numbers[0].split()[0] if numbers else b""
    return int(head) if head.isdigit() else None
