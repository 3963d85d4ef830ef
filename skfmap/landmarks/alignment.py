"""Alignment of specimens with their mean."""

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import FloatArray
from skfmap.functional.similarity import best_similarity
from skfmap.landmarks.tables import as_stack

__all__ = ["align_landmarks"]

# The alignment ends when the mean moves by less than this fraction of its size, or after this many
# rounds.
_TOL, _MOST_ROUNDS = 1e-10, 200
# Minimum number of points to rotate one specimen onto another.
_FEWEST = 3


def align_landmarks(array: npt.ArrayLike, *, scale: bool = False) -> FloatArray:
    """Return specimens rotated and translated onto their mean (generalised Procrustes analysis).

    Scanned specimens have arbitrary positions; after alignment they can be compared point by point.
    The exported table is never aligned.

    Parameters
    ----------
    array : array-like of shape (n_specimens, n_landmarks, 3)
        Landmarks, from `stack_landmarks`.
    scale : bool, default=False
        Whether specimens are scaled to centroid size 1 first. Otherwise size is kept.

    Returns
    -------
    ndarray of shape (n_specimens, n_landmarks, 3)
        Aligned specimens. They are oriented like the first of the specimens with the most
        landmarks, and the centroid of the mean is at the origin. Missing landmarks are ignored, and
        stay NaN.

    Raises
    ------
    ValueError
        If a specimen has fewer than three landmarks.

    See Also
    --------
    skfmap.shape_space.ShapeSpace : Mean and modes of specimens without missing landmarks.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.landmarks import align_landmarks
    >>> one = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
    >>> turned = one[:, [1, 2, 0]] + 5
    >>> aligned = align_landmarks([one, turned])
    >>> bool(np.allclose(aligned[0], aligned[1]))
    True
    """
    points = as_stack(array)
    there = ~np.isnan(points[:, :, 0])
    if (there.sum(axis=1) < _FEWEST).any():
        few = int(np.argmax(there.sum(axis=1) < _FEWEST))
        raise ValueError(
            f"Specimen {few} has {int(there[few].sum())} landmarks, but alignment takes at least "
            f"{_FEWEST}. Leave it out."
        )
    if scale:
        points = np.array([_of_unit_size(one) for one in points])
    mean = _centred(points[np.argmax(there.sum(axis=1))])
    for _ in range(_MOST_ROUNDS):
        aligned = np.array([_turned(one, mean) for one in points])
        before, mean = mean, _centred(_mean(aligned))
        moved = np.nansum(np.square(mean - before))
        if moved <= _TOL**2 * np.nansum(np.square(mean)):
            break
    return np.array([_turned(one, mean) for one in points])


def _turned(points: FloatArray, mean: FloatArray) -> FloatArray:
    """Return points, rotated and translated so that those in the mean are closest to it."""
    both = ~np.isnan(points[:, 0]) & ~np.isnan(mean[:, 0])
    weights = both / both.sum()
    known, onto = np.nan_to_num(points), np.nan_to_num(mean)
    rotation = best_similarity(known, onto, weights).rotation
    return (points - weights @ known) @ rotation + weights @ onto


def _mean(aligned: FloatArray) -> FloatArray:
    """Return the mean of each landmark over the specimens that have it, NaN if none has."""
    counts = (~np.isnan(aligned[:, :, :1])).sum(axis=0)
    sums = np.nansum(aligned, axis=0)
    return np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0)


def _centred(points: FloatArray) -> FloatArray:
    return np.asarray(points - np.nanmean(points, axis=0))


def _of_unit_size(points: FloatArray) -> FloatArray:
    size = float(np.sqrt(np.nansum(np.square(_centred(points)))))
    if size == 0:
        raise ValueError("All landmarks of a specimen coincide, so it has no size; leave it out.")
    return points / size
