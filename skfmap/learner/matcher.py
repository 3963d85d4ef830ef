"""The fitted state that matches new shapes: equation (2), section 4.2, and refinement."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from skfmap._tools.types import Array, FloatArray, IntArray
from skfmap.functional.fmap import MapEquation
from skfmap.functional.learning import LearnedMaps
from skfmap.functional.normalization import scale_by
from skfmap.functional.regularization import penalty_of
from skfmap.functional.residuals import residual_covariance, trusted_functions
from skfmap.learner.mirrored import odd_probes, spatial_probes
from skfmap.learner.training_set import TrainingSet
from skfmap.refinement import PointMatch, Refinement, match_points
from skfmap.shapes import ProbedShape

__all__ = ["MATCHINGS", "Matcher", "Settings", "Solution", "embedding_distance"]

MATCHINGS = ("soft", "cut")


class Settings(NamedTuple):
    """Parameters that the weights were fitted with; changing them takes effect at the next fit."""

    alpha: float
    normalize: str
    regularizer: str | Callable[[FloatArray, FloatArray], FloatArray]
    matching: str
    n_stable: int


class Solution(NamedTuple):
    """Solution of equation (2) for a shape: X_i(D), its residual, and that of the mirror image.

    If there are coordinate probes, whose change depends on the plane of the reflection, both are
    compared without them: ``upright_residual`` is then the residual of the shape without these
    probes.
    """

    C: FloatArray
    residual: float
    mirrored_residual: float
    upright_residual: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Matcher:
    """The learned state that is needed to match a new shape.

    Attributes
    ----------
    reference : ProbedShape
        The reference S_0.
    weights : ndarray of shape (m,)
        Diagonal of D.
    stable_basis : ndarray of shape (k, k)
        The stable basis Y.
    residual_covariance, truncation_covariance : ndarray
        Covariances of how far learned maps, and known maps in all functions of the basis, put the
        points of training shapes from where they belong.
    settings : Settings
        How equation (2) is set up, and which functions points are matched in.
    refinement : Refinement or None
        The refinement of matches.
    """

    reference: ProbedShape
    weights: FloatArray
    stable_basis: FloatArray
    residual_covariance: FloatArray
    truncation_covariance: FloatArray
    settings: Settings
    refinement: Refinement | None = None

    @classmethod
    def from_learned(
        cls,
        training: TrainingSet,
        learned: LearnedMaps,
        *,
        matching: str,
        n_stable: int,
        refinement: Refinement | None = None,
    ) -> Self:
        """Create a matcher from the maps that were learned from a training set.

        Parameters
        ----------
        training : TrainingSet
            The training set; shapes with share 0 are not used.
        learned : LearnedMaps
            The maps that were learned from it.
        matching, n_stable : str, int
            Parameters of the learner; here ``n_stable`` is the number p.
        refinement : Refinement, optional
            The refinement of matches.

        Returns
        -------
        Matcher
            The matcher.
        """
        rows = training.used
        residuals = [_residuals(training, i, learned.maps[i]) for i in rows]
        options, share = training.options, training.share[rows]
        return cls(
            reference=training.reference,
            weights=learned.weights,
            stable_basis=learned.stable_basis,
            residual_covariance=np.average(residuals, axis=0, weights=share),
            truncation_covariance=training.truncation(),
            settings=Settings(
                options.alpha, options.normalize, learned.regularizer, matching, n_stable
            ),
            refinement=refinement,
        )

    def __repr__(self) -> str:
        """Return the reference, the number of functions and the refinement in one line."""
        k = len(self.stable_basis)
        return f"Matcher({self.reference.name!r}, k={k}, refinement={self.refinement!r})"

    @property
    def probe_names(self) -> Array:
        """Name of each probe function; an object array of shape (m,)."""
        return np.array(self.reference.probe_names, dtype=object)

    @property
    def probe_categories(self) -> Array:
        """Family of each probe function; an object array of shape (m,)."""
        return np.array(self.reference.probe_categories, dtype=object)

    @property
    def functions(self) -> FloatArray:
        """Coefficients of the functions that points are matched in, shape (k, k) or (k, p)."""
        if self.settings.matching == "cut":
            return self.stable_basis[:, : self.settings.n_stable]
        return trusted_functions(self.residual_covariance)

    def solve(self, shape: ProbedShape, *, mirrored: bool = False) -> Solution:
        """Solve equation (2) for a shape, and optionally for its mirror image.

        Mirroring only changes the sign of oriented probes on the right-hand side, so the same
        factorisation solves both. If there are coordinate probes, these are left out of the
        comparison.

        Parameters
        ----------
        shape : ProbedShape
            The shape S_i.
        mirrored : bool, default=False
            Whether to solve for the mirror image too.

        Returns
        -------
        Solution
            X_i(D), which pulls functions on S_0 back to S_i, and the residuals of (2).
        """
        k, spectral_0 = len(self.stable_basis), self.reference.spectral
        alpha, normalize, regularizer = self.settings[:3]
        probes_0, probes_i = self.reference.probes[:k], shape.probes[:k]
        scaled_0, scaled_i = (
            scale_by(probes_0, probes, normalize) for probes in (probes_0, probes_i)
        )
        penalty = penalty_of(shape.spectral.evals[:k], spectral_0.evals[:k], alpha, regularizer)
        equation = MapEquation(scaled_0, penalty, self.weights)
        C = equation.solve(scaled_i)
        residual, upright, image = equation.objective(C, scaled_i), None, np.nan
        if mirrored and (odd := odd_probes(self.reference)).any():
            if (spatial := spatial_probes(self.reference)).any():
                kept = np.where(spatial, 0.0, self.weights)
                equation = MapEquation(scaled_0, penalty, kept)
                upright = equation.objective(equation.solve(scaled_i), scaled_i)
            turned = np.where(odd, -scaled_i, scaled_i)
            image = equation.objective(equation.solve(turned), turned)
        return Solution(C, residual, image, upright)

    def match_points(self, shape: ProbedShape, C: FloatArray) -> tuple[PointMatch, PointMatch]:
        """Match the points of a shape with its learned map (section 4.2), and refine the match.

        Parameters
        ----------
        shape : ProbedShape
            The shape S_i.
        C : ndarray of shape (k, k)
            The learned map X_i(D).

        Returns
        -------
        before, after : PointMatch
            The match before and after refinement; point-to-point maps go from S_i to S_0.
        """
        before = match_points(shape.spectral, self.reference.spectral, C, self.functions)
        if self.refinement is None:
            return before, before
        after = self.refinement.refine(self, shape.spectral, before)
        if not isinstance(after, PointMatch):
            raise TypeError(
                f"refine() of {self.refinement!r} must return a PointMatch, such as that of "
                f"rematch_points; got {type(after).__name__}."
            )
        return before, after


def embedding_distance(shape: ProbedShape, match: PointMatch) -> float:
    """Return the area-weighted mean distance between points and their matches, in the embedding."""
    distances = np.linalg.norm(match.points_i - match.points_0[match.p2p], axis=1)
    return float(np.average(distances, weights=shape.spectral.mass))


def _residuals(training: TrainingSet, i: IntArray, C: FloatArray) -> FloatArray:
    """Return the covariance of a learned map's residuals at the pairs of a training shape."""
    k, observed = training.k, training.observed[i]
    join = observed.join
    evecs_i = training.shapes[i].spectral.evecs_at(join.vertices_i, k, join.places_i)
    evecs_0 = training.reference.spectral.evecs_at(join.vertices_0, k, join.places_0)
    return residual_covariance(evecs_i, evecs_0, observed.areas, C)
