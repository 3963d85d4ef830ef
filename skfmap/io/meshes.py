"""Reading and writing meshes; vertices keep their order.

Trimesh is imported when a file is read or written, not before.
"""

import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, TypeAlias, TypeGuard, cast

import numpy as np
import numpy.typing as npt

from skfmap._tools.caching import hash_of_arrays
from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import (
    as_array,
    as_reals,
    check_folder,
    check_samples,
    is_finite,
    label,
)
from skfmap._tools.warn import warn
from skfmap.exceptions import MeshError, RepairWarning
from skfmap.geometry.faults import sound_faces
from skfmap.geometry.polygons import triangulate
from skfmap.io.brains import FREESURFER_SUFFIXES, read_freesurfer, read_gifti
from skfmap.io.formats import READ_SUFFIXES, WRITTEN_SUFFIXES, remedy_for
from skfmap.io.gltf import read_gltf
from skfmap.io.obj import read_obj
from skfmap.io.off import read_off
from skfmap.io.ply import read_ply
from skfmap.io.stl import read_stl
from skfmap.io.vtk import read_vtk, read_vtp
from skfmap.io.vtk_written import vtk_of, vtp_of
from skfmap.shapes import GivenMesh, Mesh, Registered, SkippedShape

__all__ = [
    "as_arrays",
    "as_far_as_sound",
    "as_mesh",
    "as_meshes",
    "check_meshes",
    "check_single_precision",
    "n_vertices_of",
    "named",
    "open_given",
    "read_arrays",
    "read_mesh",
    "write_mesh",
]

# What single precision may lose of the extent of a mesh: about a hundredth of a mean edge of 5,000
# vertices. Its seven digits do so where a mesh is 1,700 times its extent away from the origin.
_MOST_LOST = 1e-4

# What files of any name may be, by how they begin.
_NO_MESHES = {
    b"\x1f\x8b": "packed (gzip). Unpack it first.",
    b"pk\x03\x04": "packed (zip). Unpack it first.",
    b"bzh": "packed (bzip2). Unpack it first.",
    b"\xfd7zxz": "packed (xz). Unpack it first.",
    b"version https://git-lfs": "a pointer of Git LFS in place of the mesh. Run git lfs pull.",
    b"<!doctype html": "a page of the web. Download the file itself.",
    b"<html": "a page of the web. Download the file itself.",
}
_HEAD = 64

_OWN_READERS = {
    ".off": read_off,
    ".obj": read_obj,
    ".ply": read_ply,
    ".vtk": read_vtk,
    ".vtp": read_vtp,
    ".gii": read_gifti,
    **dict.fromkeys(FREESURFER_SUFFIXES, read_freesurfer),
}


class TrimeshLike(Protocol):
    """What is read of a trimesh.Trimesh."""

    @property
    def vertices(self) -> FloatArray:
        """Coordinates."""

    @property
    def faces(self) -> IntArray:
        """Triangles."""

    @property
    def metadata(self) -> dict[str, Any] | None:
        """May hold a name."""


MeshLike: TypeAlias = Mesh | SkippedShape | TrimeshLike | Sequence[npt.ArrayLike] | str | Path
"""A mesh as users hold it, or one that was skipped; sequences are (vertices, faces) pairs."""


def read_mesh(path: str | Path) -> Mesh:
    """Read a mesh from a file; vertices keep their number and their order.

    OFF, OBJ, PLY, STL, GLB, GLTF, surfaces of VTK (.vtk, .vtp), and those of brains: GIFTI
    (.surf.gii), and FreeSurfer's (.pial, .white and others) in its surface coordinates.

    STL files have no vertex numbers: there, corners at exactly one position become one vertex,
    numbered by first appearance. Faces of more than three corners are cut into triangles that cover
    the same area, convex ones or not; texture coordinates and normals split no vertices. Text may
    be in UTF-16 with its byte order mark.

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

    Warns
    -----
    RepairWarning
        If polygons cross themselves, so that nobody knows what they cover. They are left out.
    """
    return Mesh(*read_arrays(path), name=Path(path).stem)


