"""Registration of the reference to stiff shapes by a few landmarks, with checks of these."""

from itertools import combinations
from typing import NamedTuple, TypeAlias

import numpy as np
import scipy.sparse as sp

from skfmap._tools.parallel import threads_within
from skfmap._tools.types import BoolArray, FloatArray, IntArray, SparseMatrix
from skfmap.functional.neighbours import nearest_both
from skfmap.functional.samples import farthest_points
from skfmap.functional.similarity import best_similarity
from skfmap.geometry.closest import ClosestPoints
from skfmap.geometry.normals import vertex_normals
from skfmap.registration.deformation import Deformation
from skfmap.registration.laying import Anchors, lay
from skfmap.shapes import SpectralShape

_Surface: TypeAlias = tuple[FloatArray, IntArray]  # vertices and faces

__all__ = [
    "LandmarkBuild",
    "build_in_space",
    "exchanged",
    "lay_by_landmarks",
    "nearest_in_space",
]

# Stiffness for laying the reference onto training shapes, whose pairs are known.
_OF_TRAINING = 0.3
# Attraction by a landmark, relative to 1 for the surface at a vertex. Landmarks are noisy, so they
# are not fixed. On mandibles with 13 landmarks, 10 instead of 1 reduces errors from 0.288 to
# 0.256 mm; 3 and 30 are within 0.002 of 10.
_DRAW = 10.0
# Minimum number of landmarks that a similarity is fitted to. Two landmarks count as exchanged if
# exchanging them leaves little of the squared distance from where the others put them, and if that
# distance is far beyond the usual one. On mandibles, 1,478 of 1,482 exchanges are found, without
# false alarms.
_TO_FIT, _RELIEF, _BEYOND = 4, 4.0, 4.0
# Number of groups of landmarks that are left out in turn.
_N_GROUPS = 3
# A landmark is doubtful if the others put it farther away than this, in sqrt(area), and than this
# many times the median of its shape. On mandibles and skulls the maximum is 0.1, where a tip is
# broken.
_DOUBTFUL, _TIMES = 0.12, 6.0
# Distance that opposite normals add, in mean edge lengths.
_NORMALS = 4.0


class LandmarkBuild(NamedTuple):
    """A map that was computed in space from landmarks.

    Attributes
    ----------
    p2p, inverse : ndarray of int
        Working vertex of S_0 for each one of S_i, and of S_i for each one of S_0.
    wrong : ndarray of bool, shape (n_landmarks,)
        Landmarks that are far from where the others put them; they are not used.
    put : ndarray of int, shape (n_landmarks,)
        Working vertex of S_0 that lies nearest to each landmark when it is left out.
    exchanged : list of (int, int)
        Rows of pairs of landmarks that are exchanged with each other; these are wrong too.
    """

    p2p: IntArray
    inverse: IntArray
    wrong: BoolArray
    put: IntArray
    exchanged: list[tuple[int, int]]


def lay_by_landmarks(spectral_0: SpectralShape, surface: _Surface, pairs: Anchors) -> FloatArray:
    """Return the reference's working vertices on a stiff shape, (n_vertices_0, 3), at unit area.

    They are aligned by a similarity fitted to the landmarks, and then attracted by the landmarks
    and by the closest points of the surface.

    Parameters
    ----------
    spectral_0 : SpectralShape
        The reference S_0.
    surface : tuple of ndarray
        Vertices and faces of the shape, of unit area.
    pairs : Anchors
        Landmarks, as places on S_0 and points on the shape.
    """
    rest = Deformation.of_reference(spectral_0.vertices, spectral_0.mesh.faces)
    at = np.asarray(pairs.places @ spectral_0.vertices)
    return lay(
        rest,
        spectral_0.mesh.faces,
        ClosestPoints(*surface),
        best_similarity(at, pairs.points, pairs.weights).apply(spectral_0.vertices),
        spectral_0.mass,
        stiffness=_OF_TRAINING,
        anchors=pairs,
    )


