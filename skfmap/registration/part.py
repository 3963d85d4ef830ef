"""The refinement that lays the mesh of the reference onto each shape."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple, Self
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp
from sklearn.base import clone

from skfmap._tools.caching import hash_of_arrays
from skfmap._tools.parallel import map_shapes, threads_within
from skfmap._tools.types import FloatArray, RefineOnMaps
from skfmap._tools.validation import check_choice, check_number
from skfmap.functional.neighbours import nearest_both
from skfmap.functional.refinement import map_from_point_maps
from skfmap.functional.samples import farthest_points
from skfmap.functional.similarity import (
    STIFF,
    TELLING,
    Similarity,
    best_similarity,
    left_by_similarities,
    side_of,
)
from skfmap.geometry.closest import ClosestPoints
from skfmap.refinement import (
    ICP,
    REFINEMENTS,
    Learned,
    PointMatch,
    Refinement,
    ZoomOut,
    match_points,
)
from skfmap.registration.alignment import align, nearest_poses, principal_axes
from skfmap.registration.by_landmarks import lay_by_landmarks, nearest_in_space
from skfmap.registration.deformation import Deformation
from skfmap.registration.laying import Anchors, flipped_faces, lay, lay_on_points, unfold
from skfmap.registration.quality import Limits, Quality, assess
from skfmap.shapes import SpectralShape

__all__ = ["Laid", "Registration", "lay_on_training"]

# Candidate stiffnesses, relative to the attraction of each vertex by the surface, whose mean is 1.
_STIFFNESSES = (30.0, 3.0, 0.3, 0.03)
# Stiffness for laying the reference onto training shapes, whose pairs are known.
_OF_TRAINING = 0.3
# Attraction by a known pair if there are few, relative to 1 for the surface at a vertex; the total
# attraction by many pairs equals that of the surface. On mandibles with 13 landmarks, 10 instead of
# 1 reduces errors from 0.288 to 0.256 mm.
_FEW_PAIRS = 10.0
# Minimum number of pairs per function for which the known map is used to place points.
_MANY_PAIRS = 10
# Maximum number of training shapes that are left out in turn to choose the stiffness.
_VALIDATED = 6
# Attraction by matched points, relative to known pairs, whose total equals that of the surface.
_MATCHED = 0.1
# Misfits above which a registration is repeated from its own result (at most three times), from
# other refinements of the match, and from poses of training shapes. On FAUST, cats and animals,
# registrations from the right start are below 3.
_DOUBTFUL, _WRONG, _LOST, _AGAIN = 1.5, 2.0, 3.0, 3
# Maximum number of poses of training shapes that are stored (60 kB each at 5,000 vertices), and
# number of the nearest ones that are tried.
_MOST_POSES, _N_POSES_NEAR = 24, 5
# Another start is preferred if its misfit is below this fraction of that of the first one. Without
# this margin, the error of a cat increases from 2.5 to 3.3.
_CLEARLY = 0.8


class Laid(NamedTuple):
    """The reference laid onto a shape of unit area.

    Attributes
    ----------
    vertices : ndarray of shape (n_vertices_0, 3)
        Vertices of the reference's working mesh.
    n_flipped : int
        Number of faces that are folded over.
    quality : Quality
        How well the vertices lie on the shape.
    fits : bool
        Whether they lie as well as on training shapes.
    """

    vertices: FloatArray
    n_flipped: int
    quality: Quality
    fits: bool


class Registration(Refinement):
    """Lay the reference's mesh onto each shape, and match points through it.

    It starts from a match or, for rigid shapes, from a similarity found in space. The reference is
    then deformed as training shapes deform, and attracted by the closest points of the surface
    whose normals agree, while it becomes softer. In the learner, this is ``refine="register"``;
    `skfmap.register` returns the meshes.

    Parameters
    ----------
    start : {"bijective-zoomout", "icp", "zoomout"}, Refinement or None, default="bijective-zoomout"
        Refinement of the match to start from. None starts from the learned match, unrefined.
    deformation : {"learned", "as-rigid-as-possible"}, default="learned"
        Which deformations cost nothing: the mean and the principal components of the stretch of
        training shapes, whatever their pose; or none, relative to the reference.
    stiffness : float or "auto", default="auto"
        How much the mesh resists in the end, relative to the attraction of each vertex by the
        surface, whose mean is 1. ``"auto"`` lets training shapes choose from 30, 3, 0.3 and 0.03.
    pose : {"auto", "free", "similarity"}, default="auto"
        ``"similarity"``: shapes differ little except in position, rotation and size, as bones do;
        the start is then found in space, over all rotations. ``"auto"`` checks whether a similarity
        explains all but 2 % of the sum of squares of the known pairs of the training shapes.

    Attributes
    ----------
    start_ : Refinement or None
        The fitted start.
    deformation_ : Deformation
        The learned model of deformation; a few MB.
    stiffness_, pose_ : float, str
        What was chosen.
    choices_ : dict of float
        Mean error, in sqrt(area), of known places on training shapes that were left out of the
        deformation model, for each stiffness.
    limits_ : Limits
        Limits beyond which the reference does not fit a shape.
    poses_ : ndarray of float32, shape (n_poses, n_vertices_0, 3)
        The reference laid onto training shapes, 24 at most, where shapes bend: starts for shapes
        that the match leads to a worse place on than is usual.

    Notes
    -----
    Training shapes of any weight above 0 count equally, and are registered by their known pairs.
    Each shape that is used to choose the stiffness is left out of the deformation model; the match
    that it starts with is not learned again.

    Examples
    --------
    >>> import skfmap
    >>> from skfmap.registration import Registration
    >>> learner = skfmap.WeightedFunctionalMapLearner(refine=Registration(pose="free"))
    >>> learner.set_params(refine__stiffness=3.0).refine
    Registration(pose='free', stiffness=3.0)
    """

    def __init__(
        self,
        start: RefineOnMaps | Refinement | None = "bijective-zoomout",
        *,
        deformation: Literal["learned", "as-rigid-as-possible"] = "learned",
        stiffness: float | Literal["auto"] = "auto",
        pose: Literal["auto", "free", "similarity"] = "auto",
    ) -> None:
        self.start = start
        self.deformation = deformation
        self.stiffness = stiffness
        self.pose = pose

    def check_parameters(self) -> None:
        """Raise an error for invalid parameters."""
        if isinstance(self.start, Registration):
            raise ValueError(
                "start cannot be a Registration; give another refinement, or None for the match "
                "that was learned."
            )
        if isinstance(self.start, Refinement):
            self.start.check_parameters()
        elif self.start is not None:
            check_choice(self.start, "start", tuple(REFINEMENTS))
        check_choice(self.deformation, "deformation", ("learned", "as-rigid-as-possible"))
        check_choice(self.pose, "pose", ("auto", "free", "similarity"))
        if isinstance(self.stiffness, str):
            check_choice(self.stiffness, "stiffness", ("auto",))
        else:
            check_number(self.stiffness, "stiffness", low=0, strict=True)

    def fit(self, training: Any, matcher: Any) -> Self:
        """Learn the deformation model, and choose the stiffness.

        Parameters
        ----------
        training : TrainingSet
            Training shapes.
        matcher : Matcher
            Matcher that was learned from them.

        Returns
        -------
        Registration
            The fitted refinement.
        """
        self._prepare(training, matcher)
        self.choices_: dict[float, float] = {}
        samples = _samples(training, matcher, self.start_, self.pose_)
        laid = self._learn_deformation(training, samples)
        if self.stiffness == "auto":
            self._choose(training, samples, laid, _STIFFNESSES)
        else:
            self._choose(training, samples, laid, (float(self.stiffness),))
        return self

    def fit_fold(self, training: Any, matcher: Any) -> Self:
        """Return a refinement learned from some of the shapes, with choices made by all of them.

        The parameters are those of `fit`, which has to be called before.
        """
        other: Self = clone(self)
        other._prepare(training, matcher)
        other.pose_ = self.pose_
        other._learn_deformation(training, _samples(training, matcher, other.start_, other.pose_))
        other.stiffness_, other.choices_ = self.stiffness_, self.choices_
        other.limits_ = other.limits_._replace(usual=self.limits_.usual)
        return other

    def refine(self, learned: Learned, spectral: SpectralShape, match: PointMatch) -> PointMatch:
        """Return the match by nearest points, with respect to both positions and normals.

        The result also has a new ``inverse``, the nearest vertex to each registered one, and a new
        functional map, which is fitted to both point maps.
        """
        return _matched_in_space(
            learned.reference.spectral, spectral, match, self.vertices_on(learned, spectral, match)
        )

    def lay(self, learned: Learned, spectral: SpectralShape, match: PointMatch) -> Laid:
        """Lay the reference onto a shape.

        Parameters
        ----------
        learned : Learned
            The learned model.
        spectral : SpectralShape
            The shape S_i.
        match : PointMatch
            Match of the shape in the learned functions.

        Returns
        -------
        Laid
            The reference laid onto the shape, which is scaled to unit area.
        """
        vertices = self.vertices_on(learned, spectral, match)
        spectral_0 = learned.reference.spectral
        quality = self._quality(spectral_0, spectral, vertices)
        flipped = flipped_faces(self.deformation_, spectral_0.mesh.faces, vertices)
        return Laid(vertices, int(flipped.sum()), quality, self.limits_.allow(quality))

    def quality_of(
        self, learned: Learned, spectral: SpectralShape, match: PointMatch
    ) -> tuple[Quality, bool]:
        """Return the quality of the registration behind a match from `refine`, and whether it fits.

        Parameters
        ----------
        learned, spectral : Learned, SpectralShape
            As in `refine`.
        match : PointMatch
            The match that `refine` returned.
        """
        laid = match.points_0[:, :3]  # positions, which are followed by normals
        quality = self._quality(learned.reference.spectral, spectral, laid)
        return quality, self.limits_.allow(quality)

    def vertices_on(
        self, learned: Learned, spectral: SpectralShape, match: PointMatch
    ) -> FloatArray:
        """Return the reference's working vertices on a shape of unit area, (n_vertices_0, 3).

        If they fit worse than on training shapes, the registration is repeated from its own result.
        If they fit much worse, other refinements and poses of training shapes are tried as well.
        """
        spectral_0 = learned.reference.spectral
        best = self._tried(learned, spectral, match, self.start_)
        doubt = self.limits_.doubt(best[0])
        if self.pose_ == "similarity" or doubt <= _DOUBTFUL:
            return best[1]
        best = self._best_start(learned, spectral, match, best, doubt)
        for _ in range(_AGAIN):
            begun = _matched_in_space(spectral_0, spectral, match, best[1])
            again = self._tried(learned, spectral, begun, self.start_)
            if self._misfit(again) >= self._misfit(best):
                break
            best = again
        return best[1]

    def _best_start(
        self,
        learned: Learned,
        spectral: SpectralShape,
        match: PointMatch,
        first: tuple[Quality, FloatArray],
        doubt: float,
    ) -> tuple[Quality, FloatArray]:
        """Return the result of the first start, or of another one that is clearly better."""
        starts: list[tuple[PointMatch, Refinement | None]] = []
        if doubt > _WRONG:
            starts += [(match, other) for other in (ICP(), ZoomOut(), None)]
        if doubt > _LOST:
            spectral_0 = learned.reference.spectral
            starts += [
                (_matched_in_space(spectral_0, spectral, match, pose), self.start_)
                for pose in self._poses_near(spectral_0, spectral)
            ]
        tried = [self._tried(learned, spectral, *start) for start in starts]
        best = min(tried, key=self._misfit, default=first)
        return best if self._misfit(best) < _CLEARLY * self._misfit(first) else first

    def _misfit(self, tried: tuple[Quality, FloatArray]) -> float:
        return self.limits_.misfit(tried[0])

    def _poses_near(self, spectral_0: SpectralShape, spectral: SpectralShape) -> list[FloatArray]:
        """Return the poses of training shapes that are nearest to a shape, aligned with it."""
        return nearest_poses(
            np.concatenate([spectral_0.vertices[None], self.poses_]),
            spectral_0.mesh.faces,
            ClosestPoints(spectral.vertices, spectral.mesh.faces),
            principal_axes(spectral.vertices, spectral.mass),
            spectral_0.mass,
            _N_POSES_NEAR,
        )

    def _tried(
        self,
        learned: Learned,
        spectral: SpectralShape,
        match: PointMatch,
        refinement: Refinement | None,
    ) -> tuple[Quality, FloatArray]:
        """Return the quality and vertices of the registration that starts from a refined match."""
        deformation, spectral_0 = self.deformation_, learned.reference.spectral
        begun = match if refinement is None else refinement.refine(learned, spectral, match)
        start = _start(deformation, spectral_0, spectral, begun, self.pose_)
        drawn = _drawn(deformation, spectral_0, spectral, start, self.stiffness_)
        vertices = unfold(deformation, spectral_0.mesh.faces, drawn)
        return self._quality(spectral_0, spectral, vertices), vertices

    def _prepare(self, training: Any, matcher: Any) -> None:
        self.check_parameters()
        start = REFINEMENTS[self.start]() if isinstance(self.start, str) else self.start
        self.start_ = None if start is None else start.fit_fold(training, matcher)
        self.pose_ = _pose(training) if self.pose == "auto" else self.pose

    def _learn_deformation(self, training: Any, samples: "Sequence[_Sample]") -> list[FloatArray]:
        laid = map_shapes(
            _lay_by_pairs,
            ((training.reference.spectral, one) for one in samples),
            n_jobs=training.n_jobs,
            verbose=0,
            prefer="threads",
        )
        self.deformation_ = _deformation(
            training.reference.spectral, laid, self.deformation, self.pose_
        )
        self.limits_ = Limits.shown_by(self.deformation_, laid)
        self.poses_ = _poses(laid, training.reference.spectral, self.pose_)
        return laid

    def _choose(
        self,
        training: Any,
        samples: "Sequence[_Sample]",
        laid: list[FloatArray],
        stiffnesses: tuple[float, ...],
    ) -> None:
        """Choose the stiffness on training shapes that are left out of the deformation model.

        The usual quality is measured on the same shapes.
        """
        spectral_0, n = training.reference.spectral, len(samples)
        rows = np.unique(np.linspace(0, n - 1, min(n, _VALIDATED)).round().astype(int))
        arguments = (
            (
                _deformation(
                    spectral_0,
                    [laid[j] for j in range(n) if j != i],
                    self.deformation,
                    self.pose_,
                ),
                spectral_0,
                samples[i],
                self.pose_,
                stiffnesses,
            )
            for i in rows
        )
        seen = map_shapes(
            _validated, arguments, n_jobs=training.n_jobs, verbose=0, prefer="threads"
        )
        errors = np.mean([[error for error, _ in one] for one in seen], axis=0)
        best = int(np.argmin(errors))
        self.choices_ = dict(zip(stiffnesses, errors.tolist(), strict=True))
        self.stiffness_ = stiffnesses[best]
        qualities = [
            self._quality(spectral_0, samples[i].spectral, one[best][1])
            for i, one in zip(rows, seen, strict=True)
        ]
        self.limits_ = self.limits_.with_usual(qualities)

    def _quality(
        self, spectral_0: SpectralShape, spectral: SpectralShape, vertices: FloatArray
    ) -> Quality:
        return assess(
            self.deformation_,
            self.limits_,
            (vertices, spectral_0.mesh.faces, spectral_0.mass),
            (spectral.vertices, spectral.mesh.faces, spectral.mass),
        )


def _poses(laid: Sequence[FloatArray], spectral_0: SpectralShape, pose: str) -> Any:
    """Return poses of training shapes that differ as much as possible, (n_poses, n_vertices_0, 3).

    There are none if shapes differ only by similarities.
    """
    if pose == "similarity":
        return np.zeros((0, *spectral_0.vertices.shape), np.float32)
    aligned = [best_similarity(one, laid[0], spectral_0.mass).apply(one) for one in laid]
    unlike = farthest_points(np.reshape(aligned, (len(laid), -1)), _MOST_POSES)
    return np.asarray(laid, dtype=np.float32)[np.sort(unlike)]


@dataclass(frozen=True, eq=False)
class _Sample:
    """A training shape with its known pairs."""

    matcher: Any
    shape: Any
    pairs: Anchors
    pose: str
    known_map: FloatArray

    @property
    def spectral(self) -> SpectralShape:
        return self.shape.spectral

    @property
    def match_to_lay(self) -> PointMatch:
        """The match that supplements the known pairs of shapes that bend.

        If there are many pairs, it is the match of the known map, which is the same in all folds.
        """
        k = len(self.known_map)
        if len(self.pairs.points) < _MANY_PAIRS * k:
            return self.match
        spectral_0 = self.matcher.reference.spectral
        return match_points(self.spectral, spectral_0, self.known_map, np.eye(k))

    @cached_property
    def match(self) -> PointMatch:
        """The match by the matcher, computed on demand."""
        solution = self.matcher.solve(self.shape)
        match: PointMatch = self.matcher.match_points(self.shape, solution.C)[1]
        return match


def _samples(training: Any, matcher: Any, start: Refinement | None, pose: str) -> list[_Sample]:
    begun = replace(matcher, refinement=start)
    made = [_sample(begun, training, i, pose) for i in training.used]
    upright = [one for one in made if not _is_mirrored(training.reference.spectral, one)]
    return upright or made


def _is_mirrored(spectral_0: SpectralShape, sample: "_Sample") -> bool:
    """Return whether a stiff shape is a mirror image, which no rotation of the reference fits."""
    at_0 = np.asarray(sample.pairs.places @ spectral_0.vertices)
    left = left_by_similarities(at_0, sample.pairs.points, sample.pairs.weights)
    return sample.pose == "similarity" and len(at_0) >= TELLING and side_of(*left) == -1


def _sample(matcher: Any, training: Any, i: int, pose: str) -> _Sample:
    shape, known = training.shapes[i], training.known[i]
    spectral_0 = training.reference.spectral
    # Wrong pairs of stiff shapes are not found by functions, but may have been found in space.
    right = ~training.wrong[i] if pose == "similarity" else known.areas > 0
    draw = min(_FEW_PAIRS * right.sum(), spectral_0.mesh.n_vertices)
    join = training.joins[i].take(right)
    pairs = Anchors(
        spectral_0.place_matrix(join.vertices_0, join.places_0),
        training.points(i)[right],  # as measured: projection costs 0.007 of 0.19 mm on mandibles
        join.weights * (draw / max(float(join.weights.sum()), 1e-300)),
    )
    return _Sample(matcher, shape, pairs, pose, known.C)


def _pose(training: Any) -> str:
    """Return "similarity" if similarities explain most training shapes' known pairs, or "free"."""
    left = []
    for i in training.used:
        if len(np.unique(training.joins[i].points)) < TELLING:
            continue
        join, spectral_0 = training.joins[i], training.reference.spectral
        spectral = training.shapes[i].spectral
        points = spectral.vertices_at(join.vertices_i, join.places_i)
        points_0 = spectral_0.vertices_at(join.vertices_0, join.places_0)
        left.append(left_by_similarities(points, points_0, join.weights)[0])
    return "similarity" if left and np.median(left) <= STIFF else "free"


