"""Registration of the whole reference to a part that attracts only what it shows."""

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from skfmap._tools.types import FloatArray, IntArray
from skfmap.functional.neighbours import nearest
from skfmap.functional.samples import farthest_points
from skfmap.functional.similarity import best_similarity
from skfmap.geometry.closest import ClosestPoints, NearestPlaces, nearest_places
from skfmap.geometry.normals import vertex_normals
from skfmap.registration.deformation import Deformation
from skfmap.registration.laying import Anchors, lay_on_points, relaxed

__all__ = ["believed_places", "lay_on_part", "start_from"]

# Regions within this distance of the most likely one, in sqrt(area), are averaged with it.
_NEIGHBOURS = 0.15
# Number of points of the part that attract the reference.
_N_POINTS = 2000
# Standard deviation, in sqrt(area), of the Gaussian weight of an attraction with distance, in the
# first and in the last round.
_REACH, _REACH_AT_LAST = 0.1, 0.03
# Standard deviation, in sqrt(area), of the Gaussian weight with the distance on the reference from
# the likely place of a point, and the weight of that distance relative to one in space.
_ELSEWHERE, _BESIDE_SPACE = 0.1, 0.4
# Cosine of the angle within which normals agree: 60 degrees.
_AGREES = 0.5
# Initial stiffness as a multiple of the final one, and the number of alternations of rotations and
# coordinates in each round.
_STIFFER, _TURNS = 100.0, 2


