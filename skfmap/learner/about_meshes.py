"""Matches that know the meshes they are about."""

from collections.abc import Sequence
from dataclasses import replace

from skfmap.shapes import GivenMesh, Match, ProbedShape, SpectralShape

__all__ = ["given_of", "with_meshes"]


def with_meshes(
    matches: Sequence[Match], shapes: Sequence[ProbedShape], reference: ProbedShape
) -> list[Match]:
    """Return the matches with the given meshes of their shapes, and that of the reference.

    It is done where matches end up, so that no worker sends a mesh back. A mirror image knows the
    mesh that was given.
    """
    given_0 = given_of(reference.spectral)
    return [
        replace(match, given=given_of(shape.spectral), reference_given=given_0)
        for match, shape in zip(matches, shapes, strict=True)
    ]


def given_of(spectral: SpectralShape) -> GivenMesh:
    """Return the mesh that a shape came as, which is its working mesh if it holds no other."""
    return GivenMesh.of(spectral.mesh) if spectral.given is None else spectral.given
