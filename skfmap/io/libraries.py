"""Conversion of meshes to the types of other libraries."""

from typing import Any

from skfmap.shapes import Mesh

__all__ = ["to_pyvista", "to_trimesh"]


def to_trimesh(mesh: Mesh) -> Any:
    """Return a mesh as a trimesh.Trimesh; vertices are not merged and keep their order."""
    import trimesh  # noqa: PLC0415

    metadata = {} if mesh.name is None else {"name": mesh.name}
    vertices, faces = mesh.vertices.copy(), mesh.faces.copy()
    return trimesh.Trimesh(vertices, faces, process=False, metadata=metadata)


def to_pyvista(mesh: Mesh) -> Any:
    """Return a mesh as a pyvista.PolyData.

    Raises
    ------
    ImportError
        If pyvista is not installed.
    """
    try:
        import pyvista  # noqa: PLC0415
    except ImportError as error:
        raise ImportError(
            "to_pyvista needs pyvista, which is not installed: pip install 'skfmap[pyvista]'."
        ) from error
    return pyvista.PolyData.from_regular_faces(mesh.vertices.copy(), mesh.faces.copy())
