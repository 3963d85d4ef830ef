"""Equation (3): how far the maps that weights produce are from the known ones."""

from dataclasses import dataclass

import numpy as np

from skfmap._typing import FloatArray
from skfmap.functional.fmap import RowSystems, solve_functional_map
from skfmap.functional.norm import rank_norm_and_gradient

__all__ = ["LearningProblem"]


@dataclass(frozen=True, eq=False)
class LearningProblem:
    r"""The learning problem on arrays: N shapes, k functions, m probes.

    .. math:: E(D) = \sum_i s_i \|X_i(D) - C_i\|_\epsilon

    Parameters
    ----------
    probes_0 : ndarray of shape (k, m)
        Probe functions on the reference, centred and scaled.
    probes : ndarray of shape (N, k, m)
        Probe functions on the training shapes, centred and scaled.
    penalties : ndarray of shape (N, k, k)
        alpha (W_i * W_i + floor) of each shape.
    maps : ndarray of shape (N, k, k)
        Known functional maps C_i, from functions on S_0 to functions on S_i.
    sample_weight : ndarray of shape (N,)
        Share of each shape in the sum.
    """

    probes_0: FloatArray
    probes: FloatArray
    penalties: FloatArray
    maps: FloatArray
    sample_weight: FloatArray

    def solve(self, weights: FloatArray) -> FloatArray:
        """Return the maps X_i(D), shape (N, k, k)."""
        pairs = zip(self.probes, self.penalties, strict=True)
        return np.stack([solve_functional_map(self.probes_0, g, penalty, weights) for g, penalty in pairs])

    def differences(self, weights: FloatArray) -> FloatArray:
        """Return X_i(D) - C_i without the column of the constant, which is nil; shape (N, k, k - 1)."""
        return (self.solve(weights) - self.maps)[:, :, 1:]

    def loss(self, weights: FloatArray, epsilon: float) -> float:
        """Return E(D)."""
        return float(self.sample_weight @ rank_norm_and_gradient(self.differences(weights), epsilon)[0])

    def loss_gradient(self, weights: FloatArray, epsilon: float) -> tuple[float, FloatArray]:
        """Return E(D) and its gradient with respect to the squared weights, shape (m,).

        With R the gradient of (4) in X, and row r of L the solution of row system r for row r of R, the derivative
        with respect to the square of weight p is sum_r (L G_0)_rp (G_i - X_i G_0)_rp.
        """
        g_0 = self.probes_0[1:]
        weighted = g_0 * weights**2
        gram = weighted @ g_0.T
        loss, gradient = 0.0, np.zeros(len(weights))
        for g, penalty, C, share in zip(self.probes, self.penalties, self.maps, self.sample_weight, strict=True):
            systems = RowSystems(gram, penalty[1:, 1:])
            X = systems.solve(g[1:] @ weighted.T)
            difference = -C[:, 1:]
            difference[1:] += X
            norm, R = rank_norm_and_gradient(difference[None], epsilon)
            adjoint = systems.solve(R[0, 1:])
            loss += share * norm[0]
            gradient += share * ((adjoint @ g_0) * (g[1:] - X @ g_0)).sum(axis=0)
        return float(loss), gradient