# Cache of the latest registrations of each training shape, for as long as the shape exists.
_MOST_LAID = 4
_LAID: WeakKeyDictionary[SpectralShape, dict[str, FloatArray]] = WeakKeyDictionary()


def _lay_by_pairs(spectral_0: SpectralShape, sample: _Sample) -> FloatArray:
    """Return the reference laid onto a training shape by known pairs, which is cached."""
    pairs = sample.pairs
    # Stiff shapes are laid without the match, so that all folds share the cached results.
    match = None if sample.pose == "similarity" else sample.match_to_lay
    asked = () if match is None else (match.p2p, match.inverse)
    key = hash_of_arrays(
        spectral_0.vertices,
        spectral_0.mesh.faces,
        spectral_0.mass,
        pairs.places.indices,
        pairs.places.data,
        pairs.points,
        pairs.weights,
        *asked,
    )
    known = _LAID.setdefault(sample.spectral, {})
    laid = known.get(key)
    if laid is None:
        for oldest in list(known)[: 1 - _MOST_LAID]:  # other threads may also remove it
            known.pop(oldest, None)
        laid = known[key] = _by_pairs(spectral_0, sample, match)
    return laid


def _by_pairs(spectral_0: SpectralShape, sample: _Sample, match: PointMatch | None) -> FloatArray:
    pairs = sample.pairs
    if match is None:
        surface = sample.spectral.vertices, sample.spectral.mesh.faces
        return lay_by_landmarks(spectral_0, surface, pairs)
    rest = Deformation.of_reference(spectral_0.vertices, spectral_0.mesh.faces)
    matched = _matched(sample.spectral, spectral_0, match)
    both = Anchors(
        sp.csr_array(sp.vstack([matched.places, pairs.places])),
        np.concatenate([matched.points, pairs.points]),
        np.concatenate([_MATCHED * matched.weights, pairs.weights]),
    )
    start = lay_on_points(rest, both, matched.points)
    return _drawn(rest, spectral_0, sample.spectral, start, _OF_TRAINING, pairs)


