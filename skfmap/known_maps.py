"""Known maps, from the given pairs or from dense maps that are built from a few landmarks.

These are parts of the learner, as refinements are: `KnownMaps.build` returns, for each training
shape, the pairs that its known map is fitted to.
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from skfmap._tools.caching import MemoryLike, cached, hash_of_arrays
from skfmap._tools.parallel import map_shapes, threads_within
from skfmap._tools.part import Part
from skfmap._tools.types import BoolArray, FloatArray, IntArray, SparseMatrix
from skfmap._tools.validation import check_number, label
from skfmap.exceptions import CorrespondenceError
from skfmap.functional.from_landmarks import map_from_landmarks
from skfmap.functional.neighbours import nearest_both
from skfmap.functional.refinement import beyond, map_from_point_maps
from skfmap.functional.samples import areas_of_samples, farthest_points
from skfmap.functional.similarity import MIRROR, STIFF, TELLING, left_by_similarities, side_of
from skfmap.geometry.geodesics import heat_distances
from skfmap.ground_truth import check_landmarks, distinct_landmarks
from skfmap.registration.by_landmarks import LandmarkBuild, build_in_space
from skfmap.shapes import JoinedPairs, ProbedShape, SpectralShape

__all__ = [
    "KNOWN_MAPS",
    "AutoKnownMaps",
    "BuiltMap",
    "FromLandmarks",
    "GivenPairs",
    "InSpace",
    "KnownMaps",
    "KnownMapsRecord",
    "PairsAsGiven",
    "kind_of",
    "record_of",
    "told_of",
]

PAIRS, FROM_LANDMARKS, IN_SPACE = "pairs", "from-landmarks", "in-space"

# Minimum number of distinct landmarks that a map is built from.
_FEWEST = 8
# With this many distinct landmarks per function or more, the pairs are used as they are.
_ENOUGH = 2.0
# Number of functions of the first map, and of functions added in each step.
_FIRST, _STEP = 15, 10
# Index of the function that has half the weight of the constant one when points are matched; higher
# functions, where known maps err more, have less. Mean errors of maps between five cats and the
# sixth from 13 landmarks: 0.0237 with equal weights, 0.0201 with 1 / (1 + lambda / lambda_10),
# 0.0223 with its square.
_HALF = 10
# Number of groups of landmarks that are left out of the building in turn. Building without a group
# uses fewer samples and longer steps.
_N_GROUPS, _SAMPLES, _LONG_STEP = 5, 1000, 20
# A landmark is doubtful if the others put it farther from its place than this, in sqrt(area), and
# farther than this many times the median of its shape.
_DOUBTFUL, _TIMES = 0.15, 4.0
# Doubtful landmarks are left out if that reduces the strain of the map below this fraction, and
# reported as swapped if swapping them does. On creatures with 13 to 40 landmarks, misplaced ones
# raise the strain 1.25 to 2.1 times, swapped ones 1.2 to 2.4 times; on a cat, a correct one (the
# tip of a limb that is put elsewhere) raises it 1.23 times. A suspect is swapped with this many
# landmarks near where it is put; at most this many doubtful ones are swapped with one another.
_RELIEF, _RELIEF_OF_EXCHANGE = 0.75, 0.9
_NEAREST, _MOST_PAIRED = 4, 6
# The user is warned of shapes whose landmark errors exceed this many times the typical one; of
# parts of the surface farther than this from the nearest landmark, in sqrt(area) (eight well-spread
# landmarks leave a gap of 0.37, those on one side 0.35 to 1.07); and of landmarks in one plane,
# which are flatter than this fraction of their extent.
_UNLIKE, _GAP, _FLAT = 3.0, 0.6, 0.02
# Scale, in sqrt(area), of the weight of a pair by how far from itself its vertex returns from S_0,
# and the weight below which a pair is dropped.
_RETURNS, _NIL = 0.05, 1e-3


class GivenPairs(NamedTuple):
    """The data that known maps are built from.

    Attributes
    ----------
    shapes, reference : sequence of ProbedShape, ProbedShape
        The training shapes S_i, and S_0.
    joins : sequence of JoinedPairs
        Landmarks of each shape and of the reference.
    k : int
        Number of functions.
    memory, n_jobs : object
        Cache, and number of shapes processed in parallel.
    """

    shapes: Sequence[ProbedShape]
    reference: ProbedShape
    joins: Sequence[JoinedPairs]
    k: int
    memory: MemoryLike = None
    n_jobs: int | None = None


class BuiltMap(NamedTuple):
    """The pairs that the known map of a shape is fitted to, and an assessment of those given.

    Attributes
    ----------
    pairs : JoinedPairs
        Pairs of given vertices of S_i and of S_0.
    kind : str
        ``"pairs"`` if these are the given pairs, otherwise how they were built.
    wrong : ndarray of bool, shape (n_given,)
        Which of the given pairs were left out as wrong.
    errors : ndarray of shape (n_given,)
        Distance on S_0 between each landmark and where the map that is built without it puts it, in
        sqrt(area); NaN if it was not computed.
    residuals : ndarray of shape (n_right, n_components)
        The same error of each correct landmark, in eigenfunctions of S_0; no rows if that was not
        computed.
    exchanged : list of (int, int)
        Template points of landmarks that seem to be swapped.
    gap : float
        Largest distance from a point of S_0 to its nearest landmark, in sqrt(area); 0 if that was
        not computed.
    """

    pairs: JoinedPairs
    kind: str
    wrong: BoolArray
    errors: FloatArray
    residuals: FloatArray
    exchanged: list[tuple[int, int]]
    gap: float = 0.0

    @property
    def error(self) -> float:
        """Mean of ``errors`` at landmarks that are not wrong; 0 if it was not computed."""
        known = self.errors[~self.wrong & np.isfinite(self.errors)]
        return float(known.mean()) if len(known) else 0.0


class KnownMapsRecord(NamedTuple):
    """How the known maps of a fitted learner were made (its attribute ``known_maps_``).

    Attributes
    ----------
    kinds : list of str
        For each shape given to `fit`: ``"pairs"``, ``"from-landmarks"`` or ``"in-space"``, or
        ``""`` for the reference and shapes that were left out.
    n_landmarks, n_pairs : ndarray of int, shape (n_shapes,)
        Number of distinct landmarks that each shape shares with the reference, and of pairs that
        its known map is fitted to.
    points : ndarray of int, shape (n_points,)
        Template points of the landmarks that maps were built from.
    landmark_errors : ndarray of shape (n_shapes, n_points)
        Distance on the reference between each of them and where the map that is built without it
        puts it, in sqrt(area); NaN where it was not computed.
    """

    kinds: list[str]
    n_landmarks: IntArray
    n_pairs: IntArray
    points: IntArray
    landmark_errors: FloatArray

    @property
    def mean_error(self) -> float:
        """Mean of ``landmark_errors``; NaN if no map was built."""
        known = np.isfinite(self.landmark_errors)
        return float(self.landmark_errors[known].mean()) if known.any() else float("nan")

    def __str__(self) -> str:
        """Return a summary in one line."""
        used = [i for i, kind in enumerate(self.kinds) if kind]
        built = [i for i in used if self.kinds[i] != PAIRS]
        if not built:
            return f"known maps of {len(used)} shapes from the pairs as given"
        fewest, most = self.n_landmarks[built].min(), self.n_landmarks[built].max()
        counts = f"{fewest}" if fewest == most else f"{fewest} to {most}"
        return (
            f"known maps of {len(built)} of {len(used)} shapes built from {counts} landmarks each; "
            f"a landmark that is left out of the building is put {self.mean_error:.3f} sqrt(area) "
            "from its place on average"
        )


class KnownMaps(Part, ABC):
    """Base class of methods that find the pairs known maps are fitted to.

    Derive from it to write your own.
    """

    @abstractmethod
    def build(self, given: GivenPairs) -> list[BuiltMap]:
        """Return the pairs that the known map of each shape is fitted to.

        Parameters
        ----------
        given : GivenPairs
            Shapes, the reference, and the pairs that they share with it.

        Returns
        -------
        list of BuiltMap
            One entry per shape, in their order.

        Raises
        ------
        CorrespondenceError
            If a shape has too few pairs.
        """

    def check(self, shape: ProbedShape, reference: ProbedShape, join: JoinedPairs, k: int) -> None:
        """Raise CorrespondenceError if a shape has too few pairs."""
        check_landmarks(shape, reference, join, k)


class PairsAsGiven(KnownMaps):
    """Known maps from the given pairs.

    Each shape needs at least ``n_functions`` pairs; twice as many are better.
    """

    def build(self, given: GivenPairs) -> list[BuiltMap]:
        """Return the given pairs."""
        return [_as_given(join) for join in given.joins]


class _FromFew(KnownMaps):
    """Dense maps, built from landmarks if there are too few to be used as they are."""

    enough: float

    @abstractmethod
    def build_one(self, given: GivenPairs, i: int) -> BuiltMap:
        """Return the pairs that the known map of the i-th shape is fitted to."""

    def build(self, given: GivenPairs) -> list[BuiltMap]:
        """Return the pairs of the map built for each shape, or its given pairs if they suffice."""
        for shape, join in zip(given.shapes, given.joins, strict=True):
            self.check(shape, given.reference, join, given.k)
        arguments = ((given, i) for i in range(len(given.shapes)))
        return map_shapes(self._one, arguments, n_jobs=given.n_jobs, verbose=0, prefer="threads")

    def _one(self, given: GivenPairs, i: int) -> BuiltMap:
        if distinct_landmarks(given.joins[i]) >= self.enough * given.k:
            return _as_given(given.joins[i])
        return self.build_one(given, i)

    def check(self, shape: ProbedShape, reference: ProbedShape, join: JoinedPairs, k: int) -> None:
        """Raise CorrespondenceError if a shape has fewer than 8 landmarks, and fewer than k."""
        n_distinct = distinct_landmarks(join)
        if n_distinct < min(_FEWEST, k):
            raise CorrespondenceError(
                f"{label(shape.name, 'shape')} and {reference.name!r} share {n_distinct} distinct "
                f"landmarks (repeated ones count once). This is too few for n_functions={k}, and "
                f"building a map takes {_FEWEST}. Place more landmarks, spread over the whole "
                "surface, or leave the shape out."
            )


class FromLandmarks(_FromFew):
    """Known maps from dense maps that are built from a few landmarks, for shapes that bend.

    The first map is fitted to heat around the landmarks and to unweighted probe functions, assuming
    an isometry. It then grows as in `skfmap.refinement.BijectiveZoomOut`, constrained by the
    landmarks.

    Parameters
    ----------
    n_samples : int, default=2000
        Number of vertices of each shape that are matched while maps grow.
    final_steps : int, default=2
        Number of final steps, in which all vertices are matched.
    enough : float, default=2.0
        If a shape shares at least this many distinct pairs per function with the reference, they
        are used as they are.

    Examples
    --------
    >>> import skfmap
    >>> from skfmap.known_maps import FromLandmarks
    >>> learner = skfmap.WeightedFunctionalMapLearner(known_maps=FromLandmarks())
    >>> learner.set_params(known_maps__n_samples=1000).known_maps
    FromLandmarks(n_samples=1000)
    """

    def __init__(
        self, n_samples: int = 2000, final_steps: int = 2, enough: float = _ENOUGH
    ) -> None:
        self.n_samples = n_samples
        self.final_steps = final_steps
        self.enough = enough

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        check_number(self.n_samples, "n_samples", low=100, integer=True)
        check_number(self.final_steps, "final_steps", low=1, integer=True)
        check_number(self.enough, "enough", low=0)

    def build_one(self, given: GivenPairs, i: int) -> BuiltMap:
        """Return the pairs of the map that is built for the i-th shape."""
        return _build(self, given, i)


class InSpace(_FromFew):
    """Known maps from a few landmarks for rigid shapes, which are better matched in space.

    The reference is moved by the similarity that fits the landmarks, and then deformed as little
    as possible until it meets the landmarks and the closest points of the surface. Landmarks are
    not matched exactly, since nobody places them exactly.

    Parameters
    ----------
    enough : float, default=2.0
        As in `FromLandmarks`.

    Examples
    --------
    >>> import skfmap
    >>> from skfmap.known_maps import InSpace
    >>> skfmap.WeightedFunctionalMapLearner(known_maps=InSpace()).known_maps
    InSpace()
    """

    def __init__(self, enough: float = _ENOUGH) -> None:
        self.enough = enough

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        check_number(self.enough, "enough", low=0)

    def build_one(self, given: GivenPairs, i: int) -> BuiltMap:
        """Return the pairs of the map that is built in space for the i-th shape."""
        return _laid(given, i)


class AutoKnownMaps(FromLandmarks):
    """Known maps from the given pairs if they suffice, otherwise built from the landmarks.

    Maps are built in space (`InSpace`) if a similarity explains the landmarks, and otherwise in the
    eigenbasis (`FromLandmarks`). The attribute ``known_maps_`` of the learner records the choice.
    Parameters are those of `FromLandmarks`.
    """

    def build(self, given: GivenPairs) -> list[BuiltMap]:
        """Return the pairs of the method that `kind_of` chooses."""
        kind = kind_of(given, self.enough)
        if kind == IN_SPACE:
            return InSpace(enough=self.enough).build(given)
        return PairsAsGiven().build(given) if kind == PAIRS else super().build(given)


KNOWN_MAPS: dict[str, type[KnownMaps]] = {
    "auto": AutoKnownMaps,
    PAIRS: PairsAsGiven,
    FROM_LANDMARKS: FromLandmarks,
    IN_SPACE: InSpace,
}
"""The parts that the words of the learner's parameter ``known_maps`` stand for."""


