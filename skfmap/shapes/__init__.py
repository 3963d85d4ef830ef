"""Immutable data that passes through the pipeline.

Meshes, shapes with a spectral basis, correspondences and matches.
"""

from skfmap.shapes.correspondence import Correspondence, JoinedPairs, _correspondence  # noqa: F401 - pickles of 0.1.0
from skfmap.shapes.given_mesh import GivenMesh
from skfmap.shapes.landmarks import Landmarks
from skfmap.shapes.match import Match
from skfmap.shapes.mesh import Mesh
from skfmap.shapes.probed_shape import ProbedShape
from skfmap.shapes.prolongation import Prolongation
from skfmap.shapes.registered import Registered
from skfmap.shapes.skipped_shape import SkippedShape
from skfmap.shapes.spectral_shape import SpectralShape
from skfmap.shapes.surface_places import SurfacePlaces

__all__ = [
    "Correspondence",
    "GivenMesh",
    "JoinedPairs",
    "Landmarks",
    "Match",
    "Mesh",
    "ProbedShape",
    "Prolongation",
    "Registered",
    "SkippedShape",
    "SpectralShape",
    "SurfacePlaces",
]