def build_in_space(
    spectral_0: SpectralShape, surface: _Surface, places_0: SparseMatrix, points: FloatArray
) -> LandmarkBuild:
    """Compute the map of a stiff shape from its landmarks, without those that others contradict.

    Parameters
    ----------
    spectral_0 : SpectralShape
        The reference S_0.
    surface : tuple of ndarray
        Vertices and faces of the shape, of unit area.
    places_0 : sparse array of shape (n_landmarks, n_vertices_0)
        Places of the landmarks on S_0.
    points : ndarray of shape (n_landmarks, 3)
        Their positions on the shape, at unit area.
    """
    pairs = Anchors(places_0, points, np.full(len(points), _DRAW))
    swapped = exchanged(np.asarray(places_0 @ spectral_0.vertices), points)
    right = ~np.isin(np.arange(len(points)), swapped)
    put = _left_out(spectral_0, surface, pairs, right)
    doubtful = _doubtful(spectral_0, places_0, put) & right
    if doubtful.any() and (right & ~doubtful).sum() > _N_GROUPS:
        # Judge all landmarks again by those that are not doubtful: right ones may have seemed
        # doubtful because of wrong ones.
        put = _left_out(spectral_0, surface, pairs, right & ~doubtful)
        right &= ~_doubtful(spectral_0, places_0, put)
    laid = lay_by_landmarks(spectral_0, surface, _only(pairs, right))
    points_i, points_0 = nearest_in_space(spectral_0, surface, laid)
    p2p, inverse = nearest_both(points_i, points_0, n_threads=threads_within())
    return LandmarkBuild(p2p, inverse, ~right, put, swapped)


def exchanged(points_0: FloatArray, points: FloatArray) -> list[tuple[int, int]]:
    """Return the pairs of landmarks of a stiff shape that are exchanged with each other.

    Parameters
    ----------
    points_0, points : ndarray of shape (n_landmarks, 3)
        Landmarks of S_0 and of the shape.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.registration.by_landmarks import exchanged
    >>> points = np.random.default_rng(0).normal(size=(8, 3))
    >>> exchanged(points, 2 * points[[0, 5, 2, 3, 4, 1, 6, 7]])
    [(1, 5)]
    """
    n, found = len(points), []
    for a, b in combinations(range(n), 2):
        others = np.isin(np.arange(n), (a, b), invert=True).astype(np.float64)
        if others.sum() < _TO_FIT:
            return []
        off = points - best_similarity(points_0, points, others).apply(points_0)
        moved = points - off  # where the others put them
        usual = float(np.median(np.square(off).sum(axis=1)[others > 0]))
        own = float(np.square(off[[a, b]]).sum())
        crossed = float(np.square(points[[a, b]] - moved[[b, a]]).sum())
        if own > 2 * max(_RELIEF * crossed, _BEYOND**2 * usual):
            found.append((own - crossed, a, b))
    chosen: list[tuple[int, int]] = []
    for _, a, b in sorted(found, reverse=True):  # each landmark once, the clearest first
        if not {a, b} & {one for pair in chosen for one in pair}:
            chosen.append((a, b))
    return sorted(chosen)


def nearest_in_space(
    spectral_0: SpectralShape, surface: _Surface, laid: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return rows of coordinates and weighted normals, for S_i and for S_0.

    The distance of two rows increases with the difference of the normals.
    """
    width = _NORMALS / 2 * np.sqrt(2 / len(laid))
    rows = (
        np.hstack([vertices, width * vertex_normals(vertices, faces)])
        for vertices, faces in (
            surface,
            (laid, spectral_0.mesh.faces),
        )
    )
    points_i, points_0 = rows
    return points_i, points_0


def _only(pairs: Anchors, rows: BoolArray) -> Anchors:
    return Anchors(sp.csr_array(pairs.places[rows]), pairs.points[rows], pairs.weights[rows])


def _left_out(
    spectral_0: SpectralShape, surface: _Surface, pairs: Anchors, right: BoolArray
) -> IntArray:
    """Return the vertex of S_0 where the right landmarks of the other groups put each landmark."""
    put = np.empty(len(right), dtype=np.int64)
    at = np.asarray(pairs.places @ spectral_0.vertices)
    rank = np.argsort(farthest_points(at, len(at)))  # the groups are spread
    for group in range(_N_GROUPS):
        rows = rank % _N_GROUPS == group
        laid = lay_by_landmarks(spectral_0, surface, _only(pairs, right & ~rows))
        apart = np.square(pairs.points[rows, None] - laid[None]).sum(axis=2)
        put[rows] = apart.argmin(axis=1)
    return put


def _doubtful(spectral_0: SpectralShape, places_0: SparseMatrix, put: IntArray) -> BoolArray:
    off = spectral_0.vertices[put] - np.asarray(places_0 @ spectral_0.vertices)
    errors = np.linalg.norm(off, axis=1)
    return np.asarray(errors > max(_DOUBTFUL, _TIMES * float(np.median(errors))))
