"""Measured points of the training shapes, learned so that new shapes can be measured."""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
import scipy.sparse as sp

from skfmap._tools.parallel import map_shapes
from skfmap._tools.types import BoolArray, FloatArray, IntArray, SparseMatrix
from skfmap.functional.left_out import (
    least_calibrating,
    pooled_quantile,
    scales_of_others,
    shrunk_mean,
    shrunk_scales,
)
from skfmap.functional.similarity import MIRROR, best_similarity
from skfmap.geometry.closest import ClosestPoints, nearest_places
from skfmap.learner.confidence import matchers_without
from skfmap.learner.matcher import Matcher
from skfmap.learner.mirrored import is_against
from skfmap.learner.training_set import TrainingSet
from skfmap.refinement import match_points
from skfmap.registration import Registration
from skfmap.shapes import Correspondence, ProbedShape, SpectralShape

__all__ = ["LandmarkModel", "LeftOut", "learn_landmarks", "reference_on"]

# Training shapes are left out one at a time, or in so many groups where there are more.
_FOLDS = 10
# Width, in sqrt(area), of the surroundings of a landmark that tell how it has turned.
_AROUND = 0.1


class LeftOut(NamedTuple):
    """What answers missed on training shapes that were left out in groups.

    Attributes
    ----------
    indices, groups : ndarray of int, shape (n_shapes,)
        Index in X of each shape, and the group that it was left out with.
    missed : ndarray of shape (n_shapes, n_landmarks, 3)
        From answers, moved by what the other groups lack, to the observer's points; as each shape
        was given, in units of sqrt(area). NaN where there is no such point, or no other shape and
        not the reference tells where it should be.
    right : ndarray of bool, shape (n_shapes, n_landmarks)
        False for points that were found to be wrong when known maps were built; they count nowhere.
    """

    indices: IntArray
    groups: IntArray
    missed: FloatArray
    right: BoolArray

    @classmethod
    def nothing(cls, n_landmarks: int) -> Self:
        """Return that of no shape."""
        # Each an array of its own: one array in two places is not read from a file again.
        indices, groups = (np.empty(0, dtype=np.int64) for _ in range(2))
        right = np.empty((0, n_landmarks), dtype=bool)
        return cls(indices, groups, np.empty((0, n_landmarks, 3)), right)

    @property
    def distances(self) -> FloatArray:
        """Lengths of what was missed, shape (n_shapes, n_landmarks)."""
        return np.asarray(np.linalg.norm(self.missed, axis=2))