def kind_of(given: GivenPairs, enough: float = _ENOUGH) -> str:
    """Return the method that finds the known maps of a collection, as a key of `KNOWN_MAPS`.

    It is ``"pairs"`` if all shapes share enough distinct pairs with the reference. Otherwise it is
    ``"in-space"`` if a similarity explains the landmarks of most shapes, and ``"from-landmarks"``
    if not.
    """
    if all(distinct_landmarks(join) >= enough * given.k for join in given.joins):
        return PAIRS
    return IN_SPACE if _are_stiff(given) else FROM_LANDMARKS


def _are_stiff(given: GivenPairs) -> bool:
    # The smaller residual: specimens, or the reference, may be mirrored.
    left = [
        min(
            left_by_similarities(
                shape.spectral.vertices_at(join.vertices_i, join.places_i),
                given.reference.spectral.vertices_at(join.vertices_0, join.places_0),
                join.weights,
            )
        )
        for shape, join in zip(given.shapes, given.joins, strict=True)
        if distinct_landmarks(join) >= TELLING
    ]
    return bool(left) and float(np.median(left)) <= STIFF


def record_of(
    built: Sequence[BuiltMap], joins: Sequence[JoinedPairs], indices: Sequence[int], n_shapes: int
) -> KnownMapsRecord:
    """Return the record of maps that were built for some of the shapes given to `fit`."""
    kinds = [""] * n_shapes
    n_landmarks, n_pairs = np.zeros((2, n_shapes), dtype=np.int64)
    asked = [join.points for one, join in zip(built, joins, strict=True) if one.kind != PAIRS]
    points = np.unique(np.concatenate(asked)) if asked else np.empty(0, dtype=np.int64)
    errors = np.full((n_shapes, len(points)), np.nan)
    for one, join, index in zip(built, joins, indices, strict=True):
        kinds[index] = one.kind
        n_landmarks[index], n_pairs[index] = distinct_landmarks(join), len(one.pairs.points)
        if one.kind != PAIRS:
            errors[index, np.searchsorted(points, join.points)] = one.errors
    return KnownMapsRecord(kinds, n_landmarks, n_pairs, points, errors)


