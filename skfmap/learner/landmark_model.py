"""Measured points of the training shapes, learned so that new shapes can be measured."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from skfmap._tools.parallel import map_shapes
from skfmap._tools.types import FloatArray, IntArray, SparseMatrix
from skfmap.functional.left_out import (
    least_calibrating,
    pooled_quantile,
    shrunk_mean,
    shrunk_scales,
)
from skfmap.functional.similarity import MIRROR, best_similarity
from skfmap.geometry.closest import ClosestPoints, nearest_places
from skfmap.learner.confidence import matchers_without
from skfmap.learner.matcher import Matcher
from skfmap.learner.training_set import TrainingSet
from skfmap.refinement import match_points
from skfmap.registration import Registration
from skfmap.shapes import Correspondence, ProbedShape, SpectralShape

__all__ = ["LandmarkModel", "learn_landmarks", "reference_on"]

# Training shapes are left out one at a time, or in so many groups where there are more.
_FOLDS = 10
# Width, in sqrt(area), of the surroundings of a landmark that tell how it has turned.
_AROUND = 0.1


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
        stands, less what is noise (James and Stein 1961). It holds also how far from the surface an
        observer puts points.
    distances : ndarray of shape (n_shapes, n_landmarks)
        Of answers from the observer's points on training shapes left out, with what the others
        lack; NaN where there is no such point. Without rows if none were left out.
    """

    names: tuple[str, ...]
    places: SparseMatrix
    offsets: FloatArray
    distances: FloatArray

    def __repr__(self) -> str:
        """Return a line with counts."""
        return f"LandmarkModel(n_landmarks={len(self.names)}, n_left_out={len(self.distances)})"

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

    def expected_errors(self) -> FloatArray | None:
        """Return the mean distances on shapes left out, shape (n_landmarks,).

        Those of single landmarks are drawn towards the mean of all. None if no shape was left out.
        """
        return shrunk_scales(self.distances) if np.isfinite(self.distances).any() else None

    def radii(self, coverage: float) -> FloatArray | None:
        """Return radii that hold a share of the observer's points, shape (n_landmarks,).

        None if too few shapes were left out to promise that.
        """
        if np.isfinite(self.distances).any(axis=1).sum() < least_calibrating(coverage):
            return None
        scales = shrunk_scales(self.distances)
        return pooled_quantile(self.distances, scales, coverage) * scales


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
        Shapes whose correspondences have ``coordinates``, the reference's among them.
    matcher : Matcher
        What was learned from all of them.
    left_out : bool
        Whether shapes are left out: without, there are neither offsets nor errors to expect.

    Returns
    -------
    LandmarkModel or None
        Landmarks are in the order of the template. None if the reference has no measured points.

    Notes
    -----
    Landmarks that were left out as wrong when known maps were built do not count. Where the
    reference lacks a landmark, its place is told by others than the shapes that are left out.
    """
    truth_0, spectral_0 = training.truth_0, training.reference.spectral
    if truth_0.coordinates is None:
        return None
    used = [int(i) for i in training.used if training.truths[i].coordinates is not None]
    called = _called([truth_0, *(training.truths[i] for i in used)])
    numbers, names = np.array(list(called)), tuple(called.values())
    measured = {i: _of_training(training, i, numbers) for i in used}
    measured_0 = _measured(truth_0, training.reference, numbers)
    n_folds = min(_FOLDS, len(used)) if left_out else 0
    if n_folds < 2:
        return _known_on_reference(names, measured_0, spectral_0)
    folds = [np.array(used[f::n_folds]) for f in range(n_folds)]
    rows = np.concatenate(folds)
    fold_of = np.repeat(np.arange(n_folds), [len(fold) for fold in folds])
    images = _images(training, folds, matcher)
    back = _carried_back(measured_0, [measured[i] for i in rows], images, spectral_0)
    points_0 = _voted(measured_0, back)
    missed = np.full((len(rows), len(names), 3), np.nan)
    for f in range(n_folds):
        by_others = _voted(measured_0, back[fold_of != f])
        told = np.asarray(np.isfinite(by_others).all(axis=1))  # others put it on the reference
        places = _places(np.where(told[:, None], by_others, points_0), spectral_0)
        for row in np.flatnonzero(fold_of == f):
            i = rows[row]
            off = _missed(places, spectral_0, training.shapes[i].spectral, images[row], measured[i])
            missed[row] = np.where(told[:, None], off, np.nan)
    others = np.stack([shrunk_mean(missed[fold_of != f]) for f in range(n_folds)])
    distances = np.linalg.norm(missed - others[fold_of], axis=2)
    return LandmarkModel(names, _places(points_0, spectral_0), shrunk_mean(missed), distances)


def _called(truths: list[Correspondence]) -> dict[int, str]:
    """Return the names of template points that one shape has at least, in their order."""
    called: dict[int, str] = {}
    for truth in truths:
        if truth.landmarks is not None:
            called |= dict(zip(truth.pairs[:, 1].tolist(), truth.landmarks.names, strict=True))
    return dict(sorted(called.items()))


def _known_on_reference(
    names: tuple[str, ...], measured_0: FloatArray, spectral_0: SpectralShape
) -> LandmarkModel:
    """Return the model of the reference's landmarks alone, of which nothing is calibrated."""
    known = np.asarray(np.isfinite(measured_0).all(axis=1))
    kept = tuple(name for name, yes in zip(names, known, strict=True) if yes)
    n = len(kept)
    places = _places(measured_0[known], spectral_0)
    return LandmarkModel(kept, places, np.zeros((n, 3)), np.empty((0, n)))


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


def _of_training(training: TrainingSet, i: int, numbers: IntArray) -> FloatArray:
    """Return the measured points of a training shape, NaN for those that were found to be wrong."""
    points = _measured(training.truths[i], training.shapes[i], numbers)
    wrong = training.joins[i].points[training.found_wrong(i)]
    points[np.searchsorted(numbers, wrong)] = np.nan
    return points


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


def _voted(measured_0: FloatArray, back: FloatArray) -> FloatArray:
    """Return landmarks on the reference; those that it lacks in the median, or NaN if none has."""
    points = measured_0.copy()
    seen = np.isfinite(back).all(axis=2).any(axis=0)
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
    spectral_0: SpectralShape,
    spectral: SpectralShape,
    images: FloatArray,
    measured: FloatArray,
) -> FloatArray:
    """Return the vectors from answers to measured points, as the reference stands."""
    surface = ClosestPoints(spectral.vertices, spectral.mesh.faces)
    off = measured - surface.of(np.asarray(places @ images)).points
    return np.asarray(np.einsum("nd,nbd->nb", off, _turns(places, spectral_0, images)))


def _turns(places: SparseMatrix, reference: SpectralShape, images: FloatArray) -> FloatArray:
    """Return how the surroundings of each landmark turn, rotations of shape (n_landmarks, 3, 3).

    Rows that stand as the reference does are multiplied by them from the right.
    """
    vertices = reference.vertices
    centres = np.asarray(places @ vertices)
    squared = np.square(vertices[None] - centres[:, None]).sum(axis=2)
    weights = reference.mass * np.exp(-squared / (2 * _AROUND**2))
    return np.stack([best_similarity(vertices, images, one).rotation for one in weights])
