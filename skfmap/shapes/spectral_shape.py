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

    All quantities are on the *working mesh*, which is the given mesh if that is sound and small.

    Attributes
    ----------
    mesh : Mesh
        The working mesh, in its own units. Its faces are oriented consistently and outwards if that
        can be determined (see ``oriented`` and ``outward``); otherwise they are as given.
    evals : ndarray of shape (n_components,)
        Eigenvalues of the Laplacian of the shape scaled to unit area, ascending; ``evals[0]`` is 0.
    evecs : ndarray of shape (n_vertices, n_components)
        Eigenfunctions, orthonormal with respect to ``mass``. The first is the constant 1.
    mass : ndarray of shape (n_vertices,)
        Diagonal of the lumped mass matrix at unit area; sums to 1.
    stiffness : sparse array of shape (n_vertices, n_vertices)
        Stiffness matrix, positive semi-definite and independent of scale.
    area : float
        Area of ``mesh`` in its own units.
    oriented : bool
        Whether all faces are oriented consistently.
    outward : bool
        Whether the faces are known to point outwards.
    laplacian : str
        The Laplacian that the eigenfunctions belong to.
    prolongation : Prolongation or None
        Place of each given vertex on the working mesh. None if the working mesh has the vertices of
        the given mesh.
    given : GivenMesh or None
        The given mesh. None if it is ``mesh`` itself.
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
        """Return one line with the name and the counts."""
        counts = f"n_vertices={self.mesh.n_vertices}, n_components={len(self.evals)}"
        return f"SpectralShape({self.mesh.name!r}, {counts})"

    @property
    def name(self) -> str | None:
        """Name of the mesh."""
        return self.mesh.name

    @property
    def n_components(self) -> int:
        """Number of eigenfunctions."""
        return len(self.evals)

    @property
    def vertices(self) -> FloatArray:
        """Coordinates of the working mesh scaled to unit area, of shape (n_vertices, 3)."""
        return np.asarray(self.mesh.vertices / np.sqrt(self.area))

    @property
    def evals_in_mesh_units(self) -> FloatArray:
        """Eigenvalues without scaling to unit area, in 1 / squared units of the coordinates."""
        return np.asarray(self.evals / self.area)

    @property
    def n_given(self) -> int:
        """Number of vertices of the given mesh, on which results are returned."""
        return self.mesh.n_vertices if self.prolongation is None else len(self.prolongation.face)

    @property
    def keeps_vertices(self) -> bool:
        """Whether all given vertices that have a place are vertices of the working mesh."""
        return self.prolongation is None or self.prolongation.one_each

    @property
    def given_hash(self) -> str:
        """Hash of the given mesh; independent of its name."""
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
            Number of eigenfunctions.
        places : SurfacePlaces, optional
            Places on the given mesh to use instead; values are weighted means over their corners.

        Returns
        -------
        ndarray of shape (n, n_components)
            Values of the eigenfunctions; 0 at vertices without a place on the working mesh.
        """
        if places is not None:
            return places.means(self.evecs_at(places.corners.ravel(), n_components))
        if self.prolongation is None:
            return self.evecs[given, :n_components]
        rows = self.prolongation.matrix(self.mesh.faces, self.mesh.n_vertices, given)
        return np.asarray(rows @ self.evecs[:, :n_components])

    def placed(self, given: IntArray) -> BoolArray:
        """Return which of the given vertices have a place on the working mesh."""
        if self.prolongation is None:
            return np.ones(len(given), dtype=bool)
        return np.asarray(self.prolongation.face[given] >= 0)

    def places_of(self, given: IntArray) -> tuple[IntArray, FloatArray]:
        """Return the places of given vertices: working vertices and weights, both (n, 3)."""
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
            Places on the faces of the given mesh, to use instead of ``given``.

        Returns
        -------
        sparse array of shape (n, n_vertices)
            Weights of the working vertices.
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
        """Return coordinates of given vertices or places on the working mesh at unit area.

        The parameters are those of `place_matrix`; the result has shape (n, 3).
        """
        return np.asarray(self.place_matrix(given, places) @ self.vertices)

    def working_vertices(self, given: IntArray) -> IntArray:
        """Return the working vertex nearest to each given vertex; -1 if it has no place."""
        if self.prolongation is None:
            return np.asarray(given, dtype=np.int64)
        return self.prolongation.nearest_corner(self.mesh.faces, given)

    def given_vertices(self) -> IntArray:
        """Return the given vertex nearest to each working vertex on its faces; -1 if there is none.

        If mending split a vertex in two, both halves have the same given vertex.
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
        """Carry values from the working mesh to the given mesh.

        Parameters
        ----------
        values : ndarray of shape (n_vertices,) or (n_vertices, n_columns)
            Values at the working vertices.
        empty : float, default=nan
            Value at given vertices without a place.

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
        """Carry values from the given mesh to the working mesh, for instance your own functions.

        Each working vertex gets the mean over the given vertices around it, weighted by the
        prolongation. A working vertex without any gets the mean of its neighbours.

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
            If ``values`` does not have one entry or row for each given vertex.

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
                f"values must have one entry or row for each of the {self.n_given} vertices of the "
                f"given mesh of {self.name!r}; got shape {given.shape}."
            )
        if self.prolongation is None:
            return given
        back = self.prolongation_matrix.T.tocsr()
        columns = given.reshape(len(given), -1)
        sums = np.asarray(back @ columns, dtype=np.float64)
        weights = np.asarray(back.sum(axis=1), dtype=np.float64).ravel()
        # Fill working vertices without given vertices from their neighbours, ring by ring.
        neighbours = adjacency(self.mesh.faces, self.mesh.n_vertices)
        while (weights <= 0).any():
            empty = weights <= 0
            known = (~empty).astype(np.float64)
            means = sums / np.where(empty, 1.0, weights)[:, None] * known[:, None]
            around = np.asarray(neighbours @ means), np.asarray(neighbours @ known)
            sums[empty], weights[empty] = around[0][empty], around[1][empty]
        return np.asarray((sums / weights[:, None]).reshape(-1, *given.shape[1:]))

    def truncate(self, n_components: int) -> "SpectralShape":
        """Return the shape with only its first ``n_components`` eigenfunctions."""
        return replace(self, evals=self.evals[:n_components], evecs=self.evecs[:, :n_components])


def adjacency(faces: IntArray, n_vertices: int) -> SparseMatrix:
    """Return the vertex adjacency as a sparse array of ones."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    both = np.concatenate([ends, ends[::-1]], axis=1)
    links = sp.coo_array((np.ones(both.shape[1]), both), shape=(n_vertices, n_vertices)).tocsr()
    links.data[:] = 1.0
    return links


def _normalised(weights: FloatArray) -> FloatArray:
    """Return weights with rows rescaled to sum to 1, which single precision does not ensure."""
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
