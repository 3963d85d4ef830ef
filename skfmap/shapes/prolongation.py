"""Where the vertices of a given mesh lie on the working mesh."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from skfmap._tools.types import BoolArray, FloatArray, IntArray, SparseMatrix

__all__ = ["Prolongation"]


@dataclass(frozen=True, eq=False, repr=False)
class Prolongation:
    """Place of each vertex of a given mesh on the working mesh: a face, and a point on it.

    Attributes
    ----------
    face : ndarray of int32, shape (n_given,)
        Face of the working mesh; -1 for a vertex without a place, for instance on a component that
        was removed.
    coordinates : ndarray of float32, shape (n_given, 2)
        Weights of the second and third corners of that face. The weight of the first corner is 1
        minus their sum.

    Notes
    -----
    The matrix of a prolongation, of shape (n_given, n_working), takes functions on the working mesh
    to the given mesh. Each row has up to three entries, which sum to 1, or is empty. Only 12 bytes
    per given vertex are stored; the matrix is built on demand.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.shapes import Prolongation
    >>> middle = Prolongation(np.array([0, -1]), np.array([[0.5, 0.0], [0, 0]]))
    >>> middle.matrix(np.array([[0, 1, 2]]), 3).toarray().tolist()
    [[0.5, 0.5, 0.0], [0.0, 0.0, 0.0]]
    """

    face: npt.NDArray[np.int32]
    coordinates: npt.NDArray[np.float32]

    @classmethod
    def packed(cls, face: IntArray, coordinates: FloatArray) -> "Prolongation":
        """Pack places into 12 bytes each; coordinates where ``face`` is -1 are ignored."""
        known = np.where(face[:, None] >= 0, coordinates, 0.0)
        return cls(face.astype(np.int32), known.astype(np.float32))

    @classmethod
    def of_vertices(cls, vertex_map: IntArray, faces: IntArray) -> "Prolongation":
        """Return the prolongation of a mesh whose vertices were only renumbered or removed.

        Parameters
        ----------
        vertex_map : ndarray of int, shape (n_given,)
            Working vertex of each given vertex; -1 if it was removed.
        faces : ndarray of int, shape (n_faces, 3)
            Faces of the working mesh. Every vertex must belong to one.

        Returns
        -------
        Prolongation
            Prolongation whose matrix has at most one entry in each row.
        """
        first = np.full(int(faces.max()) + 1, -1)
        corners = faces.ravel()[::-1]  # reversed, so that the first face wins
        first[corners] = np.arange(faces.size)[::-1]
        at = np.where(vertex_map >= 0, first[vertex_map], -1)
        face, corner = np.where(at >= 0, at // 3, -1), at % 3
        coordinates = np.stack([corner == 1, corner == 2], axis=1) & (at >= 0)[:, None]
        return cls.packed(face, coordinates.astype(np.float64))

    def renumbered(self, vertex_map: IntArray) -> "Prolongation":
        """Return the prolongation of a finer mesh, given the map of its vertices to these.

        ``vertex_map`` holds, for each of its vertices, a given vertex of this prolongation, or -1
        if the vertex was removed.
        """
        lost = vertex_map < 0
        face, coordinates = self.face[vertex_map], self.coordinates[vertex_map]
        face[lost], coordinates[lost] = -1, 0.0
        return Prolongation(face, coordinates)

    def __repr__(self) -> str:
        """Return one line with the counts."""
        return f"Prolongation(n_given={len(self.face)}, n_placed={int(self.placed.sum())})"

    @property
    def placed(self) -> BoolArray:
        """Which given vertices have a place on the working mesh."""
        return np.asarray(self.face >= 0)

    @property
    def one_each(self) -> bool:
        """Whether every place is at a vertex, as for a mesh that was mended but not thinned."""
        return bool(np.isin(self.coordinates[self.placed], (0.0, 1.0)).all())

    def matrix(
        self, faces: IntArray, n_working: int, given: IntArray | None = None
    ) -> SparseMatrix:
        """Return the matrix, or some of its rows.

        Parameters
        ----------
        faces : ndarray of int, shape (n_faces, 3)
            Faces of the working mesh.
        n_working : int
            Number of vertices of the working mesh.
        given : ndarray of int, optional
            Given vertices whose rows to return; all by default.

        Returns
        -------
        sparse array of shape (n_given, n_working)
            Each row sums to 1 or is empty.
        """
        face = self.face if given is None else self.face[given]
        coordinates = self.coordinates if given is None else self.coordinates[given]
        placed = np.flatnonzero(face >= 0)
        last_two = coordinates[placed].astype(np.float64)
        weights = np.column_stack([np.maximum(1 - last_two.sum(axis=1), 0.0), last_two])
        weights /= weights.sum(axis=1, keepdims=True)  # coordinates are single precision
        rows = np.repeat(placed, 3)
        matrix = sp.coo_array(
            (weights.ravel(), (rows, faces[face[placed]].ravel())), shape=(len(face), n_working)
        ).tocsr()
        matrix.eliminate_zeros()
        return matrix

    def nearest_corner(self, faces: IntArray, given: IntArray | None = None) -> IntArray:
        """Return the working vertex with the largest weight for each given vertex; -1 if none."""
        face = self.face if given is None else self.face[given]
        coordinates = self.coordinates if given is None else self.coordinates[given]
        weights = np.column_stack([1 - coordinates.sum(axis=1), coordinates])
        corner = np.argmax(weights, axis=1)
        return np.where(face >= 0, faces[face, corner], -1).astype(np.int64)
