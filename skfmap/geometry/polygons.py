"""Triangulation of polygons."""

import numpy as np

from skfmap._tools.types import BoolArray, FloatArray, IntArray

__all__ = ["triangulate"]

# Areas below this fraction of the squared extent of a polygon are zero up to rounding.
_NO_AREA = 1e-12


def triangulate(
    vertices: FloatArray, corners: IntArray, counts: IntArray
) -> tuple[IntArray, IntArray]:
    """Cut polygons into triangles; the triangles are in the order of their polygons.

    Convex polygons become fans around their first corner; others are cut by removing ears. A
    polygon with one or two corners, or one that crosses itself, becomes one triangle with a
    repeated vertex, so that it can be recognised and no face is lost silently.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates.
    corners : ndarray of int, shape (n_corners,)
        The vertices of the first polygon, then those of the second, and so on.
    counts : ndarray of int, shape (n_polygons,)
        Number of corners of each polygon.

    Returns
    -------
    faces : ndarray of int, shape (n_faces, 3)
        Triangles, wound like their polygons.
    crossing : ndarray of int
        The polygons that cross themselves.

    Examples
    --------
    A square with a dent, whose fourth corner is inside the triangle of the others:

    >>> import numpy as np
    >>> from skfmap.geometry.polygons import triangulate
    >>> dented = np.array([[0.0, 0, 0], [2, 1, 0], [0, 2, 0], [1, 1, 0]])
    >>> faces, crossing = triangulate(dented, np.arange(4), np.array([4]))
    >>> faces.tolist(), crossing.tolist()
    ([[1, 2, 3], [0, 1, 3]], [])
    """
    if (counts == 3).all():
        return corners.reshape(-1, 3), np.empty(0, dtype=np.int64)
    start = np.cumsum(counts) - counts
    pieces: list[IntArray] = []
    owners: list[IntArray] = []
    crossing: list[int] = []
    for n in np.unique(counts[counts > 0]).tolist():
        polygons = np.flatnonzero(counts == n)
        table = corners[start[polygons][:, None] + np.arange(n)]
        if n < 4:
            faces, owner = table[:, [0, n // 2, n - 1]], polygons
        else:
            faces, owner, odd = _cut(vertices, table, polygons)
            crossing += odd
        pieces.append(faces)
        owners.append(owner)
    if not pieces:
        return np.empty((0, 3), dtype=np.int64), np.empty(0, dtype=np.int64)
    order = np.argsort(np.concatenate(owners), kind="stable")
    return np.concatenate(pieces)[order], np.sort(np.array(crossing, dtype=np.int64))


def _cut(
    vertices: FloatArray, table: IntArray, polygons: IntArray
) -> tuple[IntArray, IntArray, list[int]]:
    """Cut polygons with the same number of corners.

    Return the triangles, the polygon of each, and the polygons that cross themselves. Indices of
    vertices that do not exist are passed on; later checks reject them.
    """
    n = table.shape[1]
    outside = ((table < 0) | (table >= len(vertices))).any(axis=1)
    points = np.zeros((len(table), n, 3))
    points[~outside] = vertices[table[~outside]]
    flat, sideless = _in_plane(points)
    fan = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)], axis=1)
    simple = outside | ~np.isfinite(flat).all(axis=(1, 2)) | _is_fan(flat)
    pieces, owners = [table[simple][:, fan].reshape(-1, 3)], [np.repeat(polygons[simple], n - 2)]
    crossing = []
    for i in np.flatnonzero(~simple).tolist():
        ears = None if sideless[i] else _ears(flat[i])
        if ears is None:
            crossing.append(int(polygons[i]))
            ears = [(0, 0, 1)]
        pieces.append(table[i][np.array(ears)])
        owners.append(np.full(len(ears), polygons[i]))
    return np.concatenate(pieces), np.concatenate(owners), crossing


