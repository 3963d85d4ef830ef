"""Well-spread points of a shape that stand for all, where a part of them is enough."""

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.functional.neighbours import nearest

__all__ = ["areas_of_samples", "farthest_points"]

# Share of the largest distance within which distances are equal.
_ROUNDING = 1e-9


def farthest_points(points: FloatArray, n_samples: int) -> IntArray:
    """Return points each of which is farthest from those before it, in space.

    The first is farthest from the centre of all; of points that are as far but for rounding, the
    first is taken.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        Vertices.
    n_samples : int
        How many; all if there are no more.

    Returns
    -------
    ndarray of int, shape (min(n_samples, n_points),)
        Rows of ``points``, in the order in which they were found.

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
    # Squared distances from a point are the product of all rows with one of its own.
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
        distances[last] = -1.0  # no rounding brings it back
    return chosen


def areas_of_samples(points: FloatArray, areas: FloatArray, samples: IntArray) -> FloatArray:
    """Return the area of all points that are nearest to each sample.

    Parameters
    ----------
    points, areas : ndarray of shape (n_points, 3), ndarray of shape (n_points,)
        Vertices and their areas.
    samples : ndarray of int, shape (n_samples,)
        Rows of ``points``.

    Returns
    -------
    ndarray of shape (n_samples,)
        With the sum of ``areas``.
    """
    owners = nearest(points, points[samples])
    return np.asarray(np.bincount(owners, areas, minlength=len(samples)), dtype=np.float64)
