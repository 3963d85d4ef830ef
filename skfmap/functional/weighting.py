"""The weighting strategies of section 5.2: which probes share a weight."""

from collections.abc import Sequence

import numpy as np

from skfmap._typing import IntArray

__all__ = ["WEIGHTINGS", "weight_groups"]

WEIGHTINGS = (None, "unique", "category", "function")


def weight_groups(weighting: str | None, categories: Sequence[str]) -> IntArray:
    """Return the number of the free weight that each probe uses, shape (n_probes,).

    Parameters
    ----------
    weighting : {"unique", "category", "function"} or None
        One weight for all, one per category, one per probe function, or none to learn (D = I).
    categories : sequence of str
        Category of each probe.

    Returns
    -------
    groups : ndarray of int, shape (n_probes,)
        Numbers from 0; all -1 if there is nothing to learn.

    Examples
    --------
    >>> from skfmap.functional import weight_groups
    >>> weight_groups("category", ["hks", "hks", "wks"]).tolist()
    [0, 0, 1]
    """
    n_probes = len(categories)
    if weighting is None:
        return np.full(n_probes, -1)
    if weighting == "unique":
        return np.zeros(n_probes, dtype=np.int64)
    if weighting == "function":
        return np.arange(n_probes)
    first_seen = list(dict.fromkeys(categories))
    return np.array([first_seen.index(category) for category in categories], dtype=np.int64)
