"""Semilandmarks that slide along surfaces and curves to minimise bending energy."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve

from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import check_number
from skfmap.exceptions import CorrespondenceError
from skfmap.functional.subvertex import nearest_on_triangles
from skfmap.geometry.closest import ClosestPoints
from skfmap.landmarks.alignment import align_landmarks
from skfmap.landmarks.tables import check_landmarks, landmark_names, stack_landmarks
from skfmap.landmarks.thin_plate import bending_matrix
from skfmap.shapes import Correspondence, Landmarks, Mesh

__all__ = ["slide"]

# Ridge, as a fraction of the largest stiffness, against movements that cost no energy.
_FREE = 1e-10
# On a curved surface a step in the tangent planes may not lower the energy; it is then halved, at
# most this many times.
_HALVINGS = 6


def slide(
    landmarks: Sequence[Landmarks],
    meshes: Sequence[Mesh] | None = None,
    *,
    surfaces: Sequence[str] = (),
    curves: Sequence[Sequence[str]] = (),
    reference: Landmarks | None = None,
    n_rounds: int = 5,
) -> list[Landmarks]:
    """Slide semilandmarks along surfaces and curves to minimise the bending energy.

    The position of a semilandmark along the surface carries no information; only the surface does.
    Each semilandmark is moved in its tangent plane, or along its curve, to minimise the bending
    energy of the thin-plate spline from the reference (Bookstein 1997, Gunz et al. 2005), and then
    projected back onto the surface or the curve. Landmarks in neither ``surfaces`` nor ``curves``
    are fixed.

    Parameters
    ----------
    landmarks : sequence of Landmarks
        Landmarks and semilandmarks of each specimen. Fixed ones may be missing.
    meshes : sequence of Mesh, optional
        The specimens' meshes; needed for ``surfaces``. Points of curves are projected onto them
        too.
    surfaces : sequence of str, default=()
        Names of the semilandmarks that slide on the surface.
    curves : sequence of sequence of str, default=()
        Names of the points of each curve, in order. Those between the first and the last slide
        along the polyline through the given points; if the curve is closed, repeat the first name
        at the end.
    reference : Landmarks, optional
        Configuration that the splines start from, with all names. By default it is the mean of the
        specimens, aligned and scaled to the same size, and computed again in each round.
    n_rounds : int, default=5
        Number of rounds of moving and projecting the points.

    Returns
    -------
    list of Landmarks
        Landmarks in the units and coordinates of each specimen. Fixed landmarks do not move.

    Raises
    ------
    CorrespondenceError
        If a name is unknown or slides in two ways, if a sliding point is missing, or if landmarks
        do not lie on the mesh given for them.
    ValueError
        If points slide on the surface and no meshes are given, or if no point slides.

    Notes
    -----
    In each round the energy of a specimen, relative to that round's reference, does not increase.
    If a specimen is rotated, translated or scaled, so is the result. Semilandmarks need fixed
    landmarks around them, at least four that are not in one plane; otherwise all of them may move
    by an affine map, which costs no energy.

    References
    ----------
    .. [1] F. L. Bookstein. "Landmark methods for forms without landmarks". Medical Image Analysis,
       1997.
    .. [2] P. Gunz, P. Mitteroecker, F. L. Bookstein. "Semilandmarks in three dimensions". Modern
       Morphometrics in Physical Anthropology, 2005.

    Examples
    --------
    On the second specimen, the point between two corners slides to where it is on the first:

    >>> from skfmap import Landmarks
    >>> from skfmap.landmarks import slide
    >>> names = ["a", "b", "c", "d", "e", "between"]
    >>> fixed = [[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4], [4, 4, 4]]
    >>> one = Landmarks([*fixed, [2, 0, 0]], names)
    >>> other = Landmarks([*fixed, [3, 0, 0]], names)
    >>> slid, = slide([other], curves=[["a", "between", "b"]], reference=one)
    >>> slid.point("between").round(6).tolist()
    [2.0, 0.0, 0.0]
    """
    kept = check_landmarks(landmarks)
    check_number(n_rounds, "n_rounds", low=1, integer=True)
    names = landmark_names(kept)
    sliding = _sliding(names, surfaces, curves)
    points = stack_landmarks(kept)
    _check_there(points, names, kept, sliding)
    _check_meshes(meshes, kept, sliding)
    put_back = _put_back(points, meshes, sliding)
    points = np.array([back.onto(one) for back, one in zip(put_back, points, strict=True)])
    bent = None if reference is None else stack_landmarks([reference], names)[0]
    for _ in range(n_rounds):
        mean = _mean(points) if bent is None else bent
        energy_of = _energies(mean)
        points = np.array(
            [
                _slid(one, energy_of(one), sliding, back)
                for one, back in zip(points, put_back, strict=True)
            ]
        )
    return [_like(one, at, names) for one, at in zip(kept, points, strict=True)]


class _Sliding(NamedTuple):
    """Columns that slide on the surface, and columns of each curve including both ends."""

    surface: IntArray
    curves: list[IntArray]


class _PutBack(NamedTuple):
    """Projection onto the curves and surface of one specimen, and the surface normals."""

    onto: Callable[[FloatArray], FloatArray]
    normals: Callable[[FloatArray], FloatArray]


def _sliding(
    names: tuple[str, ...], surfaces: Sequence[str], curves: Sequence[Sequence[str]]
) -> _Sliding:
    if isinstance(surfaces, str) or any(isinstance(curve, str) for curve in curves):
        raise TypeError("surfaces must be a list of names, and curves a list of lists of names.")
    told = [*surfaces, *(name for curve in curves for name in curve)]
    if unknown := sorted({name for name in told if name not in names}):
        raise CorrespondenceError(
            f"There is no landmark {', '.join(unknown)}; there are {', '.join(names)}."
        )
    if short := [curve for curve in curves if len(curve) < 3]:
        raise CorrespondenceError(
            f"The curve {', '.join(short[0])} has no point between its ends that could slide; name "
            "at least three."
        )
    slides = [*surfaces, *(name for curve in curves for name in curve[1:-1])]
    if twice := sorted({name for name in slides if slides.count(name) > 1}):
        raise CorrespondenceError(
            f"{', '.join(twice)} slides on two curves, or on a curve and on the surface. Name it "
            "once; only the ends of a curve may be named again."
        )
    if not slides:
        raise ValueError("Nothing slides: name points in surfaces or in curves.")
    column = {name: i for i, name in enumerate(names)}
    return _Sliding(
        np.array([column[name] for name in surfaces], dtype=np.int64),
        [np.array([column[name] for name in curve]) for curve in curves],
    )


def _check_there(
    points: FloatArray, names: tuple[str, ...], landmarks: list[Landmarks], sliding: _Sliding
) -> None:
    needed = np.unique(np.concatenate([sliding.surface, *sliding.curves]))
    missing = np.isnan(points[:, needed, 0])
    if missing.any():
        i, j = np.argwhere(missing)[0]
        called = landmarks[i].name if landmarks[i].name is not None else f"landmarks[{i}]"
        raise CorrespondenceError(
            f"{called} lacks {names[needed[j]]!r}, which slides or ends a curve; leave the "
            "specimen or the point out."
        )


def _check_meshes(
    meshes: Sequence[Mesh] | None, landmarks: list[Landmarks], sliding: _Sliding
) -> None:
    """Raise unless the landmarks of each specimen lie on its mesh."""
    if meshes is None:
        if len(sliding.surface):
            raise ValueError("Points slide on the surface of a mesh; give one mesh per specimen.")
        return
    if len(meshes) != len(landmarks):
        raise ValueError(
            f"There are {len(landmarks)} specimens but {len(meshes)} meshes; give one for each."
        )
    for one, mesh in zip(landmarks, meshes, strict=True):
        Correspondence.from_points(one, mesh)


def _put_back(
    points: FloatArray, meshes: Sequence[Mesh] | None, sliding: _Sliding
) -> list[_PutBack]:
    """Return the projection onto the curves and the surface of each specimen."""
    inside = [curve[1:-1] for curve in sliding.curves]
    on_mesh = np.concatenate([sliding.surface, *inside]).astype(np.int64)

    def of_one(points: FloatArray, mesh: ClosestPoints | None) -> _PutBack:
        lines = [points[curve] for curve in sliding.curves]

        def onto(moved: FloatArray) -> FloatArray:
            out = moved.copy()
            for rows, line in zip(inside, lines, strict=True):
                out[rows] = _nearest_on_line(out[rows], line)
            if mesh is not None:
                out[on_mesh] = mesh.of(out[on_mesh]).points
            return out

        def normals(there: FloatArray) -> FloatArray:
            return np.empty((0, 3)) if mesh is None else mesh.of(there).normals

        return _PutBack(onto, normals)

    surfaces: list[ClosestPoints | None] = [None] * len(points)
    if meshes is not None:
        surfaces = [ClosestPoints(mesh.vertices, mesh.faces) for mesh in meshes]
    return [of_one(one, mesh) for one, mesh in zip(points, surfaces, strict=True)]


def _energies(reference: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return a function for the bending matrix, which omits the landmarks a specimen lacks."""
    made: dict[bytes, FloatArray] = {}

    def matrix(points: FloatArray) -> FloatArray:
        known = ~np.isnan(points[:, 0]) & ~np.isnan(reference[:, 0])
        if known.tobytes() not in made:
            L = np.zeros((len(points), len(points)))
            L[np.ix_(known, known)] = bending_matrix(reference[known])
            made[known.tobytes()] = L
        return made[known.tobytes()]

    return matrix


