"""Measures of match quality, and scorers for searches.

The measures are geodesic errors, equation (5), singular values, coverage and continuity.

All lengths are in units of sqrt(area) of the reference. There are three kinds of errors:
``"direct"`` accepts no symmetric answer; ``"consistent"`` takes the better of the direct and the
symmetric answer once for the whole map; ``"per_vertex"`` takes the better at each pair (the paper's
"symmetric correspondences are considered correct").
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skfmap._measures import (
    ERROR_KINDS,
    GeodesicDistances,
    PairErrors,
    continuity,
    coverage,
    error_curve,
    geodesic_error,
    mean_over_shapes,
    pair_errors,
    reference_distances,
    singular_value_profile,
)
from skfmap._tools.types import DistanceMethod, ErrorKind, Model
from skfmap._tools.unwrap import learner_and_shapes
from skfmap._tools.validation import check_choice, check_sample_weight
from skfmap.exceptions import CorrespondenceError
from skfmap.functional.stable_basis import basis_error
from skfmap.learner.models import predict_landmarks
from skfmap.shapes import Correspondence, Landmarks
from skfmap.shapes.usable import Answer

__all__ = [
    "ERROR_KINDS",
    "GeodesicDistances",
    "PairErrors",
    "basis_error",
    "continuity",
    "coverage",
    "error_curve",
    "geodesic_error",
    "get_scorer",
    "get_scorer_names",
    "multi_scorer",
    "pair_errors",
    "reference_distances",
    "singular_value_profile",
]


def matching_errors(
    model: Model,
    X: Sequence[Any],
    y: Sequence[Answer],
    *,
    method: DistanceMethod = "heat",
    reference_y: Answer | None = None,
) -> list[PairErrors]:
    """Match shapes with a fitted model and return the errors of each."""
    learner, shapes = learner_and_shapes(model, X)
    errors = getattr(learner, "errors_to_score", learner.pair_errors)
    return list(errors(shapes, y, method=method, reference_y=reference_y))


_SCORERS: dict[str, ErrorKind] = {
    "neg_geodesic_error": "direct",
    "neg_consistent_geodesic_error": "consistent",
    "neg_per_vertex_geodesic_error": "per_vertex",
}


@dataclass(frozen=True)
class _GeodesicScorer:
    """Scorer: minus the mean geodesic error of one kind, over the shapes."""

    kind: ErrorKind
    reference_y: Answer | None = None

    def __call__(
        self,
        estimator: Model,
        X: Sequence[Any],
        y: Sequence[Any],
        sample_weight: Sequence[float] | None = None,
    ) -> float:
        """Return the score of a fitted learner, Pipeline or search on shapes ``X``."""
        means = [
            e.mean(self.kind)
            for e in matching_errors(estimator, X, y, reference_y=self.reference_y)
        ]
        return -mean_over_shapes(means, check_sample_weight(sample_weight, len(means)))


@dataclass(frozen=True)
class _LandmarkScorer:
    """Scorer: minus the mean distance between predicted and measured landmarks."""

    def __call__(
        self,
        estimator: Model,
        X: Sequence[Any],
        y: Sequence[Any],
        sample_weight: Sequence[float] | None = None,
    ) -> float:
        """Return the score of a fitted learner, Pipeline or search on shapes ``X``, in mesh units.

        Shapes without a measured landmark that was learned do not count.
        """
        found = predict_landmarks(estimator, X)
        if len(found) != len(y):
            raise ValueError(f"X has {len(found)} shapes and y {len(y)} correspondences.")
        _check_names(found, y)
        means = [_mean_distance(marks, truth) for marks, truth in zip(found, y, strict=True)]
        return -mean_over_shapes(means, check_sample_weight(sample_weight, len(means)))


def _check_names(found: Sequence[Landmarks], y: Sequence[object]) -> None:
    """Raise if no landmark of the shapes was learned."""
    measured = [one.landmarks for one in y if isinstance(one, Correspondence)]
    given = dict.fromkeys(name for one in measured if one is not None for name in one.names)
    learned = found[0].names if found else ()
    if given and not set(given) & set(learned):
        raise CorrespondenceError(
            f"No landmark of y was learned: y has {', '.join(given)}, the model has "
            f"{', '.join(learned)}. Landmarks correspond by name, or by number if they have no "
            "names."
        )


def _mean_distance(found: Landmarks, truth: object) -> float:
    measured = truth.landmarks if isinstance(truth, Correspondence) else None
    if measured is None:
        raise CorrespondenceError(
            "neg_landmark_error needs measured points; give y as "
            "Correspondence.from_points(points, mesh, names)."
        )
    common = [name for name in measured.names if name in found.names]
    off = [np.linalg.norm(found.point(name) - measured.point(name)) for name in common]
    return float(np.nanmean(off)) if np.isfinite(off).any() else float("nan")


_LANDMARK_ERROR = "neg_landmark_error"


def get_scorer_names() -> list[str]:
    """Return the names that `get_scorer` accepts."""
    return sorted([*_SCORERS, _LANDMARK_ERROR])


def get_scorer(name: str, reference_y: Answer | None = None) -> Callable[..., float]:
    """Return a scorer for ``scoring=`` of scikit-learn's searches and cross-validation.

    Parameters
    ----------
    name : str
        ``"neg_geodesic_error"`` accepts no symmetric answer. ``"neg_consistent_geodesic_error"``
        takes the better of the direct and the symmetric answer once for the map,
        ``"neg_per_vertex_geodesic_error"`` takes it at each pair; both need the symmetric answer in
        the reference's correspondence. With the paper's symmetric probes a direct score is a coin
        toss between left and right, so use the consistent one. ``"neg_landmark_error"`` is the
        distance between predicted and measured landmarks, in the units of the meshes; ``y`` then
        holds correspondences from `Correspondence.from_points`.
    reference_y : Correspondence or int array, optional
        Correspondence of the reference at the template points that are scored, if these were not
        given to ``fit``. With sparse landmarks, fit on half of them and score on the other half.

    Returns
    -------
    callable
        ``(estimator, X, y, sample_weight=None) -> float``, larger is better.

    Examples
    --------
    >>> from skfmap.metrics import get_scorer
    >>> get_scorer("neg_consistent_geodesic_error")
    _GeodesicScorer(kind='consistent', reference_y=None)
    """
    check_choice(name, "name", get_scorer_names())
    if name == _LANDMARK_ERROR:
        if reference_y is not None:
            raise ValueError(f"{_LANDMARK_ERROR} does not take reference_y; leave it out.")
        return _LandmarkScorer()
    return _GeodesicScorer(_SCORERS[name], reference_y)


@dataclass(frozen=True)
class _MultiScorer:
    """Scorer that returns several scores of the same matches."""

    names: tuple[str, ...]
    reference_y: Answer | None = None

    def __call__(
        self,
        estimator: Model,
        X: Sequence[Any],
        y: Sequence[Any],
        sample_weight: Sequence[float] | None = None,
    ) -> dict[str, float]:
        """Return the scores of a fitted learner, Pipeline or search on shapes ``X``, by name."""
        scores = {}
        kinds = {name: _SCORERS[name] for name in self.names if name in _SCORERS}
        if kinds:
            errors = matching_errors(estimator, X, y, reference_y=self.reference_y)
            weights = check_sample_weight(sample_weight, len(errors))
            for name, kind in kinds.items():
                scores[name] = -mean_over_shapes([one.mean(kind) for one in errors], weights)
        if _LANDMARK_ERROR in self.names:
            scores[_LANDMARK_ERROR] = _LandmarkScorer()(estimator, X, y, sample_weight)
        return {name: scores[name] for name in self.names}


def multi_scorer(*names: str, reference_y: Answer | None = None) -> Callable[..., dict[str, float]]:
    """Return one scorer for several scores, which matches the shapes only once.

    scikit-learn's ``scoring=[...]`` would match them once for each score. In a search, ``refit``
    names the score that decides:
    ``GridSearchCV(..., scoring=multi_scorer(...), refit="neg_geodesic_error")``.

    Parameters
    ----------
    *names : str
        Names of scores, as in `get_scorer`.
    reference_y : Correspondence or int array, optional
        As in `get_scorer`, for geodesic errors.

    Returns
    -------
    callable
        ``(estimator, X, y, sample_weight=None) -> dict`` of floats by name, larger is better.

    Raises
    ------
    ValueError
        If no name is given, or a name is repeated or unknown.

    Examples
    --------
    >>> from skfmap.metrics import multi_scorer
    >>> scorer = multi_scorer("neg_geodesic_error", "neg_consistent_geodesic_error")
    >>> scorer.names
    ('neg_geodesic_error', 'neg_consistent_geodesic_error')
    """
    if not names or len(set(names)) < len(names):
        raise ValueError(
            f"multi_scorer takes distinct names of scores, out of {', '.join(get_scorer_names())}; "
            f"got {names!r}."
        )
    for name in names:
        check_choice(name, "name", get_scorer_names())
    if reference_y is not None and not set(names) & set(_SCORERS):
        raise ValueError(f"{_LANDMARK_ERROR} does not take reference_y; leave it out.")
    return _MultiScorer(names, reference_y)
