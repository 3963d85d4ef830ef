"""Classification of meshes as whole shapes or parts, by rim length and area."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.exceptions import MeshError
from skfmap.geometry.faults import sound_faces
from skfmap.io import MeshLike, n_vertices_of, named
from skfmap.partial.answers import arrays_of
from skfmap.partial.scan import area_and_rim
from skfmap.shapes.skipped_shape import SetAside

__all__ = ["TrainingSizes", "kinds_of", "only", "rows_of"]

# A mesh is whole if its rim is at most this much longer than those of the training shapes, in
# sqrt of its area.
_RIM = 0.1
# Limits of the area, as fractions of the median area of the training shapes, outside which a mesh
# is not matched.
_TOO_SMALL, _TOO_LARGE = 0.15, 3.0
# Factors between units that are often confused: metres, centimetres, millimetres, inches, feet.
_UNITS = (10.0, 12.0, 25.4, 100.0, 304.8, 1000.0)


class TrainingSizes(NamedTuple):
    """Areas and rim lengths of the whole training shapes.

    Attributes
    ----------
    unit : float
        Square root of the area of the reference, in the units of the meshes.
    areas, rims : ndarray of shape (n_shapes,)
        Areas and rim lengths, in units of the reference.
    """

    unit: float
    areas: FloatArray
    rims: FloatArray

    def kind(self, vertices: FloatArray, faces: IntArray, *, any_units: bool) -> str:
        """Return "whole" or "part", or why a mesh cannot be matched.

        Parameters
        ----------
        vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
            The mesh as given.
        any_units : bool
            Whether its units may differ from those of the training shapes.
        """
        faces = faces[sound_faces(vertices, faces)]
        if not len(faces):
            return "whole"  # the pipeline reports what is wrong with it
        area, rim = area_and_rim(vertices / self.unit, faces)
        if rim / np.sqrt(area) <= (self.rims / np.sqrt(self.areas)).max() + _RIM:
            return "whole"
        share = area / float(np.median(self.areas))
        if any_units or _TOO_SMALL <= share <= _TOO_LARGE:
            return "part"
        told = f"it has {share:.2g} times their area"
        if share < _TOO_SMALL:
            told = f"it has {100 * share:.2g} % of their area, too little to say where it belongs"
        return told + _told_of_units(share)


def kinds_of(items: Sequence[MeshLike], sizes: TrainingSizes, *, any_units: bool) -> list[str]:
    """Return "whole" or "part" for each mesh, or why it cannot be matched."""
    kinds = []
    for i, item in enumerate(items):
        try:
            kinds.append(sizes.kind(*arrays_of(item, i), any_units=any_units))
        except (MeshError, OSError):
            kinds.append("whole")  # the pipeline reports what is wrong with it
    return kinds


def rows_of(kinds: Sequence[str], kind: str) -> list[int]:
    """Return the indices of the meshes of one kind."""
    return [i for i, one in enumerate(kinds) if one == kind]


def only(items: Sequence[MeshLike], kinds: Sequence[str], kind: str) -> list[MeshLike]:
    """Return the meshes with those of other kinds set aside, so that all keep their indices."""
    return [
        item if one == kind else SetAside(named(item, i), "", n_vertices_of(item))
        for i, (item, one) in enumerate(zip(items, kinds, strict=True))
    ]


def _told_of_units(share: float) -> str:
    """Return which confusion of units would explain an area, and the factor that corrects it."""
    # A part that can be matched has between _TOO_SMALL and all of the area in the right units.
    least, most = np.sqrt(share), np.sqrt(share / _TOO_SMALL)
    larger = [f for f in _UNITS if least <= f <= most]
    smaller = [f for f in _UNITS if least <= 1 / f <= most]
    if larger:
        factors, way = [f"{1 / f:.4g}" for f in larger], "smaller"
    elif smaller:
        factors, way = [f"{f:.4g}" for f in smaller], "larger"
    else:
        return ""
    return (
        f" (units that are {' or '.join(f'{f:.4g}' for f in larger or smaller)} times {way} would "
        f"explain that: multiply its coordinates by {' or '.join(factors)})"
    )
