"""Functional maps from known correspondences."""

from dataclasses import dataclass

import numpy as np

from skfmap._typing import FloatArray

__all__ = ["GroundTruth", "map_from_pairs"]

# Below this eigenvalue of the sampled Gram matrix (the identity for a full map), a function counts as not observed.
_OBSERVED = 0.1
# The same for the functions on S_0, whose areas the map may shrink; nil where whole parts stand on one point.
_REACHED = 1e-3
# Strengths of the isometric prior that are tried where pairs are few or leave functions undetermined.
_STRENGTHS = tuple(np.geomspace(1e-4, 1.0, 9))
# Distinct pairs per function beyond which no prior is needed.
_PLENTY = 8
_MOST_LEVERAGE = 0.99


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

    Where pairs are few (below eight per function) or leave functions on S_i undetermined (a partial correspondence), a
    pull towards maps that commute with the Laplacian helps. Its strength is the one that best predicts pairs left out
    one at a time; ``n_observed`` tells what the pairs alone determine.

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
    if n_observed == len(gram) and len(np.unique(evecs_i, axis=0)) > _PLENTY * len(gram):
        return GroundTruth(np.asarray(np.linalg.solve(gram, rhs)), n_observed)
    penalties = mask**2 + 1e-6
    strengths = (0.0, *_STRENGTHS) if n_observed == len(gram) else _STRENGTHS
    trials = [_with_prior(evecs_i, evecs_0, areas, gram, rhs, strength * penalties) for strength in strengths]
    return GroundTruth(trials[int(np.argmin([error for _, error in trials]))][0], n_observed)


def _with_prior(
    evecs_i: FloatArray, evecs_0: FloatArray, areas: FloatArray, gram: FloatArray, rhs: FloatArray, penalty: FloatArray
) -> tuple[FloatArray, float]:
    """Return the map under a prior, and its mean squared error at pairs that are left out one at a time."""
    C, error = np.empty_like(gram), 0.0
    for column, diagonal in enumerate(penalty.T):
        inverse = np.linalg.inv(gram + np.diag(diagonal))
        C[:, column] = inverse @ rhs[:, column]
        leverage = areas * np.einsum("qi,ij,qj->q", evecs_i, inverse, evecs_i, optimize=True)
        residuals = (evecs_i @ C[:, column] - evecs_0[:, column]) / (1 - np.minimum(leverage, _MOST_LEVERAGE))
        error += float(areas @ residuals**2)
    return C, error


def _rank(gram: FloatArray, threshold: float) -> int:
    return int((np.linalg.eigvalsh(gram) > threshold).sum())


def _target_gram(evecs_i: FloatArray, evecs_0: FloatArray, areas: FloatArray) -> FloatArray:
    """Return the Gram matrix of the functions on S_0 as the points of S_i see them, averaged over a point's pairs."""
    _, inverse = np.unique(evecs_i, axis=0, return_inverse=True)
    area = np.bincount(inverse.ravel(), areas)
    sums = np.stack([np.bincount(inverse.ravel(), areas * column) for column in evecs_0.T], axis=1)
    average = sums / np.maximum(area, 1e-300)[:, None]
    return np.asarray(average.T @ (area[:, None] * average))
