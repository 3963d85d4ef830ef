"""Estimates of future errors from the errors on specimens that were left out."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = [
    "least_calibrating",
    "pooled_quantile",
    "scales_of_others",
    "shrunk_mean",
    "shrunk_scales",
]

# Number of additional specimens with a residual of zero. With two references among twenty mandibles
# the errors are 0.181 and 0.191 mm from nine left out (with 2 of these or none), and 0.192 and
# 0.203 from three, rather than 0.200 and 0.215. James and Stein's (1961) shrinkage of each landmark
# is too strong: 0.187 and 0.195 from nine.
_NOTHING_LACKS = 2
# The mean over all landmarks counts as this many specimens, in addition to those that have the
# landmark.
_PRIOR = 4.0


def shrunk_mean(residuals: FloatArray) -> FloatArray:
    """Return the mean residual of each landmark, shrunk towards zero.

    The mean includes two additional specimens whose residuals are zero.

    Parameters
    ----------
    residuals : ndarray of shape (n_specimens, n_landmarks, d)
        Residual vectors; NaN where a specimen lacks a landmark.

    Returns
    -------
    ndarray of shape (n_landmarks, d)
        Means; zero for a landmark that no specimen has.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional.left_out import shrunk_mean
    >>> shrunk_mean(np.array([[[1.0, 0]]] * 8)).tolist()
    [[0.8, 0.0]]
    """
    known = np.asarray(np.isfinite(residuals).all(axis=2))
    sums = np.where(known[:, :, None], residuals, 0.0).sum(axis=0)
    return np.asarray(sums / (known.sum(axis=0) + _NOTHING_LACKS)[:, None])


def shrunk_scales(distances: FloatArray) -> FloatArray:
    """Return the mean distance of each landmark, shrunk towards the mean over all landmarks.

    Parameters
    ----------
    distances : ndarray of shape (n_specimens, n_landmarks)
        Distances; NaN where a specimen lacks a landmark. At least one must be known.

    Returns
    -------
    ndarray of shape (n_landmarks,)
        Scales, positive.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional.left_out import shrunk_scales
    >>> shrunk_scales(np.array([[1.0, 3.0]] * 4)).tolist()
    [1.5, 2.5]
    """
    known = np.isfinite(distances)
    overall = float(distances[known].mean())
    sums = np.where(known, distances, 0.0).sum(axis=0)
    scales = (sums + _PRIOR * overall) / (known.sum(axis=0) + _PRIOR)
    return np.asarray(np.maximum(scales, np.finfo(np.float64).tiny))


def scales_of_others(distances: FloatArray) -> FloatArray:
    """Return, for each specimen, the `shrunk_scales` of the others.

    Scales that include a specimen's own distances make it look more accurate than a new one: with
    nine specimens of 13 or 51 landmarks, balls meant to cover 0.9 cover 0.88, but 0.90 to 0.91 with
    the scales of the others.

    Parameters
    ----------
    distances : ndarray of shape (n_specimens, n_landmarks)
        Distances; NaN where a specimen lacks a landmark. At least two specimens must have one.

    Returns
    -------
    ndarray of shape (n_specimens, n_landmarks)
        Scales, positive.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional.left_out import scales_of_others
    >>> scales_of_others(np.array([[1.0], [3.0], [5.0]])).tolist()
    [[4.0], [3.0], [2.0]]
    """
    rows = range(len(distances))
    return np.stack([shrunk_scales(np.delete(distances, row, axis=0)) for row in rows])


def pooled_quantile(distances: FloatArray, scales: FloatArray, coverage: float) -> float:
    """Return the factor by which to multiply the scales so that they cover a share of distances.

    Ratios of distances to scales are pooled over landmarks, and each specimen has the same weight.
    One additional ratio, larger than all others, represents the new specimen.

    Parameters
    ----------
    distances : ndarray of shape (n_specimens, n_landmarks)
        Distances; NaN where a specimen lacks a landmark.
    scales : ndarray of shape (n_landmarks,) or (n_specimens, n_landmarks)
        Scales, positive.
    coverage : float
        Share to cover, between 0 and 1.

    Returns
    -------
    float
        The factor; infinite if there are too few distances.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional.left_out import pooled_quantile
    >>> pooled_quantile(np.arange(1.0, 10)[:, None], np.ones(1), 0.9)
    9.0
    >>> pooled_quantile(np.arange(1.0, 9)[:, None], np.ones(1), 0.9)
    inf
    """
    scores = distances / scales
    known = np.isfinite(scores)
    weights = known / np.maximum(known.sum(axis=1), 1)[:, None]
    order = np.argsort(scores[known])
    # The additional ratio weighs as much as one landmark of one specimen.
    total = weights.sum() + weights[known].mean() if known.any() else 1.0
    reached = np.cumsum(weights[known][order]) / total
    at = int(np.searchsorted(reached, coverage - 1e-12))
    return float(scores[known][order][at]) if at < len(order) else float("inf")


def least_calibrating(coverage: float) -> int:
    """Return the minimum number of specimens that a coverage can be promised from.

    The specimens are exchangeable with the new one. For 0.9 it takes nine: among ten, the new one
    has the largest error once in ten times.

    Examples
    --------
    >>> from skfmap.functional.left_out import least_calibrating
    >>> least_calibrating(0.9)
    9
    """
    return int(np.ceil(coverage / (1 - coverage) - 1e-9))
