"""Reach the learner inside a pipeline or a fitted search."""

from collections.abc import Sequence
from typing import Any

from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

__all__ = ["learner_and_shapes"]


def learner_and_shapes(model: Any, X: Sequence[Any]) -> tuple[Any, Sequence[Any]]:
    """Return the fitted learner at the end of ``model``, and ``X`` as the steps before it transform it.

    ``model`` is a learner, a Pipeline that ends in one, or a fitted search over either.
    """
    if hasattr(model, "estimator") and not hasattr(model, "match"):
        check_is_fitted(model, "best_estimator_")
        model = model.best_estimator_
    learner = model
    if isinstance(model, Pipeline):
        check_is_fitted(model[-1])
        X, learner = (model[:-1].transform(X) if len(model) > 1 else X), model[-1]
    if not hasattr(learner, "functional_maps"):
        raise TypeError(
            f"Expected a WeightedFunctionalMapLearner, a Pipeline that ends in one, or a fitted search over either; "
            f"got {type(model).__name__}."
        )
    return learner, X
