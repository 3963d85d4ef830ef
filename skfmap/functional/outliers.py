"""Pairs of points that no smooth map can hold together."""

import numpy as np

from skfmap._tools.types import BoolArray, FloatArray

__all__ = ["wrong_pairs"]

# The figures below are of TOSCA's cats, where a tenth of the pairs is exchanged at random.
#
# A smooth map is one of so few functions. 10, 20, 30 and 50 find 88, 93, 94 and 96 % of the wrong
# pairs; where three tenths are wrong 86, 42, 1 and 0 %: the more functions, the better a wrong
# map fits.
_N_FUNCTIONS = 20
# Pairs per function at least: fewer pairs are fitted by fewer functions, but by eight at least. Of
# 50 right pairs on creatures five functions take 11 to 16 % for wrong, seven or more none; with a
# tenth exchanged, eight find 88 %.
_PAIRS_PER_FUNCTION, _FEWEST_FUNCTIONS = 10, 8
# Residual, in medians, beyond which a pair is left out: 3, 4, 5 and 6 find 96, 93, 84 and 54 % of
# the wrong pairs, and take 1.6, 0.24, 0.08 and 0.02 % of the right ones for wrong.
_FAR = 4.0
# A wrong pair lies about as far away as points do that have nothing to do with each other; with one
# that lies less than this share of that far, a fit may be to blame. Of 60 right pairs on creatures
# 1.8 % are taken for wrong without it, 0.6 % with it, and 86 and 84 % of the wrong ones are found.
_OF_CHANCE, _N_SHIFTS = 0.4, 16
# Nothing changes after 5 rounds; with three tenths wrong, 5, 10 and 20 rounds find 19, 42 and 43 %.
_N_ROUNDS = 10
# Fewer pairs say too little of each other.
_FEWEST = 50
# Most of the pairs have to be right for a median to mean anything.
_MOST_WRONG = 0.5
# A residual that is rounding, of eigenfunctions whose mean square is 1.
_ROUNDING = 1e-9


def wrong_pairs(evecs_i: FloatArray, evecs_0: FloatArray, areas: FloatArray) -> BoolArray:
    """Return which pairs lie far from where a smooth map that is fitted to the others puts them.

    Parameters
    ----------
    evecs_i, evecs_0 : ndarray of shape (n_pairs, k)
        Eigenfunctions at the paired points of S_i and S_0.
    areas : ndarray of shape (n_pairs,)
        Area that each pair stands for. Those of any area count alike: weighted by area, a fit to a
        hundred pairs misses so many of the small ones that 6 % of the right pairs were dropped.

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
    >>> images += 0.01 * np.sin(50 * evecs)
    >>> np.flatnonzero(wrong_pairs(evecs, images, np.ones(100))).tolist()
    [7]
    """
    k = max(len(evecs_i) // _PAIRS_PER_FUNCTION, _FEWEST_FUNCTIONS)
    k = min(_N_FUNCTIONS, evecs_i.shape[1], k)
    wrong = np.zeros(len(evecs_i), dtype=bool)
    if (areas > 0).sum() < _FEWEST:
        return wrong
    for _ in range(_N_ROUNDS):
        right = ~wrong & (areas > 0)
        C = np.linalg.lstsq(evecs_i[right, :k], evecs_0[right, :k], rcond=None)[0]
        images = evecs_i[:, :k] @ C
        distances = np.linalg.norm(images - evecs_0[:, :k], axis=1)
        least = _OF_CHANCE * _by_chance(images[right], evecs_0[right, :k])
        # The median is rounding where a map holds the pairs exactly.
        far = distances > np.max([_FAR * np.median(distances[right]), least, _ROUNDING])
        if np.array_equal(far, wrong) or far.mean() > _MOST_WRONG:
            break
        wrong = far
    return wrong


def _by_chance(images: FloatArray, evecs_0: FloatArray) -> float:
    """Return the median distance of points that are paired with another one's partner."""
    shifts = np.unique(np.linspace(1, len(images) - 1, _N_SHIFTS).astype(int))
    medians = [
        np.median(np.linalg.norm(images - np.roll(evecs_0, shift, axis=0), axis=1))
        for shift in shifts
    ]
    return float(np.median(medians))
