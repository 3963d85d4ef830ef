"""Functional maps from known correspondences."""

from dataclasses import dataclass

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["GroundTruth", "map_from_pairs"]

# The figures below are of TOSCA's cats, 50 functions, unless they say otherwise.
#
# Below this eigenvalue of the sampled Gram matrix (the identity for a full map), a function
# counts as not observed. All pairs leave 0.93 and more (up to 120 functions), two well-spread
# landmarks per function 0.34, 1.2 landmarks 0.03.
_OBSERVED = 0.1
# The same for the functions on S_0, whose areas the map may shrink: all pairs leave 0.23 and more;
# where whole parts stand on one point it is nil.
_REACHED = 1e-3
# Strengths of the isometric prior that are tried. Left-out errors hold what the cut to k
# functions costs, and so ask for too much: up to 16 landmarks per function the choice is the
# upper end. With a higher one it would be 10 at 2 landmarks (relative error of C 0.18, not 0.14)
# and 3 at 4 (0.11, not 0.09); only at 1.2 landmarks would that be better (0.24, not 0.31).
_STRENGTHS = tuple(np.geomspace(1e-4, 1.0, 9))
# Distinct pairs per function beyond which no prior is used: it does harm. Relative errors of C
# with and without it at 1.2, 2, 4, 8 and 16 landmarks: 0.31, 0.14, 0.086, 0.061, 0.053 and 0.58,
# 0.16, 0.089, 0.051, 0.037.
_PLENTY = 8
# Added to W * W of the prior, so that its diagonal counts at all; from 0 to 1e-4 the map is the
# same.
_PRIOR_FLOOR = 1e-6
# A residual is enlarged 100 times at most, as 1 / (1 - leverage) is infinite for a pair that alone
# decides; with two landmarks per function every cap from 0.5 on leads to the same choice.
_MOST_LEVERAGE = 0.99


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """A functional map fitted to pairs.

    Attributes
    ----------
    C : ndarray of shape (k, k)
        Pulls functions on S_0 back to S_i.
    n_observed : int
        How many of the k functions the pairs determine, on S_i or on S_0, whichever is less; k for
        a full correspondence.
    """

    C: FloatArray
    n_observed: int


def map_from_pairs(
    evecs_i: FloatArray, evecs_0: FloatArray, areas: FloatArray, mask: FloatArray
) -> GroundTruth:
    r"""Fit C to pairs of points by mass-weighted least squares.

    .. math:: \min_C \sum_q a_q \|\Phi_i(x_q)\, C - \Phi_0(T x_q)\|^2

    Where pairs are few (below eight per function) or leave functions on S_i undetermined (a partial
    correspondence), a pull towards maps that commute with the Laplacian helps. Its strength is the
    one that best predicts pairs left out one at a time; ``n_observed`` tells what the pairs alone
    determine.

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
    penalties = mask**2 + _PRIOR_FLOOR
    strengths = (0.0, *_STRENGTHS) if n_observed == len(gram) else _STRENGTHS
    trials = [
        _with_prior(evecs_i, evecs_0, areas, gram, rhs, strength * penalties)
        for strength in strengths
    ]
    return GroundTruth(trials[int(np.argmin([error for _, error in trials]))][0], n_observed)


def _with_prior(
    evecs_i: FloatArray,
    evecs_0: FloatArray,
    areas: FloatArray,
    gram: FloatArray,
    rhs: FloatArray,
    penalty: FloatArray,
) -> tuple[FloatArray, float]:
    """Return the map under a prior, and its squared error at pairs left out one at a time."""
    C, error = np.empty_like(gram), 0.0
    for column, diagonal in enumerate(penalty.T):
        inverse = np.linalg.inv(gram + np.diag(diagonal))
        C[:, column] = inverse @ rhs[:, column]
        leverage = areas * np.einsum("qi,ij,qj->q", evecs_i, inverse, evecs_i, optimize=True)
        residuals = (evecs_i @ C[:, column] - evecs_0[:, column]) / (
            1 - np.minimum(leverage, _MOST_LEVERAGE)
        )
        error += float(areas @ residuals**2)
    return C, error


def _rank(gram: FloatArray, threshold: float) -> int:
    return int((np.linalg.eigvalsh(gram) > threshold).sum())


def _target_gram(evecs_i: FloatArray, evecs_0: FloatArray, areas: FloatArray) -> FloatArray:
    """Return the Gram matrix of functions on S_0, averaged over the pairs of each point of S_i."""
    _, inverse = np.unique(evecs_i, axis=0, return_inverse=True)
    area = np.bincount(inverse.ravel(), areas)
    sums = np.stack([np.bincount(inverse.ravel(), areas * column) for column in evecs_0.T], axis=1)
    average = sums / np.maximum(area, np.finfo(np.float64).tiny)[:, None]  # points without area
    return np.asarray(average.T @ (area[:, None] * average))
