"""Parts of shapes, matched to the whole reference by any pipeline that matches whole ones."""

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
from skfmap.basis import SpectralBasis
from skfmap.exceptions import MeshError
from skfmap.io import MeshLike, check_meshes, n_vertices_of, named
from skfmap.learner import BridgedLearner, WeightedFunctionalMapLearner, models
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
from skfmap.partial.kinds import TrainingSizes
from skfmap.partial.laid_out import (
    landmarks_on_part,
    no_landmarks,
    not_registered,
    registered_on_part,
)
from skfmap.partial.learning import learned_from
from skfmap.partial.scale import scale_of
from skfmap.partial.scan import scan_of
from skfmap.partial.scoring import (
    PartScorer,
    ScoredErrors,
    as_correspondence,
    parts_to_score,
)
from skfmap.partial.warned import warn_of_few, warn_of_sides, warn_of_size, warn_of_strange
from skfmap.refinement import Refinement
from skfmap.shapes import Correspondence, Landmarks, Match, Registered
from skfmap.shapes.skipped_shape import SetAside
from skfmap.shapes.usable import Answer

__all__ = ["PartialMatcher"]


class PartialMatcher(Versioned, BaseEstimator):
    """Match scans that show a part of a shape, and say which part of the reference they cover.

    Training shapes are cut as scans would show them, which gives parts whose truth is known. A new
    part is recognised point by point from its surroundings; what points believe is made consistent
    by their distances; and the reference, deformed as training shapes deform, is laid onto the
    part. Whole shapes are told from parts, and answered by the pipeline as they are without this.

    Parameters
    ----------
    estimator : Pipeline
        From meshes to matches: `SpectralBasis`, `DescriptorTransformer`,
        `WeightedFunctionalMapLearner`.
    cuts : {"auto", "planes", "limbs", "views", "discs"}, Cut or list, default="auto"
        How training shapes are cut: words, or objects of `skfmap.partial`, yours among them.
        ``"auto"`` is all of the four.
    n_cuts : int, default=12
        Parts that are cut of each training shape to learn from. The whole shape is one more.
    n_calibrated : int, default=2
        How many of them are matched by what was learned without the shape, which says how large
        errors are to be expected, and what is covered.
    scale : {"known", "estimated"}, default="known"
        Whether scans are in the units of the training shapes. ``"estimated"``: they may be in any
        units, and the scale of a part is estimated with its map, as ``Match.scale``.
    random_state : int, default=0
        What cuts are drawn by.
    n_jobs : int, optional
        Shapes at a time; see joblib. The result is the same for every value.
    verbose : int, default=0
        1 tells each stage.

    Attributes
    ----------
    estimator_ : Pipeline
        The pipeline, fitted on the whole training shapes.
    body_ : Body
        The reference, how it deforms, and what its surroundings look like.
    trust_ : PartTrust
        What parts of training shapes that were left out showed.
    unit_ : float
        Root of the area of the reference, in the units of the meshes.
    areas_, rims_ : ndarray of shape (n_shapes,)
        Of the training shapes: area and length of the rim, in units of the reference.
    sides_ : Sides
        What is known of left and right, and of inside and outside.

    See Also
    --------
    skfmap.match : Takes this model as any other.

    Notes
    -----
    Coordinates may be turned and shifted in any way. Faces that are wound inwards are told, and
    turned. A mirror image is told of kinds alone that are unlike their own, as jaws of one side
    are: that of a scan of a cat is a scan of a cat.

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
        """Fit the pipeline to whole shapes, and learn from parts of them.

        Parameters
        ----------
        X : sequence of meshes
            Whole training shapes, the reference among them.
        y : sequence of Correspondence or of int arrays of shape (n_pairs, 2)
            Where each lies on the template, as for the learner.
        sample_weight : array-like of shape (n_shapes,), optional
            As in `WeightedFunctionalMapLearner.fit`; shapes of weight 0 are not
            cut, but the reference always is.

        Returns
        -------
        PartialMatcher
            Itself.

        Raises
        ------
        TypeError
            If ``estimator`` is no pipeline from meshes to a learner.
        ValueError
            If a parameter cannot be used, or there are fewer than three shapes.

        Warns
        -----
        StabilityWarning
            If there are but three.
        """
        cuts = self._check_parameters()
        pipeline = clone(self.estimator)
        self._tell("fitting the pipeline to whole shapes")
        shapes = pipeline[:-1].fit_transform(X, y)
        pipeline[-1].fit(shapes, y, sample_weight)
        learner = _learner_of(pipeline)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the learner has told it
            training = learner._training_set(shapes, y, sample_weight)
        if len(training.used) < 2:
            raise ValueError(
                "PartialMatcher leaves training shapes out in turn, and needs the reference and "
                f"two more at least; got {len(training.used)} more. Give more shapes; for whole "
                "shapes alone, fit the pipeline by itself."
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
        self.sides_ = learned.sides
        return self

    def match(
        self,
        X: Sequence[MeshLike],
        *,
        refine: RefineOverride | Refinement | None = "fitted",
        interpolate: Interpolation = None,
    ) -> list[Match]:
        """Match scans, of parts or of whole shapes, to the reference.

        Parameters
        ----------
        X : sequence of meshes
            In the units of the training shapes.
        refine, interpolate : optional
            For whole shapes; as in `WeightedFunctionalMapLearner.match`. Places of parts are always
            between vertices.

        Returns
        -------
        list of Match
            With ``covered`` and ``covered_probability``. Vertices of a scan that belong to nothing
            have -1, and so has ``inverse`` where nothing of the reference is covered. A part has no
            functional map; its entries are NaN. ``torn`` marks where neighbours land far apart; a
            whole shape on which they do is matched as a part, if it tears less then.

        Warns
        -----
        SkippedShapeWarning
            If a part is too small to say where it belongs, below 15 % of the area of the training
            shapes, or units differ from theirs.
        UnfamiliarShapeWarning
            If a scan does not lie on the reference as parts of training shapes do, or its map
            tears (``Match.torn``).
        """
        check_is_fitted(self)
        items = check_meshes(X)
        check_choice(interpolate, "interpolate", INTERPOLATIONS)
        changed(_learner_of(self.estimator_).matcher_, refine=refine)  # raises also without wholes
        kinds = self._kinds(items)
        found: dict[int, Match] = {}
        if "whole" in kinds:
            answers = models.match(
                self.estimator_,
                _only(items, kinds, "whole"),
                refine=refine,
                interpolate=interpolate,
            )
            rows = _rows(kinds, "whole")
            found.update(self._mended(items, {i: all_covered(answers[i]) for i in rows})[0])
        parts = self._laid(items, _rows(kinds, "part"))
        found.update(self._matched(items, parts))
        for i in range(len(items)):
            if i not in found:
                found[i] = self._nothing(items[i], i)
        self._warn(items, kinds, parts)
        warn_of_tears(found)
        return [found[i] for i in range(len(items))]

    def match_between(
        self, X: Sequence[MeshLike], pairs: Iterable[tuple[int, int]] | None = None
    ) -> list[Match]:
        """Match scans to one another; parts, and parts to whole shapes, through the reference.

        Parameters
        ----------
        X : sequence of meshes
            In the units of the training shapes.
        pairs : iterable of (int, int), optional
            From which scan to which: indices (i, j) into ``X``. All pairs of different scans, in
            both directions, by default.

        Returns
        -------
        list of Match
            One for each pair, from ``X[i]`` to ``X[j]``, which is its reference. ``p2p`` sends
            vertices of ``X[i]`` to vertices of ``X[j]``, and is -1 at those that ``X[j]`` does not
            show; ``covered`` and ``covered_probability`` tell which vertices of ``X[j]`` the scan
            ``X[i]`` shows, and ``inverse`` where these lie on it, -1 elsewhere. Pairs of whole
            shapes are the pipeline's, in which tears are not looked for; others have no functional
            map, and its entries are NaN. Their ``torn`` is that of ``X[i]`` on the reference.
            ``expected_error`` combines those of both ways to the reference, in units of sqrt(area)
            of the *reference of the model*; None if one of the two is whole and the pipeline
            calibrates no errors.

        Raises
        ------
        TypeError, ValueError
            If ``pairs`` does not hold pairs of indices into ``X``.

        Warns
        -----
        SkippedShapeWarning, UnfamiliarShapeWarning
            As in `match`, of each scan once.
        """
        check_is_fitted(self)
        items = check_meshes(X)
        wanted = check_wanted(pairs, len(items))
        kinds = self._kinds(items)
        whole = [pair for pair in wanted if all(kinds[i] == "whole" for i in pair)]
        done: dict[tuple[int, int], Match] = {}
        if whole:
            among = _only(items, kinds, "whole")
            answers = models.match_between(self.estimator_, among, whole)
            done.update(zip(whole, map(all_covered, answers), strict=True))
        mixed = [pair for pair in wanted if pair not in done]
        matches, on_reference = self._on_reference(
            items, kinds, {i for pair in mixed for i in pair}, {i for pair in whole for i in pair}
        )
        learner = _learner_of(self.estimator_)
        for i, j in mixed:
            if i in on_reference and j in on_reference:
                done[i, j] = between_parts(on_reference[i], on_reference[j])
            else:
                done[i, j] = no_pair(learner, matches[i], matches[j])
        return [done[pair] for pair in wanted]

    def register(self, X: Sequence[MeshLike]) -> list[Registered]:
        """Lay the reference's mesh onto each scan.

        Parameters
        ----------
        X : sequence of meshes
            In the units of the training shapes.

        Returns
        -------
        list of Registered
            All of the given mesh of the reference, in the place and the units of each scan; where
            the scan shows nothing of it, it lies as training shapes deform. Of a part, ``off`` is
            a share of what is covered, ``stretched`` is not known and NaN, and ``fits`` tells
            whether the part is familiar; `match` tells what is covered.

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
            answers = models.register(self.estimator_, _only(items, kinds, "whole"))
            found.update((i, answers[i]) for i in _rows(kinds, "whole"))
        parts, known = self._laid(items, _rows(kinds, "part")), self._knowledge()
        for i, part in parts.items():
            found[i] = registered_on_part(known, part, named(items[i], i))
        self._warn(items, kinds, parts)
        return [
            found[i] if i in found else not_registered(known, named(item, i))
            for i, item in enumerate(items)
        ]

    def predict_landmarks(
        self, X: Sequence[MeshLike], *, coverage: float = 0.9, on_surface: bool = False
    ) -> list[Landmarks]:
        """Place the landmarks of the training shapes on scans, where these show them.

        Parameters
        ----------
        X : sequence of meshes
            In the units of the training shapes.
        coverage, on_surface : float, bool
            As in `WeightedFunctionalMapLearner.predict_landmarks`; ``coverage`` for whole shapes.

        Returns
        -------
        list of Landmarks
            In the units and the place of each mesh. Landmarks that a part does not show are NaN. Of
            the others, ``expected_error`` is that of its match, or that of landmarks on whole
            shapes if it is larger; there are no radii.

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
        # Also without whole ones: it checks what is asked.
        found = models.predict_landmarks(
            self.estimator_,
            _only(items, kinds, "whole"),
            coverage=coverage,
            on_surface=on_surface,
        )
        parts, known = self._laid(items, _rows(kinds, "part")), self._knowledge()
        for i, kind in enumerate(kinds):
            name = named(items[i], i)
            if i in parts:
                found[i] = landmarks_on_part(known, parts[i], name, on_surface=on_surface)
            elif kind != "whole":
                found[i] = no_landmarks(known, name)
        self._warn(items, kinds, parts)
        return found

    def functional_maps(self, X: Sequence[MeshLike]) -> FloatArray:
        """Return the full maps X_i(D) of whole shapes, by the pipeline.

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
        """Return the reduced maps X_i(D) Y_p of whole shapes, by the pipeline.

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
        """Match scans of known correspondence, as they are, and return the error at each pair.

        Parameters
        ----------
        X, y : sequence of meshes, sequence of correspondences
            Parts or whole shapes, and where they lie on the template.
        method : {"heat", "exact", "dijkstra"}, default="heat"
            How distances on the reference are measured; see `skfmap.metrics.GeodesicDistances`.
        reference_y : Correspondence or int array, optional
            As in `WeightedFunctionalMapLearner.pair_errors`.

        Returns
        -------
        list of PairErrors
            In units of sqrt(area) of the reference. A point of a part without an answer counts as
            one that is answered at random; a scan that was left out has no pairs.
        """
        check_is_fitted(self)
        items, truths = self._checked_pairs(X, y)
        kinds = self._kinds(items)
        found: dict[int, PairErrors] = {}
        if "whole" in kinds:
            wholes = _only(items, kinds, "whole")
            how: dict[str, Any] = {"method": method, "reference_y": reference_y}
            learner, shapes = learner_and_shapes(self.estimator_, wholes)
            errors = learner.pair_errors(shapes, y, **how)
            found.update((i, errors[i]) for i in _rows(kinds, "whole"))
        parts = self._laid(items, _rows(kinds, "part"))
        matches = self._matched(items, parts)
        self._warn(items, kinds, parts)
        scorer = PartScorer(_learner_of(self.estimator_), method, reference_y)
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
        """Return the errors that `score` and the scorers of `skfmap.metrics` count.

        Parameters
        ----------
        X, y, method, reference_y : optional
            As in `pair_errors`.

        Returns
        -------
        list of ScoredErrors
            Of each scan. Of a whole shape also on one part by each of the cuts, which are drawn by
            ``random_state`` and by the shape; ``mean(kind)`` counts the whole shape as much as its
            parts.
        """
        errors = self.pair_errors(X, y, method=method, reference_y=reference_y)
        items, truths = self._checked_pairs(X, y)
        cuts, parts, owners = make_cuts(self.cuts), [], []
        for i in _rows(self._kinds(items), "whole"):
            if not errors[i].weights.any():
                continue
            given = arrays_of(items[i], i)
            parts += parts_to_score(*given, truths[i], cuts, self.random_state)
            owners += [i] * len(cuts)
        own: dict[int, list[PairErrors]] = {i: [] for i in range(len(items))}
        if parts:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # nobody has given these parts
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

        Higher is better. Of each whole shape one part by each of ``cuts`` is matched too, and the
        mean of its parts counts as much as the whole shape. A scan that is a part counts as it is.

        Parameters
        ----------
        X, y : sequence of meshes, sequence of correspondences
            Held-out shapes, whole or in part, and where they lie on the template.
        sample_weight : array-like of shape (n_shapes,), optional
            How much each shape counts, with its parts.
        reference_y : Correspondence or int array, optional
            As in `pair_errors`.

        Returns
        -------
        float
            In units of sqrt(area) of the reference; a symmetric answer counts as wrong. Points
            of a part without an answer count as answered at random. What is said to be covered does
            not count.
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
        if not isinstance(self.estimator, Pipeline) or len(self.estimator) < 2:
            raise TypeError(
                "estimator must be a Pipeline from meshes to a learner, make_pipeline("
                "SpectralBasis(), DescriptorTransformer(), WeightedFunctionalMapLearner()); got "
                f"{type(self.estimator).__name__}."
            )
        if not isinstance(self.estimator[-1], (WeightedFunctionalMapLearner, BridgedLearner)):
            raise TypeError(
                "the last step of estimator must be a WeightedFunctionalMapLearner or a "
                f"BridgedLearner; got {type(self.estimator[-1]).__name__}."
            )
        if not isinstance(self.estimator[0], SpectralBasis):
            raise TypeError(
                "the first step of estimator must be a SpectralBasis, which says how fine scans "
                f"may be; got {type(self.estimator[0]).__name__}."
            )
        check_number(self.n_cuts, "n_cuts", low=1, integer=True)
        check_number(self.n_calibrated, "n_calibrated", low=1, high=self.n_cuts, integer=True)
        check_choice(self.scale, "scale", ("known", "estimated"))
        check_number(self.random_state, "random_state", low=0, integer=True)
        return make_cuts(self.cuts)

    def _kinds(self, items: Sequence[MeshLike]) -> list[str]:
        """Return "whole" or "part" for each mesh, or why nothing can be said of it."""
        sizes = TrainingSizes(self.unit_, self.areas_, self.rims_)
        kinds = []
        for i, item in enumerate(items):
            try:
                kinds.append(sizes.kind(*arrays_of(item, i), any_units=self.scale == "estimated"))
            except (MeshError, OSError):
                kinds.append("whole")  # what is to be done about it is the pipeline's to say
        return kinds

    def _knowledge(self) -> Knowledge:
        learner = _learner_of(self.estimator_)
        target = given_reference(learner.reference_)
        if not target.is_working:
            # Points of scans lie between the vertices of the given reference, which is opened
            # before threads ask for it.
            target.places(np.zeros((1, 3)), np.array([[0.0, 0, 1]]))
        return Knowledge(learner, target, self.body_, self.trust_)

    def _laid(self, items: Sequence[MeshLike], rows: Sequence[int]) -> dict[int, Part]:
        """Return the reference laid onto some of the meshes, by their indices."""
        laid = map_shapes(
            _lay,
            ((self, items[i], i) for i in rows),
            n_jobs=self.n_jobs,
            verbose=self.verbose,
            prefer="threads",
        )
        return dict(zip(rows, laid, strict=True))

    def _matched(self, items: Sequence[MeshLike], parts: dict[int, Part]) -> dict[int, Match]:
        """Return the matches of parts that the reference was laid onto, by their indices."""
        known, found = self._knowledge(), {}
        for i, part in parts.items():
            match = matched_part(known, part, named(items[i], i))
            match = with_tears(known, part.vertices, part.faces, 1.0, match)
            found[i] = with_meshes(match, items[i], i, known.learner.reference_.spectral)
        return found

    def _mended(
        self, items: Sequence[MeshLike], found: dict[int, Match]
    ) -> tuple[dict[int, Match], dict[int, Part]]:
        """Return matches of whole shapes; those that tear less as parts are, with these parts."""
        known = self._knowledge()
        told, torn = tears_of_wholes(known, items, found)
        parts = self._laid(items, torn)
        better = better_of(known, told, self._matched(items, parts), parts)
        return told | better, {i: parts[i] for i in better}

    def _on_reference(
        self, items: Sequence[MeshLike], kinds: Sequence[str], wanted: set[int], told: set[int]
    ) -> tuple[dict[int, Match], dict[int, OnReference]]:
        """Return matches to the reference, and what pairs need of those that say something.

        Of the wanted meshes alone, and without warnings of whole ones that were ``told``.
        """
        kinds = [kind if i in wanted else "" for i, kind in enumerate(kinds)]
        matches: dict[int, Match] = {}
        on_reference: dict[int, OnReference] = {}
        for i in sorted(wanted):
            if kinds[i] not in ("whole", "part"):
                matches[i] = self._nothing(items[i], i)
        parts = self._laid(items, _rows(kinds, "part"))
        known = self._knowledge()
        wholes, mended = self._mended(items, self._whole_on_places(items, kinds, told))
        matches |= self._matched(items, parts) | wholes
        for i, part in (parts | mended).items():
            on_reference[i] = part_on_reference(known, part, matches[i])
        for i, match in wholes.items():
            if i not in mended and (match.p2p >= 0).any():
                vertices, faces = arrays_of(items[i], i)
                on_reference[i] = whole_on_reference(vertices, faces, match)
        self._warn(items, kinds, parts)
        warn_of_tears(matches)
        return matches, on_reference

    def _whole_on_places(
        self, items: Sequence[MeshLike], kinds: Sequence[str], told: set[int]
    ) -> dict[int, Match]:
        """Return matches of whole shapes to places of the reference."""
        found: dict[int, Match] = {}
        for silent in (False, True):
            now = [kind if (i in told) == silent else "" for i, kind in enumerate(kinds)]
            rows = _rows(now, "whole")
            if not rows:
                continue
            with warnings.catch_warnings():
                if silent:
                    warnings.simplefilter("ignore")
                matches = models.match(
                    self.estimator_, _only(items, now, "whole"), interpolate="barycentric"
                )
            found.update((i, all_covered(matches[i])) for i in rows)
        return found

    def _nothing(self, item: MeshLike, i: int) -> Match:
        learner = _learner_of(self.estimator_)
        nothing = nothing_said(learner, item, i)
        return with_meshes(nothing, item, i, learner.reference_.spectral)

    def _warn(
        self, items: Sequence[MeshLike], kinds: Sequence[str], parts: dict[int, Part]
    ) -> None:
        """Say what a person should know of all that are not whole."""
        names = [named(item, i) for i, item in enumerate(items)]
        called = [
            f"X[{i}]" if name is None else f"X[{i}] ({name!r})" for i, name in enumerate(names)
        ]
        warn_of_size(called, kinds)
        warn_of_sides([called[i] for i in parts], [part.side for part in parts.values()])
        warn_of_strange(
            [
                called[i]
                for i, part in parts.items()
                if part.is_itself and not self.trust_.is_familiar(part.laid)
            ]
        )

    def _tell(self, message: str) -> None:
        if self.verbose:
            tell(f"[{type(self).__name__}] {message}")

    def __sklearn_tags__(self) -> Tags:
        """Return the tags of the pipeline."""
        return get_tags(self.estimator)


def _learner_of(pipeline: Pipeline) -> Any:
    """Return the learner at the end of a pipeline; that of a bridged one."""
    last = pipeline[-1]
    return last.estimator_ if isinstance(last, BridgedLearner) else last


def _rows(kinds: Sequence[str], kind: str) -> list[int]:
    return [i for i, one in enumerate(kinds) if one == kind]


def _only(items: Sequence[MeshLike], kinds: Sequence[str], kind: str) -> list[MeshLike]:
    """Return the meshes with those of other kinds set aside: all keep their indices."""
    return [
        item if one == kind else SetAside(named(item, i), "", n_vertices_of(item))
        for i, (item, one) in enumerate(zip(items, kinds, strict=True))
    ]


def _lay(matcher: PartialMatcher, item: MeshLike, i: int) -> Part:
    """Return the reference laid onto a part."""
    vertices, faces = arrays_of(item, i)
    body, max_vertices = matcher.body_, matcher.estimator_[0].max_vertices
    unit, scale = matcher.unit_, None
    for turn in (1, -1):  # the other way round if the faces are inside out
        faces = faces[:, ::turn]
        if matcher.scale == "estimated":
            area = float(np.median(matcher.areas_))
            unit = 1 / scale_of(vertices, faces, body, matcher.trust_, area)
            scale = matcher.unit_ / unit
        scan = scan_of(vertices, faces, unit, max_vertices)
        side = matcher.sides_.of(body, scan) if turn == 1 else "inside out"
        if side != "inside out":
            break
    return Part(vertices / unit, faces, scan, body.lay(scan), unit, side, scale)
