"""The given mesh of the reference, laid onto the given meshes of shapes."""

import numpy as np
from scipy.spatial import KDTree

from skfmap._tools.types import FloatArray, IntArray
from skfmap.functional.similarity import MIRROR
from skfmap.geometry.closest import ClosestPoints
from skfmap.geometry.elasticity import ElasticSurface, nearest_rotations
from skfmap.geometry.geodesics import mean_edge_length
from skfmap.geometry.normals import vertex_normals
from skfmap.io import open_given
from skfmap.learner.given_answers import GivenReference, given_surface
from skfmap.learner.matcher import Matcher
from skfmap.refinement import match_points
from skfmap.registration import Registration
from skfmap.shapes import Mesh, ProbedShape, Registered, SkippedShape

__all__ = ["faces_of", "registered", "unregistered", "with_detail"]

# Normals agree if the cosine of the angle between them is above this: 60 degrees.
_AGREES = 0.5


def registered(
    matcher: Matcher, registration: Registration, shape: ProbedShape, target: GivenReference
) -> Registered:
    """Return the given mesh of the reference laid onto one shape.

    Parameters
    ----------
    matcher, registration : Matcher, Registration
        The fitted matcher and registration.
    shape : ProbedShape
        The shape S_i.
    target : GivenReference
        The given mesh of S_0.
    """
    spectral, C = shape.spectral, matcher.solve(shape).C
    before = match_points(spectral, matcher.reference.spectral, C, matcher.functions)
    laid = registration.lay(matcher, spectral, before)
    vertices = with_detail(target, laid.vertices) * np.sqrt(spectral.area)
    if shape.reflected:
        vertices = vertices * MIRROR
    surface = ClosestPoints(*given_surface(spectral))
    faces = faces_of(target)
    if not (spectral.keeps_vertices and target.shape.keeps_vertices):
        reach = mean_edge_length(laid.vertices, target.shape.mesh.faces) * np.sqrt(spectral.area)
        vertices = _onto(surface, vertices, faces, reach)
    return Registered(
        vertices=vertices,
        faces=faces,
        distance=surface.of(vertices).distances,
        n_flipped=laid.n_flipped,
        fits=laid.fits,
        name=shape.name,
        reference_name=matcher.reference.name,
        **laid.quality._asdict(),
    )


def unregistered(shape: SkippedShape, target: GivenReference) -> Registered:
    """Return the answer for a shape that cannot be used."""
    n_0, nan = target.shape.n_given, float("nan")
    return Registered(
        vertices=np.full((n_0, 3), nan),
        faces=faces_of(target),
        distance=np.full(n_0, nan),
        n_flipped=0,
        off=nan,
        uncovered=nan,
        stretched=nan,
        energy=nan,
        fits=False,
        name=shape.name,
        reference_name=target.shape.name,
    )


def with_detail(target: GivenReference, laid: FloatArray) -> FloatArray:
    """Return the given vertices of the reference, moved with the working vertices, at unit area.

    Detail beyond the working mesh rotates with it; components that were left out follow the nearest
    vertex.
    """
    spectral_0 = target.shape
    if spectral_0.prolongation is None:
        return laid
    working, given = spectral_0.vertices, target.arrays[0] / np.sqrt(spectral_0.area)
    turns = ElasticSurface.at_rest(working, spectral_0.mesh.faces).rotations(laid)
    columns = np.hstack([working, laid, turns.reshape(-1, 9)])
    carried, lost = spectral_0.prolong(columns), ~spectral_0.prolongation.placed
    if lost.any():
        finite = lost & np.isfinite(given).all(axis=1)
        carried[finite] = columns[KDTree(working).query(given[finite])[1]]
        lost &= ~finite
    carried[lost] = columns[0]  # vertices without coordinates
    rotations = nearest_rotations(carried[:, 6:].reshape(-1, 3, 3))
    beyond = np.where(lost[:, None], 0.0, np.nan_to_num(given - carried[:, :3]))
    return np.asarray(carried[:, 3:6] + np.einsum("nab,nb->na", rotations, beyond))


def _onto(
    surface: ClosestPoints, vertices: FloatArray, faces: IntArray, reach: float
) -> FloatArray:
    """Move vertices onto the surface where it is near and the normals agree.

    Either mesh may have been given inside out; the majority of the vertices decides.
    """
    near, normals = surface.of(vertices), vertex_normals(vertices, faces)
    cosines = np.einsum("na,na->n", normals, near.normals)
    agree = cosines * np.sign(np.median(cosines)) > _AGREES
    moved = agree & (near.distances < reach) & ~near.on_rim
    return np.where(moved[:, None], near.points, vertices)


def faces_of(target: GivenReference) -> IntArray:
    """Return the faces of the reference as it was given."""
    mesh = target.shape.mesh if target.shape.given is None else open_given(target.shape.given)
    return mesh.faces if isinstance(mesh, Mesh) else mesh[1]
