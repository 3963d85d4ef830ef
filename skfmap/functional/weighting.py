"""The weighting strategies of section 5.2: which probes share a weight."""

from collections.abc import Hashable, Sequence

import numpy as np

from skfmap._tools.types import IntArray, WeightingWord

__all__ = ["WEIGHTINGS", "check_weighting", "coarse_groups", "weight_groups"]

WEIGHTINGS: tuple[WeightingWord | None, ...] = (None, "unique", "category", "function")


def weight_groups(
    weighting: str | Sequence[Hashable] | None, categories: Sequence[str]
) -> IntArray:
    """Return the index of the free weight that each probe uses, shape (n_probes,).

    Parameters
    ----------
    weighting : {"unique", "category", "function"}, sequence of labels or None
        One weight for all probes, one per category, one per probe function, one per label, or no
        weights to learn (D = I).
    categories : sequence of str
        Category of each probe.

    Returns
    -------
    groups : ndarray of int, shape (n_probes,)
        Indices from 0; all -1 if there is nothing to learn.

    Examples
    --------
    >>> from skfmap.functional import weight_groups
    >>> weight_groups("category", ["hks", "hks", "wks"]).tolist()
    [0, 0, 1]
    >>> weight_groups(["coarse", "fine", "coarse"], ["hks", "hks", "wks"]).tolist()
    [0, 1, 0]
    """
    n_probes = len(categories)
    if weighting is None:
        return np.full(n_probes, -1)
    if not isinstance(weighting, str):
        return _numbered(weighting)
    if weighting == "unique":
        return np.zeros(n_probes, dtype=np.int64)
    if weighting == "function":
        return np.arange(n_probes)
    return _numbered(categories)


def coarse_groups(groups: IntArray, categories: Sequence[str]) -> IntArray | None:
    """Return groups with one weight per category.

    None if the categories are not unions of whole groups, or are not fewer than the groups.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional.weighting import coarse_groups
    >>> coarse_groups(np.array([0, 1, 2]), ["hks", "hks", "wks"]).tolist()
    [0, 0, 1]
    """
    coarse = _numbered(categories)
    pairs = np.unique(np.column_stack([groups, coarse]), axis=0)
    return coarse if coarse.max() < groups.max() and len(pairs) == groups.max() + 1 else None


def check_weighting(weighting: object, n_probes: int) -> None:
    """Raise unless ``weighting`` is valid for this number of probes."""
    if weighting is None or (isinstance(weighting, str) and weighting in WEIGHTINGS):
        return
    if isinstance(weighting, str) or not hasattr(weighting, "__len__"):
        raise ValueError(
            f"weighting must be one of {WEIGHTINGS}, or one label for each probe; got "
            f"{weighting!r}."
        )
    if len(weighting) != n_probes:
        raise ValueError(
            f"weighting must be a label for each of the {n_probes} probes; got {len(weighting)} "
            "labels."
        )
    labels: Sequence[object] = list(weighting)  # type: ignore[call-overload]
    strange = [item for item in labels if not isinstance(item, Hashable)]
    if strange:
        raise TypeError(f"The labels of weighting must be strings or numbers; got {strange[0]!r}.")


def _numbered(labels: Sequence[Hashable]) -> IntArray:
    """Return labels as integers, numbered in order of first occurrence."""
    number = {label: i for i, label in enumerate(dict.fromkeys(labels))}
    return np.array([number[label] for label in labels], dtype=np.int64)
