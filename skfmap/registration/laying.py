"""Non-rigid registration of the reference to matched points and to the closest surface points."""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from skfmap._tools.types import BoolArray, FloatArray, IntArray, SparseMatrix
from skfmap.geometry.closest import ClosestPoints, face_normals
from skfmap.geometry.elasticity import ElasticSurface, nearest_rotations
from skfmap.geometry.normals import vertex_normals
from skfmap.registration.deformation import Deformation

__all__ = ["Anchors", "flipped_faces", "lay", "lay_on_points", "relaxed", "unfold"]

# Attraction by matched points, relative to edges of weight about 1. Values from 0.01 to 0.2 all
# gave the same errors. The second is the number of rounds.
_DRAW = 0.05
_POINT_ROUNDS = 8
# Scale, in sqrt(area), of the robust weight of matched points: farther ones are probably wrong.
_WRONG = 0.05
# Standard deviation, in sqrt(area), of the Gaussian weight of the attraction by the surface.
_REACH = 0.1
# Cosine of the angle within which normals agree: 60 degrees.
_AGREES = 0.5
# Initial stiffness as a multiple of the final one, and the number of rounds.
_STIFFER, _ROUNDS = 100.0, 9
# Number of alternations of rotations and coordinates in a round.
_TURNS = 2
# Weight that holds vertices where they are, relative to 1 for the surface: without any attraction,
# nothing moves.
_IN_PLACE = 1e-7
# Number of rings around folds that are smoothed, in each round of unfolding.
_UNFOLDING = (1, 2, 2, 3, 3, 4, 4)
# Maximum number of rounds in which corners of the remaining folds move towards their neighbours.
_SMOOTHING = 20


class Anchors(NamedTuple):
    """Places on the reference, and the points that attract them.

    Attributes
    ----------
    places : sparse array of shape (n, n_vertices)
        Barycentric weights of the places; rows sum to 1.
    points : ndarray of shape (n, 3)
        Target positions.
    weights : ndarray of shape (n,)
        Strength of the attraction, relative to 1 for the surface at each vertex.
    """

    places: SparseMatrix
    points: FloatArray
    weights: FloatArray


def lay_on_points(deformation: Deformation, anchors: Anchors, start: FloatArray) -> FloatArray:
    """Return the reference deformed so that places on it lie near given points.

    The weights of points that the deformation cannot reach decrease from round to round.

    Parameters
    ----------
    deformation : Deformation
        Deformation model.
    anchors : Anchors
        Places and points.
    start : ndarray of shape (n_vertices, 3)
        Initial coordinates.

    Returns
    -------
    ndarray of shape (n_vertices, 3)
        Coordinates of the vertices.
    """
    vertices, weights, elastic = start, anchors.weights, deformation.mean
    for _ in range(_POINT_ROUNDS):
        drawn = anchors._replace(weights=_DRAW * weights)
        vertices = relaxed(elastic, 1.0, vertices, drawn, n_turns=1)
        elastic = deformation.adapted(vertices)
        off = np.linalg.norm(anchors.places @ vertices - anchors.points, axis=1)
        weights = anchors.weights / np.square(1 + np.square(off / _WRONG))
    return vertices


def lay(
    deformation: Deformation,
    faces: IntArray,
    target: ClosestPoints,
    start: FloatArray,
    areas: FloatArray,
    *,
    stiffness: float,
    anchors: Anchors | None = None,
) -> FloatArray:
    """Return the reference attracted by the closest points of a surface, with falling stiffness.

    Closest points do not attract if they are far away, if their normals do not agree, or if they
    lie on the rim of an open surface.

    Parameters
    ----------
    deformation : Deformation
        Deformation model.
    faces : ndarray of int, shape (n_faces, 3)
        Faces of the reference.
    target : ClosestPoints
        The surface, of unit area.
    start : ndarray of shape (n_vertices, 3)
        Initial coordinates.
    areas : ndarray of shape (n_vertices,)
        Areas of the reference's vertices. The attraction of a vertex is proportional to its area.
    stiffness : float
        Stiffness of the last round, relative to the attraction of each vertex by the surface, whose
        mean is 1.
    anchors : Anchors, optional
        Additional points that attract places of the reference.

    Returns
    -------
    ndarray of shape (n_vertices, 3)
        Coordinates of the vertices.
    """
    vertices, draw = start, areas / areas.mean()
    for now in np.geomspace(_STIFFER * stiffness, stiffness, _ROUNDS):
        near = target.of(vertices)
        normals = vertex_normals(vertices, faces)
        agree = np.einsum("na,na->n", normals, near.normals) > _AGREES
        weights = draw * np.exp(-np.square(near.distances / _REACH) / 2) * (agree & ~near.on_rim)
        drawn = Anchors(sp.eye_array(len(vertices), format="csr"), near.points, weights)
        elastic = deformation.adapted(vertices)
        vertices = relaxed(elastic, float(now), vertices, drawn, anchors, n_turns=_TURNS)
    return vertices


