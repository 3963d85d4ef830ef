"""Matches with the meshes that they refer to."""

from collections.abc import Sequence
from dataclasses import replace

from skfmap.shapes import GivenMesh, Match, ProbedShape, SpectralShape

__all__ = ["given_of", "with_meshes"]


def with_meshes(
    matches: Sequence[Match], shapes: Sequence[ProbedShape], reference: ProbedShape
) -> list[Match]:
    """Return the matches with the given meshes of their shapes and of the reference.

    This is done in the calling process, so that no worker sends a mesh back. For a mirror image it
    is the mesh that was given.
    """
    given_0 = given_of(reference.spectral)
    return [
        replace(match, given=given_of(shape.spectral), reference_given=given_0)
        for match, shape in zip(matches, shapes, strict=True)
    ]


def given_of(spectral: SpectralShape) -> GivenMesh:
    """Return the given mesh of a shape, or its working mesh if there is no other."""
    return GivenMesh.of(spectral.mesh) if spectral.given is None else spectral.given
