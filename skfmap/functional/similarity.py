"""Similarity transformations between paired points, and whether they need a reflection."""

from typing import NamedTuple

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = [
    "MIRROR",
    "STIFF",
    "TELLING",
    "Similarity",
    "best_similarity",
    "left_by_similarities",
    "side_of",
]

# Shapes count as rigid if the residual of the best similarity, as a fraction of the sum of squares,
# is at most STIFF; judging it takes at least TELLING points, because a similarity fits any three
# points. The residual between landmarks of any two of twenty mandibles or eleven skulls is at most
# 0.006, that between cats 0.2 in the median.
STIFF, TELLING = 0.02, 6
# The side is known if the residuals with and without a reflection differ by this factor. Mandibles
# are nearly flat: their residual with a reflection is 0.0133 or more, at least 3.6 times the
# residual without one. The rule fails for bodies that bend: between people the residual with a
# reflection is 0.048, and between four-legged animals 0.76 of the residual without one.
_TIMES = 2.0
# The reflection of the first coordinate, which is left to right in the coordinates of scanners.
MIRROR = np.array([-1.0, 1.0, 1.0])


class Similarity(NamedTuple):
    """Similarity transformation of row vectors x to ``scale * x @ rotation + shift``.

    Attributes
    ----------
    scale : float
        Scale factor, positive.
    rotation : ndarray of shape (3, 3)
        Proper rotation.
    shift : ndarray of shape (3,)
        Translation.
    """

    scale: float
    rotation: FloatArray
    shift: FloatArray

    def apply(self, points: FloatArray) -> FloatArray:
        """Return the transformed points, shape (n, 3)."""
        return np.asarray(self.scale * points @ self.rotation + self.shift)


def best_similarity(points: FloatArray, onto: FloatArray, weights: FloatArray) -> Similarity:
    """Return the least-squares similarity from points to their counterparts (Umeyama 1991).

    Parameters
    ----------
    points, onto : ndarray of shape (n, 3)
        Paired points; ``points`` are moved.
    weights : ndarray of shape (n,)
        Weight of each pair; not all of them 0.

    Returns
    -------
    Similarity
        The similarity without a reflection whose weighted sum of squares is smallest.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional.similarity import best_similarity
    >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
    >>> found = best_similarity(points, 2 * points[:, [1, 2, 0]] + 1, np.ones(4))
    >>> round(found.scale, 6), np.round(found.shift, 6).tolist()
    (2.0, [1.0, 1.0, 1.0])
    """
    share = weights / weights.sum()
    centre, centre_onto = share @ points, share @ onto
    a, b = points - centre, onto - centre_onto
    U, s, Vt = np.linalg.svd((a * share[:, None]).T @ b)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    rotation = (U * signs) @ Vt
    size = max(float(share @ np.square(a).sum(axis=1)), 1e-300)
    scale = max(float(s @ signs) / size, 1e-12)
    return Similarity(scale, rotation, centre_onto - scale * centre @ rotation)


def left_by_similarities(
    points: FloatArray, points_0: FloatArray, weights: FloatArray
) -> tuple[float, float]:
    """Return the residuals of the best similarities, without and with a reflection.

    Orthogonal Procrustes analysis gives both; each has a rotation, a translation and a scale.

    Parameters
    ----------
    points, points_0 : ndarray of shape (n_pairs, 3)
        Paired points.
    weights : ndarray of shape (n_pairs,)
        Weight of each pair; not all of them 0.

    Returns
    -------
    rotated, reflected : float
        Residual sums of squares, as a fraction of the sum of squares about the centroid: from 0,
        if the two sets are similar, to 1. Both are 1 if all points of a set coincide.

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


def side_of(rotated: float, reflected: float) -> int | None:
    """Return -1 if points are mirrored, 1 if they are not, and None if this cannot be decided.

    Parameters
    ----------
    rotated, reflected : float
        Residuals, from `left_by_similarities`.

    Examples
    --------
    >>> from skfmap.functional.similarity import side_of
    >>> side_of(0.015, 0.004), side_of(0.001, 0.4), side_of(0.004, 0.005), side_of(0.8, 0.3)
    (-1, 1, None, None)
    """
    less, more = sorted((rotated, reflected))
    if less > STIFF or more < max(_TIMES * less, 1e-9):
        return None
    return 1 if rotated < reflected else -1
