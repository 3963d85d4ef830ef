"""Prediction of landmarks on new shapes."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.functional.similarity import MIRROR
from skfmap.geometry.closest import ClosestPoints
from skfmap.learner.confidence import Confidence
from skfmap.learner.given_answers import given_surface
from skfmap.learner.landmark_model import LandmarkModel
from skfmap.learner.matcher import Matcher, Solution
from skfmap.refinement import match_points
from skfmap.registration import Registration
from skfmap.shapes import Landmarks, ProbedShape, SkippedShape

__all__ = ["LandmarkPredictor", "Measured"]


class Measured(NamedTuple):
    """Landmarks of a shape, the solution of equation (2), and whether the shape is familiar."""

    landmarks: Landmarks
    solution: Solution
    fits: bool


@dataclass(frozen=True, eq=False)
class LandmarkPredictor:
    """Predictor of landmarks on the given meshes of new shapes.

    Attributes
    ----------
    model, matcher, confidence : LandmarkModel, Matcher, Confidence or None
        The fitted objects.
    coverage : float
        Share of the observer's points that balls with the radii should contain.
    on_surface : bool
        Whether points that the observer puts off the surface are put onto it.
    """

    model: LandmarkModel
    matcher: Matcher
    confidence: Confidence | None
    coverage: float
    on_surface: bool

    def of(self, shape: ProbedShape) -> Measured:
        """Return the landmarks of a shape, and whether it is like the training shapes.

        If it is not, expected errors are NaN.
        """
        images, solution, fits = self._images(shape)
        scale = np.sqrt(shape.spectral.area)
        signs = MIRROR if shape.reflected else np.ones(3)
        vertices, faces = given_surface(shape.spectral)
        surface = ClosestPoints(vertices * signs / scale, faces)
        points = self.model.points_on(self.matcher.reference.spectral, images, surface)
        if self.on_surface:
            points = surface.of(points).points
        told = self._told(points * signs * scale, shape.name, scale, fits=fits)
        return Measured(told, solution, fits)

    def nowhere(self, shape: SkippedShape) -> Landmarks:
        """Return the answer for a shape that cannot be used: NaN."""
        points = np.full((len(self.model.names), 3), np.nan)
        return self._told(points, shape.name, np.nan, fits=False)

    def _told(self, points: FloatArray, name: str | None, scale: float, *, fits: bool) -> Landmarks:
        errors, radii = self.model.expected_errors(), self.model.radii(self.coverage)
        known = scale if fits else np.nan
        return Landmarks(
            points,
            self.model.names,
            name=name,
            expected_error=None if errors is None else known * errors,
            radius=None if radii is None else known * radii,
            coverage=None if radii is None else self.coverage,
        )

    def _images(self, shape: ProbedShape) -> tuple[FloatArray, Solution, bool]:
        """Return positions of the reference's vertices, the solution, and whether they fit."""
        matcher, spectral = self.matcher, shape.spectral
        solution, registration = matcher.solve(shape, mirrored=True), matcher.refinement
        if isinstance(registration, Registration):
            functions = matcher.functions
            before = match_points(spectral, matcher.reference.spectral, solution.C, functions)
            laid = registration.lay(matcher, spectral, before)
            return laid.vertices, solution, laid.fits
        before, after = matcher.match_points(shape, solution.C)
        fits = True
        if self.confidence is not None:
            refined = registration is not None
            fits = self.confidence.assess(
                matcher, shape, solution, before, after, refined=refined
            ).familiar
        return np.asarray(spectral.vertices[after.inverse]), solution, fits
