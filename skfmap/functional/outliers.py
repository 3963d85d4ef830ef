"""Detection of pairs of points that no smooth map can fit."""

import numpy as np

from skfmap._tools.types import BoolArray, FloatArray

__all__ = ["wrong_pairs"]

# The figures below are for TOSCA's cats, with a tenth of the pairs exchanged at random.
#
# Number of functions of a smooth map. 10, 20, 30 and 50 functions find 88, 93, 94 and 96 % of the
# wrong pairs; if three tenths are wrong, 86, 42, 1 and 0 %: the more functions, the better a wrong
# map fits.
_N_FUNCTIONS = 20
# Minimum number of pairs per function: fewer pairs are fitted by fewer functions, but by at least
# eight. Of 50 right pairs on creatures, five functions classify 11 to 16 % as wrong, seven or more
# none; with a tenth exchanged, eight find 88 %.
_PAIRS_PER_FUNCTION, _FEWEST_FUNCTIONS = 10, 8
# A pair is wrong if its residual exceeds this many medians: 3, 4, 5 and 6 find 96, 93, 84 and 54 %
# of the wrong pairs, and classify 1.6, 0.24, 0.08 and 0.02 % of the right ones as wrong.
_FAR = 4.0
# The residual of a wrong pair is about that of unrelated points. A residual below this fraction of
# it may be due to a poor fit, and the pair is kept. Of 60 right pairs on creatures, 1.8 % are
# classified as wrong without this rule and 0.6 % with it; of the wrong ones 86 and 84 % are found.
_OF_CHANCE, _N_SHIFTS = 0.4, 16
# Maximum number of rounds. Nothing changes after 5; with three tenths wrong, 5, 10 and 20 rounds
# find 19, 42 and 43 %.
_N_ROUNDS = 10
# Fewer pairs than this are too few to judge one another by.
_FEWEST = 50
# The median is meaningful only if most of the pairs are right.
_MOST_WRONG = 0.5
# Residuals below this are rounding errors; the mean square of an eigenfunction is 1.
_ROUNDING = 1e-9


def wrong_pairs(evecs_i: FloatArray, evecs_0: FloatArray, areas: FloatArray) -> BoolArray:
    """Return which pairs are far from where a smooth map, fitted to the other pairs, puts them.

    Parameters
    ----------
    evecs_i, evecs_0 : ndarray of shape (n_pairs, k)
        Eigenfunctions at the paired points of S_i and S_0.
    areas : ndarray of shape (n_pairs,)
        Area that each pair represents. All pairs with a positive area have the same weight: if a
        fit to a hundred pairs is weighted by area, it misses so many small ones that 6 % of the
        right pairs are dropped.

    Returns
    -------
    wrong : ndarray of bool, shape (n_pairs,)
        True for wrong pairs; never for more than half of them.

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
        # If a map fits the pairs exactly, the median is rounding error.
        far = distances > np.max([_FAR * np.median(distances[right]), least, _ROUNDING])
        if np.array_equal(far, wrong) or far.mean() > _MOST_WRONG:
            break
        wrong = far
    return wrong


def _by_chance(images: FloatArray, evecs_0: FloatArray) -> float:
    """Return the median distance between unrelated points, from shifted pairs."""
    shifts = np.unique(np.linspace(1, len(images) - 1, _N_SHIFTS).astype(int))
    medians = [
        np.median(np.linalg.norm(images - np.roll(evecs_0, shift, axis=0), axis=1))
        for shift in shifts
    ]
    return float(np.median(medians))
