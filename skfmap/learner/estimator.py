"""Learn which probe functions to trust, and which functions map stably."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal, Self

import numpy as np
from joblib import cpu_count, effective_n_jobs
from sklearn.base import BaseEstimator
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted

from skfmap._measures import PairErrors, mean_over_shapes
from skfmap._tools.caching import MemoryLike
from skfmap._tools.callbacks import CallbackSupportMixin, FitTask, with_callbacks
from skfmap._tools.fitted import fitted_attribute
from skfmap._tools.parallel import map_shapes, single_threaded, tell
from skfmap._tools.types import (
    Array,
    Confidences,
    DistanceMethod,
    FloatArray,
    IntArray,
    Interpolation,
    KnownMapsWord,
    Matching,
    MatchingOverride,
    Normalize,
    OnMirrored,
    RaiseOrSkip,
    RefineOverride,
    RefineWord,
    RegularizerWord,
    Weighting,
)
from skfmap._tools.validation import check_choice, check_number, check_sample_weight, label
from skfmap._version import Versioned
from skfmap.functional.learning import LearnedMaps
from skfmap.functional.regularization import Regularizer
from skfmap.functional.stable_basis import missed_by_maps
from skfmap.ground_truth import join_with_reference, known_maps, warn_of_coverage
from skfmap.known_maps import KnownMaps, KnownMapsRecord
from skfmap.learner.about_meshes import with_meshes
from skfmap.learner.between import check_wanted, match_pairs, matched_once, only_wanted
from skfmap.learner.confidence import Confidence
from skfmap.learner.diagnostics import (
    Finding,
    diagnose,
    diagnose_new_shapes,
    diagnose_reflected,
    diagnose_registered,
    is_mirrored,
    report,
)
from skfmap.learner.error_model import ErrorModel
from skfmap.learner.given_answers import given_reference
from skfmap.learner.inputs import check_new_shapes, check_scored
from skfmap.learner.laid_out import registered, unregistered
from skfmap.learner.landmark_model import LandmarkModel, learn_landmarks
from skfmap.learner.legacy import upgraded
from skfmap.learner.matcher import Matcher, Solution
from skfmap.learner.mirrored import mirror_image
from skfmap.learner.new_shape import INTERPOLATIONS, MatchedShape, match_shape, no_match, point_map
from skfmap.learner.parameters import (
    WORDS,
    changed,
    check_parameters,
    confidence_of,
    count_stable,
    known_maps_of,
    learning_options,
    refinement_of,
)
from skfmap.learner.parts import check_part_is_object, fit_part
from skfmap.learner.predicted_landmarks import LandmarkPredictor
from skfmap.learner.scoring import score_point_maps
from skfmap.learner.training_set import FitRecord, TrainingSet
from skfmap.refinement import Refinement
from skfmap.registration import Registration
from skfmap.shapes import Correspondence, Landmarks, Match, ProbedShape, Registered
from skfmap.shapes.usable import Answer, ProbedItem, Usable, describe, put_back

__all__ = ["WeightedFunctionalMapLearner"]


class WeightedFunctionalMapLearner(CallbackSupportMixin, Versioned, BaseEstimator):
    r"""Learn probe weights D and a stable basis Y from shapes with known correspondences.

    It is the last step of a pipeline. ``predict``, which pipelines and searches also have, returns
    the reduced functional maps of the paper, an array of shape (n_shapes, k, p). To get
    point-to-point maps with expected errors, use ``skfmap.match(model, X)``, because a Pipeline
    does not have the method ``match`` of its last step.

    For a new shape S_i, the functional map is (equation 2 of the paper)

    .. math:: X_i(D) = \arg\min_C \|(C G_0 - G_i) D\|_F^2 + \alpha \|C \odot W\|_F^2

    and D minimises the sum over training shapes of :math:`\|X_i(D) - C_i\|_\epsilon` (equations 3
    and 4). The entries of W * W are at least 1e-5 (``DIAGONAL_FLOOR`` of
    `skfmap.functional.penalty_of`), so that the minimum is unique even if the spectra agree and no
    weighted probe has a component along a function. The two maps go in opposite directions: the
    functional map pulls functions on the reference S_0 back to S_i; the point-to-point map sends
    points of S_i to S_0.

    The parameters form four groups: learning (`n_functions` to `tol`), matching new shapes
    (`n_stable` to `on_mirrored`), confidence (`confidence`) and running (`on_invalid` to
    `verbose`). Start with the defaults; `n_functions`, `refine` and `confidence` are the ones most
    often changed.

    Parameters
    ----------
    n_functions : int, default=50
        The number k of eigenfunctions that are used on each shape, starting with the smoothest.
    weighting : {"function", "category", "unique"}, sequence, callable or None, default="function"
        One weight per probe, one per family, one for all, or none (D = I, the naive baseline; Y is
        still learned). A sequence contains a label for each probe, and probes with the same label
        share a weight; a callable returns these labels for the names and the categories of the
        probes, ``(names, categories) -> labels``.
    epsilon : float or "auto", default="auto"
        The epsilon of the norm (4). ``"auto"`` is the 80 percent rule of section 3.2. The loss
        depends on epsilon, so it does not tell which epsilon is better: use a score.
    alpha : float, default=0.01
        Strength of the regulariser, for probes of norm 1 / sqrt(m). With learned weights it only
        affects the start and the automatic epsilon; with ``weighting=None`` it is worth a search.
    regularizer : {"laplacian", "resolvent", "learned"} or callable, default="laplacian"
        Deformation model: ``(evals_i, evals_0) -> W`` of shape (k, k). ``"laplacian"`` is the
        paper's, ``"resolvent"`` is bounded (Ren et al. 2019), and ``"learned"`` expects each entry
        to be as large as in the known maps of the training shapes.
    normalize : {"shape", "reference"}, default="shape"
        Whether probe columns are scaled by each shape's own norms (section 2.1) or by those of the
        reference.
    known_maps : {"auto", "pairs", "from-landmarks", "in-space"}, KnownMaps or None, default="auto"
        Where the known maps of training shapes come from. ``"pairs"``, or None: from the given
        pairs, of which there must be at least ``n_functions``. ``"from-landmarks"``: dense maps are
        built for shapes that share fewer than twice as many pairs with the reference, but at least
        8 landmarks (`skfmap.known_maps.FromLandmarks`). ``"in-space"``: likewise, for rigid kinds
        of shapes (`skfmap.known_maps.InSpace`). ``"auto"`` chooses according to the data, and
        ``known_maps_`` records the choice.
    reference : str, default="first"
        ``"first"``: the first training shape. ``"medoid"``: the training shape whose geodesic
        distances differ least from those of all others. Any other value is the name of a training
        shape.
    max_iter : int, default=1000
        Maximum number of L-BFGS iterations.
    tol : float, default=1e-4
        The search has converged when no derivative of the mean loss per singular value, with
        respect to a log-weight, is larger than this.
    n_stable : int, float in (0, 1], or None
        The number p of stable functions that the reduced map keeps, or their fraction of k; None is
        k // 2.
    matching : {"soft", "cut"}, default="soft"
        ``"soft"`` matches points in all stable functions, each weighted by how accurately it puts
        the points of the training shapes where they belong; ``"cut"`` matches in the first p only.
    refine : {"auto", "bijective-zoomout", "register", "icp", "zoomout"}, Refinement or None
        How point-to-point maps are refined: a word, or the object that it stands for
        (`skfmap.refinement`), whose parameters can then be searched, such as ``refine__step``. The
        default, ``"auto"``, is ``"register"`` if the correspondence of the reference has measured
        points (`Correspondence.from_points`), and otherwise ``"bijective-zoomout"``. The latter is
        the best of those that work on maps alone: it fits maps of growing size, up to all
        eigenfunctions of `SpectralBasis`, to the point-to-point maps in both directions, with
        functions weighted by their errors on the training shapes; it about halves the errors.
        ``"zoomout"`` (Melzi et al. 2019) and ``"icp"`` (Ovsjanikov et al. 2012) are as published.
        ``"register"`` (`skfmap.registration.Registration`) continues in space, and lays the
        reference's mesh onto each shape: errors fall by another tenth to a quarter, and a match
        takes about a second more. None switches refinement off.
    on_mirrored : {"warn", "reflect"}, default="warn"
        What to do with shapes that are mirror images of the kind that the reference belongs to,
        such as a right femur among left ones. Training shapes are recognised by their
        correspondences, new ones if equation (2) fits their mirror image much better. ``"reflect"``
        learns from and matches their mirror images, and issues a warning that names them; answers
        are on the meshes as given. It needs oriented probes, or training shapes so rigid that a
        similarity explains their correspondences. A body that is its own mirror image is not
        reflected.
    confidence : {"cross-fit"}, Confidence or None, default="cross-fit"
        How expected errors are found: ``"cross-fit"`` is `CrossFitConfidence`, which learns again
        for each of three folds. None omits them, for searches that only compare scores: a fit then
        takes a third of the time, or a tenth with refinement. ``expected_error`` and ``confidence``
        of matches are then None, landmarks have no ``expected_error``, ``radius`` or learned
        offset, and there are no warnings about contradictory correspondences. Only
        ``refine="register"`` then warns of unfamiliar shapes; without it ``familiar`` is None.
    on_invalid : {"raise", "skip"}, default="raise"
        What to do with a training shape whose correspondence cannot be used: out of range, empty,
        without a point of the reference, or with too few points. ``"skip"`` leaves it out with a
        warning; for the reference, an error is always raised. Shapes that earlier steps skipped are
        always left out.
    memory : str or joblib.Memory, optional
        Where known maps and geodesic distances are cached, so that the fits and scores of a search
        share them.
    n_jobs : int, optional
        Number of shapes processed in parallel; see joblib. It does not change the result.
    verbose : int, default=0
        If 1, each stage and every tenth iteration are reported.

    Attributes
    ----------
    weights_ : ndarray of shape (m,)
        Diagonal of D, positive.
    stable_basis_ : ndarray of shape (k, k)
        Y: coefficients of functions on the reference, most stable first. The constant function is
        mapped exactly.
    stability_ : ndarray of shape (k,)
        Singular values that belong to the columns of Y, ascending.
    epsilon_ : float
        The epsilon used.
    loss_, loss_curve_, n_iter_ : float, list of float, int
        Equation (3) at the end, at the start and after each iteration, and the number of
        iterations.
    converged_ : bool
        Whether the search for weights converged.
    n_training_shapes_ : int
        Number of shapes learned from, without the reference and those with sample weight 0.
    n_stable_ : int
        The number p of stable functions that the reduced map keeps.
    reference_, reference_index_ : ProbedShape, int
        The reference, and its index in the training data.
    reference_correspondence_ : Correspondence
        Where the reference lies on the template.
    probe_names_, probe_categories_ : ndarray of str, shape (m,)
        Name and category of the probe function that each weight belongs to.
    residual_covariance_ : ndarray of shape (k, k)
        Covariance of how far learned maps put the points of the training shapes from where they
        belong; ``matching="soft"`` weights functions by it.
    truncation_covariance_ : ndarray of shape (n_components, n_components)
        The same for the known maps in all functions of the basis, whose errors come from truncation
        alone; refinement weights functions by it.
    matcher_ : Matcher
        The fitted state that matches new shapes; most of the attributes above are read from it.
    refine_, confidence_ : Refinement or None, Confidence or None
        The fitted parts.
    known_maps_ : KnownMapsRecord
        How the known maps were made: kind, landmarks and pairs of each training shape, and how far
        from its place each landmark is put by the map that is built without it. None in models that
        were saved before this was recorded.
    landmarks_ : LandmarkModel or None
        Model of the measured points of the training shapes, for `predict_landmarks`; None if the
        reference has no measured points.
    error_models_, misfits_, training_errors_ : dict, ndarray, ndarray
        Attributes of `CrossFitConfidence`, which describes them; they do not exist for any other
        ``confidence``.

    See Also
    --------
    SpectralBasis, DescriptorTransformer : The previous steps of the pipeline.
    skfmap.functional.learn_functional_maps : The same on arrays, for maps without points.

    References
    ----------
    .. [1] E. Corman, M. Ovsjanikov, A. Chambolle. "Supervised descriptor learning for non-rigid
       shape matching". ECCV Workshops, 2014.

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

    # For models that were saved before these parameters existed.
    on_mirrored: OnMirrored = "warn"
    known_maps: KnownMapsWord | KnownMaps | None = "auto"

    matcher_: Matcher
    confidence_: Confidence | None
    landmarks_: LandmarkModel | None
    record_: FitRecord
    known_maps_: KnownMapsRecord | None
    weights_: FloatArray = fitted_attribute("matcher_.weights")
    stable_basis_: FloatArray = fitted_attribute("matcher_.stable_basis")
    residual_covariance_: FloatArray = fitted_attribute("matcher_.residual_covariance")
    truncation_covariance_: FloatArray = fitted_attribute("matcher_.truncation_covariance")
    reference_: ProbedShape = fitted_attribute("matcher_.reference")
    n_stable_: int = fitted_attribute("matcher_.settings.n_stable")
    refine_: Refinement | None = fitted_attribute("matcher_.refinement")
    stability_: FloatArray = fitted_attribute("record_.stability")
    epsilon_: float = fitted_attribute("record_.epsilon")
    loss_: float = fitted_attribute("record_.loss")
    loss_curve_: list[float] = fitted_attribute("record_.loss_curve")
    n_iter_: int = fitted_attribute("record_.n_iter")
    converged_: bool = fitted_attribute("record_.converged")
    n_training_shapes_: int = fitted_attribute("record_.n_shapes")
    reference_index_: int = fitted_attribute("record_.reference_index")
    reference_correspondence_: Correspondence = fitted_attribute("record_.reference_correspondence")
    probe_names_: Array = fitted_attribute("matcher_.probe_names")
    probe_categories_: Array = fitted_attribute("matcher_.probe_categories")
    error_models_: dict[str, ErrorModel] = fitted_attribute("confidence_.error_models_")
    misfits_: FloatArray = fitted_attribute("confidence_.misfits_")
    training_errors_: FloatArray = fitted_attribute("confidence_.training_errors_")

    def __init__(
        self,
        *,
        n_functions: int = 50,
        weighting: Weighting = "function",
        epsilon: float | Literal["auto"] = "auto",
        alpha: float = 0.01,
        regularizer: RegularizerWord | Regularizer = "laplacian",
        normalize: Normalize = "shape",
        known_maps: KnownMapsWord | KnownMaps | None = "auto",
        reference: str = "first",
        max_iter: int = 1000,
        tol: float = 1e-4,
        n_stable: float | None = None,
        matching: Matching = "soft",
        refine: RefineWord | Refinement | None = "auto",
        on_mirrored: OnMirrored = "warn",
        confidence: Confidences | Confidence | None = "cross-fit",
        on_invalid: RaiseOrSkip = "raise",
        memory: MemoryLike = None,
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
        self.confidence = confidence
        self.known_maps = known_maps
        self.reference = reference
        self.on_invalid = on_invalid
        self.on_mirrored = on_mirrored
        self.max_iter = max_iter
        self.tol = tol
        self.memory = memory
        self.n_jobs = n_jobs
        self.verbose = verbose

    @with_callbacks
    def fit(
        self,
        X: Sequence[ProbedItem],
        y: Sequence[Answer],
        sample_weight: Sequence[float] | None = None,
    ) -> Self:
        """Learn the weights and the stable basis.

        Parameters
        ----------
        X : sequence of ProbedShape
            Training shapes, including the reference; from `DescriptorTransformer`.
        y : sequence of Correspondence or of int arrays of shape (n_pairs, 2)
            Where each shape lies on the template: rows ``[vertex, template point]``.
        sample_weight : array-like of shape (n_shapes,), optional
            Share of each shape in the sum (3) and in Y; that of the reference is not used.

        Returns
        -------
        WeightedFunctionalMapLearner
            The fitted learner.

        Raises
        ------
        CorrespondenceError
            If correspondences do not fit their shape, share no template point with the reference,
            or are too few for k.
        ValueError
            If shapes are not consistent with each other, or a parameter is invalid.
        TypeError
            If ``X`` or ``y`` contains objects of another type.

        Warns
        -----
        CoverageWarning
            If correspondences determine a functional map only in part.
        OrientationWarning
            If the correspondence of a shape confuses left and right, as that of a mirrored mesh
            does, or if shapes were reflected.
        ConvergenceWarning
            If the search stopped before it converged.
        StabilityWarning
            If no function is mapped stably, or many weights are at the bounds of the search.
        DisagreementWarning
            If the correspondence of a shape contradicts those of the others, or that of the
            reference contradicts all of them.
        SkippedShapeWarning
            If shapes were left out.
        """
        check_parameters(self)
        training = self._training_set(X, y, sample_weight)
        self._tell(f"reference: {label(training.reference.name, 'shape')}")
        self._tell(str(training.how))
        task = FitTask(self, X, y, sample_weight, self.max_iter)
        fitted, findings = self._fitted(training, task)
        report(findings)
        self.__dict__.update(fitted)  # at once, so that an interrupted fit leaves nothing behind
        task.end(fitted)
        return self

    def _fitted(self, training: TrainingSet, task: FitTask) -> tuple[dict[str, Any], list[Finding]]:
        """Run the paper's pipeline (figure 2); return the fitted state and findings about it."""
        learned = single_threaded(self._learn, training, task)
        fitted = self._assembled(training, learned)
        confidence = confidence_of(self.confidence)
        if confidence is not None:
            self._tell("calibrating expected errors on held-out training shapes")
            fitted["confidence_"] = fit_part(confidence, training, fitted["matcher_"])
        fitted["landmarks_"] = learn_landmarks(
            training, fitted["matcher_"], left_out=confidence is not None
        )
        errors = getattr(fitted["confidence_"], "training_errors_", None)
        return fitted, diagnose(training, learned, errors)

    def functional_maps(self, X: Sequence[ProbedItem]) -> FloatArray:
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
            If a shape is unlike the training shapes.
        """
        usable, k = self._usable(X), len(self.stable_basis_)
        solutions = self._solutions(usable.shapes)
        familiar = [
            self.confidence_ is None or self.confidence_.is_familiar(one) for one in solutions
        ]
        report(diagnose_new_shapes(usable, [False] * len(familiar), familiar))
        return np.stack(
            put_back([one.C for one in solutions], usable, lambda _: np.full((k, k), np.nan))
        )

    def ground_truth_maps(self, X: Sequence[ProbedItem], y: Sequence[Answer]) -> FloatArray:
        """Return the maps C_i given by known correspondences, to compare with `functional_maps`.

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
        usable, answers = self._scored(X, y)
        k, truth_0, reference = (
            len(self.stable_basis_),
            self.reference_correspondence_,
            self.reference_,
        )
        joins = [
            join_with_reference(a, s, truth_0, reference)
            for a, s in zip(answers, usable.shapes, strict=True)
        ]
        known = known_maps(
            usable.shapes, reference, joins, k, memory=self.memory, n_jobs=self.n_jobs
        )
        warn_of_coverage(
            known, [describe(i, s) for i, s in zip(usable.indices, usable.shapes, strict=True)], k
        )
        return np.stack(
            put_back([one.C for one in known], usable, lambda _: np.full((k, k), np.nan))
        )

    def predict(self, X: Sequence[ProbedItem]) -> FloatArray:
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
        self,
        X: Sequence[ProbedItem],
        *,
        refine: RefineOverride | Refinement | None = "fitted",
        interpolate: Interpolation = None,
    ) -> list[Match]:
        """Match the points of each shape to those of the reference, in the stable functions.

        Parameters
        ----------
        X : sequence of ProbedShape
            New shapes.
        refine : str, Refinement or None, default="fitted"
            Overrides the parameter of that name. ``"fitted"`` uses the fitted refinement, and None
            does not refine. Errors are calibrated for these two; for any other refinement, the
            expected errors are those of the unrefined match.
        interpolate : {"barycentric", "soft"} or None, default=None
            What a row of `Match.matrix` contains: one vertex of the reference (None), the nearest
            point on the triangles around it, or several vertices, weighted by their distance in
            the embedding.

        Returns
        -------
        list of Match
            Point-to-point map (from each shape to the reference), expected errors, confidence and
            functional maps.

        Warns
        -----
        OrientationWarning
            If a shape fits the reference much better as a mirror image, or was reflected for that
            reason. If a body is its own mirror image, its mirrored mesh cannot be told from it, and
            is matched by its own left and right.
        UnfamiliarShapeWarning
            If a shape is unlike the training shapes: another kind of body, or another resolution.
            With ``"register"`` also if the reference does not fit it, as in `register`.
        """
        usable = self._usable(X)
        found = self._matched(usable.shapes, refine, interpolate)
        self._report_found(usable, found)
        assessed = self.confidence_ is not None
        return put_back(
            with_meshes([one.match for one in found], usable.shapes, self.reference_),
            usable,
            lambda skipped: no_match(skipped, self.matcher_, assessed=assessed),
        )

    def match_between(
        self, X: Sequence[ProbedItem], pairs: Iterable[tuple[int, int]] | None = None
    ) -> list[Match]:
        """Match shapes to one another, by what they have in common with the reference.

        Each shape is matched to the reference once. Pairs are then matched in the embedding that
        all shapes share, and refined by two steps in both directions. With ``refine="register"``
        they are matched through the reference's surface, which has been laid onto each of them.

        Parameters
        ----------
        X : sequence of ProbedShape
            New shapes.
        pairs : iterable of (int, int), optional
            Indices (i, j) into ``X``, to match ``X[i]`` to ``X[j]``. By default, all pairs of
            different shapes in both directions: (0, 1), (0, 2), ..., (1, 0), ...

        Returns
        -------
        list of Match
            One match for each pair, whose reference is ``X[j]``: ``p2p`` sends vertices of ``X[i]``
            to vertices of ``X[j]``, and ``functional_map``, of shape (k, k), pulls functions on
            ``X[j]`` back to ``X[i]``. ``reduced_map`` contains the images on ``X[i]`` of the p most
            stable functions as carried to ``X[j]``. ``expected_error`` combines those of the two
            matches to the reference, in units of sqrt(area) of ``X[j]``. If either shape was left
            out, the answers are -1 and NaN.

        Raises
        ------
        TypeError, ValueError
            If ``pairs`` does not contain pairs of indices into ``X``.

        Warns
        -----
        OrientationWarning, UnfamiliarShapeWarning
            As in `match`, once for each shape.

        Notes
        -----
        Both directions come from the same search: ``p2p`` of (j, i) is ``inverse`` of (i, j). In
        addition to the answers, the points of each shape in the embedding are kept: 5 MB for 5,000
        vertices and 120 functions. If there are many pairs, request some of them at a time.
        """
        usable = self._usable(X)
        wanted = check_wanted(pairs, len(usable.shapes) + len(usable.skipped))
        usable = only_wanted(usable, wanted)
        matched = matched_once(self.matcher_, self.confidence_, usable.shapes, self.n_jobs)
        self._report_found(usable, [one.found for one in matched])
        by_index = dict(zip(usable.indices, matched, strict=True))
        return match_pairs(
            self.matcher_, self.confidence_, by_index, usable.skipped, wanted, self.n_jobs
        )

    def register(self, X: Sequence[ProbedItem]) -> list[Registered]:
        """Lay the reference's mesh onto each shape.

        Parameters
        ----------
        X : sequence of ProbedShape
            New shapes.

        Returns
        -------
        list of Registered
            The vertices of the reference's given mesh, laid onto the given mesh of each shape.

        Raises
        ------
        ValueError
            If the learner was fitted with a refinement other than ``"register"``.

        Warns
        -----
        UnfamiliarShapeWarning
            If the reference does not fit a shape, such as another kind of body, or a part of one.
        """
        usable = self._usable(X)
        registration = self.refine_
        if not isinstance(registration, Registration):
            late = isinstance(refinement_of(self.refine), Registration)
            raise ValueError(
                "register needs a learner that was fitted with refine='register'; here refine is "
                f"{self.refine!r}{', but was set after the fit' if late else ''}. "
                f"{'Fit' if late else 'Set it and fit'} again."
            )
        target = given_reference(self.reference_, [self.reference_])
        arguments = ((self.matcher_, registration, shape, target) for shape in usable.shapes)
        laid = map_shapes(
            registered, arguments, n_jobs=self.n_jobs, verbose=self.verbose, prefer="threads"
        )
        report(diagnose_registered(usable, laid))
        return put_back(laid, usable, lambda skipped: unregistered(skipped, target))

    def predict_landmarks(
        self, X: Sequence[ProbedItem], *, coverage: float = 0.9, on_surface: bool = False
    ) -> list[Landmarks]:
        """Place the landmarks of the training shapes on new shapes.

        Parameters
        ----------
        X : sequence of ProbedShape
            New shapes.
        coverage : float, default=0.9
            Share of the observer's points that balls of `Landmarks.radius` should contain.
        on_surface : bool, default=False
            Whether all points are put onto the surface. By default they are as far off the surface
            as those of the training shapes are on average, because of the observer's habit or a
            different threshold of the scan.

        Returns
        -------
        list of Landmarks
            Landmarks in the units and coordinates of each mesh. There are no expected errors if the
            learner was fitted with ``confidence=None``, or if the shape is unlike the training
            shapes. There are no radii if too few training shapes were left out to guarantee the
            coverage; 0.9 takes nine.

        Raises
        ------
        ValueError
            If the learner was fitted without measured points, or ``coverage`` is not between 0 and
            1.

        Warns
        -----
        OrientationWarning
            If a shape fits much better after mirroring; with ``on_mirrored="reflect"`` the
            landmarks are placed on its mirror image.
        UnfamiliarShapeWarning
            If a shape is unlike the training shapes.

        Notes
        -----
        Expected errors and radii come from distances on whole training shapes that were held out,
        both from learning and from the mean offset that is added to predictions; they are pooled
        over landmarks. Radii have the promised coverage on average over similar shapes and
        landmarks, provided that models learned from slightly fewer shapes have similar errors, as
        cross-validation assumes. They do not have it for each single landmark, nor for the points
        of another observer. If some shapes are much harder than others, and few were left out, the
        coverage can be a few percent lower. All training shapes with a positive weight count
        equally.
        """
        usable = self._usable(X)
        if check_number(coverage, "coverage", low=0, strict=True) >= 1:
            raise ValueError(f"coverage must be below 1, for instance 0.9; got {coverage!r}.")
        if self.landmarks_ is None:
            raise ValueError(
                "predict_landmarks needs a learner that was fitted with measured points; give y as "
                "Correspondence.from_points(points, mesh, names), also for the reference."
            )
        predictor = LandmarkPredictor(
            self.landmarks_, self.matcher_, self.confidence_, coverage, on_surface
        )
        found = map_shapes(
            predictor.of,
            ((shape,) for shape in usable.shapes),
            n_jobs=self.n_jobs,
            verbose=self.verbose,
            prefer="threads",
        )
        mirrored = [is_mirrored(one.solution) for one in found]
        report(diagnose_new_shapes(usable, mirrored, [one.fits for one in found]))
        return put_back([one.landmarks for one in found], usable, predictor.nowhere)

    def point_maps(
        self,
        X: Sequence[ProbedItem],
        *,
        matching: MatchingOverride = "fitted",
        n_stable: float | Literal["fitted"] | None = "fitted",
        refine: RefineOverride | Refinement | None = "fitted",
    ) -> list[IntArray]:
        """Return point-to-point maps only, optionally with other settings than the fitted ones.

        ``matching="cut", n_stable=1.0`` matches in all functions with equal weights, which is the
        full map of the paper's figure 5.

        Parameters
        ----------
        X : sequence of ProbedShape
            New shapes.
        matching, n_stable, refine : optional
            Override the parameters of these names; ``"fitted"`` uses the fitted values.

        Returns
        -------
        list of ndarray of int, each of shape (n_vertices_i,)
            Vertex of the reference for each vertex of S_i; -1 for vertices that were removed, and
            for all vertices of a shape that was left out.
        """
        usable = self._usable(X)
        p2ps = self._point_maps(usable.shapes, matching=matching, n_stable=n_stable, refine=refine)
        return put_back(p2ps, usable, lambda skipped: np.full(skipped.n_vertices, -1))

    def stability_function(self) -> FloatArray:
        """Return the error of learned maps at each vertex of the reference, as a function to plot.

        Returns
        -------
        ndarray of shape (n_vertices_0,)
            The root of the sum over Y of squared (singular value times function), per training
            shape: how far the maps move a point in the embedding. It is small where many functions
            agree.
        """
        check_is_fitted(self)
        spectral, Y = self.reference_.spectral, self.stable_basis_
        evecs = spectral.evecs[:, : len(Y)]
        missed = missed_by_maps(evecs, Y, self.stability_, self.record_.total_share)
        return np.asarray(spectral.prolong(missed))

    def pair_errors(
        self,
        X: Sequence[ProbedItem],
        y: Sequence[Answer],
        *,
        method: DistanceMethod = "heat",
        matching: MatchingOverride = "fitted",
        n_stable: float | Literal["fitted"] | None = "fitted",
        refine: RefineOverride | Refinement | None = "fitted",
        reference_y: Answer | None = None,
    ) -> list[PairErrors]:
        """Match shapes with known correspondences and return the error at each pair.

        Parameters
        ----------
        X, y : sequence of ProbedShape, sequence of correspondences
            Shapes and where they lie on the template.
        method : {"heat", "exact", "dijkstra"}, default="heat"
            How distances on the reference are measured; see `skfmap.metrics.GeodesicDistances`.
        matching, n_stable, refine : optional
            As in `point_maps`.
        reference_y : Correspondence or int array, optional
            Where the reference lies on the template of ``y``; by default as given to `fit`. With
            sparse landmarks, fit on one half of them and score on the other.

        Returns
        -------
        list of PairErrors
            Errors in units of sqrt(area) of the reference; a shape that was left out has no pairs.
        """
        usable, answers = self._scored(X, y)
        p2ps = self._point_maps(usable.shapes, matching=matching, n_stable=n_stable, refine=refine)
        self._tell("geodesic distances on the reference, once for all scores")
        return score_point_maps(
            p2ps,
            usable,
            answers,
            self.reference_,
            self.reference_correspondence_,
            reference_y=reference_y,
            method=method,
            memory=self.memory,
            n_jobs=self.n_jobs,
        )

    def score(
        self,
        X: Sequence[ProbedItem],
        y: Sequence[Answer],
        sample_weight: Sequence[float] | None = None,
        reference_y: Answer | None = None,
    ) -> float:
        """Return minus the mean geodesic error of the matches; larger is better.

        This is the direct error: a symmetric answer counts as wrong. For scorers that accept
        symmetric answers, see `skfmap.metrics.get_scorer`.

        Parameters
        ----------
        X, y : sequence of ProbedShape, sequence of correspondences
            Shapes and where they lie on the template.
        sample_weight : array-like of shape (n_shapes,), optional
            Weight of each shape in the mean.
        reference_y : Correspondence or int array, optional
            As in `pair_errors`.

        Returns
        -------
        float
            The score in units of sqrt(area) of the reference, averaged over pairs and then over
            shapes. Shapes that were left out do not count; NaN if all were.
        """
        means = [
            errors.mean("direct") for errors in self.pair_errors(X, y, reference_y=reference_y)
        ]
        return -mean_over_shapes(means, check_sample_weight(sample_weight, len(means)))

    def set_params(self, **params: Any) -> Self:
        """Set parameters.

        Parameters of a part, such as ``refine__step``, can be set if the part is an object and not
        a word.
        """
        check_part_is_object(params, self.get_params(deep=False), WORDS)
        return super().set_params(**params)

    def _training_set(
        self, X: Sequence[ProbedItem], y: Sequence[Answer], sample_weight: Sequence[float] | None
    ) -> TrainingSet:
        return TrainingSet.from_samples(
            X,
            y,
            sample_weight,
            n_functions=self.n_functions,
            reference=self.reference,
            on_invalid=self.on_invalid,
            on_mirrored=self.on_mirrored,
            options=learning_options(self),
            build=known_maps_of(self.known_maps),
            memory=self.memory,
            n_jobs=self.n_jobs,
        )

    def _learn(self, training: TrainingSet, task: FitTask) -> LearnedMaps:
        """Learn the weights and the stable basis, and notify callbacks after each iteration."""

        def after_iteration(iteration: int, loss: float, so_far: Callable[[], LearnedMaps]) -> bool:
            if iteration % 10 == 0:
                self._tell(f"iteration {iteration}: loss {loss:.4f}")
            stop = task.end_iteration(lambda: self._assembled(training, so_far()))
            task.begin_iteration()
            return stop

        task.begin_iteration()
        # The workers of a cluster are no threads of this process.
        n_threads = min(effective_n_jobs(self.n_jobs), cpu_count())
        return training.learn(n_threads=n_threads, callback=after_iteration)

    def _assembled(self, training: TrainingSet, learned: LearnedMaps) -> dict[str, Any]:
        """Return the fitted state except for the confidence."""
        n_stable = count_stable(self.n_stable, self.n_functions)
        matcher = Matcher.from_learned(training, learned, matching=self.matching, n_stable=n_stable)
        refinement = refinement_of(self.refine, measured=training.truth_0.coordinates is not None)
        return {
            "matcher_": replace(matcher, refinement=fit_part(refinement, training, matcher)),
            "record_": training.record(learned),
            "known_maps_": training.how,
            "confidence_": None,
            "landmarks_": None,
        }

    def _usable(self, X: Sequence[ProbedItem]) -> Usable:
        check_is_fitted(self)
        return self._of_one_side(check_new_shapes(X, self.reference_, len(self.stable_basis_)))

    def _scored(self, X: Sequence[ProbedItem], y: Sequence[Answer]) -> tuple[Usable, list[Any]]:
        check_is_fitted(self)
        usable, answers = check_scored(
            X, y, self.reference_, len(self.stable_basis_), skip=self.on_invalid == "skip"
        )
        return self._of_one_side(usable), answers

    def _of_one_side(self, usable: Usable) -> Usable:
        """Replace mirrored shapes by their mirror images if ``on_mirrored="reflect"``."""
        if self.on_mirrored != "reflect":
            return usable
        mirrored = [is_mirrored(one) for one in self._solutions(usable.shapes, mirrored=True)]
        called = map(describe, usable.indices, usable.shapes)
        report(diagnose_reflected([who for who, yes in zip(called, mirrored, strict=True) if yes]))
        return usable._replace(
            shapes=[
                mirror_image(shape) if yes else shape
                for shape, yes in zip(usable.shapes, mirrored, strict=True)
            ]
        )

    def _solutions(
        self, shapes: Sequence[ProbedShape], *, mirrored: bool = False
    ) -> list[Solution]:
        return map_shapes(
            partial(self.matcher_.solve, mirrored=mirrored),
            ((s,) for s in shapes),
            n_jobs=self.n_jobs,
            verbose=0,
            prefer="threads",
        )

    def _report_found(self, usable: Usable, found: Sequence[MatchedShape]) -> None:
        """Warn of what the matches of new shapes show."""
        mirrored, familiar, misfits = (
            [is_mirrored(one.solution) for one in found],
            [one.match.familiar for one in found],
            [one.misfit for one in found],
        )
        report(diagnose_new_shapes(usable, mirrored, familiar, misfits))

    def _matched(
        self,
        shapes: Sequence[ProbedShape],
        refine: str | Refinement | None,
        interpolate: str | None,
    ) -> list[MatchedShape]:
        """Return the matches of usable shapes, without warnings."""
        check_choice(interpolate, "interpolate", INTERPOLATIONS)
        matcher = changed(self.matcher_, refine=refine)
        refined = matcher.refinement is not None and matcher.refinement is self.refine_
        target = given_reference(matcher.reference, shapes)
        arguments = (
            (matcher, self.confidence_, shape, interpolate, refined, target) for shape in shapes
        )
        return map_shapes(match_shape, arguments, n_jobs=self.n_jobs, verbose=0, prefer="threads")

    def _point_maps(self, shapes: Sequence[ProbedShape], **how: Any) -> list[IntArray]:
        """Return point-to-point maps between the given meshes."""
        matcher = changed(self.matcher_, **how)
        target = given_reference(matcher.reference, shapes)
        arguments = ((matcher, shape, target) for shape in shapes)
        return map_shapes(point_map, arguments, n_jobs=self.n_jobs, verbose=0, prefer="threads")

    def _tell(self, message: str) -> None:
        if self.verbose:
            tell(f"[{type(self).__name__}] {message}")

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a saved state, including those of earlier releases."""
        super().__setstate__(upgraded(state))

    def __sklearn_is_fitted__(self) -> bool:
        """Return whether `fit` has finished."""
        return hasattr(self, "matcher_")

    def __sklearn_tags__(self) -> Tags:
        """Return tags that declare that samples are not table rows, and that y is required."""
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = False
        tags.target_tags.required = True
        return tags
