"""Bending energy of thin-plate splines, which sliding minimises."""

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import cdist

from skfmap._tools.types import FloatArray

__all__ = ["bending_energy", "bending_matrix"]

# The reference is flat if a singular value is below this fraction of the largest.
_FLAT = 1e-9
# Two points coincide if their distance is at most this fraction of the size of the reference.
_SAME = 1e-9


def bending_matrix(reference: FloatArray) -> FloatArray:
    r"""Return the bending-energy matrix of a reference configuration.

    The thin-plate spline in space interpolates with the kernel :math:`-\|r\|`, and has the least
    bending energy of all maps that take the reference to given points (Bookstein 1989).

    Parameters
    ----------
    reference : ndarray of shape (n_landmarks, 3)
        Distinct points. They may lie in one plane; an affine map that moves them out of it costs no
        energy.

    Returns
    -------
    ndarray of shape (n_landmarks, n_landmarks)
        Symmetric positive semi-definite matrix :math:`L`, in units of one over length: the energy
        of a map to points :math:`Y`, as rows, is :math:`\mathrm{tr}(Y^T L Y)`. It vanishes for
        affine maps of the reference, and only for these.

    Raises
    ------
    ValueError
        If two points coincide.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.landmarks.thin_plate import bending_matrix
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
    >>> L = bending_matrix(corners)
    >>> bool(np.allclose(L @ (2 * corners[:, [1, 0, 2]] + 3), 0)), bool(np.trace(L) > 0)
    (True, True)
    """
    centred = reference - reference.mean(axis=0)
    size = float(np.sqrt(np.square(centred).sum(axis=1).max()))
    apart = cdist(centred, centred)
    np.fill_diagonal(apart, np.inf)
    if len(reference) > 1 and apart.min() <= _SAME * size:
        i, j = np.unravel_index(apart.argmin(), apart.shape)
        raise ValueError(
            f"Points {min(i, j)} and {max(i, j)} of the reference coincide; leave one of them out."
        )
    np.fill_diagonal(apart, 0.0)
    U, s, _ = np.linalg.svd(np.column_stack([np.ones(len(centred)), centred / (size or 1.0)]))
    free = U[:, int((s > _FLAT * s[0]).sum()) :]  # orthogonal to all affine maps
    return np.asarray(free @ np.linalg.solve(-free.T @ apart @ free, free.T))


def bending_energy(points: npt.ArrayLike, reference: npt.ArrayLike) -> float:
    """Return the bending energy of the thin-plate spline that takes a reference to points.

    Parameters
    ----------
    points : array-like of shape (n_landmarks, 3)
        Images of the points of the reference.
    reference : array-like of shape (n_landmarks, 3)
        Distinct points.

    Returns
    -------
    float
        The energy, which is 0 if and only if the map is affine. It is proportional to the square of
        the size of ``points``, and inversely proportional to the size of the reference.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.landmarks import bending_energy
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
    >>> round(bending_energy(corners @ np.diag([1, 2, 3]), corners), 12)
    0.0
    >>> moved = corners.copy()
    >>> moved[4] *= 1.1
    >>> bending_energy(moved, corners) > 0
    True
    """
    Y, from_ = np.asarray(points, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    if Y.shape != from_.shape or Y.ndim != 2 or Y.shape[1] != 3:
        raise ValueError(
            "points and reference must both have shape (n_landmarks, 3); got "
            f"{Y.shape} and {from_.shape}."
        )
    Y = Y - Y.mean(axis=0)
    return max(0.0, float(np.einsum("ia,ij,ja->", Y, bending_matrix(from_), Y)))
