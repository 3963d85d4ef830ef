"""Cross-validation with one reference."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from sklearn.model_selection import BaseCrossValidator, check_cv

from skfmap._typing import IntArray

__all__ = ["PinnedReference"]


class PinnedReference(BaseCrossValidator):
    """Split all samples but the first, and open every training fold with the first.

    Scores of functional maps compare only on one reference. ``PinnedReference(LeaveOneOut())`` is the paper's protocol.

    Parameters
    ----------
    cv : int, cross-validation generator or iterable, default=5
        What `sklearn.model_selection.check_cv` takes; it splits ``X[1:]``.

    Examples
    --------
    >>> from sklearn.model_selection import LeaveOneOut
    >>> from skfmap.model_selection import PinnedReference
    >>> for train, test in PinnedReference(LeaveOneOut()).split(list("rabc")):
    ...     print(train.tolist(), test.tolist())
    [0, 2, 3] [1]
    [0, 1, 3] [2]
    [0, 1, 2] [3]
    """

    def __init__(self, cv: Any = 5) -> None:
        self.cv = cv

    def split(self, X: Sequence[Any], y: Any = None, groups: Any = None) -> Iterator[tuple[IntArray, IntArray]]:
        """Yield training and test indices; sample 0 is in every training fold and in no test fold.

        Parameters
        ----------
        X : sequence
            The samples, the reference first.
        y : sequence, optional
            The correspondences; carried along for stratified and grouped splitters.
        groups : array-like, optional
            Group of each sample, the reference's included.

        Yields
        ------
        train, test : ndarray of int
            Indices into ``X``.
        """
        rest = np.arange(1, self._n_samples(X))
        inner_y = None if y is None else [y[i] for i in rest.tolist()]
        inner_groups = None if groups is None else np.asarray(groups)[rest]
        for train, test in self._inner().split([X[i] for i in rest.tolist()], inner_y, inner_groups):
            yield np.concatenate([[0], rest[train]]), rest[test]

    def get_n_splits(self, X: Any = None, y: Any = None, groups: Any = None) -> int:
        """Return the number of folds."""
        inner = None if X is None else list(range(1, self._n_samples(X)))
        inner_y = None if y is None or X is None else [y[i] for i in range(1, len(X))]
        inner_groups = None if groups is None else np.asarray(groups)[1:]
        return int(self._inner().get_n_splits(inner, inner_y, inner_groups))

    def _inner(self) -> Any:
        if hasattr(self.cv, "__next__"):  # a generator of splits would be used up by the first call
            self.cv = list(self.cv)
        return check_cv(self.cv)

    @staticmethod
    def _n_samples(X: Sequence[Any]) -> int:
        if len(X) < 3:
            raise ValueError(
                f"PinnedReference needs the reference and at least two more shapes, one to train on and one to test; "
                f"got {len(X)}."
            )
        return len(X)