def told_of(
    given: GivenPairs, built: Sequence[BuiltMap], called: Sequence[str], names: Sequence[str] | None
) -> list[str]:
    """Return messages about built maps that the user should read.

    Parameters
    ----------
    given, built : GivenPairs, sequence of BuiltMap
        The data that the maps were built from, and the results.
    called : sequence of str
        Names of the shapes in messages.
    names : sequence of str or None
        Names of the template points; if None, messages give their indices.

    Returns
    -------
    list of str
        Messages about landmarks that are swapped, out of place, far from parts of the surface or in
        one plane, and about shapes that are unlike the others; empty if there is nothing to report.
    """
    rows = [i for i, one in enumerate(built) if one.kind != PAIRS]
    if not rows:
        return []
    parts = [(called[i], given.joins[i], built[i]) for i in rows]
    return [
        message
        for message in (
            _exchanged_message(parts, names),
            _out_of_place_message(parts, names),
            _unlike_message(parts),
            _far_message(parts),
            _plane_message(given, rows),
        )
        if message
    ]


_Parts = Sequence[tuple[str, JoinedPairs, BuiltMap]]


def is_on_most(n_wrong: Any, n_given: Any) -> Any:
    """Return whether a mistake is on so many shapes that it must be on the reference."""
    return (n_wrong > 1) & (2 * n_wrong > n_given)


