"""Learn which probe functions to trust when matching non-rigid shapes."""

from skfmap._version import __version__
from skfmap.basis import SpectralBasis
from skfmap.descriptors import DescriptorTransformer
from skfmap.health import check_mesh, repair_mesh
from skfmap.learner import WeightedFunctionalMapLearner, functional_maps, match
from skfmap.shapes import Correspondence, Match, Mesh, ProbedShape, SpectralShape

__all__ = [
    "Correspondence",
    "DescriptorTransformer",
    "Match",
    "Mesh",
    "ProbedShape",
    "SpectralBasis",
    "SpectralShape",
    "WeightedFunctionalMapLearner",
    "__version__",
    "check_mesh",
    "functional_maps",
    "match",
    "repair_mesh",
]
