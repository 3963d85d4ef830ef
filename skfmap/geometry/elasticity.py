"""As-rigid-as-possible energy of surfaces that bend freely and resist stretching."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import igl
import numpy as np
import scipy.sparse as sp

from skfmap._tools.types import FloatArray, IntArray, SparseMatrix

__all__ = ["ElasticSurface", "nearest_rotations"]

# Lower bound of the cotangents: with negative ones, edges of obtuse triangles would push instead of
# pull.
_LEAST_COTANGENT = 1e-3
# Weight of the rotation of the whole surface at each vertex; it decides only where edges leave the
# rotation undetermined.
_OF_WHOLE = 1e-9
# Newton's iteration is used for matrices whose determinant, at unit norm, is above this (that of
# rotations is 0.19). It then never takes this many steps, and ends when entries change by less than
# the last value.
_LEAST_DETERMINANT, _MOST_STEPS, _ENOUGH = 1e-4, 20, 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class ElasticSurface:
    """The edges of a mesh at rest (Sorkine, Alexa 2007).

    The energy of other coordinates is the weighted sum of squared differences between their edges
    and the edges at rest, rotated by the mean of the rotations at their two ends. It does not
    change when the surface is rotated or translated.

    Attributes
    ----------
    edges : ndarray of int, shape (n_edges, 2)
        Vertices at the two ends of each edge.
    weights : ndarray of shape (n_edges,)
        Mean cotangents, at least 0.001.
    vectors : ndarray of shape (n_edges, 3)
        Vectors from the second end to the first, at rest.
    n_vertices : int
        Number of vertices.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.elasticity import ElasticSurface
    >>> from skfmap.geometry.sphere import subdivided_octahedron
    >>> vertices, faces = subdivided_octahedron(2)
    >>> turned = vertices[:, [1, 2, 0]] + 5.0
    >>> bool(ElasticSurface.at_rest(vertices, faces).strains(turned).max() < 1e-12)
    True
    """

    edges: IntArray
    weights: FloatArray
    vectors: FloatArray
    n_vertices: int

    @classmethod
    def at_rest(cls, vertices: FloatArray, faces: IntArray) -> Self:
        """Return the surface that is at rest in the coordinates of a mesh."""
        laplacian = sp.triu(igl.cotmatrix(vertices, faces), k=1).tocoo()
        edges = np.stack(laplacian.coords, axis=1).astype(np.int64)
        weights = np.maximum(laplacian.data, _LEAST_COTANGENT)
        return cls(edges, weights, vertices[edges[:, 0]] - vertices[edges[:, 1]], len(vertices))

    def __getstate__(self) -> dict[str, object]:
        """Return the attributes, without cached results."""
        names = ("edges", "weights", "vectors", "n_vertices")
        return {name: getattr(self, name) for name in names}

    def with_vectors(self, vectors: FloatArray) -> Self:
        """Return the surface with other edges at rest."""
        other = replace(self, vectors=vectors)
        # Results that do not depend on the vectors are kept.
        other.__dict__.update(
            differences=self.differences, ends=self.ends, stiffness=self.stiffness
        )
        return other

    @cached_property
    def differences(self) -> SparseMatrix:
        """Matrix that takes values at vertices to their differences along edges."""
        n, rows = len(self.edges), np.arange(len(self.edges))
        signs = np.repeat([1.0, -1.0], n)
        shape = (n, self.n_vertices)
        return sp.csr_array((signs, (np.tile(rows, 2), self.edges.T.ravel())), shape=shape)

    @cached_property
    def ends(self) -> SparseMatrix:
        """Matrix that sums values over the edges at each vertex, shape (n_vertices, n_edges)."""
        return sp.csr_array(abs(self.differences.T))

    @cached_property
    def stiffness(self) -> SparseMatrix:
        """Matrix of the energy for given rotations, shape (n_vertices, n_vertices)."""
        return (self.differences.T @ sp.diags_array(self.weights) @ self.differences).tocsc()

    def along_edges(self, vertices: FloatArray) -> FloatArray:
        """Return the edges of other coordinates, shape (n_edges, 3)."""
        return vertices[self.edges[:, 0]] - vertices[self.edges[:, 1]]

    def rotations(self, vertices: FloatArray) -> FloatArray:
        """Return the rotations that best take the edges around each vertex from rest, (n, 3, 3).

        If these edges are collinear or have no length, as when a match maps neighbours to one
        point, the rotation is not unique; the rotation of the whole surface then decides.
        """
        weighted = self.weights[:, None] * self.along_edges(vertices)
        products = weighted[:, :, None] * self.vectors[:, None, :]
        sums = np.asarray(self.ends @ products.reshape(-1, 9)).reshape(-1, 3, 3)
        whole = _by_singular_values(sums.mean(axis=0, keepdims=True))
        size = np.linalg.norm(sums, axis=(1, 2)).mean()
        return nearest_rotations(sums + _OF_WHOLE * size * whole)

    def turned(self, rotations: FloatArray) -> FloatArray:
        """Return the right-hand side that belongs to ``stiffness``, shape (n_vertices, 3)."""
        vectors = np.einsum("eab,eb->ea", self._at_edges(rotations), self.vectors)
        return np.asarray(self.differences.T @ (self.weights[:, None] * vectors))

    def seen_from_rest(self, vertices: FloatArray) -> FloatArray:
        """Return the edges of other coordinates, rotated back, shape (n_edges, 3).

        They differ from the edges at rest by stretch and shear only.
        """
        turns = self._at_edges(self.rotations(vertices))
        return np.asarray(np.einsum("eba,eb->ea", turns, self.along_edges(vertices)))

    def strains(self, vertices: FloatArray) -> FloatArray:
        """Return the absolute logarithms of the ratios of edge lengths to those at rest."""
        now, before = (
            np.linalg.norm(vectors, axis=1)
            for vectors in (self.along_edges(vertices), self.vectors)
        )
        return np.asarray(np.abs(np.log(np.maximum(now, 1e-12) / np.maximum(before, 1e-12))))

    def _at_edges(self, rotations: FloatArray) -> FloatArray:
        return np.asarray((rotations[self.edges[:, 0]] + rotations[self.edges[:, 1]]) / 2)


def nearest_rotations(matrices: FloatArray) -> FloatArray:
    """Return the proper rotations nearest to matrices, both of shape (n, 3, 3).

    For matrices that preserve orientation these are the polar factors, found by Newton's iteration
    (Higham 1986) for all at once, in a seventh of the time of singular value decompositions, which
    are used for the others.
    """
    # libigl has such a function only in releases after the oldest one supported.
    by_entry = matrices.reshape(-1, 9).T
    Q = by_entry / np.maximum(np.linalg.norm(by_entry, axis=0), 1e-300)
    upright = _cofactors(Q)[1] > _LEAST_DETERMINANT
    Q, step = Q[:, upright], np.inf
    for _ in range(_MOST_STEPS):
        if not Q.size or step < _ENOUGH:
            break
        cofactors, determinants = _cofactors(Q)
        size = np.cbrt(determinants)  # scaling speeds up the convergence
        before, Q = Q, (Q / size + cofactors * (size / determinants)) / 2
        step = float(np.abs(Q - before).max())
    rotations = np.empty(matrices.shape)
    rotations[upright] = Q.T.reshape(-1, 3, 3)
    rotations[~upright] = _by_singular_values(matrices[~upright])
    return rotations


def _by_singular_values(matrices: FloatArray) -> FloatArray:
    U, _, Vt = np.linalg.svd(matrices)
    U[:, :, 2] *= np.linalg.det(U @ Vt)[:, None]
    return np.asarray(U @ Vt)


def _cofactors(M: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the cofactors and determinants of matrices, given as nine rows of entries."""
    a, b, c, d, e, f, g, h, i = M
    cofactors = np.stack(
        [
            *(e * i - f * h, f * g - d * i, d * h - e * g),
            *(c * h - b * i, a * i - c * g, b * g - a * h),
            *(b * f - c * e, c * d - a * f, a * e - b * d),
        ]
    )
    return cofactors, np.einsum("kn,kn->n", M[:3], cofactors[:3])
