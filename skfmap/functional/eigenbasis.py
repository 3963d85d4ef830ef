"""The first eigenfunctions of a Laplacian."""

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from skfmap._tools.ties import ROUNDING, first_of_largest
from skfmap._tools.types import FloatArray, IntArray, SparseMatrix

__all__ = ["fix_signs", "laplacian_eigenbasis"]

# The shift, as a fraction of the last eigenvalue wanted according to Weyl's law (4 pi n on a
# surface of unit area). A shift in the middle of the spectrum wanted is half as far from the last
# eigenvalues as a shift below the first. For 128 functions of a cat, the Krylov space needs 377
# dimensions with a shift below the first, and 345, 321, 281 and 281 with fractions of 0.2, 0.3, 0.5
# and 0.7.
_SHARE = 0.5
# If more than this fraction of the eigenvalues wanted lie below the shift, as on a needle, the
# shift is lowered.
_MOST_BELOW = 0.75
# A pivot smaller than this fraction of the shift would cost more than six digits. The smallest
# pivot is 0.002 to 0.8 on cats and creatures.
_LEAST_PIVOT = 1e-4
# Vectors per block. They share a triangular solve, but larger blocks need more vectors in all
# (docs/speed.rst, "Bases"): 128 functions of a cat take 1.8, 2.2 and 2.7 dimensions each with
# blocks of 1, 4 and 8.
_BLOCK = 4
# An eigenfunction f of unit norm counts as found when its error |K f - theta f| under the inverse K
# is below this fraction of |theta|.
_TOLERANCE = 1e-9
# Smaller problems, and those that need a large part of all eigenfunctions, are solved as dense
# ones. On random balls, both methods take equally long for about 1/15 of all functions at 300
# vertices, 1/4 at 500 and 1/3 at 1,000 and 2,000.
_SMALL = 300
_LARGE_PART = 4
# Dimensions of the Krylov space per function wanted: at the first convergence check, and at the
# point of giving up (plus a constant).
_FIRST_LOOK, _MOST, _SOME_MORE = 1.75, 8.0, 100
# Dimensions per function wanted that gain one more digit; they set when to check again. On a mesh
# of 1,500 vertices a check at 250 dimensions takes as long as ten blocks. Cats and creatures need
# 1/16.
_PER_DIGIT = 1 / 16
# Rounding error of the eigenvalue 0, as a fraction of the shift; anything below is not an
# eigenvalue.
_ROUNDING_OF_NIL = 1e-6
# Rows of a tall matrix that are multiplied at a time, so that part of the product stays in the
# cache; this is twice as fast as all rows at once.
_ROWS = 500
# The integral of f^3 counts as rounding below this fraction of the integral of |f|^3. The
# antisymmetric functions of a symmetric ellipsoid have 1e-12, its other functions 0.009, and those
# of the cats 5e-5 or more.
_NIL_SKEWNESS = 1e-6


def laplacian_eigenbasis(
    stiffness: SparseMatrix, mass: FloatArray, n_components: int
) -> tuple[FloatArray, FloatArray]:
    """Solve ``stiffness @ evecs = diag(mass) @ evecs @ diag(evals)`` for the smallest eigenvalues.

    The method is block Lanczos on the inverse, shifted to the middle of the spectrum wanted, with
    full orthogonalisation and fixed start vectors, so that every run returns the same result. The
    residual norm of (stiffness + x mass)^-1 (stiffness - x mass) f is below 1e-8 for each
    eigenvalue ``x`` and its function ``f``.

    Parameters
    ----------
    stiffness : sparse array of shape (n_vertices, n_vertices)
        Positive semi-definite, of a connected surface.
    mass : ndarray of shape (n_vertices,)
        Lumped mass matrix of the surface at unit area, positive.
    n_components : int
        Number of eigenfunctions, less than ``n_vertices``.

    Returns
    -------
    evals : ndarray of shape (n_components,)
        Eigenvalues in ascending order; the first is exactly 0.
    evecs : ndarray of shape (n_vertices, n_components)
        Mass-orthonormal eigenfunctions. The first is exactly constant and positive; the signs of
        the others are set by `fix_signs`.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the iteration does not converge, or the Laplacian is not finite.

    Examples
    --------
    The Laplacian of a path of three vertices:

    >>> import numpy as np, scipy.sparse as sp
    >>> from skfmap.functional.eigenbasis import laplacian_eigenbasis
    >>> stiffness = sp.csc_array(np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]]))
    >>> evals, evecs = laplacian_eigenbasis(stiffness, np.full(3, 1 / 3), 2)
    >>> evals.round(9).tolist()
    [0.0, 3.0]
    """
    # In g = sqrt(mass) f the problem is an ordinary symmetric one.
    root = np.sqrt(mass)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = sp.diags_array(1 / root)
        symmetric = sp.csc_array(scale @ stiffness @ scale)
    if not np.isfinite(symmetric.data).all():
        raise np.linalg.LinAlgError(
            "its Laplacian is not finite; it may have faces without area, or coordinates with too "
            "few digits"
        )
    if len(mass) <= max(_SMALL, _LARGE_PART * n_components):
        evals, vectors = np.linalg.eigh(symmetric.toarray())
        evals, vectors = evals[:n_components], vectors[:, :n_components]
    else:
        evals, vectors = _block_lanczos(symmetric, root, n_components)
    evals, evecs = np.maximum(evals, 0.0), vectors / root[:, None]
    evals[0] = 0.0
    evecs[:, 0] = 1 / np.sqrt(mass.sum())
    # In column order, so that the first few functions are contiguous in memory too.
    return evals, np.asfortranarray(fix_signs(evecs, mass))


