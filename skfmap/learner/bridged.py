"""Matching through a similar training shape whose correspondence to the reference is known."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Self

import numpy as np
import scipy.sparse as sp
from sklearn.base import BaseEstimator, clone
from sklearn.utils import Tags, get_tags
from sklearn.utils.validation import check_is_fitted

from skfmap._measures import PairErrors, mean_over_shapes
from skfmap._tools.callbacks import FitTask
from skfmap._tools.parallel import map_shapes
from skfmap._tools.ties import first_of_least
from skfmap._tools.types import (
    DistanceMethod,
    FloatArray,
    IntArray,
    Interpolation,
    RefineOverride,
)
from skfmap._tools.validation import check_sample_weight
from skfmap._version import Versioned
from skfmap.functional.ground_truth import map_from_pairs
from skfmap.functional.regularization import laplacian_mask
from skfmap.functional.residuals import residual_covariance
from skfmap.learner.about_meshes import with_meshes
from skfmap.learner.across import Across, cross_over
from skfmap.learner.confidence import Confidence
from skfmap.learner.diagnostics import diagnose_new_shapes, is_mirrored, report
from skfmap.learner.estimator import WeightedFunctionalMapLearner
from skfmap.learner.given_answers import given_reference, on_working_mesh
from skfmap.learner.inputs import check_shapes
from skfmap.learner.matcher import Matcher, Solution
from skfmap.learner.new_shape import no_match
from skfmap.learner.parameters import confidence_of
from skfmap.learner.scoring import score_point_maps
from skfmap.learner.training_set import TrainingSet
from skfmap.refinement import Refinement
from skfmap.shapes import Match
from skfmap.shapes.usable import Answer, ProbedItem, put_back

__all__ = ["BridgedLearner"]

# A bridge is used only if it reduces errors on shapes left out below this fraction. It is used for
# the women and not for the cats, as it should be (docs/benchmarks.rst).
_WORTH = 0.9


class BridgedLearner(Versioned, BaseEstimator):
    """Match through a similar training shape if the reference is unlike the other shapes.

    Points of a new shape are first mapped to a training shape (the bridge), by maps that are
    learned for it as well. From there they follow the known correspondence of the bridge to the
    reference, extended to all vertices. The functional map is that of the learner, from functions
    on the reference S_0 to functions on each shape; point-to-point maps go from each shape to S_0.

    Parameters
    ----------
    estimator : WeightedFunctionalMapLearner
        The learner. In a pipeline, use the BridgedLearner as the last step in its place. For
        ``through="auto"`` the learner needs a ``confidence``.
    through : str, default="auto"
        ``"auto"`` selects the training shape whose functions represent the known maps of the others
        best, and uses it if that reduces the error on held-out training shapes. The name of a
        training shape always uses that shape.

    Attributes
    ----------
    estimator_ : WeightedFunctionalMapLearner
        The learner, fitted on the reference.
    bridge_ : WeightedFunctionalMapLearner or None
        The learner whose reference is the bridge, if one is used. The model then contains both
        meshes.
    bridge_errors_ : dict
        Mean errors on held-out training shapes, ``"direct"`` and ``"bridge"``; empty if there was
        no bridge to try, or errors are not calibrated.
    reference_, weights_, stable_basis_ and all other fitted attributes of the learner
        Read from ``estimator_``.

    Examples
    --------
    >>> import skfmap
    >>> skfmap.BridgedLearner(skfmap.WeightedFunctionalMapLearner(n_functions=20), through="dog8")
    BridgedLearner(estimator=WeightedFunctionalMapLearner(n_functions=20),
                   through='dog8')
    """

    def __init__(self, estimator: WeightedFunctionalMapLearner, through: str = "auto") -> None:
        self.estimator = estimator
        self.through = through

    def fit(
        self,
        X: Sequence[ProbedItem],
        y: Sequence[Answer],
        sample_weight: Sequence[float] | None = None,
    ) -> Self:
        """Learn the maps to the reference and to the bridge; this takes twice as long.

        Parameters
        ----------
        X, y, sample_weight : sequence, sequence, array-like or None
            As in `WeightedFunctionalMapLearner.fit`.

        Returns
        -------
        BridgedLearner
            The fitted learner.

        Raises
        ------
        ValueError
            If ``through`` does not name exactly one training shape other than the reference, or if
            no other shape is left to learn from; also if it is ``"auto"`` and the learner does not
            calibrate errors.
        """
        self._check_parameters(X)
        learner = clone(self.estimator).fit(X, y, sample_weight)
        training = learner._training_set(X, y, sample_weight)
        index = self._bridge_index(training)
        bridge: WeightedFunctionalMapLearner | None = None
        across: Across | None = None
        errors: dict[str, float] = {}
        if index is not None:
            learner._tell(f"learning the maps to the bridge, {training.describe(index)}")
            bridge, across = _learn_bridge(self.estimator, training, index)
            errors = _errors(learner, bridge, across)
            learner._tell(f"errors on shapes left out: {errors or 'not known'}")
            if self.through == "auto" and not errors["bridge"] < _WORTH * errors["direct"]:
                bridge, across = None, None
        self.estimator_, self.bridge_, self.bridge_errors_, self._across = (
            learner,
            bridge,
            errors,
            across,
        )
        return self

    def functional_maps(self, X: Sequence[ProbedItem]) -> FloatArray:
        """Return the full maps X_i(D), as `WeightedFunctionalMapLearner.functional_maps` does.

        Parameters
        ----------
        X : sequence of ProbedShape
            New shapes.

        Returns
        -------
        maps : ndarray of shape (n_shapes, k, k)
            From functions on the reference to functions on each shape.
        """
        check_is_fitted(self)
        return self.estimator_.functional_maps(X)

    def ground_truth_maps(self, X: Sequence[ProbedItem], y: Sequence[Answer]) -> FloatArray:
        """Return the known maps C_i, as `WeightedFunctionalMapLearner.ground_truth_maps` does.

        Parameters
        ----------
        X, y : sequence of ProbedShape, sequence of correspondences
            Shapes and where they lie on the template.

        Returns
        -------
        maps : ndarray of shape (n_shapes, k, k)
            From functions on the reference to functions on each shape.
        """
        check_is_fitted(self)
        return self.estimator_.ground_truth_maps(X, y)

    def predict(self, X: Sequence[ProbedItem]) -> FloatArray:
        """Return the reduced maps X_i(D) Y_p, as `WeightedFunctionalMapLearner.predict` does.

        Parameters
        ----------
        X : sequence of ProbedShape
            New shapes.

        Returns
        -------
        reduced : ndarray of shape (n_shapes, k, p)
            Images on each shape of the p most stable functions of the reference.
        """
        check_is_fitted(self)
        return self.estimator_.predict(X)

    def match(
        self,
        X: Sequence[ProbedItem],
        *,
        refine: RefineOverride | Refinement | None = "fitted",
        interpolate: Interpolation = None,
    ) -> list[Match]:
        """Match the points of each shape to those of the reference, through the bridge.

        Parameters
        ----------
        X, refine, interpolate : optional
            As in `WeightedFunctionalMapLearner.match`.

        Returns
        -------
        list of Match
            Expected errors are the sum of those of the match to the bridge and those of the
            correspondence from there to the reference.
        """
        check_is_fitted(self)
        if self.bridge_ is None or self._across is None:
            return self.estimator_.match(X, refine=refine, interpolate=interpolate)
        learner, matcher = self.estimator_, self.matcher_
        usable = learner._usable(X)
        arguments = ((shape,) for shape in usable.shapes)
        solve = partial(matcher.solve, mirrored=True)
        direct = map_shapes(solve, arguments, n_jobs=learner.n_jobs, verbose=0, prefer="threads")
        found = self.bridge_._matched(usable.shapes, refine, interpolate)
        matches = [
            _cross(one.match, solution, matcher, self.confidence_, self._across)
            for one, solution in zip(found, direct, strict=True)
        ]
        familiar = [match.familiar for match in matches]
        report(diagnose_new_shapes(usable, [is_mirrored(one) for one in direct], familiar))
        return put_back(
            with_meshes(matches, usable.shapes, matcher.reference),
            usable,
            lambda one: no_match(one, matcher, assessed=self.confidence_ is not None),
        )

    def match_between(
        self, X: Sequence[ProbedItem], pairs: Iterable[tuple[int, int]] | None = None
    ) -> list[Match]:
        """Match shapes to one another, by what they have in common with the bridge.

        The correspondence from the bridge to the reference is not used.

        Parameters
        ----------
        X, pairs : optional
            As in `WeightedFunctionalMapLearner.match_between`.

        Returns
        -------
        list of Match
            One match for each pair.
        """
        check_is_fitted(self)
        learner = self.estimator_ if self.bridge_ is None else self.bridge_
        return learner.match_between(X, pairs)

    def point_maps(self, X: Sequence[ProbedItem], **how: Any) -> list[IntArray]:
        """Return point-to-point maps only, as `WeightedFunctionalMapLearner.point_maps` does.

        Parameters
        ----------
        X : sequence of ProbedShape
            New shapes.
        **how : optional
            ``matching``, ``n_stable``, ``refine``.

        Returns
        -------
        list of ndarray of int, each of shape (n_vertices_i,)
            Vertex of the reference for each vertex of S_i; -1 if there is none.
        """
        check_is_fitted(self)
        if self.bridge_ is None or self._across is None:
            return self.estimator_.point_maps(X, **how)
        usable = self.estimator_._usable(X)
        p2ps = [
            np.append(self._across.p2p, -1)[p2p]
            for p2p in self.bridge_._point_maps(usable.shapes, **how)
        ]
        return put_back(p2ps, usable, lambda skipped: np.full(skipped.n_vertices, -1))

    def pair_errors(
        self,
        X: Sequence[ProbedItem],
        y: Sequence[Answer],
        *,
        method: DistanceMethod = "heat",
        reference_y: Answer | None = None,
        **how: Any,
    ) -> list[PairErrors]:
        """Match shapes with known correspondences and return the error at each pair.

        Parameters
        ----------
        X, y, method, reference_y, **how : optional
            As in `WeightedFunctionalMapLearner.pair_errors`.

        Returns
        -------
        list of PairErrors
            Errors in units of sqrt(area) of the reference.
        """
        check_is_fitted(self)
        learner = self.estimator_
        if self.bridge_ is None or self._across is None:
            return learner.pair_errors(X, y, method=method, reference_y=reference_y, **how)
        usable, answers = learner._scored(X, y)
        p2ps = [
            np.append(self._across.p2p, -1)[p2p]
            for p2p in self.bridge_._point_maps(usable.shapes, **how)
        ]
        measured = {
            "method": method,
            "memory": learner.memory,
            "n_jobs": learner.n_jobs,
            "reference_y": reference_y,
        }
        return score_point_maps(
            p2ps, usable, answers, self.reference_, self.reference_correspondence_, **measured
        )

    def score(
        self,
        X: Sequence[ProbedItem],
        y: Sequence[Answer],
        sample_weight: Sequence[float] | None = None,
        reference_y: Answer | None = None,
    ) -> float:
        """Return minus the mean geodesic error of the matches; larger is better.

        Parameters
        ----------
        X, y, sample_weight, reference_y : optional
            As in `WeightedFunctionalMapLearner.score`.

        Returns
        -------
        float
            The score in units of sqrt(area) of the reference.
        """
        means = [
            errors.mean("direct") for errors in self.pair_errors(X, y, reference_y=reference_y)
        ]
        return -mean_over_shapes(means, check_sample_weight(sample_weight, len(means)))

    def __getattr__(self, name: str) -> Any:
        """Return a fitted attribute of the learner."""
        if not name.endswith("_") or name.startswith("_") or "estimator_" not in vars(self):
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}.")
        return getattr(self.estimator_, name)

    def _check_parameters(self, X: Sequence[ProbedItem]) -> None:
        if not isinstance(self.estimator, WeightedFunctionalMapLearner):
            raise TypeError(
                "estimator must be a WeightedFunctionalMapLearner, and the BridgedLearner the last "
                f"step of the pipeline; got {type(self.estimator).__name__}."
            )
        if not isinstance(self.through, str):
            raise ValueError(
                f"through must be 'auto' or the name of a training shape; got {self.through!r}."
            )
        if self.through != "auto":
            self._check_name([shape.name for shape in check_shapes(X, self.estimator.n_functions)])
        elif not self._calibrates():
            raise ValueError(
                "through='auto' compares expected errors, but confidence="
                f"{self.estimator.confidence!r} of the learner does not provide them. Set "
                "confidence='cross-fit', or name the training shape to go through; every fold of a "
                "search must then contain it."
            )

    def _calibrates(self) -> bool:
        confidence = confidence_of(self.estimator.confidence)
        return confidence is not None and type(confidence).mean_error is not Confidence.mean_error

    def _check_name(self, names: Sequence[str | None]) -> None:
        if names.count(self.through) != 1:
            raise ValueError(
                f"through={self.through!r} must name exactly one training shape other than the "
                f"reference, out of {', '.join(map(str, names))}. A fold without it cannot be "
                "fitted; through='auto' (with confidence='cross-fit') chooses again in each fold."
            )

    def _bridge_index(self, training: TrainingSet) -> int | None:
        """Return the index of the bridge; None if there are too few shapes to choose from."""
        if self.through == "auto":
            return choose_bridge(training)
        names = [shape.name for shape in training.shapes]
        self._check_name(names)
        if len(names) < 2:
            raise ValueError(
                f"Besides the bridge {self.through!r} there is no training shape to learn from; "
                "give at least one more."
            )
        return names.index(self.through)

    def __sklearn_tags__(self) -> Tags:
        """Return the tags of the learner."""
        return get_tags(self.estimator)


def choose_bridge(training: TrainingSet) -> int | None:
    """Return the training shape whose functions represent the others best.

    This is the shape with the smallest sum of residuals of the known maps from it to the others.
    None if there are fewer than three shapes.
    """
    used = [int(i) for i in training.used]
    if len(used) < 3:
        return None
    left = [np.sum([_what_is_left(training, i, j) for i in used if i != j]) for j in used]
    return used[first_of_least(np.array(left))]


def _what_is_left(training: TrainingSet, i: int, j: int) -> float:
    """Return the mean squared residual of the known map from shape j to shape i."""
    k, join = training.k, training.truths[i].join(training.truths[j])
    if len(np.unique(join.vertices_i)) < k:
        return np.inf
    spectral_i, spectral_j = training.shapes[i].spectral, training.shapes[j].spectral
    evecs_i, evecs_j = (
        spectral_i.evecs_at(join.vertices_i, k, join.places_i),
        spectral_j.evecs_at(join.vertices_0, k, join.places_0),
    )
    areas = join.weights / join.weights.sum()
    C = map_from_pairs(
        evecs_i, evecs_j, areas, laplacian_mask(spectral_i.evals[:k], spectral_j.evals[:k])
    ).C
    return float(np.trace(residual_covariance(evecs_i, evecs_j, areas, C)))


def _learn_bridge(
    estimator: WeightedFunctionalMapLearner, training: TrainingSet, index: int
) -> tuple[WeightedFunctionalMapLearner, Across]:
    """Learn the maps to a training shape, and extend its correspondence with the reference."""
    bridge, truth = on_working_mesh(training.shapes[index], training.truths[index])
    order = [index, *(i for i in range(len(training.shapes)) if i != index)]
    inner = clone(estimator).set_params(reference="first", verbose=0)
    to_bridge = inner._training_set(
        [bridge, *(training.shapes[i] for i in order[1:])],
        [truth, *(training.truths[i] for i in order[1:])],
        [1.0, *training.share[order[1:]]],
    )
    # The fit on the reference has already issued the warnings, with the caller's indices.
    fitted, _ = inner._fitted(to_bridge, FitTask.untold())
    vars(inner).update(fitted)
    across = cross_over(
        training.shapes[index].spectral,
        training.reference.spectral,
        training.joins[index],
        given_reference(training.reference).of_working_vertices(),
        training.memory,
    )
    return inner, across


def _errors(
    learner: WeightedFunctionalMapLearner, bridge: WeightedFunctionalMapLearner, across: Across
) -> dict[str, float]:
    """Return the mean errors on held-out training shapes, directly and through the bridge."""
    if learner.confidence_ is None or bridge.confidence_ is None:
        return {}
    direct, inner = learner.confidence_.mean_error(), bridge.confidence_.mean_error()
    return {"direct": direct, "bridge": inner + across.error} if np.isfinite(direct) else {}


def _cross(
    match: Match,
    solution: Solution,
    matcher: Matcher,
    confidence: Confidence | None,
    across: Across,
) -> Match:
    """Return the match to the reference that follows from a match to the bridge.

    Its functional map is the direct one.
    """
    n_j, spectral_0 = len(across.p2p), matcher.reference.spectral
    step = sp.coo_array(
        (np.ones(n_j), (np.arange(n_j), across.p2p)), shape=(n_j, spectral_0.n_given)
    ).tocsr()
    expected = match.expected_error
    if expected is not None:
        expected = expected + np.append(across.uncertainty, np.nan)[match.p2p]
    return replace(
        match,
        p2p=np.append(across.p2p, -1)[match.p2p],  # -1 (a removed vertex) picks the last entry
        expected_error=expected,
        functional_map=solution.C,
        reduced_map=solution.C @ matcher.stable_basis[:, : matcher.settings.n_stable],
        reference_name=matcher.reference.name,
        reference_hash=spectral_0.given_hash,
        refined_map=None,
        matrix=match.matrix @ step,
        inverse=np.append(match.inverse, -1)[across.inverse],
        familiar=None if confidence is None else confidence.is_familiar(solution, match.misfit),
    )