@dataclass(frozen=True, eq=False, repr=False)
class LandmarkModel:
    """Where the landmarks are on the reference, and what answers lack on shapes left out.

    Lengths are in units of sqrt(area).

    Attributes
    ----------
    names : tuple of str
        Of the landmarks.
    places : sparse array of shape (n_landmarks, n_vertices_0)
        Where they are on the reference's working mesh: where they were measured there, or where
        most training shapes have those that the reference lacks. Rows sum to 1.
    offsets : ndarray of shape (n_landmarks, 3)
        What the surface's answers lack in the mean on training shapes left out, as the reference
        stands, shrunk where these are few. It holds also how far from the surface an observer puts
        points.
    left_out : LeftOut
        What answers missed on training shapes left out; without rows if none were.
    """

    names: tuple[str, ...]
    places: SparseMatrix
    offsets: FloatArray
    left_out: LeftOut

    def __repr__(self) -> str:
        """Return a line with counts."""
        return (
            f"LandmarkModel(n_landmarks={len(self.names)}, n_left_out={len(self.left_out.groups)})"
        )

    def points_on(
        self, reference: SpectralShape, images: FloatArray, surface: ClosestPoints
    ) -> FloatArray:
        """Return the landmarks on a shape, shape (n_landmarks, 3).

        Parameters
        ----------
        reference : SpectralShape
            S_0.
        images : ndarray of shape (n_vertices_0, 3)
            Where its working vertices are on the shape; from `reference_on`.
        surface : ClosestPoints
            The shape, of unit area.
        """
        turns = _turns(self.places, reference, images)
        on_surface = surface.of(np.asarray(self.places @ images)).points
        return np.asarray(on_surface + np.einsum("nb,nbd->nd", self.offsets, turns))

    def expected_errors(self, but: int | None = None) -> FloatArray | None:
        """Return the mean distances on shapes left out, shape (n_landmarks,).

        Those of single landmarks are drawn towards the mean of all. None if no shape was left out.
        ``but`` is a group that is not asked.
        """
        distances = self._distances(but)
        return shrunk_scales(distances) if np.isfinite(distances).any() else None

    def radii(self, coverage: float, but: int | None = None) -> FloatArray | None:
        """Return radii that hold a share of the observer's points, shape (n_landmarks,).

        None if too few shapes were left out to promise that. ``but`` is a group that is not asked.
        """
        distances = self._distances(but)
        n_told = np.isfinite(distances).any(axis=1).sum()
        if n_told < max(2, least_calibrating(coverage)):
            return None
        # As that of a new shape, the distances of each are measured by what others say.
        scales = scales_of_others(distances)
        return pooled_quantile(distances, scales, coverage) * shrunk_scales(distances)

    def _distances(self, but: int | None) -> FloatArray:
        left = self.left_out
        distances = np.where(left.right, left.distances, np.nan)
        return distances if but is None else distances[left.groups != but]


def reference_on(matcher: Matcher, shape: ProbedShape) -> FloatArray:
    """Return where the reference's working vertices are on a shape of unit area.

    Its shape is (n_vertices_0, 3): registered vertices, or the vertices that they are matched with.
    """
    spectral, C = shape.spectral, matcher.solve(shape).C
    if isinstance(matcher.refinement, Registration):
        before = match_points(spectral, matcher.reference.spectral, C, matcher.functions)
        return matcher.refinement.vertices_on(matcher, spectral, before)
    return np.asarray(spectral.vertices[matcher.match_points(shape, C)[1].inverse])


