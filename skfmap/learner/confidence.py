"""Expected errors of matches, estimated on held-out training shapes."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple, Self

import numpy as np

from skfmap._tools.parallel import map_shapes, single_threaded
from skfmap._tools.part import Part
from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import check_number
from skfmap.learner.error_model import ErrorModel, fit_error_model
from skfmap.learner.familiarity import is_familiar
from skfmap.learner.matcher import Matcher, Solution, embedding_distance
from skfmap.learner.observation import Observation, Watch, observe, watch_reference
from skfmap.learner.signs import vertex_signs
from skfmap.learner.training_set import Observed, TrainingSet
from skfmap.refinement import PointMatch
from skfmap.shapes import ProbedShape

__all__ = ["REFINED", "UNREFINED", "Confidence", "CrossFitConfidence", "Trust", "matchers_without"]

UNREFINED, REFINED = "unrefined", "refined"

# The weights of a fold start from those of all shapes, and need not be converged tightly: longer
# searches match shapes left out no better (docs/speed.rst). On cats left out in turn, the mean
# expected error is 0.0307 (true 0.0309), with a rank correlation of 0.506; with searches from the
# beginning, of 28 evaluations rather than 3, 0.0305 and 0.504. With three training shapes the
# expected errors are 0.0319 and 0.0327 (true 0.0353).
_MAX_ITER, _TOL = 60, 1e-3

# Built pairs have about the error of landmarks left out of the building, and matches share a part
# of it. This fraction of it is added, in squares. Expected errors of cats left out are then 0.82 of
# the true ones by edge paths (four cats, 50 landmarks), as with all pairs (0.83, ten cats); with
# all of it 1.22 (ten cats, 13 landmarks).
_OWN_PART = 0.5


class Trust(NamedTuple):
    """How far to trust a match, at each vertex and as a whole; `Match` describes the fields."""

    expected_error: FloatArray
    confidence: FloatArray
    misfit: float
    familiar: bool


class Confidence(Part, ABC):
    """Base class of methods that assess how far matches can be trusted.

    Derive from it and implement `assess`. If the method learns something from the training shapes,
    override `fit`.
    """

    @abstractmethod
    def assess(
        self,
        matcher: Matcher,
        shape: ProbedShape,
        solution: Solution,
        before: PointMatch,
        after: PointMatch,
        *,
        refined: bool,
    ) -> Trust:
        """Return how far to trust a match.

        Parameters
        ----------
        matcher : Matcher
            The matcher that made the match.
        shape : ProbedShape
            The shape S_i.
        solution : Solution
            The solution of equation (2).
        before, after : PointMatch
            The match before and after refinement.
        refined : bool
            Whether the refinement is the one that the learner was fitted with.

        Returns
        -------
        Trust
            Expected errors and confidences at the vertices of S_i, and an assessment of the match
            as a whole.
        """

    def is_familiar(self, solution: Solution, misfit: float = np.nan) -> bool:  # noqa: ARG002
        """Return whether a shape is like the training shapes; this default returns True.

        Judge by its solution of equation (2), and by `Match.misfit` if there is a match.
        """
        return True

    def mean_error(self) -> float:
        """Return the mean error on held-out training shapes; this default returns NaN."""
        return float("nan")

    def share_between(self) -> float:
        """Return the ratio of errors between two new shapes to those of unrelated errors.

        Unrelated errors are the root of the sum of squares of both errors to the reference. This
        default returns 1.
        """
        return 1.0


class CrossFitConfidence(Confidence):
    """Predict errors from observable signs of a match, calibrated on held-out training shapes.

    A single training shape cannot be held out: errors are then those on the training shape itself,
    which are optimistic.

    Parameters
    ----------
    cv : int, default=3
        Number of folds. The learner is fitted once for each, so a fit takes about 1 + cv times as
        long as with ``confidence=None``.

    Attributes
    ----------
    error_models_ : dict of ErrorModel
        Models of the expected error of ``"unrefined"`` matches, and of ``"refined"`` ones (refined
        with the learner's ``refine``).
    misfits_ : ndarray of shape (n_shapes,)
        The residual of equation (2) on each shape given to `fit`; NaN for the reference and for
        shapes with weight 0.
    training_errors_ : ndarray of shape (n_shapes,)
        Mean error of the match of each of these shapes, refined if the learner refines; NaN also if
        no known pair leads to one of the vertices at which errors are observed.
    share_between_ : float
        Ratio of the errors from one held-out shape to another to the root of the sum of squares of
        the expected errors of both: below 1 if shapes have similar errors. 1 if there is only one
        shape.

    Examples
    --------
    >>> import skfmap
    >>> from skfmap.learner import CrossFitConfidence
    >>> learner = skfmap.WeightedFunctionalMapLearner(confidence=CrossFitConfidence(cv=5))
    >>> learner.set_params(confidence__cv=2).confidence
    CrossFitConfidence(cv=2)
    """

    # For models that were saved before matches between new shapes existed.
    share_between_: float = 1.0

    def __init__(self, cv: int = 3) -> None:
        self.cv = cv

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        check_number(self.cv, "cv", low=2, integer=True)

    def fit(self, training: TrainingSet, matcher: Matcher) -> Self:
        """Match each training shape with a model learned from others, and fit error models.

        Parameters
        ----------
        training : TrainingSet
            Training shapes.
        matcher : Matcher
            Matcher learned from all of them; it is used directly if there is only one shape.

        Returns
        -------
        CrossFitConfidence
            The fitted object.
        """
        used = training.used
        watch = watch_reference(
            training.reference, [training.observed[i].join for i in used], training.memory
        )
        n_folds = min(self.cv, len(used))
        folds = [used[f::n_folds] for f in range(n_folds)]
        matchers = [matcher] if n_folds == 1 else matchers_without(training, folds, matcher)
        arguments = (
            (one, training.shapes[i], training.observed[i], watch)
            for one, rows in zip(matchers, folds, strict=True)
            for i in rows
        )
        seen = map_shapes(_observe, arguments, n_jobs=training.n_jobs, verbose=0, prefer="threads")
        order = np.concatenate(folds)
        worst = max(one.distance for one in seen)
        self.error_models_ = {
            kind: single_threaded(  # with several threads, waiting costs more than they save
                fit_error_model,
                [
                    _weighted(one.observations[kind], training.share[i])
                    for i, one in zip(order, seen, strict=True)
                ],
                watch,
                worst_distance=worst,
                cross_validated=n_folds > 1,
            )
            for kind in seen[0].observations
        }
        kind = UNREFINED if matcher.refinement is None else REFINED
        self.share_between_ = _share_between(
            [one.observations[kind] for one in seen],
            self.error_models_[kind],
            training.reference.spectral.vertices,
            watch,
        )
        self.misfits_, self.training_errors_ = np.full((2, training.n_given), np.nan)
        self.misfits_[training.indices[order]] = [one.residual for one in seen]
        self.training_errors_[training.indices[order]] = [
            one.observations[kind].mean_error for one in seen
        ]
        return self

    def assess(
        self,
        matcher: Matcher,
        shape: ProbedShape,
        solution: Solution,
        before: PointMatch,
        after: PointMatch,
        *,
        refined: bool,
    ) -> Trust:
        """Return expected errors, confidences, the misfit and whether the shape is familiar.

        If the refinement is not the fitted one, expected errors are those of the unrefined match.
        The parameters are those of `Confidence.assess`.
        """
        unrefined: ErrorModel = self.error_models_[UNREFINED]
        misfit = unrefined.misfit(embedding_distance(shape, before))
        model, seen = (self.error_models_[REFINED], after) if refined else (unrefined, before)
        expected_error, confidence = model.predict(
            vertex_signs(matcher, shape, seen, refined=refined), seen.p2p, misfit
        )
        return Trust(expected_error, confidence, misfit, self.is_familiar(solution, misfit))

    def is_familiar(self, solution: Solution, misfit: float = np.nan) -> bool:
        """Return whether a shape fits about as well as the held-out training shapes."""
        return is_familiar(self.misfits_, solution.residual, misfit)

    def mean_error(self) -> float:
        """Return the mean error on held-out training shapes, refined if the learner refines."""
        return self.error_models_[
            REFINED if REFINED in self.error_models_ else UNREFINED
        ].mean_error

    def share_between(self) -> float:
        """Return the ratio that was observed between held-out training shapes."""
        return self.share_between_


class _Seen(NamedTuple):
    """Observations on one training shape by kind, its residual, and its `embedding_distance`."""

    observations: dict[str, Observation]
    residual: float
    distance: float


def _observe(matcher: Matcher, shape: ProbedShape, observed: Observed, watch: Watch) -> _Seen:
    solution = matcher.solve(shape)
    before, after = matcher.match_points(shape, solution.C)
    matches = {UNREFINED: before} | ({} if matcher.refinement is None else {REFINED: after})
    seen = {
        kind: _with_error_of_pairs(
            observe(
                matcher,
                shape,
                observed.join,
                observed.areas,
                match,
                watch,
                refined=kind == REFINED,
            ),
            observed.error,
        )
        for kind, match in matches.items()
    }
    return _Seen(seen, solution.residual, embedding_distance(shape, before))


def _share_between(
    observations: Sequence[Observation], model: ErrorModel, vertices_0: FloatArray, watch: Watch
) -> float:
    """Return the ratio of errors between shapes to the root of squares of their expected errors.

    The error between two shapes is the difference between where they put a point of the reference.

    On three folds of cats left out, expected errors between them are then 0.98, 0.96 and 0.90 of
    the true ones; without this ratio 1.15, 1.10 and 1.05, and with sums 1.5, 1.5 and 1.4. The pairs
    within one fold are too few: 0.76, 0.96 and 0.80.
    """
    off, lengths, errors, expected = [], 0.0, 0.0, []
    for one in observations:
        there = vertices_0[one.matched] - vertices_0[watch.vertices[one.watched]]
        off.append(_at_watched(one, there, watch))
        lengths += float(np.linalg.norm(there, axis=1).sum())
        errors += float(one.errors.sum())
        said, _ = model.predict(one.signs, one.matched, 0.0)
        expected.append(_at_watched(one, said[:, None], watch)[:, 0])
    apart = unrelated = 0.0
    for i, j in combinations(range(len(observations)), 2):
        both = np.flatnonzero(np.isfinite(expected[i]) & np.isfinite(expected[j]))
        apart += float(np.linalg.norm(off[i][both] - off[j][both], axis=1).sum())
        unrelated += float(np.hypot(expected[i][both], expected[j][both]).sum())
    if not (unrelated > 0 and lengths > 0):
        return 1.0
    return (errors / lengths) * apart / unrelated  # errors are measured along the surface


def _at_watched(observation: Observation, values: FloatArray, watch: Watch) -> FloatArray:
    """Return the mean of the rows at each watched vertex; NaN if there is none."""
    n, rows = len(watch.vertices), observation.watched
    sums = np.stack([np.bincount(rows, column, n) for column in values.T], axis=1)
    counts = np.bincount(rows, minlength=n)[:, None]
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def _with_error_of_pairs(observation: Observation, error: float) -> Observation:
    """Add to the errors the part that matches do not share with built pairs."""
    return observation._replace(errors=np.hypot(observation.errors, _OWN_PART * error))


def _weighted(observation: Observation, share: float) -> Observation:
    return observation._replace(weights=share * observation.weights)


def matchers_without(
    training: TrainingSet, folds: list[IntArray], matcher: Matcher
) -> list[Matcher]:
    """Return, for each fold of training shapes, the matcher learned from all others."""
    used = training.used
    arguments = ((training.only(np.setdiff1d(used, rows)), matcher) for rows in folds)
    return map_shapes(_learned_from, arguments, n_jobs=training.n_jobs, verbose=0, prefer="threads")


def _learned_from(training: TrainingSet, whole: Matcher) -> Matcher:
    options, settings = training.options, whole.settings
    learned = training.learn(
        start=whole.weights, max_iter=min(options.max_iter, _MAX_ITER), tol=max(options.tol, _TOL)
    )
    matcher = Matcher.from_learned(
        training, learned, matching=settings.matching, n_stable=settings.n_stable
    )
    if whole.refinement is None:
        return matcher
    return replace(matcher, refinement=whole.refinement.fit_fold(training, matcher))
