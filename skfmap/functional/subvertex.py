"""Matches between the vertices of S_0: the nearest point of a triangle, in any dimension."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["nearest_on_triangles"]

# Squared sine of a corner's angle. Below it, twelve of sixteen digits of the determinant are
# rounding, and all of the triangle is within 1e-6 of its length of its edges, which are searched
# too.
_FLAT = 1e-12


def nearest_on_triangles(points: FloatArray, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return where on its triangle each point is nearest.

    Parameters
    ----------
    points : ndarray of shape (n, d)
        Points of an embedding.
    corners : ndarray of shape (n, 3, d)
        Corners of one triangle for each point; degenerate ones are allowed.

    Returns
    -------
    barycentric : ndarray of shape (n, 3)
        Coordinates of the nearest point, non-negative, summing to 1.
    squared : ndarray of shape (n,)
        Squared distance to it.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional import nearest_on_triangles
    >>> corners = np.array([[[0.0, 0], [1, 0], [0, 1]]])
    >>> nearest_on_triangles(np.array([[1.0, 1.0]]), corners)[0].tolist()
    [[0.0, 0.5, 0.5]]
    """
    candidates = [_inside(points, corners)]
    candidates += [_on_edge(points, corners, a, b) for a, b in ((0, 1), (1, 2), (2, 0))]
    squared = np.stack([_squared_distance(points, corners, c) for c in candidates])
    best = np.argmin(squared, axis=0)
    rows = np.arange(len(points))
    return np.stack(candidates)[best, rows], squared[best, rows]


def _squared_distance(
    points: FloatArray, corners: FloatArray, barycentric: FloatArray
) -> FloatArray:
    return np.asarray(np.square(np.einsum("nc,ncd->nd", barycentric, corners) - points).sum(axis=1))


def _on_edge(points: FloatArray, corners: FloatArray, a: int, b: int) -> FloatArray:
    """Return the nearest point of the edge from corner a to corner b."""
    edge = corners[:, b] - corners[:, a]
    length = np.square(edge).sum(axis=1)
    along = ((points - corners[:, a]) * edge).sum(axis=1) / np.where(length > 0, length, 1.0)
    out = np.zeros((len(points), 3))
    out[:, b] = np.clip(along, 0.0, 1.0)
    out[:, a] = 1.0 - out[:, b]
    return out


def _inside(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the foot of the point on the triangle's plane; the first corner if it lies outside."""
    u, v, w = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    uu, uv, vv = (u * u).sum(axis=1), (u * v).sum(axis=1), (v * v).sum(axis=1)
    uw, vw = (u * w).sum(axis=1), (v * w).sum(axis=1)
    determinant = uu * vv - uv**2
    usable = determinant > _FLAT * uu * vv
    scale = np.where(usable, determinant, 1.0)
    second, third = (vv * uw - uv * vw) / scale, (uu * vw - uv * uw) / scale
    feet = np.stack([1 - second - third, second, third], axis=1)
    return np.where((usable & (feet >= 0).all(axis=1))[:, None], feet, [1.0, 0.0, 0.0])