def _in_plane(points: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Project polygons along their normals, shape (n, n_corners, 2), wound counterclockwise.

    Also return which of them have no normal, because their signed areas cancel.
    """
    with np.errstate(all="ignore"):
        centred = points - points.mean(axis=1, keepdims=True)
        extent = np.abs(centred).max(axis=(1, 2), keepdims=True)
        centred = centred / np.where(extent > 0, extent, 1)
        normal = np.cross(centred, np.roll(centred, -1, axis=1)).sum(axis=1)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = normal / np.where(length > 0, length, 1)
        spokes = centred - centred[:, :1]
        areas = np.linalg.norm(np.cross(spokes[:, 1:-1], spokes[:, 2:]), axis=2).sum(axis=1)
    sideless = (areas > 1e-9) & (length[:, 0] < 1e-9 * areas)
    # The axis that is farthest from the normal defines the first direction in the plane.
    least = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(least, normal)
    first = first / np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-300)
    second = np.cross(normal, first)
    flat = np.stack([(centred * one[:, None]).sum(axis=2) for one in (first, second)], axis=2)
    return flat, np.asarray(sideless)


def _is_fan(flat: FloatArray) -> BoolArray:
    """Return which polygons are convex, so that the fan around the first corner tiles them.

    All triangles then have a positive area, and the angles at that corner sum to less than pi.
    """
    spokes = flat[:, 1:] - flat[:, :1]
    one, other = spokes[:, :-1], spokes[:, 1:]
    area = _cross(one, other)
    sides = np.roll(flat, -1, axis=1) - flat
    turns = _cross(sides, np.roll(sides, -1, axis=1))
    angle = np.arctan2(area, (one * other).sum(axis=2)).sum(axis=1)
    return np.asarray(
        (area > _NO_AREA).all(axis=1) & (turns > -_NO_AREA).all(axis=1) & (angle < np.pi + 1e-9)
    )


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _ears(points: FloatArray) -> list[tuple[int, int, int]] | None:
    """Return the triangles of one polygon by their corners; None if it crosses itself.

    Parameters
    ----------
    points : ndarray of shape (n_corners, 2)
        The polygon, wound counterclockwise.
    """
    if _crosses_itself(points):
        return None
    left = list(range(len(points)))
    ears: list[tuple[int, int, int]] = []
    while len(left) > 3:
        at = _first_ear(points[left])
        if at is None:
            break
        ears.append((left[at - 1], left[at], left[(at + 1) % len(left)]))
        del left[at]
    rest = points[left]
    if len(left) > 3 and abs(_cross(rest, np.roll(rest, -1, axis=0)).sum()) > 1e-9:
        return None
    return [*ears, *((left[0], left[j], left[j + 1]) for j in range(1, len(left) - 1))]


def _first_ear(points: FloatArray) -> int | None:
    """Return the first corner, from the second on, that can be cut off; None if there is none."""
    n = len(points)
    for at in [*range(1, n), 0]:
        a, b, c = points[at - 1], points[at], points[(at + 1) % n]
        if not _cross(b - a, c - a) > _NO_AREA:
            continue
        inside = np.ones(n, dtype=bool)
        for start, end in ((a, b), (b, c), (c, a)):
            inside &= _cross(end - start, points - start) >= -_NO_AREA
        # A bridge edge to a hole passes its corners twice.
        same = (points[:, None] == np.stack([a, b, c])).all(axis=2).any(axis=1)
        if not (inside & ~same).any():
            return at
    return None


def _crosses_itself(points: FloatArray) -> bool:
    """Return whether two sides of a polygon cross in their interiors."""
    end = np.roll(points, -1, axis=0)
    side = end - points
    # Whether the ends of each side (rows) are to the left of each other side (columns).
    from_start = _cross(side[None], points[:, None] - points[None])
    from_end = _cross(side[None], end[:, None] - points[None])
    parted = (from_start > _NO_AREA) & (from_end < -_NO_AREA)
    parted |= (from_start < -_NO_AREA) & (from_end > _NO_AREA)
    return bool((parted & parted.T).any())
