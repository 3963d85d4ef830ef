"""Heat and wave kernel signatures."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["heat_kernel_signature", "wave_kernel_signature"]


def heat_kernel_signature(evals: FloatArray, evecs: FloatArray, times: FloatArray) -> FloatArray:
    """Return sum_k exp(-t lambda_k) phi_k(x)^2 over the non-constant eigenfunctions.

    See Sun, Ovsjanikov, Guibas 2009. The result has shape (n_vertices, n_times). The constant
    eigenfunction is omitted: it only adds a constant, which centring removes.
    """
    return np.asarray(evecs[:, 1:] ** 2 @ np.exp(-np.outer(evals[1:], times)))


def wave_kernel_signature(
    evals: FloatArray, evecs: FloatArray, log_energies: FloatArray, sigma: float
) -> FloatArray:
    """Return the average of phi_k(x)^2 with Gaussian weights in the log eigenvalue.

    See Aubry, Schlickewei, Cremers 2011. The result has shape (n_vertices, n_energies). Unlike in
    their rule, ``sigma`` does not depend on the number of energies; their rule breaks down with few
    energies.
    """
    distance = (log_energies[None, :] - np.log(evals[1:, None])) / sigma
    # Scaling the largest weight to 1 keeps energies outside the spectrum from underflowing to
    # 0 / 0.
    exponent = -(distance**2) / 2
    weights = np.exp(exponent - exponent.max(axis=0))
    return np.asarray(evecs[:, 1:] ** 2 @ (weights / weights.sum(axis=0)))
