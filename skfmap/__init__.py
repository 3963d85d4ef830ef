"""Learn which probe functions to trust when matching non-rigid shapes."""

import importlib
from types import ModuleType

from skfmap._version import __version__
from skfmap.basis import SpectralBasis
from skfmap.descriptors import DescriptorTransformer
from skfmap.health import check_mesh, repair_mesh
from skfmap.learner import (
    BridgedLearner,
    WeightedFunctionalMapLearner,
    functional_maps,
    match,
    predict_landmarks,
    register,
)
from skfmap.partial.matcher import PartialMatcher
from skfmap.shapes import (
    Correspondence,
    Landmarks,
    Match,
    Mesh,
    ProbedShape,
    Registered,
    SpectralShape,
)

__all__ = [
    "BridgedLearner",
    "Correspondence",
    "DescriptorTransformer",
    "Landmarks",
    "Match",
    "Mesh",
    "PartialMatcher",
    "ProbedShape",
    "Registered",
    "SpectralBasis",
    "SpectralShape",
    "WeightedFunctionalMapLearner",
    "__version__",
    "check_mesh",
    "functional_maps",
    "match",
    "predict_landmarks",
    "register",
    "repair_mesh",
]

# Imported when they are asked for: pictures and reports take a while to load.
_SUBMODULES = (
    "basis",
    "commands",
    "datasets",
    "descriptors",
    "exceptions",
    "functional",
    "geometry",
    "ground_truth",
    "health",
    "io",
    "known_maps",
    "landmarks",
    "learner",
    "metrics",
    "model_selection",
    "partial",
    "persistence",
    "plotting",
    "refinement",
    "registration",
    "report",
    "shape_space",
    "shapes",
)


def __getattr__(name: str) -> ModuleType:
    """Return a module of the package."""
    if name not in _SUBMODULES:
        raise AttributeError(f"module 'skfmap' has no attribute {name!r}")
    return importlib.import_module(f"skfmap.{name}")


def __dir__() -> list[str]:
    """Return the public names, modules among them."""
    return sorted([*__all__, *_SUBMODULES])
