"""Learn which probe functions to trust when matching non-rigid shapes."""

from skfmap._version import __version__
from skfmap.basis import SpectralBasis
from skfmap.descriptors import DescriptorTransformer
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
    "functional_maps",
    "match",
]
