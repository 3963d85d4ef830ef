"""A model of the measured points of training shapes, to predict landmarks on new shapes."""

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

# Training shapes are left out one at a time, or in this many groups if there are more.
_FOLDS = 10
# Width, in sqrt(area), of the surroundings of a landmark from which its rotation is estimated.
_AROUND = 0.1


class LeftOut(NamedTuple):
    """Residuals of predictions on training shapes that were left out in groups.

    Attributes
    ----------
    indices, groups : ndarray of int, shape (n_shapes,)
        Index in X of each shape, and the group that it was left out with.
    missed : ndarray of shape (n_shapes, n_landmarks, 3)
        Vectors from predictions, corrected by the mean offset of the other groups, to the
        observer's points; in the orientation in which each shape was given, in units of sqrt(area).
        NaN if there is no such point, or neither the reference nor another shape has the landmark.
    right : ndarray of bool, shape (n_shapes, n_landmarks)
        False for points that were found to be wrong when known maps were built; these are never
        used.
    """

    indices: IntArray
    groups: IntArray
    missed: FloatArray
    right: BoolArray

    @classmethod
    def nothing(cls, n_landmarks: int) -> Self:
        """Return residuals of no shape."""
        # Separate arrays, because load_model rejects files that use one array twice.
        indices, groups = (np.empty(0, dtype=np.int64) for _ in range(2))
        right = np.empty((0, n_landmarks), dtype=bool)
        return cls(indices, groups, np.empty((0, n_landmarks, 3)), right)

    @property
    def distances(self) -> FloatArray:
        """Lengths of the residuals, shape (n_shapes, n_landmarks)."""
        return np.asarray(np.linalg.norm(self.missed, axis=2))


@dataclass(frozen=True, eq=False, repr=False)
class LandmarkModel:
    """Places of the landmarks on the reference, and residuals on training shapes left out.

    Lengths are in units of sqrt(area).

    Attributes
    ----------
    names : tuple of str
        Names of the landmarks.
    places : sparse array of shape (n_landmarks, n_vertices_0)
        Places of the landmarks on the reference's working mesh, where they were measured. A
        landmark that the reference lacks is at the median of its places on the training shapes.
        Rows sum to 1.
    offsets : ndarray of shape (n_landmarks, 3)
        Mean vectors from predictions on the surface to the observer's points on training shapes
        left out, in the orientation of the reference, shrunk towards zero if there are few shapes.
        They include how far off the surface the observer puts points.
    left_out : LeftOut
        Residuals on training shapes left out; without rows if there are none.
    """

    names: tuple[str, ...]
    places: SparseMatrix
    offsets: FloatArray
    left_out: LeftOut

    def __repr__(self) -> str:
        """Return counts in one line."""
        return (
            f"LandmarkModel(n_landmarks={len(self.names)}, n_left_out={len(self.left_out.groups)})"
        )

    def points_on(
        self, reference: SpectralShape, images: FloatArray, surface: ClosestPoints
    ) -> FloatArray:
        """Return the predicted landmarks on a shape, shape (n_landmarks, 3).

        Parameters
        ----------
        reference : SpectralShape
            The reference S_0.
        images : ndarray of shape (n_vertices_0, 3)
            Positions of its working vertices on the shape, from `reference_on`.
        surface : ClosestPoints
            The surface of the shape, at unit area.
        """
        turns = _turns(self.places, reference, images)
        on_surface = surface.of(np.asarray(self.places @ images)).points
        return np.asarray(on_surface + np.einsum("nb,nbd->nd", self.offsets, turns))

    def expected_errors(self, but: int | None = None) -> FloatArray | None:
        """Return the mean distances on shapes left out, shape (n_landmarks,).

        Distances of single landmarks are shrunk towards the overall mean. None if no shape was left
        out. The group ``but`` is excluded.
        """
        distances = self._distances(but)
        return shrunk_scales(distances) if np.isfinite(distances).any() else None

    def radii(self, coverage: float, but: int | None = None) -> FloatArray | None:
        """Return radii that contain a share of the observer's points, shape (n_landmarks,).

        None if too few shapes were left out to guarantee the coverage. The group ``but`` is
        excluded.
        """
        distances = self._distances(but)
        n_told = np.isfinite(distances).any(axis=1).sum()
        if n_told < max(2, least_calibrating(coverage)):
            return None
        # The distances of each shape are scaled by the others, as those of a new shape are.
        scales = scales_of_others(distances)
        return pooled_quantile(distances, scales, coverage) * shrunk_scales(distances)

    def _distances(self, but: int | None) -> FloatArray:
        left = self.left_out
        distances = np.where(left.right, left.distances, np.nan)
        return distances if but is None else distances[left.groups != but]


def reference_on(matcher: Matcher, shape: ProbedShape) -> FloatArray:
    """Return positions of the reference's working vertices on a shape of unit area.

    They have shape (n_vertices_0, 3), and are the registered vertices, or else the vertices that
    they are matched with.
    """
    spectral, C = shape.spectral, matcher.solve(shape).C
    if isinstance(matcher.refinement, Registration):
        before = match_points(spectral, matcher.reference.spectral, C, matcher.functions)
        return matcher.refinement.vertices_on(matcher, spectral, before)
    return np.asarray(spectral.vertices[matcher.match_points(shape, C)[1].inverse])


