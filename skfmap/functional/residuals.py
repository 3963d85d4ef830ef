"""How far points land from where they belong, and how far to trust each function for that.

A functional map puts a point x of S_i at the row of Phi_i C, while its image T x sits at the row of
Phi_0. How the two differ on the training shapes is what a nearest-neighbour search on a new shape
has to forgive: some functions are mapped worse than others (section 4.1 of the paper), and a map
cut to k functions moves every point a little.
"""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["calibrated_covariance", "residual_covariance", "trusted_functions"]

# Added to the eigenvalues of a covariance, as a share of their mean: no function is trusted
# without limit. Errors of TOSCA's cats left out, times 100, matched and refined (bijective
# ZoomOut), with 0.05: 3.01, 1.83; with 0.2: 3.09, 1.76; with 0.5: 3.19, 1.77.
_FLOOR = 0.2
# A pair that alone decides where its map puts it says nothing: residuals are enlarged ten times
# at most. Of the cats' pairs, one in a hundred is held at two landmarks per function, none at
# three.
_MOST_LEVERAGE = 0.9
# Eigenvalues of a Gram matrix, as a share of its largest, that are nil to rounding: what no pair
# sees.
_UNSEEN = 1e-10

# Share of the residuals' own covariance in `calibrated_covariance`, which has the figures.
_OBSERVED = 0.3


def residual_covariance(
    evecs_i: FloatArray,
    evecs_0: FloatArray,
    areas: FloatArray,
    C: FloatArray,
    leverage_of: FloatArray | None = None,
) -> FloatArray:
    r"""Return the mean squared difference between where a map puts points and where they belong.

    .. math:: \Sigma = \sum_q a_q\, r_q r_q^T / \sum_q a_q,
              \qquad r_q = \Phi_i(x_q)\, C - \Phi_0(T x_q)

    Its part within the first k functions of S_i is Y diag(s^2) Y^T of the stable basis; the rest is
    what the cut to k functions costs.

    Parameters
    ----------
    evecs_i, evecs_0 : ndarray of shape (n_pairs, k)
        Eigenfunctions at paired points of S_i and S_0.
    areas : ndarray of shape (n_pairs,)
        Area that each pair stands for.
    C : ndarray of shape (k, k)
        Functional map, from functions on S_0 to functions on S_i.
    leverage_of : ndarray of shape (k, k), optional
        If ``C`` was fitted to these very pairs by least squares, its Gram matrix. Each residual is
        then the one that the pair would have if it had been left out, so that few pairs do not look
        better than many.

    Returns
    -------
    covariance : ndarray of shape (k, k)
        Symmetric, positive semi-definite.
    """
    residuals = evecs_i @ C - evecs_0
    if leverage_of is not None:
        inverse = np.linalg.pinv(leverage_of, rcond=_UNSEEN, hermitian=True)
        leverage = areas * ((evecs_i @ inverse) * evecs_i).sum(axis=1)
        residuals = residuals / (1 - np.minimum(leverage, _MOST_LEVERAGE))[:, None]
    covariance = (areas[:, None] * residuals).T @ residuals / areas.sum()
    return np.asarray((covariance + covariance.T) / 2)


def calibrated_covariance(covariance: FloatArray, residuals: FloatArray) -> FloatArray:
    """Return a covariance whose variances are those of a few residuals that can be relied on.

    What built maps show of themselves is too good, in some functions more than in others: they go
    where functions agree. What they miss at landmarks that were left out of the building is true,
    but few points do not tell how functions err together. So the correlations are those of the
    covariance, the variances those of the residuals, and the residuals' own covariance has a share.

    Parameters
    ----------
    covariance : ndarray of shape (k, k)
        From `residual_covariance`.
    residuals : ndarray of shape (n, k)
        At landmarks left out.

    Returns
    -------
    ndarray of shape (k, k)
        Symmetric, positive semi-definite.

    Notes
    -----
    Refined errors of three of TOSCA's cats, left out, where known maps are built from 13, 25 and 50
    landmarks: 0.0268, 0.0264 and 0.0259 with the first covariance alone; where the residuals'
    covariance has a share of 0 beside their variances, 0.0255, 0.0256 and 0.0250; of 0.3, 0.0250,
    0.0261 and 0.0251; of 0.5, 0.0254, 0.0264 and 0.0254. From all pairs 0.0242.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional import calibrated_covariance
    >>> calibrated_covariance(np.eye(2), np.array([[1.0, 2.0], [1.0, -2.0]])).tolist()
    [[1.0, 0.0], [0.0, 4.0]]
    """
    observed = residuals.T @ residuals / len(residuals)
    variances, own = np.diag(observed), np.diag(covariance)
    scales = np.sqrt(variances / np.where(own > 0, own, np.inf))
    rescaled = scales[:, None] * covariance * scales
    return np.asarray((1 - _OBSERVED) * rescaled + _OBSERVED * observed)


def trusted_functions(covariance: FloatArray) -> FloatArray:
    """Return the functions on S_0 in which points are matched, scaled by how far to trust each.

    The eigenvectors v of the covariance, each divided by its eigenvalue plus a floor, so that a
    difference between two points counts less where maps are known to err. A function without error
    has weight 1.

    Parameters
    ----------
    covariance : ndarray of shape (k, k)
        From `residual_covariance`, averaged over training shapes.

    Returns
    -------
    functions : ndarray of shape (k, k)
        Coefficients in the eigenfunctions of S_0, one function per column, most trusted first.

    Notes
    -----
    Division by the square root would make distances those of Mahalanobis, the likelihood of
    Gaussian residuals. It matches worse: the errors of TOSCA's cats left out in turn are 0.0309
    with the eigenvalue and 0.0333 with its root, refined (bijective ZoomOut) 0.0176 and 0.0184;
    with the best of other floors for the root 0.0314 and 0.0179.
    """
    eigenvalues, vectors = np.linalg.eigh(covariance)
    floor = _FLOOR * float(eigenvalues.mean())
    if floor <= 0:
        return np.eye(len(covariance))
    return np.asarray(vectors * (floor / (np.maximum(eigenvalues, 0.0) + floor)))
