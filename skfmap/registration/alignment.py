"""A shape moved onto another by a similarity: where shapes are stiff, space says where to begin."""

from collections.abc import Iterable
from itertools import chain

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.functional.samples import farthest_points
from skfmap.functional.similarity import Similarity, best_similarity
from skfmap.geometry.closest import ClosestPoints
from skfmap.geometry.normals import vertex_normals

__all__ = ["align", "nearest_poses", "principal_axes"]

# Vertices that are aligned: few to choose among starts, more for the end.
_FEW, _MANY = 500, 1500
_ROUNDS_OF_FEW, _ROUNDS_OF_MANY = 20, 25
# Share of the nearest points that count, at first and later: what is left are parts that differ.
_AT_FIRST, _LATER, _FIRST_ROUNDS = 0.5, 0.8, 10
# Cosine of the angle within which normals agree, about 70 degrees: shapes are not yet deformed.
_AGREES = 0.3
# Cost of other starts, as a share of what it is: bodies that are nearly their own image in half a
# turn lie about as well either way, and then the match decides.
_N_TURNS, _PREFERRED = 4, 0.7
# Distance, in sqrt(area), that a point counts with whose normal does not agree.
_AGAINST = 0.1
# Of poses: vertices that choose among them and the rounds in which they do, and then the end.
_OF_POSES, _ROUNDS_OF_POSES, _MANY_OF_POSES, _ROUNDS_AT_LAST = 150, 6, 400, 15


def align(
    vertices: FloatArray,
    faces: IntArray,
    target: ClosestPoints,
    frame: tuple[FloatArray, FloatArray],
    areas: FloatArray,
    starts: Iterable[Similarity] = (),
) -> Similarity:
    """Return the similarity that lays a shape nearest onto a surface (iterative closest points).

    From the principal axes in their four proper turns, and from other starts; the best is kept,
    others rather than turns where both are about as good.

    Parameters
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        The shape that is moved, of about unit area.
    target : ClosestPoints
        The surface, of unit area.
    frame : tuple of ndarray
        `principal_axes` of the surface.
    areas : ndarray of shape (n_vertices,)
        Of the vertices of the shape.
    starts : iterable of Similarity
        What else to begin with.

    Returns
    -------
    Similarity
        Without a reflection.
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
    """Return the poses that a similarity lays nearest onto a surface, the nearest first.

    Each is tried in the four proper turns of the principal axes, and can be kept in more than one.

    Parameters
    ----------
    poses : ndarray of shape (n_poses, n_vertices, 3)
        Coordinates of one mesh, of about unit area.
    faces : ndarray of int, shape (n_faces, 3)
        Its faces.
    target, frame : ClosestPoints, tuple of ndarray
        The surface, of unit area, and its `principal_axes`.
    areas : ndarray of shape (n_vertices,)
        Of the vertices of the mesh.
    n_kept : int
        How many are returned.

    Returns
    -------
    list of ndarray of shape (n_vertices, 3)
        Coordinates where they lie.
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
    """Return well-spread vertices and the normals there."""
    rows = farthest_points(vertices, n)
    return vertices[rows], vertex_normals(vertices, faces)[rows]


def principal_axes(vertices: FloatArray, areas: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the centroid of the area, and its principal axes as the columns of a rotation."""
    share = areas / areas.sum()
    centre = share @ vertices
    _, axes = np.linalg.eigh((vertices - centre).T @ (share[:, None] * (vertices - centre)))
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return centre, axes


def _turns(
    own: tuple[FloatArray, FloatArray], onto: tuple[FloatArray, FloatArray]
) -> Iterable[Similarity]:
    """Yield the four similarities of scale 1 that take axes to axes."""
    for signs in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)):
        rotation = (own[1] * np.array(signs, dtype=np.float64)) @ onto[1].T
        yield Similarity(1.0, rotation, onto[0] - own[0] @ rotation)


def _closer(
    points: FloatArray, normals: FloatArray, target: ClosestPoints, start: Similarity, n_rounds: int
) -> Similarity:
    """Return the similarity after rounds of closest points, from those that are nearest."""
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
    """Return the mean distance from the surface, where normals agree."""
    near = target.of(found.apply(points))
    agree = np.einsum("na,na->n", normals @ found.rotation, near.normals) > _AGREES
    return float(np.where(agree, np.minimum(near.distances, _AGAINST), _AGAINST).mean())
