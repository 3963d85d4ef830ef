"""Kernels on arrays of coefficients: functional maps, how they are learned, and stable functions.

They depend on numpy and scipy only.
"""

from skfmap.functional.eigenbasis import laplacian_eigenbasis
from skfmap.functional.embedding import spectral_embeddings
from skfmap.functional.fmap import MapEquation, solve_functional_map
from skfmap.functional.from_landmarks import heat_around, map_from_landmarks
from skfmap.functional.ground_truth import GroundTruth, map_from_pairs
from skfmap.functional.learning import LearnedMaps, learn_functional_maps
from skfmap.functional.neighbours import nearest, nearest_both
from skfmap.functional.norm import epsilon_by_rule, rank_norm, rank_norm_and_gradient
from skfmap.functional.normalization import scale_by
from skfmap.functional.objective import LearningProblem
from skfmap.functional.optimize import Optimum, optimize_weights
from skfmap.functional.outliers import wrong_pairs
from skfmap.functional.projection import diffuse, project
from skfmap.functional.quadratic_systems import QuadraticSystems
from skfmap.functional.refinement import map_from_point_maps, nearest_orthogonal
from skfmap.functional.regularization import (
    LearnedMask,
    PenaltyQuadratic,
    laplacian_mask,
    learned_mask,
    penalty_of,
    penalty_quadratic,
    resolvent_mask,
)
from skfmap.functional.residuals import (
    calibrated_covariance,
    residual_covariance,
    trusted_functions,
)
from skfmap.functional.row_systems import RowSystems, SharedRowSystems
from skfmap.functional.samples import areas_of_samples, farthest_points
from skfmap.functional.signatures import heat_kernel_signature, wave_kernel_signature
from skfmap.functional.stable_basis import basis_error, missed_by_maps, stable_basis
from skfmap.functional.subvertex import nearest_on_triangles
from skfmap.functional.weighting import weight_groups

__all__ = [
    "GroundTruth",
    "LearnedMaps",
    "LearnedMask",
    "LearningProblem",
    "MapEquation",
    "Optimum",
    "PenaltyQuadratic",
    "QuadraticSystems",
    "RowSystems",
    "SharedRowSystems",
    "areas_of_samples",
    "basis_error",
    "calibrated_covariance",
    "diffuse",
    "epsilon_by_rule",
    "farthest_points",
    "heat_around",
    "heat_kernel_signature",
    "laplacian_eigenbasis",
    "laplacian_mask",
    "learn_functional_maps",
    "learned_mask",
    "map_from_landmarks",
    "map_from_pairs",
    "map_from_point_maps",
    "missed_by_maps",
    "nearest",
    "nearest_both",
    "nearest_on_triangles",
    "nearest_orthogonal",
    "optimize_weights",
    "penalty_of",
    "penalty_quadratic",
    "project",
    "rank_norm",
    "rank_norm_and_gradient",
    "residual_covariance",
    "resolvent_mask",
    "scale_by",
    "solve_functional_map",
    "spectral_embeddings",
    "stable_basis",
    "trusted_functions",
    "wave_kernel_signature",
    "weight_groups",
    "wrong_pairs",
]
