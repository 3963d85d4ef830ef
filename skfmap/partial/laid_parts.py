"""Registration of the reference to a scan whose orientation or scale may have to be corrected."""

from typing import NamedTuple

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.partial.answers import Part
from skfmap.partial.body import Body
from skfmap.partial.scale import scale_of
from skfmap.partial.scan import Scan, scan_of
from skfmap.partial.trust import PartTrust
from skfmap.partial.winding import is_inside_out

__all__ = ["WaysToLay", "laid_part"]


class WaysToLay(NamedTuple):
    """What is needed to lay the reference onto scans.

    Attributes
    ----------
    body, trust : Body, PartTrust
        What was learned from the training shapes.
    usual_score : float
        Median score of parts of held-out training shapes.
    unit : float
        Square root of the area of the reference, in the units of the meshes.
    areas : ndarray of shape (n_shapes,)
        Areas of the training shapes, in units of the reference.
    estimates_scale : bool
        Whether the scale of each scan is estimated.
    max_vertices : int or None
        Maximum number of vertices of the working mesh of a scan.
    """

    body: Body
    trust: PartTrust
    usual_score: float
    unit: float
    areas: FloatArray
    estimates_scale: bool
    max_vertices: int | None


def laid_part(ways: WaysToLay, vertices: FloatArray, faces: IntArray) -> Part:
    """Return the reference laid onto a part.

    Parameters
    ----------
    ways : WaysToLay
        The fitted models and parameters.
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        The part, as given.
    """
    scan, unit, scale = _scan_of(ways, vertices, faces)
    is_reversed = is_inside_out(ways.body, scan, ways.usual_score)
    if is_reversed:
        faces = faces[:, ::-1]
        scan, unit, scale = _scan_of(ways, vertices, faces)
    return Part(vertices / unit, faces, scan, ways.body.lay(scan), unit, is_reversed, scale)


def _scan_of(
    ways: WaysToLay, vertices: FloatArray, faces: IntArray
) -> tuple[Scan, float, float | None]:
    """Return a scan in units of the reference, their length, and the scale if it is estimated."""
    unit, scale = ways.unit, None
    if ways.estimates_scale:
        area = float(np.median(ways.areas))
        unit = 1 / scale_of(vertices, faces, ways.body, ways.trust, area)
        scale = ways.unit / unit
    return scan_of(vertices, faces, unit, ways.max_vertices), unit, scale