def _exchanged_message(parts: _Parts, names: Sequence[str] | None) -> str:
    told = _of_whom(
        [
            (f"{_called(a, names)} and {_called(b, names)}", who, "")
            for who, _, one in parts
            for a, b in one.exchanged
        ],
        len(parts),
    )
    return (
        f"These landmarks seem to be swapped, because the others put each at the other's place: "
        f"{told}. They were left out; swap them back, or check the specimen."
        if told
        else ""
    )


def _out_of_place_message(parts: _Parts, names: Sequence[str] | None) -> str:
    found = []
    for who, join, one in parts:
        known = {point for pair in one.exchanged for point in pair}
        found += [
            (_called(int(join.points[q]), names), who, f" ({one.errors[q]:.2f})")
            for q in np.flatnonzero(one.wrong)
            if int(join.points[q]) not in known
        ]
    told = _of_whom(found, len(parts))
    return (
        "These landmarks are far from where the others put them, by this many sqrt(area): "
        f"{told}. They were left out; check them."
        if told
        else ""
    )


def _of_whom(found: Sequence[tuple[str, str, str]], n_shapes: int) -> str:
    """Return landmarks with their shapes; those found on most shapes belong to the reference."""
    counts = Counter(what for what, _, _ in found)
    on_most = [what for what, n in counts.items() if is_on_most(n, n_shapes)]
    told = [f"{what} of the reference" for what in on_most]
    told += [f"{what} of {who}{by}" for what, who, by in found if what not in on_most]
    return ", ".join(told)


