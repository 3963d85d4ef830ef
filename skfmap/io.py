"""Reading and writing meshes, vertex order kept. Trimesh is imported when a file is read or written, not before."""

import io
import logging
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import check_place, check_samples, has_place, label
from skfmap.exceptions import MeshError
from skfmap.geometry.faults import sound_faces
from skfmap.shapes import Mesh, SkippedShape

__all__ = [
    "MESH_SUFFIXES",
    "as_far_as_sound",
    "as_mesh",
    "as_meshes",
    "check_meshes",
    "n_vertices_of",
    "named",
    "read_arrays",
    "read_mesh",
    "write_mesh",
]

MESH_SUFFIXES = (".off", ".obj", ".ply", ".stl")

# What single precision may lose of the size of a mesh.
_MOST_LOST = 1e-4

# Materials and texture would split an OBJ file into parts with vertices of their own.
_READ_OPTIONS: dict[str, dict[str, bool]] = {
    ".obj": {"maintain_order": True, "group_material": False, "skip_materials": True}
}


_MARK = b"\xef\xbb\xbf"  # of the order of bytes, which editors put in front of texts

# OBJ files: lines that go on; what follows a vertex there, and those that name vertex 0.
_CONTINUED = re.compile(rb"\\\r?\n")
_AFTER_SLASH = re.compile(rb"/[^\s]*")
_ZERO_INDEX = re.compile(rb"^[ \t]*f[ \t]+(?:[^\n]*[ \t])?0+(?=\s|$)[^\n]*", re.MULTILINE)


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
    return Mesh(*read_arrays(path), name=Path(path).stem)


def read_arrays(path: str | Path) -> tuple[FloatArray, IntArray]:
    """Return the vertices and faces of a file as `read_mesh` reads them, be they a sound mesh or not."""
    if not isinstance(path, (str, Path)):
        raise TypeError(f"A mesh is read from a path; got {path!r}.")
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise MeshError(f"{path} has the suffix {suffix!r}; skfmap reads {', '.join(MESH_SUFFIXES)}.")
    if not path.is_file():
        raise FileNotFoundError(f"There is no mesh file {path}.")
    import trimesh  # noqa: PLC0415

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # it writes tracebacks where nobody listens
    content = path.read_bytes().removeprefix(_MARK)
    if suffix == ".off":
        content = _without_comments(content)
    if suffix == ".obj":
        content = _plain_obj(content)
    try:
        loaded = trimesh.load(
            io.BytesIO(content), file_type=suffix[1:], process=False, force="mesh", **_READ_OPTIONS.get(suffix, {})
        )
        vertices, faces = np.asarray(loaded.vertices), np.asarray(loaded.faces)
    except Exception as error:
        said = str(error).rstrip(".")
        raise MeshError(
            f"{path} cannot be read as a triangle mesh; is it whole, and of the format that its name says? The reader "
            f"says: {type(error).__name__}: {said}."
        ) from error
    if suffix == ".stl":
        vertices, faces = _weld(vertices, faces)
    stored = _stored_counts(content, suffix)
    _check_counts(path, stored, len(vertices), len(faces))
    _check_face_lines(path, content, suffix, stored)
    return vertices, faces.reshape(-1, 3) if faces.size == 0 else faces


def as_far_as_sound(vertices: FloatArray, faces: IntArray, name: str) -> tuple[Mesh, str]:
    """Return a mesh of the faces that are sound, and what was done; vertices keep their numbers.

    Those without a place belong to no face then, and are put to the centre of the others.
    """
    placed, sound = has_place(vertices), sound_faces(vertices, faces)
    n_faces, n_vertices = int((~sound).sum()), int((~placed).sum())
    if not (n_faces or n_vertices):
        return Mesh(vertices, faces, name), ""
    if not sound.any():
        raise MeshError(f"Nothing is left of {label(name)}: no face names three vertices with a place. Leave it out.")
    points = np.where(placed[:, None], vertices, vertices[placed].mean(axis=0))
    what = "were no triangles, led nowhere or had vertices without a place"
    done = f"left out {n_faces} faces that {what} ({n_vertices} vertices with NaN or infinite coordinates)"
    return Mesh(points, faces[sound], name), done


