"""The whole reference laid onto a part: what the part shows draws it, and the rest follows."""

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

# Regions that are counted with the likeliest one, by their distance from it, in sqrt(area).
_NEIGHBOURS = 0.15
# Points of the part that draw the reference to themselves.
_N_POINTS = 2000
# Distance, in sqrt(area), at which what draws counts for little, in the first round and the last.
_REACH, _REACH_AT_LAST = 0.1, 0.03
# Distance on the reference, in sqrt(area), at which what is believed elsewhere counts for little,
# and how much it counts beside one in space.
_ELSEWHERE, _BESIDE_SPACE = 0.1, 0.4
# Cosine of the angle within which normals agree: 60 degrees.
_AGREES = 0.5
# The stiffness falls from so many times what it ends with, in rounds of so many turns.
_STIFFER, _TURNS = 100.0, 2


def believed_places(
    probabilities: npt.NDArray[np.float32], centres: FloatArray, distances_0: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return where on the reference points are believed to be, and how firmly.

    Parameters
    ----------
    probabilities : ndarray of shape (n_points, n_regions)
        Of the regions.
    centres : ndarray of shape (n_regions, 3)
        Of the regions, on the reference.
    distances_0 : ndarray of shape (n_regions, n_regions)
        Along it.

    Returns
    -------
    places : ndarray of shape (n_points, 3)
        Near the reference: means of the centres about the likeliest.
    belief : ndarray of shape (n_points,)
        The probability of these regions together.
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
    """Return the reference deformed so that places on it lie near the points that believe in them.

    Parameters
    ----------
    deformation : Deformation
        How it deforms.
    faces : ndarray of int, shape (n_faces, 3)
        Of the reference.
    points, places, belief : ndarray of shape (n_points, 3), (n_points, 3), (n_points,)
        Points of the part, where on the reference they are believed to be, and how firmly.
    vertices_0 : ndarray of shape (n_vertices, 3)
        Of the reference as it stands.
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
    """Return the reference drawn to a part, softer from round to round.

    Vertices of the reference are drawn to where the part is nearest, but not to its rim, beyond
    which nothing was scanned. And points of the part, all of which belong somewhere, draw what of
    the reference is nearest to them.

    Parameters
    ----------
    deformation : Deformation
        How it deforms.
    faces, areas : ndarray of int, shape (n_faces, 3), ndarray of shape (n_vertices,)
        Of the reference, and areas of its vertices.
    vertices_0 : ndarray of shape (n_vertices, 3)
        Of the reference as it stands.
    part : tuple of ndarray
        Vertices and faces of the part, in units of sqrt(area) of the reference.
    places : ndarray of shape (n_vertices_i, 3)
        Where on the reference vertices of the part are believed to be. They do not draw what is
        elsewhere, so that a leg that was not scanned is not laid onto the other.
    start : ndarray of shape (n_vertices, 3)
        Coordinates to begin with.
    stiffness : float
        Of the last round, beside a mean of 1 with which the part draws a vertex.
    n_rounds : int
        How many.
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
    """Return where points are nearest to the reference; where that is not believed, to a vertex."""
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
