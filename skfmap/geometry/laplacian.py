"""Stiffness and mass matrices of triangle meshes."""

import igl
import numpy as np
import robust_laplacian
import scipy.sparse as sp

from skfmap._tools.types import FloatArray, IntArray, SparseMatrix

__all__ = ["LAPLACIANS", "cotangent_laplacian", "robust_mesh_laplacian"]


def cotangent_laplacian(vertices: FloatArray, faces: IntArray) -> tuple[SparseMatrix, FloatArray]:
    """Return the cotangent stiffness matrix and the lumped (barycentric) mass matrix.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles, none of them degenerate.

    Returns
    -------
    stiffness : sparse array of shape (n_vertices, n_vertices)
        Positive semi-definite stiffness matrix (libigl's is negative), without units.
    mass : ndarray of shape (n_vertices,)
        A third of the area of the triangles at each vertex; the sum is the area.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.laplacian import cotangent_laplacian
    >>> vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> stiffness, mass = cotangent_laplacian(vertices, np.array([[0, 1, 2]]))
    >>> stiffness.toarray().round(6) + 0.0
    array([[ 1. , -0.5, -0.5],
           [-0.5,  0.5,  0. ],
           [-0.5,  0. ,  0.5]])
    >>> mass.sum().item()
    0.5
    """
    stiffness = sp.csc_array(-igl.cotmatrix(vertices, faces))
    mass = igl.massmatrix(vertices, faces, igl.MASSMATRIX_TYPE_BARYCENTRIC).diagonal()
    return stiffness, np.asarray(mass)


def robust_mesh_laplacian(vertices: FloatArray, faces: IntArray) -> tuple[SparseMatrix, FloatArray]:
    """Return the tufted intrinsic Delaunay Laplacian and its lumped mass matrix.

    See Sharp and Crane 2020. It is intended for non-manifold and badly shaped meshes, and has the
    same arguments and results as `cotangent_laplacian`.
    """
    stiffness, mass = robust_laplacian.mesh_laplacian(vertices, faces)
    return sp.csc_array(stiffness), np.asarray(mass.diagonal())


LAPLACIANS = {"cotangent": cotangent_laplacian, "robust": robust_mesh_laplacian}
