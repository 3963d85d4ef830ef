"""Places on the faces of a mesh; vertices are a special case."""

from typing import NamedTuple

import numpy as np

from skfmap._tools.types import FloatArray, IntArray

__all__ = ["SurfacePlaces"]


class SurfacePlaces(NamedTuple):
    """Places on the faces of a mesh.

    Attributes
    ----------
    corners : ndarray of int, shape (n, 3)
        Vertices of the face that each place lies on.
    weights : ndarray of shape (n, 3)
        Weights of the corners, non-negative with sum 1.

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
        """Return places at vertices."""
        corners = np.repeat(np.asarray(vertices)[:, None], 3, axis=1)
        return cls(corners, np.tile([1.0, 0.0, 0.0], (len(corners), 1)))

    @property
    def vertices(self) -> IntArray:
        """Corner with the largest weight of each place, of shape (n,)."""
        most = self.weights.argmax(axis=1)
        return np.asarray(np.take_along_axis(self.corners, most[:, None], axis=1)[:, 0])

    def take(self, rows: IntArray) -> "SurfacePlaces":
        """Return the places selected by row indices or a mask."""
        return SurfacePlaces(self.corners[rows], self.weights[rows])

    def means(self, values: FloatArray) -> FloatArray:
        """Return weighted means over corners, of shape (n, n_columns).

        ``values`` has shape (3 n, n_columns): the values at the corners, place by place.
        """
        by_corner = values.reshape(*self.corners.shape, -1)
        return np.asarray(np.einsum("nc,ncd->nd", self.weights, by_corner))
