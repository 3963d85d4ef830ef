"""Learn which probe functions to trust, and which functions map stably."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Self

import numpy as np
from joblib import cpu_count, effective_n_jobs
from sklearn.base import BaseEstimator, clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted

from skfmap._bridge import choose_bridge, cross, cross_over, pays
from skfmap._calibration import calibrate
from skfmap._callbacks import CallbackSupportMixin, FitTask, with_callbacks
from skfmap._disagreement import warn_of_disagreement
from skfmap._familiarity import places_of_misfits, warn_of_unfamiliar_shapes
from skfmap._handedness import warn_of_mirrored_shapes, warn_of_mirrored_training_shapes
from skfmap._inputs import check_correspondences, check_same_probes, check_shapes, place
from skfmap._matching import MATCHINGS, REFINEMENTS, UNREFINED, Matcher, Settings, learned_map
from skfmap._medoid import medoid_index
from skfmap._new_shapes import INTERPOLATIONS, match_shape, point_map
from skfmap._parallel import map_shapes, single_threaded, tell
from skfmap._skipped import (
    Sorted,
    as_given,
    expand,
    given_numbers,
    no_match,
    sort_out,
    spread,
    warn_of_skipped,
)
from skfmap._training import Training, learning_arrays, matcher_from
from skfmap._typing import FloatArray, IntArray
from skfmap._unwrap import learner_and_shapes
from skfmap._validation import check_choice, check_number, check_sample_weight, label
from skfmap._version import Versioned
from skfmap.exceptions import CorrespondenceError, DisagreementWarning, MeshError, StabilityWarning
from skfmap.functional.learning import LearnedMaps, learn_functional_maps
from skfmap.functional.optimize import LOG_WEIGHT_BOUND
from skfmap.functional.regularization import LEARNED, REGULARIZERS
from skfmap.functional.weighting import WEIGHTINGS
from skfmap.ground_truth import check_landmarks, join_with_reference, known_maps
from skfmap.metrics import PairErrors, mean_over_shapes, pair_errors, reference_distances
from skfmap.shapes import Correspondence, Match, ProbedShape, SkippedShape

__all__ = ["WeightedFunctionalMapLearner", "functional_maps", "match"]

# Where even the most stable function is missed by so much of its norm, nothing was learned.
_UNSTABLE = 0.7
# References up to this many vertices have all their distances computed for a score.
_N_ALL_ROWS = 8000


class WeightedFunctionalMapLearner(CallbackSupportMixin, Versioned, BaseEstimator):
    r"""Learn probe weights D and a stable basis Y from shapes with known correspondences.

    For a new shape S_i, the functional map is (equation 2 of the paper)

    .. math:: X_i(D) = \arg\min_C \|(C G_0 - G_i) D\|_F^2 + \alpha \|C \odot W\|_F^2

    and D minimises the sum over training shapes of :math:`\|X_i(D) - C_i\|_\epsilon` (equations 3 and 4). Two maps,
    opposite ways: the functional map pulls functions on the reference S_0 back to S_i; the point map sends points of
    S_i to S_0.

    Parameters
    ----------
    n_functions : int, default=50
        k: how many of each shape's first eigenfunctions are used.
    weighting : {"function", "category", "unique"}, sequence, callable or None, default="function"
        One weight per probe, per family, for all, or none (D = I, the naive baseline; Y is learned all the same). A
        sequence holds a label for each probe, and those of one label share a weight; a callable returns it for the
        names and the categories of the probes, ``(names, categories) -> labels``.
    epsilon : float or "auto", default="auto"
        Of the norm (4). ``"auto"`` is the 80 percent rule of section 3.2. The loss depends on epsilon, so it says
        nothing about which epsilon is better: use a score.
    alpha : float, default=0.01
        Strength of the regulariser, for probes of norm 1 / sqrt(m). Beside learned weights it only sets the start and
        the automatic epsilon; for ``weighting=None`` it is worth a search.
    regularizer : {"laplacian", "resolvent", "learned"} or callable, default="laplacian"
        Deformation model: ``(evals_i, evals_0) -> W`` of shape (k, k). ``"laplacian"`` is the paper's, ``"resolvent"``
        is bounded (Ren et al. 2019), ``"learned"`` expects of each entry what the known maps of the training shapes
        have there.
    normalize : {"shape", "reference"}, default="shape"
        Whether probe columns are scaled by each shape's own norms (section 2.1) or by those of the reference.
    n_stable : int, float in (0, 1], or None
        p: how many stable functions the reduced map keeps, or their share of k; None is k // 2.
    matching : {"soft", "cut"}, default="soft"
        Points are matched in all stable functions, each weighted by how far it puts the points of the training shapes
        from where they belong, or in the first p alone.
    refine : {"icp", "zoomout", "bijective-zoomout"} or None, default=None
        How point maps are refined. ``"bijective-zoomout"`` is the best by far: maps of growing size, up to all
        eigenfunctions that `SpectralBasis` holds, each fitted to the point maps of both directions, with functions
        weighted by what the training shapes showed. ``"zoomout"`` (Melzi et al. 2019) and ``"icp"`` (Ovsjanikov et al.
        2012) are as published. On a shape of 5,000 vertices a step takes 0.3 s; there are eleven by default.
    bridge : {"auto"}, str or None, default=None
        Whether points go to the reference through a training shape that is near, whose own correspondence is known:
        for a reference that is very different from the rest. ``"auto"`` chooses the training shape, learns the maps to
        it as well, and keeps to whichever way has the lower error on training shapes left out; a name takes that shape
        without asking. The model then holds a second mesh, and `fit` takes twice as long.
    reference : str, default="first"
        ``"first"``: the first training shape. ``"medoid"``: the training shape whose geodesic distances differ least
        from all others'. Else the name of a training shape.
    on_invalid : {"raise", "skip"}, default="raise"
        What to do with a training shape whose correspondence cannot be used: out of range, empty, without a point of
        the reference, or with too few points. ``"skip"`` leaves it out with a warning; the reference's always raises.
        Shapes that the steps before skipped are left out in any case.
    max_iter : int, default=1000
        Most iterations of L-BFGS.
    tol : float, default=1e-4
        Largest derivative of the mean singular value's loss in a log-weight at which the search has converged.
    memory : str or joblib.Memory, optional
        Where ground-truth maps and geodesic distances are cached, so that the fits and scores of a search share them.
    n_jobs : int, optional
        Shapes at a time; see joblib. The result is the same for every value.
    verbose : int, default=0
        1 tells each stage and every tenth iteration.

    Attributes
    ----------
    weights_ : ndarray of shape (m,)
        Diagonal of D, positive.
    stable_basis_ : ndarray of shape (k, k)
        Y: coefficients of functions on the reference, most stable first. The constant function maps exactly.
    stability_ : ndarray of shape (k,)
        Singular values that go with Y, ascending.
    epsilon_ : float
        The epsilon used.
    loss_, loss_curve_, n_iter_ : float, list of float, int
        Equation (3) at the end, at the start and after each iteration, and the number of iterations.
    converged_ : bool
        Whether the search for weights converged.
    n_training_shapes_ : int
        Number of shapes learned from, without the reference and those of sample weight 0.
    n_stable_ : int
        p.
    reference_, reference_index_ : ProbedShape, int
        The reference, and its place in the training data.
    reference_correspondence_ : Correspondence
        Where the reference lies on the template.
    probe_names_, probe_categories_ : ndarray of str, shape (m,)
        What each weight belongs to.
    residual_covariance_ : ndarray of shape (k, k)
        How far learned maps put the points of the training shapes from where they belong: what ``matching="soft"``
        weighs functions by.
    truncation_covariance_ : ndarray of shape (n_components, n_components)
        The same for the known maps in all functions held, which err by their cut alone: what refinement goes by.
    bridge_ : WeightedFunctionalMapLearner or None
        The learner whose reference is the bridge, if points go through one.
    bridge_errors_ : dict
        Mean errors on training shapes left out, ``"direct"`` and ``"bridge"``; empty if no bridge was looked for.
    error_models_ : dict
        What error to expect of a match, for ``"unrefined"`` ones and for those refined as ``refine`` says.
    misfits_ : ndarray of shape (n_shapes,)
        What was left of equation (2) on each shape given to `fit` when it was left out of the learning (of a single
        one, as it was learned); NaN for the reference and shapes that were not learned from. A new shape far beyond the
        largest is not like them.
    training_errors_ : ndarray of shape (n_shapes,)
        Mean error of the match of each of them, in sqrt(area) of the reference, where expected errors were calibrated.
        One far above the others has a correspondence that contradicts theirs.

    See Also
    --------
    SpectralBasis, DescriptorTransformer : The steps before.
    skfmap.functional.learn_functional_maps : The same on arrays, for functional maps without points.

    References
    ----------
    .. [1] E. Corman, M. Ovsjanikov, A. Chambolle. "Supervised descriptor learning for non-rigid shape matching". ECCV
       Workshops, 2014.

    Examples
    --------
    >>> from sklearn.pipeline import make_pipeline
    >>> import skfmap
    >>> from skfmap.datasets import make_creatures
    >>> creatures = make_creatures(n_shapes=4, n_vertices=500)
    >>> model = make_pipeline(
    ...     skfmap.SpectralBasis(n_components=30),
    ...     skfmap.DescriptorTransformer(),
    ...     skfmap.WeightedFunctionalMapLearner(n_functions=20),
    ... )
    >>> model = model.fit(creatures.meshes[:3], creatures.correspondences[:3])
    >>> model.predict(creatures.meshes[3:]).shape
    (1, 20, 10)
    >>> match, = skfmap.match(model, creatures.meshes[3:])
    >>> len(match.p2p) == creatures.meshes[3].n_vertices
    True
    """

    def __init__(
        self,
        *,
        n_functions: int = 50,
        weighting: str | Sequence[Any] | Callable[..., Any] | None = "function",
        epsilon: float | str = "auto",
        alpha: float = 0.01,
        regularizer: str | Callable[[FloatArray, FloatArray], FloatArray] = "laplacian",
        normalize: str = "shape",
        n_stable: float | None = None,
        matching: str = "soft",
        refine: str | None = None,
        bridge: str | None = None,
        reference: str = "first",
        on_invalid: str = "raise",
        max_iter: int = 1000,
        tol: float = 1e-4,
        memory: Any = None,
        n_jobs: int | None = None,
        verbose: int = 0,
    ) -> None:
        self.n_functions = n_functions
        self.weighting = weighting
        self.epsilon = epsilon
        self.alpha = alpha
        self.regularizer = regularizer
        self.normalize = normalize
        self.n_stable = n_stable
        self.matching = matching
        self.refine = refine
        self.bridge = bridge
        self.reference = reference
        self.on_invalid = on_invalid
        self.max_iter = max_iter
        self.tol = tol
        self.memory = memory
        self.n_jobs = n_jobs
        self.verbose = verbose

    @with_callbacks  # type: ignore[untyped-decorator]
    def fit(self, X: Sequence[ProbedShape], y: Sequence[Any], sample_weight: Sequence[float] | None = None) -> Self:
        """Learn weights and stable basis.

        Parameters
        ----------
        X : sequence of ProbedShape
            Training shapes, the reference among them; from `DescriptorTransformer`.
        y : sequence of Correspondence or of int arrays of shape (n_pairs, 2)
            Where each shape lies on the template: rows ``[vertex, template point]``.
        sample_weight : array-like of shape (n_shapes,), optional
            Share of each shape in the sum (3) and in Y; the reference's is not used.

        Returns
        -------
        WeightedFunctionalMapLearner
            Itself.

        Raises
        ------
        CorrespondenceError
            If correspondences do not fit their shape, share no template point with the reference, or are too few for k.
        ValueError
            If shapes do not fit each other or a parameter cannot be used.
        TypeError
            If ``X`` or ``y`` holds something else.

        Warns
        -----
        CoverageWarning
            If correspondences determine only a part of a functional map.
        OrientationWarning
            If the correspondence of a shape takes its left for right, as that of a mirrored mesh does.
        ConvergenceWarning
            If the search stopped before it converged.
        StabilityWarning
            If no function maps stably, or many weights are at the bounds of the search.
        DisagreementWarning
            If the correspondence of a shape contradicts those of the others, or that of the reference all.
        SkippedShapeWarning
            If shapes were left out.
        """
        self._check_parameters()
        given = check_shapes(X, self.n_functions)
        answers = check_correspondences(y, given, skip=self.on_invalid == "skip")
        share = check_sample_weight(sample_weight, len(given))
        where = self._reference_index(given, answers)
        self._tell(f"reference: {label(given[where].name, 'shape')}")
        used = self._usable(given, answers, where)
        shapes, truths, index = [given[i] for i in used], [answers[i] for i in used], used.index(where)
        training = self._training(index, shapes, truths, share[used])._replace(place=where)
        if not training.share.any():
            raise ValueError("sample_weight is zero for every shape but the reference; there is nothing to learn from.")

        task = FitTask(self, X, y, sample_weight, self.max_iter)
        learned = single_threaded(self._learn, training, task)
        fitted = self._fitted_attributes(training, learned)
        self._tell("calibrating expected errors on training shapes left out in turn")
        places = [i for i in used if i != where]
        fitted |= self._calibrated(training, _matcher_of(fitted), places, len(given))
        warn_of_mirrored_training_shapes(training, places)
        warn_of_disagreement(fitted["training_errors_"], given, stacklevel=3)
        _warn_of_instability(
            fitted,
            np.stack([one.C for one in training.known]),
            epsilon_given=self.weighting is not None and self.epsilon != "auto",
        )
        fitted |= self._fit_bridge(training, [truths[i] for i in range(len(shapes)) if i != index], fitted)
        self.__dict__.update(fitted)  # at once, so that an interrupted fit leaves nothing behind
        task.end(fitted)
        return self

    def functional_maps(self, X: Sequence[ProbedShape]) -> FloatArray:
        """Return the full maps X_i(D), from functions on the reference to functions on each shape.

        Parameters
        ----------
        X : sequence of ProbedShape
            New shapes.

        Returns
        -------
        maps : ndarray of shape (n_shapes, k, k)
            Functional maps, in the order of ``X``.

        Warns
        -----
        UnfamiliarShapeWarning
            If a shape is not like the training shapes.
        """
        given, k = self._check_new(X), len(self.stable_basis_)
        strange = places_of_misfits(self._matcher(), self.misfits_, given.shapes, self.n_jobs)
        warn_of_unfamiliar_shapes(given, strange, stacklevel=3)
        maps = self._functional_maps(given.shapes)
        return np.stack(spread(maps, given, lambda _: np.full((k, k), np.nan)))

    def _functional_maps(self, shapes: Sequence[ProbedShape]) -> list[FloatArray]:
        arguments = ((self._matcher(), shape) for shape in shapes)
        return list(map_shapes(learned_map, arguments, n_jobs=self.n_jobs, verbose=0, prefer="threads"))

    def ground_truth_maps(self, X: Sequence[ProbedShape], y: Sequence[Any]) -> FloatArray:
        """Return the maps C_i that known correspondences make, to compare `functional_maps` with.

        Parameters
        ----------
        X, y : sequence of ProbedShape, sequence of correspondences
            Shapes and where they lie on the template.

        Returns
        -------
        maps : ndarray of shape (n_shapes, k, k)
            From functions on the reference to functions on each shape.

        Raises
        ------
        CorrespondenceError
            If a shape and the reference share fewer than k distinct landmarks.
        """
        X, answers = self._check_scored(X, y)
        given, k = sort_out(X), len(self.stable_basis_)
        joins = [
            join_with_reference(answers[i], shape, self.reference_correspondence_, self.reference_)
            for i, shape in zip(given.places, given.shapes, strict=True)
        ]
        known = known_maps(given.shapes, self.reference_, joins, k, memory=self.memory, n_jobs=self.n_jobs)
        return np.stack(spread([one.C for one in known], given, lambda _: np.full((k, k), np.nan)))

    def predict(self, X: Sequence[ProbedShape]) -> FloatArray:
        """Return the reduced maps X_i(D) Y_p of section 4.2.

        Parameters
        ----------
        X : sequence of ProbedShape
            New shapes.

        Returns
        -------
        reduced : ndarray of shape (n_shapes, k, p)
            Images on each shape of the p most stable functions of the reference.
        """
        return self.functional_maps(X) @ self.stable_basis_[:, : self.n_stable_]

    def match(
        self, X: Sequence[ProbedShape], *, refine: str | None = "fitted", interpolate: str | None = None
    ) -> list[Match]:
        """Match the points of each shape to those of the reference, in the stable functions.

        Parameters
        ----------
        X : sequence of ProbedShape
            New shapes.
        refine : {"icp", "zoomout", "bijective-zoomout"} or None, optional
            As the parameter of that name; what the model was fitted with by default. Errors are calibrated for that and
            for None; any other refinement is given the expected errors of the match before it.
        interpolate : {"barycentric", "soft"} or None, default=None
            Whether `Match.matrix` holds one vertex of the reference for each of S_i, the nearest point on the triangles
            around it, or several vertices weighted by their distance in the embedding.

        Returns
        -------
        list of Match
            Point map (from each shape to the reference), expected errors, confidence and functional maps.

        Warns
        -----
        OrientationWarning
            If a shape fits the reference much better as a mirror image. A mirrored body that is its own mirror image
            cannot be told from a body, and is matched by its own left and right.
        UnfamiliarShapeWarning
            If a shape is not like the training shapes: another kind of body, another resolution.
        """
        given = self._check_new(X)
        check_choice(interpolate, "interpolate", INTERPOLATIONS)
        matcher = self._matcher(refine=refine)
        mirrored = warn_of_mirrored_shapes(matcher, given)
        matches = self._matches(matcher, given.shapes, refine, interpolate)
        strange = places_of_misfits(matcher, self.misfits_, given.shapes, self.n_jobs, matches)
        warn_of_unfamiliar_shapes(given, [i for i in strange if i not in mirrored], stacklevel=3)
        matches = [replace(match, familiar=i not in strange) for i, match in enumerate(matches)]
        return spread(matches, given, self._no_match)

    def _matches(
        self, matcher: Matcher, shapes: Sequence[ProbedShape], refine: str | None, interpolate: str | None
    ) -> list[Match]:
        """Return the matches of shapes that can be used, directly or through the bridge."""
        if self.bridge_ is not None:
            inner = self.bridge_
            matches = inner._matches(inner._matcher(refine=refine), shapes, refine, interpolate)
            direct = self._functional_maps(shapes)
            return [cross(one, C, matcher, self._across) for one, C in zip(matches, direct, strict=True)]
        arguments = ((matcher, self.error_models_, shape, interpolate) for shape in shapes)
        found = map_shapes(match_shape, arguments, n_jobs=self.n_jobs, verbose=0, prefer="threads")
        return [as_given(one, shape.spectral.vertex_map) for one, shape in zip(found, shapes, strict=True)]

    def _no_match(self, skipped: SkippedShape) -> Match:
        return no_match(skipped, self.reference_, len(self.stable_basis_), self.n_stable_)

    def point_maps(
        self,
        X: Sequence[ProbedShape],
        *,
        matching: str | None = None,
        n_stable: float | None = None,
        refine: str | None = "fitted",
    ) -> list[IntArray]:
        """Return point maps alone, in other functions than the parameters say if asked.

        ``matching="cut", n_stable=1.0`` matches in all functions alike, which is the full map of the paper's figure 5.

        Parameters
        ----------
        X : sequence of ProbedShape
            New shapes.
        matching : {"soft", "cut"}, optional
            The parameter of that name by default.
        n_stable : int, float in (0, 1], optional
            The parameter of that name by default.
        refine : {"icp", "zoomout", "bijective-zoomout"} or None, optional
            The parameter of that name by default.

        Returns
        -------
        list of ndarray of int, each of shape (n_vertices_i,)
            Vertex of the reference for each vertex of S_i; -1 for vertices that were removed, and for all of a shape
            that was left out.
        """
        given = self._check_new(X)
        p2ps = self._point_maps(given.shapes, matching=matching, n_stable=n_stable, refine=refine)
        numbered = [expand(p2p, shape.spectral.vertex_map, -1) for p2p, shape in zip(p2ps, given.shapes, strict=True)]
        return spread(numbered, given, lambda skipped: np.full(skipped.n_vertices, -1))

    def _point_maps(self, shapes: Sequence[ProbedShape], **how: Any) -> list[IntArray]:
        """Return point maps in the numbers of the meshes that were matched."""
        if self.bridge_ is not None:
            return [self._across.p2p[p2p] for p2p in self.bridge_._point_maps(shapes, **how)]
        matcher = self._matcher(**how)
        arguments = ((matcher, shape) for shape in shapes)
        return list(map_shapes(point_map, arguments, n_jobs=self.n_jobs, verbose=0, prefer="threads"))

    def stability_function(self) -> FloatArray:
        """Return how far learned maps miss each point of the reference, as a function to look at.

        Returns
        -------
        ndarray of shape (n_vertices_0,)
            Root of the sum over Y of squared (singular value times function), per training shape: the length of what
            maps add to the row of a point in the embedding. Low where many functions agree.
        """
        check_is_fitted(self, "stable_basis_")
        k = len(self.stable_basis_)
        scaled = self.reference_.spectral.evecs[:, :k] @ (self.stable_basis_ * self.stability_)
        return np.asarray(np.linalg.norm(scaled, axis=1) / np.sqrt(self._n_training))

    def pair_errors(
        self,
        X: Sequence[ProbedShape],
        y: Sequence[Any],
        *,
        method: str = "heat",
        matching: str | None = None,
        n_stable: float | None = None,
        refine: str | None = "fitted",
        reference_y: Any = None,
    ) -> list[PairErrors]:
        """Match shapes of known correspondence and return the error at each pair.

        Parameters
        ----------
        X, y : sequence of ProbedShape, sequence of correspondences
            Shapes and where they lie on the template.
        method : {"heat", "exact", "dijkstra"}, default="heat"
            How distances on the reference are measured; see `skfmap.metrics.GeodesicDistances`.
        matching, n_stable, refine : optional
            As in `point_maps`.
        reference_y : Correspondence or int array, optional
            Where the reference lies at the template points of ``y``; what `fit` was given by default. With sparse
            landmarks, fit one half of them and score the other.

        Returns
        -------
        list of PairErrors
            In units of sqrt(area) of the reference; without pairs for a shape that was left out.
        """
        X, answers = self._check_scored(X, y)
        given = sort_out(X)
        distances = reference_distances(self.reference_.spectral.mesh, method, memory=self.memory, n_jobs=self.n_jobs)
        truth_0 = self.reference_correspondence_
        if reference_y is not None:
            (truth_0,) = check_correspondences([reference_y], [self.reference_])
        if method == "heat" and self.reference_.spectral.mesh.n_vertices <= _N_ALL_ROWS:
            # The same rows for every shape and fold, so that a cache serves them all.
            self._tell("geodesic distances on the reference, once for all scores")
            distances.rows(_reference_vertices(truth_0))
        p2ps = self._point_maps(given.shapes, matching=matching, n_stable=n_stable, refine=refine)
        errors = [
            _as_given(pair_errors(p2p, answers[i], truth_0, distances), shape)
            for p2p, i, shape in zip(p2ps, given.places, given.shapes, strict=True)
        ]
        nothing = PairErrors(np.empty(0, dtype=np.int64), np.empty(0), None, np.empty(0))
        return spread(errors, given, lambda _: nothing)

    def score(
        self,
        X: Sequence[ProbedShape],
        y: Sequence[Any],
        sample_weight: Sequence[float] | None = None,
        reference_y: Any = None,
    ) -> float:
        """Return minus the mean geodesic error of the matches; larger is better.

        Direct: a symmetric answer counts as an error. `skfmap.metrics.get_scorer` has the kinds that forgive it.

        Parameters
        ----------
        X, y : sequence of ProbedShape, sequence of correspondences
            Shapes and where they lie on the template.
        sample_weight : array-like of shape (n_shapes,), optional
            Share of each shape.
        reference_y : Correspondence or int array, optional
            As in `pair_errors`.

        Returns
        -------
        float
            In units of sqrt(area) of the reference, averaged over pairs and then over shapes. Shapes that were left out
            do not count; NaN if all were.
        """
        means = [errors.mean("direct") for errors in self.pair_errors(X, y, reference_y=reference_y)]
        return -mean_over_shapes(means, check_sample_weight(sample_weight, len(means)))

    def _check_parameters(self) -> None:
        check_number(self.n_functions, "n_functions", low=2, integer=True)
        if isinstance(self.weighting, str) or self.weighting is None:
            check_choice(self.weighting, "weighting", WEIGHTINGS)
        if isinstance(self.epsilon, str):
            check_choice(self.epsilon, "epsilon", ("auto",))
        else:
            check_number(self.epsilon, "epsilon", low=0, strict=True)
        check_number(self.alpha, "alpha", low=0, strict=True)
        if not callable(self.regularizer):
            check_choice(self.regularizer, "regularizer", (*REGULARIZERS, LEARNED))
        check_choice(self.normalize, "normalize", ("shape", "reference"))
        check_choice(self.matching, "matching", MATCHINGS)
        check_choice(self.refine, "refine", REFINEMENTS)
        check_choice(self.on_invalid, "on_invalid", ("raise", "skip"))
        for name in ("reference", "bridge"):
            value = getattr(self, name)
            if not isinstance(value, str) and (name == "reference" or value is not None):
                raise ValueError(f"{name} must be the name of a shape, or one of its words; got {value!r}.")
        check_number(self.max_iter, "max_iter", low=1, integer=True)
        check_number(self.tol, "tol", low=0)
        _count_stable(self.n_stable, self.n_functions)

    def _reference_index(self, shapes: Sequence[Any], truths: Sequence[Any]) -> int:
        """Return the place of the reference; one that cannot be used is an error."""
        index = self._place_of_reference(shapes, truths)
        for what in (shapes[index], truths[index]):
            if isinstance(what, SkippedShape):
                raise MeshError(
                    f"The reference, {place(index, what)}, cannot be used: {what.reason} Mend it or choose another."
                )
        if shapes[index].spectral.vertex_map is not None:
            raise MeshError(
                f"The vertices of the reference, {place(index, shapes[index])}, have other numbers since it was "
                "mended, and matches refer to them. Mend it with repair_mesh first, and use that mesh and its numbers."
            )
        return index

    def _place_of_reference(self, shapes: Sequence[Any], truths: Sequence[Any]) -> int:
        if self.reference == "first":
            return 0
        if self.reference == "medoid":
            sound = [i for i in range(len(shapes)) if not isinstance(truths[i], SkippedShape)]
            if not sound:
                raise MeshError(f"No shape can be used: {truths[0].reason} All others are left out too.")
            return sound[medoid_index([shapes[i] for i in sound], [truths[i] for i in sound], self.n_jobs)]
        names = [shape.name for shape in shapes]
        if names.count(self.reference) != 1:
            raise ValueError(
                f"reference={self.reference!r} must name exactly one of the training shapes; got {names}. In a search "
                "that resamples, keep it in every fold with PinnedReference."
            )
        return names.index(self.reference)

    def _usable(self, shapes: Sequence[Any], truths: Sequence[Any], reference: int) -> list[int]:
        """Return the places of the shapes to learn from, the reference among them, and warn of the others."""
        answers = [
            self._without_points(truths[i], shapes[i], truths[reference], shapes[reference])
            if self.on_invalid == "skip" and i != reference
            else truths[i]
            for i in range(len(shapes))
        ]
        warn_of_skipped(answers)
        used = [i for i, answer in enumerate(answers) if not isinstance(answer, SkippedShape)]
        if len(used) < 2:
            raise ValueError(f"Give at least two shapes: the reference and one to learn from; got {len(used)}.")
        return used

    def _without_points(self, truth: Any, shape: Any, truth_0: Correspondence, reference: ProbedShape) -> Any:
        """Return the correspondence, or why there is nothing to be learned from it."""
        if isinstance(truth, SkippedShape):
            return truth
        try:
            check_landmarks(shape, reference, join_with_reference(truth, shape, truth_0, reference), self.n_functions)
        except CorrespondenceError as error:
            return SkippedShape(shape.name, str(error))
        return truth

    def _training(
        self, index: int, shapes: Sequence[ProbedShape], truths: Sequence[Correspondence], share: FloatArray
    ) -> Training:
        """Split the reference off, and fit what is known of the others."""
        rest = [i for i in range(len(shapes)) if i != index]
        reference, others = shapes[index], [shapes[i] for i in rest]
        joins = [join_with_reference(truths[i], shapes[i], truths[index], reference) for i in rest]
        known = known_maps(others, reference, joins, self.n_functions, memory=self.memory, n_jobs=self.n_jobs)
        return Training(index, reference, truths[index], others, joins, known, share[rest])

    def _fit_bridge(
        self, training: Training, truths: Sequence[Correspondence], fitted: dict[str, Any]
    ) -> dict[str, Any]:
        """Learn the maps to a training shape that is near as well, if asked, and find out whether that pays."""
        place = self._bridge_index(training, truths)
        if place is None:
            return {"bridge_": None, "bridge_errors_": {}, "_across": None}
        shape = training.shapes[place]
        self._tell(f"learning the maps to {label(shape.name, 'shape')} as well")
        rest = [i for i in range(len(truths)) if i != place]
        inner = clone(self).set_params(reference="first", bridge=None, verbose=0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DisagreementWarning)  # it has been told, by the right places
            inner.fit(
                [_as_numbered_now(training.shapes[i]) for i in (place, *rest)],
                [truths[place], *(truths[i] for i in rest)],
                [1.0, *training.share[rest]],
            )
        across = cross_over(shape.spectral.mesh, training.reference.spectral.mesh, training.joins[place], self.memory)
        kind = self.refine or UNREFINED
        errors = {
            "direct": fitted["error_models_"][kind].mean_error,
            "bridge": inner.error_models_[kind].mean_error + across.error,
        }
        self._tell(f"errors on shapes left out: {errors['direct']:.4f} directly, {errors['bridge']:.4f} by the bridge")
        if self.bridge == "auto" and not pays(errors["direct"], errors["bridge"]):
            return {"bridge_": None, "bridge_errors_": errors, "_across": None}
        return {"bridge_": inner, "bridge_errors_": errors, "_across": across}

    def _bridge_index(self, training: Training, truths: Sequence[Correspondence]) -> int | None:
        if self.bridge is None:
            return None
        if self.bridge == "auto":
            return choose_bridge(training, truths, self.n_functions)
        names = [shape.name for shape in training.shapes]
        if names.count(self.bridge) != 1 or len(names) < 2:
            raise ValueError(
                f"bridge={self.bridge!r} must name exactly one of the training shapes beside the reference, and leave "
                f"another to learn from; got {names}."
            )
        return names.index(self.bridge)

    def _options(self, reference: ProbedShape) -> dict[str, Any]:
        """Return the parameters of `learn_functional_maps`."""
        return {
            "weighting": _labels_of(self.weighting, reference),
            "categories": reference.probe_categories,
            "epsilon": self.epsilon,
            "alpha": self.alpha,
            "regularizer": self.regularizer,
            "normalize": self.normalize,
            "max_iter": self.max_iter,
            "tol": self.tol,
        }

    def _learn(self, training: Training, task: FitTask) -> LearnedMaps:
        def after_iteration(iteration: int, loss: float, so_far: Callable[[], LearnedMaps]) -> bool:
            if iteration % 10 == 0:
                self._tell(f"iteration {iteration}: loss {loss:.4f}")
            stop = task.end_iteration(lambda: self._fitted_attributes(training, so_far()))
            task.begin_iteration()
            return stop

        task.begin_iteration()
        arrays = learning_arrays(training, self.n_functions)
        learned = learn_functional_maps(
            **arrays,
            **self._options(training.reference),
            n_threads=min(effective_n_jobs(self.n_jobs), cpu_count()),  # a cluster's workers are not threads here
            callback=after_iteration,
        )
        if not (learned.optimum.converged or learned.optimum.stopped):
            warnings.warn(
                f"The weights did not converge in {learned.optimum.n_iter} iterations (gradient "
                f"{learned.optimum.gradient_norm:.2g}, tol {self.tol:g}): {learned.optimum.message}. Raise max_iter "
                "or tol.",
                ConvergenceWarning,
                stacklevel=5,
            )
        return learned

    def _fitted_attributes(self, training: Training, learned: LearnedMaps) -> dict[str, Any]:
        """Return what `fit` leaves behind, but for the expected errors."""
        reference, p = training.reference, _count_stable(self.n_stable, self.n_functions)
        settings = Settings(self.alpha, self.normalize, learned.regularizer, self.matching, p, self.refine)
        used = np.flatnonzero(training.share > 0)
        matcher = matcher_from(training, used, learned.maps[used], learned, settings)
        return {
            "weights_": learned.weights,
            "stable_basis_": learned.stable_basis,
            "stability_": learned.stability,
            "residual_covariance_": matcher.residual_covariance,
            "truncation_covariance_": matcher.truncation_covariance,
            "epsilon_": learned.epsilon,
            "loss_": learned.optimum.loss_curve[-1],
            "loss_curve_": learned.optimum.loss_curve,
            "n_iter_": learned.optimum.n_iter,
            "converged_": learned.optimum.converged,
            "n_training_shapes_": len(used),
            "n_stable_": p,
            "reference_": reference,
            "reference_index_": training.place,
            "reference_correspondence_": training.truth_0,
            "probe_names_": np.array(reference.probe_names, dtype=object),
            "probe_categories_": np.array(reference.probe_categories, dtype=object),
            "bridge_": None,
            "bridge_errors_": {},
            "_across": None,
            "_n_training": float(training.share.sum()),
            "error_models_": {},
            "misfits_": np.empty(0),
            "training_errors_": np.empty(0),
            "_settings": settings,
        }

    def _calibrated(self, training: Training, matcher: Matcher, places: Sequence[int], n_shapes: int) -> dict[str, Any]:
        """Return the expected errors, and what each training shape showed, at the places of X."""
        options = self._options(training.reference)
        observed = calibrate(training, matcher, options, memory=self.memory, n_jobs=self.n_jobs)
        misfits, errors = np.full((2, n_shapes), np.nan)
        misfits[places], errors[places] = observed.misfits, observed.errors
        return {"error_models_": observed.error_models, "misfits_": misfits, "training_errors_": errors}

    def _matcher(
        self, *, matching: str | None = None, n_stable: float | None = None, refine: str | None = "fitted"
    ) -> Matcher:
        """Return what matches new shapes, with other settings if asked."""
        check_choice(matching, "matching", (None, *MATCHINGS))
        check_choice(refine, "refine", ("fitted", *REFINEMENTS))
        given = {
            "matching": matching,
            "n_stable": None if n_stable is None else _count_stable(n_stable, len(self.stable_basis_)),
        }
        settings = self._settings._replace(**{name: value for name, value in given.items() if value is not None})
        if refine != "fitted":
            settings = settings._replace(refine=refine)
        return _matcher_of(vars(self))._replace(settings=settings)

    def _check_new(self, X: Sequence[Any]) -> Sorted:
        check_is_fitted(self, "stable_basis_")
        given = sort_out(check_shapes(X, len(self.stable_basis_)))
        for i, shape in zip(given.places, given.shapes, strict=True):
            check_same_probes(shape, self.reference_, place(i, shape), "the training shapes")
        return given

    def _check_scored(self, X: Sequence[Any], y: Sequence[Any]) -> tuple[list[Any], list[Any]]:
        """Return shapes and correspondences; a shape whose correspondence does not fit is skipped too, if asked."""
        self._check_new(X)
        answers = check_correspondences(y, X, skip=self.on_invalid == "skip")
        shapes = [a if isinstance(a, SkippedShape) else shape for shape, a in zip(X, answers, strict=True)]
        warn_of_skipped([one for one, shape in zip(shapes, X, strict=True) if one is not shape])
        return shapes, answers

    def _tell(self, message: str) -> None:
        if self.verbose:
            tell(f"[{type(self).__name__}] {message}")

    def __sklearn_tags__(self) -> Tags:
        """Return tags that say that samples are no rows of a table, and that y is needed."""
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = False
        tags.target_tags.required = True
        return tags


def match(
    model: Any, X: Sequence[Any], *, refine: str | None = "fitted", interpolate: str | None = None
) -> list[Match]:
    """Match shapes with a fitted learner, a Pipeline that ends in one, or a fitted search over either.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, Pipeline or fitted search
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


