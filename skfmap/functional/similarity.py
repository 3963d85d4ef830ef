"""Similarities between paired points, and whether they need a reflection."""

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

# Up to which what a similarity leaves, as a share of squares, is that of stiff shapes, and points
# that it takes to tell. Between landmarks of any two of twenty mandibles or eleven skulls 0.006 is
# left at most, between cats 0.2 in the median; three points of anything are explained.
STIFF, TELLING = 0.02, 6
# How much less one of two similarities leaves, with a reflection and without, that tells the side.
# Mandibles are nearly flat: with a reflection they leave 0.0133 and more, 3.6 times as much at
# least. Bodies that bend cannot be told so: between people 0.048 is left with one, and between
# four-legged animals 0.76 of what is left without one.
_TIMES = 2.0
# The reflection: of the first coordinate, which runs from side to side in scanners' coordinates.
MIRROR = np.array([-1.0, 1.0, 1.0])


class Similarity(NamedTuple):
    """A scale, a rotation and a shift: points x, as rows, go to ``scale * x @ rotation + shift``.

    Attributes
    ----------
    scale : float
        Above 0.
    rotation : ndarray of shape (3, 3)
        Proper.
    shift : ndarray of shape (3,)
        Where the origin goes.
    """

    scale: float
    rotation: FloatArray
    shift: FloatArray

    def apply(self, points: FloatArray) -> FloatArray:
        """Return where points go, shape (n, 3)."""
        return np.asarray(self.scale * points @ self.rotation + self.shift)


def best_similarity(points: FloatArray, onto: FloatArray, weights: FloatArray) -> Similarity:
    """Return the similarity that takes points nearest to others (Umeyama 1991).

    Parameters
    ----------
    points, onto : ndarray of shape (n, 3)
        Paired points; the first are moved.
    weights : ndarray of shape (n,)
        How much each pair counts; not all of them 0.

    Returns
    -------
    Similarity
        Without a reflection, of least weighted sum of squares.

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


def side_of(rotated: float, reflected: float) -> int | None:
    """Return -1 where points are mirrored, 1 where they are not, and None where they do not tell.

    Parameters
    ----------
    rotated, reflected : float
        What is left of the points; from `left_by_similarities`.

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
