"""Mesh saliency (Lee, Varshney, Jacobs 2005), with neighbourhoods measured along the surface."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from skfmap._tools.types import FloatArray, SparseMatrix

__all__ = ["gaussian_averages", "mesh_saliency"]

# Steps until the shortest time. A mode is damped by (1 + x / 2)^-2 rather than exp(-x). This is at
# most 0.12 too little damping, where exp(-x) is 0.10.
_STEPS = 2
# Ratios of two times this close to an integer count as integers.
_ROUNDING = 1e-9


def mesh_saliency(
    curvature: FloatArray, stiffness: SparseMatrix, mass: FloatArray, scales: FloatArray
) -> FloatArray:
    """Return the difference of Gaussian-weighted curvature averages at scales sigma and 2 sigma.

    Parameters
    ----------
    curvature : ndarray of shape (n_vertices,)
        Mean curvature.
    stiffness, mass : sparse array of shape (n_vertices, n_vertices), ndarray of shape (n_vertices,)
        Stiffness and mass matrix of the surface.
    scales : ndarray of shape (n_scales,)
        Standard deviations sigma, in the unit of length, ascending.

    Returns
    -------
    saliency : ndarray of shape (n_vertices, n_scales)
        abs(G(curvature, sigma) - G(curvature, 2 sigma)).
    """
    averages = gaussian_averages(curvature, stiffness, mass, np.concatenate([scales, 2 * scales]))
    narrow, wide = np.split(averages, 2, axis=1)
    return np.abs(narrow - wide)


def gaussian_averages(
    values: FloatArray, stiffness: SparseMatrix, mass: FloatArray, scales: FloatArray
) -> FloatArray:
    """Return Gaussian-weighted averages of a function, shape (n_vertices, n_scales).

    ``scales`` are standard deviations. On a surface the Gaussian is the heat kernel at time sigma^2
    / 2. One factorisation serves all scales: the heat equation is solved by implicit Euler steps of
    equal length (half the shortest time), with linear interpolation between steps. Constants and
    the integral are preserved.
    """
    times = np.asarray(scales, dtype=np.float64) ** 2 / 2
    step = times.min() / _STEPS
    n_steps = int(np.ceil(times.max() / step - _ROUNDING))
    system = sp.csc_array(sp.diags_array(mass) + step * stiffness)
    solver = splu(
        system, permc_spec="COLAMD", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    in_steps = times / step
    before, averages = values, np.empty((len(values), len(times)))
    for i in range(n_steps):
        after = solver.solve(mass * before)
        # A time between two steps is interpolated; the last one may coincide with the last step.
        share = in_steps - i
        for j in np.flatnonzero((share >= 0) & ((share < 1) | (i == n_steps - 1))):
            averages[:, j] = (1 - share[j]) * before + share[j] * after
        before = after
    return averages
