"""Places on the faces of a mesh, of which vertices are a special case."""

from typing import NamedTuple

import numpy as np

from skfmap._tools.types import FloatArray, IntArray

__all__ = ["SurfacePlaces"]


class SurfacePlaces(NamedTuple):
    """Places on the faces of a mesh.

    Attributes
    ----------
    corners : ndarray of int, shape (n, 3)
        Vertices of the face that each place is in.
    weights : ndarray of shape (n, 3)
        Of the corners: not negative, and 1 together.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.shapes import SurfacePlaces
    >>> places = SurfacePlaces(np.array([[4, 7, 9]]), np.array([[0.2, 0.5, 0.3]]))
    >>> places.vertices.tolist()
    [7]
    """

    corners: IntArray
    weights: FloatArray

    @classmethod
    def at_vertices(cls, vertices: IntArray) -> "SurfacePlaces":
        """Return the places of vertices."""
        corners = np.repeat(np.asarray(vertices)[:, None], 3, axis=1)
        return cls(corners, np.tile([1.0, 0.0, 0.0], (len(corners), 1)))

    @property
    def vertices(self) -> IntArray:
        """The corner of most weight of each place, shape (n,)."""
        most = self.weights.argmax(axis=1)
        return np.asarray(np.take_along_axis(self.corners, most[:, None], axis=1)[:, 0])

    def take(self, rows: IntArray) -> "SurfacePlaces":
        """Return some of the places, by their numbers or a mask."""
        return SurfacePlaces(self.corners[rows], self.weights[rows])

    def means(self, values: FloatArray) -> FloatArray:
        """Return means over corners, shape (n, n_columns), of values of shape (3 n, n_columns)."""
        by_corner = values.reshape(*self.corners.shape, -1)
        return np.asarray(np.einsum("nc,ncd->nd", self.weights, by_corner))
