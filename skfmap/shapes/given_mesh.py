"""The mesh that a shape came as."""

from dataclasses import dataclass, replace
from typing import Any, Self

from skfmap.shapes.mesh import Mesh

__all__ = ["GivenMesh"]


@dataclass(frozen=True, eq=False, repr=False)
class GivenMesh:
    """The mesh that a shape came as: what it was, and where it is to be found again.

    Attributes
    ----------
    name : str or None
        Its name.
    n_vertices, n_faces : int
        Counts.
    content_hash : str
        Hash of its vertices and faces.
    source : Mesh, trimesh.Trimesh, (vertices, faces), path or None
        The caller's own object or file; None where nobody holds it. `skfmap.io.open_given` reads
        it, and notices if it is another by now.
    """

    name: str | None
    n_vertices: int
    n_faces: int
    content_hash: str
    source: Any = None

    def __repr__(self) -> str:
        """Return a line with name and counts."""
        return f"GivenMesh({self.name!r}, n_vertices={self.n_vertices}, n_faces={self.n_faces})"

    def found_at(self, source: Any) -> "GivenMesh":
        """Return the same, to be found in ``source``."""
        return replace(self, source=source)

    @classmethod
    def of(cls, mesh: Mesh) -> Self:
        """Return what says that a mesh is the given one."""
        return cls(mesh.name, mesh.n_vertices, mesh.n_faces, mesh.content_hash, mesh)
