"""Wraps a surface full of tunnels, pores and debris into the shell around it."""

from collections.abc import Iterator
from typing import NamedTuple

import igl
import numpy as np
import scipy.sparse as sp
from scipy import ndimage

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.geometry.faults import area_and_longest_edge, boundary_pieces, half_edges
from skfmap.geometry.isosurface import marching_cubes
from skfmap.geometry.mending import mend

__all__ = ["Wrapped", "wants_wrapping", "wrap"]

# More handles than this no body has; the mouse skulls that this was made for have 250 and more.
_MOST_HANDLES = 10
# What is left out is no mere debris if so many pieces with this share of the area lie around the
# piece that is kept.
_MANY_PIECES, _MUCH_AREA = 10, 0.1

# All in cells of the grid. The closing radius ...
_RADIUS = 6
# ... and the radii of balls that may be caught in a chamber: what fits in but not out is closed ...
_BALLS = (8, 10, 12, 14, 16)
# ... if there is room for a ball that is so many times larger; else it is a mere niche.
_WIDER = 1.3
# Shells are made so far outside, so that sheets without thickness have two sides, and are moved
# back by nearly as much.
_OFFSET, _BACK = 0.5, 0.9
# Distances are exact so near the surface; and from this near, nothing leads from side to side.
_BAND, _WALL = 2.5, 1.75
# Rounds of smoothing where the shell spans an opening.
_SMOOTHING = 10


class Wrapped(NamedTuple):
    """A shell around a surface.

    Attributes
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles of one closed manifold surface, wound outwards.
    radius : float
        The closing radius: a ball of this radius can touch the shell everywhere from outside, but
        in front of chambers.
    """

    vertices: FloatArray
    faces: IntArray
    radius: float


class _Grid(NamedTuple):
    """Points of a grid and what is known there."""

    points: FloatArray
    distance: FloatArray
    """Distance from the surface, negative inside."""
    level: FloatArray
    """Negative inside and up to the offset outside; zero where the side changes in the open."""


def wrap(
    vertices: FloatArray, faces: IntArray, *, n_cells: int = 150, radius: float | None = None
) -> Wrapped:
    """Return the outer shell of a surface: closed, in one piece, with hardly a handle.

    On a grid, whatever has a generalised winding number above one half is inside. What no ball of
    the closing radius can cover from outside is closed, and so are chambers: spaces where a larger
    ball finds room that cannot leave by any opening. The level set (marching cubes) half a cell
    outside is moved back to the surface.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles of finite coordinates, wound outwards as far as may be. They may have holes, and
        be many pieces.
    n_cells : int, default=150
        Cells of the grid along the longest side.
    radius : float, optional
        The closing radius. Six cells by default.

    Returns
    -------
    Wrapped
        The shell, with triangles about as large as a cell, and the closing radius.

    References
    ----------
    Barill, Dickson, Schmidt, Levin, Jacobson, *Fast winding numbers for soups and clouds*, 2018.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.geometry.wrapping import wrap
    >>> ball = make_sphere(n_subdivisions=3)
    >>> shell = wrap(ball.vertices, ball.faces[5:], n_cells=40)
    >>> len(shell.faces) == 2 * len(shell.vertices) - 4  # closed, without a handle
    True
    >>> bool((np.abs(np.linalg.norm(shell.vertices, axis=1) - 1) < 0.02).all())
    True
    """
    cell = float(np.ptp(vertices[faces.ravel()], axis=0).max()) / n_cells
    radius = _RADIUS * cell if radius is None else float(radius)
    grid = _known_on_grid(vertices, faces, cell, radius + 3 * cell)
    distance = grid.distance
    chambers = _chambers(distance, radius, cell)
    if chambers.any():
        distance = np.minimum(distance, ndimage.distance_transform_edt(~chambers) * cell)
    level = np.minimum(grid.level, _closed(distance, radius, cell))
    level[chambers | ((level > 0) & ~_with_the_border(level > 0))] = -cell
    points, triangles = marching_cubes(np.clip(level, -cell, cell), grid.points)
    shell = mend(points, triangles)
    moved = _moved_back(shell.vertices, shell.faces, vertices, faces, cell)
    return Wrapped(moved, shell.faces, radius)


