"""Equation (4): a smooth approximation of the rank."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["epsilon_by_rule", "rank_norm", "rank_norm_and_gradient"]


def rank_norm(A: FloatArray, epsilon: float) -> float:
    """Return the sum over singular values of sigma^2 / (sigma^2 + epsilon), equation (4).

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional import rank_norm
    >>> rank_norm(np.diag([3.0, 1.0, 0.0]), epsilon=1.0)
    1.4
    """
    return float(rank_norm_and_gradient(A[None], epsilon)[0][0])


def rank_norm_and_gradient(A: FloatArray, epsilon: float) -> tuple[FloatArray, FloatArray]:
    r"""Return the norm (4) of each matrix in a stack, and its gradient.

    No singular values are needed: with :math:`P = A^T A` of size k, the norm is
    :math:`k - \epsilon\,\mathrm{tr}(P + \epsilon I)^{-1}` and its gradient
    :math:`2 \epsilon A (P + \epsilon I)^{-2}`, which is smooth where singular values coincide.

    Parameters
    ----------
    A : ndarray of shape (n, rows, k)
        Differences of functional maps.
    epsilon : float
        Square of the singular value that counts as one half; positive.

    Returns
    -------
    norms : ndarray of shape (n,)
        Values of (4).
    gradients : ndarray of shape (n, rows, k)
        Derivatives with respect to the entries of ``A``.
    """
    k = A.shape[2]
    inverse = np.linalg.inv(A.transpose(0, 2, 1) @ A + epsilon * np.eye(k))
    norms = k - epsilon * np.trace(inverse, axis1=1, axis2=2)
    return norms, 2 * epsilon * (A @ inverse) @ inverse


def epsilon_by_rule(differences: FloatArray) -> float:
    """Return epsilon by the rule of section 3.2, from the maps at D = I.

    For 80 percent of the singular values of all training shapes,
    sigma^2 / (sigma^2 + epsilon) <= 0.9: epsilon is the 0.8 quantile of sigma^2, divided by 9.

    Parameters
    ----------
    differences : ndarray of shape (n_shapes, rows, k)
        X_i(I) - C_i.

    Returns
    -------
    epsilon : float
        Positive, unless more than 80 percent of all singular values vanish.
    """
    squares = np.linalg.svd(differences, compute_uv=False) ** 2
    return float(np.quantile(squares, 0.8) / 9)
