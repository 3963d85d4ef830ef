r"""Row systems of all shapes at once, if the regulariser makes them values of one quadratic.

With the commutator of the Laplacians or of their resolvents, the system of row r of shape S_i is

.. math:: s\,A(t) = t^2 M_2 - 2 t M_1 + M_0, \qquad s = 1 + \gamma t^2,

where :math:`t` and :math:`s` are numbers that depend on the row, and the symmetric matrices depend
on the reference and the weights only. One eigendecomposition of twice the size, followed by matrix
products, then solves all systems.
"""

import numpy as np
import scipy.linalg

from skfmap._tools.types import FloatArray
from skfmap.functional.regularization import PenaltyQuadratic
from skfmap.functional.row_systems import RowSystems

__all__ = ["QuadraticSystems"]

# Row systems are solved to the backward error of a Cholesky factorisation, a few units in the
# last place. The decomposition alone reaches 7e-16 with weights from exp(-1/2) to exp(1/2), and
# 1e-13 with weights between the bounds exp(-7) and exp(7), where one correction reduces it to
# 4e-17.
_BACKWARD_ERROR = 1e-15
# Passes of the correction loop; one correction is needed at the bounds, a second is in reserve.
_MOST_CORRECTIONS = 3
# If the error after the corrections is larger than this (ten times the error before them with
# weights at the bounds), the systems are solved by factorisations.
_ACCEPTED = 1e-12
# Any positive scaling d gives the same inverse, but d must not be zero where the diagonal of S is.
_LEAST_SCALING = 1e-12


class QuadraticSystems:
    r"""The row systems of equation (2) for all shapes, diagonalised once.

    Let Q diagonalise :math:`M_2` and :math:`M_1` simultaneously, with :math:`Q^T M_2 Q = I` and
    :math:`Q^T M_1 Q = H`. The polynomial then becomes :math:`(t - H)^2 + S`, and its inverse is a
    block of the inverse of

    .. math:: \begin{pmatrix} t - H & -d \\ S / d & t - H \end{pmatrix}.

    The eigenvalues are conjugate pairs, because A(t) is positive definite for real t. One or two
    corrections with the residual remove rounding errors; if they do not suffice, the rows are
    factorised one by one.

    Parameters
    ----------
    gram : ndarray of shape (k, k)
        G_0 D^2 G_0^T.
    quadratic : PenaltyQuadratic
        The regulariser in this form, for rows and columns 1 to k - 1.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the systems are not finite, or not positive definite up to rounding.
    """

    def __init__(self, gram: FloatArray, quadratic: PenaltyQuadratic) -> None:
        self.gram = gram
        self._norm = float(np.abs(gram).sum(axis=0).max())
        H, Q = _diagonalise_together(gram * quadratic.growth + np.diag(quadratic.a), quadratic)
        S = Q.T @ (gram + np.diag(quadratic.c)) @ Q - np.diag(H**2)
        d = np.sqrt(np.maximum(np.diag(S), _LEAST_SCALING * np.abs(S).max()))
        linear = np.block([[np.diag(H), np.diag(d)], [-S / d[:, None], np.diag(H)]])
        if not np.isfinite(linear).all():
            raise np.linalg.LinAlgError(
                "The row systems are not finite; check the probes for extreme coefficients."
            )
        values, vectors = np.linalg.eig(linear)
        upper = np.flatnonzero(values.imag > 0)
        if len(upper) != len(H):
            raise np.linalg.LinAlgError("A row system is not positive definite; raise alpha.")
        out = Q @ vectors[: len(H), upper]
        into = (np.linalg.inv(vectors)[upper, len(H) :] / d) @ Q.T
        self._values = values[upper]
        # Real and imaginary parts side by side, so that all products are of real matrices.
        self._into = np.hstack([into.real.T, into.imag.T])
        self._out = 2 * np.vstack([out.real.T, -out.imag.T])

    def solve(
        self, rhs: FloatArray, penalty: FloatArray, t: FloatArray, s: FloatArray
    ) -> FloatArray:
        """Return the solutions for rows of any shapes.

        Parameters
        ----------
        rhs, penalty : ndarray of shape (n_rows, k)
            Right-hand sides, and diagonals of the regulariser.
        t, s : ndarray of shape (n_rows,)
            Argument t of the quadratic for each row, and 1 + gamma t^2.

        Returns
        -------
        ndarray of shape (n_rows, k)
            Solutions.
        """
        poles = 1 / (t[:, None] - self._values)
        real, imaginary = poles.real.copy(), poles.imag.copy()
        x = self._apply(rhs, real, imaginary, s)
        error = np.inf
        for _ in range(_MOST_CORRECTIONS):
            residual = rhs - (x @ self.gram + penalty * x)
            before, error = error, self._backward_error(residual, rhs, penalty, x)
            # If a correction does not halve the error, rounding is the limit.
            if error <= _BACKWARD_ERROR or error > before / 2:
                break
            x = x + self._apply(residual, real, imaginary, s)
        if not error <= _ACCEPTED:
            return RowSystems(self.gram, penalty).solve(rhs)
        return x

    def _apply(
        self, rhs: FloatArray, real: FloatArray, imaginary: FloatArray, s: FloatArray
    ) -> FloatArray:
        """Return the solutions, as accurate as the decomposition."""
        n = len(self.gram)
        both = rhs @ self._into
        a, b = both[:, :n], both[:, n:]
        product = np.empty_like(both)
        product[:, :n] = a * real - b * imaginary
        product[:, n:] = a * imaginary + b * real
        x = product @ self._out
        x *= s[:, None]
        return np.asarray(x)

    def _backward_error(
        self, residual: FloatArray, rhs: FloatArray, penalty: FloatArray, x: FloatArray
    ) -> float:
        scale = (self._norm + penalty.max(axis=1)) * np.abs(x).max(axis=1) + np.abs(rhs).max(axis=1)
        scale = np.maximum(scale, np.finfo(np.float64).tiny)  # a system of zeros has no residual
        return float((np.abs(residual).max(axis=1) / scale).max())


def _diagonalise_together(
    M_2: FloatArray, quadratic: PenaltyQuadratic
) -> tuple[FloatArray, FloatArray]:
    """Return H and Q with Q^T M_2 Q = I and Q^T diag(b) Q = diag(H)."""
    if quadratic.growth == 0:
        return quadratic.b / quadratic.a, np.diag(1 / np.sqrt(quadratic.a))
    H, Q = scipy.linalg.eigh(np.diag(quadratic.b), M_2)
    return np.asarray(H), np.asarray(Q)
