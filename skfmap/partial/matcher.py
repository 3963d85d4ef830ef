"""Parts of shapes, matched to the whole reference by any pipeline that matches whole ones."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self

import numpy as np
import scipy.sparse as sp
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline
from sklearn.utils import Tags, get_tags
from sklearn.utils.validation import check_is_fitted

from skfmap._tools.caching import hash_of_arrays
from skfmap._tools.parallel import map_shapes, tell
from skfmap._tools.types import FloatArray, IntArray, Interpolation, RefineOverride
from skfmap._tools.validation import check_choice, check_number
from skfmap._tools.warn import warn
from skfmap._version import Versioned
from skfmap.basis import SpectralBasis
from skfmap.exceptions import MeshError, SkippedShapeWarning, UnfamiliarShapeWarning
from skfmap.geometry.faults import sound_faces
from skfmap.geometry.normals import vertex_normals
from skfmap.io import MeshLike, as_arrays, check_meshes, n_vertices_of, named
from skfmap.learner import BridgedLearner, WeightedFunctionalMapLearner, models
from skfmap.learner.about_meshes import given_of
from skfmap.learner.given_answers import GivenReference, given_reference
from skfmap.learner.new_shape import INTERPOLATIONS, blank_match
from skfmap.learner.parameters import changed
from skfmap.learner.training_set import TrainingSet
from skfmap.partial.body import Body, LaidOnPart, Lesson, nearest_with_normals, shared_regions
from skfmap.partial.cuts import Cut, make_cuts
from skfmap.partial.scan import Scan, area_and_rim, scan_of
from skfmap.partial.trust import PartTrust, Seen
from skfmap.refinement import Refinement
from skfmap.registration.part import Registration, lay_on_training
from skfmap.shapes import GivenMesh, Match, Mesh, SpectralShape
from skfmap.shapes.usable import Answer, describe

__all__ = ["PartialMatcher"]

# A mesh is whole whose rim is no longer than that of training shapes by this, in sqrt(area).
_RIM = 0.1
# Shares of the median area of the training shapes, below and above which nothing can be said.
_TOO_SMALL, _TOO_LARGE = 0.15, 3.0
# Farther than this from the laid reference, in sqrt(area), a point belongs to nothing.
_NOTHING = 0.08
# Groups of training shapes that are left out in turn.
_N_FOLDS = 3


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
    n_cuts : int, default=6
        Parts that are cut of each training shape to learn from. The whole shape is one more.
    n_calibrated : int, default=2
        How many of them are matched by what was learned without the shape, which says how large
        errors are to be expected, and what is covered.
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

    See Also
    --------
    skfmap.match : Takes this model as any other.

    Notes
    -----
    Units of scans are those of the training shapes. Coordinates may be turned and shifted in any
    way, faces have to be wound outwards.

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
        n_cuts: int = 6,
        n_calibrated: int = 2,
        random_state: int = 0,
        n_jobs: int | None = None,
        verbose: int = 0,
    ) -> None:
        self.estimator = estimator
        self.cuts = cuts
        self.n_cuts = n_cuts
        self.n_calibrated = n_calibrated
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
            As in `WeightedFunctionalMapLearner.fit`; shapes of weight 0 are not cut.

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
                f"two more at least; got {len(training.used)} more."
            )
        self._tell("laying the reference onto whole shapes")
        whole, laid = _whole_shapes(training, learner)
        fitted = self._learned(training, whole, laid, cuts)
        self.__dict__.update(estimator_=pipeline, **fitted)
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
            functional map; its entries are NaN.

        Warns
        -----
        SkippedShapeWarning
            If a part is too small to say where it belongs, below 15 % of the area of the training
            shapes, or units differ from theirs.
        UnfamiliarShapeWarning
            If a scan does not lie on the reference as parts of training shapes do.
        """
        check_is_fitted(self)
        items = check_meshes(X)
        check_choice(interpolate, "interpolate", INTERPOLATIONS)
        changed(_learner_of(self.estimator_).matcher_, refine=refine)  # raises also without wholes
        kinds = [self._kind(item, i) for i, item in enumerate(items)]
        whole = [i for i, kind in enumerate(kinds) if kind == "whole"]
        found: dict[int, Match] = {}
        if whole:
            answers = models.match(
                self.estimator_, [items[i] for i in whole], refine=refine, interpolate=interpolate
            )
            found.update(zip(whole, map(_all_covered, answers), strict=True))
        found.update(self._parts(items, [i for i, kind in enumerate(kinds) if kind == "part"]))
        tried = {i: kind for i, kind in enumerate(kinds) if kind not in ("whole", "part")}
        for i in tried:
            found[i] = self._nothing(items[i], i)
        self._warn(items, found, tried)
        reference = _learner_of(self.estimator_).reference_.spectral
        return [
            _called(found[i], named(item, i))
            if kinds[i] == "whole"
            else _with_meshes(found[i], item, i, reference)
            for i, item in enumerate(items)
        ]

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
        check_number(self.random_state, "random_state", low=0, integer=True)
        return make_cuts(self.cuts)

    def _learned(
        self,
        training: TrainingSet,
        whole: list[Mesh],
        laid: list[FloatArray],
        cuts: list[Cut],
    ) -> dict[str, Any]:
        """Return what parts of whole shapes teach; the reference is the first of them."""
        spectral_0 = training.reference.spectral
        unit, faces_0 = float(np.sqrt(spectral_0.area)), spectral_0.mesh.faces
        self._tell("cutting shapes, and looking at the surroundings of points")
        lessons = map_shapes(
            _lessons_of,
            (
                (mesh, on, faces_0, unit, cuts, self.n_cuts, [self.random_state, i])
                for i, (mesh, on) in enumerate(zip(whole, laid, strict=True))
            ),
            n_jobs=self.n_jobs,
            verbose=0,
        )
        regions = shared_regions(spectral_0.vertices, faces_0, spectral_0.mass)
        self._tell("learning to recognise points")
        folds = [np.arange(len(whole))]
        others = np.arange(1, len(whole))
        folds += [np.setdiff1d(folds[0], others[k::_N_FOLDS]) for k in range(_N_FOLDS)]
        folds = [fold for fold in folds if len(fold) > 1]
        bodies = map_shapes(
            _body_of,
            ((regions, [laid[i] for i in fold[1:]], [lessons[i] for i in fold]) for fold in folds),
            n_jobs=self.n_jobs,
            verbose=0,
        )
        self._tell("matching parts of shapes that were left out")
        left_out = [
            (body, lesson)
            for body, fold in zip(bodies[1:], folds[1:], strict=True)
            for i in np.setdiff1d(folds[0], fold)
            for lesson in lessons[i][1 : 1 + self.n_calibrated]
        ]
        seen = map_shapes(_seen, left_out, n_jobs=self.n_jobs, verbose=0)
        sizes = np.array([area_and_rim(one.vertices / unit, one.faces) for one in whole])
        return {
            "body_": bodies[0],
            "trust_": PartTrust.learned(seen, regions),
            "unit_": unit,
            "areas_": sizes[:, 0],
            "rims_": sizes[:, 1],
        }

    def _kind(self, item: MeshLike, i: int) -> str:
        """Return "whole" or "part", or why nothing can be said."""
        try:
            vertices, faces = _arrays(item, i)
        except (MeshError, OSError):
            return "whole"  # what is to be done about it is the pipeline's to say
        faces = faces[sound_faces(vertices, faces)]
        if not len(faces):
            return "whole"
        area, rim = area_and_rim(vertices / self.unit_, faces)
        if rim <= self.rims_.max() + _RIM:
            return "whole"
        share = area / float(np.median(self.areas_))
        if share < _TOO_SMALL:
            return f"it has {100 * share:.2g} % of their area, too little to say where it belongs"
        if share > _TOO_LARGE:
            return f"it has {share:.2g} times their area"
        return "part"

    def _parts(self, items: Sequence[MeshLike], rows: list[int]) -> dict[int, Match]:
        learner = _learner_of(self.estimator_)
        # Points of scans lie between the vertices of the given reference.
        target = given_reference(learner.reference_)
        if not target.is_working:
            target.places(np.zeros((1, 3)), np.array([[0.0, 0, 1]]))
        matched = map_shapes(
            _match_part,
            ((self, items[i], i, target) for i in rows),
            n_jobs=self.n_jobs,
            verbose=self.verbose,
            prefer="threads",
        )
        return dict(zip(rows, matched, strict=True))

    def _nothing(self, item: MeshLike, i: int) -> Match:
        """Return the answer where nothing can be said: -1 and NaN."""
        learner = _learner_of(self.estimator_)
        spectral_0 = learner.reference_.spectral
        n_i, n_0 = n_vertices_of(item), spectral_0.n_given
        return replace(
            blank_match(learner.matcher_, n_i, n_0, assessed=True),
            name=named(item, i),
            reference_name=learner.reference_.name,
            reference_hash=spectral_0.given_hash,
            covered=np.zeros(n_0, dtype=bool),
            covered_probability=np.full(n_0, np.nan),
        )

    def _warn(
        self, items: Sequence[MeshLike], found: dict[int, Match], tried: dict[int, str]
    ) -> None:
        told = "; ".join(f"{describe(i, found[i])}: {why}" for i, why in tried.items())
        if told:
            warn(
                f"Unlike the training shapes in size, and not matched: {told}. Scans have to be in "
                "the units of the training shapes, and show 15 % of a shape at least.",
                SkippedShapeWarning,
            )
        strange = ", ".join(
            describe(i, found[i])
            for i in range(len(items))
            if found[i].familiar is False and np.isnan(found[i].functional_map).all()
        )
        if strange:
            warn(
                f"The reference does not lie on {strange} as on parts of the training shapes. "
                "Another kind of body, other units, or faces wound inwards? Do not rely on these "
                "matches.",
                UnfamiliarShapeWarning,
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


def _arrays(item: MeshLike, i: int) -> tuple[FloatArray, IntArray]:
    given = as_arrays(item, i)
    return (given.vertices, given.faces) if isinstance(given, Mesh) else given


def _whole_shapes(training: TrainingSet, learner: Any) -> tuple[list[Mesh], list[FloatArray]]:
    """Return working meshes, and the reference laid onto them in sqrt(area) of itself."""
    refinement = learner.refine_
    start = refinement.start_ if isinstance(refinement, Registration) else refinement
    laid = lay_on_training(training, learner.matcher_, start)
    spectral_0 = training.reference.spectral
    others = [training.shapes[i].spectral for i in training.used]
    scaled = [
        on * np.sqrt(one.area / spectral_0.area) for on, one in zip(laid, others, strict=True)
    ]
    meshes = [spectral_0.mesh, *(one.mesh for one in others)]
    return meshes, [spectral_0.vertices, *scaled]


def _lessons_of(
    mesh: Mesh,
    laid: FloatArray,
    faces_0: IntArray,
    unit: float,
    cuts: list[Cut],
    n_cuts: int,
    seed: list[int],
) -> list[Lesson]:
    """Return the whole of a shape and parts of it, with their features."""
    parts = [mesh]
    for number in range(n_cuts):
        rng = np.random.default_rng([*seed, number])
        parts.append(cuts[(number + seed[-1]) % len(cuts)].cut(mesh, rng))
    lessons = [
        Lesson.of(scan_of(part.vertices, part.faces, unit, None), laid, faces_0) for part in parts
    ]
    for lesson in lessons:
        lesson.scan.features  # noqa: B018
    return lessons


def _body_of(regions: Any, laid: list[FloatArray], lessons: list[list[Lesson]]) -> Body:
    return Body.learned(regions, laid, [one for each in lessons for one in each])


def _seen(body: Body, lesson: Lesson) -> Seen:
    return Seen(lesson, body.lay(lesson.scan))


def _all_covered(match: Match) -> Match:
    """Return a match of a whole shape, which covers all; nothing is known of one without any."""
    n_0, known = len(match.inverse), bool((match.p2p >= 0).any())
    return replace(
        match,
        covered=np.full(n_0, known),
        covered_probability=np.full(n_0, 1.0 if known else np.nan),
    )


def _called(match: Match, name: str | None) -> Match:
    """Return the match of a whole shape with its name: the pipeline numbers whole ones alone."""
    given = None if match.given is None else replace(match.given, name=name)
    return replace(match, name=name, given=given)


def _with_meshes(match: Match, item: MeshLike, i: int, reference: SpectralShape) -> Match:
    """Return the match of what is no whole shape, with its mesh and that of the reference."""
    vertices, faces = _arrays(item, i)
    content = hash_of_arrays(vertices, faces)
    given = GivenMesh(match.name, len(vertices), len(faces), content, item)
    return replace(match, given=given, reference_given=given_of(reference))


def _match_part(matcher: PartialMatcher, item: MeshLike, i: int, target: GivenReference) -> Match:
    """Return the match of one part, at the vertices that it came with."""
    learner, unit = _learner_of(matcher.estimator_), matcher.unit_
    given, faces = _arrays(item, i)
    scan = scan_of(given, faces, unit, matcher.estimator_[0].max_vertices)
    laid = matcher.body_.lay(scan)
    return _on_given(matcher, learner, target, scan, laid, (given / unit, faces), named(item, i))


def _on_given(
    matcher: PartialMatcher,
    learner: Any,
    target: GivenReference,
    scan: Scan,
    laid: LaidOnPart,
    given: tuple[FloatArray, IntArray],
    name: str | None,
) -> Match:
    reference, regions = learner.reference_, matcher.body_.regions
    spectral_0, n_i = reference.spectral, len(given[0])
    sound = given[1][sound_faces(*given)]
    usable = np.zeros(n_i, dtype=bool)
    usable[sound] = True
    rows = np.flatnonzero(usable)
    at, normals = given[0][rows], vertex_normals(np.nan_to_num(given[0]), sound)[rows]
    own = nearest_with_normals(at, normals, scan.vertices, scan.normals)
    laid_normals = vertex_normals(laid.vertices, regions.faces)
    working = nearest_with_normals(at, normals, laid.vertices, laid_normals)
    errors, right = matcher.trust_.assess(scan, laid)
    familiar = matcher.trust_.is_familiar(laid)
    belongs = laid.away[own] <= _NOTHING
    rows, working, own = rows[belongs], working[belongs], own[belongs]
    corners, weights = _corners(target, working)
    p2p, expected, confidence = np.full(n_i, -1), np.full(n_i, np.nan), np.full(n_i, np.nan)
    p2p[rows] = corners[np.arange(len(rows)), weights.argmax(axis=1)]
    expected[rows], confidence[rows] = errors[own], right[own]
    n_0 = spectral_0.n_given
    matrix = sp.coo_array(
        (weights.ravel(), (np.repeat(rows, weights.shape[1]), corners.ravel())), shape=(n_i, n_0)
    ).tocsr()
    matrix.eliminate_zeros()
    probability = spectral_0.prolong(matcher.trust_.coverage(laid), 0.0)
    covered = probability >= 0.5
    places = spectral_0.prolong(laid.vertices, 0.0), spectral_0.prolong(laid_normals, 0.0)
    inverse = np.full(n_0, -1)
    if covered.any() and len(rows):
        chosen = nearest_with_normals(
            places[0][covered],
            places[1][covered],
            given[0][rows],
            vertex_normals(np.nan_to_num(given[0]), sound)[rows],
        )
        inverse[covered] = rows[chosen]
    k, p = len(learner.stable_basis_), learner.n_stable_
    return Match(
        p2p,
        expected,
        confidence,
        np.full((k, k), np.nan),
        np.full((k, p), np.nan),
        name=name,
        reference_name=reference.name,
        n_supporting=np.zeros(n_i, dtype=np.int64),
        matrix=matrix,
        inverse=inverse,
        reference_hash=spectral_0.given_hash,
        misfit=laid.strain / matcher.trust_.usual_strain,
        familiar=familiar,
        covered=covered,
        covered_probability=probability,
    )


def _corners(target: GivenReference, working: IntArray) -> tuple[IntArray, FloatArray]:
    """Return vertices of the given reference, and weights, at vertices of the working one."""
    if target.is_working:
        return working[:, None], np.ones((len(working), 1))
    mesh = target.shape.mesh
    normals = vertex_normals(mesh.vertices, mesh.faces)
    return target.places(mesh.vertices[working], normals[working])
