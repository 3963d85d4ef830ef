"""What the learner's exchangeable parts have in common."""

from typing import Any, Self

from sklearn.base import BaseEstimator, clone

from skfmap._tools.documented import Documented

__all__ = ["Part"]


class Part(Documented, BaseEstimator):
    """A part of the learner: a `Refinement` or a `Confidence`.

    It stores its parameters in ``__init__``. What it has to learn from the training shapes goes
    into `fit`, which is called once for all of them, and once more for each fold of a calibration.
    """

    def check_parameters(self) -> None:
        """Raise ValueError or TypeError for a parameter that cannot be used."""

    def fit(self, training: Any, matcher: Any) -> Self:  # noqa: ARG002
        """Learn from training shapes what the part needs; nothing here.

        Parameters
        ----------
        training : TrainingSet
            Training shapes and their known maps.
        matcher : Matcher
            What was learned from them.

        Returns
        -------
        Part
            Itself.
        """
        return self

    def fit_fold(self, training: Any, matcher: Any) -> Self:
        """Return what is learned from some of the shapes that `fit` has learned from.

        A fitted clone here. Override it where what all shapes chose need not be chosen anew.

        Parameters
        ----------
        training : TrainingSet
            Training shapes of a fold.
        matcher : Matcher
            What was learned from them.

        Returns
        -------
        Part
            Another part; this one is not changed.
        """
        other: Self = clone(self)
        other.fit(training, matcher)
        return other
