"""The spectral embedding in which points are matched to their nearest neighbours."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["spectral_embeddings"]


def spectral_embeddings(
    evecs_i: FloatArray, evecs_0: FloatArray, C: FloatArray, functions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the vertices of S_i and of S_0, embedded by the values of the given functions.

    A function f on S_0 is pulled back to C f on S_i, and (C f)(x) = f(T x): a point x of S_i and
    its image T x have the same values. The point map T, from S_i to S_0, therefore takes each row
    of the first array to the nearest row of the second. This holds for any C and needs no mass
    matrix.

    Parameters
    ----------
    evecs_i, evecs_0 : ndarray of shape (n_vertices_i, k), ndarray of shape (n_vertices_0, k)
        Eigenfunctions.
    C : ndarray of shape (k, k)
        Functional map, from functions on S_0 to functions on S_i.
    functions : ndarray of shape (k, p)
        Coefficients of functions on S_0: Y_p, or Y with scaled columns.

    Returns
    -------
    points_i, points_0 : ndarray of shape (n_vertices_i, p), ndarray of shape (n_vertices_0, p)
        Phi_i C Y and Phi_0 Y.
    """
    return np.asarray(evecs_i @ (C @ functions)), np.asarray(evecs_0 @ functions)
