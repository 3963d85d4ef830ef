"""Matching of partial scans to the whole reference, around a pipeline for whole shapes."""

import warnings
from collections.abc import Iterable, Sequence
from typing import Any, Literal, Self

import numpy as np
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline
from sklearn.utils import Tags, get_tags
from sklearn.utils.validation import check_is_fitted

from skfmap._measures import PairErrors, mean_over_shapes
from skfmap._tools.parallel import map_shapes, tell
from skfmap._tools.types import DistanceMethod, FloatArray, Interpolation, RefineOverride
from skfmap._tools.unwrap import learner_and_shapes
from skfmap._tools.validation import check_choice, check_number, check_sample_weight
from skfmap._version import Versioned
from skfmap.io import MeshLike, check_meshes, named
from skfmap.learner import models
from skfmap.learner.between import check_wanted
from skfmap.learner.given_answers import given_reference
from skfmap.learner.new_shape import INTERPOLATIONS
from skfmap.learner.parameters import changed
from skfmap.partial.answers import (
    Knowledge,
    Part,
    all_covered,
    arrays_of,
    matched_part,
    nothing_said,
    with_meshes,
)
from skfmap.partial.between import (
    OnReference,
    between_parts,
    no_pair,
    part_on_reference,
    whole_on_reference,
)
from skfmap.partial.cuts import Cut, make_cuts
from skfmap.partial.glue import (
    better_of,
    tears_of_wholes,
    warn_of_tears,
    with_tears,
)
from skfmap.partial.kinds import TrainingSizes, kinds_of, only, rows_of
from skfmap.partial.laid_out import (
    landmarks_on_part,
    no_landmarks,
    not_registered,
    registered_on_part,
)
from skfmap.partial.laid_parts import WaysToLay, laid_part
from skfmap.partial.learning import learned_from
from skfmap.partial.parameters import check_estimator, learner_of
from skfmap.partial.scoring import (
    PartScorer,
    ScoredErrors,
    as_correspondence,
    parts_to_score,
)
from skfmap.partial.warned import warn_of_few, warn_of_parts
from skfmap.refinement import Refinement
from skfmap.shapes import Correspondence, Landmarks, Match, Registered
from skfmap.shapes.usable import Answer

__all__ = ["PartialMatcher"]


