"""Parts of shapes: scans with pieces missing, matched to the whole reference."""

from skfmap.partial.cuts import Cut, DiscCut, LimbCut, PlaneCut, ViewCut

__all__ = ["Cut", "DiscCut", "LimbCut", "PlaneCut", "ViewCut"]