def write_mesh(mesh: Mesh, path: str | Path) -> None:
    """Write a mesh; the suffix of ``path`` chooses the format.

    OFF and OBJ keep sixteen digits of the size of the mesh, whatever its unit. PLY and STL hold single precision, some
    seven digits of the distance from the origin. STL loses the numbering.

    Parameters
    ----------
    mesh : Mesh
        The mesh.
    path : str or Path
        File to write: .off, .obj, .ply or .stl.

    Raises
    ------
    ValueError
        If the suffix is another, or if single precision cannot hold the mesh.
    FileNotFoundError
        If there is no such folder.
    TypeError
        If it is no `Mesh`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.io import read_mesh, write_mesh
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "ball.off"
    >>> write_mesh(make_sphere(n_subdivisions=1), path)
    >>> read_mesh(path)
    Mesh('ball', n_vertices=18, n_faces=32)
    """
    if not isinstance(mesh, Mesh):
        raise TypeError(f"A skfmap.Mesh is written; got {type(mesh).__name__}.")
    suffix = Path(path).suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise ValueError(f"{path} has the suffix {suffix!r}; skfmap writes {', '.join(MESH_SUFFIXES)}.")
    check_place(path)
    import trimesh  # noqa: PLC0415

    if suffix in (".ply", ".stl"):
        _check_single_precision(mesh, path)
        options = {}
    else:
        # The writer has a fixed number of decimals, not of digits.
        largest = float(np.abs(mesh.vertices).max())
        options = {"digits": max(0, 16 - math.floor(math.log10(largest))) if largest > 0 else 0}
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path, **options)


def _check_single_precision(mesh: Mesh, path: str | Path) -> None:
    with np.errstate(all="ignore"):
        lost = np.abs(mesh.vertices.astype(np.float32).astype(np.float64) - mesh.vertices).max()
    if not lost <= _MOST_LOST * np.ptp(mesh.vertices, axis=0).max():
        raise ValueError(
            f"{path} would hold {mesh!r} in single precision, which loses its shape: it is too large, too small, or "
            "too far from the origin for its size. Write it as OFF, or move and scale it."
        )


def as_mesh(item: Any, position: int | None = None) -> Mesh:
    """Return a `Mesh` for whatever a user holds: a Mesh, a trimesh.Trimesh, a (vertices, faces) pair, or a path."""
    if isinstance(item, Mesh):
        return item
    if isinstance(item, (str, Path)):
        return read_mesh(item)
    if isinstance(item, SkippedShape):
        place = "" if position is None else f"X[{position}], "
        raise MeshError(
            f"{place}{label(item.name, 'shape')} was left out before: {item.reason} Leave it out here too; "
            "SpectralBasis(on_invalid='skip'), or 'repair', passes it on."
        )
    name = None if position is None else f"shape {position}"
    if _is_trimesh(item):
        return Mesh(item.vertices, item.faces, name=(item.metadata or {}).get("name") or name)
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
    name = (item.metadata or {}).get("name") if _is_trimesh(item) else None
    return name or f"shape {position}"


def n_vertices_of(item: Any) -> int:
    """Return how many vertices something has that is no sound mesh; 0 where that cannot be told."""
    if isinstance(item, SkippedShape):
        return item.n_vertices
    if isinstance(item, (str, Path)):
        try:
            return len(read_arrays(item)[0])
        except (MeshError, OSError):
            return 0
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


