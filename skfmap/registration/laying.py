"""The reference laid onto a surface: deformed from a start, then drawn to the closest points."""

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

# How strongly matched points draw, beside edges of weight about 1; of 0.01 to 0.2 all did as well.
_DRAW = 0.05
_POINT_ROUNDS = 8
# Distance, in sqrt(area), beyond which a matched point is taken for a wrong one.
_WRONG = 0.05
# Distance, in sqrt(area), beyond which the surface draws no more.
_REACH = 0.1
# Cosine of the angle within which normals agree: 60 degrees.
_AGREES = 0.5
# The stiffness falls from so many times what it ends with, in so many rounds.
_STIFFER, _ROUNDS = 100.0, 9
# Turns of rotations and coordinates in a round.
_TURNS = 2
# What holds vertices where they are, beside the surface's 1: if nothing draws, nothing moves.
_IN_PLACE = 1e-7
# Rounds in which folds are let go, with so many rings around them in each.
_UNFOLDING = (1, 2, 2, 3, 3, 4, 4)
# Rounds in which corners of what folds are left move towards their neighbours.
_SMOOTHING = 20


class Anchors(NamedTuple):
    """Places of the reference, and the points that they should lie on.

    Attributes
    ----------
    places : sparse array of shape (n, n_vertices)
        Rows sum to 1.
    points : ndarray of shape (n, 3)
        Where they belong.
    weights : ndarray of shape (n,)
        How strongly they draw, beside the surface's 1 for each vertex.
    """

    places: SparseMatrix
    points: FloatArray
    weights: FloatArray


def lay_on_points(deformation: Deformation, anchors: Anchors, start: FloatArray) -> FloatArray:
    """Return the reference deformed so that its places lie near given points.

    Points that the deformation cannot follow count for less from round to round.

    Parameters
    ----------
    deformation : Deformation
        How it deforms.
    anchors : Anchors
        The points.
    start : ndarray of shape (n_vertices, 3)
        Coordinates to begin with.

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
    """Return the reference drawn to the closest points of a surface, softer from round to round.

    Points whose normals do not agree, that are far, or on the rim of an open surface do not draw.

    Parameters
    ----------
    deformation : Deformation
        How it deforms.
    faces : ndarray of int, shape (n_faces, 3)
        Of the reference.
    target : ClosestPoints
        The surface, of unit area.
    start : ndarray of shape (n_vertices, 3)
        Coordinates to begin with.
    areas : ndarray of shape (n_vertices,)
        Of the reference's vertices; the surface draws each by its area.
    stiffness : float
        Of the last round, beside a mean of 1 with which the surface draws a vertex.
    anchors : Anchors, optional
        Points that draw as well.

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
    """Return which faces are folded over: turned against the rotation of their corners."""
    rest = deformation.shape_at_rest
    turns = deformation.mean.rotations(vertices)[faces].mean(axis=1)
    before = np.einsum("nab,nb->na", turns, face_normals(rest, faces))
    return np.asarray(np.einsum("na,na->n", before, face_normals(vertices, faces)) < 0)


def unfold(deformation: Deformation, faces: IntArray, vertices: FloatArray) -> FloatArray:
    """Return the coordinates with folds smoothed out, and what lies around them.

    Around folds, rotations are those of the surroundings, as smooth as can be, and coordinates
    follow them.
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
    """Return the coordinates with corners of folds moved half way to their neighbours' mean.

    What folds are left are slivers, by a twentieth of a face: of 10,000 faces of cats, 0 to 26, and
    none or one after this.
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
    """Return the coordinates with free ones put where the others' rotations put them."""
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
    """Return the coordinates of least energy, rotations and coordinates by turns."""
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