def _known_on_grid(vertices: FloatArray, faces: IntArray, cell: float, margin: float) -> _Grid:
    """Return a grid around the surface, with distances from it, exact near the surface."""
    used = vertices[np.unique(faces)]
    low = used.min(axis=0) - margin
    size = np.ceil((np.ptp(used, axis=0) + 2 * margin) / cell).astype(int) + 1
    axes = [low[k] + cell * np.arange(size[k]) for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    empty = np.ones(size, dtype=bool)
    for part in _points_on(vertices, faces, cell / 2):
        empty[tuple(np.rint((part - low) / cell).astype(int).T)] = False
    distance = np.asarray(ndimage.distance_transform_edt(empty)) * cell
    near = distance <= _BAND * cell
    squared, _, _ = igl.point_mesh_squared_distance(points[near], vertices, faces)
    side, gradual = _sides(points, distance <= _WALL * cell, vertices, faces, cell)
    distance[near] = np.sqrt(squared)
    level = side * np.minimum(distance - side * _OFFSET * cell, gradual)
    return _Grid(points, side * distance, level)


def _points_on(vertices: FloatArray, faces: IntArray, spacing: float) -> Iterator[FloatArray]:
    """Yield points on triangles, none of which is farther than the spacing from the next."""
    longest = np.sqrt(area_and_longest_edge(vertices, faces)[1])
    steps = np.ceil(np.maximum(longest / spacing, 1.0)).astype(int)
    for n in np.unique(steps):
        corners = vertices[faces[steps == n]]
        i, j = np.divmod(np.arange((n + 1) ** 2), n + 1)
        weights = np.stack([i, j, n - i - j], axis=1)[i + j <= n] / n
        yield np.einsum("pk,fkx->fpx", weights, corners).reshape(-1, 3)


def _sides(
    points: FloatArray, wall: BoolArray, vertices: FloatArray, faces: IntArray, cell: float
) -> tuple[FloatArray, FloatArray]:
    """Return -1 inside and 1 outside, and about a distance from where that changes in the open."""
    winding = np.zeros(wall.shape)
    if (half_edges(faces).count % 2 == 0).all():  # no rim: it is the same in all of a region
        winding[wall] = igl.fast_winding_number(vertices, faces, points[wall])
        region, n_regions = ndimage.label(~wall)
        if n_regions:
            region, elsewhere = region[~wall] - 1, points[~wall]
            samples = elsewhere[np.unique(region, return_index=True)[1]]
            winding[~wall] = igl.fast_winding_number(vertices, faces, samples)[region]
    else:
        flat = igl.fast_winding_number(vertices, faces, points.reshape(-1, 3))
        winding = flat.reshape(wall.shape)
    return np.where(winding > 0.5, -1.0, 1.0), 4 * cell * np.abs(winding - 0.5)


def _with_the_border(mask: BoolArray) -> BoolArray:
    """Return what hangs together with the outside of the grid."""
    regions, _ = ndimage.label(np.pad(mask, 1, constant_values=True))
    return np.asarray(regions == regions[0, 0, 0])[1:-1, 1:-1, 1:-1]


def _closed(distance: FloatArray, radius: float, cell: float) -> FloatArray:
    """Return about the distance from where balls get from outside, positive where they do.

    It is one cell too deep, so that the surface itself decides wherever it is met.
    """
    outside = _with_the_border(distance > radius)
    return radius + cell - ndimage.distance_transform_edt(~outside) * cell


def _chambers(distance: FloatArray, radius: float, cell: float) -> BoolArray:
    """Return the chambers: where a ball fits in that cannot leave by any opening.

    The next smaller ball can; each place that it gets to is the chamber's if its middle comes there
    in fewer steps than from outside.
    """
    closed = np.zeros(distance.shape, dtype=bool)
    smaller = radius
    for ball in (n * cell for n in _BALLS if n * cell > radius):
        room = (distance > ball) & ~closed
        out = _with_the_border(room)
        caught, n_caught = ndimage.label(room & ~out)
        widest = ndimage.maximum(distance, caught, np.arange(1, n_caught + 1))
        wide = np.append(False, np.asarray(widest) > _WIDER * ball)[caught]
        if wide.any():
            way = (distance > smaller) & ~closed
            middles = _reached_first(wide, out, way)
            away = ndimage.distance_transform_edt(~middles) * cell
            others = ndimage.distance_transform_edt(~(way & ~middles)) * cell
            closed |= (away < smaller) & (away <= others)
        smaller = ball
    return closed


def _reached_first(here: BoolArray, there: BoolArray, free: BoolArray) -> BoolArray:
    """Return what is reached from here sooner than from there, by steps through free points."""
    shape = np.array(here.shape) + 2
    owner = np.zeros(shape, dtype=np.int8)  # 0 where nobody gets, 3 where nobody is yet
    inner = (slice(1, -1),) * 3
    owner[inner] = np.where(here, 1, np.where(there, 2, np.where(free, 3, 0)))
    flat = owner.ravel()
    steps = np.array([1, -1, shape[2], -shape[2], shape[1] * shape[2], -shape[1] * shape[2]])
    fronts = [np.flatnonzero(flat == who) for who in (1, 2)]
    while len(fronts[0]):
        for who in (2, 1):
            reached = (fronts[who - 1][:, None] + steps).ravel()
            reached = reached[flat[reached] == 3]
            flat[reached] = who
            fronts[who - 1] = np.unique(reached)
    return np.asarray(owner[inner] == 1)


def _moved_back(
    points: FloatArray, triangles: IntArray, vertices: FloatArray, faces: IntArray, cell: float
) -> FloatArray:
    """Move a shell back to the surface where it lies along it, and smooth it where it does not."""
    squared, _, nearest = igl.point_mesh_squared_distance(points, vertices, faces)
    distance = np.sqrt(squared)
    spans = distance > 1.2 * _OFFSET * cell
    step = _BACK * np.minimum(distance, _OFFSET * cell) / np.maximum(distance, 1e-300)
    moved = np.where(spans[:, None], points, points + step[:, None] * (nearest - points))
    edges = half_edges(triangles)
    links = sp.csr_array(
        (np.ones(len(edges.start)), (edges.start, edges.end)), shape=(len(points), len(points))
    )
    means = sp.diags_array(1 / np.maximum(links.sum(axis=1), 1)) @ links
    for _ in range(_SMOOTHING):
        moved = np.where(spans[:, None], (moved + means @ moved) / 2, moved)
    return moved


def wants_wrapping(faces: IntArray, tally: dict[str, float] | None = None) -> str:
    """Say why a mended surface is no body but for its shell; nothing if it is one.

    Parameters
    ----------
    faces : ndarray of int, shape (n_faces, 3)
        Triangles in one piece.
    tally : dict of str to float, optional
        What `mend` did to make one of it.

    Returns
    -------
    str
        The reason in words, or an empty string.

    Examples
    --------
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.geometry.wrapping import wants_wrapping
    >>> ball = make_sphere(n_subdivisions=2)
    >>> wants_wrapping(ball.faces)
    ''
    >>> wants_wrapping(ball.faces, {"pieces around": 30, "area around": 0.2})
    '30 pieces with 20% of the area lie around the largest'
    """
    n_handles = _count_handles(faces)
    if n_handles > _MOST_HANDLES:
        return f"it has {n_handles} handles or tunnels"
    tally = tally or {}
    n_others, share = int(tally.get("pieces around", 0)), tally.get("area around", 0)
    if n_others >= _MANY_PIECES and share > _MUCH_AREA:
        return f"{n_others} pieces with {share:.0%} of the area lie around the largest"
    return ""


def _count_handles(faces: IntArray) -> int:
    """Return the genus of a surface in one piece, whose rims count as closed."""
    edges = half_edges(faces)
    euler = len(np.unique(faces)) - len(edges.count) + len(faces)
    return (2 - euler - len(boundary_pieces(faces))) // 2
