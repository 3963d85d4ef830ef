"""The deformation model: which entries of a functional map are expected to be small."""

from collections.abc import Callable

import numpy as np

from skfmap._typing import FloatArray

__all__ = ["DIAGONAL_FLOOR", "REGULARIZERS", "laplacian_mask", "penalty_of"]

DIAGONAL_FLOOR = 1e-5
"""Added to W * W, so that row systems stay definite where W vanishes and no probe sees a function."""

Regularizer = Callable[[FloatArray, FloatArray], FloatArray]


def laplacian_mask(evals_i: FloatArray, evals_0: FloatArray) -> FloatArray:
    """Return W_kl = (lambda_k of S_i - lambda_l of S_0) / the last lambda of S_0, shape (k_i, k_0).

    The commutator of C with the Laplacians (section 2.1), free of units.
    """
    return (evals_i[:, None] - evals_0[None, :]) / evals_0[-1]


REGULARIZERS: dict[str, Regularizer] = {"laplacian": laplacian_mask}


def penalty_of(evals_i: FloatArray, evals_0: FloatArray, alpha: float, regularizer: str | Regularizer) -> FloatArray:
    """Return the diagonals of the row systems' regulariser, alpha (W * W + floor), shape (k_i, k_0).

    Raises
    ------
    ValueError
        If a callable regulariser returns another shape or values that are not finite.
    """
    mask = np.asarray((REGULARIZERS[regularizer] if isinstance(regularizer, str) else regularizer)(evals_i, evals_0))
    if mask.shape != (len(evals_i), len(evals_0)) or not np.isfinite(mask).all():
        raise ValueError(
            f"The regularizer must return finite values of shape ({len(evals_i)}, {len(evals_0)}); got {mask.shape}."
        )
    return np.asarray(alpha * (mask**2 + DIAGONAL_FLOOR))
