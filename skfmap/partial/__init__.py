"""Parts of shapes: scans with pieces missing, matched to the whole reference."""

from skfmap.partial.cuts import Cut, DiscCut, LimbCut, PlaneCut, ViewCut
from skfmap.partial.matcher import PartialMatcher

__all__ = ["Cut", "DiscCut", "LimbCut", "PartialMatcher", "PlaneCut", "ViewCut"]