def _unlike_message(parts: _Parts) -> str:
    parts = [part for part in parts if np.isfinite(part[2].errors).all()]
    typical = np.array([float(np.median(one.errors)) for _, _, one in parts])
    told = [
        f"{parts[i][0]} ({typical[i]:.2f})"
        for i in range(len(parts))
        if len(parts) > 2 and typical[i] > max(_DOUBTFUL, _UNLIKE * np.median(typical))
    ]
    return (
        "On these shapes, maps that are built without a landmark put it this many sqrt(area) from "
        f"its place: {', '.join(told)}; the typical value is {np.median(typical):.2f}. Check their "
        "landmarks, or leave these shapes out: they are unlike the reference, or the landmarks "
        "belong to another specimen."
        if told
        else ""
    )


def _far_message(parts: _Parts) -> str:
    gap = max(one.gap for _, _, one in parts)
    return (
        f"Parts of the reference are {gap:.1f} sqrt(area) from the nearest landmark. Known maps "
        "are guesses there, and errors at landmarks do not show how good they are. Place landmarks "
        "on all sides."
        if gap > _GAP
        else ""
    )


def _plane_message(given: GivenPairs, rows: Sequence[int]) -> str:
    spectral_0 = given.reference.spectral
    for i in rows:
        join = given.joins[i]
        at = spectral_0.place_matrix(join.vertices_0, join.places_0)
        points = np.asarray(at @ spectral_0.vertices)
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[-1] > _FLAT * spread[0]:
            return ""
    return (
        "All landmarks of the reference lie in one plane, so only oriented probes can tell one "
        "side of it from the other. Place some landmarks outside the plane."
    )


def _called(point: int, names: Sequence[str] | None) -> str:
    return f"point {point}" if names is None else repr(names[point])


def _as_given(join: JoinedPairs) -> BuiltMap:
    n, none = len(join.points), np.empty((0, 0))
    return BuiltMap(join, PAIRS, np.zeros(n, dtype=bool), np.full(n, np.nan), none, [])


