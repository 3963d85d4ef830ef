"""Landmarks of many specimens: tables, measurements, semilandmarks and symmetry."""

from skfmap.landmarks.alignment import align_landmarks
from skfmap.landmarks.measure import distances
from skfmap.landmarks.observer import ObserverError, observer_error
from skfmap.landmarks.semilandmarks import carry_points
from skfmap.landmarks.shrinkage import Shrinkage, shrinkage
from skfmap.landmarks.sliding import slide
from skfmap.landmarks.symmetry import (
    Pairing,
    asymmetric_component,
    propose_pairing,
    symmetric_component,
)
from skfmap.landmarks.tables import (
    centroid_sizes,
    landmark_names,
    stack_landmarks,
    write_table,
)
from skfmap.landmarks.thin_plate import bending_energy

__all__ = [
    "ObserverError",
    "Pairing",
    "Shrinkage",
    "align_landmarks",
    "asymmetric_component",
    "bending_energy",
    "carry_points",
    "centroid_sizes",
    "distances",
    "landmark_names",
    "observer_error",
    "propose_pairing",
    "shrinkage",
    "slide",
    "stack_landmarks",
    "symmetric_component",
    "write_table",
]