def _plain_obj(content: bytes) -> bytes:
    """Return the vertices and faces of an OBJ file alone, in a form that the reader does not misread.

    It stumbles over comments behind numbers and over corners that differ in form (``f 1//1 2/2 3``), and takes relative
    numbers (-1 is the last vertex so far) for counted from the end of the file.
    """
    lines, n_vertices = [], 0
    for line in _CONTINUED.sub(b" ", content).splitlines():
        words = line.split(b"#", maxsplit=1)[0].split()
        if words[:1] == [b"v"]:
            n_vertices += 1
        elif words[:1] == [b"f"]:
            words = [_AFTER_SLASH.sub(b"", word) for word in words]
            words[1:] = [_absolute(word, n_vertices) for word in words[1:]]
        else:
            continue
        lines.append(b" ".join(words))
    return b"\n".join(lines) + b"\n"


def _absolute(word: bytes, n_vertices: int) -> bytes:
    """Return the number of a vertex, counted from 1, where it was counted back from the last one so far."""
    if not (word.startswith(b"-") and word[1:].isdigit()):
        return word
    back = int(word[1:])
    return b"%d" % max(0, n_vertices + 1 - back if back else 0)  # 0 is refused later


def _check_counts(path: Path, stored: tuple[int, int] | None, n_vertices: int, n_faces: int) -> None:
    if stored is None:
        return
    if stored[1] == n_faces == 0:
        raise MeshError(
            f"{path} holds {stored[0]} vertices and no faces: a cloud of points, or a file that was cut short."
        )
    if stored[0] != n_vertices:
        raise MeshError(
            f"{path} stores {stored[0]} vertices, but {n_vertices} were read, so that correspondences would point at "
            "the wrong ones. Export it again with positions and triangles only, for instance as OFF."
        )
    if n_faces < stored[1]:
        raise MeshError(f"{path} says that it holds {stored[1]} faces, but {n_faces} were read; the file is truncated.")


def _check_face_lines(path: Path, content: bytes, suffix: str, stored: tuple[int, int] | None) -> None:
    """Raise where a face does not say what it should, which the reader takes for another face without a word."""
    if suffix == ".obj" and (zero := _ZERO_INDEX.search(content)):
        raise MeshError(f"{path} has a face with vertex 0 ({zero[0].strip()[:60]!r}); OBJ files count from 1.")
    if suffix == ".off" and _has_more_lines(content, stored):
        raise MeshError(f"{path} says that it holds {stored[1] if stored else 0} faces, but more lines follow.")
    for line in _lines_of_faces(content, suffix, stored):
        numbers = line.split()
        if not numbers or not numbers[0].isdigit():
            continue
        corners = numbers[1 : 1 + int(numbers[0])]
        if len(corners) < int(numbers[0]):
            raise MeshError(f"{path} has a face that is cut short: {line[:60]!r} says {int(numbers[0])} vertices.")
        if not all(corner.lstrip(b"+-").isdigit() for corner in corners):
            raise MeshError(f"{path} has a face whose vertices are no whole numbers: {line[:60]!r}.")


def _has_more_lines(content: bytes, stored: tuple[int, int] | None) -> bool:
    """Return whether an OFF file with a line for each vertex and face has more lines than it says."""
    if stored is None:
        return False
    lines = content.splitlines()
    head = 1 if len(lines[0].split()) > 1 else 2
    body = lines[head:]
    one_each = all(len(line.split()) >= 3 for line in body[: sum(stored)])
    return len(body) > sum(stored) and one_each


def _lines_of_faces(content: bytes, suffix: str, stored: tuple[int, int] | None) -> list[bytes]:
    """Return the lines of a text file that begin with the number of vertices of a face, as far as that is plain."""
    if stored is None or suffix not in (".off", ".ply"):
        return []
    if suffix == ".off":
        lines = content.splitlines()
        return lines[-stored[1] :] if 1 <= len(lines) - sum(stored) <= 2 and stored[1] else []
    head, _, body = content.partition(b"end_header")
    elements = re.findall(rb"^element (\w+)", head, re.MULTILINE)
    list_first = re.search(rb"^element face \d+\s+property list", head, re.MULTILINE)
    if b"format ascii" not in head or elements != [b"vertex", b"face"] or not list_first:
        return []
    lines = [line for line in body.splitlines() if line.strip()]
    return lines[stored[0] : sum(stored)]


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
