"""What answers on specimens that were left out say of answers to come."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = [
    "least_calibrating",
    "pooled_quantile",
    "scales_of_others",
    "shrunk_mean",
    "shrunk_scales",
]

# Specimens, beside those there are, to which nothing is lacking. With two references among twenty
# mandibles errors are 0.181 and 0.191 mm from nine left out, with 2 of these or none, and 0.192 and
# 0.203 from three, rather than 0.200 and 0.215. What James and Stein (1961) take off each landmark
# is too much: 0.187 and 0.195 from nine.
_NOTHING_LACKS = 2
# How many specimens the mean over all landmarks counts for, beside those that have a landmark.
_PRIOR = 4.0


def shrunk_mean(residuals: FloatArray) -> FloatArray:
    """Return the mean of vectors, with some more specimens of which all are zero.

    Parameters
    ----------
    residuals : ndarray of shape (n_specimens, n_landmarks, d)
        NaN where a specimen lacks a landmark.

    Returns
    -------
    ndarray of shape (n_landmarks, d)
        Zero where no specimen tells.

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
    """Return the mean distance of each landmark, drawn towards that of all of them.

    Parameters
    ----------
    distances : ndarray of shape (n_specimens, n_landmarks)
        NaN where a specimen lacks a landmark; not all of them.

    Returns
    -------
    ndarray of shape (n_landmarks,)
        Positive.

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

    Measured by scales that its own distances enter, a specimen looks nearer than one to come: balls
    that are to hold 0.9 hold 0.88 where they are told by nine specimens of 13 or 51 landmarks, and
    0.90 to 0.91 with the scales of the others.

    Parameters
    ----------
    distances : ndarray of shape (n_specimens, n_landmarks)
        NaN where a specimen lacks a landmark; two specimens at least have one.

    Returns
    -------
    ndarray of shape (n_specimens, n_landmarks)
        Positive.

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
    """Return by how much scales are to be multiplied to hold as many distances as wished.

    Distances over scales are pooled over landmarks, each specimen with the same weight; one more
    distance than there are, beyond all others, stands for the one to come.

    Parameters
    ----------
    distances : ndarray of shape (n_specimens, n_landmarks)
        NaN where a specimen lacks a landmark.
    scales : ndarray of shape (n_landmarks,) or (n_specimens, n_landmarks)
        Positive.
    coverage : float
        Between 0 and 1.

    Returns
    -------
    float
        Infinite if there are too few distances.

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
    # The one to come weighs as much as one landmark of one specimen.
    total = weights.sum() + weights[known].mean() if known.any() else 1.0
    reached = np.cumsum(weights[known][order]) / total
    at = int(np.searchsorted(reached, coverage - 1e-12))
    return float(scores[known][order][at]) if at < len(order) else float("inf")


def least_calibrating(coverage: float) -> int:
    """Return how many specimens it takes at least to promise a coverage.

    That many are exchangeable with the one to come: nine for 0.9, as of ten the largest is the one
    to come once in ten times.

    Examples
    --------
    >>> from skfmap.functional.left_out import least_calibrating
    >>> least_calibrating(0.9)
    9
    """
    return int(np.ceil(coverage / (1 - coverage) - 1e-9))