def _deformation(
    spectral_0: SpectralShape, laid: Sequence[FloatArray], kind: str, pose: str
) -> Deformation:
    if kind == "learned" and len(laid):
        areas = spectral_0.mass if pose == "similarity" else None
        return Deformation.learned(spectral_0.vertices, spectral_0.mesh.faces, laid, areas=areas)
    return Deformation.of_reference(spectral_0.vertices, spectral_0.mesh.faces)


def _validated(
    deformation: Deformation,
    spectral_0: SpectralShape,
    sample: _Sample,
    pose: str,
    stiffnesses: tuple[float, ...],
) -> list[tuple[float, FloatArray]]:
    """Return the mean error at known pairs, and the registered vertices, for each stiffness."""
    start = _start(deformation, spectral_0, sample.spectral, sample.match, pose)
    found, pairs = [], sample.pairs
    surface = ClosestPoints(sample.spectral.vertices, sample.spectral.mesh.faces)
    for stiffness in stiffnesses:
        vertices = _drawn(deformation, spectral_0, sample.spectral, start, stiffness)
        on_surface = surface.of(np.asarray(pairs.places @ vertices)).points
        off = np.linalg.norm(on_surface - pairs.points, axis=1)
        found.append((float(np.average(off, weights=pairs.weights)), vertices))
    return found


