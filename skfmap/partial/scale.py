"""The scale of a scan in unknown units, estimated together with its map."""

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.partial.body import Body, LaidOnPart
from skfmap.partial.scan import Scan, area_and_rim, scan_of
from skfmap.partial.sides import score_of
from skfmap.partial.trust import PartTrust

__all__ = ["scale_of"]

# Which share of the area of a whole shape a scan may show, and how many scales are tried between.
_LEAST, _MOST, _N_SCALES = 0.2, 1.1, 8
# Vertices that are enough to compare scales by.
_FEW = 2500


def scale_of(
    vertices: FloatArray, faces: IntArray, body: Body, trust: PartTrust, area: float
) -> float:
    """Return what coordinates have to be multiplied by to be in sqrt(area) of the reference.

    A part shows between a fifth and all of a shape, so that only scales within a factor of 2.3 are
    possible. The one is taken at which what the surroundings of points tell fits together best.
    There the reference is laid onto the scan, and what is covered of it says how much larger the
    scan is than it should be.

    Parameters
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        The scan, in any units.
    body, trust : Body, PartTrust
        What was learned.
    area : float
        Of a usual training shape, in units of the reference.
    """
    coarse = scan_of(vertices, faces, 1.0, _FEW)
    own = area_and_rim(coarse.vertices, coarse.faces)[0]
    scales = np.sqrt(np.geomspace(_LEAST, _MOST, _N_SCALES) * area / own)
    scans = [Scan(coarse.vertices * scale, coarse.faces) for scale in scales]
    best = int(np.argmax([score_of(body, scan) for scan in scans]))
    larger = _larger(body, trust, body.lay(scans[best]))
    return float(scales[best] / larger)


def _larger(body: Body, trust: PartTrust, laid: LaidOnPart) -> float:
    """Return how many times longer the covered part of the reference is than it usually is."""
    faces = body.regions.faces
    covered = faces[(trust.coverage(laid) >= 0.5)[faces].all(axis=1)]
    if not len(covered):
        return 1.0
    areas = [area_and_rim(at, covered)[0] for at in (laid.vertices, body.deformation.shape_at_rest)]
    return float(np.sqrt(areas[0] / areas[1]))