def _laid(given: GivenPairs, i: int) -> BuiltMap:
    shape, reference, join = given.shapes[i], given.reference, given.joins[i]
    spectral, spectral_0 = shape.spectral, reference.spectral
    places_0 = spectral_0.place_matrix(join.vertices_0, join.places_0)
    at_0 = np.asarray(places_0 @ spectral_0.vertices)
    points = spectral.vertices_at(join.vertices_i, join.places_i)
    vertices, faces = spectral.vertices, spectral.mesh.faces
    left = left_by_similarities(points, at_0, join.weights)
    if side_of(*left) == -1:  # a mirrored specimen; its mirror image is used
        points, vertices, faces = points * MIRROR, vertices * MIRROR, faces[:, ::-1]
    task = _InSpace(spectral_0, vertices, faces, places_0, points)
    key = hash_of_arrays(
        spectral_0.vertices,
        spectral_0.mesh.faces,
        spectral_0.mass,
        vertices,
        faces,
        places_0.toarray(),
        points,
    )
    built = cached(_built_in_space, given.memory)(task, key)
    apart = np.linalg.norm(at_0[:, None] - spectral_0.vertices[built.put][None], axis=2)
    exchanged = [(int(join.points[a]), int(join.points[b])) for a, b in built.exchanged]
    missed = spectral_0.evecs[built.put] - places_0 @ spectral_0.evecs
    return BuiltMap(
        _dense(spectral, spectral_0, built.p2p, built.inverse),
        IN_SPACE,
        built.wrong,
        np.diag(apart).copy(),
        missed[~built.wrong],
        exchanged,
    )


class _InSpace(NamedTuple):
    spectral_0: SpectralShape
    vertices: FloatArray
    faces: IntArray
    places_0: SparseMatrix
    points: FloatArray


def _built_in_space(task: _InSpace, content_hash: str) -> LandmarkBuild:  # noqa: ARG001
    surface = task.vertices, task.faces
    return build_in_space(task.spectral_0, surface, task.places_0, task.points)


class _Side(NamedTuple):
    """The data of a shape that maps are built from."""

    vertices: FloatArray
    faces: IntArray
    mass: FloatArray
    evals: FloatArray
    evecs: FloatArray
    probes: FloatArray
    at: FloatArray  # eigenfunctions at the landmarks

    def samples(self, n_samples: int) -> "_Side":
        """Return the side with well-spread vertices only, and the areas that they represent."""
        if n_samples >= len(self.mass):
            return self
        rows = np.sort(farthest_points(self.vertices, n_samples))
        areas = areas_of_samples(self.vertices, self.mass, rows)
        return self._replace(vertices=self.vertices[rows], mass=areas, evecs=self.evecs[rows])

    def cut(self, n_functions: int) -> "_Side":
        """Return the side with the first eigenfunctions only."""
        n = n_functions
        return self._replace(evals=self.evals[:n], evecs=self.evecs[:, :n], at=self.at[:, :n])

    def only(self, landmarks: IntArray | BoolArray) -> "_Side":
        """Return the side with some of its landmarks only."""
        return self._replace(at=self.at[landmarks])


class _Task(NamedTuple):
    side_i: _Side
    side_0: _Side
    landmarks_0: IntArray  # vertices of S_0 nearest to its landmarks
    n_samples: int
    final_steps: int


class _Found(NamedTuple):
    p2p: IntArray
    inverse: IntArray
    wrong: BoolArray
    errors: FloatArray
    residuals: FloatArray
    exchanged: list[tuple[int, int]]  # rows of the landmarks
    gap: float


def _build(part: FromLandmarks, given: GivenPairs, i: int) -> BuiltMap:
    shape, reference, join = given.shapes[i], given.reference, given.joins[i]
    spectral, spectral_0 = shape.spectral, reference.spectral
    n = min(spectral.n_components, spectral_0.n_components)
    task = _Task(
        _side(shape, spectral.evecs_at(join.vertices_i, n, join.places_i), n),
        _side(reference, spectral_0.evecs_at(join.vertices_0, n, join.places_0), n),
        spectral_0.working_vertices(join.vertices_0),
        part.n_samples,
        part.final_steps,
    )
    key = hash_of_arrays(*task.side_i, *task.side_0, *task[2:])
    found = cached(_built_from, given.memory)(task, key)
    exchanged = [(int(join.points[a]), int(join.points[b])) for a, b in found.exchanged]
    pairs = _dense(spectral, spectral_0, found.p2p, found.inverse)
    return BuiltMap(
        pairs, FROM_LANDMARKS, found.wrong, found.errors, found.residuals, exchanged, found.gap
    )


def _side(shape: ProbedShape, at: FloatArray, n: int) -> _Side:
    mesh, spectral = shape.spectral.mesh, shape.spectral
    vertices = np.asarray(mesh.vertices / np.sqrt(mesh.area))
    evals, evecs = spectral.evals[:n], spectral.evecs[:, :n]
    return _Side(vertices, mesh.faces, spectral.mass, evals, evecs, shape.probes, at)