def learn_landmarks(
    training: TrainingSet, matcher: Matcher, *, left_out: bool = True
) -> LandmarkModel | None:
    """Learn where measured points are, from shapes that are left out in turn.

    Parameters
    ----------
    training : TrainingSet
        Shapes whose correspondences have ``coordinates``, including the reference's.
    matcher : Matcher
        What was learned from all of them.
    left_out : bool
        Whether shapes are left out: without, as with a single shape, there are neither offsets nor
        errors to expect.

    Returns
    -------
    LandmarkModel or None
        Landmarks are in the order of the template. None if the reference has no measured points.

    Notes
    -----
    Landmarks that were left out as wrong when known maps were built do not count, nor do shapes
    that are mirror images of the others and were not reflected. Where the
    reference lacks a landmark, its place is told by others than the shapes that are left out.
    """
    truth_0, spectral_0 = training.truth_0, training.reference.spectral
    if truth_0.coordinates is None:
        return None
    used = [int(i) for i in training.used if _counts(training, int(i))]
    called = _called([truth_0, *(training.truths[i] for i in used)])
    numbers, names = np.array(list(called)), tuple(called.values())
    measured = {i: _measured(training.truths[i], training.shapes[i], numbers) for i in used}
    measured_0 = _measured(truth_0, training.reference, numbers)
    measured_0[np.isin(numbers, training.wrong_on_reference())] = np.nan
    n_folds = min(_FOLDS, len(used)) if left_out else 0
    if n_folds < 2:
        points_0 = _on_reference(training, matcher, measured_0, measured)
        places, nothing = _places(points_0, spectral_0), LeftOut.nothing(len(names))
        return LandmarkModel(names, places, np.zeros((len(names), 3)), nothing)
    folds = [np.array(used[f::n_folds]) for f in range(n_folds)]
    rows, n = np.concatenate(folds), len(names)
    groups = np.repeat(np.arange(n_folds), [len(fold) for fold in folds])
    right = np.stack([_right(training, i, numbers) for i in rows])
    images = _images(training, folds, matcher)
    back = _carried_back(measured_0, [measured[i] for i in rows], images, spectral_0)
    trusted = np.where(right[:, :, None], back, np.nan)
    points_0 = _voted(_voted(measured_0, trusted), back)  # of wrong ones where there are no others
    missed, turns = np.full((len(rows), n, 3), np.nan), np.empty((len(rows), n, 3, 3))
    for f in range(n_folds):
        by_others = _voted(measured_0, trusted[groups != f])
        told = np.asarray(np.isfinite(by_others).all(axis=1))  # others put it on the reference
        places = _places(np.where(told[:, None], by_others, points_0), spectral_0)
        for row in np.flatnonzero(groups == f):
            i, image = rows[row], images[row]
            off = _missed(places, training.shapes[i].spectral, image, measured[i])
            missed[row] = np.where(told[:, None], off, np.nan)
            turns[row] = _turns(places, spectral_0, image)
    missed_0 = np.einsum("snd,snbd->snb", missed, turns)  # as the reference stands
    missed_0[~right] = np.nan
    others = np.stack([shrunk_mean(missed_0[groups != f]) for f in range(n_folds)])[groups]
    left = missed - np.einsum("snb,snbd->snd", others, turns)
    signs = np.array([MIRROR if training.shapes[i].reflected else np.ones(3) for i in rows])
    seen = LeftOut(training.indices[rows], groups, left * signs[:, None], right)
    return LandmarkModel(names, _places(points_0, spectral_0), shrunk_mean(missed_0), seen)


def _counts(training: TrainingSet, i: int) -> bool:
    """Tell whether a training shape was measured, and is not the mirror image of the others."""
    known = training.shapes[i], training.reference, training.joins[i], training.known[i]
    return training.truths[i].coordinates is not None and not is_against(*known)


def _called(truths: list[Correspondence]) -> dict[int, str]:
    """Return the names of template points that one shape has at least, in their order."""
    called: dict[int, str] = {}
    for truth in truths:
        if truth.landmarks is not None:
            called |= dict(zip(truth.pairs[:, 1].tolist(), truth.landmarks.names, strict=True))
    return dict(sorted(called.items()))


def _on_reference(
    training: TrainingSet,
    matcher: Matcher,
    measured_0: FloatArray,
    measured: dict[int, FloatArray],
) -> FloatArray:
    """Return the landmarks on the reference, where nothing is left out, by what was learned."""
    lacks = ~np.isfinite(measured_0).all(axis=1)
    asked = [i for i, at in measured.items() if np.isfinite(at[lacks]).any()]
    images = [reference_on(matcher, training.shapes[i]) for i in asked]
    at = [measured[i] for i in asked]
    return _voted(measured_0, _carried_back(measured_0, at, images, training.reference.spectral))


def _images(training: TrainingSet, folds: list[IntArray], matcher: Matcher) -> list[FloatArray]:
    """Return the reference on each shape of each fold, by what was learned without the fold."""
    arguments = (
        (one, training.shapes[i])
        for one, rows in zip(_matchers(training, folds, matcher), folds, strict=True)
        for i in rows
    )
    images: list[FloatArray] = map_shapes(
        reference_on, arguments, n_jobs=training.n_jobs, verbose=0, prefer="threads"
    )
    return images


def _matchers(training: TrainingSet, folds: list[IntArray], matcher: Matcher) -> list[Matcher]:
    """Return what is learned without each fold.

    Where shapes are stiff, the start is found in space, and only the deformation is learned anew.
    """
    registration = matcher.refinement
    if not (isinstance(registration, Registration) and registration.pose_ == "similarity"):
        return matchers_without(training, folds, matcher)
    return [
        replace(
            matcher,
            refinement=registration.fit_fold(
                training.only(np.setdiff1d(training.used, rows)), matcher
            ),
        )
        for rows in folds
    ]


