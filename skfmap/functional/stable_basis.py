"""Section 4.1: the stable functions, and equation (5)."""

import numpy as np

from skfmap._tools.ties import ROUNDING, first_of_largest
from skfmap._tools.types import FloatArray

__all__ = ["basis_error", "missed_by_maps", "stable_basis"]


def stable_basis(
    differences: FloatArray, sample_weight: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return an orthonormal basis of functions on S_0, in order of decreasing stability.

    The basis consists of the right singular vectors of the stacked differences, in order of
    increasing singular value.

    Parameters
    ----------
    differences : ndarray of shape (n_shapes, k, k)
        X_i(D) - C_i.
    sample_weight : ndarray of shape (n_shapes,), optional
        Share of each shape.

    Returns
    -------
    stable_basis : ndarray of shape (k, k)
        Y: coefficients in the eigenfunctions of S_0, one function per column.
    stability : ndarray of shape (k,)
        Singular values, ascending: the square root of each function's summed squared error.
    """
    share = np.ones(len(differences)) if sample_weight is None else sample_weight
    stacked = (np.sqrt(share)[:, None, None] * differences).reshape(-1, differences.shape[2])
    _, singular_values, vectors = np.linalg.svd(stacked, full_matrices=False)
    Y = vectors[::-1].T
    largest = np.array([column[first_of_largest(np.abs(column), ROUNDING)] for column in Y.T])
    return np.where(largest < 0, -Y, Y), np.asarray(singular_values[::-1])


def basis_error(X: FloatArray, C: FloatArray, Y: FloatArray) -> FloatArray:
    """Return equation (5), the norm of (X - C) y_j for each column of Y; shape (Y.shape[1],)."""
    return np.asarray(np.linalg.norm((X - C) @ Y, axis=0))


def missed_by_maps(
    evecs_0: FloatArray, Y: FloatArray, stability: FloatArray, total_share: float
) -> FloatArray:
    """Return the error of learned maps at each vertex of S_0, per training shape.

    The result has shape (n_vertices_0,). It is the root of the sum over Y of squared (singular
    value times function): how far the maps move a point in the embedding.
    """
    return np.asarray(np.linalg.norm(evecs_0 @ (Y * stability), axis=1) / np.sqrt(total_share))