def _built_from(task: _Task, content_hash: str) -> _Found:  # noqa: ARG001
    """Build the dense map without landmarks that contradict the others."""
    places = _distances_between(task)
    told, wrong, exchanged = _without_wrong(task, places)
    whole = task.side_i.only(~wrong), task.side_0.only(~wrong)
    C = _grown((whole[0].samples(task.n_samples), whole[1].samples(task.n_samples)), _STEP)
    p2p, inverse = _matched(*whole, C)
    for _ in range(task.final_steps):
        p2p, inverse = _matched(*whole, _fitted(*whole, len(C), p2p, inverse))
    gap = float(places[~wrong].min(axis=0).max())
    errors = _errors(places, told)
    return _Found(p2p, inverse, wrong, errors, told.residuals[~wrong], exchanged, gap)


def _without_wrong(
    task: _Task, places: FloatArray
) -> tuple["_Told", BoolArray, list[tuple[int, int]]]:
    """Return where landmarks are put by the others, which are wrong, and which are swapped.

    A landmark is wrong if the others put it elsewhere, and the map without it has clearly less
    strain. The second condition is needed because the correct tip of a leg, when left out, may be
    put onto another leg.
    """
    wrong, exchanged = np.zeros(len(places), dtype=bool), []
    told = _left_out(task, ~wrong)
    suspects = _doubtful(_errors(places, told))
    while suspects.any() and (~(suspects | wrong)).sum() >= _FEWEST // 2:
        # Judge again by the trusted landmarks only: wrong ones cast doubt on correct ones.
        again = _left_out(task, ~(suspects | wrong))
        strain = _strain(task, ~wrong)
        pair = _exchanged(task, places, suspects, (told, again), wrong, strain)
        if pair is not None:
            wrong[list(pair)] = True
            exchanged.append(pair)
        else:
            out = wrong | _doubtful(_errors(places, again))
            if _strain(task, ~out) >= _RELIEF * strain:
                break
            wrong = out
        told = _left_out(task, ~wrong)
        suspects = _doubtful(_errors(places, told)) & ~wrong
    return told, wrong, exchanged


def _exchanged(
    task: _Task,
    places: FloatArray,
    suspects: BoolArray,
    told: Sequence["_Told"],
    wrong: BoolArray,
    strain: float,
) -> tuple[int, int] | None:
    """Return the two landmarks whose swap reduces the strain of the map most, if it does clearly.

    Each suspect is swapped with the landmarks near where it is put, and those that are still
    doubtful are swapped with one another.
    """
    tried = {
        (min(a, b), max(a, b))
        for a in np.flatnonzero(suspects & ~wrong).tolist()
        for one in told
        for b in np.argsort(places[:, one.put[a]])[:_NEAREST].tolist()
        if a != b and not wrong[b]
    }
    doubtful = np.flatnonzero(_doubtful(_errors(places, told[-1])) & ~wrong).tolist()
    tried |= set(combinations(doubtful[:_MOST_PAIRED], 2))
    strains = {}
    for a, b in sorted(tried):
        order = np.arange(len(places))
        order[[a, b]] = b, a
        turned = task._replace(side_0=task.side_0.only(order))
        strains[a, b] = _strain(turned, ~wrong)
    best = min(strains, key=lambda pair: strains[pair], default=None)
    return best if best is not None and strains[best] < _RELIEF_OF_EXCHANGE * strain else None


