"""The deformation model: which entries of a functional map are expected to be small.

Equation (2) is solved with the penalty alpha (W * W + `DIAGONAL_FLOOR`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter

from skfmap._tools.types import FloatArray

__all__ = [
    "DIAGONAL_FLOOR",
    "LEARNED",
    "REGULARIZERS",
    "LearnedMask",
    "PenaltyQuadratic",
    "laplacian_mask",
    "learned_mask",
    "penalty_of",
    "penalty_quadratic",
    "resolvent_mask",
]

DIAGONAL_FLOOR = 1e-5
"""Floor added to W * W in equation (2), so that the row systems are always positive definite.

Without it they are singular where W vanishes and no probe has a component. On TOSCA's cats, floors
from 0 to 1e-5 give equal matches of shapes left out (mean error 0.0309); 1e-3 also pulls small
entries of the map to zero (0.0324).
"""

# Scale of the learned W * W, which puts its median (0.44 on TOSCA's cats) near the Laplacian's
# (0.10). Errors of shapes left out, times 100, with 1e-4, 1e-3 and 1e-2: 3.06, 3.04, 3.04; with the
# Laplacian 3.09.
_LEARNED_SCALE = 1e-3
# Added to the mean squares; a tenth of these are below 6e-5. Errors with 1e-5, 1e-4, 1e-3: 3.05,
# 3.04, 3.09.
_LEAST_VARIANCE = 1e-4
# Standard deviation of the Gaussian over neighbouring entries. Errors with 0, 1 and 2: 2.97, 3.04,
# 3.59 for nine training shapes besides the reference, 3.28, 3.19, 3.72 for three.
_NEIGHBOURS = 1.0

Regularizer = Callable[[FloatArray, FloatArray], FloatArray]


def laplacian_mask(evals_i: FloatArray, evals_0: FloatArray) -> FloatArray:
    """Return W_kl = (lambda_k of S_i - lambda_l of S_0) / the last lambda of S_0, shape (k_i, k_0).

    This penalises the commutator of C with the Laplacians (section 2.1), and has no units.
    """
    return (evals_i[:, None] - evals_0[None, :]) / evals_0[-1]


def resolvent_mask(evals_i: FloatArray, evals_0: FloatArray) -> FloatArray:
    """Return W of the commutator with the resolvents, shape (k_i, k_0).

    See Ren et al. 2019, with gamma = 1/2. Unlike the Laplacian mask it is bounded, and therefore
    constrains the higher functions less.
    """
    roots = [np.sqrt(np.maximum(evals, 0) / evals_0[-1]) for evals in (evals_i, evals_0)]
    real, imaginary = zip(*((x / (1 + x**2), 1 / (1 + x**2)) for x in roots), strict=True)
    return np.hypot(*(part[0][:, None] - part[1][None, :] for part in (real, imaginary)))


@dataclass(frozen=True, eq=False)
class LearnedMask:
    """W estimated from known maps: large where their entries are small.

    Attributes
    ----------
    mask : ndarray of shape (k, k)
        W, which does not depend on the eigenvalues.
    """

    mask: FloatArray

    def __call__(self, evals_i: FloatArray, evals_0: FloatArray) -> FloatArray:  # noqa: ARG002
        """Return W."""
        return self.mask


def learned_mask(maps: FloatArray, sample_weight: FloatArray | None = None) -> LearnedMask:
    r"""Return a mask W that is large where the entries of known maps are small.

    .. math:: W_{kl}^2 = \frac{s}{v_{kl} + \varepsilon}, \qquad s = 10^{-3},
              \quad \varepsilon = 10^{-4}

    Here v is the mean square of each entry over the maps, smoothed over neighbouring entries by a
    Gaussian with a standard deviation of one entry. This corresponds to a prior of independent
    Gaussian entries with these variances, which reflect real deformations rather than perfect
    isometries. W * W is at most s / eps = 10.

    Parameters
    ----------
    maps : ndarray of shape (N, k, k)
        Known functional maps.
    sample_weight : ndarray of shape (N,), optional
        Share of each map.

    Returns
    -------
    LearnedMask
        The regulariser.

    Examples
    --------
    For maps whose entries are all 0.3, W * W is 1e-3 / (0.09 + 1e-4):

    >>> import numpy as np
    >>> from skfmap.functional import learned_mask
    >>> mask = learned_mask(np.full((2, 4, 4), 0.3)).mask
    >>> float((mask[0, 0] ** 2).round(6))
    0.011099
    """
    mean_square = np.average(np.square(maps), axis=0, weights=sample_weight)
    variance = gaussian_filter(mean_square, _NEIGHBOURS, mode="nearest")
    return LearnedMask(np.sqrt(_LEARNED_SCALE / (variance + _LEAST_VARIANCE)))


REGULARIZERS: dict[str, Regularizer] = {"laplacian": laplacian_mask, "resolvent": resolvent_mask}
LEARNED = "learned"


def penalty_of(
    evals_i: FloatArray, evals_0: FloatArray, alpha: float, regularizer: str | Regularizer
) -> FloatArray:
    """Return the diagonals of the row systems' regulariser, shape (k_i, k_0).

    They are alpha (W * W + `DIAGONAL_FLOOR`).

    Raises
    ------
    ValueError
        If a callable regulariser returns an array of another shape, or values that are not finite.
    """
    mask = np.asarray(
        (REGULARIZERS[regularizer] if isinstance(regularizer, str) else regularizer)(
            evals_i, evals_0
        )
    )
    real = mask.dtype.kind in "biuf"
    if mask.shape != (len(evals_i), len(evals_0)) or not real or not np.isfinite(mask).all():
        raise ValueError(
            f"The regularizer must return finite real values of shape ({len(evals_i)}, "
            f"{len(evals_0)}); got dtype {mask.dtype} and shape {mask.shape}."
        )
    return np.asarray(alpha * (mask**2 + DIAGONAL_FLOOR))


class PenaltyQuadratic(NamedTuple):
    """Penalties as values of a quadratic: (1 + growth t^2) penalty = a t^2 - 2 b t + c.

    Attributes
    ----------
    t : ndarray of shape (n_shapes, k)
        Argument of the quadratic for each row of each shape.
    a, b, c : ndarray of shape (k,)
        Coefficients of the quadratic for each column.
    growth : float
        Coefficient of t^2 on the left-hand side, non-negative.
    """

    t: FloatArray
    a: FloatArray
    b: FloatArray
    c: FloatArray
    growth: float


def penalty_quadratic(
    evals: FloatArray, evals_0: FloatArray, alpha: float, regularizer: str | Regularizer
) -> PenaltyQuadratic | None:
    """Return all penalties in a form in which one decomposition solves all row systems.

    For the Laplacian, W = t - y, where t and y are eigenvalues divided by the last one of S_0. For
    the resolvents, W^2 = (t - y)^2 / ((1 + t^2) (1 + y^2)), where t and y are the square roots of
    these ratios.

    Parameters
    ----------
    evals, evals_0 : ndarray of shape (n_shapes, k), ndarray of shape (k,)
        Eigenvalues.
    alpha : float
        Strength of the regulariser.
    regularizer : str or callable
        As in `penalty_of`.

    Returns
    -------
    PenaltyQuadratic or None
        The same penalties as `penalty_of`; None for any other regulariser.
    """
    if regularizer == "laplacian":
        growth, t, y = 0.0, evals / evals_0[-1], evals_0 / evals_0[-1]
    elif regularizer == "resolvent":
        growth, (t, y) = 1.0, (np.sqrt(np.maximum(x, 0) / evals_0[-1]) for x in (evals, evals_0))
    else:
        return None
    share = alpha / (1 + growth * y**2)
    floor = alpha * DIAGONAL_FLOOR
    return PenaltyQuadratic(t, share + growth * floor, share * y, share * y**2 + floor, growth)
