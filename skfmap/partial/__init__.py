"""Matching of incomplete scans to the whole reference."""

from skfmap.partial.cuts import Cut, DiscCut, LimbCut, PlaneCut, ViewCut

__all__ = ["Cut", "DiscCut", "LimbCut", "PlaneCut", "ViewCut"]
