"""Similarities between paired points, and whether they need a reflection."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["left_by_similarities"]


def left_by_similarities(
    points: FloatArray, points_0: FloatArray, weights: FloatArray
) -> tuple[float, float]:
    """Return what the best similarity, and the best one with a reflection, leave of paired points.

    By orthogonal Procrustes analysis: both have a rotation, a translation and a scale.

    Parameters
    ----------
    points, points_0 : ndarray of shape (n_pairs, 3)
        Paired points.
    weights : ndarray of shape (n_pairs,)
        How much each pair counts; not all of them 0.

    Returns
    -------
    rotated, reflected : float
        Sum of squares that is left, as a share of that about the centroid: from 0, where the points
        of one set are those of the other, to 1. Both are 1 where all points of a set are one.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional.similarity import left_by_similarities
    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
    >>> rotated, reflected = left_by_similarities(points, points * [-1, 1, 1], np.ones(4))
    >>> reflected < 1e-12 < rotated
    True
    """
    share = weights / weights.sum()
    a, b = points - share @ points, points_0 - share @ points_0
    size = float(share @ np.square(a).sum(axis=1)) * float(share @ np.square(b).sum(axis=1))
    if size <= 0:
        return 1.0, 1.0
    cross = (a * share[:, None]).T @ b
    s1, s2, s3 = np.linalg.svd(cross, compute_uv=False)
    side = -s3 if np.linalg.det(cross) < 0 else s3
    rotated, reflected = (max(0.0, float(1 - (s1 + s2 + s) ** 2 / size)) for s in (side, -side))
    return rotated, reflected
