"""Equation (3): how far the learned maps are from the known maps."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.functional.norm import rank_norm_and_gradient
from skfmap.functional.quadratic_systems import QuadraticSystems
from skfmap.functional.regularization import PenaltyQuadratic
from skfmap.functional.row_systems import RowSystems, SharedRowSystems

__all__ = ["LearningProblem"]

# Rows of functional maps processed at a time, and numbers in their factors (64 MB). They bound the
# memory for any number of shapes: 300 shapes, 100 functions and 310 probes peak at 0.4 GiB
# (docs/speed.rst).
_MOST_ROWS = 512
_MOST_NUMBERS = 8_000_000
# Even a few shapes are divided into chunks, so that each thread has work. Two threads save nothing
# with 75,000 numbers in all maps, and 13 % with 100,000 (docs/speed.rst, "Loss and gradient").
_N_CHUNKS = 4
_FEW = 100_000
# Numbers in all maps from which one decomposition for all shapes replaces factorisations row by
# row. Its speed relative to them is 2.3 with 12,000 and k = 20; with k = 50, 0.8 with 12,000 and 3
# with 24,000; with k = 100, 0.7 with 9,801 and 1.2 with 19,602.
_MANY = 12_000

# Solves the row systems of some shapes for right-hand sides of shape (n_shapes, k - 1, k - 1).
Solver = Callable[[FloatArray], FloatArray]
_Result = TypeVar("_Result")


@dataclass(frozen=True, eq=False)
class LearningProblem:
    r"""The learning problem on arrays: N shapes, k functions, m probes.

    .. math:: E(D) = \sum_i s_i \|X_i(D) - C_i\|_\epsilon

    Shapes are processed in chunks, several at a time if there are several threads; the result does
    not depend on the number of threads.

    Parameters
    ----------
    probes_0 : ndarray of shape (k, m)
        Probe functions on the reference, centred and scaled.
    probes : ndarray of shape (N, k, m)
        Probe functions on the training shapes, centred and scaled.
    penalties : ndarray of shape (N, k, k)
        alpha (W_i * W_i + floor) for each shape.
    maps : ndarray of shape (N, k, k)
        Known functional maps C_i, from functions on S_0 to functions on S_i.
    sample_weight : ndarray of shape (N,)
        Share of each shape in the sum.
    quadratic : PenaltyQuadratic, optional
        The same penalties in the form of `skfmap.functional.regularization.penalty_quadratic`,
        which is much faster for many shapes.
    n_threads : int, default=1
        Number of threads, each working on one chunk. Limit BLAS to one thread if there are several.
    """

    probes_0: FloatArray
    probes: FloatArray
    penalties: FloatArray
    maps: FloatArray
    sample_weight: FloatArray
    quadratic: PenaltyQuadratic | None = None
    n_threads: int = 1

    def solve(self, weights: FloatArray) -> FloatArray:
        """Return the maps X_i(D), shape (N, k, k)."""
        weighted = self.probes_0[1:] * weights**2
        systems = self._systems(weighted)

        def maps_of(chunk: slice) -> FloatArray:
            return systems(chunk)(self.probes[chunk, 1:] @ weighted.T)

        X = np.zeros_like(self.maps)
        X[:, 0, 0] = 1.0
        X[:, 1:, 1:] = np.concatenate(self._over_chunks(maps_of))
        return X

    def differences(self, weights: FloatArray) -> FloatArray:
        """Return X_i(D) - C_i without the first column, which is zero; shape (N, k, k - 1)."""
        return (self.solve(weights) - self.maps)[:, :, 1:]

    def loss(self, weights: FloatArray, epsilon: float) -> float:
        """Return E(D)."""
        return float(
            self.sample_weight @ rank_norm_and_gradient(self.differences(weights), epsilon)[0]
        )

    def loss_gradient(self, weights: FloatArray, epsilon: float) -> tuple[float, FloatArray]:
        """Return E(D) and its gradient with respect to the squared weights, shape (m,).

        With R the gradient of (4) in X, and row r of L the solution of row system r for row r of R,
        the derivative with respect to the square of weight p is sum_r (L G_0)_rp (G_i - X_i
        G_0)_rp.
        """
        g_0 = self.probes_0[1:]
        weighted = g_0 * weights**2
        systems = self._systems(weighted)

        def loss_gradient_of(chunk: slice) -> tuple[float, FloatArray]:
            solve, g, share = systems(chunk), self.probes[chunk, 1:], self.sample_weight[chunk]
            X = solve(g @ weighted.T)
            difference = -self.maps[chunk, :, 1:]
            difference[:, 1:] += X
            norms, R = rank_norm_and_gradient(difference, epsilon)
            adjoint = solve(R[:, 1:])
            by_shape = np.einsum("irp,irp->ip", adjoint @ g_0, g - X @ g_0)
            return float(share @ norms), share @ by_shape

        losses, gradients = zip(*self._over_chunks(loss_gradient_of), strict=True)
        return float(np.sum(losses)), np.sum(gradients, axis=0)

    def _systems(self, weighted: FloatArray) -> Callable[[slice], Solver]:
        """Return a function that gives the solver of a chunk, for maps and their adjoints."""
        gram, penalties = weighted @ self.probes_0[1:].T, self.penalties[:, 1:, 1:]
        n_shapes, n, _ = penalties.shape
        if self.quadratic is not None and n_shapes * n**2 >= _MANY:
            return _by_quadratic(gram, penalties, self.quadratic)
        if n_shapes > 1 and (penalties == penalties[0]).all():
            shared = SharedRowSystems(gram, penalties[0])
            return lambda chunk: shared.solve  # noqa: ARG005

        def factorised(chunk: slice) -> Solver:
            rows = RowSystems(gram, penalties[chunk].reshape(-1, n))
            return lambda rhs: rows.solve(rhs.reshape(-1, n)).reshape(rhs.shape)

        return factorised

    def _over_chunks(self, function: Callable[[slice], _Result]) -> list[_Result]:
        n_shapes, k, _ = self.maps.shape
        size = max(1, min(_MOST_ROWS, _MOST_NUMBERS // k**2) // k)
        size = min(size, -(-n_shapes // _N_CHUNKS))
        chunks = [slice(i, i + size) for i in range(0, len(self.maps), size)]
        if self.n_threads == 1 or self.maps.size < _FEW:
            return [function(chunk) for chunk in chunks]
        with ThreadPoolExecutor(self.n_threads) as threads:
            return list(threads.map(function, chunks))


def _by_quadratic(
    gram: FloatArray, penalties: FloatArray, quadratic: PenaltyQuadratic
) -> Callable[[slice], Solver]:
    within = quadratic._replace(
        t=quadratic.t[:, 1:], a=quadratic.a[1:], b=quadratic.b[1:], c=quadratic.c[1:]
    )
    systems, n = QuadraticSystems(gram, within), len(gram)

    def of_chunk(chunk: slice) -> Solver:
        t = within.t[chunk].ravel()
        known = penalties[chunk].reshape(-1, n), t, 1 + within.growth * t**2
        return lambda rhs: systems.solve(rhs.reshape(-1, n), *known).reshape(rhs.shape)

    return of_chunk
