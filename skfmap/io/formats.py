"""Formats of meshes: those that are read, and those that are not."""

from collections.abc import Iterable
from pathlib import Path

from skfmap.io.brains import FREESURFER_SUFFIXES

__all__ = ["MESH_SUFFIXES", "READ_SUFFIXES", "WRITTEN_SUFFIXES", "remedy_for", "unread_formats"]

MESH_SUFFIXES = (".off", ".obj", ".ply", ".stl")
"""Formats that others are copies of for viewing, where both are there."""

WRITTEN_SUFFIXES = (*MESH_SUFFIXES, ".glb", ".vtk", ".vtp")
"""Formats that are written."""

READ_SUFFIXES = (*MESH_SUFFIXES, ".glb", ".gltf", ".vtk", ".vtp", ".gii", *FREESURFER_SUFFIXES)
"""Formats that are read."""

_PARAVIEW = "ParaView and 3D Slicer save it as PLY"
_BLENDER = "Blender saves it as PLY or GLB"
_CAD = "FreeCAD and Gmsh make it a mesh, and save that as PLY"
_GMSH = "the command meshio convert makes it a PLY file"
_MESHLAB = "MeshLab saves it as PLY"

# What other programs keep surfaces in, and how to get them out.
_REMEDIES = {
    **dict.fromkeys((".vtkhdf", ".vtm", ".vtu"), _PARAVIEW),
    ".asc": "mris_convert of FreeSurfer makes its text a surface that is read",
    ".orig": "a surface of FreeSurfer is read where its name ends in .white, for instance",
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

_MOST = 8  # names that a message lists


def remedy_for(suffix: str) -> str:
    """Return how a mesh of a format that is not read comes into one that is, as a sentence."""
    remedy = "unpack it first" if suffix in _PACKED else _REMEDIES.get(suffix)
    return f" {remedy[0].upper()}{remedy[1:]}." if remedy else ""


def unread_formats(folder: Path, files: Iterable[Path], read: Iterable[Path]) -> str:
    """Name the meshes among files whose format is not read, and say what to do; empty if none.

    Those that are there in another format too are not missed.
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
        f"{folder}: {', '.join(missed[:_MOST])}{rest} are left out, as {', '.join(suffixes)} is "
        f"not read.{''.join(remedies)}"
    )


def _is_unread(path: Path) -> bool:
    """Tell whether a file is a mesh of another format, or a mesh that is packed."""
    suffix = path.suffix.lower()
    inside = Path(path.stem).suffix.lower()
    return suffix in _REMEDIES or (
        suffix in _PACKED and (inside in READ_SUFFIXES or inside in _REMEDIES)
    )


def _stem(path: Path) -> str:
    """Return the name of a mesh without its suffix, or suffixes where it is packed."""
    return Path(path.stem).stem if path.suffix.lower() in _PACKED else path.stem