def read_arrays(path: str | Path) -> tuple[FloatArray, IntArray]:
    """Return the vertices and faces of a file as stored, whether they are a sound mesh or not."""
    if not isinstance(path, (str, Path)):
        raise TypeError(f"A mesh is read from a path; got {path!r}.")
    path = Path(path)
    content, suffix = _content_of(path), path.suffix.lower()
    try:
        if suffix in _OWN_READERS:
            vertices, polygons = _OWN_READERS[suffix](content)
            if (polygons.counts < 0).any() or polygons.counts.sum() != len(polygons.corners):
                raise MeshError("has faces whose numbers of corners do not add up: it is damaged.")
            faces, crossing = triangulate(vertices, *polygons)
        else:
            # glTF may keep its numbers in files beside it.
            vertices, faces = read_stl(content) if suffix == ".stl" else read_gltf(path, content)
            crossing = faces[:0, 0]
    except MeshError as error:
        raise MeshError(f"{path} cannot be read: it {error}") from None
    except Exception as error:
        said = str(error).rstrip(".")
        raise MeshError(
            f"{path} cannot be read: it is damaged, or not of the format that its name says "
            f"({type(error).__name__}: {said})."
        ) from error
    if len(crossing):
        warn(
            f"{path} has {len(crossing)} faces that cross themselves, the first is face "
            f"{crossing[0]}. What they cover cannot be known, and they are left out; cut them into "
            "triangles before saving.",
            RepairWarning,
        )
    return np.asarray(vertices, dtype=np.float64), faces.astype(np.int64)


def _content_of(path: Path) -> bytes:
    """Return the bytes of a mesh file; raise where it is none, by its name or by how it begins."""
    suffix = path.suffix.lower()
    if suffix not in READ_SUFFIXES:
        if (bare := str(path).strip("\"' \t\r\n")) != str(path):
            raise MeshError(f"{str(path)!r} has blanks or quotes around it; give {bare!r}.")
        raise MeshError(
            f"{path} has the suffix {suffix!r}; skfmap reads {', '.join(READ_SUFFIXES)}."
            f"{remedy_for(suffix)}"
        )
    if not path.is_file():
        at_home = os.path.expanduser(path)  # which raises nothing for a user that is unknown
        remedy = f" Write {at_home}." if at_home != str(path) else ""
        raise FileNotFoundError(f"There is no mesh file {path}.{remedy}")
    content = path.read_bytes()
    if not content.strip():
        raise MeshError(f"{path} is empty. Export the mesh again, or remove the file.")
    for begin, what in _NO_MESHES.items():
        if content[:_HEAD].lstrip().lower().startswith(begin):
            raise MeshError(f"{path} cannot be read: it is {what}")
    return content


def as_far_as_sound(vertices: FloatArray, faces: IntArray, name: str) -> tuple[Mesh, str]:
    """Return a mesh of the faces that are sound, and what was done; vertices keep their numbers.

    Vertices without finite coordinates belong to no face then, and move to the centre of the rest.
    """
    finite, sound = is_finite(vertices), sound_faces(vertices, faces)
    n_faces, n_vertices = int((~sound).sum()), int((~finite).sum())
    if not (n_faces or n_vertices):
        return Mesh(vertices, faces, name), ""
    if not sound.any():
        raise MeshError(
            f"Nothing is left of {label(name)}: no face names three vertices with finite "
            "coordinates. Leave it out."
        )
    points = np.where(finite[:, None], vertices, vertices[finite].mean(axis=0))
    done = (
        f"left out {n_faces} faces that were not triangles, led nowhere or had unusable vertices "
        f"({n_vertices} vertices with NaN or infinite coordinates)"
    )
    return Mesh(points, faces[sound], name), done


