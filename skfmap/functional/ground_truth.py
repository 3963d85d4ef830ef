"""Functional maps from known correspondences."""

from dataclasses import dataclass

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["GroundTruth", "map_from_pairs"]

# The figures below are for TOSCA's cats and 50 functions unless stated otherwise.
#
# A function counts as not observed below this eigenvalue of the sampled Gram matrix (which is the
# identity for a full map). The smallest eigenvalue is 0.93 or more with all pairs (up to 120
# functions), 0.34 with two well-spread landmarks per function, and 0.03 with 1.2.
_OBSERVED = 0.1
# The same for the functions on S_0, whose areas the map may shrink. All pairs give 0.23 or more; if
# whole parts are mapped to one point it is zero.
_REACHED = 1e-3
# Strengths of the isometric prior to choose from. Left-out errors include the error of truncating
# to k functions, and therefore favour too strong a prior: with up to 16 landmarks per function the
# choice is the upper end. If the range went further, the choice would be 10 at 2 landmarks
# (relative error of C 0.18, not 0.14) and 3 at 4 (0.11, not 0.09); only at 1.2 landmarks would that
# be better (0.24, not 0.31).
_STRENGTHS = tuple(np.geomspace(1e-4, 1.0, 9))
# With more distinct pairs per function than this no prior is used, because it does harm. Relative
# errors of C at 1.2, 2, 4, 8 and 16 landmarks: with it 0.31, 0.14, 0.086, 0.061, 0.053, without it
# 0.58, 0.16, 0.089, 0.051, 0.037.
_PLENTY = 8
# Added to W * W of the prior, so that its diagonal counts at all; values from 0 to 1e-4 give the
# same map.
_PRIOR_FLOOR = 1e-6
# Largest leverage, so that a residual is enlarged at most 100 times: 1 / (1 - leverage) is infinite
# for a pair that alone determines a function. With two landmarks per function every cap from 0.5 on
# leads to the same choice.
_MOST_LEVERAGE = 0.99


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """A functional map fitted to pairs.

    Attributes
    ----------
    C : ndarray of shape (k, k)
        Functional map, which pulls functions on S_0 back to S_i.
    n_observed : int
        Number of the k functions that the pairs determine, on S_i or on S_0, whichever is smaller;
        k for a full correspondence.
    """

    C: FloatArray
    n_observed: int


def map_from_pairs(
    evecs_i: FloatArray, evecs_0: FloatArray, areas: FloatArray, mask: FloatArray
) -> GroundTruth:
    r"""Fit C to pairs of points by mass-weighted least squares.

    .. math:: \min_C \sum_q a_q \|\Phi_i(x_q)\, C - \Phi_0(T x_q)\|^2

    If there are few pairs (up to eight per function), or if they leave functions on S_i
    undetermined (a partial correspondence), a prior that favours maps commuting with the Laplacian
    is added. Its strength is the one that best predicts pairs left out one at a time.
    ``n_observed`` counts what the pairs alone determine.

    Parameters
    ----------
    evecs_i, evecs_0 : ndarray of shape (n_pairs, k)
        Eigenfunctions at the paired points of S_i and S_0.
    areas : ndarray of shape (n_pairs,)
        Area on S_i that each pair represents; the areas of a full correspondence sum to 1.
    mask : ndarray of shape (k, k)
        W of the regulariser; used only by the prior.

    Returns
    -------
    GroundTruth
        The map, and how many functions are observed.
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
