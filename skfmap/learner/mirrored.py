"""Detection and reflection of specimens that are mirror images of the others."""

from dataclasses import replace

import numpy as np

from skfmap._tools.types import BoolArray, FloatArray
from skfmap.functional.similarity import MIRROR, TELLING, left_by_similarities, side_of
from skfmap.ground_truth import KnownMap
from skfmap.shapes import (
    GivenMesh,
    JoinedPairs,
    Mesh,
    ProbedShape,
    Prolongation,
    SpectralShape,
)

__all__ = ["is_against", "is_mirror_image", "mirror_image", "odd_probes", "spatial_probes"]

# Prefix of the names of families that change sign under any reflection.
_ODD = "oriented"
# Prefix of the names of families of coordinates, and suffixes of those of their functions that
# change sign under `mirror_image`.
_COORDINATES, _NEGATED = "coordinates", ("[x]", "[normal_x]")

# Threshold of the correlation between oriented probes and their images under the known map. It is
# 0.3 to 0.9 for correct shapes of TOSCA.
_AGAINST = 0.1


def odd_probes(shape: ProbedShape) -> BoolArray:
    """Return which probe functions change sign under any reflection, shape (m,)."""
    return np.array([category.startswith(_ODD) for category in shape.probe_categories])


def spatial_probes(shape: ProbedShape) -> BoolArray:
    """Return which probe functions are coordinates, shape (m,)."""
    return np.array([category.startswith(_COORDINATES) for category in shape.probe_categories])


def mirror_image(shape: ProbedShape) -> ProbedShape:
    """Return the mirror image of a shape, with the same vertex indices.

    The first coordinate is negated, and the winding of faces is reversed, so that they point
    outwards again. Eigenfunctions do not change, nor do probe functions, except for those that
    distinguish left from right. The mirror image of the mirror image is the shape.

    Parameters
    ----------
    shape : ProbedShape
        A shape.

    Returns
    -------
    ProbedShape
        Its mirror image; answers for it are on the given mesh of the shape.
    """
    return replace(
        shape,
        spectral=_image(shape.spectral),
        probes=np.where(_changes_sign(shape), -shape.probes, shape.probes),
        reflected=not shape.reflected,
    )


def is_mirror_image(
    shape: ProbedShape, reference: ProbedShape, join: JoinedPairs, known: KnownMap
) -> bool:
    """Return whether a training shape is the mirror image of what it should be.

    There are two criteria: whether the known map takes oriented probes to their opposites, and
    whether the similarity that explains the pairs in space is a reflection. At least one must say
    so, and the other must not contradict it.
    """
    agreement = _agreement(shape, reference, known.C)
    side = _side_in_space(shape, reference, join, known)
    if side is None:
        return agreement < -_AGAINST
    return side < 0 and agreement < _AGAINST


def is_against(
    shape: ProbedShape, reference: ProbedShape, join: JoinedPairs, known: KnownMap
) -> bool:
    """Return whether a training shape is a mirror image by at least one of the two criteria.

    They contradict each other if a mesh is inside out.
    """
    if not _changes_sign(reference).any():
        return False  # no probe distinguishes left from right
    side = _side_in_space(shape, reference, join, known)
    return _agreement(shape, reference, known.C) < -_AGAINST or side == -1


def _image(spectral: SpectralShape) -> SpectralShape:
    mesh, places, given = spectral.mesh, spectral.prolongation, spectral.given
    if given is None:
        given = GivenMesh.of(mesh)
    if places is not None:  # the second and third corner, and so their weights, are swapped
        places = Prolongation(places.face, places.coordinates[:, ::-1])
    return replace(
        spectral,
        mesh=Mesh(mesh.vertices * MIRROR, mesh.faces[:, [0, 2, 1]], mesh.name),
        prolongation=places,
        given=given,
    )


def _changes_sign(shape: ProbedShape) -> BoolArray:
    """Return which probe functions change sign in `mirror_image`."""
    negated = np.array([name.endswith(_NEGATED) for name in shape.probe_names])
    return odd_probes(shape) | (spatial_probes(shape) & negated)


def _agreement(shape: ProbedShape, reference: ProbedShape, C: FloatArray) -> float:
    """Return the correlation of a shape's oriented probes with the mapped ones of the reference.

    It is 0 if there are no oriented probes.
    """
    odd = odd_probes(reference)
    if not odd.any():
        return 0.0
    k = len(C)
    own, carried = shape.probes[1:k, odd], (C @ reference.probes[:k])[1:, odd]
    own, carried = (
        values / np.maximum(np.linalg.norm(values, axis=0), 1e-300) for values in (own, carried)
    )
    return float((own * carried).sum() / odd.sum())


def _side_in_space(
    shape: ProbedShape, reference: ProbedShape, join: JoinedPairs, known: KnownMap
) -> int | None:
    """Return the determinant's sign of the similarity that explains the pairs, or None."""
    if len(np.unique(join.points)) < TELLING:
        return None
    spectral, spectral_0 = shape.spectral, reference.spectral
    points = spectral.vertices_at(join.vertices_i, join.places_i)
    points_0 = spectral_0.vertices_at(join.vertices_0, join.places_0)
    return side_of(*left_by_similarities(points, points_0, known.areas))
