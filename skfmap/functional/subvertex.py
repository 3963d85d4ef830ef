"""Nearest points on triangles in any dimension, for matches to places between vertices of S_0."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["nearest_by_lengths", "nearest_on_triangles", "squared_edges"]

# Squared sine of a corner's angle below which a triangle counts as flat: twelve of sixteen digits
# of the determinant are then rounding errors, and every point of the triangle is within 1e-6 of its
# length of the edges, which are searched too.
_FLAT = 1e-12


def nearest_on_triangles(points: FloatArray, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the nearest point of one triangle for each point.

    Parameters
    ----------
    points : ndarray of shape (n, d)
        Points of an embedding.
    corners : ndarray of shape (n, 3, d)
        Corners of one triangle for each point; degenerate ones are allowed.

    Returns
    -------
    barycentric : ndarray of shape (n, 3)
        Barycentric coordinates of the nearest point, non-negative and summing to 1.
    squared : ndarray of shape (n,)
        Squared distance to the nearest point.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional import nearest_on_triangles
    >>> corners = np.array([[[0.0, 0], [1, 0], [0, 1]]])
    >>> nearest_on_triangles(np.array([[1.0, 1.0]]), corners)[0].tolist()
    [[0.0, 0.5, 0.5]]
    """
    to_corners = np.square(points[:, None] - corners).sum(axis=2)
    return nearest_by_lengths(to_corners, squared_edges(corners))


def squared_edges(corners: FloatArray) -> FloatArray:
    """Return the squared lengths of the edges 0-1, 1-2 and 2-0 of each triangle."""
    return np.asarray(np.square(corners - np.roll(corners, -1, axis=1)).sum(axis=2))


def nearest_by_lengths(to_corners: FloatArray, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the nearest point of one triangle for each point, from lengths alone.

    In many dimensions the lengths take most of the time, and neighbouring triangles share most of
    them.

    Parameters
    ----------
    to_corners : ndarray of shape (n, 3)
        Squared distances of each point to the corners of its triangle.
    edges : ndarray of shape (n, 3)
        Squared lengths of its edges, from `squared_edges`.

    Returns
    -------
    barycentric, squared : ndarray of shape (n, 3), ndarray of shape (n,)
        As in `nearest_on_triangles`.
    """
    candidates = [_inside(to_corners, edges)]
    candidates += [_on_edge(to_corners, edges, a) for a in range(3)]
    squared = np.stack([_squared_distance(to_corners, edges, c) for c in candidates])
    best = np.argmin(squared, axis=0)
    rows = np.arange(len(to_corners))
    return np.stack(candidates)[best, rows], squared[best, rows]


def _squared_distance(
    to_corners: FloatArray, edges: FloatArray, barycentric: FloatArray
) -> FloatArray:
    """Return squared distances by the parallel axis theorem."""
    products = barycentric * np.roll(barycentric, -1, axis=1)
    squared = (barycentric * to_corners).sum(axis=1) - (products * edges).sum(axis=1)
    return np.asarray(np.maximum(squared, 0.0))


def _on_edge(to_corners: FloatArray, edges: FloatArray, a: int) -> FloatArray:
    """Return the nearest point of the edge from corner ``a`` to the next corner."""
    b, length = (a + 1) % 3, edges[:, a]
    along = (to_corners[:, a] + length - to_corners[:, b]) / 2
    out = np.zeros_like(edges)
    out[:, b] = np.clip(along / np.where(length > 0, length, 1.0), 0.0, 1.0)
    out[:, a] = 1.0 - out[:, b]
    return out


def _inside(to_corners: FloatArray, edges: FloatArray) -> FloatArray:
    """Return the projection onto the triangle's plane, or the first corner if it is outside.

    With u and v from the first corner to the others, and w to the point, each inner product is half
    of the sum of two squared lengths minus the third.
    """
    (a, b, c), (uu, third_side, vv) = to_corners.T, edges.T
    uv, uw, vw = (uu + vv - third_side) / 2, (a + uu - b) / 2, (a + vv - c) / 2
    determinant = uu * vv - uv**2
    usable = determinant > _FLAT * uu * vv
    scale = np.where(usable, determinant, 1.0)
    second, third = (vv * uw - uv * vw) / scale, (uu * vw - uv * uw) / scale
    feet = np.stack([1 - second - third, second, third], axis=1)
    return np.where((usable & (feet >= 0).all(axis=1))[:, None], feet, [1.0, 0.0, 0.0])
