"""The row systems of equation (2), factorised per shape, or once for all shapes that share them."""

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from skfmap._tools.types import FloatArray

__all__ = ["RowSystems", "SharedRowSystems"]


class RowSystems:
    r"""The row systems of equation (2) for one shape, factorised once.

    Row ``r`` of the functional map solves

    .. math:: (G_0 D^2 G_0^T + \mathrm{diag}(penalty_r))\, c_r = G_0 D^2 g_r .

    The same factor serves the solution and the adjoint of the gradient.

    Parameters
    ----------
    gram : ndarray of shape (k, k)
        G_0 D^2 G_0^T.
    penalty : ndarray of shape (n_rows, k)
        Diagonal of each row's regulariser, positive.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a system is not positive definite up to rounding.
    """

    def __init__(self, gram: FloatArray, penalty: FloatArray) -> None:
        self.factors = []
        diagonal = np.arange(len(gram))
        for row_penalty in penalty:
            system = np.array(gram, order="F")
            system[diagonal, diagonal] += row_penalty
            factor, info = dpotrf(system, overwrite_a=True, clean=False)
            if info != 0:
                raise np.linalg.LinAlgError(
                    "A row system is not positive definite; raise alpha, or remove probes with "
                    "extreme weights."
                )
            self.factors.append(factor)

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solve the system of each row for the same row of ``rhs``; shape (n_rows, k)."""
        return np.stack(
            [dpotrs(factor, row)[0] for factor, row in zip(self.factors, rhs, strict=True)]
        )


class SharedRowSystems:
    """Row systems that are the same for all shapes, so that each row is factorised only once.

    Parameters
    ----------
    gram : ndarray of shape (k, k)
        G_0 D^2 G_0^T.
    penalty : ndarray of shape (k, k)
        Diagonals of the rows' regularisers, the same on all shapes.
    """

    def __init__(self, gram: FloatArray, penalty: FloatArray) -> None:
        self._rows = RowSystems(gram, penalty)

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Return the solutions of all shapes, shape (n_shapes, k, k)."""
        by_row = [dpotrs(factor, rhs[:, r].T)[0].T for r, factor in enumerate(self._rows.factors)]
        return np.stack(by_row, axis=1)