def write_mesh(mesh: Mesh | Registered, path: str | Path) -> None:
    """Write a mesh; the suffix of ``path`` chooses the format.

    OFF and OBJ keep sixteen digits of the largest coordinate, whatever its unit, VTK and VTP all.
    PLY, STL and GLB hold single precision, some seven digits. STL loses the numbering.

    Parameters
    ----------
    mesh : Mesh or Registered
        The mesh, or one of those that `skfmap.register` returns. Vertices and faces are written,
        and nothing else: no colours, no texture coordinates.
    path : str or Path
        File to write: .off, .obj, .ply, .stl, .glb, .vtk or .vtp.

    Raises
    ------
    ValueError
        If the suffix is another, or if single precision cannot hold the mesh.
    FileNotFoundError
        If there is no such folder.
    TypeError
        If it is neither.
    MeshError
        If the shape of a `Registered` was left out, so that there is no mesh.

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
    if isinstance(mesh, Registered):
        mesh = mesh.mesh
    if not isinstance(mesh, Mesh):
        remedies = {list: " Write those of a list one by one.", tuple: " Mesh(*pair) makes one."}
        raise TypeError(
            "write_mesh takes one skfmap.Mesh, or one of what skfmap.register returns; got "
            f"{type(mesh).__name__}.{remedies.get(type(mesh), '')}"
        )
    suffix = Path(path).suffix.lower()
    if suffix not in WRITTEN_SUFFIXES:
        raise ValueError(
            f"{path} has the suffix {suffix!r}; skfmap writes {', '.join(WRITTEN_SUFFIXES)}."
        )
    check_folder(path)
    if suffix in (".vtk", ".vtp"):
        content = (vtk_of if suffix == ".vtk" else vtp_of)(mesh.vertices, mesh.faces, {})
        Path(path).write_bytes(content)
        return
    import trimesh  # noqa: PLC0415

    if suffix in (".ply", ".stl", ".glb"):
        check_single_precision(mesh, path)
        options = {}
    else:
        # The writer takes a number of decimals, not of digits, of which a float has sixteen.
        largest = float(np.abs(mesh.vertices).max())
        options = {"digits": max(0, 16 - math.floor(math.log10(largest))) if largest > 0 else 0}
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path, **options)


def check_single_precision(mesh: Mesh, path: str | Path) -> None:
    """Raise a ValueError if single precision cannot hold a mesh that is to be written."""
    with np.errstate(all="ignore"):
        lost = np.abs(mesh.vertices.astype(np.float32).astype(np.float64) - mesh.vertices).max()
    if not lost <= _MOST_LOST * np.ptp(mesh.vertices, axis=0).max():
        raise ValueError(
            f"{path} would hold {mesh!r} in single precision, which loses its shape: it is too "
            "large, too small, or too far from the origin for its size. Write it as OFF, or move "
            "and scale it."
        )


def as_mesh(item: MeshLike, index: int | None = None) -> Mesh:
    """Return a `Mesh` for a Mesh, a trimesh.Trimesh, a (vertices, faces) pair or a path."""
    if isinstance(item, Mesh):
        return item
    if isinstance(item, (str, Path)):
        return read_mesh(item)
    if isinstance(item, SkippedShape):
        where = "" if index is None else f"X[{index}], "
        raise MeshError(
            f"{where}{label(item.name, 'shape')} was left out before: {item.reason} Leave it out "
            "here too; SpectralBasis(on_invalid='skip') passes it on."
        )
    name = None if index is None else f"shape {index}"
    if _is_trimesh(item):
        return Mesh(item.vertices, item.faces, name=(item.metadata or {}).get("name") or name)
    if isinstance(item, (tuple, list)) and len(item) == 2:
        vertices, faces = cast("tuple[FloatArray, IntArray]", item)  # Mesh checks them
        return Mesh(vertices, faces, name=name)
    where = "" if index is None else f"X[{index}] is "
    remedy = " Give its .mesh." if hasattr(type(item), "mesh") else ""
    raise TypeError(
        f"{where}a {type(item).__name__}; a mesh is a skfmap.Mesh, a trimesh.Trimesh, a "
        f"(vertices, faces) pair or a path.{remedy}"
    )


def as_meshes(X: Sequence[MeshLike]) -> list[Mesh]:
    """Return the meshes of ``X``; raise for one bare mesh, (vertices, faces) pair or path."""
    return [as_mesh(item, i) for i, item in enumerate(check_meshes(X))]


def as_arrays(item: MeshLike, index: int | None = None) -> Mesh | tuple[FloatArray, IntArray]:
    """Return the vertices and faces of a mesh, sound or not; a `Mesh`, which is, as it is.

    What has no vertices and faces of the right kind at all is an error, as for `as_mesh`.
    """
    if isinstance(item, (Mesh, SkippedShape)):
        return as_mesh(item, index)
    who = label(None if index is None else named(item, index))
    if isinstance(item, (str, Path)):
        vertices, faces = read_arrays(item)
    elif _is_trimesh(item):
        vertices, faces = item.vertices, item.faces
    elif isinstance(item, (tuple, list)) and len(item) == 2:
        vertices, faces = cast("tuple[FloatArray, IntArray]", item)
    else:
        as_mesh(item, index)  # says what it is
    points = as_reals(vertices, f"The vertices of {who}", MeshError)
    triangles = as_array(faces, f"The faces of {who}", MeshError)
    points = points.reshape(0, 3) if points.size == 0 else points
    triangles = triangles.reshape(0, 3) if triangles.size == 0 else triangles
    if points.ndim != 2 or points.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise MeshError(
            f"{who} must have vertices of shape (n, 3) and triangles of shape (m, 3); got "
            f"{points.shape} and {triangles.shape}. Triangulate it first."
        )
    if triangles.size and not np.issubdtype(triangles.dtype, np.integer):
        raise MeshError(f"The faces of {who} must be integers; got dtype {triangles.dtype}.")
    return points, triangles.astype(np.int64)


def open_given(given: GivenMesh) -> Mesh | tuple[FloatArray, IntArray]:
    """Return the mesh that a shape came as; a MeshError where it is another by now, or gone."""
    if given.source is None:
        raise MeshError(
            f"The mesh that {label(given.name)} came as is not kept. Transform it again."
        )
    mesh = as_arrays(given.source)
    vertices, faces = (mesh.vertices, mesh.faces) if isinstance(mesh, Mesh) else mesh
    if hash_of_arrays(vertices, faces) != given.content_hash:
        raise MeshError(
            f"{label(given.name)} has changed since its basis was computed"
            + (f" ({given.source})" if isinstance(given.source, (str, Path)) else "")
            + ". Transform it again."
        )
    return mesh


def check_meshes(X: Sequence[MeshLike]) -> list[MeshLike]:
    """Return the items of ``X``; raise for one bare mesh, (vertices, faces) pair or path."""
    if isinstance(X, (Mesh, str, Path)) or _is_trimesh(X) or _is_bare_pair(X):
        raise TypeError(
            f"X must be a sequence of meshes; got one mesh ({type(X).__name__}). Wrap it in a "
            "list: [X]."
        )
    return list(check_samples(X, "meshes"))


def named(item: MeshLike, index: int) -> str | None:
    """Return the name that `as_mesh` gives, without looking at the mesh."""
    if isinstance(item, (str, Path)):
        return Path(item).stem
    if isinstance(item, (Mesh, SkippedShape)):
        return item.name
    name = (item.metadata or {}).get("name") if _is_trimesh(item) else None
    return name or f"shape {index}"


def n_vertices_of(item: MeshLike) -> int:
    """Return the number of vertices of a mesh, sound or not; 0 where it cannot be told."""
    if isinstance(item, SkippedShape):
        return item.n_vertices
    if isinstance(item, (str, Path)):
        try:
            return len(read_arrays(item)[0])
        except (MeshError, OSError):
            return 0
    if isinstance(item, (tuple, list)):
        vertices: Any = item[0] if len(item) == 2 else ()
    else:
        vertices = getattr(item, "vertices", ())
    return len(vertices) if hasattr(vertices, "__len__") else 0


def _is_trimesh(item: object) -> TypeGuard[TrimeshLike]:
    """Return whether this is a trimesh.Trimesh, without importing trimesh, which takes a while.

    Whoever has one has imported it.
    """
    trimesh = sys.modules.get("trimesh")
    return trimesh is not None and isinstance(item, trimesh.Trimesh)


def _is_bare_pair(X: object) -> bool:
    """Return whether this is (vertices, faces), the second a table of whole numbers."""
    if not isinstance(X, Sequence) or isinstance(X, (str, bytes)) or len(X) != 2:
        return False
    if isinstance(X[0], (Mesh, str, Path)) or _is_trimesh(X[0]):
        return False
    try:
        faces = np.asarray(X[1])
    except ValueError:
        return False
    return faces.ndim == 2 and faces.shape[1] == 3 and np.issubdtype(faces.dtype, np.integer)
