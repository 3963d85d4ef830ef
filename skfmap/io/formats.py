"""Mesh formats that are read or written, and remedies for those that are not."""

from collections.abc import Iterable
from pathlib import Path

from skfmap.io.brains import FREESURFER_SUFFIXES

__all__ = ["MESH_SUFFIXES", "READ_SUFFIXES", "WRITTEN_SUFFIXES", "remedy_for", "unread_formats"]

MESH_SUFFIXES = (".off", ".obj", ".ply", ".stl")
"""Primary formats; files of the same name in other formats are taken to be copies for viewing."""

WRITTEN_SUFFIXES = (*MESH_SUFFIXES, ".glb", ".vtk", ".vtp")
"""Formats that are written."""

READ_SUFFIXES = (*MESH_SUFFIXES, ".glb", ".gltf", ".vtk", ".vtp", ".gii", *FREESURFER_SUFFIXES)
"""Formats that are read."""

_PARAVIEW = "ParaView and 3D Slicer can save it as PLY"
_BLENDER = "Blender can save it as PLY or GLB"
_CAD = "FreeCAD and Gmsh can mesh it, and save the mesh as PLY"
_GMSH = "the command meshio convert can convert it to PLY"
_MESHLAB = "MeshLab can save it as PLY"

# Formats of surfaces that are not read, and how to convert them.
_REMEDIES = {
    **dict.fromkeys((".vtkhdf", ".vtm", ".vtu"), _PARAVIEW),
    ".asc": "convert it to a FreeSurfer surface with mris_convert",
    ".orig": "a FreeSurfer surface is read if its name ends in .white, for instance",
    **dict.fromkeys((".blend", ".dae", ".fbx", ".usd", ".usda", ".usdc", ".usdz"), _BLENDER),
    **dict.fromkeys((".iges", ".igs", ".step", ".stp"), _CAD),
    **dict.fromkeys((".mesh", ".msh", ".xdmf"), _GMSH),
    **dict.fromkeys(
        (".3ds", ".3mf", ".amf", ".byu", ".ctm", ".drc", ".ifs", ".iv", ".lwo", ".smf", ".srf",
         ".surf", ".tri", ".vrml", ".wrl", ".x3d"),
        _MESHLAB,
    ),
}  # fmt: skip

_PACKED = (".7z", ".bz2", ".gz", ".rar", ".xz", ".zip", ".zst")

_MOST = 8  # largest number of names listed in a message


def remedy_for(suffix: str) -> str:
    """Return a sentence that says how to convert a mesh in an unsupported format."""
    remedy = "unpack it first" if suffix in _PACKED else _REMEDIES.get(suffix)
    return f" {remedy[0].upper()}{remedy[1:]}." if remedy else ""


def unread_formats(folder: Path, files: Iterable[Path], read: Iterable[Path]) -> str:
    """Return a message that names meshes in unsupported formats; empty if there are none.

    Meshes that are also present in a supported format are not named.
    """
    stems = {path.stem for path in read}
    missed = sorted(
        path.name
        for path in files
        if _is_unread(path) and _stem(path) not in stems and path.name[0] != "."
    )
    if not missed:
        return ""
    rest = f" and {len(missed) - _MOST} more" if len(missed) > _MOST else ""
    suffixes = sorted({Path(name).suffix.lower() for name in missed})
    remedies = dict.fromkeys(remedy_for(suffix) for suffix in suffixes)
    return (
        f"{folder}: {', '.join(missed[:_MOST])}{rest} are left out, because {', '.join(suffixes)} "
        f"is not read.{''.join(remedies)}"
    )


def _is_unread(path: Path) -> bool:
    """Return whether a file is a mesh in an unsupported format, or a compressed mesh."""
    suffix = path.suffix.lower()
    inside = Path(path.stem).suffix.lower()
    return suffix in _REMEDIES or (
        suffix in _PACKED and (inside in READ_SUFFIXES or inside in _REMEDIES)
    )


def _stem(path: Path) -> str:
    """Return the name of a mesh without its suffix, or its suffixes if it is compressed."""
    return Path(path.stem).stem if path.suffix.lower() in _PACKED else path.stem