class PartialMatcher(Versioned, BaseEstimator):
    """Match scans that show only part of a shape, and find which part of the reference they cover.

    The training shapes are cut in the way that scans are incomplete, which gives parts with known
    correspondences. For a new part, local features give each point probabilities of the regions
    of the reference, and the distances between points make these probabilities consistent. The
    reference, deformed as training shapes deform, is then laid onto the part. Whole shapes are
    distinguished from parts, and are matched by the pipeline as they would be without this class.

    Parameters
    ----------
    estimator : Pipeline
        Pipeline from meshes to matches: `SpectralBasis`, `DescriptorTransformer`,
        `WeightedFunctionalMapLearner`.
    cuts : {"auto", "planes", "limbs", "views", "discs"}, Cut or list, default="auto"
        How training shapes are cut: by name, or by objects derived from `skfmap.partial.Cut`.
        ``"auto"`` uses all four kinds.
    n_cuts : int, default=12
        Number of parts that are cut from each training shape to learn from. The whole shape is
        used in addition.
    n_calibrated : int, default=2
        How many of these parts are matched by a model that was learned without the shape. They
        calibrate the expected errors and the probabilities of being covered.
    scale : {"known", "estimated"}, default="known"
        ``"known"``: scans are in the units of the training shapes. ``"estimated"``: scans may be
        in any units; the scale of a part is estimated together with its map, and is returned as
        ``Match.scale``.
    random_state : int, default=0
        Seed of the random cuts.
    n_jobs : int, optional
        Number of shapes processed in parallel; see joblib. The result is the same for every value.
    verbose : int, default=0
        1 reports each stage.

    Attributes
    ----------
    estimator_ : Pipeline
        The pipeline, fitted on the whole training shapes.
    body_ : Body
        The reference, its deformation model, and the model that recognises its regions.
    trust_ : PartTrust
        Calibration of errors and coverage, learned from parts of held-out training shapes.
    unit_ : float
        Square root of the area of the reference, in the units of the meshes.
    areas_, rims_ : ndarray of shape (n_shapes,)
        Area and rim length of each training shape, in units of the reference.
    usual_score_ : float
        Median score of parts of held-out training shapes: how consistent the regions are that are
        recognised on them. Scans below it are checked for faces that are wound inwards.

    See Also
    --------
    skfmap.match : Accepts this model like any other.

    Notes
    -----
    Scans may be rotated and translated in any way. Faces that are wound inwards are detected and
    reversed. A mirrored scan can only be detected for kinds of shapes that differ from their
    mirror images, such as jaws of one side: the mirror image of a scan of a cat is a scan of a cat.

    Examples
    --------
    >>> from sklearn.pipeline import make_pipeline
    >>> import skfmap
    >>> skfmap.PartialMatcher(make_pipeline(skfmap.SpectralBasis()), cuts="planes", n_cuts=4)
    PartialMatcher(cuts='planes',
                   estimator=Pipeline(steps=[('spectralbasis', SpectralBasis())]),
                   n_cuts=4)
    """

    def __init__(
        self,
        estimator: Pipeline,
        cuts: str | Cut | Sequence[str | Cut] = "auto",
        *,
        n_cuts: int = 12,
        n_calibrated: int = 2,
        scale: Literal["known", "estimated"] = "known",
        random_state: int = 0,
        n_jobs: int | None = None,
        verbose: int = 0,
    ) -> None:
        self.estimator = estimator
        self.cuts = cuts
        self.n_cuts = n_cuts
        self.n_calibrated = n_calibrated
        self.scale = scale
        self.random_state = random_state
        self.n_jobs = n_jobs
        self.verbose = verbose

    def fit(
        self,
        X: Sequence[MeshLike],
        y: Sequence[Answer],
        sample_weight: Sequence[float] | None = None,
    ) -> Self:
        """Fit the pipeline to whole shapes, and learn from parts cut from them.

        Parameters
        ----------
        X : sequence of meshes
            Whole training shapes, the reference among them.
        y : sequence of Correspondence or of int arrays of shape (n_pairs, 2)
            Correspondence of each shape with the template, as for the learner.
        sample_weight : array-like of shape (n_shapes,), optional
            As in `WeightedFunctionalMapLearner.fit`. Shapes with weight 0 are not cut, except
            the reference.

        Returns
        -------
        PartialMatcher
            The fitted matcher.

        Raises
        ------
        TypeError
            If ``estimator`` is not a pipeline from meshes to a learner.
        ValueError
            If a parameter is invalid, or there are fewer than three shapes.

        Warns
        -----
        StabilityWarning
            If there are only three shapes.
        """
        cuts = self._check_parameters()
        pipeline = clone(self.estimator)
        self._tell("fitting the pipeline to whole shapes")
        shapes = pipeline[:-1].fit_transform(X, y)
        pipeline[-1].fit(shapes, y, sample_weight)
        learner = learner_of(pipeline)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the learner has already warned
            training = learner._training_set(shapes, y, sample_weight)
        if len(training.used) < 2:
            raise ValueError(
                "PartialMatcher leaves training shapes out in turn, and needs the reference and "
                f"two more shapes at least; got {len(training.used)} more. Give more shapes, or "
                "fit the pipeline by itself if all scans are whole."
            )
        warn_of_few(len(training.used))
        learned = learned_from(
            training,
            learner,
            cuts,
            n_cuts=self.n_cuts,
            n_calibrated=self.n_calibrated,
            random_state=self.random_state,
            n_jobs=self.n_jobs,
            tell=self._tell,
        )
        self.estimator_, self.body_, self.trust_ = pipeline, learned.body, learned.trust
        self.unit_, self.areas_, self.rims_ = learned.unit, learned.areas, learned.rims
        self.usual_score_ = learned.usual_score
        return self

    def match(
        self,
        X: Sequence[MeshLike],
        *,
        refine: RefineOverride | Refinement | None = "fitted",
        interpolate: Interpolation = None,
    ) -> list[Match]:
        """Match scans of parts or of whole shapes to the reference.

        Parameters
        ----------
        X : sequence of meshes
            Scans, in the units of the training shapes.
        refine, interpolate : optional
            As in `WeightedFunctionalMapLearner.match`; they apply to whole shapes. Points of parts
            are always matched to places between vertices.

        Returns
        -------
        list of Match
            Matches with ``covered`` and ``covered_probability``. ``p2p`` is -1 at vertices of a
            scan that belong to nothing, and ``inverse`` is -1 where the reference is not covered.
            A part has no functional map; its entries are NaN. ``torn`` marks vertices whose
            neighbours are matched far apart. A whole shape that has such vertices is matched as a
            part instead, if it tears less then.

        Warns
        -----
        SkippedShapeWarning
            If a part is too small to be matched, below 15 % of the area of the training shapes, or
            its units seem to differ from theirs.
        UnfamiliarShapeWarning
            If the reference fits a scan worse than it fits parts of training shapes, or the map
            tears (``Match.torn``).
        """
        check_is_fitted(self)
        items = check_meshes(X)
        check_choice(interpolate, "interpolate", INTERPOLATIONS)
        changed(learner_of(self.estimator_).matcher_, refine=refine)  # raises also without wholes
        kinds = self._kinds(items)
        found: dict[int, Match] = {}
        if "whole" in kinds:
            answers = models.match(
                self.estimator_,
                only(items, kinds, "whole"),
                refine=refine,
                interpolate=interpolate,
            )
            rows = rows_of(kinds, "whole")
            found.update(self._mended(items, {i: all_covered(answers[i]) for i in rows})[0])
        parts = self._laid(items, rows_of(kinds, "part"))
        found.update(self._matched(items, parts))
        for i in range(len(items)):
            if i not in found:
                found[i] = self._nothing(items[i], i)
        warn_of_parts(items, kinds, parts, self.trust_)
        warn_of_tears(found)
        return [found[i] for i in range(len(items))]

    def match_between(
        self, X: Sequence[MeshLike], pairs: Iterable[tuple[int, int]] | None = None
    ) -> list[Match]:
        """Match scans to one another; pairs that include a part go through the reference.

        Parameters
        ----------
        X : sequence of meshes
            Scans, in the units of the training shapes.
        pairs : iterable of (int, int), optional
            Indices (i, j) into ``X``, for a map from ``X[i]`` to ``X[j]``. By default all pairs of
            different scans, in both directions.

        Returns
        -------
        list of Match
            One match for each pair, from ``X[i]`` to ``X[j]``, which is its reference. ``p2p``
            maps vertices of ``X[i]`` to vertices of ``X[j]``, and is -1 at vertices that ``X[j]``
            does not show. ``covered`` and ``covered_probability`` say which vertices of ``X[j]``
            are shown by ``X[i]``, and ``inverse`` where on ``X[i]`` they lie, -1 elsewhere. Pairs
            of whole shapes are matched by the pipeline, without a check for tears. Other pairs have
            no functional map; its entries are NaN. Their ``torn`` is that of the match of ``X[i]``
            to the reference of the model. ``expected_error`` combines the errors of both matches to
            the reference, in units of sqrt(area) of the *reference of the model*; it is None if one
            of the two is whole and the pipeline does not calibrate errors.

        Raises
        ------
        TypeError, ValueError
            If ``pairs`` does not hold pairs of indices into ``X``.

        Warns
        -----
        SkippedShapeWarning, UnfamiliarShapeWarning
            As in `match`, once for each scan.
        """
        check_is_fitted(self)
        items = check_meshes(X)
        wanted = check_wanted(pairs, len(items))
        kinds = self._kinds(items)
        whole = [pair for pair in wanted if all(kinds[i] == "whole" for i in pair)]
        done: dict[tuple[int, int], Match] = {}
        if whole:
            among = only(items, kinds, "whole")
            answers = models.match_between(self.estimator_, among, whole)
            done.update(zip(whole, map(all_covered, answers), strict=True))
        mixed = [pair for pair in wanted if pair not in done]
        matches, on_reference = self._on_reference(
            items, kinds, {i for pair in mixed for i in pair}, {i for pair in whole for i in pair}
        )
        learner = learner_of(self.estimator_)
        for i, j in mixed:
            if i in on_reference and j in on_reference:
                done[i, j] = between_parts(on_reference[i], on_reference[j])
            else:
                done[i, j] = no_pair(learner, matches[i], matches[j])
        return [done[pair] for pair in wanted]

    def register(self, X: Sequence[MeshLike]) -> list[Registered]:
        """Lay the mesh of the reference onto each scan.

        Parameters
        ----------
        X : sequence of meshes
            Scans, in the units of the training shapes.

        Returns
        -------
        list of Registered
            The complete given mesh of the reference, in the position and units of each scan. Where
            the scan is missing, the mesh follows the deformation of training shapes. For a part,
            ``off`` is a fraction of the covered area, ``stretched`` is unknown (NaN), and ``fits``
            says whether the part is familiar. `match` returns what is covered.

        Raises
        ------
        ValueError
            If a scan is whole, and the learner of the pipeline was not fitted with
            ``refine="register"``.

        Warns
        -----
        SkippedShapeWarning, UnfamiliarShapeWarning
            As in `match`.
        """
        check_is_fitted(self)
        items = check_meshes(X)
        kinds = self._kinds(items)
        found: dict[int, Registered] = {}
        if "whole" in kinds:
            answers = models.register(self.estimator_, only(items, kinds, "whole"))
            found.update((i, answers[i]) for i in rows_of(kinds, "whole"))
        parts, known = self._laid(items, rows_of(kinds, "part")), self._knowledge()
        for i, part in parts.items():
            found[i] = registered_on_part(known, part, named(items[i], i))
        warn_of_parts(items, kinds, parts, self.trust_)
        return [
            found[i] if i in found else not_registered(known, named(item, i))
            for i, item in enumerate(items)
        ]

    def predict_landmarks(
        self, X: Sequence[MeshLike], *, coverage: float = 0.9, on_surface: bool = False
    ) -> list[Landmarks]:
        """Place the landmarks of the training shapes on scans that show them.

        Parameters
        ----------
        X : sequence of meshes
            Scans, in the units of the training shapes.
        coverage, on_surface : float, bool
            As in `WeightedFunctionalMapLearner.predict_landmarks`; ``coverage`` applies to whole
            shapes.

        Returns
        -------
        list of Landmarks
            Landmarks in the units and position of each mesh. Landmarks that a part does not show
            are NaN. For the others, ``expected_error`` is the larger one of the error of the match
            and that of landmarks on whole shapes. Parts have no radii.

        Raises
        ------
        ValueError
            If the learner was fitted without measured points, or ``coverage`` is not between 0 and
            1.

        Warns
        -----
        SkippedShapeWarning, UnfamiliarShapeWarning
            As in `match`.
        """
        check_is_fitted(self)
        items = check_meshes(X)
        kinds = self._kinds(items)
        # Called even if no shape is whole, since it checks the arguments.
        found = models.predict_landmarks(
            self.estimator_,
            only(items, kinds, "whole"),
            coverage=coverage,
            on_surface=on_surface,
        )
        parts, known = self._laid(items, rows_of(kinds, "part")), self._knowledge()
        for i, kind in enumerate(kinds):
            name = named(items[i], i)
            if i in parts:
                found[i] = landmarks_on_part(known, parts[i], name, on_surface=on_surface)
            elif kind != "whole":
                found[i] = no_landmarks(known, name)
        warn_of_parts(items, kinds, parts, self.trust_)
        return found

    def functional_maps(self, X: Sequence[MeshLike]) -> FloatArray:
        """Return the full maps X_i(D) of whole shapes, computed by the pipeline.

        Parameters
        ----------
        X : sequence of meshes
            Whole shapes.

        Returns
        -------
        maps : ndarray of shape (n_shapes, k, k)
            From functions on the reference to functions on each shape.
        """
        check_is_fitted(self)
        return models.functional_maps(self.estimator_, X)

    def predict(self, X: Sequence[MeshLike]) -> FloatArray:
        """Return the reduced maps X_i(D) Y_p of whole shapes, computed by the pipeline.

        Parameters
        ----------
        X : sequence of meshes
            Whole shapes.

        Returns
        -------
        reduced : ndarray of shape (n_shapes, k, p)
            Images on each shape of the p most stable functions of the reference.
        """
        check_is_fitted(self)
        return np.asarray(self.estimator_.predict(X))

    def pair_errors(
        self,
        X: Sequence[MeshLike],
        y: Sequence[Answer],
        *,
        method: DistanceMethod = "heat",
        reference_y: Answer | None = None,
    ) -> list[PairErrors]:
        """Match scans with known correspondences, and return the error at each pair.

        Parameters
        ----------
        X, y : sequence of meshes, sequence of correspondences
            Parts or whole shapes, which are not cut, and their correspondences with the template.
        method : {"heat", "exact", "dijkstra"}, default="heat"
            How distances on the reference are computed; see `skfmap.metrics.GeodesicDistances`.
        reference_y : Correspondence or int array, optional
            As in `WeightedFunctionalMapLearner.pair_errors`.

        Returns
        -------
        list of PairErrors
            Errors in units of sqrt(area) of the reference. An unmatched point of a part has the
            error of a random match. A scan that was skipped has no pairs.
        """
        check_is_fitted(self)
        items, truths = self._checked_pairs(X, y)
        kinds = self._kinds(items)
        found: dict[int, PairErrors] = {}
        if "whole" in kinds:
            wholes = only(items, kinds, "whole")
            how: dict[str, Any] = {"method": method, "reference_y": reference_y}
            learner, shapes = learner_and_shapes(self.estimator_, wholes)
            errors = learner.pair_errors(shapes, y, **how)
            found.update((i, errors[i]) for i in rows_of(kinds, "whole"))
        parts = self._laid(items, rows_of(kinds, "part"))
        matches = self._matched(items, parts)
        warn_of_parts(items, kinds, parts, self.trust_)
        scorer = PartScorer(learner_of(self.estimator_), method, reference_y)
        for i, truth in enumerate(truths):
            if i not in found:
                found[i] = scorer.errors(matches.get(i), truth)
        return [found[i] for i in range(len(items))]

    def errors_to_score(
        self,
        X: Sequence[MeshLike],
        y: Sequence[Answer],
        *,
        method: DistanceMethod = "heat",
        reference_y: Answer | None = None,
    ) -> list[ScoredErrors]:
        """Return the errors that `score` and the scorers of `skfmap.metrics` average.

        Parameters
        ----------
        X, y, method, reference_y : optional
            As in `pair_errors`.

        Returns
        -------
        list of ScoredErrors
            Errors of each scan. For a whole shape they include one part for each of the cuts,
            drawn from ``random_state`` and the content of the shape. ``mean(kind)`` gives the
            whole shape the same weight as all of its parts together.
        """
        errors = self.pair_errors(X, y, method=method, reference_y=reference_y)
        items, truths = self._checked_pairs(X, y)
        cuts, parts, owners = make_cuts(self.cuts), [], []
        for i in rows_of(self._kinds(items), "whole"):
            if not errors[i].weights.any():
                continue
            given = arrays_of(items[i], i)
            parts += parts_to_score(*given, truths[i], cuts, self.random_state)
            owners += [i] * len(cuts)
        own: dict[int, list[PairErrors]] = {i: [] for i in range(len(items))}
        if parts:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the user has not given these parts
                how: dict[str, Any] = {"method": method, "reference_y": reference_y}
                meshes, known = zip(*parts, strict=True)
                of_parts = self.pair_errors(meshes, known, **how)
            for i, one in zip(owners, of_parts, strict=True):
                own[i].append(one)
        return [ScoredErrors(one, own[i]) for i, one in enumerate(errors)]

    def score(
        self,
        X: Sequence[MeshLike],
        y: Sequence[Answer],
        sample_weight: Sequence[float] | None = None,
        reference_y: Answer | None = None,
    ) -> float:
        """Return minus the mean geodesic error on whole shapes and on their parts.

        Higher is better. From each whole shape, one part is cut by each of ``cuts`` and matched
        too; the mean error of these parts has the same weight as that of the whole shape. A scan
        that is already a part is not cut.

        Parameters
        ----------
        X, y : sequence of meshes, sequence of correspondences
            Held-out scans, whole or partial, and their correspondences with the template.
        sample_weight : array-like of shape (n_shapes,), optional
            Weight of each shape, together with its parts.
        reference_y : Correspondence or int array, optional
            As in `pair_errors`.

        Returns
        -------
        float
            Minus the mean error, in units of sqrt(area) of the reference. A symmetric match counts
            as wrong. Unmatched points of a part have the error of a random match. The predicted
            coverage does not enter the score.
        """
        means = [one.mean() for one in self.errors_to_score(X, y, reference_y=reference_y)]
        return -mean_over_shapes(means, check_sample_weight(sample_weight, len(means)))

    def _checked_pairs(
        self, X: Sequence[MeshLike], y: Sequence[Answer]
    ) -> tuple[list[MeshLike], list[Correspondence]]:
        check_is_fitted(self)
        items = check_meshes(X)
        if len(items) != len(y):
            raise ValueError(
                f"X has {len(items)} shapes, but y has {len(y)} correspondences; give one for each."
            )
        return items, [as_correspondence(one) for one in y]

    def _check_parameters(self) -> list[Cut]:
        check_estimator(self.estimator)
        check_number(self.n_cuts, "n_cuts", low=1, integer=True)
        check_number(self.n_calibrated, "n_calibrated", low=1, high=self.n_cuts, integer=True)
        check_choice(self.scale, "scale", ("known", "estimated"))
        check_number(self.random_state, "random_state", low=0, integer=True)
        return make_cuts(self.cuts)

    def _kinds(self, items: Sequence[MeshLike]) -> list[str]:
        """Return "whole" or "part" for each mesh, or why it cannot be matched."""
        sizes = TrainingSizes(self.unit_, self.areas_, self.rims_)
        return kinds_of(items, sizes, any_units=self.scale == "estimated")

    def _knowledge(self) -> Knowledge:
        learner = learner_of(self.estimator_)
        target = given_reference(learner.reference_)
        if not target.is_working:
            # Points of scans are matched between the vertices of the given reference. Its search
            # tree is built here, before several threads use it.
            target.places(np.zeros((1, 3)), np.array([[0.0, 0, 1]]))
        return Knowledge(learner, target, self.body_, self.trust_)

    def _laid(self, items: Sequence[MeshLike], rows: Sequence[int]) -> dict[int, Part]:
        """Return the reference laid onto some of the meshes, by index."""
        learned = WaysToLay(
            self.body_,
            self.trust_,
            self.usual_score_,
            self.unit_,
            self.areas_,
            estimates_scale=self.scale == "estimated",
            max_vertices=self.estimator_[0].max_vertices,
        )
        laid = map_shapes(
            laid_part,
            ((learned, *arrays_of(items[i], i)) for i in rows),
            n_jobs=self.n_jobs,
            verbose=self.verbose,
            prefer="threads",
        )
        return dict(zip(rows, laid, strict=True))

    def _matched(self, items: Sequence[MeshLike], parts: dict[int, Part]) -> dict[int, Match]:
        """Return the matches of parts that the reference was laid onto, by index."""
        known, found = self._knowledge(), {}
        for i, part in parts.items():
            match = matched_part(known, part, named(items[i], i))
            match = with_tears(known, part.vertices, part.faces, 1.0, match)
            found[i] = with_meshes(match, items[i], i, known.learner.reference_.spectral)
        return found

    def _mended(
        self, items: Sequence[MeshLike], found: dict[int, Match]
    ) -> tuple[dict[int, Match], dict[int, Part]]:
        """Return matches of whole shapes, and the parts as which those that tear were matched."""
        known = self._knowledge()
        told, torn = tears_of_wholes(known, items, found)
        parts = self._laid(items, torn)
        better = better_of(known, told, self._matched(items, parts), parts)
        return told | better, {i: parts[i] for i in better}

    def _on_reference(
        self, items: Sequence[MeshLike], kinds: Sequence[str], wanted: set[int], told: set[int]
    ) -> tuple[dict[int, Match], dict[int, OnReference]]:
        """Return matches to the reference, and what pairs need of those that are not empty.

        Only the ``wanted`` meshes are matched. There are no warnings about whole shapes in
        ``told``, for which they were given before.
        """
        kinds = [kind if i in wanted else "" for i, kind in enumerate(kinds)]
        matches: dict[int, Match] = {}
        on_reference: dict[int, OnReference] = {}
        for i in sorted(wanted):
            if kinds[i] not in ("whole", "part"):
                matches[i] = self._nothing(items[i], i)
        parts = self._laid(items, rows_of(kinds, "part"))
        known = self._knowledge()
        wholes, mended = self._mended(items, self._whole_on_places(items, kinds, told))
        matches |= self._matched(items, parts) | wholes
        for i, part in (parts | mended).items():
            on_reference[i] = part_on_reference(known, part, matches[i])
        for i, match in wholes.items():
            if i not in mended and (match.p2p >= 0).any():
                vertices, faces = arrays_of(items[i], i)
                on_reference[i] = whole_on_reference(vertices, faces, match)
        warn_of_parts(items, kinds, parts, self.trust_)
        warn_of_tears(matches)
        return matches, on_reference

    def _whole_on_places(
        self, items: Sequence[MeshLike], kinds: Sequence[str], told: set[int]
    ) -> dict[int, Match]:
        """Return matches of whole shapes to places between vertices of the reference."""
        found: dict[int, Match] = {}
        for silent in (False, True):
            now = [kind if (i in told) == silent else "" for i, kind in enumerate(kinds)]
            rows = rows_of(now, "whole")
            if not rows:
                continue
            with warnings.catch_warnings():
                if silent:
                    warnings.simplefilter("ignore")
                matches = models.match(
                    self.estimator_, only(items, now, "whole"), interpolate="barycentric"
                )
            found.update((i, all_covered(matches[i])) for i in rows)
        return found

    def _nothing(self, item: MeshLike, i: int) -> Match:
        learner = learner_of(self.estimator_)
        nothing = nothing_said(learner, item, i)
        return with_meshes(nothing, item, i, learner.reference_.spectral)

    def _tell(self, message: str) -> None:
        if self.verbose:
            tell(f"[{type(self).__name__}] {message}")

    def __sklearn_tags__(self) -> Tags:
        """Return the tags of the pipeline."""
        return get_tags(self.estimator)