def functional_maps(model: Any, X: Sequence[Any]) -> FloatArray:
    """Return full functional maps, from the reference to each shape, by any model that `match` takes.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, Pipeline or fitted search
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


def _count_stable(n_stable: float | None, k: int) -> int:
    """Return p."""
    if n_stable is None:
        return max(1, k // 2)
    if isinstance(n_stable, (int, np.integer)):
        return int(check_number(n_stable, "n_stable", low=1, high=k, integer=True))
    return max(1, round(check_number(n_stable, "n_stable", low=0, high=1, strict=True) * k))


def _warn_of_instability(fitted: Mapping[str, Any], known: FloatArray, *, epsilon_given: bool = False) -> None:
    """Say it if nothing was learned that can be relied on, and what to change."""
    images = np.linalg.norm(known @ fitted["stable_basis_"], axis=1).mean(axis=0)
    missed = fitted["stability_"] / np.sqrt(fitted["_n_training"]) / np.maximum(images, 1e-300)
    best = float(missed[1:].min())  # the constant function always maps
    if best > _UNSTABLE:
        warnings.warn(
            f"No function maps stably: even the best is missed by {best:.2f} of its norm on the training shapes. Check "
            "that the correspondences belong to their shapes (vertex numbers from 0, Correspondence.from_vertices or "
            "from_template), and the winding of the meshes; or give other probes.",
            StabilityWarning,
            stacklevel=4,
        )
    full = fitted["_n_training"] * (len(fitted["stable_basis_"]) - 1)
    if epsilon_given and fitted["n_iter_"] == 0 and not 1e-3 < fitted["loss_"] / full < 1 - 1e-3:
        warnings.warn(
            f"No weight was changed: at epsilon={fitted['epsilon_']:.3g} the loss is as good as constant. Take "
            "epsilon='auto', or a number near the squared singular values of X(I) - C.",
            StabilityWarning,
            stacklevel=4,
        )
    logs = np.log(fitted["weights_"])
    for n_bound, side, remedy in (
        (int((logs >= LOG_WEIGHT_BOUND).sum()), "upper", "lower alpha"),
        (int((logs <= -LOG_WEIGHT_BOUND).sum()), "lower", "raise alpha, or give more training shapes"),
    ):
        if n_bound > len(logs) / 2:
            warnings.warn(
                f"{n_bound} of {len(logs)} weights are at the {side} bound of the search; {remedy}.",
                StabilityWarning,
                stacklevel=4,
            )


def _as_given(errors: PairErrors, shape: ProbedShape) -> PairErrors:
    """Return errors at the vertices that the shape came with."""
    vertex_map = shape.spectral.vertex_map
    return errors if vertex_map is None else replace(errors, vertices=given_numbers(vertex_map)[errors.vertices])


def _labels_of(weighting: Any, reference: ProbedShape) -> Any:
    """Return a weighting that needs no names: a callable is asked for the label of each probe."""
    if not callable(weighting):
        return weighting
    labels = weighting(list(reference.probe_names), list(reference.probe_categories))
    if isinstance(labels, str) or not hasattr(labels, "__iter__"):
        raise TypeError(f"weighting must return one label for each probe; it returned {labels!r}.")
    return list(labels)


def _as_numbered_now(shape: ProbedShape) -> ProbedShape:
    """Return the shape as if its vertices had always had the numbers of the mended mesh, as its correspondence has."""
    return replace(shape, spectral=replace(shape.spectral, vertex_map=None))


def _reference_vertices(truth: Correspondence) -> IntArray:
    symmetric = truth.pairs[:0] if truth.symmetric_pairs is None else truth.symmetric_pairs
    return np.union1d(truth.pairs[:, 0], symmetric[:, 0])


def _matcher_of(fitted: Mapping[str, Any]) -> Matcher:
    """Return what matches new shapes, from the fitted attributes."""
    names = ("reference_", "weights_", "stable_basis_", "residual_covariance_", "truncation_covariance_", "_settings")
    return Matcher(*(fitted[name] for name in names))
