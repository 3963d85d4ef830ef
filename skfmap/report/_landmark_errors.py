"""Landmarks predicted on specimens that were left out of the training, beside the true ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator

from skfmap._tools.parallel import tell
from skfmap._tools.types import FloatArray
from skfmap._tools.unwrap import learner_and_shapes
from skfmap._tools.validation import label
from skfmap.learner import predict_landmarks
from skfmap.learner.landmark_model import LandmarkModel
from skfmap.model_selection import PinnedReference
from skfmap.report._evaluation import CrossValidation, folds_of, index_of_reference, trained
from skfmap.shapes import Correspondence, Landmarks, Mesh, SkippedShape

__all__ = ["LandmarkEvaluation", "evaluate_landmarks"]

# What radii promise, as by default where landmarks are predicted.
_COVERAGE = 0.9


@dataclass(frozen=True, eq=False)
class LandmarkEvaluation:
    """Landmarks of specimens, predicted by models that were not trained on them.

    Attributes
    ----------
    meshes : list of Mesh
        The specimens, without the reference: their working meshes, in the coordinates they came in.
    predicted, true : list of Landmarks
        Of each specimen, in the units and coordinates of its mesh.
    """

    meshes: list[Mesh]
    predicted: list[Landmarks]
    true: list[Landmarks]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all true landmarks, in the order in which they come."""
        return tuple(dict.fromkeys(name for marks in self.true for name in marks.names))

    @cached_property
    def errors(self) -> FloatArray:
        """Distances of predicted from true landmarks.

        Of shape (n_specimens, n_landmarks), in the units of the meshes; NaN where either is
        missing.
        """
        pairs = zip(self.predicted, self.true, strict=True)
        offs = [in_order(one, self.names) - in_order(true, self.names) for one, true in pairs]
        return np.linalg.norm(np.reshape(offs, (len(offs), len(self.names), 3)), axis=2)

    @cached_property
    def expected(self) -> FloatArray:
        """Errors that were expected, shaped as ``errors``; NaN where none was."""
        return self._of_each("expected_error")

    @cached_property
    def radius(self) -> FloatArray:
        """Radii of the balls that were promised to hold true landmarks, shaped as ``errors``."""
        return self._of_each("radius")

    def _of_each(self, what: str) -> FloatArray:
        rows = [
            [
                np.nan
                if getattr(one, what) is None or name not in one.names
                else getattr(one, what)[one.names.index(name)]
                for name in self.names
            ]
            for one in self.predicted
        ]
        return np.reshape(np.asarray(rows, dtype=np.float64), (len(rows), len(self.names)))


def in_order(marks: Landmarks, names: Sequence[str]) -> FloatArray:
    """Return the points of these names, shape (n_names, 3); NaN where there is none."""
    unknown = np.full(3, np.nan)
    return np.array([marks.point(name) if name in marks.names else unknown for name in names])


def evaluate_landmarks(
    model: BaseEstimator,
    X: Sequence[Any],
    y: Sequence[Correspondence | ArrayLike],
    landmarks: Sequence[Landmarks | None],
    *,
    cv: CrossValidation | None = None,
    verbose: int = 0,
) -> LandmarkEvaluation:
    """Return the landmarks of specimens that were left out in turn, predicted from the rest.

    The fit has left specimens out for the errors that it expects, and what it found is taken from
    there: the deformation, what answers are moved by and the errors to expect are those of the
    others; the start of the match and the stiffness of the reference are learned from all. With
    ``cv`` everything is learned anew for each group, which takes a fit each. Parameters are those
    of the model, and so is the reference.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, Pipeline or fitted search
        A fitted model.
    X, y : sequence, sequence of correspondences
        What it was fitted on, the reference among them.
    landmarks : sequence of Landmarks or None
        Of each specimen, in the coordinates of its mesh; None where there are none.
    cv : int, cross-validation generator or iterable, optional
        Splits the specimens without the reference, for fits of their own. By default nothing is
        fitted, unless the model calibrated no errors (``confidence=None``): then one at a time is
        left out.
    verbose : int, default=0
        1 tells each fold.

    Returns
    -------
    LandmarkEvaluation
        One entry for each specimen with landmarks, but for the reference and those that were
        skipped, in the order of ``X``.

    Raises
    ------
    ValueError
        If ``X`` does not hold the model's reference, or fewer than two other specimens, or none of
        these has landmarks.
    """
    learner, given = learner_and_shapes(model, X)
    usable = [i for i, shape in enumerate(given) if not isinstance(shape, SkippedShape)]
    index = index_of_reference(learner, given, usable)
    if cv is None and learner.landmarks_ is not None and len(learner.landmarks_.left_out.indices):
        return _left_out_by_fit(learner.landmarks_, given, y, landmarks)
    order = [index, *(i for i in usable if i != index)]
    shapes: list[Any] = [given[i] for i in order]
    truths: list[Any] = [y[i] for i in order]
    marks = [landmarks[i] for i in order]
    splits = list(PinnedReference(folds_of(cv or len(shapes), len(shapes) - 1)).split(shapes))
    found: dict[int, Landmarks] = {}
    for fold, (train, test) in enumerate(splits, start=1):
        tested = [i for i in test.tolist() if marks[i] is not None]
        if not tested:
            continue
        if verbose:
            names = ", ".join(label(shapes[i].name, "shape") for i in tested)
            tell(f"fold {fold} of {len(splits)}: {names} left out")
        own = trained(learner, shapes, truths, train)
        predicted = predict_landmarks(own, [shapes[i] for i in tested])
        found |= dict(zip(tested, predicted, strict=True))
    if not found:
        raise ValueError("No specimen beside the reference has landmarks to compare with.")
    known = {i: true for i, true in enumerate(marks) if i in found and true is not None}
    return LandmarkEvaluation(
        [shapes[i].spectral.mesh for i in known],
        [found[i] for i in known],
        list(known.values()),
    )


def _left_out_by_fit(
    model: LandmarkModel,
    shapes: Sequence[Any],
    y: Sequence[Any],
    landmarks: Sequence[Landmarks | None],
) -> LandmarkEvaluation:
    """Return what `fit` found on the specimens that it left out.

    What it missed are the points of ``y``; ``landmarks`` may be those of another observer.
    """
    left = model.left_out
    rows = [row for row, i in enumerate(left.indices) if landmarks[i] is not None]
    rows.sort(key=lambda row: int(left.indices[row]))
    meshes, predicted, true = [], [], []
    for row in rows:
        marks, spectral = landmarks[left.indices[row]], shapes[left.indices[row]].spectral
        scale, group = np.sqrt(spectral.area), int(left.groups[row])
        errors, radii = model.expected_errors(group), model.radii(_COVERAGE, group)
        at = Landmarks(
            in_order(y[left.indices[row]].landmarks, model.names) - scale * left.missed[row],
            model.names,
            name=spectral.name,
            expected_error=None if errors is None else scale * errors,
            radius=None if radii is None else scale * radii,
            coverage=None if radii is None else _COVERAGE,
        )
        meshes.append(spectral.mesh)
        predicted.append(at)
        true.append(marks)
    if not true:
        raise ValueError("No specimen beside the reference has landmarks to compare with.")
    return LandmarkEvaluation(meshes, predicted, true)
