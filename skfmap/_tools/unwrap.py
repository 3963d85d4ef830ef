"""Reach the learner inside a pipeline or a fitted search."""

from collections.abc import Sequence
from typing import Any

from sklearn.base import BaseEstimator
from sklearn.model_selection._search import BaseSearchCV
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted

__all__ = ["fitted_learner", "last_step", "learner_and_shapes"]


def learner_and_shapes(model: BaseEstimator, X: Sequence[Any]) -> tuple[Any, Sequence[Any]]:
    """Return the fitted learner at the end of ``model``, and ``X`` as it reaches that learner.

    ``model`` is a learner, a Pipeline that ends in one, or a fitted search over either.
    """
    learner, steps = _unwrap(model)
    for before in steps:
        X = before.transform(X) if len(before) else X
    return learner, X


def last_step(model: Any) -> Any:
    """Return the fitted learner at the end of ``model``, bridged or not."""
    return _unwrap(model)[0]


def fitted_learner(model: Any) -> Any:
    """Return the fitted learner at the end of ``model``; that of a meta-estimator is inside it."""
    learner = last_step(model)
    while hasattr(learner, "estimator_"):
        learner = last_step(learner.estimator_)
    return learner


def _unwrap(model: Any) -> tuple[Any, list[Any]]:
    learner, steps = model, []
    while not hasattr(learner, "functional_maps"):
        if isinstance(learner, Pipeline):
            steps.append(learner[:-1])
            learner = learner[-1]
        elif isinstance(learner, BaseSearchCV):
            check_is_fitted(learner, "best_estimator_")
            learner = learner.best_estimator_
        else:
            raise TypeError(
                "Expected a WeightedFunctionalMapLearner, a Pipeline that ends in one, or a "
                f"fitted search over either; got {type(model).__name__}."
            )
    check_is_fitted(learner)
    return learner, steps