def _slid(points: FloatArray, L: FloatArray, sliding: _Sliding, back: _PutBack) -> FloatArray:
    """Return the points of one specimen after a step that lowers their energy, if there is one."""
    rows, directions = _tangents(points, sliding, back)
    step = np.zeros_like(points)
    np.add.at(step, rows, _best_step(points, L, rows, directions)[:, None] * directions)
    before = _energy(points, L)
    for halved in range(_HALVINGS + 1):
        moved = back.onto(points + step / 2**halved)
        if _energy(moved, L) < before:
            return moved
    return points


def _tangents(points: FloatArray, sliding: _Sliding, back: _PutBack) -> tuple[IntArray, FloatArray]:
    """Return the directions in which points may move: rows of the points, and unit vectors."""
    rows, directions = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))]
    for curve in sliding.curves:
        ahead = points[curve[2:]] - points[curve[:-2]]
        rows.append(curve[1:-1])
        directions.append(ahead / np.maximum(np.linalg.norm(ahead, axis=1), 1e-300)[:, None])
    if len(sliding.surface):
        normals = back.normals(points[sliding.surface])
        # Start from the axis that is farthest from the normal.
        axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
        first = np.cross(normals, axis)
        first /= np.maximum(np.linalg.norm(first, axis=1), 1e-300)[:, None]
        rows += [sliding.surface, sliding.surface]
        directions += [first, np.cross(normals, first)]
    return np.concatenate(rows), np.concatenate(directions)


