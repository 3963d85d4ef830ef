"""Reading and writing meshes, vertex order kept. Trimesh is imported when a file is read or written, not before."""

import io
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skfmap._typing import FloatArray, IntArray
from skfmap._validation import check_samples
from skfmap.exceptions import MeshError
from skfmap.shapes import Mesh, SkippedShape

__all__ = [
    "MESH_SUFFIXES",
    "as_mesh",
    "as_meshes",
    "check_meshes",
    "n_vertices_of",
    "named",
    "read_mesh",
    "write_mesh",
]

MESH_SUFFIXES = (".off", ".obj", ".ply", ".stl")

# Materials and texture would split an OBJ file into parts with vertices of their own.
_READ_OPTIONS: dict[str, dict[str, bool]] = {
    ".obj": {"maintain_order": True, "group_material": False, "skip_materials": True}
}


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
    import trimesh  # noqa: PLC0415

    content = path.read_bytes()
    if suffix == ".off":
        content = _without_comments(content)
    try:
        loaded = trimesh.load(
            io.BytesIO(content), file_type=suffix[1:], process=False, force="mesh", **_READ_OPTIONS.get(suffix, {})
        )
        vertices, faces = np.asarray(loaded.vertices), np.asarray(loaded.faces)
    except Exception as error:
        raise MeshError(f"{path} cannot be read as a triangle mesh: {type(error).__name__}: {error}.") from error
    if suffix == ".stl":
        vertices, faces = _weld(vertices, faces)
    _check_counts(path, _stored_counts(content, suffix), len(vertices), len(faces))
    return Mesh(vertices, faces, name=path.stem)


def write_mesh(mesh: Mesh, path: str | Path) -> None:
    """Write a mesh; the suffix of ``path`` (.off, .obj, .ply, .stl) chooses the format. STL loses the numbering."""
    suffix = Path(path).suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise ValueError(f"{path} has the suffix {suffix!r}; skfmap writes {', '.join(MESH_SUFFIXES)}.")
    import trimesh  # noqa: PLC0415

    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)


def as_mesh(item: Any, position: int | None = None) -> Mesh:
    """Return a `Mesh` for whatever a user holds: a Mesh, a trimesh.Trimesh, a (vertices, faces) pair, or a path."""
    if isinstance(item, Mesh):
        return item
    if isinstance(item, (str, Path)):
        return read_mesh(item)
    if isinstance(item, SkippedShape):
        raise MeshError(item.reason)
    name = None if position is None else f"shape {position}"
    if _is_trimesh(item):
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
    return [as_mesh(item, i) for i, item in enumerate(check_meshes(X))]


def check_meshes(X: Any) -> list[Any]:
    """Return the items of ``X``, whatever they are; one bare mesh, (vertices, faces) pair or path is a TypeError."""
    if isinstance(X, (Mesh, str, Path)) or _is_trimesh(X) or _is_bare_pair(X):
        raise TypeError(
            f"X must be a sequence of meshes, but it is one mesh ({type(X).__name__}); wrap it in a list: [X]."
        )
    return list(check_samples(X, "meshes"))


def named(item: Any, position: int) -> str | None:
    """Return the name that `as_mesh` gives, without looking at the mesh."""
    if isinstance(item, (str, Path)):
        return Path(item).stem
    if isinstance(item, (Mesh, SkippedShape)):
        return item.name
    name = item.metadata.get("name") if _is_trimesh(item) else None
    return name or f"shape {position}"


def n_vertices_of(item: Any) -> int:
    """Return how many vertices something has that is no sound mesh; 0 where that cannot be told."""
    if isinstance(item, SkippedShape):
        return item.n_vertices
    vertices = item[0] if isinstance(item, (tuple, list)) else getattr(item, "vertices", ())
    return len(vertices) if hasattr(vertices, "__len__") else 0


def _is_trimesh(item: Any) -> bool:
    """Tell a trimesh.Trimesh without importing trimesh, which takes a while: whoever has one has imported it."""
    trimesh = sys.modules.get("trimesh")
    return trimesh is not None and isinstance(item, trimesh.Trimesh)


def _is_bare_pair(X: Any) -> bool:
    """Tell (vertices, faces) from a sequence of two meshes: its second item is a table of whole numbers."""
    if not isinstance(X, Sequence) or isinstance(X, (str, bytes)) or len(X) != 2:
        return False
    if isinstance(X[0], (Mesh, str, Path)) or _is_trimesh(X[0]):
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


def _without_comments(content: bytes) -> bytes:
    """Return an OFF file without its comments, which the reader takes for data in places."""
    lines = (line.split(b"#", maxsplit=1)[0].strip() for line in content.splitlines())
    return b"\n".join(line for line in lines if line) + b"\n"


def _check_counts(path: Path, stored: tuple[int, int] | None, n_vertices: int, n_faces: int) -> None:
    if stored is None:
        return
    if stored[0] != n_vertices:
        raise MeshError(
            f"{path} stores {stored[0]} vertices, but {n_vertices} were read, so that correspondences would point at "
            "the wrong ones. Export it again with positions and triangles only, for instance as OFF."
        )
    if n_faces < stored[1]:
        raise MeshError(f"{path} says that it holds {stored[1]} faces, but {n_faces} were read; the file is truncated.")


def _stored_counts(content: bytes, suffix: str) -> tuple[int, int] | None:
    """Return how many vertices and faces a file says it holds, or None where it does not say."""
    if suffix == ".stl":
        return None
    if suffix == ".obj":
        return _count_lines(content, b"v"), _count_lines(content, b"f")
    if suffix == ".ply":
        head = content[:65536]
        vertices, faces = (re.search(rb"^element %s (\d+)" % kind, head, re.MULTILINE) for kind in (b"vertex", b"face"))
        return (int(vertices[1]), int(faces[1])) if vertices and faces else None
    numbers = content.lstrip().removeprefix(b"OFF").split(maxsplit=2)[:2]
    return (int(numbers[0]), int(numbers[1])) if len(numbers) == 2 and b"".join(numbers).isdigit() else None


def _count_lines(content: bytes, keyword: bytes) -> int:
    return len(re.findall(rb"^[ \t]*%s[ \t]" % keyword, content, re.MULTILINE))
