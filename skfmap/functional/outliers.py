"""Pairs of points that no smooth map can hold together."""

import numpy as np

from skfmap._typing import BoolArray, FloatArray

__all__ = ["wrong_pairs"]

# A smooth map is one of so few functions, and of a tenth of the pairs at most.
_N_FUNCTIONS = 20
# Residual, in medians, beyond which a pair is left out: on the cats 0.2 % of the right pairs, 95 % of random ones.
_FAR = 4.0
_N_ROUNDS = 10
# With fewer pairs, one that is far says nothing.
_FEWEST = 50


def wrong_pairs(evecs_i: FloatArray, evecs_0: FloatArray, areas: FloatArray) -> BoolArray:
    """Tell which pairs lie far from where a smooth functional map, fitted to the others, puts them.

    Parameters
    ----------
    evecs_i, evecs_0 : ndarray of shape (n_pairs, k)
        Eigenfunctions at the paired points of S_i and S_0.
    areas : ndarray of shape (n_pairs,)
        Area that each pair stands for.

    Returns
    -------
    wrong : ndarray of bool, shape (n_pairs,)
        Never more than half of the pairs.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional import wrong_pairs
    >>> x = np.linspace(-1, 1, 100)
    >>> evecs = np.stack([np.ones(100), x, x**2], axis=1)
    >>> images = evecs.copy()
    >>> images[7] = evecs[90]
    >>> np.flatnonzero(wrong_pairs(evecs, images + 0.01 * np.sin(50 * evecs), np.ones(100))).tolist()
    [7]
    """
    k = min(_N_FUNCTIONS, evecs_i.shape[1], len(evecs_i) // 10)
    wrong = np.zeros(len(evecs_i), dtype=bool)
    if len(evecs_i) < _FEWEST:
        return wrong
    for _ in range(_N_ROUNDS):
        right = ~wrong
        root = np.sqrt(areas[right])[:, None]
        C = np.linalg.lstsq(root * evecs_i[right, :k], root * evecs_0[right, :k], rcond=None)[0]
        distances = np.linalg.norm(evecs_i[:, :k] @ C - evecs_0[:, :k], axis=1)
        # A median of nil is rounding: pairs that a map holds exactly.
        far = distances > np.maximum(_FAR * np.median(distances[right]), 1e-9)
        if np.array_equal(far, wrong) or far.mean() > 0.5:
            break
        wrong = far
    return wrong