def _grown(sides: tuple[_Side, _Side], step: int) -> FloatArray:
    """Return the functional map in all functions of the basis, grown from the landmarks."""
    most = min(side.evecs.shape[1] for side in sides)
    first = min(_FIRST, most)
    start = map_from_landmarks(
        *(side.evals[:first] for side in sides),
        *(side.at[:, :first] for side in sides),
        *(side.probes[:first] for side in sides),
    )
    both, before = _matched(*sides, start), None
    for size in [*range(first + step // 2, most, step), most, most]:
        C = beyond(before, _fitted(*sides, size, *both))
        both, before = _matched(*sides, C), C
    return C


def _strain(task: _Task, right: BoolArray) -> float:
    """Return the mean squared distance between points of both shapes and their matches.

    Distances are measured in the embedding, under the map that is built from the landmarks in
    ``right``.
    """
    n_samples = min(task.n_samples, _SAMPLES)
    i, o = (side.only(right).samples(n_samples) for side in (task.side_i, task.side_0))
    C = _grown((i, o), _LONG_STEP)
    p2p, inverse = _matched(i, o, C)
    trust = _trust(o, len(C))
    points_i, points_0 = (i.evecs @ C) * trust, o.evecs[:, : len(C)] * trust
    there = np.square(points_i - points_0[p2p]).sum(axis=1)
    back = np.square(points_0 - points_i[inverse]).sum(axis=1)
    return float(i.mass @ there + o.mass @ back)


def _fitted(i: _Side, o: _Side, size: int, p2p: IntArray, inverse: IntArray) -> FloatArray:
    held = i.at[:, :size], o.at[:, :size]
    return map_from_point_maps(
        i.evecs[:, :size], o.evecs[:, :size], i.mass, o.mass, p2p, inverse, held
    )


def _matched(i: _Side, o: _Side, C: FloatArray) -> tuple[IntArray, IntArray]:
    k, trust = len(C), _trust(o, len(C))
    return nearest_both(
        (i.evecs[:, :k] @ C) * trust, o.evecs[:, :k] * trust, n_threads=threads_within()
    )


def _trust(side_0: _Side, k: int) -> FloatArray:
    evals = side_0.evals
    return np.asarray(1 / (1 + evals[:k] / evals[min(_HALF, len(evals) - 1)]))


class _Told(NamedTuple):
    """Where the landmarks of other groups put each landmark: vertices of S_0, and residuals."""

    put: IntArray
    residuals: FloatArray


def _left_out(task: _Task, right: BoolArray) -> _Told:
    """Return where each landmark is put by the correct landmarks of other groups."""
    side_i, side_0 = task.side_i, task.side_0
    few_i, few_0 = (side.samples(min(task.n_samples, _SAMPLES)) for side in (side_i, side_0))
    put, residuals = np.empty(len(right), dtype=np.int64), np.empty_like(side_i.at)
    trust = _trust(side_0, side_i.evecs.shape[1])
    for group in _groups(task):
        kept = right & ~np.isin(np.arange(len(right)), group)
        C = _grown((few_i.only(kept), few_0.only(kept)), _LONG_STEP)
        found = side_i.at[group] @ C
        residuals[group] = found - side_0.at[group]
        put[group] = nearest_both(found * trust, side_0.evecs * trust)[0]
    return _Told(put, residuals)


def _groups(task: _Task) -> list[IntArray]:
    """Return well-spread groups of landmarks to leave out together.

    Landmarks at the same place are in the same group.
    """
    vertices, place = np.unique(task.landmarks_0, return_inverse=True)
    rank = np.empty(len(vertices), dtype=np.int64)
    rank[farthest_points(task.side_0.vertices[vertices], len(vertices))] = np.arange(len(vertices))
    group_of = rank[place.ravel()] % _N_GROUPS
    groups = [np.flatnonzero(group_of == group) for group in range(_N_GROUPS)]
    return [group for group in groups if len(group)]


def _distances_between(task: _Task) -> FloatArray:
    """Return the distances from each landmark of S_0 to all vertices of S_0, in sqrt(area)."""
    vertices, inverse = np.unique(task.landmarks_0, return_inverse=True)
    return heat_distances(task.side_0.vertices, task.side_0.faces, vertices)[inverse.ravel()]


def _errors(places: FloatArray, told: _Told) -> FloatArray:
    return np.asarray(places[np.arange(len(places)), told.put])


def _doubtful(errors: FloatArray) -> BoolArray:
    return np.asarray(errors > max(_DOUBTFUL, _TIMES * float(np.median(errors))))


def _dense(
    spectral: SpectralShape, spectral_0: SpectralShape, p2p: IntArray, inverse: IntArray
) -> JoinedPairs:
    """Return a pair of given vertices for each working vertex that returns near itself."""
    vertices_i, vertices_0 = spectral.given_vertices(), spectral_0.given_vertices()[p2p]
    back = spectral.vertices[inverse[p2p]] - spectral.vertices
    trust = np.exp(-np.square(np.linalg.norm(back, axis=1) / _RETURNS))
    rows = np.flatnonzero((vertices_i >= 0) & (vertices_0 >= 0) & (trust > _NIL))
    return JoinedPairs(vertices_i[rows], vertices_0[rows], vertices_0[rows], trust[rows])
