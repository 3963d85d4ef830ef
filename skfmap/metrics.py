"""How good a match is, and scorers for searches.

Geodesic errors, equation (5), singular values, coverage, continuity.

All lengths are in units of sqrt(area) of the reference. Errors come in three kinds: ``"direct"``
forgives nothing; ``"consistent"`` takes the better of the direct and the symmetric answer once for
the whole map; ``"per_vertex"`` takes the better at each pair (the paper's "symmetric
correspondences are considered correct").
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

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
from skfmap._tools.types import Model
from skfmap._tools.unwrap import learner_and_shapes
from skfmap._tools.validation import check_choice, check_sample_weight
from skfmap.functional.stable_basis import basis_error
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
    "pair_errors",
    "reference_distances",
    "singular_value_profile",
]


def matching_errors(
    model: Model,
    X: Sequence[Any],
    y: Sequence[Answer],
    *,
    method: str = "heat",
    reference_y: Answer | None = None,
) -> list[PairErrors]:
    """Match shapes with a fitted model and return the errors of each."""
    learner, shapes = learner_and_shapes(model, X)
    return list(learner.pair_errors(shapes, y, method=method, reference_y=reference_y))


_SCORERS = {
    "neg_geodesic_error": "direct",
    "neg_consistent_geodesic_error": "consistent",
    "neg_per_vertex_geodesic_error": "per_vertex",
}


@dataclass(frozen=True)
class _GeodesicScorer:
    """A scorer: minus the mean error of one kind, over the shapes."""

    kind: str
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


def get_scorer_names() -> list[str]:
    """Return the names that `get_scorer` takes."""
    return sorted(_SCORERS)


def get_scorer(name: str, reference_y: Answer | None = None) -> Callable[..., float]:
    """Return a scorer for ``scoring=`` of scikit-learn's searches and cross-validation.

    Parameters
    ----------
    name : str
        ``"neg_geodesic_error"`` forgives nothing. ``"neg_consistent_geodesic_error"`` takes the
        better side once for the map, ``"neg_per_vertex_geodesic_error"`` at each pair; both need
        the symmetric answer in the reference's correspondence. With the paper's symmetric probes a
        direct score is a coin toss between sides: use the consistent one.
    reference_y : Correspondence or int array, optional
        Where the reference lies at the template points that are scored, if these were not given to
        ``fit``: with sparse landmarks, half of them are fitted and the other half scored.

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
    check_choice(name, "name", _SCORERS)
    return _GeodesicScorer(_SCORERS[name], reference_y)
