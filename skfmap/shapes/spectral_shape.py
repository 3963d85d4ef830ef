"""A shape of unit area with its first Laplacian eigenfunctions."""

from dataclasses import dataclass, replace

import numpy as np

from skfmap._tools.types import FloatArray, IntArray, SparseMatrix
from skfmap.shapes.mesh import Mesh

__all__ = ["SpectralShape"]


@dataclass(frozen=True, eq=False, repr=False)
class SpectralShape:
    """A shape of unit area with its first Laplacian eigenfunctions.

    Attributes
    ----------
    mesh : Mesh
        The mesh in its own units, numbered as given. Its faces are wound consistently and outwards
        where that can be told (``oriented`` says so); otherwise they are as given.
    evals : ndarray of shape (n_components,)
        Eigenvalues of the Laplacian of the shape scaled to unit area, ascending; ``evals[0]`` is 0.
    evecs : ndarray of shape (n_vertices, n_components)
        Eigenfunctions, orthonormal with respect to ``mass``. The first is the constant 1.
    mass : ndarray of shape (n_vertices,)
        Lumped mass matrix (its diagonal) at unit area; sums to 1.
    stiffness : sparse array of shape (n_vertices, n_vertices)
        Stiffness matrix, positive semi-definite; it does not depend on the scale.
    area : float
        Area of ``mesh`` in its own units.
    oriented : bool
        Whether all faces are wound consistently.
    outward : bool
        Whether they are known to point outwards.
    laplacian : str
        Which Laplacian the eigenfunctions are of.
    vertex_map : ndarray of int, shape (n_vertices_given,), or None
        If the mesh was mended: number in ``mesh`` of each vertex that was given, -1 where it was
        removed. None if vertices have their own numbers.
    """

    mesh: Mesh
    evals: FloatArray
    evecs: FloatArray
    mass: FloatArray
    stiffness: SparseMatrix
    area: float
    oriented: bool = True
    outward: bool = True
    laplacian: str = "cotangent"
    vertex_map: IntArray | None = None

    def __repr__(self) -> str:
        """Return a line with name and counts."""
        counts = f"n_vertices={self.mesh.n_vertices}, n_components={len(self.evals)}"
        return f"SpectralShape({self.mesh.name!r}, {counts})"

    @property
    def name(self) -> str | None:
        """Name of the mesh."""
        return self.mesh.name

    @property
    def n_components(self) -> int:
        """Number of eigenfunctions held."""
        return len(self.evals)

    @property
    def vertices(self) -> FloatArray:
        """Coordinates scaled to unit area, shape (n_vertices, 3)."""
        return np.asarray(self.mesh.vertices / np.sqrt(self.area))

    @property
    def evals_in_mesh_units(self) -> FloatArray:
        """Eigenvalues of the mesh as given, in 1 / squared units of its coordinates."""
        return np.asarray(self.evals / self.area)

    def truncate(self, n_components: int) -> "SpectralShape":
        """Return the same shape with its first ``n_components`` eigenfunctions only."""
        return replace(self, evals=self.evals[:n_components], evecs=self.evecs[:, :n_components])
