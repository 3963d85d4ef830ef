"""The given mesh of a shape: name, counts, hash and source."""

from dataclasses import dataclass, replace
from typing import Any, Self

from skfmap.shapes.mesh import Mesh

__all__ = ["GivenMesh"]


@dataclass(frozen=True, eq=False, repr=False)
class GivenMesh:
    """Description of a given mesh, and where to find it again.

    Attributes
    ----------
    name : str or None
        Name of the mesh.
    n_vertices, n_faces : int
        Number of vertices and of faces.
    content_hash : str
        Hash of the vertices and faces.
    source : Mesh, trimesh.Trimesh, (vertices, faces), path or None
        The caller's object or file; None if it is no longer available. `skfmap.io.open_given`
        opens it, and raises an error if it has changed.
    """

    name: str | None
    n_vertices: int
    n_faces: int
    content_hash: str
    source: Any = None

    def __repr__(self) -> str:
        """Return one line with the name and the counts."""
        return f"GivenMesh({self.name!r}, n_vertices={self.n_vertices}, n_faces={self.n_faces})"

    def found_at(self, source: Any) -> "GivenMesh":
        """Return a copy with another ``source``."""
        return replace(self, source=source)

    @classmethod
    def of(cls, mesh: Mesh) -> Self:
        """Describe a mesh as the given mesh."""
        return cls(mesh.name, mesh.n_vertices, mesh.n_faces, mesh.content_hash, mesh)
