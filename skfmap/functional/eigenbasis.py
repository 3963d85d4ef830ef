"""The first eigenfunctions of a Laplacian."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh, splu

from skfmap._typing import FloatArray, SparseMatrix

__all__ = ["fix_signs", "laplacian_eigenbasis"]

# Shift of the inverse iteration: well below the first non-zero eigenvalue of a surface of unit area.
_SHIFT = -0.01


def laplacian_eigenbasis(stiffness: SparseMatrix, mass: FloatArray, n_components: int) -> tuple[FloatArray, FloatArray]:
    """Solve ``stiffness @ evecs = diag(mass) @ evecs @ diag(evals)`` for the smallest eigenvalues.

    Shift-invert Lanczos with a fixed start vector, so that every run returns the same result.

    Parameters
    ----------
    stiffness : sparse array of shape (n_vertices, n_vertices)
        Positive semi-definite, of a connected surface.
    mass : ndarray of shape (n_vertices,)
        Lumped mass matrix of the surface at unit area, positive.
    n_components : int
        Number of eigenfunctions, below ``n_vertices``.

    Returns
    -------
    evals : ndarray of shape (n_components,)
        Ascending, the first exactly 0.
    evecs : ndarray of shape (n_vertices, n_components)
        Mass-orthonormal; the first exactly constant and positive, the others with `fix_signs`.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the iteration does not converge.

    Examples
    --------
    A path of three vertices:

    >>> import numpy as np, scipy.sparse as sp
    >>> from skfmap.functional.eigenbasis import laplacian_eigenbasis
    >>> stiffness = sp.csc_array(np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]]))
    >>> evals, evecs = laplacian_eigenbasis(stiffness, np.full(3, 1 / 3), 2)
    >>> evals.round(9).tolist()
    [0.0, 3.0]
    """
    # In g = sqrt(mass) f the problem is an ordinary symmetric one.
    root = np.sqrt(mass)
    scale = sp.diags_array(1 / root)
    symmetric = sp.csc_array(scale @ stiffness @ scale)
    shifted = sp.csc_array(symmetric - _SHIFT * sp.eye_array(len(mass)))
    solver = splu(shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    inverse = LinearOperator(shifted.shape, matvec=solver.solve, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(len(mass))
    try:
        evals, vectors = eigsh(symmetric, n_components, sigma=_SHIFT, OPinv=inverse, v0=start)
    except ArpackNoConvergence as error:
        raise np.linalg.LinAlgError(f"the eigen-solver did not converge: {error}") from error
    order = np.argsort(evals, kind="stable")
    evals, evecs = np.maximum(evals[order], 0.0), vectors[:, order] / root[:, None]
    evals[0] = 0.0
    evecs[:, 0] = 1 / np.sqrt(mass.sum())
    return evals, fix_signs(evecs, mass)


def fix_signs(evecs: FloatArray, mass: FloatArray) -> FloatArray:
    """Flip functions so that the integral of their cube is positive, which no renumbering of vertices changes.

    Where that integral is nil to rounding (antisymmetric functions), the entry of largest magnitude is made positive.
    """
    skewness = mass @ evecs**3
    size = mass @ np.abs(evecs) ** 3
    largest = np.take_along_axis(evecs, np.argmax(np.abs(evecs), axis=0)[None], axis=0)[0]
    deciding = np.where(np.abs(skewness) > 1e-6 * size, skewness, largest)
    return np.asarray(np.where(deciding < 0, -evecs, evecs))
