"""Equation (2): the functional map that best preserves the weighted probe functions.

A floor under the regulariser, `DIAGONAL_FLOOR` = 1e-5, is added to the two terms of the paper.
"""

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.functional.row_systems import RowSystems

__all__ = ["MapEquation", "solve_functional_map"]


class MapEquation:
    """Equation (2), factorised once for all right-hand sides.

    Parameters
    ----------
    probes_0 : ndarray of shape (k, n_probes)
        Coefficients of the probe functions on S_0, centred (row 0 is zero) and scaled.
    penalty : ndarray of shape (k, k)
        alpha (W * W + floor), from `skfmap.functional.penalty_of`.
    weights : ndarray of shape (n_probes,)
        Diagonal of D; only its square matters.
    """

    def __init__(self, probes_0: FloatArray, penalty: FloatArray, weights: FloatArray) -> None:
        self.probes_0, self.penalty, self.weights = probes_0, penalty, weights
        self._weighted = probes_0[1:] * weights**2
        self._systems = RowSystems(self._weighted @ probes_0[1:].T, penalty[1:, 1:])

    def solve(self, probes_i: FloatArray) -> FloatArray:
        """Return X_i(D), shape (k, k), for the probe functions of S_i, shape (k, n_probes)."""
        C = np.zeros_like(self.penalty)
        C[0, 0] = 1.0
        C[1:, 1:] = self._systems.solve(probes_i[1:] @ self._weighted.T)
        return C

    def objective(self, C: FloatArray, probes_i: FloatArray) -> float:
        """Return the value of equation (2) at ``C``.

        At X_i(D) it measures how badly the shape fits what was learned.
        """
        residual = (C @ self.probes_0 - probes_i) * self.weights
        return float(
            np.square(residual).sum() + (self.penalty[1:, 1:] * np.square(C[1:, 1:])).sum()
        )


def solve_functional_map(
    probes_0: FloatArray, probes_i: FloatArray, penalty: FloatArray, weights: FloatArray
) -> FloatArray:
    r"""Fit the functional map of equation (2) of Corman, Ovsjanikov, Chambolle 2014, with a floor.

    .. math:: X_i(D) = \arg\min_C \|(C G_0 - G_i) D\|_F^2
              + \alpha \sum_{k, l \geq 1} (W_{kl}^2 + \delta)\, C_{kl}^2, \qquad \delta = 10^{-5}

    The paper has no delta. It makes the minimum unique: the other terms leave an entry undetermined
    if W vanishes (equal eigenvalues) and no weighted probe has a component along the function.
    Constants map to constants: the first column is exactly e_0. The rows decouple into systems of
    k - 1 unknowns each.

    Parameters
    ----------
    probes_0, probes_i : ndarray of shape (k, n_probes)
        Coefficients of the probe functions on S_0 and S_i, centred (row 0 is zero) and scaled.
    penalty : ndarray of shape (k, k)
        alpha (W * W + delta), from `skfmap.functional.penalty_of`.
    weights : ndarray of shape (n_probes,)
        Diagonal of D; only its square matters.

    Returns
    -------
    C : ndarray of shape (k, k)
        Functional map, which pulls functions on S_0 back to S_i. Column j is the image of
        eigenfunction j of S_0.

    Examples
    --------
    Two copies of one shape are related by the identity:

    >>> import numpy as np
    >>> from skfmap.functional import penalty_of, solve_functional_map
    >>> probes, evals = np.diag([0.0, 1, 1]), np.array([0.0, 1, 2])
    >>> penalty = penalty_of(evals, evals, 1e-3, "laplacian")
    >>> C = solve_functional_map(probes, probes, penalty, np.ones(3))
    >>> bool(np.allclose(C, np.eye(3)))
    True
    """
    return MapEquation(probes_0, penalty, weights).solve(probes_i)
