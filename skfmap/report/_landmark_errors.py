"""Cross-validated predictions of landmarks, with the true landmarks."""

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

# Coverage of the radii; the default of predict_landmarks.
_COVERAGE = 0.9


@dataclass(frozen=True, eq=False)
class LandmarkEvaluation:
    """Landmarks of specimens, predicted by models that were not trained on them.

    Attributes
    ----------
    meshes : list of Mesh
        Working meshes of the specimens, without the reference, in their original coordinates.
    predicted, true : list of Landmarks
        Landmarks of each specimen, in the units and coordinates of its mesh.
    """

    meshes: list[Mesh]
    predicted: list[Landmarks]
    true: list[Landmarks]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all true landmarks, in order of first occurrence."""
        return tuple(dict.fromkeys(name for marks in self.true for name in marks.names))

    @cached_property
    def errors(self) -> FloatArray:
        """Distances between predicted and true landmarks, of shape (n_specimens, n_landmarks).

        They are in the units of the meshes, and NaN where either landmark is missing.
        """
        pairs = zip(self.predicted, self.true, strict=True)
        offs = [in_order(one, self.names) - in_order(true, self.names) for one, true in pairs]
        return np.linalg.norm(np.reshape(offs, (len(offs), len(self.names), 3)), axis=2)

    @cached_property
    def expected(self) -> FloatArray:
        """Expected errors, of the same shape as ``errors``; NaN where there is none."""
        return self._of_each("expected_error")

    @cached_property
    def radius(self) -> FloatArray:
        """Radii of the balls predicted to contain the true landmarks, shaped as ``errors``."""
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
    """Return the landmarks with these names, of shape (n_names, 3); NaN for missing ones."""
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
    """Predict the landmarks of each training specimen without learning from it.

    By default, the predictions that `fit` made to calibrate expected errors are reused. In these,
    the deformation, the corrections and the expected errors are learned without the specimen, but
    the start of the match and the stiffness of the reference are learned from all specimens. With
    ``cv``, everything is learned again for each fold, at the cost of one fit per fold. The
    parameters and the reference are those of the model.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, Pipeline or fitted search
        Fitted model.
    X : sequence of shapes
        Specimens that the model was fitted on, including the reference.
    y : sequence of correspondences
        Correspondence of each specimen with the template.
    landmarks : sequence of (Landmarks or None)
        True landmarks of each specimen, in the coordinates of its mesh; None for a specimen without
        landmarks.
    cv : int, cross-validation generator or iterable, optional
        How to split the specimens, without the reference, into folds to fit. By default the
        predictions of the original fit are reused; if it made none (``confidence=None``), each
        specimen is left out in turn.
    verbose : int, default=0
        If 1, report each fold.

    Returns
    -------
    LandmarkEvaluation
        One entry for each specimen with landmarks, in the order of ``X``, except for the reference
        and skipped specimens.

    Raises
    ------
    ValueError
        If ``X`` does not contain the model's reference or at least two other specimens, or none of
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
        raise ValueError("No specimen besides the reference has landmarks to compare with.")
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
    """Return the predictions that `fit` made for specimens that it left out.

    The stored offsets are relative to the points of ``y``; ``landmarks`` may be those of another
    observer.
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
        raise ValueError("No specimen besides the reference has landmarks to compare with.")
    return LandmarkEvaluation(meshes, predicted, true)
