"""Edge flips towards a Delaunay triangulation of a closed surface."""

import numpy as np

from skfmap._tools.types import BoolArray, FloatArray, IntArray

__all__ = ["flip_edges"]

# Tolerance in radians of the comparison with 180 degrees. Without it, rounding would make edges
# flip back and forth.
_ROUNDING = 1e-6


def flip_edges(vertices: FloatArray, faces: IntArray, n_rounds: int = 4) -> IntArray:
    """Flip edges with opposite angles of more than 180 degrees in sum.

    An edge is not flipped if the surface would fold or become non-manifold.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles of a closed, manifold, consistently oriented surface.
    n_rounds : int
        Number of rounds. In each round, a triangle takes part in at most one flip.

    Returns
    -------
    ndarray of int, shape (n_faces, 3)
        Triangles with the same orientation.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.datasets._edge_flips import flip_edges
    >>> vertices = np.array([[-3, 0, 0], [3, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -4.0]])
    >>> faces = np.array([[0, 1, 3], [0, 2, 1], [0, 3, 4], [3, 1, 4], [1, 2, 4], [2, 0, 4]])
    >>> flip_edges(vertices, faces)[:2].tolist()
    [[2, 3, 0], [3, 2, 1]]
    """
    faces = faces.copy()
    for _ in range(n_rounds):
        corners, sides = _edges(faces)
        wrong = np.flatnonzero(_is_obtuse(vertices, corners))
        wrong = wrong[~_would_fold(vertices, corners[wrong])]
        wrong = wrong[~_is_joined(corners, wrong, len(vertices))]
        chosen = wrong[_independent(corners[wrong], sides[wrong])]
        if not len(chosen):
            break
        a, b, left, right = corners[chosen].T
        faces[sides[chosen, 0]] = np.column_stack([right, left, a])
        faces[sides[chosen, 1]] = np.column_stack([left, right, b])
    return faces


def _edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Return (a, b, left apex, right apex) for each edge a < b, and its two triangles."""
    starts, ends = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    apexes = np.roll(faces, -2, axis=1).ravel()
    owners = np.repeat(np.arange(len(faces)), 3)
    up, down = np.flatnonzero(starts < ends), np.flatnonzero(starts > ends)
    up = up[np.lexsort((ends[up], starts[up]))]
    down = down[np.lexsort((starts[down], ends[down]))]
    corners = np.column_stack([starts[up], ends[up], apexes[up], apexes[down]])
    return corners, np.column_stack([owners[up], owners[down]])


def _is_obtuse(vertices: FloatArray, corners: IntArray) -> BoolArray:
    """Return whether the two angles opposite each edge sum to more than 180 degrees."""
    a, b, left, right = (vertices[column] for column in corners.T)
    return np.asarray(_angle(a - left, b - left) + _angle(a - right, b - right) > np.pi + _ROUNDING)


def _angle(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(axis=1))


def _is_joined(corners: IntArray, chosen: IntArray, n_vertices: int) -> BoolArray:
    """Return whether the vertices opposite each chosen edge are already joined by an edge."""
    present = corners[:, 0] * n_vertices + corners[:, 1]
    ends = np.sort(corners[chosen, 2:], axis=1)
    return np.isin(ends[:, 0] * n_vertices + ends[:, 1], present)


def _would_fold(vertices: FloatArray, corners: IntArray) -> BoolArray:
    """Return whether a triangle would face away from the old ones after the flip."""
    a, b, left, right = (vertices[column] for column in corners.T)
    before = np.cross(b - a, left - a) + np.cross(right - a, b - a)
    first, second = np.cross(left - right, a - right), np.cross(right - left, b - left)
    return np.asarray(
        np.minimum((before * first).sum(axis=1), (before * second).sum(axis=1)) <= 0.0
    )


def _independent(corners: IntArray, sides: IntArray) -> IntArray:
    """Choose flips greedily that share no triangle and create no edge twice; return indices."""
    taken: set[int] = set()
    made: set[tuple[int, int]] = set()
    chosen = []
    for index, ((_, _, left, right), (face, other)) in enumerate(
        zip(corners.tolist(), sides.tolist(), strict=True)
    ):
        edge = (min(left, right), max(left, right))
        if face in taken or other in taken or edge in made:
            continue
        taken.update((face, other))
        made.add(edge)
        chosen.append(index)
    return np.array(chosen, dtype=np.int64)
