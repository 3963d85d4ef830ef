"""Measured points of the training shapes, learned so that new shapes can be measured."""

from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple, Self

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
from skfmap.shapes import Landmarks, ProbedShape, SpectralShape

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
        was given, in units of sqrt(area). NaN where there is no such point.
    """

    indices: IntArray
    groups: IntArray
    missed: FloatArray

    @classmethod
    def nothing(cls, n_landmarks: int) -> Self:
        """Return that of no shape."""
        indices, groups = np.empty((2, 0), dtype=np.int64)  # two: saved models share no arrays
        return cls(indices, groups, np.empty((0, n_landmarks, 3)))

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
        stands, less what is noise (James and Stein 1961). It holds also how far from the surface an
        observer puts points.
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
        return shrunk_scales(distances) if len(distances) else None

    def radii(self, coverage: float, but: int | None = None) -> FloatArray | None:
        """Return radii that hold a share of the observer's points, shape (n_landmarks,).

        None if too few shapes were left out to promise that. ``but`` is a group that is not asked.
        """
        distances = self._distances(but)
        if len(distances) < least_calibrating(coverage):
            return None
        scales = shrunk_scales(distances)
        return pooled_quantile(distances, scales, coverage) * scales

    def _distances(self, but: int | None) -> FloatArray:
        distances, groups = self.left_out.distances, self.left_out.groups
        return distances if but is None else distances[groups != but]


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
        None if the reference has no measured points.
    """
    marks_0 = training.landmarks_0()
    if marks_0 is None:
        return None
    marks = {int(i): training.landmarks(i) for i in training.used}
    own = {i: one for i, one in marks.items() if one is not None}
    used = list(own)
    names = tuple(dict.fromkeys(chain(marks_0.names, *(one.names for one in own.values()))))
    measured = {i: _measured(one, training.shapes[i], names) for i, one in own.items()}
    measured_0 = _measured(marks_0, training.reference, names)
    n_folds = min(_FOLDS, len(used)) if left_out else 0
    if n_folds < 2:
        return _known_on_reference(names, measured_0, training.reference.spectral)
    folds = [np.array(used[f::n_folds]) for f in range(n_folds)]
    rows, spectral_0 = np.concatenate(folds), training.reference.spectral
    images = _images(training, folds, matcher)
    model = LandmarkModel(
        names,
        _voted(measured_0, [measured[i] for i in rows], images, spectral_0),
        np.zeros((len(names), 3)),
        LeftOut.nothing(len(names)),
    )
    turns = np.stack([_turns(model.places, spectral_0, at) for at in images])
    missed = np.stack(
        [
            _missed(model, spectral_0, training.shapes[i].spectral, at, measured[i])
            for i, at in zip(rows, images, strict=True)
        ]
    )
    missed_0 = np.einsum("snd,snbd->snb", missed, turns)  # as the reference stands
    groups = np.repeat(np.arange(n_folds), [len(fold) for fold in folds])
    others = np.stack([shrunk_mean(missed_0[groups != f]) for f in range(n_folds)])[groups]
    left = missed - np.einsum("snb,snbd->snd", others, turns)
    signs = [MIRROR if training.shapes[i].reflected else np.ones(3) for i in rows]
    return replace(
        model,
        offsets=shrunk_mean(missed_0),
        left_out=LeftOut(training.indices[rows], groups, left * np.array(signs)[:, None]),
    )


def _known_on_reference(
    names: tuple[str, ...], measured_0: FloatArray, spectral_0: SpectralShape
) -> LandmarkModel:
    """Return the model of the reference's landmarks alone, of which nothing is calibrated."""
    known = np.asarray(np.isfinite(measured_0).all(axis=1))
    kept = tuple(name for name, yes in zip(names, known, strict=True) if yes)
    n = len(kept)
    places = _places(measured_0[known], spectral_0)
    return LandmarkModel(kept, places, np.zeros((n, 3)), LeftOut.nothing(n))


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
    everything = np.concatenate(folds)
    return [
        replace(
            matcher,
            refinement=registration.fit_fold(
                training.only(np.setdiff1d(everything, rows)), matcher
            ),
        )
        for rows in folds
    ]


def _measured(marks: Landmarks, shape: ProbedShape, names: tuple[str, ...]) -> FloatArray:
    """Return the measured points of a shape at unit area, (n_landmarks, 3); NaN for missing ones.

    Of a shape that was reflected those of its image.
    """
    numbers = {name: number for number, name in enumerate(names)}
    points = np.full((len(names), 3), np.nan)
    at = marks.points / np.sqrt(shape.spectral.area)
    points[[numbers[name] for name in marks.names]] = at * MIRROR if shape.reflected else at
    return points


def _voted(
    measured_0: FloatArray,
    measured: list[FloatArray],
    images: list[FloatArray],
    spectral_0: SpectralShape,
) -> SparseMatrix:
    """Return the places of all landmarks on the reference.

    Those that it lacks are where they are in the median over other shapes, carried back by the
    reference's image there.
    """
    points = measured_0.copy()
    lacks = ~np.isfinite(points).all(axis=1)
    if lacks.any():
        back = np.full((len(measured), len(points), 3), np.nan)
        for t, (at, image) in enumerate(zip(measured, images, strict=True)):
            rows = np.flatnonzero(lacks & np.isfinite(at).all(axis=1))
            near = nearest_places(at[rows], image, spectral_0.mesh.faces)
            there = spectral_0.vertices[near.corners]
            back[t, rows] = np.einsum("nc,ncd->nd", near.weights, there)
        points[lacks] = np.nanmedian(back[:, lacks], axis=0)
    return _places(points, spectral_0)


def _places(points: FloatArray, spectral_0: SpectralShape) -> SparseMatrix:
    near = nearest_places(points, spectral_0.vertices, spectral_0.mesh.faces)
    rows = np.repeat(np.arange(len(points)), 3)
    return sp.coo_array(
        (near.weights.ravel(), (rows, near.corners.ravel())),
        shape=(len(points), spectral_0.mesh.n_vertices),
    ).tocsr()


def _missed(
    model: LandmarkModel,
    spectral_0: SpectralShape,
    spectral: SpectralShape,
    images: FloatArray,
    measured: FloatArray,
) -> FloatArray:
    """Return the vectors from answers to measured points, (n_landmarks, 3)."""
    surface = ClosestPoints(spectral.vertices, spectral.mesh.faces)
    return np.asarray(measured - model.points_on(spectral_0, images, surface))


def _turns(places: SparseMatrix, reference: SpectralShape, images: FloatArray) -> FloatArray:
    """Return how the surroundings of each landmark turn, rotations of shape (n_landmarks, 3, 3).

    Rows that stand as the reference does are multiplied by them from the right.
    """
    vertices = reference.vertices
    centres = np.asarray(places @ vertices)
    squared = np.square(vertices[None] - centres[:, None]).sum(axis=2)
    weights = reference.mass * np.exp(-squared / (2 * _AROUND**2))
    return np.stack([best_similarity(vertices, images, one).rotation for one in weights])