def _start(
    deformation: Deformation,
    spectral_0: SpectralShape,
    spectral: SpectralShape,
    match: PointMatch,
    pose: str,
) -> FloatArray:
    """Return the initial coordinates: the aligned mean shape, or a deformation to the match."""
    matched = _matched(spectral, spectral_0, match)
    if pose == "free":
        start = lay_on_points(deformation, matched, matched.points)
        return unfold(deformation, spectral_0.mesh.faces, start)
    rest = deformation.shape_at_rest
    by_match = best_similarity(rest, matched.points, matched.weights * spectral_0.mass)
    found: Similarity = align(
        rest,
        spectral_0.mesh.faces,
        ClosestPoints(spectral.vertices, spectral.mesh.faces),
        principal_axes(spectral.vertices, spectral.mass),
        spectral_0.mass,
        [by_match],
    )
    return found.apply(rest)


def _matched(spectral: SpectralShape, spectral_0: SpectralShape, match: PointMatch) -> Anchors:
    """Return the points to which a match sends the reference's vertices.

    The weight of a vertex depends on how near to itself it returns when it is matched to the shape
    and back.
    """
    vertices_0 = spectral_0.vertices
    back = np.linalg.norm(vertices_0 - vertices_0[match.p2p[match.inverse]], axis=1)
    width = 2 * np.sqrt(2 / len(vertices_0))
    return Anchors(
        sp.eye_array(len(vertices_0), format="csr"),
        spectral.vertices[match.inverse],
        1 / (1 + np.square(back / width)),
    )


