"""Heat and wave kernel signatures."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["heat_kernel_signature", "wave_kernel_signature"]


def heat_kernel_signature(evals: FloatArray, evecs: FloatArray, times: FloatArray) -> FloatArray:
    """Return sum_k exp(-t lambda_k) phi_k(x)^2 over the non-constant eigenfunctions.

    Sun, Ovsjanikov, Guibas 2009; shape (n_vertices, n_times). The constant mode is left out: it
    adds a constant, and probes are centred anyway.
    """
    return np.asarray(evecs[:, 1:] ** 2 @ np.exp(-np.outer(evals[1:], times)))


def wave_kernel_signature(
    evals: FloatArray, evecs: FloatArray, log_energies: FloatArray, sigma: float
) -> FloatArray:
    """Return the average of phi_k(x)^2 under Gaussian weights in log eigenvalue.

    Aubry, Schlickewei, Cremers 2011; shape (n_vertices, n_energies). Unlike their rule, ``sigma``
    does not depend on the number of energies, which would break down with few of them.
    """
    distance = (log_energies[None, :] - np.log(evals[1:, None])) / sigma
    # The largest weight is 1 whatever the energy, so that energies outside the spectrum do not
    # underflow to 0 / 0.
    exponent = -(distance**2) / 2
    weights = np.exp(exponent - exponent.max(axis=0))
    return np.asarray(evecs[:, 1:] ** 2 @ (weights / weights.sum(axis=0)))
