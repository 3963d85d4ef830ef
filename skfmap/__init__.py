"""Learn which probe functions to trust when matching non-rigid shapes."""

import importlib
from types import ModuleType
from typing import TYPE_CHECKING

from skfmap._version import __version__
from skfmap.basis import SpectralBasis
from skfmap.descriptors import DescriptorTransformer
from skfmap.health import check_mesh, repair_mesh
from skfmap.learner import (
    BridgedLearner,
    WeightedFunctionalMapLearner,
    functional_maps,
    match,
    match_between,
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

if TYPE_CHECKING:  # at run time they are imported on first use, below
    from skfmap import (
        basis as basis,
    )
    from skfmap import (
        commands as commands,
    )
    from skfmap import (
        datasets as datasets,
    )
    from skfmap import (
        descriptors as descriptors,
    )
    from skfmap import (
        exceptions as exceptions,
    )
    from skfmap import (
        functional as functional,
    )
    from skfmap import (
        geometry as geometry,
    )
    from skfmap import (
        ground_truth as ground_truth,
    )
    from skfmap import (
        health as health,
    )
    from skfmap import (
        io as io,
    )
    from skfmap import (
        known_maps as known_maps,
    )
    from skfmap import (
        landmarks as landmarks,
    )
    from skfmap import (
        learner as learner,
    )
    from skfmap import (
        metrics as metrics,
    )
    from skfmap import (
        model_selection as model_selection,
    )
    from skfmap import (
        persistence as persistence,
    )
    from skfmap import (
        plotting as plotting,
    )
    from skfmap import (
        refinement as refinement,
    )
    from skfmap import (
        registration as registration,
    )
    from skfmap import (
        report as report,
    )
    from skfmap import (
        shape_space as shape_space,
    )
    from skfmap import (
        shapes as shapes,
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
    "match_between",
    "predict_landmarks",
    "register",
    "repair_mesh",
]

# Imported on first use, because plotting and reports take a while to load.
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


if not TYPE_CHECKING:  # otherwise type checkers would accept any name

    def __getattr__(name: str) -> ModuleType:
        """Import and return a module of the package."""
        if name not in _SUBMODULES:
            raise AttributeError(f"module 'skfmap' has no attribute {name!r}")
        return importlib.import_module(f"skfmap.{name}")


def __dir__() -> list[str]:
    """Return the public names, including modules."""
    return sorted([*__all__, *_SUBMODULES])
