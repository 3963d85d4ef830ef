"""The reference's mesh in the form of another shape."""

from dataclasses import dataclass

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.exceptions import MeshError
from skfmap.shapes import outlets
from skfmap.shapes.mesh import Mesh

__all__ = ["Registered"]


@dataclass(frozen=True, eq=False, repr=False)
class Registered:
    """The reference's mesh laid onto a shape: its vertices moved there, with the same faces.

    Attributes
    ----------
    vertices : ndarray of shape (n_vertices_0, 3)
        Of the reference's mesh as it was given, in the units and the place of the shape's mesh; NaN
        if the shape was left out.
    faces : ndarray of int, shape (n_faces_0, 3)
        Those of the reference. On a shape that was reflected they point inwards.
    distance : ndarray of shape (n_vertices_0,)
        Of each vertex from the shape's surface as it was given, in its units.
    n_flipped : int
        Faces of the working mesh that are folded over.
    off : float
        Share of the reference's area that lies off the shape, by more than two edges of its working
        mesh, or on it but facing the other way.
    uncovered : float
        Share of the shape's area that lies off the reference.
    stretched : float
        Share of the reference's area that is stretched or compressed more than nearly all of the
        training shapes'.
    fits : bool
        Whether ``off``, ``uncovered`` and ``stretched`` are like those of training shapes that were
        left out. Where it is False, `UnfamiliarShapeWarning` has named the shape, and the mesh is
        not to be trusted.
    name, reference_name : str or None
        Of the shape and of the reference.
    energy : float
        What the deformation takes beyond what training shapes showed; without a unit. It tells
        which of several ways to lie is right.
    """

    vertices: FloatArray
    faces: IntArray
    distance: FloatArray
    n_flipped: int
    off: float
    uncovered: float
    stretched: float
    fits: bool
    name: str | None = None
    reference_name: str | None = None
    energy: float = float("nan")

    def __repr__(self) -> str:
        """Return a line with the names and how well the reference fits."""
        return (
            f"Registered({self.reference_name!r} on {self.name!r}, fits={self.fits}, "
            f"n_flipped={self.n_flipped}, off={self.off:.3f}, uncovered={self.uncovered:.3f}, "
            f"stretched={self.stretched:.3f})"
        )

    def _repr_html_(self) -> str:
        return outlets.html_of(self)

    @property
    def mesh(self) -> Mesh:
        """The mesh, named after the shape.

        Raises
        ------
        MeshError
            If the shape was left out, so that there is none.
        """
        if not np.isfinite(self.vertices).all():
            raise MeshError(f"{self.name!r} was left out: the reference lies nowhere on it.")
        return Mesh(self.vertices, self.faces, self.name)
