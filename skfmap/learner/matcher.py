"""What matching a new shape needs, all of it learned: equation (2), section 4.2, refinement."""

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
    """Parameters that weights and errors belong to.

    Setting them later has no effect before the next fit.
    """

    alpha: float
    normalize: str
    regularizer: str | Callable[[FloatArray, FloatArray], FloatArray]
    matching: str
    n_stable: int


class Solution(NamedTuple):
    """Equation (2) for one shape: X_i(D), the value there, and that for the mirrored shape.

    Beside coordinates, which change by any reflection as it happens to lie, the mirrored shape is
    compared with the shape without them: ``upright_residual`` is the value for the shape then.
    """

    C: FloatArray
    residual: float
    mirrored_residual: float
    upright_residual: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Matcher:
    """What matching a new shape needs.

    Attributes
    ----------
    reference : ProbedShape
        S_0.
    weights : ndarray of shape (m,)
        Diagonal of D.
    stable_basis : ndarray of shape (k, k)
        Y.
    residual_covariance, truncation_covariance : ndarray
        How far learned maps, and known ones in all functions held, put the points of training
        shapes from where they belong.
    settings : Settings
        How equation (2) is set up, and which functions points are matched in.
    refinement : Refinement or None
        A part with a ``refine`` method.
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
        """Put together what was learned from a training set.

        Parameters
        ----------
        training : TrainingSet
            The training set; shapes without a share are not asked.
        learned : LearnedMaps
            What was learned from it.
        matching, n_stable : str, int
            As the learner's parameters; p.
        refinement : Refinement, optional
            How matches are refined.

        Returns
        -------
        Matcher
            What matches new shapes.
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
        """Return a line with the reference, the number of functions, and the refinement."""
        k = len(self.stable_basis)
        return f"Matcher({self.reference.name!r}, k={k}, refinement={self.refinement!r})"

    @property
    def probe_names(self) -> Array:
        """What each weight belongs to; an object array of shape (m,)."""
        return np.array(self.reference.probe_names, dtype=object)

    @property
    def probe_categories(self) -> Array:
        """Family of each probe function; an object array of shape (m,)."""
        return np.array(self.reference.probe_categories, dtype=object)

    @property
    def functions(self) -> FloatArray:
        """Functions that points are matched in, shape (k, k) or (k, p)."""
        if self.settings.matching == "cut":
            return self.stable_basis[:, : self.settings.n_stable]
        return trusted_functions(self.residual_covariance)

    def solve(self, shape: ProbedShape, *, mirrored: bool = False) -> Solution:
        """Solve equation (2) for a shape, and for its mirror image if asked.

        Mirroring turns the sign of oriented probes on the right-hand side, and nothing else: one
        factorisation serves both, but beside coordinates, which are left out.

        Parameters
        ----------
        shape : ProbedShape
            S_i.
        mirrored : bool, default=False
            Whether the mirror image is solved for too.

        Returns
        -------
        Solution
            X_i(D), which pulls functions on S_0 back to S_i, and the values of (2) there.
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
        """Match the points of a shape under its learned map (section 4.2), and refine the match.

        Parameters
        ----------
        shape : ProbedShape
            S_i.
        C : ndarray of shape (k, k)
            X_i(D).

        Returns
        -------
        before, after : PointMatch
            The match before refinement and after; point maps run from S_i to S_0.
        """
        before = match_points(shape.spectral, self.reference.spectral, C, self.functions)
        if self.refinement is None:
            return before, before
        after = self.refinement.refine(self, shape.spectral, before)
        if not isinstance(after, PointMatch):
            raise TypeError(
                f"refine() of {self.refinement!r} must return a PointMatch, for instance that of "
                f"rematch_points; got {type(after).__name__}."
            )
        return before, after


def embedding_distance(shape: ProbedShape, match: PointMatch) -> float:
    """Return the mean distance, by area, of the points of a shape from their matches.

    In the embedding.
    """
    distances = np.linalg.norm(match.points_i - match.points_0[match.p2p], axis=1)
    return float(np.average(distances, weights=shape.spectral.mass))


def _residuals(training: TrainingSet, i: IntArray, C: FloatArray) -> FloatArray:
    """Return the covariance of what a learned map misses at the known pairs of a training shape."""
    k, observed = training.k, training.observed[i]
    join = observed.join
    evecs_i = training.shapes[i].spectral.evecs_at(join.vertices_i, k, join.places_i)
    evecs_0 = training.reference.spectral.evecs_at(join.vertices_0, k, join.places_0)
    return residual_covariance(evecs_i, evecs_0, observed.areas, C)