def flipped_faces(deformation: Deformation, faces: IntArray, vertices: FloatArray) -> BoolArray:
    """Return which faces are folded over, against the mean rotation of their corners."""
    rest = deformation.shape_at_rest
    turns = deformation.mean.rotations(vertices)[faces].mean(axis=1)
    before = np.einsum("nab,nb->na", turns, face_normals(rest, faces))
    return np.asarray(np.einsum("na,na->n", before, face_normals(vertices, faces)) < 0)


def unfold(deformation: Deformation, faces: IntArray, vertices: FloatArray) -> FloatArray:
    """Return coordinates in which folds and their neighbourhoods are smoothed out.

    The rotations around folds are interpolated as smoothly as possible from those of the
    surroundings, and the coordinates follow them.
    """
    elastic = deformation.mean
    rings = (elastic.ends @ elastic.ends.T).tocsr()
    for n_rings in _UNFOLDING:
        flipped = flipped_faces(deformation, faces, vertices)
        if not flipped.any():
            break
        around = np.bincount(faces[flipped].ravel(), minlength=len(vertices)).astype(np.float64)
        for _ in range(n_rings):
            around = np.asarray(rings @ around)
        free = around > 0
        if free.all():
            break
        vertices = _following(deformation.adapted(vertices), vertices, free)
    return _smoothed(deformation, faces, vertices)


def _smoothed(deformation: Deformation, faces: IntArray, vertices: FloatArray) -> FloatArray:
    """Return coordinates in which corners of folds are moved half way to their neighbours' mean.

    The remaining folds are slivers of about a twentieth of a face. Of 10,000 faces of cats, 0 to 26
    are folded before this, and none or one afterwards.
    """
    ends = deformation.mean.ends
    neighbours = (ends @ ends.T - sp.diags_array(np.asarray(ends.sum(axis=1)).ravel())).tocsr()
    counts = np.asarray(neighbours.sum(axis=1), dtype=np.float64).reshape(-1, 1)
    for _ in range(_SMOOTHING):
        flipped = flipped_faces(deformation, faces, vertices)
        if not flipped.any():
            break
        corners = np.unique(faces[flipped])
        means = np.asarray(neighbours[corners] @ vertices) / counts[corners]
        vertices = vertices.copy()
        vertices[corners] = (vertices[corners] + means) / 2
    return vertices


def _following(elastic: ElasticSurface, vertices: FloatArray, free: BoolArray) -> FloatArray:
    """Return coordinates in which free vertices follow rotations interpolated from the others."""
    rows = elastic.stiffness[free]
    solver, held = splu(rows[:, free].tocsc()), rows[:, ~free]
    rotations = elastic.rotations(vertices)
    smooth = solver.solve(-np.asarray(held @ rotations[~free].reshape(-1, 9)))
    rotations[free] = nearest_rotations(smooth.reshape(-1, 3, 3))
    followed = vertices.copy()
    followed[free] = solver.solve(
        elastic.turned(rotations)[free] - np.asarray(held @ vertices[~free])
    )
    return followed


def relaxed(
    elastic: ElasticSurface,
    stiffness: float,
    vertices: FloatArray,
    *drawn: Anchors | None,
    n_turns: int,
) -> FloatArray:
    """Return coordinates of low energy, by alternating between rotations and coordinates."""
    matrix = stiffness * elastic.stiffness + _IN_PLACE * sp.eye_array(len(vertices))
    pull = _IN_PLACE * vertices
    for one in drawn:
        if one is not None:
            weighted = sp.diags_array(one.weights) @ one.places
            matrix = matrix + one.places.T @ weighted
            pull += np.asarray(weighted.T @ one.points)
    solver = splu(matrix.tocsc())
    for _ in range(n_turns):
        turned = elastic.turned(elastic.rotations(vertices))
        vertices = solver.solve(stiffness * turned + pull)
    return np.asarray(vertices)
