"""Alignment of a shape to another by a similarity, as the start of a registration."""

from collections.abc import Iterable
from itertools import chain

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.functional.samples import farthest_points
from skfmap.functional.similarity import Similarity, best_similarity
from skfmap.geometry.closest import ClosestPoints
from skfmap.geometry.normals import vertex_normals

__all__ = ["align", "nearest_poses", "principal_axes"]

# Number of vertices that are aligned: few to choose among starts, more for the final result; and
# the numbers of rounds with each.
_FEW, _MANY = 500, 1500
_ROUNDS_OF_FEW, _ROUNDS_OF_MANY = 20, 25
# Fraction of the nearest points that are used, in the first rounds and later; the others are parts
# that differ.
_AT_FIRST, _LATER, _FIRST_ROUNDS = 0.5, 0.8, 10
# Cosine of the angle within which normals agree, about 70 degrees: shapes are not yet deformed.
_AGREES = 0.3
# Number of orientations of the principal axes, and the factor on the costs of other starts: bodies
# that are nearly symmetric under half a turn fit about as well either way, and then the match
# decides.
_N_TURNS, _PREFERRED = 4, 0.7
# Cost, in sqrt(area), of a point whose normal does not agree, and the maximum cost of a point.
_AGAINST = 0.1
# For poses: numbers of vertices and of rounds to choose among them, and for the final result.
_OF_POSES, _ROUNDS_OF_POSES, _MANY_OF_POSES, _ROUNDS_AT_LAST = 150, 6, 400, 15


def align(
    vertices: FloatArray,
    faces: IntArray,
    target: ClosestPoints,
    frame: tuple[FloatArray, FloatArray],
    areas: FloatArray,
    starts: Iterable[Similarity] = (),
) -> Similarity:
    """Return the similarity that best aligns a shape with a surface (iterative closest points).

    It starts from the four proper orientations of the principal axes, and from the given starts.
    The best result is kept; a given start is preferred if both are about as good.

    Parameters
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        The shape to move, of approximately unit area.
    target : ClosestPoints
        The surface, of unit area.
    frame : tuple of ndarray
        `principal_axes` of the surface.
    areas : ndarray of shape (n_vertices,)
        Areas of the vertices of the shape.
    starts : iterable of Similarity
        Additional starts.

    Returns
    -------
    Similarity
        The best similarity, which is not a reflection.
    """
    normals, rows = vertex_normals(vertices, faces), farthest_points(vertices, _MANY)
    own = principal_axes(vertices, areas)
    few, many = ((vertices[some], normals[some]) for some in (rows[:_FEW], rows))
    begun = [
        _closer(*few, target, start, _ROUNDS_OF_FEW) for start in chain(_turns(own, frame), starts)
    ]
    costs = [_cost(*few, target, found) for found in begun]
    costs[_N_TURNS:] = [_PREFERRED * cost for cost in costs[_N_TURNS:]]
    best = begun[int(np.argmin(costs))]
    return _closer(*many, target, best, _ROUNDS_OF_MANY)


def nearest_poses(
    poses: FloatArray,
    faces: IntArray,
    target: ClosestPoints,
    frame: tuple[FloatArray, FloatArray],
    areas: FloatArray,
    n_kept: int,
) -> list[FloatArray]:
    """Return the poses that similarities align best with a surface, the best first.

    Each pose is tried in the four proper orientations of the principal axes, and can be returned in
    more than one of them.

    Parameters
    ----------
    poses : ndarray of shape (n_poses, n_vertices, 3)
        Coordinates of one mesh in several poses, of approximately unit area.
    faces : ndarray of int, shape (n_faces, 3)
        Its faces.
    target, frame : ClosestPoints, tuple of ndarray
        The surface, of unit area, and its `principal_axes`.
    areas : ndarray of shape (n_vertices,)
        Areas of the vertices of the mesh.
    n_kept : int
        Number of poses to return.

    Returns
    -------
    list of ndarray of shape (n_vertices, 3)
        Aligned coordinates.
    """
    found: list[tuple[float, int, Similarity]] = []
    for number, pose in enumerate(poses):
        few = _some(pose, faces, _OF_POSES)
        for turn in _turns(principal_axes(pose, areas), frame):
            closer = _closer(*few, target, turn, _ROUNDS_OF_POSES)
            found.append((_cost(*few, target, closer), number, closer))
    found.sort(key=lambda one: one[:2])
    return [
        _closer(
            *_some(poses[number], faces, _MANY_OF_POSES), target, closer, _ROUNDS_AT_LAST
        ).apply(poses[number])
        for _, number, closer in found[:n_kept]
    ]


def _some(vertices: FloatArray, faces: IntArray, n: int) -> tuple[FloatArray, FloatArray]:
    """Return well-spread vertices and their normals."""
    rows = farthest_points(vertices, n)
    return vertices[rows], vertex_normals(vertices, faces)[rows]


def principal_axes(vertices: FloatArray, areas: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the area centroid, and the principal axes as the columns of a rotation."""
    share = areas / areas.sum()
    centre = share @ vertices
    _, axes = np.linalg.eigh((vertices - centre).T @ (share[:, None] * (vertices - centre)))
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return centre, axes


def _turns(
    own: tuple[FloatArray, FloatArray], onto: tuple[FloatArray, FloatArray]
) -> Iterable[Similarity]:
    """Yield the four similarities of scale 1 that map axes to axes."""
    for signs in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)):
        rotation = (own[1] * np.array(signs, dtype=np.float64)) @ onto[1].T
        yield Similarity(1.0, rotation, onto[0] - own[0] @ rotation)


def _closer(
    points: FloatArray, normals: FloatArray, target: ClosestPoints, start: Similarity, n_rounds: int
) -> Similarity:
    """Return the similarity after rounds of closest points that use only the nearest ones."""
    found = start
    for number in range(n_rounds):
        near = target.of(found.apply(points))
        agree = np.einsum("na,na->n", normals @ found.rotation, near.normals) > _AGREES
        usable = agree & ~near.on_rim
        if usable.sum() < 4:
            break
        share = _AT_FIRST if number < _FIRST_ROUNDS else _LATER
        usable &= near.distances <= np.quantile(near.distances[usable], share)
        found = best_similarity(points, near.points, usable.astype(np.float64))
    return found


def _cost(
    points: FloatArray, normals: FloatArray, target: ClosestPoints, found: Similarity
) -> float:
    """Return the mean distance from the surface, with a fixed cost where normals disagree."""
    near = target.of(found.apply(points))
    agree = np.einsum("na,na->n", normals @ found.rotation, near.normals) > _AGREES
    return float(np.where(agree, np.minimum(near.distances, _AGAINST), _AGAINST).mean())