def _measured(truth: Correspondence, shape: ProbedShape, numbers: IntArray) -> FloatArray:
    """Return the measured points of a shape at unit area, (n_landmarks, 3); NaN for missing ones.

    Of a shape that was reflected those of its image.
    """
    points = np.full((len(numbers), 3), np.nan)
    at = np.asarray(truth.coordinates) / np.sqrt(shape.spectral.area)
    at = at * MIRROR if shape.reflected else at
    points[np.searchsorted(numbers, truth.pairs[:, 1])] = at
    return points


def _right(training: TrainingSet, i: int, numbers: IntArray) -> BoolArray:
    """Return which landmarks of a training shape were not found to be wrong.

    What is wrong on most shapes is so on the reference, and right on these.
    """
    wrong = training.joins[i].points[training.wrong[i]]
    return np.isin(numbers, np.setdiff1d(wrong, training.wrong_on_reference()), invert=True)


def _carried_back(
    measured_0: FloatArray,
    measured: list[FloatArray],
    images: list[FloatArray],
    spectral_0: SpectralShape,
) -> FloatArray:
    """Return where shapes have, on the reference, the landmarks that it lacks; NaN elsewhere.

    Its shape is (n_shapes, n_landmarks, 3): each is carried back by the reference's image.
    """
    lacks = ~np.isfinite(measured_0).all(axis=1)
    back = np.full((len(measured), len(measured_0), 3), np.nan)
    for t, (at, image) in enumerate(zip(measured, images, strict=True)):
        rows = np.flatnonzero(lacks & np.isfinite(at).all(axis=1))
        if len(rows):
            near = nearest_places(at[rows], image, spectral_0.mesh.faces)
            there = spectral_0.vertices[near.corners]
            back[t, rows] = np.einsum("nc,ncd->nd", near.weights, there)
    return back


def _voted(points_0: FloatArray, back: FloatArray) -> FloatArray:
    """Return landmarks on the reference; those that it lacks in the median, or NaN if none has."""
    points = points_0.copy()
    seen = np.isnan(points_0).any(axis=1) & np.isfinite(back).all(axis=2).any(axis=0)
    points[seen] = np.nanmedian(back[:, seen], axis=0)
    return points


def _places(points: FloatArray, spectral_0: SpectralShape) -> SparseMatrix:
    near = nearest_places(points, spectral_0.vertices, spectral_0.mesh.faces)
    rows = np.repeat(np.arange(len(points)), 3)
    return sp.coo_array(
        (near.weights.ravel(), (rows, near.corners.ravel())),
        shape=(len(points), spectral_0.mesh.n_vertices),
    ).tocsr()


def _missed(
    places: SparseMatrix,
    spectral: SpectralShape,
    images: FloatArray,
    measured: FloatArray,
) -> FloatArray:
    """Return the vectors from answers to measured points, (n_landmarks, 3)."""
    surface = ClosestPoints(spectral.vertices, spectral.mesh.faces)
    return np.asarray(measured - surface.of(np.asarray(places @ images)).points)


def _turns(places: SparseMatrix, reference: SpectralShape, images: FloatArray) -> FloatArray:
    """Return how the surroundings of each landmark turn, rotations of shape (n_landmarks, 3, 3).

    Rows that stand as the reference does are multiplied by them from the right.
    """
    vertices = reference.vertices
    centres = np.asarray(places @ vertices)
    squared = np.square(vertices[None] - centres[:, None]).sum(axis=2)
    weights = reference.mass * np.exp(-squared / (2 * _AROUND**2))
    return np.stack([best_similarity(vertices, images, one).rotation for one in weights])
