"""Well-spread samples of the points of a shape."""

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.functional.neighbours import nearest

__all__ = ["areas_of_samples", "farthest_points"]

# Distances that differ by less than this fraction of the largest count as equal.
_ROUNDING = 1e-9


def farthest_points(points: FloatArray, n_samples: int) -> IntArray:
    """Return farthest-point samples, by Euclidean distance.

    The first sample is the point farthest from the centroid; each further one is farthest from the
    samples before it. Of points that are equally far up to rounding, the first is taken.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Points, usually vertices.
    n_samples : int
        Number of samples; all points are returned if there are fewer.

    Returns
    -------
    ndarray of int, shape (min(n_samples, n_points),)
        Rows of ``points``, in the order in which they were chosen.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional import farthest_points
    >>> farthest_points(np.array([[0.0], [1.0], [2.0], [9.0]]), 3).tolist()
    [3, 0, 2]
    """
    centred = points - points.mean(axis=0)
    distances = np.einsum("ij,ij->i", centred, centred)  # from the centre, for the first
    ones = np.ones(len(points))
    # The squared distances from a point are the product of its row with all columns.
    rows = np.column_stack([centred, distances, ones])
    columns = np.column_stack([-2 * centred, ones, distances]).T.copy()
    chosen = np.empty(min(n_samples, len(points)), dtype=np.int64)
    for number in range(len(chosen)):
        largest = distances.max()
        last = int((distances >= largest - _ROUNDING * abs(largest)).argmax())
        chosen[number] = last
        if number == 0:
            distances[:] = np.inf
        np.minimum(distances, rows[last] @ columns, out=distances)
        distances[last] = -1.0  # never chosen again, whatever the rounding
    return chosen


def areas_of_samples(points: FloatArray, areas: FloatArray, samples: IntArray) -> FloatArray:
    """Return, for each sample, the total area of the points nearest to it.

    Parameters
    ----------
    points, areas : ndarray of shape (n_points, 3), ndarray of shape (n_points,)
        Vertices and their areas.
    samples : ndarray of int, shape (n_samples,)
        Rows of ``points``.

    Returns
    -------
    ndarray of shape (n_samples,)
        Areas; their sum is the sum of ``areas``.
    """
    owners = nearest(points, points[samples])
    return np.asarray(np.bincount(owners, areas, minlength=len(samples)), dtype=np.float64)
