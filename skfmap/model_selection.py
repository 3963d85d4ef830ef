"""Cross-validation with the same reference in all folds."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from sklearn.model_selection import BaseCrossValidator, check_cv

from skfmap._tools.types import IntArray
from skfmap._tools.validation import check_samples
from skfmap.shapes import SkippedShape

__all__ = ["PinnedReference"]


class PinnedReference(BaseCrossValidator):
    """Cross-validator that splits all samples but the first, which starts every training fold.

    A plain splitter such as ``cv=5`` also puts the first sample into a test fold. In that fold
    another sample silently becomes the reference, and its maps and scores cannot be compared with
    those of other folds, because functional maps are comparable on one reference only. An estimator
    cannot detect this from inside a fold.

    Shapes that were skipped before (`skfmap.shapes.SkippedShape`) are in no fold.
    ``PinnedReference(LeaveOneOut())`` is the paper's protocol. To hold out shapes with
    `sklearn.model_selection.train_test_split`, split ``X[1:]`` and put ``X[0]`` in front of the
    training part.

    Parameters
    ----------
    cv : int, cross-validation generator or iterable, default=5
        Any value that `sklearn.model_selection.check_cv` accepts; it splits ``X[1:]``.
    predict_all : bool, default=False
        Whether each sample is in exactly one test fold, including the reference and skipped shapes,
        as `sklearn.model_selection.cross_val_predict` requires. These join the first test fold. The
        reference stays in the training fold, so its prediction is that of a training shape. Use
        this option for predictions only, because scores would include the reference.

    Examples
    --------
    >>> from sklearn.model_selection import LeaveOneOut
    >>> from skfmap.model_selection import PinnedReference
    >>> for train, test in PinnedReference(LeaveOneOut()).split(list("rabc")):
    ...     print(train.tolist(), test.tolist())
    [0, 2, 3] [1]
    [0, 1, 3] [2]
    [0, 1, 2] [3]

    For `sklearn.model_selection.cross_val_predict`, with maps that all refer to one reference:

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
            The correspondences; passed on to ``cv``.
        groups : array-like, optional
            Group of each sample, including the reference.

        Yields
        ------
        train, test : ndarray of int
            Indices into ``X``.
        """
        samples, answers = _samples(X), None if y is None else list(y)
        rest = self._indices(samples)
        # Samples that are in no test fold of the inner splitter.
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
        if hasattr(self.cv, "__next__"):  # the first call would exhaust a generator of splits
            self.cv = list(self.cv)
        return check_cv(self.cv)

    @staticmethod
    def _indices(X: Sequence[Any]) -> IntArray:
        """Return the indices of the samples to split: all but the first and skipped ones."""
        rest = [i for i in range(1, len(X)) if not isinstance(X[i], SkippedShape)]
        if len(rest) < 2:
            raise ValueError(
                "PinnedReference needs the reference and at least two more shapes, one to train "
                f"on and one to test; got {len(rest) + min(1, len(X))} shapes."
            )
        return np.array(rest)


def _samples(X: Sequence[Any]) -> list[Any]:
    return list(check_samples(X, "shapes")) if len(X) else []
