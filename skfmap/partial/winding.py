"""Detection of scans whose faces are wound inwards."""

import numpy as np

from skfmap.partial.body import Body
from skfmap.partial.consistency import hypotheses
from skfmap.partial.scan import Scan

__all__ = ["is_inside_out", "score_of"]

# Minimum gain in the score of a hypothesis for a scan to count as reversed. For correct parts of
# cats and creatures, the score is worse by at least 1.8 if their faces are wound inwards.
_CLEARLY = 1.0


def is_inside_out(body: Body, scan: Scan, usual: float) -> bool:
    """Tell whether a scan fits clearly better with reversed faces.

    Parameters
    ----------
    body : Body
        The reference and its models.
    scan : Scan
        The scan.
    usual : float
        Median score of parts of held-out training shapes; a scan with this score is not examined.
    """
    score = score_of(body, scan)
    if score >= usual:
        return False
    turned = Scan(scan.vertices, np.ascontiguousarray(scan.faces[:, ::-1]))
    return score_of(body, turned) > score + _CLEARLY


def score_of(body: Body, scan: Scan) -> float:
    """Return how consistent the probabilities of regions on a scan are; higher is better."""
    regions = body.regions
    apart = regions.distances[:, regions.centres].astype(np.float64)
    logarithms = body.recogniser.logarithms(scan.features[scan.points])
    along = scan.distances, scan.straight, apart, body.straight
    return hypotheses(logarithms, *along, 1)[0].score
