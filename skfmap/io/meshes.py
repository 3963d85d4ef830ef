"""Reading and writing of meshes; vertices keep their order.

Trimesh is only imported when it is needed.
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

# Largest rounding error in single precision, as a fraction of the extent of a mesh: about 1 % of
# the mean edge with 5,000 vertices. It is reached at 1,700 times the extent from the origin.
_MOST_LOST = 1e-4

# Contents that any file may have instead of a mesh, by their first bytes.
_NO_MESHES = {
    b"\x1f\x8b": "compressed (gzip). Unpack it first.",
    b"pk\x03\x04": "compressed (zip). Unpack it first.",
    b"bzh": "compressed (bzip2). Unpack it first.",
    b"\xfd7zxz": "compressed (xz). Unpack it first.",
    b"version https://git-lfs": "a Git LFS pointer instead of the mesh. Run git lfs pull.",
    b"<!doctype html": "a web page. Download the file itself.",
    b"<html": "a web page. Download the file itself.",
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
    """The attributes of a trimesh.Trimesh that are used."""

    @property
    def vertices(self) -> FloatArray:
        """Coordinates."""

    @property
    def faces(self) -> IntArray:
        """Triangles."""

    @property
    def metadata(self) -> dict[str, Any] | None:
        """Metadata, which may contain a name."""


MeshLike: TypeAlias = Mesh | SkippedShape | TrimeshLike | Sequence[npt.ArrayLike] | str | Path
"""Types accepted as a mesh, or a skipped shape; sequences are (vertices, faces) pairs."""


def read_mesh(path: str | Path) -> Mesh:
    """Read a mesh from a file; vertices keep their number and their order.

    Supported formats are OFF, OBJ, PLY, STL, GLB, GLTF, VTK surfaces (.vtk, .vtp), and brain
    surfaces: GIFTI (.surf.gii), and FreeSurfer (.pial, .white and others) in its surface
    coordinates.

    STL files store no shared vertices: corners at exactly the same position become one vertex,
    numbered by first occurrence. Faces with more than three corners, convex or not, are cut into
    triangles that cover the same area. Texture coordinates and normals do not split vertices. Text
    files may be in UTF-16 with a byte order mark.

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
        If the file does not exist.
    MeshError
        If the file cannot be read as a triangle mesh, or the reader lost or added vertices.

    Warns
    -----
    RepairWarning
        If faces are polygons that cross themselves. These have no defined interior and are left
        out.
    """
    return Mesh(*read_arrays(path), name=Path(path).stem)


def read_arrays(path: str | Path) -> tuple[FloatArray, IntArray]:
    """Return the vertices and faces of a file as stored, whether they are a sound mesh or not."""
    if not isinstance(path, (str, Path)):
        raise TypeError(f"path must be the path of a mesh file; got {path!r}.")
    path = Path(path)
    content, suffix = _content_of(path), path.suffix.lower()
    try:
        if suffix in _OWN_READERS:
            vertices, polygons = _OWN_READERS[suffix](content)
            if (polygons.counts < 0).any() or polygons.counts.sum() != len(polygons.corners):
                raise MeshError(
                    "has faces whose numbers of corners do not add up: the file is damaged."
                )
            faces, crossing = triangulate(vertices, *polygons)
        else:
            # A .gltf file may store its numbers in other files beside it.
            vertices, faces = read_stl(content) if suffix == ".stl" else read_gltf(path, content)
            crossing = faces[:0, 0]
    except MeshError as error:
        raise MeshError(f"{path} cannot be read: it {error}") from None
    except Exception as error:
        said = str(error).rstrip(".")
        raise MeshError(
            f"{path} cannot be read: it is damaged, or not in the format of its suffix "
            f"({type(error).__name__}: {said})."
        ) from error
    if len(crossing):
        warn(
            f"{path} has {len(crossing)} faces that cross themselves; the first is face "
            f"{crossing[0]}. They have no defined interior and are left out. To keep them, cut "
            "them into triangles before saving.",
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
    """Return a mesh with only the sound faces, and a description of what was done.

    Vertices keep their indices. Those without finite coordinates belong to no face; they are moved
    to the centre of the others.
    """
    finite, sound = is_finite(vertices), sound_faces(vertices, faces)
    n_faces, n_vertices = int((~sound).sum()), int((~finite).sum())
    if not (n_faces or n_vertices):
        return Mesh(vertices, faces, name), ""
    if not sound.any():
        raise MeshError(
            f"Nothing is left of {label(name)}: no face has three different vertices with "
            "finite coordinates. Leave it out."
        )
    points = np.where(finite[:, None], vertices, vertices[finite].mean(axis=0))
    done = (
        f"left out {n_faces} faces that were degenerate or had invalid indices or unusable "
        f"vertices ({n_vertices} vertices with NaN or infinite coordinates)"
    )
    return Mesh(points, faces[sound], name), done


def write_mesh(mesh: Mesh | Registered, path: str | Path) -> None:
    """Write a mesh to a file; the suffix of ``path`` selects the format.

    OFF and OBJ keep 16 digits of the largest coordinate, whatever its unit; VTK and VTP keep all
    digits. PLY, STL and GLB have single precision, about 7 digits. STL loses the order of the
    vertices.

    Parameters
    ----------
    mesh : Mesh or Registered
        A mesh, or an item returned by `skfmap.register`. Only vertices and faces are written, but
        no colours or texture coordinates.
    path : str or Path
        File to write: .off, .obj, .ply, .stl, .glb, .vtk or .vtp.

    Raises
    ------
    ValueError
        If the suffix is not supported, or single precision cannot represent the mesh.
    FileNotFoundError
        If the folder does not exist.
    TypeError
        If ``mesh`` has another type.
    MeshError
        If the shape of a `Registered` was skipped, so that there is no mesh.

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
        remedies = {
            list: " Write the meshes of a list one by one.",
            tuple: " Use Mesh(*pair) to make one.",
        }
        raise TypeError(
            "mesh must be a skfmap.Mesh, or an item returned by skfmap.register; got "
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
        # The writer takes a number of decimals; it is chosen to give 16 significant digits.
        largest = float(np.abs(mesh.vertices).max())
        options = {"digits": max(0, 16 - math.floor(math.log10(largest))) if largest > 0 else 0}
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path, **options)