def _drawn(
    deformation: Deformation,
    spectral_0: SpectralShape,
    spectral: SpectralShape,
    start: FloatArray,
    stiffness: float,
    anchors: Anchors | None = None,
) -> FloatArray:
    return lay(
        deformation,
        spectral_0.mesh.faces,
        ClosestPoints(spectral.vertices, spectral.mesh.faces),
        start,
        spectral_0.mass,
        stiffness=stiffness,
        anchors=anchors,
    )


def _matched_in_space(
    spectral_0: SpectralShape, spectral: SpectralShape, match: PointMatch, laid: FloatArray
) -> PointMatch:
    """Return the match of nearest points, by positions and weighted normals."""
    points_i, points_0 = nearest_in_space(
        spectral_0, (spectral.vertices, spectral.mesh.faces), laid
    )
    p2p, inverse = nearest_both(points_i, points_0, n_threads=threads_within())
    n = min(spectral.n_components, spectral_0.n_components)
    C = map_from_point_maps(
        spectral.evecs[:, :n], spectral_0.evecs[:, :n], spectral.mass, spectral_0.mass, p2p, inverse
    )
    return PointMatch(match.learned_map, C, points_i, points_0, p2p, inverse)


def lay_on_training(training: Any, matcher: Any, start: Refinement | None) -> list[FloatArray]:
    """Return the reference laid onto training shapes by their known pairs.

    Parameters
    ----------
    training : TrainingSet
        Training shapes; only those with a positive weight, ``training.used``, are registered.
    matcher : Matcher
        Matcher that was learned from them.
    start : Refinement or None
        A fitted refinement, which is used if there are few pairs.

    Returns
    -------
    list of ndarray of shape (n_vertices_0, 3)
        Coordinates of the reference's working vertices on each shape, which has unit area.
    """
    pose, spectral_0 = _pose(training), training.reference.spectral
    begun = replace(matcher, refinement=start)
    samples = [_sample(begun, training, i, pose) for i in training.used]
    return map_shapes(
        _lay_by_pairs,
        ((spectral_0, one) for one in samples),
        n_jobs=training.n_jobs,
        verbose=0,
        prefer="threads",
    )
