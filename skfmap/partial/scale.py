"""Estimation of the scale of a scan in unknown units, together with its map."""

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.partial.body import Body, LaidOnPart
from skfmap.partial.scan import Scan, area_and_rim, scan_of
from skfmap.partial.trust import PartTrust
from skfmap.partial.winding import score_of

__all__ = ["scale_of"]

# Fractions of the area of a whole shape that a scan may show, and the number of scales tried.
_LEAST, _MOST, _N_SCALES = 0.2, 1.1, 8
# Number of vertices of the coarse mesh on which scales are compared.
_FEW = 2500


def scale_of(
    vertices: FloatArray, faces: IntArray, body: Body, trust: PartTrust, area: float
) -> float:
    """Return the factor that converts coordinates to units of sqrt(area) of the reference.

    A part shows between a fifth and all of a shape, so the possible scales lie within a factor of
    2.3. Of these, the one is chosen at which the probabilities of regions are most consistent.
    The reference is then laid onto the scan at this scale, and the area of its covered part
    corrects the scale.

    Parameters
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        The scan, in any units.
    body, trust : Body, PartTrust
        The fitted models.
    area : float
        Area of a typical training shape, in units of the reference.
    """
    coarse = scan_of(vertices, faces, 1.0, _FEW)
    own = area_and_rim(coarse.vertices, coarse.faces)[0]
    scales = np.sqrt(np.geomspace(_LEAST, _MOST, _N_SCALES) * area / own)
    scans = [Scan(coarse.vertices * scale, coarse.faces) for scale in scales]
    best = int(np.argmax([score_of(body, scan) for scan in scans]))
    larger = _larger(body, trust, body.lay(scans[best]))
    return float(scales[best] / larger)


def _larger(body: Body, trust: PartTrust, laid: LaidOnPart) -> float:
    """Return the ratio of lengths of the covered part of the laid reference to those at rest."""
    faces = body.regions.faces
    covered = faces[(trust.coverage(laid) >= 0.5)[faces].all(axis=1)]
    if not len(covered):
        return 1.0
    areas = [area_and_rim(at, covered)[0] for at in (laid.vertices, body.deformation.shape_at_rest)]
    return float(np.sqrt(areas[0] / areas[1]))
