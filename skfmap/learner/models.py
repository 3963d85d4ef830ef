"""What any fitted model answers: a learner, a Pipeline that ends in one, a fitted search."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from skfmap._tools.types import FloatArray, Model
from skfmap._tools.unwrap import learner_and_shapes
from skfmap.refinement import Refinement
from skfmap.shapes import Match

__all__ = ["functional_maps", "match"]


def match(
    model: Model,
    X: Sequence[Any],
    *,
    refine: str | Refinement | None = "fitted",
    interpolate: str | None = None,
) -> list[Match]:
    """Match shapes with any fitted model.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, BridgedLearner, Pipeline or fitted search
        The model.
    X : sequence
        What the model takes: meshes for a pipeline that begins with `SpectralBasis`.
    refine, interpolate : optional
        As in `WeightedFunctionalMapLearner.match`.

    Returns
    -------
    list of Match
        Point map from each shape to the reference, expected errors, confidence and functional maps.
    """
    learner, shapes = learner_and_shapes(model, X)
    return list(learner.match(shapes, refine=refine, interpolate=interpolate))


def functional_maps(model: Model, X: Sequence[Any]) -> FloatArray:
    """Return full functional maps, from the reference to each shape, by any fitted model.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, BridgedLearner, Pipeline or fitted search
        The model.
    X : sequence
        What the model takes.

    Returns
    -------
    maps : ndarray of shape (n_shapes, k, k)
        X_i(D).
    """
    learner, shapes = learner_and_shapes(model, X)
    return np.asarray(learner.functional_maps(shapes))
