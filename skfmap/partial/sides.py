"""Detection of scans that are mirrored or whose faces are wound inwards."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from skfmap.functional.similarity import MIRROR
from skfmap.partial.body import Body
from skfmap.partial.consistency import hypotheses
from skfmap.partial.scan import Scan

__all__ = ["Sides", "mirror_image", "score_of", "turned_out"]

# Minimum gain in the score of a hypothesis for a scan to count as reversed or mirrored. For correct
# parts of cats and creatures, the score is worse by at least 1.8 if their faces are wound inwards.
_CLEARLY = 1.0
# Bodies differ from their mirror images if there are at least this many parts, and this fraction of
# them score better than their images by this much. A third do where left and right look alike.
_N_PARTS, _MOST, _BETTER = 8, 0.8, 0.5


class Sides(NamedTuple):
    """What was learned about mirror images and about the orientation of faces.

    Attributes
    ----------
    usual : float
        Median score of parts of held-out training shapes.
    sided : bool
        Whether bodies of this kind differ from their mirror images, as jaws of one side do. If
        left and right look alike, mirrored scans cannot be detected.
    """

    usual: float
    sided: bool

    @classmethod
    def learned(cls, scores: Sequence[float], of_images: Sequence[float]) -> Self:
        """Learn from the scores of held-out parts and of their mirror images."""
        better = np.asarray(scores) - np.asarray(of_images)
        sided = len(better) >= _N_PARTS and np.mean(better > _BETTER) >= _MOST
        return cls(float(np.median(scores)), bool(sided))

    def of(self, body: Body, scan: Scan) -> str:
        """Return which of "right", "inside out", "mirrored" or "negated" fits a scan best.

        A scan that scores as well as usual is "right". The last two are returned only if bodies
        differ from their mirror images: "mirrored" if the scan is a mirror image, and "negated" if
        an axis was negated without reversing the faces.
        """
        score = score_of(body, scan)
        if score >= self.usual:
            return "right"
        others = {"inside out": turned_out(scan)}
        if self.sided:
            others["mirrored"] = mirror_image(scan)
            others["negated"] = turned_out(others["mirrored"])
        scores = {name: score_of(body, one) for name, one in others.items()}
        best = max(scores, key=lambda name: scores[name])
        return best if scores[best] > score + _CLEARLY else "right"


def turned_out(scan: Scan) -> Scan:
    """Return a scan with its faces reversed."""
    return Scan(scan.vertices, np.ascontiguousarray(scan.faces[:, ::-1]))


def mirror_image(scan: Scan) -> Scan:
    """Return the mirror image of a scan, with its faces wound outwards if they were before."""
    return Scan(scan.vertices * MIRROR, np.ascontiguousarray(scan.faces[:, ::-1]))


def score_of(body: Body, scan: Scan) -> float:
    """Return how consistent the probabilities of regions on a scan are; higher is better."""
    regions = body.regions
    apart = regions.distances[:, regions.centres].astype(np.float64)
    logarithms = body.recogniser.logarithms(scan.features[scan.points])
    along = scan.distances, scan.straight, apart, body.straight
    return hypotheses(logarithms, *along, 1)[0].score