def _block_lanczos(
    A: SparseMatrix, null: FloatArray, n_wanted: int
) -> tuple[FloatArray, FloatArray]:
    """Return the smallest eigenvalues of a matrix with a known null vector, and their vectors.

    Eigenvalues are in ascending order. The basis of the Krylov space of K = (A - shift)^-1 grows by
    one block at a time: K times the last block, orthogonalised against all earlier ones.
    """
    n = len(null)
    shift, solver = _factorise(A, n_wanted)
    most = min(n - _BLOCK, int(_MOST * n_wanted) + _SOME_MORE)
    # One block more than is checked: the last one is written, but not used.
    Q = np.empty((n, most + _BLOCK), order="F")  # memory is only touched as columns are filled
    Q[:, 0] = null / np.linalg.norm(null)
    block = np.random.default_rng(0).standard_normal((n, _BLOCK))
    Q[:, 1 : 1 + _BLOCK] = _orthonormal(block - np.outer(Q[:, 0], Q[:, 0] @ block))[0]
    H = np.zeros((most, most))
    H[0, 0] = -1 / shift
    look, worst = int(_FIRST_LOOK * n_wanted), np.inf
    for end in range(1 + _BLOCK, most + 1, _BLOCK):
        begin, is_last = end - _BLOCK, end + _BLOCK > most
        W = np.asarray(solver.solve(Q[:, begin:end]))
        # K is symmetric, so products with all other blocks are rounding errors.
        near = slice(max(0, begin - _BLOCK), end)
        H[near, begin:end] = Q[:, near].T @ W
        H[begin:end, near] = H[near, begin:end].T
        W -= Q[:, near] @ H[near, begin:end]
        _remove(W, Q[:, :end])
        new, coupling = _orthonormal(W)
        if end >= look or is_last:
            theta, s = scipy.linalg.eigh(H[:end, :end], check_finite=False)
            chosen = _smallest(theta, shift)[:n_wanted]
            if len(chosen) == n_wanted:
                theta, s = theta[chosen], s[:, chosen]
                worst = (np.linalg.norm(coupling @ s[begin:], axis=0) / np.abs(theta)).max()
                if worst <= _TOLERANCE:
                    return shift + 1 / theta, Q[:, :end] @ s
            missing = np.log10(min(worst, 1) / _TOLERANCE)
            look = end + max(_BLOCK, int(_PER_DIGIT * n_wanted * missing))
        Q[:, end : end + _BLOCK] = new
    reached = f"error {worst:.1g} after {end} vectors"
    raise np.linalg.LinAlgError(f"the eigen-solver did not converge: {reached}")


def _factorise(A: SparseMatrix, n_wanted: int) -> tuple[float, SuperLU]:
    """Return a shift in the middle of the smallest eigenvalues, and the factors of A - shift."""
    shift = _SHARE * 4 * np.pi * n_wanted
    while True:
        solver = splu(
            sp.csc_array(A - shift * sp.eye_array(A.shape[0])),
            permc_spec="COLAMD",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        # The number of negative pivots is the number of eigenvalues below the shift (Sylvester).
        pivots = solver.U.diagonal()
        n_below = np.count_nonzero(pivots < 0)
        if n_below > _MOST_BELOW * n_wanted:
            shift *= n_wanted / (2 * n_below)
        elif np.abs(pivots).min() < _LEAST_PIVOT * shift:
            shift *= 0.9
        else:
            return shift, solver


def _smallest(theta: FloatArray, shift: float) -> IntArray:
    """Return the indices that sort the eigenvalues shift + 1 / theta, from 0 upwards.

    ``theta`` is in ascending order.
    """
    below = np.flatnonzero(theta <= (_ROUNDING_OF_NIL - 1) / shift)
    return np.concatenate([below[::-1], np.flatnonzero(theta > 0)[::-1]])


def _remove(W: FloatArray, Q: FloatArray) -> None:
    """Subtract from W, in place, its projection onto the span of the orthonormal Q."""
    parts = [slice(start, start + _ROWS) for start in range(0, len(W), _ROWS)]
    inside = sum(Q[part].T @ W[part] for part in parts)
    for part in parts:
        W[part] -= Q[part] @ inside


def _orthonormal(block: FloatArray) -> tuple[FloatArray, FloatArray]:
    Q, R = scipy.linalg.qr(block, mode="economic", check_finite=False)
    return np.asarray(Q), np.asarray(R)


def fix_signs(evecs: FloatArray, mass: FloatArray) -> FloatArray:
    """Flip functions so that the integral of their cube is positive.

    This sign does not depend on the numbering of the vertices. If the integral is zero up to
    rounding (antisymmetric functions), the entry of largest magnitude is made positive. If several
    entries are equal up to rounding, such as mirrored ones, the first decides.
    """
    cubes = evecs * evecs * evecs
    skewness, magnitude = mass @ cubes, mass @ np.abs(cubes)
    largest = np.array([column[first_of_largest(np.abs(column), ROUNDING)] for column in evecs.T])
    deciding = np.where(np.abs(skewness) > _NIL_SKEWNESS * magnitude, skewness, largest)
    return np.asarray(np.where(deciding < 0, -evecs, evecs))
