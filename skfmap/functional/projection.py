"""Projection of functions onto the eigenfunctions, and heat diffusion of coefficients."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["diffuse", "project"]


def project(values: FloatArray, evecs: FloatArray, mass: FloatArray) -> FloatArray:
    """Return coefficients ``evecs.T @ diag(mass) @ values``, shape (n_components, ...)."""
    return np.asarray(evecs.T @ (mass * values.T).T)


def diffuse(coefficients: FloatArray, evals: FloatArray, times: FloatArray) -> FloatArray:
    """Solve the heat equation exactly in the eigenbasis: coefficients decay as exp(-t lambda).

    Parameters
    ----------
    coefficients : ndarray of shape (n_components,)
        Coefficients of the initial heat distribution.
    evals : ndarray of shape (n_components,)
        Eigenvalues at unit area.
    times : ndarray of shape (n_times,)
        Diffusion times, at unit area.

    Returns
    -------
    diffused : ndarray of shape (n_components, n_times)
        Coefficients at each time.
    """
    return coefficients[:, None] * np.exp(-np.outer(evals, times))
