"""Functional maps from known correspondences."""

from dataclasses import dataclass

import numpy as np

from skfmap._typing import FloatArray

__all__ = ["GroundTruth", "map_from_pairs"]

# Below this eigenvalue of the sampled Gram matrix (the identity for a full map), a function counts as not observed.
_OBSERVED = 0.1
# The same for the functions on S_0, whose areas the map may shrink; nil where whole parts stand on one point.
_REACHED = 1e-3
# Strength of the isometric prior on what the pairs do not determine.
_PRIOR = 1e-2


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """A functional map fitted to pairs.

    Attributes
    ----------
    C : ndarray of shape (k, k)
        Pulls functions on S_0 back to S_i.
    n_observed : int
        How many of the k functions the pairs determine, on S_i or on S_0, whichever is less; k for a full
        correspondence.
    """

    C: FloatArray
    n_observed: int


def map_from_pairs(evecs_i: FloatArray, evecs_0: FloatArray, areas: FloatArray, mask: FloatArray) -> GroundTruth:
    r"""Fit C to pairs of points by mass-weighted least squares.

    .. math:: \min_C \sum_q a_q \|\Phi_i(x_q)\, C - \Phi_0(T x_q)\|^2

    Where the pairs leave functions on S_i undetermined (a partial correspondence), a slight pull towards maps that
    commute with the Laplacian decides, and ``n_observed`` tells.

    Parameters
    ----------
    evecs_i, evecs_0 : ndarray of shape (n_pairs, k)
        Eigenfunctions at the paired points of S_i and S_0.
    areas : ndarray of shape (n_pairs,)
        Area on S_i that each pair stands for; sums to 1 for a full correspondence.
    mask : ndarray of shape (k, k)
        W of the regulariser; used only where the pairs do not decide.

    Returns
    -------
    GroundTruth
        The map, and how much of it is observed.
    """
    weighted = areas[:, None] * evecs_i
    gram, rhs = weighted.T @ evecs_i, weighted.T @ evecs_0
    n_observed = min(_rank(gram, _OBSERVED), _rank(_target_gram(evecs_i, evecs_0, areas), _REACHED))
    if n_observed == len(gram):
        return GroundTruth(np.asarray(np.linalg.solve(gram, rhs)), n_observed)
    systems = gram + _PRIOR * (mask.T[:, :, None] ** 2 + 1e-6) * np.eye(len(gram))
    columns = np.linalg.solve(systems, rhs.T[:, :, None])
    return GroundTruth(np.ascontiguousarray(columns[:, :, 0].T), n_observed)


def _rank(gram: FloatArray, threshold: float) -> int:
    return int((np.linalg.eigvalsh(gram) > threshold).sum())


def _target_gram(evecs_i: FloatArray, evecs_0: FloatArray, areas: FloatArray) -> FloatArray:
    """Return the Gram matrix of the functions on S_0 as the points of S_i see them, averaged over a point's pairs."""
    _, inverse = np.unique(evecs_i, axis=0, return_inverse=True)
    area = np.bincount(inverse.ravel(), areas)
    sums = np.stack([np.bincount(inverse.ravel(), areas * column) for column in evecs_0.T], axis=1)
    average = sums / np.maximum(area, 1e-300)[:, None]
    return np.asarray(average.T @ (area[:, None] * average))
