"""Cross-validation with one reference."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from sklearn.model_selection import BaseCrossValidator, check_cv

from skfmap._tools.types import IntArray
from skfmap._tools.validation import check_samples
from skfmap.shapes import SkippedShape

__all__ = ["PinnedReference"]


class PinnedReference(BaseCrossValidator):
    """Split all samples but the first, and open every training fold with the first.

    A plain splitter, ``cv=5`` for one, tests the first sample as well: there another one becomes
    the reference, without a word, and maps and scores of the folds do not compare, as functional
    maps do on one reference only. No estimator can tell from inside of a fold.

    Shapes that were skipped before (`skfmap.shapes.SkippedShape`) are in no fold.
    ``PinnedReference(LeaveOneOut())`` is the paper's protocol. To hold shapes out by
    `sklearn.model_selection.train_test_split`, split ``X[1:]``, and put ``X[0]`` in front of the
    training part.

    Parameters
    ----------
    cv : int, cross-validation generator or iterable, default=5
        What `sklearn.model_selection.check_cv` takes; it splits ``X[1:]``.
    predict_all : bool, default=False
        Whether each sample is in one test fold, as `sklearn.model_selection.cross_val_predict`
        asks for: the reference too, and shapes that were skipped. They join the first test fold;
        the reference is in its training fold all the same, and its answer is that of a shape that
        was learned from. Scores would count it: use it for predictions only.

    Examples
    --------
    >>> from sklearn.model_selection import LeaveOneOut
    >>> from skfmap.model_selection import PinnedReference
    >>> for train, test in PinnedReference(LeaveOneOut()).split(list("rabc")):
    ...     print(train.tolist(), test.tolist())
    [0, 2, 3] [1]
    [0, 1, 3] [2]
    [0, 1, 2] [3]

    All maps to one reference, each made without the shape that it is of:

    >>> for train, test in PinnedReference(LeaveOneOut(), predict_all=True).split(list("rabc")):
    ...     print(train.tolist(), test.tolist())
    [0, 2, 3] [0, 1]
    [0, 1, 3] [2]
    [0, 1, 2] [3]
    """

    def __init__(self, cv: Any = 5, *, predict_all: bool = False) -> None:
        self.cv = cv
        self.predict_all = predict_all

    def split(
        self, X: Sequence[Any], y: Any = None, groups: Any = None
    ) -> Iterator[tuple[IntArray, IntArray]]:
        """Yield training and test indices; sample 0 is in every training fold.

        It is in no test fold, or in the first one with ``predict_all``.

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
        samples, answers = _samples(X), None if y is None else list(y)
        rest = self._indices(samples)
        # What is in no test fold of the inner splitter.
        also = np.setdiff1d(np.arange(len(samples)), rest) if self.predict_all else rest[:0]
        inner_y = None if answers is None else [answers[i] for i in rest.tolist()]
        inner_groups = None if groups is None else np.asarray(groups)[rest]
        for train, test in self._inner().split(
            [samples[i] for i in rest.tolist()], inner_y, inner_groups
        ):
            yield np.concatenate([[0], rest[train]]), np.concatenate([also, rest[test]])
            also = rest[:0]

    def get_n_splits(self, X: Any = None, y: Any = None, groups: Any = None) -> int:
        """Return the number of folds."""
        rest = None if X is None else self._indices(_samples(X))
        inner = None if rest is None else rest.tolist()
        inner_y = None if y is None or rest is None else [list(y)[i] for i in rest.tolist()]
        inner_groups = (
            None if groups is None else np.asarray(groups)[slice(1, None) if rest is None else rest]
        )
        return int(self._inner().get_n_splits(inner, inner_y, inner_groups))

    def __repr__(self) -> str:
        return f"PinnedReference(cv={self.cv!r}{', predict_all=True' if self.predict_all else ''})"

    def _inner(self) -> Any:
        if hasattr(self.cv, "__next__"):  # a generator of splits would be used up by the first call
            self.cv = list(self.cv)
        return check_cv(self.cv)

    @staticmethod
    def _indices(X: Sequence[Any]) -> IntArray:
        """Return the indices of the samples that are split.

        Neither the first nor those that were skipped.
        """
        rest = [i for i in range(1, len(X)) if not isinstance(X[i], SkippedShape)]
        if len(rest) < 2:
            raise ValueError(
                "PinnedReference needs the reference and at least two more shapes, one to train "
                f"on and one to test; got {len(rest) + min(1, len(X))}."
            )
        return np.array(rest)


def _samples(X: Sequence[Any]) -> list[Any]:
    return list(check_samples(X, "shapes")) if len(X) else []