def check_single_precision(mesh: Mesh, path: str | Path) -> None:
    """Raise a ValueError if single precision cannot represent a mesh."""
    with np.errstate(all="ignore"):
        lost = np.abs(mesh.vertices.astype(np.float32).astype(np.float64) - mesh.vertices).max()
    if not lost <= _MOST_LOST * np.ptp(mesh.vertices, axis=0).max():
        raise ValueError(
            f"{path} would store {mesh!r} in single precision, which distorts its shape: it is too "
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
            f"{where}{label(item.name, 'shape')} was skipped before: {item.reason} Leave it out "
            "here too, or use SpectralBasis(on_invalid='skip'), which passes it on."
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
    """Return the items of ``X`` as meshes; raise an error if ``X`` is a single mesh."""
    return [as_mesh(item, i) for i, item in enumerate(check_meshes(X))]


def as_arrays(item: MeshLike, index: int | None = None) -> Mesh | tuple[FloatArray, IntArray]:
    """Return the vertices and faces of a mesh, which need not be sound; a `Mesh` as it is.

    Other types raise the errors of `as_mesh`.
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
        as_mesh(item, index)  # raises the error
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
    """Open a given mesh; raise a MeshError if it is not available or has changed."""
    if given.source is None:
        raise MeshError(
            f"The given mesh of {label(given.name, 'shape')} was not kept. Transform it again."
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
    """Return the items of ``X`` as a list; raise an error if ``X`` is a single mesh."""
    if isinstance(X, (Mesh, str, Path)) or _is_trimesh(X) or _is_bare_pair(X):
        raise TypeError(
            f"X must be a sequence of meshes; got a single mesh ({type(X).__name__}). Wrap it in "
            "a list: [X]."
        )
    return list(check_samples(X, "meshes"))


def named(item: MeshLike, index: int) -> str | None:
    """Return the name that `as_mesh` would give, without reading the mesh."""
    if isinstance(item, (str, Path)):
        return Path(item).stem
    if isinstance(item, (Mesh, SkippedShape)):
        return item.name
    name = (item.metadata or {}).get("name") if _is_trimesh(item) else None
    return name or f"shape {index}"


def n_vertices_of(item: MeshLike) -> int:
    """Return the number of vertices of a mesh, sound or not; 0 if it is not known."""
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
    """Return whether an object is a trimesh.Trimesh, without importing trimesh, which is slow.

    If trimesh has not been imported, there can be no such object.
    """
    trimesh = sys.modules.get("trimesh")
    return trimesh is not None and isinstance(item, trimesh.Trimesh)


def _is_bare_pair(X: object) -> bool:
    """Return whether ``X`` is a single (vertices, faces) pair, with faces an integer array."""
    if not isinstance(X, Sequence) or isinstance(X, (str, bytes)) or len(X) != 2:
        return False
    if isinstance(X[0], (Mesh, str, Path)) or _is_trimesh(X[0]):
        return False
    try:
        faces = np.asarray(X[1])
    except ValueError:
        return False
    return faces.ndim == 2 and faces.shape[1] == 3 and np.issubdtype(faces.dtype, np.integer)
