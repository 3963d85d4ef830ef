"""What is left at the points: where known and fitted maps put a point, and how far to trust each function for it.

A functional map puts a point x of S_i at the row of Phi_i C, while its image T x sits at the row of Phi_0. How the two
differ on the training shapes is what a nearest-neighbour search on a new shape has to forgive: some functions are
mapped worse than others (section 4.1 of the paper), and a map cut to k functions moves every point a little.
"""

import numpy as np

from skfmap._typing import FloatArray

__all__ = ["residual_covariance", "trusted_functions"]

# Added to the eigenvalues of a covariance, as a share of their mean: no function is trusted without limit.
_FLOOR = 0.2
# A pair that alone decides where its map puts it says nothing; its leverage is held below this.
_MOST_LEVERAGE = 0.9


def residual_covariance(
    evecs_i: FloatArray, evecs_0: FloatArray, areas: FloatArray, C: FloatArray, leverage_of: FloatArray | None = None
) -> FloatArray:
    r"""Return the mean squared difference between where a map puts points and where they belong.

    .. math:: \Sigma = \sum_q a_q\, r_q r_q^T / \sum_q a_q, \qquad r_q = \Phi_i(x_q)\, C - \Phi_0(T x_q)

    Its part within the first k functions of S_i is Y diag(s^2) Y^T of the stable basis; the rest is what the cut to k
    functions costs.

    Parameters
    ----------
    evecs_i, evecs_0 : ndarray of shape (n_pairs, k)
        Eigenfunctions at paired points of S_i and S_0.
    areas : ndarray of shape (n_pairs,)
        Area that each pair stands for.
    C : ndarray of shape (k, k)
        Functional map, from functions on S_0 to functions on S_i.
    leverage_of : ndarray of shape (k, k), optional
        If ``C`` was fitted to these very pairs by least squares, its Gram matrix. Each residual is then the one that
        the pair would have if it had been left out, so that few pairs do not look better than many.

    Returns
    -------
    covariance : ndarray of shape (k, k)
        Symmetric, positive semi-definite.
    """
    residuals = evecs_i @ C - evecs_0
    if leverage_of is not None:
        inverse = np.linalg.pinv(leverage_of, rcond=1e-10, hermitian=True)
        leverage = areas * ((evecs_i @ inverse) * evecs_i).sum(axis=1)
        residuals = residuals / (1 - np.minimum(leverage, _MOST_LEVERAGE))[:, None]
    covariance = (areas[:, None] * residuals).T @ residuals / areas.sum()
    return np.asarray((covariance + covariance.T) / 2)


def trusted_functions(covariance: FloatArray) -> FloatArray:
    """Return functions on S_0 in which points are matched, each scaled by how far it can be trusted.

    The eigenvectors v of the covariance, each divided by its eigenvalue plus a floor, so that a difference between two
    points counts less where maps are known to err. A function without error has weight 1.

    Parameters
    ----------
    covariance : ndarray of shape (k, k)
        From `residual_covariance`, averaged over training shapes.

    Returns
    -------
    functions : ndarray of shape (k, k)
        Coefficients in the eigenfunctions of S_0, one function per column, most trusted first.
    """
    eigenvalues, vectors = np.linalg.eigh(covariance)
    floor = _FLOOR * float(eigenvalues.mean())
    if floor <= 0:
        return np.eye(len(covariance))
    return np.asarray(vectors * (floor / (np.maximum(eigenvalues, 0.0) + floor)))
