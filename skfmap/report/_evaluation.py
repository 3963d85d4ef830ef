"""Cross-validated matches of the training shapes, all on one reference."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, clone
from sklearn.model_selection import BaseCrossValidator

from skfmap._tools.parallel import tell
from skfmap._tools.types import IntArray
from skfmap._tools.unwrap import fitted_learner, learner_and_shapes
from skfmap._tools.validation import label
from skfmap.learner import BridgedLearner, WeightedFunctionalMapLearner
from skfmap.learner.given_answers import drawn_on_working_meshes, errors_on_working_mesh
from skfmap.learner.inputs import check_correspondences
from skfmap.metrics import PairErrors
from skfmap.model_selection import PinnedReference
from skfmap.shapes import Correspondence, Match, Mesh, ProbedShape, SkippedShape

__all__ = ["Evaluation", "evaluate", "folds_of", "index_of_reference", "thin_out", "trained"]

Learner: TypeAlias = WeightedFunctionalMapLearner | BridgedLearner
# Values that scikit-learn accepts for cv.
CrossValidation: TypeAlias = int | BaseCrossValidator | Iterable[tuple[IntArray, IntArray]]

# Largest number of template points that errors are averaged over. All points of a full-resolution
# mesh would need gigabytes of distances; the standard error with 5,000 is 1.4 % of the spread.
_MOST_POINTS = 5000


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Matches of shapes by models that were not trained on them.

    Attributes
    ----------
    meshes : list of Mesh
        Working meshes of the shapes, without the reference. Matches and errors refer to their
        vertices.
    matches : list of Match
        Match of each shape to the reference.
    errors : list of PairErrors
        Errors of the matches.
    naive_errors : list of PairErrors
        Errors of the same model without weights (D = I); empty if not requested.
    """

    meshes: list[Mesh]
    matches: list[Match]
    errors: list[PairErrors]
    naive_errors: list[PairErrors]


def evaluate(
    model: BaseEstimator,
    X: Sequence[Any],
    y: Sequence[Correspondence | ArrayLike],
    *,
    cv: CrossValidation = 5,
    y_scored: Sequence[Correspondence | ArrayLike] | None = None,
    naive: bool = True,
    verbose: int = 0,
) -> Evaluation:
    """Cross-validate a model: train it without some of the shapes, and match those.

    All folds use the parameters and the reference of the model. Bases and probes are computed once,
    by the transformers of the model.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, Pipeline or fitted search
        Fitted model.
    X : sequence of shapes
        Shapes that the model was fitted on, including the reference.
    y : sequence of correspondences
        Correspondence of each shape with the template.
    cv : int, cross-validation generator or iterable, default=5
        How to split the shapes, without the reference; see
        `skfmap.model_selection.PinnedReference`.
    y_scored : sequence of correspondences, optional
        Correspondences to score the matches with; ``y`` by default. With sparse landmarks, give
        those that were not learned from.
    naive : bool, default=True
        Whether to also evaluate the model without weights, for comparison.
    verbose : int, default=0
        If 1, report each fold.

    Returns
    -------
    Evaluation
        One entry for each shape except the reference, in the order of ``X``. Shapes that were
        skipped by earlier steps, or by the learner because of their correspondences, have none.

    Raises
    ------
    CorrespondenceError
        If a correspondence does not belong to its shape.
    ValueError
        If ``X`` does not contain the model's reference or at least two other shapes, or if ``y``
        has another length.
    """
    learner, given = learner_and_shapes(model, X)
    skip = fitted_learner(model).on_invalid == "skip"
    known = check_correspondences(y, given, skip=skip)
    asked = known if y_scored is None else check_correspondences(y_scored, given, skip=skip)
    usable = [
        i
        for i in range(len(given))
        if not any(isinstance(one[i], SkippedShape) for one in (known, asked))
    ]
    index = index_of_reference(learner, given, usable)
    order = [index, *(i for i in usable if i != index)]
    shapes, truths = [given[i] for i in order], [known[i] for i in order]
    scored = thin_out([asked[i] for i in order])
    fitted: dict[int, tuple[Match, PairErrors]] = {}
    without: dict[int, PairErrors] = {}
    splits = list(PinnedReference(folds_of(cv, len(shapes) - 1)).split(shapes, truths))
    for fold, (train, test) in enumerate(splits, start=1):
        if verbose:
            tell(
                f"fold {fold} of {len(splits)}: "
                f"{', '.join(label(shapes[i].name, 'shape') for i in test)} left out"
            )
        own = trained(learner, shapes, truths, train)
        matches, errors = own.match([shapes[i] for i in test]), _errors(own, shapes, scored, test)
        fitted |= dict(zip(test.tolist(), zip(matches, errors, strict=True), strict=True))
        if naive:
            plain = trained(learner, shapes, truths, train, weighting=None)
            without |= dict(zip(test.tolist(), _errors(plain, shapes, scored, test), strict=True))
    tested = sorted(fitted)
    return Evaluation(
        [shapes[i].spectral.mesh for i in tested],
        [_drawn(fitted[i][0], shapes[i], shapes[0]) for i in tested],
        [errors_on_working_mesh(fitted[i][1], shapes[i].spectral) for i in tested],
        [errors_on_working_mesh(without[i], shapes[i].spectral) for i in tested if naive],
    )


def thin_out(truths: Sequence[Correspondence]) -> list[Correspondence]:
    """Restrict correspondences to at most 5,000 randomly chosen template points, for scoring."""
    points = np.unique(truths[0].pairs[:, 1])
    if len(points) <= _MOST_POINTS:
        return list(truths)
    chosen = np.random.default_rng(0).choice(points, _MOST_POINTS, replace=False)
    return [truth.restrict(chosen) for truth in truths]


def _drawn(match: Match, shape: ProbedShape, reference: ProbedShape) -> Match:
    return drawn_on_working_meshes(match, shape.spectral, reference.spectral)


def folds_of(cv: CrossValidation, n_shapes: int) -> CrossValidation:
    """Return ``cv``, limited to the number of shapes if it is a number of folds."""
    return min(cv, n_shapes) if isinstance(cv, int) else cv


def index_of_reference(
    learner: Learner, shapes: Sequence[ProbedShape], usable: Sequence[int]
) -> int:
    """Return the index of the reference of a fitted learner among the shapes."""
    wanted = learner.reference_.spectral.given_hash
    for i in usable:
        if shapes[i].spectral.given_hash == wanted:
            return i
    raise ValueError(
        f"X does not contain the model's reference, {label(learner.reference_.name, 'shape')}. "
        "Give the shapes that the model was fitted on, transformed by the same steps."
    )


def trained(
    learner: Learner,
    shapes: Sequence[ProbedShape],
    truths: Sequence[Correspondence],
    train: IntArray,
    **changes: Any,
) -> Learner:
    """Return a learner with the same parameters, fitted on a fold; its reference comes first."""
    fresh = clone(learner)
    getattr(fresh, "estimator", fresh).set_params(reference="first", verbose=0, **changes)
    return fresh.fit([shapes[i] for i in train], [truths[i] for i in train])


def _errors(
    learner: Learner,
    shapes: Sequence[ProbedShape],
    scored: Sequence[Correspondence],
    test: IntArray,
) -> list[PairErrors]:
    errors = learner.pair_errors(
        [shapes[i] for i in test], [scored[i] for i in test], reference_y=scored[0]
    )
    return list(errors)
