"""A triangle mesh: checked, immutable, identified by its content."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from skfmap._tools.caching import hash_of_arrays
from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import (
    check_faces,
    check_vertices,
    label,
    read_only,
)
from skfmap.shapes import outlets

__all__ = ["Mesh"]


@dataclass(frozen=True, eq=False, repr=False)
class Mesh:
    """A triangle mesh: checked, immutable, and identified by its content.

    Parameters
    ----------
    vertices : array-like of shape (n_vertices, 3)
        Coordinates, in any unit; copied.
    faces : array-like of int, shape (n_faces, 3)
        Vertex indices of each triangle, counted from 0; copied.
    name : str, optional
        Name of the shape in messages and reports.

    Raises
    ------
    MeshError
        If a coordinate is not finite, an index is out of range, a face is not a triangle, or there
        are no vertices or no faces.

    Notes
    -----
    A mesh deliberately has no length, no shape and no array interface, because scikit-learn slices
    whatever looks like an array.

    Examples
    --------
    >>> from skfmap import Mesh
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], name="one")
    >>> mesh
    Mesh('one', n_vertices=3, n_faces=1)
    >>> mesh.area
    0.5
    """

    vertices: FloatArray
    faces: IntArray
    name: str | None = None

    def __post_init__(self) -> None:
        who = label(self.name)
        vertices = check_vertices(self.vertices, who)
        faces = check_faces(self.faces, len(vertices), who)
        object.__setattr__(self, "vertices", read_only(vertices))
        object.__setattr__(self, "faces", read_only(faces))

    def __repr__(self) -> str:
        """Return one line with the name and the counts."""
        name = "" if self.name is None else f"{self.name!r}, "
        return f"Mesh({name}n_vertices={self.n_vertices}, n_faces={self.n_faces})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by way of the constructor, without cached values."""
        return Mesh, (self.vertices, self.faces, self.name)

    def __deepcopy__(self, memo: object) -> Self:
        """Return the mesh itself: it cannot change."""
        return self

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return len(self.vertices)

    @property
    def n_faces(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @cached_property
    def area(self) -> float:
        """Total area, in squared units of the coordinates."""
        a, b, c = (self.vertices[self.faces[:, j]] for j in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    @cached_property
    def content_hash(self) -> str:
        """Hash of the vertices and faces, but not of the name; the key in caches."""
        return hash_of_arrays(self.vertices, self.faces)

    def _repr_html_(self) -> str:
        return outlets.html_of(self)

    def to_trimesh(self) -> Any:
        """Return a copy as a `trimesh.Trimesh`, with the same vertices in the same order."""
        return outlets.to_trimesh(self)

    def to_pyvista(self) -> Any:
        """Return a copy as a `pyvista.PolyData`.

        Raises
        ------
        ImportError
            If pyvista is not installed (``pip install 'skfmap[pyvista]'``).
        """
        return outlets.to_pyvista(self)