def learn_landmarks(
    training: TrainingSet, matcher: Matcher, *, left_out: bool = True
) -> LandmarkModel | None:
    """Fit the landmark model, with residuals from shapes that are left out in turn.

    Parameters
    ----------
    training : TrainingSet
        Shapes whose correspondences have ``coordinates``, including the reference.
    matcher : Matcher
        Matcher learned from all of them.
    left_out : bool
        Whether shapes are left out. Otherwise, as with a single shape, there are no offsets and no
        expected errors.

    Returns
    -------
    LandmarkModel or None
        Landmarks are in the order of the template. None if the reference has no measured points.

    Notes
    -----
    Landmarks that were left out as wrong when known maps were built are not used, nor are shapes
    that are mirror images of the others and were not reflected. If the reference lacks a landmark,
    only shapes that are not left out determine its place.
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
    points_0 = _voted(_voted(measured_0, trusted), back)  # from wrong points if there are no others
    missed, turns = np.full((len(rows), n, 3), np.nan), np.empty((len(rows), n, 3, 3))
    for f in range(n_folds):
        by_others = _voted(measured_0, trusted[groups != f])
        told = np.asarray(np.isfinite(by_others).all(axis=1))  # place known without this group
        places = _places(np.where(told[:, None], by_others, points_0), spectral_0)
        for row in np.flatnonzero(groups == f):
            i, image = rows[row], images[row]
            off = _missed(places, training.shapes[i].spectral, image, measured[i])
            missed[row] = np.where(told[:, None], off, np.nan)
            turns[row] = _turns(places, spectral_0, image)
    missed_0 = np.einsum("snd,snbd->snb", missed, turns)  # in the orientation of the reference
    missed_0[~right] = np.nan
    others = np.stack([shrunk_mean(missed_0[groups != f]) for f in range(n_folds)])[groups]
    left = missed - np.einsum("snb,snbd->snd", others, turns)
    signs = np.array([MIRROR if training.shapes[i].reflected else np.ones(3) for i in rows])
    seen = LeftOut(training.indices[rows], groups, left * signs[:, None], right)
    return LandmarkModel(names, _places(points_0, spectral_0), shrunk_mean(missed_0), seen)


def _counts(training: TrainingSet, i: int) -> bool:
    """Return whether a training shape was measured, and is not a mirror image of the others."""
    known = training.shapes[i], training.reference, training.joins[i], training.known[i]
    return training.truths[i].coordinates is not None and not is_against(*known)


def _called(truths: list[Correspondence]) -> dict[int, str]:
    """Return the names of template points that at least one shape has, in their order."""
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
    """Return the landmarks on the reference, using the matcher learned from all shapes."""
    lacks = ~np.isfinite(measured_0).all(axis=1)
    asked = [i for i, at in measured.items() if np.isfinite(at[lacks]).any()]
    images = [reference_on(matcher, training.shapes[i]) for i in asked]
    at = [measured[i] for i in asked]
    return _voted(measured_0, _carried_back(measured_0, at, images, training.reference.spectral))


def _images(training: TrainingSet, folds: list[IntArray], matcher: Matcher) -> list[FloatArray]:
    """Return the reference on each shape, using the matcher learned without its fold."""
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
    """Return the matchers learned without each fold.

    For rigid shapes, whose registration starts in space, only the deformation is learned again.
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

    For a reflected shape they are those of its mirror image.
    """
    points = np.full((len(numbers), 3), np.nan)
    at = np.asarray(truth.coordinates) / np.sqrt(shape.spectral.area)
    at = at * MIRROR if shape.reflected else at
    points[np.searchsorted(numbers, truth.pairs[:, 1])] = at
    return points


def _right(training: TrainingSet, i: int, numbers: IntArray) -> BoolArray:
    """Return which landmarks of a training shape were not found to be wrong.

    A landmark that is wrong on most shapes is wrong on the reference, and correct on the shapes.
    """
    wrong = training.joins[i].points[training.wrong[i]]
    return np.isin(numbers, np.setdiff1d(wrong, training.wrong_on_reference()), invert=True)


def _carried_back(
    measured_0: FloatArray,
    measured: list[FloatArray],
    images: list[FloatArray],
    spectral_0: SpectralShape,
) -> FloatArray:
    """Return places on the reference of the landmarks that it lacks, one per shape; else NaN.

    The result has shape (n_shapes, n_landmarks, 3). Landmarks are carried back from the image of
    the reference on each shape.
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
    """Return landmarks on the reference; missing ones are medians, or NaN if no shape has them."""
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
    """Return the vectors from predictions to measured points, shape (n_landmarks, 3)."""
    surface = ClosestPoints(spectral.vertices, spectral.mesh.faces)
    return np.asarray(measured - surface.of(np.asarray(places @ images)).points)


def _turns(places: SparseMatrix, reference: SpectralShape, images: FloatArray) -> FloatArray:
    """Return the rotation of the surroundings of each landmark, shape (n_landmarks, 3, 3).

    Row vectors in the orientation of the reference are multiplied by them from the right.
    """
    vertices = reference.vertices
    centres = np.asarray(places @ vertices)
    squared = np.square(vertices[None] - centres[:, None]).sum(axis=2)
    weights = reference.mass * np.exp(-squared / (2 * _AROUND**2))
    return np.stack([best_similarity(vertices, images, one).rotation for one in weights])