def _best_step(
    points: FloatArray, L: FloatArray, rows: IntArray, directions: FloatArray
) -> FloatArray:
    """Return the step along each direction that minimises the energy, which is quadratic."""
    A = L[np.ix_(rows, rows)] * (directions @ directions.T)
    gradient = np.einsum("nd,nd->n", directions, (L @ _centred(points))[rows])
    A[np.diag_indices_from(A)] += _FREE * A.diagonal().max() or 1.0
    return np.asarray(-solve(A, gradient, assume_a="pos"))


def _energy(points: FloatArray, L: FloatArray) -> float:
    centred = _centred(points)
    return float((centred * (L @ centred)).sum())


def _centred(points: FloatArray) -> FloatArray:
    """Return points minus their mean; missing ones become 0, and do not affect the energy."""
    return np.nan_to_num(points - np.nanmean(points, axis=0))


def _nearest_on_line(points: FloatArray, line: FloatArray) -> FloatArray:
    """Return the nearest points on a polyline."""
    n_segments = len(line) - 1
    ends = np.stack([line[:-1], line[1:], line[1:]], axis=1)  # segments as degenerate triangles
    weights, squared = nearest_on_triangles(
        np.repeat(points, n_segments, axis=0), np.tile(ends, (len(points), 1, 1))
    )
    best = squared.reshape(len(points), n_segments).argmin(axis=1)
    chosen = weights.reshape(len(points), n_segments, 3)[np.arange(len(points)), best]
    return np.asarray(np.einsum("nc,nca->na", chosen, ends[best]))


def _mean(points: FloatArray) -> FloatArray:
    aligned = align_landmarks(points, scale=True)
    counts = (~np.isnan(aligned[:, :, :1])).sum(axis=0)
    return np.asarray(np.nansum(aligned, axis=0) / np.where(counts > 0, counts, np.nan))


def _like(one: Landmarks, points: FloatArray, names: tuple[str, ...]) -> Landmarks:
    """Return landmarks with the names of ``one`` and new points."""
    return Landmarks(points[[names.index(name) for name in one.names]], one.names, name=one.name)
