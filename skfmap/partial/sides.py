"""Scans that were wound inwards, or mirrored: told by how well their surroundings fit together."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from skfmap.functional.similarity import MIRROR
from skfmap.partial.body import Body
from skfmap.partial.consistency import hypotheses
from skfmap.partial.scan import Scan

__all__ = ["Sides", "mirror_image", "score_of", "turned_out"]

# By how much the score of a hypothesis has to be better for the other side. Of right parts of cats
# and creatures, it is worse by 1.8 at least if faces are wound inwards.
_CLEARLY = 1.0
# A kind of body is unlike its mirror image if so many parts were looked at, and this share of them
# are better than their images by so much. Where left and right look alike, a third are.
_N_PARTS, _MOST, _BETTER = 8, 0.8, 0.5


class Sides(NamedTuple):
    """What is known of left and right, and of inside and outside.

    Attributes
    ----------
    usual : float
        Median score of parts of training shapes that were left out.
    sided : bool
        Whether bodies of this kind are unlike their mirror images, as jaws of one side are; where
        left and right look alike, nothing tells a mirrored scan.
    """

    usual: float
    sided: bool

    @classmethod
    def learned(cls, scores: Sequence[float], of_images: Sequence[float]) -> Self:
        """Learn from scores of parts that were left out, and of their mirror images."""
        better = np.asarray(scores) - np.asarray(of_images)
        sided = len(better) >= _N_PARTS and np.mean(better > _BETTER) >= _MOST
        return cls(float(np.median(scores)), bool(sided))

    def of(self, body: Body, scan: Scan) -> str:
        """Return "right", "inside out", "mirrored" or "negated", by which the scan fits best.

        What fits as well as usual is right. Of sided kinds alone it is told that the scan is a
        mirror image ("mirrored"), or that an axis was negated and the faces were left as they were.
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
    """Return a scan with its faces wound the other way."""
    return Scan(scan.vertices, np.ascontiguousarray(scan.faces[:, ::-1]))


def mirror_image(scan: Scan) -> Scan:
    """Return the mirror image of a scan, wound as it is."""
    return Scan(scan.vertices * MIRROR, np.ascontiguousarray(scan.faces[:, ::-1]))


def score_of(body: Body, scan: Scan) -> float:
    """Return how well what the surroundings of points tell fits together; higher is better."""
    regions = body.regions
    apart = regions.distances[:, regions.centres].astype(np.float64)
    logarithms = body.recogniser.logarithms(scan.features[scan.points])
    along = scan.distances, scan.straight, apart, body.straight
    return hypotheses(logarithms, *along, 1)[0].score