def believed_places(
    probabilities: npt.NDArray[np.float32], centres: FloatArray, distances_0: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the likely place of each point on the reference, and its probability.

    Parameters
    ----------
    probabilities : ndarray of shape (n_points, n_regions)
        Probabilities of regions at each point.
    centres : ndarray of shape (n_regions, 3)
        Centres of the regions on the reference.
    distances_0 : ndarray of shape (n_regions, n_regions)
        Distances between the centres along the reference.

    Returns
    -------
    places : ndarray of shape (n_points, 3)
        Means of the centres around the most likely one, which are near the reference.
    belief : ndarray of shape (n_points,)
        Total probability of these regions.
    """
    kept = probabilities * (distances_0[probabilities.argmax(axis=1)] < _NEIGHBOURS)
    belief = kept.sum(axis=1)
    return np.asarray(kept @ centres / belief[:, None]), np.asarray(belief, dtype=np.float64)


def start_from(
    deformation: Deformation,
    faces: IntArray,
    points: FloatArray,
    places: FloatArray,
    belief: FloatArray,
    vertices_0: FloatArray,
) -> FloatArray:
    """Return the reference deformed so that the likely places of points lie near these points.

    Parameters
    ----------
    deformation : Deformation
        Deformation model.
    faces : ndarray of int, shape (n_faces, 3)
        Faces of the reference.
    points, places, belief : ndarray of shape (n_points, 3), (n_points, 3), (n_points,)
        Points of the part, their likely places on the reference, and the probabilities of these.
    vertices_0 : ndarray of shape (n_vertices, 3)
        Vertices of the undeformed reference.
    """
    on_0 = nearest_places(places, vertices_0, faces)
    matrix = _matrix(on_0.corners, on_0.weights, len(vertices_0))
    weights = belief * (len(vertices_0) / len(points))
    rest = deformation.shape_at_rest
    moved = best_similarity(np.asarray(matrix @ rest), points, weights)
    start = (rest @ moved.rotation) + (
        np.average(points, axis=0, weights=weights)
        - np.average(matrix @ rest, axis=0, weights=weights) @ moved.rotation
    )
    return lay_on_points(deformation, Anchors(matrix, points, weights), start)


def lay_on_part(
    deformation: Deformation,
    faces: IntArray,
    areas: FloatArray,
    vertices_0: FloatArray,
    part: tuple[FloatArray, IntArray],
    places: FloatArray,
    start: FloatArray,
    *,
    stiffness: float,
    n_rounds: int,
) -> FloatArray:
    """Return the reference attracted by a part, with decreasing stiffness.

    Each vertex of the reference is attracted by the closest point of the part, unless that lies on
    the rim, beyond which nothing was scanned. Conversely, points of the part, all of which
    correspond to some place, attract the closest place of the reference.

    Parameters
    ----------
    deformation : Deformation
        Deformation model.
    faces, areas : ndarray of int, shape (n_faces, 3), ndarray of shape (n_vertices,)
        Faces of the reference, and areas of its vertices.
    vertices_0 : ndarray of shape (n_vertices, 3)
        Vertices of the undeformed reference.
    part : tuple of ndarray
        Vertices and faces of the part, in units of sqrt(area) of the reference.
    places : ndarray of shape (n_vertices_i, 3)
        Likely places of the vertices of the part on the reference. A vertex of the part attracts
        only what is near its place, so that a leg that was not scanned is not laid onto the other.
    start : ndarray of shape (n_vertices, 3)
        Initial coordinates.
    stiffness : float
        Stiffness of the last round, relative to the attraction of each vertex by the part, whose
        mean is 1.
    n_rounds : int
        Number of rounds.
    """
    target, normals_i = ClosestPoints(*part), vertex_normals(*part)
    rows = farthest_points(part[0], _N_POINTS)
    points, normals_i, believed = part[0][rows], normals_i[rows], places[rows]
    vertices, draw = start, areas / areas.mean()
    stiffnesses = np.geomspace(_STIFFER * stiffness, stiffness, n_rounds)
    for now, reach in zip(stiffnesses, np.geomspace(_REACH, _REACH_AT_LAST, n_rounds), strict=True):
        normals = vertex_normals(vertices, faces)
        near = target.of(vertices)
        agree = np.einsum("na,na->n", normals, near.normals) > _AGREES
        pulls = draw * np.exp(-np.square(near.distances / reach) / 2) * (agree & ~near.on_rim)
        elsewhere = np.linalg.norm(places[nearest(near.points, part[0])] - vertices_0, axis=1)
        pulls *= np.exp(-np.square(elsewhere / _ELSEWHERE) / 2)
        there = Anchors(sp.eye_array(len(vertices), format="csr"), near.points, pulls)
        back = _back(points, believed, vertices, vertices_0, faces)
        facing = np.einsum("nc,ncd->nd", back.weights, normals[back.corners])
        agree = np.einsum("na,na->n", facing, normals_i) > _AGREES
        pulls = np.exp(-np.square(back.distances / (2 * reach)) / 2) * agree
        here = Anchors(_matrix(back.corners, back.weights, len(vertices)), points, pulls)
        elastic = deformation.adapted(vertices)
        vertices = relaxed(elastic, float(now), vertices, there, here, n_turns=_TURNS)
    return vertices


def _back(
    points: FloatArray,
    believed: FloatArray,
    vertices: FloatArray,
    vertices_0: FloatArray,
    faces: IntArray,
) -> NearestPlaces:
    """Return the nearest place of the reference for each point.

    Where that is far from the likely place of the point, return the vertex that is nearest in space
    and on the reference together.
    """
    back = nearest_places(points, vertices, faces)
    there = np.einsum("nc,ncd->nd", back.weights, vertices_0[back.corners])
    rows = np.flatnonzero(np.linalg.norm(there - believed, axis=1) > _ELSEWHERE)
    if not len(rows):
        return back
    chosen = nearest(
        np.column_stack([points[rows], _BESIDE_SPACE * believed[rows]]),
        np.column_stack([vertices, _BESIDE_SPACE * vertices_0]),
    )
    corners, weights, distances = back.corners.copy(), back.weights.copy(), back.distances.copy()
    corners[rows], weights[rows] = chosen[:, None], [1.0, 0.0, 0.0]
    distances[rows] = np.linalg.norm(points[rows] - vertices[chosen], axis=1)
    return NearestPlaces(corners, weights, distances)


def _matrix(corners: IntArray, weights: FloatArray, n_vertices: int) -> sp.csr_array:
    rows = np.repeat(np.arange(len(corners)), 3)
    shape = (len(corners), n_vertices)
    return sp.coo_array((weights.ravel(), (rows, corners.ravel())), shape=shape).tocsr()
