"""Products of gradients that distinguish left from right."""

import numpy as np
import scipy.sparse as sp

from skfmap._tools.types import FloatArray, IntArray

__all__ = ["integrated_oriented_products"]


def integrated_oriented_products(f: FloatArray, g: FloatArray, faces: IntArray) -> FloatArray:
    """Integrate <grad f x grad g, n> against the hat function of each vertex.

    On a triangle the integral of the product is det [f1 - f0, f2 - f0; g1 - g0, g2 - g0] / 2, which
    needs no normal, no division and no length. A reflection of the surface changes its sign (see
    the Poisson bracket of Ren et al. 2018).

    Parameters
    ----------
    f, g : ndarray of shape (n_vertices, n_products)
        Functions on the vertices, in pairs.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles, wound consistently.

    Returns
    -------
    integrals : ndarray of shape (n_vertices, n_products)
        Integrals; the coefficients in the eigenfunctions are ``evecs.T @ integrals``.
    """
    f0, f1, f2 = (f[faces[:, j]] for j in range(3))
    g0, g1, g2 = (g[faces[:, j]] for j in range(3))
    per_corner = ((f1 - f0) * (g2 - g0) - (f2 - f0) * (g1 - g0)) / 6
    corners = (faces.T.ravel(), np.tile(np.arange(len(faces)), 3))
    at_vertices = sp.coo_array((np.ones(faces.size), corners), shape=(len(f), len(faces)))
    return np.asarray(at_vertices.tocsr() @ per_corner)
