"""A shape of unit area with its first Laplacian eigenfunctions."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.spatial import KDTree

from skfmap._tools.types import BoolArray, FloatArray, IntArray, SparseMatrix
from skfmap._tools.validation import as_reals
from skfmap.shapes.given_mesh import GivenMesh
from skfmap.shapes.mesh import Mesh
from skfmap.shapes.prolongation import Prolongation
from skfmap.shapes.surface_places import SurfacePlaces

__all__ = ["SpectralShape"]


@dataclass(frozen=True, eq=False, repr=False)
class SpectralShape:
    """A shape of unit area with its first Laplacian eigenfunctions.

    It lives on a *working mesh*, which is the given mesh where that is sound and small.

    Attributes
    ----------
    mesh : Mesh
        The working mesh, in its own units. Its faces are wound consistently and outwards where that
        can be told (``oriented`` says so); otherwise they are as given.
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
    prolongation : Prolongation or None
        Where each given vertex lies on the working mesh. None where the working mesh is the given
        one, vertex by vertex.
    given : GivenMesh or None
        The mesh that was given. None where it is ``mesh`` itself.
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
    prolongation: Prolongation | None = None
    given: GivenMesh | None = None

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

    @property
    def n_given(self) -> int:
        """Number of vertices of the given mesh, which answers are on."""
        return self.mesh.n_vertices if self.prolongation is None else len(self.prolongation.face)

    @property
    def keeps_vertices(self) -> bool:
        """Whether the given vertices that have a place are vertices of the working mesh."""
        return self.prolongation is None or self.prolongation.one_each

    @property
    def given_hash(self) -> str:
        """Hash of the given mesh, whatever its name."""
        return self.mesh.content_hash if self.given is None else self.given.content_hash

    @property
    def prolongation_matrix(self) -> SparseMatrix:
        """The prolongation as a sparse array of shape (n_given, n_vertices); see `Prolongation`."""
        if self.prolongation is None:
            return sp.eye_array(self.mesh.n_vertices, format="csr")
        return self.prolongation.matrix(self.mesh.faces, self.mesh.n_vertices)

    def evecs_at(
        self, given: IntArray, n_components: int, places: SurfacePlaces | None = None
    ) -> FloatArray:
        """Return the first eigenfunctions at given vertices, interpolated on the working mesh.

        Parameters
        ----------
        given : ndarray of int, shape (n,)
            Vertices of the given mesh.
        n_components : int
            How many functions.
        places : SurfacePlaces, optional
            Places on the given mesh where they are wanted instead; means over their corners.

        Returns
        -------
        ndarray of shape (n, n_components)
            Their values; 0 at vertices without a place.
        """
        if places is not None:
            return places.means(self.evecs_at(places.corners.ravel(), n_components))
        if self.prolongation is None:
            return self.evecs[given, :n_components]
        rows = self.prolongation.matrix(self.mesh.faces, self.mesh.n_vertices, given)
        return np.asarray(rows @ self.evecs[:, :n_components])

    def placed(self, given: IntArray) -> BoolArray:
        """Return which of some given vertices have a place on the working mesh."""
        if self.prolongation is None:
            return np.ones(len(given), dtype=bool)
        return np.asarray(self.prolongation.face[given] >= 0)

    def places_of(self, given: IntArray) -> tuple[IntArray, FloatArray]:
        """Return the places of some given vertices: working vertices and weights, both (n, 3)."""
        if self.prolongation is None:
            return np.repeat(given[:, None], 3, axis=1), np.tile([1.0, 0, 0], (len(given), 1))
        face = self.prolongation.face[given]
        last_two = self.prolongation.coordinates[given].astype(np.float64)
        return self.mesh.faces[face], np.column_stack(
            [np.maximum(1 - last_two.sum(axis=1), 0.0), last_two]
        )

    def place_matrix(self, given: IntArray, places: SurfacePlaces | None = None) -> SparseMatrix:
        """Return where given vertices, or places on the given mesh, lie on the working mesh.

        Parameters
        ----------
        given : ndarray of int, shape (n,)
            Vertices of the given mesh.
        places : SurfacePlaces, optional
            Places on its faces; these are then asked about.

        Returns
        -------
        sparse array of shape (n, n_vertices)
            Weights of working vertices.
        """
        corners, weights = self.places_of(given if places is None else places.corners.ravel())
        n = len(given)
        if places is not None:
            weights = weights * places.weights.reshape(-1, 1)
            n = len(places.corners)
        rows = np.repeat(np.arange(n), 3 if places is None else 9)
        shape = (n, self.mesh.n_vertices)
        return sp.coo_array((weights.ravel(), (rows, corners.ravel())), shape=shape).tocsr()

    def vertices_at(self, given: IntArray, places: SurfacePlaces | None = None) -> FloatArray:
        """Return where these lie on the working mesh at unit area, shape (n, 3).

        The parameters are those of `place_matrix`.
        """
        return np.asarray(self.place_matrix(given, places) @ self.vertices)

    def working_vertices(self, given: IntArray) -> IntArray:
        """Return the working vertex nearest to each of some given vertices; -1 without a place."""
        if self.prolongation is None:
            return np.asarray(given, dtype=np.int64)
        return self.prolongation.nearest_corner(self.mesh.faces, given)

    def given_vertices(self) -> IntArray:
        """Return the given vertex nearest to each working one on its faces; -1 where none is.

        Where mending cut a vertex in two, both have the one that was given.
        """
        if self.prolongation is None:
            return np.arange(self.mesh.n_vertices)
        matrix = self.prolongation_matrix.tocsc()
        weights = matrix.max(axis=0).toarray().ravel()
        nearest = np.asarray(matrix.argmax(axis=0)).ravel()
        if self.prolongation.one_each and not (weights > 0).all():
            known, cut = np.flatnonzero(weights > 0), np.flatnonzero(weights <= 0)
            _, beside = KDTree(self.mesh.vertices[known]).query(self.mesh.vertices[cut])
            nearest[cut], weights[cut] = nearest[known[beside]], 1.0
        return np.where(weights > 0, nearest, -1)

    def prolong(self, values: FloatArray, empty: float = np.nan) -> FloatArray:
        """Bring values from the working mesh to the given one.

        Parameters
        ----------
        values : ndarray of shape (n_vertices,) or (n_vertices, n_columns)
            Values at the working vertices.
        empty : float, default=nan
            What given vertices without a place get.

        Returns
        -------
        ndarray of shape (n_given,) or (n_given, n_columns)
            Values at the given vertices.
        """
        if self.prolongation is None:
            return values
        carried = np.asarray(self.prolongation_matrix @ values, dtype=np.float64)
        carried[~self.prolongation.placed] = empty
        return carried

    def restrict(self, values: npt.ArrayLike) -> FloatArray:
        """Bring values from the given mesh to the working one: the way for functions of your own.

        Each working vertex gets the mean of the given vertices around it, weighted as the
        prolongation weighs them; one without any gets the mean of its neighbours.

        Parameters
        ----------
        values : array-like of shape (n_given,) or (n_given, n_columns)
            Values at the given vertices.

        Returns
        -------
        ndarray of shape (n_vertices,) or (n_vertices, n_columns)
            Values at the working vertices.

        Raises
        ------
        ValueError
            If there is not one value, or row, for each given vertex.

        Examples
        --------
        >>> from skfmap import SpectralBasis
        >>> from skfmap.datasets import make_sphere
        >>> ball = make_sphere(n_subdivisions=4)
        >>> (shape,) = SpectralBasis(5, max_vertices=500).transform([ball])
        >>> shape.restrict(ball.vertices[:, 2]).shape == (shape.mesh.n_vertices,)
        True
        """
        given = as_reals(values, "values")
        if given.ndim not in (1, 2) or len(given) != self.n_given:
            raise ValueError(
                f"values must have one entry or row for each of the {self.n_given} vertices that "
                f"{self.name!r} was given with; got shape {given.shape}."
            )
        if self.prolongation is None:
            return given
        back = self.prolongation_matrix.T.tocsr()
        columns = given.reshape(len(given), -1)
        sums = np.asarray(back @ columns, dtype=np.float64)
        weights = np.asarray(back.sum(axis=1), dtype=np.float64).ravel()
        # Where no given vertex is, neighbours that have some lend theirs, ring by ring.
        neighbours = adjacency(self.mesh.faces, self.mesh.n_vertices)
        while (weights <= 0).any():
            empty = weights <= 0
            known = (~empty).astype(np.float64)
            means = sums / np.where(empty, 1.0, weights)[:, None] * known[:, None]
            around = np.asarray(neighbours @ means), np.asarray(neighbours @ known)
            sums[empty], weights[empty] = around[0][empty], around[1][empty]
        return np.asarray((sums / weights[:, None]).reshape(-1, *given.shape[1:]))

    def truncate(self, n_components: int) -> "SpectralShape":
        """Return the same shape with its first ``n_components`` eigenfunctions only."""
        return replace(self, evals=self.evals[:n_components], evecs=self.evecs[:, :n_components])


def adjacency(faces: IntArray, n_vertices: int) -> SparseMatrix:
    """Return which vertices share an edge, as a sparse array of ones."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    both = np.concatenate([ends, ends[::-1]], axis=1)
    links = sp.coo_array((np.ones(both.shape[1]), both), shape=(n_vertices, n_vertices)).tocsr()
    links.data[:] = 1.0
    return links


def _normalised(weights: FloatArray) -> FloatArray:
    """Return weights whose rows sum to 1, which single precision leaves open."""
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
