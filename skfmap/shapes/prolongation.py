"""Where the vertices of a given mesh lie on the working mesh."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from skfmap._tools.types import BoolArray, FloatArray, IntArray, SparseMatrix

__all__ = ["Prolongation"]


@dataclass(frozen=True, eq=False, repr=False)
class Prolongation:
    """Where each vertex of a given mesh lies on the working mesh: a face, and a point of it.

    Attributes
    ----------
    face : ndarray of int32, shape (n_given,)
        Face of the working mesh; -1 where there is nothing to say, as on a piece that was left out.
    coordinates : ndarray of float32, shape (n_given, 2)
        Weights of the second and the third corner of that face; the first has the rest.

    Notes
    -----
    As a matrix, of shape (n_given, n_working), it has up to three entries in a row, which sum to 1,
    or none. It takes functions on the working mesh to the given one. Twelve bytes for each given
    vertex are kept; the matrix is made on demand.

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
        """Return places in twelve bytes each; coordinates of those without one do not matter."""
        known = np.where(face[:, None] >= 0, coordinates, 0.0)
        return cls(face.astype(np.int32), known.astype(np.float32))

    @classmethod
    def of_vertices(cls, vertex_map: IntArray, faces: IntArray) -> "Prolongation":
        """Return that of a mesh whose vertices were only renumbered or removed.

        Parameters
        ----------
        vertex_map : ndarray of int, shape (n_given,)
            Working vertex of each given one, -1 where it was removed.
        faces : ndarray of int, shape (n_faces, 3)
            Of the working mesh; every vertex has one.

        Returns
        -------
        Prolongation
            One entry in each row.
        """
        first = np.full(int(faces.max()) + 1, -1)
        corners = faces.ravel()[::-1]  # the first face that has a vertex is written last
        first[corners] = np.arange(faces.size)[::-1]
        at = np.where(vertex_map >= 0, first[vertex_map], -1)
        face, corner = np.where(at >= 0, at // 3, -1), at % 3
        coordinates = np.stack([corner == 1, corner == 2], axis=1) & (at >= 0)[:, None]
        return cls.packed(face, coordinates.astype(np.float64))

    def renumbered(self, vertex_map: IntArray) -> "Prolongation":
        """Return that of the mesh whose vertices ``vertex_map`` takes to the given ones here.

        ``vertex_map`` is -1 where a vertex was removed.
        """
        lost = vertex_map < 0
        face, coordinates = self.face[vertex_map], self.coordinates[vertex_map]
        face[lost], coordinates[lost] = -1, 0.0
        return Prolongation(face, coordinates)

    def __repr__(self) -> str:
        """Return a line with counts."""
        return f"Prolongation(n_given={len(self.face)}, n_placed={int(self.placed.sum())})"

    @property
    def placed(self) -> BoolArray:
        """Which given vertices have a place on the working mesh."""
        return np.asarray(self.face >= 0)

    @property
    def one_each(self) -> bool:
        """Whether every place is a vertex, as where a mesh was mended but not thinned."""
        return bool(np.isin(self.coordinates[self.placed], (0.0, 1.0)).all())

    def matrix(
        self, faces: IntArray, n_working: int, given: IntArray | None = None
    ) -> SparseMatrix:
        """Return the matrix, or some of its rows.

        Parameters
        ----------
        faces, n_working : ndarray of int, shape (n_faces, 3), int
            Faces and number of vertices of the working mesh.
        given : ndarray of int, optional
            Given vertices whose rows are wanted; all by default.

        Returns
        -------
        sparse array of shape (n_given, n_working)
            Rows sum to 1, or are empty.
        """
        face = self.face if given is None else self.face[given]
        coordinates = self.coordinates if given is None else self.coordinates[given]
        placed = np.flatnonzero(face >= 0)
        last_two = coordinates[placed].astype(np.float64)
        weights = np.column_stack([np.maximum(1 - last_two.sum(axis=1), 0.0), last_two])
        weights /= weights.sum(axis=1, keepdims=True)  # coordinates are in single precision
        rows = np.repeat(placed, 3)
        matrix = sp.coo_array(
            (weights.ravel(), (rows, faces[face[placed]].ravel())), shape=(len(face), n_working)
        ).tocsr()
        matrix.eliminate_zeros()
        return matrix

    def nearest_corner(self, faces: IntArray, given: IntArray | None = None) -> IntArray:
        """Return the working vertex of most weight for each given one; -1 where there is none."""
        face = self.face if given is None else self.face[given]
        coordinates = self.coordinates if given is None else self.coordinates[given]
        weights = np.column_stack([1 - coordinates.sum(axis=1), coordinates])
        corner = np.argmax(weights, axis=1)
        return np.where(face >= 0, faces[face, corner], -1).astype(np.int64)
