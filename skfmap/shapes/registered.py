"""The mesh of the reference laid onto another shape."""

from dataclasses import dataclass

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.exceptions import MeshError
from skfmap.shapes import outlets
from skfmap.shapes.mesh import Mesh

__all__ = ["Registered"]


@dataclass(frozen=True, eq=False, repr=False)
class Registered:
    """The mesh of the reference laid onto a shape: the same faces, with the vertices moved.

    Attributes
    ----------
    vertices : ndarray of shape (n_vertices_0, 3)
        Moved vertices of the given mesh of the reference, in the units and the coordinate system of
        the shape's mesh; NaN if the shape was skipped.
    faces : ndarray of int, shape (n_faces_0, 3)
        Faces of the reference. On a reflected shape they point inwards.
    distance : ndarray of shape (n_vertices_0,)
        Distance of each vertex from the surface of the given mesh of the shape, in its units.
    n_flipped : int
        Number of faces of the working mesh that are folded over.
    off : float
        Fraction of the reference's area that lies off the shape by more than two edge lengths of
        its working mesh, or lies on it but faces the other way.
    uncovered : float
        Fraction of the shape's area that the reference does not cover.
    stretched : float
        Fraction of the reference's area that is stretched or compressed more than nearly all of the
        area on the training shapes.
    fits : bool
        Whether ``off``, ``uncovered`` and ``stretched`` are as small as for training shapes when
        they were left out. If False, an `UnfamiliarShapeWarning` named the shape, and the mesh
        should not be trusted.
    name, reference_name : str or None
        Names of the shape and of the reference.
    energy : float
        Dimensionless energy of the deformation beyond the variation seen in training. It is used to
        choose among several candidate registrations.
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
        """Return one line with the names and the quality of the fit."""
        return (
            f"Registered({self.reference_name!r} on {self.name!r}, fits={self.fits}, "
            f"n_flipped={self.n_flipped}, off={self.off:.3f}, uncovered={self.uncovered:.3f}, "
            f"stretched={self.stretched:.3f})"
        )

    def _repr_html_(self) -> str:
        return outlets.html_of(self)

    @property
    def mesh(self) -> Mesh:
        """The registered mesh, named after the shape.

        Raises
        ------
        MeshError
            If the shape was skipped, so that there is no registered mesh.
        """
        if not np.isfinite(self.vertices).all():
            raise MeshError(
                f"{self.name!r} was skipped, so it has no registered mesh. The warnings of the "
                "pipeline say why."
            )
        return Mesh(self.vertices, self.faces, self.name)
