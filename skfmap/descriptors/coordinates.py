"""Coordinates as probe functions, for aligned collections."""

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import check_number, label
from skfmap.descriptors.family import ProbeFamily
from skfmap.exceptions import MeshError
from skfmap.functional.projection import project
from skfmap.geometry.normals import vertex_normals
from skfmap.shapes import SpectralShape

__all__ = ["Coordinates"]

_AXES = ("x", "y", "z")


class Coordinates(ProbeFamily):
    """Positions and normals, for collections of aligned shapes.

    Positions are relative to the centroid of the surface, at unit area. Unlike all other families,
    these functions change when a shape is rotated. Use them only if all shapes, including new ones,
    have been aligned, and are so rigid that corresponding points are then close to each other. They
    are never part of the default.

    Parameters
    ----------
    normals : bool, default=True
        Whether unit normals at the vertices, pointing outwards, are probe functions too.
    time : float, default=0.0
        Time of the heat diffusion that smooths the functions, at unit area; with 0 they are only
        smoothed by truncation to the basis.

    Notes
    -----
    Give the family a name that begins with ``coordinates``: the learner's ``on_mirrored="reflect"``
    negates x in families with such a name. It assumes that aligned shapes stay aligned when they
    are mirrored in the plane x = 0, which holds if x runs from left to right. Only oriented probes
    can show that a new shape is mirrored.

    Examples
    --------
    >>> from skfmap import DescriptorTransformer, SpectralBasis
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.descriptors import Coordinates, default_families
    >>> families = [*default_families(), ("coordinates", Coordinates())]
    >>> shapes = SpectralBasis(20).transform([make_sphere(3)])
    >>> (shape,) = DescriptorTransformer(families).transform(shapes)
    >>> shape.probe_names[-6:-2]
    ('coordinates[x]', 'coordinates[y]', 'coordinates[z]', 'coordinates[normal_x]')
    """

    def __init__(self, normals: bool = True, *, time: float = 0.0) -> None:
        self.normals = normals
        self.time = time

    def check_parameters(self) -> None:
        """Raise ValueError or TypeError if a parameter is invalid."""
        if not isinstance(self.normals, (bool, np.bool_)):
            raise TypeError(f"normals must be True or False; got {self.normals!r}.")
        check_number(self.time, "time", low=0)

    def labels(self) -> list[str]:
        """Return the names of the functions."""
        return [*_AXES, *(f"normal_{axis}" for axis in _AXES if self.normals)]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        columns = [shape.vertices - shape.mass @ shape.vertices]
        if self.normals:
            if not shape.oriented:
                raise MeshError(
                    f"The faces of {label(shape.name)} cannot be wound consistently, so the "
                    "direction of its normals is undefined; mend its non-manifold edges, or use "
                    "Coordinates(normals=False)."
                )
            columns.append(vertex_normals(shape.vertices, shape.mesh.faces))
        coefficients = project(np.hstack(columns), shape.evecs, shape.mass)
        return coefficients * np.exp(-self.time * shape.evals)[:, None]
