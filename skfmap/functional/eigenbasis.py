"""The first eigenfunctions of a Laplacian."""

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from skfmap._tools.ties import ROUNDING, first_of_largest
from skfmap._tools.types import FloatArray, SparseMatrix

__all__ = ["fix_signs", "laplacian_eigenbasis"]

# The inverse iteration is shifted to well below the first non-zero eigenvalue of a surface of
# unit area: 25 on a sphere, 6 to 7 on TOSCA's cats, where any shift from 1e-6 to 10 needs as many
# vectors.
_SHIFT = 0.01
# Vectors at a time share a triangular solve, but need more of them in all (docs/speed.rst,
# "Bases"): of a cat, 128 functions take 2.5, 2.9, 3.6 and 4.5 dimensions each by blocks of 1, 4,
# 8 and 16.
_BLOCK = 4
# Residual |A v - lambda v| of unit vectors, relative to max(lambda, 1), at which a function counts
# as found: what ARPACK leaves as well (docs/speed.rst, "Bases").
_TOLERANCE = 1e-10
# Smaller problems, and those that need a large part of all eigenfunctions, are solved as dense
# ones. Random balls take as long either way for about 1/30 of all functions at 300 vertices, 1/11
# at 1,000 and 1/7 at 2,000.
_SMALL = 300
_LARGE_PART = 8
# Dimensions of the Krylov space per function wanted: how many to begin looking at, and how many,
# and some more, to give up at. A cat needs 5.3 (16 functions), 4.2 (32), 2.9 (128) and 2.6 (256).
_FIRST_LOOK, _MOST, _SOME_MORE = 2.0, 8.0, 100
# Looks are a twelfth of the functions wanted apart: 128 of a cat are found at the eleventh.
_LOOKS = 12
# Share of the integral of |f|^3 below which that of f^3 is rounding: antisymmetric functions of a
# symmetric ellipsoid leave 1e-12, its others 0.009, those of the cats 5e-5 and more.
_NIL_SKEWNESS = 1e-6


def laplacian_eigenbasis(
    stiffness: SparseMatrix, mass: FloatArray, n_components: int
) -> tuple[FloatArray, FloatArray]:
    """Solve ``stiffness @ evecs = diag(mass) @ evecs @ diag(evals)`` for the smallest eigenvalues.

    Block Lanczos on the shifted inverse, with full orthogonalisation and fixed start vectors, so
    that every run returns the same result. Residuals relative to max(eigenvalue, 1) are below 1e-9.

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
        If the iteration does not converge, or the Laplacian is not finite.

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
    if not np.isfinite(symmetric.data).all():
        raise np.linalg.LinAlgError(
            "its Laplacian is not finite, as of faces without area or coordinates without digits"
        )
    if len(mass) <= max(_SMALL, _LARGE_PART * n_components):
        evals, vectors = np.linalg.eigh(symmetric.toarray())
        evals, vectors = evals[:n_components], vectors[:, :n_components]
    else:
        evals, vectors = _block_lanczos(symmetric, root, n_components)
    evals, evecs = np.maximum(evals, 0.0), vectors / root[:, None]
    evals[0] = 0.0
    evecs[:, 0] = 1 / np.sqrt(mass.sum())
    # Column by column in memory: fewer of them are a part that is contiguous as well.
    return evals, np.asfortranarray(fix_signs(evecs, mass))


def _block_lanczos(
    A: SparseMatrix, null: FloatArray, n_wanted: int
) -> tuple[FloatArray, FloatArray]:
    """Return the smallest eigenvalues of a matrix with a known null vector, and their vectors.

    Eigenvalues ascend. A basis of the Krylov space of K = (A + shift)^-1 grows by a block at a
    time, each one the part of K times the block before that is new. One more application of K takes
    rounding errors of high frequency out of the Ritz vectors.
    """
    n = len(null)
    shifted = sp.csc_array(A + _SHIFT * sp.eye_array(n))
    solver = splu(
        shifted, permc_spec="COLAMD", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    most = min(n - _BLOCK, int(_MOST * n_wanted) + _SOME_MORE)
    # One block more than is looked at: the last one is written, but not used.
    Q = np.empty((n, most + _BLOCK), order="F")  # columns are touched as they are needed
    Q[:, 0] = null / np.linalg.norm(null)
    block = np.random.default_rng(0).standard_normal((n, _BLOCK))
    Q[:, 1 : 1 + _BLOCK] = _orthonormal(block - np.outer(Q[:, 0], Q[:, 0] @ block))[0]
    H = np.zeros((most, most))
    H[0, 0] = 1 / _SHIFT
    look = int(_FIRST_LOOK * n_wanted)
    for end in range(1 + _BLOCK, most + 1, _BLOCK):
        begin, is_last = end - _BLOCK, end + _BLOCK > most
        W = np.asarray(solver.solve(np.ascontiguousarray(Q[:, begin:end])))
        # K is symmetric: of the other blocks only rounding is left.
        near = slice(max(0, begin - _BLOCK), end)
        H[near, begin:end] = Q[:, near].T @ W
        H[begin:end, near] = H[near, begin:end].T
        W -= Q[:, near] @ H[near, begin:end]
        W -= Q[:, :end] @ (Q[:, :end].T @ W)
        new, coupling = _orthonormal(W)
        if end >= look or is_last:
            theta, s = scipy.linalg.eigh(H[:end, :end], subset_by_index=(end - n_wanted, end - 1))
            errors = np.linalg.norm(coupling @ s[begin:end], axis=0) / theta**2
            if (errors <= _TOLERANCE * np.maximum(1 / theta, 1)).all():
                return _rayleigh_ritz(A, solver.solve(Q[:, :end] @ (s / theta)))
            look = end + max(_BLOCK, n_wanted // _LOOKS)
        Q[:, end : end + _BLOCK] = new
    reached = f"residual {errors.max():.1g} after {end} vectors"
    raise np.linalg.LinAlgError(f"the eigen-solver did not converge: {reached}")


def _orthonormal(block: FloatArray) -> tuple[FloatArray, FloatArray]:
    Q, R = scipy.linalg.qr(block, mode="economic", check_finite=False)
    return np.asarray(Q), np.asarray(R)


def _rayleigh_ritz(A: SparseMatrix, vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the Ritz values and orthonormal Ritz vectors of A in the span of some vectors."""
    within = vectors.T @ np.asarray(A @ vectors)
    evals, mixing = scipy.linalg.eigh((within + within.T) / 2, vectors.T @ vectors)
    return np.asarray(evals), np.asarray(vectors @ mixing)


def fix_signs(evecs: FloatArray, mass: FloatArray) -> FloatArray:
    """Flip functions so that the integral of their cube is positive.

    No renumbering of vertices changes that. Where the integral is nil to rounding (antisymmetric
    functions), the entry of largest magnitude is made positive; of entries that are equal up to
    rounding, as mirrored ones are, the first.
    """
    cubes = evecs * evecs * evecs
    skewness, magnitude = mass @ cubes, mass @ np.abs(cubes)
    largest = np.array([column[first_of_largest(np.abs(column), ROUNDING)] for column in evecs.T])
    deciding = np.where(np.abs(skewness) > _NIL_SKEWNESS * magnitude, skewness, largest)
    return np.asarray(np.where(deciding < 0, -evecs, evecs))
