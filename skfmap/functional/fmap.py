"""Equation (2): the functional map that best carries weighted probe functions."""

import numpy as np

from skfmap._typing import FloatArray
from skfmap.functional.row_systems import RowSystems

__all__ = ["solve_functional_map"]


def solve_functional_map(
    probes_0: FloatArray, probes_i: FloatArray, penalty: FloatArray, weights: FloatArray
) -> FloatArray:
    r"""Fit the functional map of equation (2) of Corman, Ovsjanikov, Chambolle 2014.

    .. math:: X_i(D) = \arg\min_C \|(C G_0 - G_i) D\|_F^2 + \alpha \|C \odot W\|_F^2

    Constants map to constants: the first column is e_0 exactly. The rows decouple, each a system of k - 1 unknowns.

    Parameters
    ----------
    probes_0, probes_i : ndarray of shape (k, n_probes)
        Coefficients of the probe functions on S_0 and S_i, centred (row 0 is nil) and scaled.
    penalty : ndarray of shape (k, k)
        alpha (W * W + floor), from `skfmap.functional.penalty_of`.
    weights : ndarray of shape (n_probes,)
        Diagonal of D; only its square matters.

    Returns
    -------
    C : ndarray of shape (k, k)
        Functional map: pulls functions on S_0 back to S_i. Column j is the image of eigenfunction j of S_0.

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
    weighted = probes_0[1:] * weights**2
    systems = RowSystems(weighted @ probes_0[1:].T, penalty[1:, 1:])
    C = np.zeros_like(penalty)
    C[0, 0] = 1.0
    C[1:, 1:] = systems.solve(probes_i[1:] @ weighted.T)
    return C
