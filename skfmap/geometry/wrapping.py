"""Wrapping of a surface full of tunnels, pores and debris in an outer shell."""

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

# No body has more handles than this; the mouse skulls for which this was written have 250 or more.
_MOST_HANDLES = 10
# The components left out are more than debris if at least this many of them, with more than this
# fraction of the area, are around the component that is kept.
_MANY_PIECES, _MUCH_AREA = 10, 0.1

# All lengths are in cells of the grid. The closing radius ...
_RADIUS = 6
# ... and the radii of balls that may be trapped in a chamber. A space is closed if a ball fits into
# it but cannot leave it ...
_BALLS = (8, 10, 12, 14, 16)
# ... and if there is room for a ball this many times larger; otherwise it is only a niche.
_WIDER = 1.3
# Offset at which shells are extracted, so that sheets without thickness have two sides, and the
# fraction of it by which they are moved back.
_OFFSET, _BACK = 0.5, 0.9
# Distances are exact up to the first distance from the surface; grid points farther from it than
# the second are connected only if they are on the same side.
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
        The closing radius: a ball of this radius can touch the shell from outside everywhere except
        at closed chambers.
    """

    vertices: FloatArray
    faces: IntArray
    radius: float


class _Grid(NamedTuple):
    """Points of a grid, and distances there."""

    points: FloatArray
    distance: FloatArray
    """Distance from the surface, negative inside."""
    level: FloatArray
    """Negative inside and up to the offset outside; zero where the side changes at a hole."""


def wrap(
    vertices: FloatArray, faces: IntArray, *, n_cells: int = 150, radius: float | None = None
) -> Wrapped:
    """Return the outer shell of a surface: closed, connected, and with hardly any handles.

    Grid points with a generalised winding number above one half are inside. Spaces that no ball of
    the closing radius can reach from outside are closed, and so are chambers: spaces that contain a
    larger ball which cannot leave through any opening. The level set half a cell outside (marching
    cubes) is then moved back to the surface.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles with finite coordinates, wound outwards as far as possible. The surface may have
        holes and many components.
    n_cells : int, default=150
        Number of grid cells along the longest side.
    radius : float, optional
        The closing radius; by default six cells.

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
    """Return a grid around the surface with distances from it, which are exact nearby."""
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
    """Yield points on triangles whose distances from one another are at most the spacing."""
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
    """Return -1 inside and 1 outside, and an approximate distance from where this changes.

    The distance is meant for holes, where the side changes away from the surface.
    """
    winding = np.zeros(wall.shape)
    if (half_edges(faces).count % 2 == 0).all():  # no boundary: constant within each region
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
    """Return the part of a mask that is connected to the outside of the grid."""
    regions, _ = ndimage.label(np.pad(mask, 1, constant_values=True))
    return np.asarray(regions == regions[0, 0, 0])[1:-1, 1:-1, 1:-1]


def _closed(distance: FloatArray, radius: float, cell: float) -> FloatArray:
    """Return the approximate signed distance from the space that balls reach from outside.

    It is positive inside that space, and one cell too large, so that the surface itself decides
    wherever a ball touches it.
    """
    outside = _with_the_border(distance > radius)
    return radius + cell - ndimage.distance_transform_edt(~outside) * cell


def _chambers(distance: FloatArray, radius: float, cell: float) -> BoolArray:
    """Return the chambers: spaces that contain a ball which cannot leave through any opening.

    The next smaller ball can leave. A point that it reaches belongs to the chamber if its centre
    gets there in fewer steps from the chamber than from outside.
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
    """Return the points that are reached sooner from ``here`` than from ``there``.

    Steps go through free points.
    """
    shape = np.array(here.shape) + 2
    owner = np.zeros(shape, dtype=np.int8)  # 0: unreachable, 3: not reached yet
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
    """Move a shell back to the surface where it is close, and smooth it where it is not."""
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
    """Return why a mended surface should be wrapped; an empty string if it should not.

    Parameters
    ----------
    faces : ndarray of int, shape (n_faces, 3)
        Triangles of a connected surface.
    tally : dict of str to float, optional
        The tally of `mend` for this surface.

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
    'it has 30 components with 20% of the area around the largest one'
    """
    n_handles = _count_handles(faces)
    if n_handles > _MOST_HANDLES:
        return f"it has {n_handles} handles or tunnels"
    tally = tally or {}
    n_others, share = int(tally.get("pieces around", 0)), tally.get("area around", 0)
    if n_others >= _MANY_PIECES and share > _MUCH_AREA:
        return f"it has {n_others} components with {share:.0%} of the area around the largest one"
    return ""


def _count_handles(faces: IntArray) -> int:
    """Return the genus of a connected surface whose holes count as closed."""
    edges = half_edges(faces)
    euler = len(np.unique(faces)) - len(edges.count) + len(faces)
    return (2 - euler - len(boundary_pieces(faces))) // 2
