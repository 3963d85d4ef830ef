"""Registration of the reference to a scan whose orientation or scale may have to be corrected."""

from typing import NamedTuple

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.partial.answers import Part
from skfmap.partial.body import Body
from skfmap.partial.scale import scale_of
from skfmap.partial.scan import scan_of
from skfmap.partial.sides import Sides
from skfmap.partial.trust import PartTrust

__all__ = ["WaysToLay", "laid_part"]


class WaysToLay(NamedTuple):
    """What is needed to lay the reference onto scans.

    Attributes
    ----------
    body, trust, sides : Body, PartTrust, Sides
        What was learned from the training shapes.
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
    sides: Sides
    unit: float
    areas: FloatArray
    estimates_scale: bool
    max_vertices: int | None


def laid_part(ways: WaysToLay, vertices: FloatArray, faces: IntArray) -> Part:
    """Return the reference laid onto a part.

    Parameters
    ----------
    ways : WaysToLay
        What was learned.
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        The part, as given.
    """
    unit, scale = ways.unit, None
    for turn in (1, -1):  # reverse the faces if they are inside out
        faces = faces[:, ::turn]
        if ways.estimates_scale:
            area = float(np.median(ways.areas))
            unit = 1 / scale_of(vertices, faces, ways.body, ways.trust, area)
            scale = ways.unit / unit
        scan = scan_of(vertices, faces, unit, ways.max_vertices)
        side = ways.sides.of(ways.body, scan) if turn == 1 else "inside out"
        if side != "inside out":
            break
    return Part(vertices / unit, faces, scan, ways.body.lay(scan), unit, side, scale)
