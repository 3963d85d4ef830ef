"""A shell is closed, in one piece, near the surface, and has the handles that are no pores."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from skfmap.datasets import make_creatures, make_sphere
from skfmap.geometry.faults import boundary_pieces, components, half_edges, is_wound_consistently
from skfmap.geometry.isosurface import marching_cubes
from skfmap.geometry.mending import mend
from skfmap.geometry.orientation import signed_volume
from skfmap.geometry.wrapping import wants_wrapping, wrap

generators = st.integers(0, 2**32 - 1).map(np.random.default_rng)
BALL = make_sphere(n_subdivisions=4)


def euler(faces):
    return len(np.unique(faces)) - len(half_edges(faces).count) + len(faces)


def assert_shell(shell):
    assert (half_edges(shell.faces).count == 2).all()
    assert len(np.unique(components(shell.faces, len(shell.vertices)))) == 1
    assert is_wound_consistently(shell.faces)
    assert signed_volume(shell.vertices, shell.faces) > 0


def distances(points, shell):
    """Return distances from the nearest of many points on a shell."""
    a, b, c = (shell.vertices[shell.faces[:, j]] for j in range(3))
    return cKDTree(np.concatenate([shell.vertices, (a + b + c) / 3])).query(points)[0]


def torus(major, minor, n=60):
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    u, v = 2 * np.pi * i / n, 2 * np.pi * j / n
    around = major + minor * np.cos(v)
    vertices = np.stack([around * np.cos(u), around * np.sin(u), minor * np.sin(v)], axis=-1)
    a, b = n * i + j, n * ((i + 1) % n) + j
    c, d = n * ((i + 1) % n) + (j + 1) % n, n * i + (j + 1) % n
    faces = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])
    return vertices.reshape(-1, 3), faces.reshape(-1, 3)


@pytest.fixture(scope="module")
def hollow():
    """A hollow ball with forty pores and one wide opening, as marching cubes make it."""
    axis = np.linspace(-1.2, 1.2, 73)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    length = np.linalg.norm(points, axis=-1)
    values = np.maximum(length - 1, 0.8 - length)
    towards = np.random.default_rng(0).standard_normal((40, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    for direction, width in [*((one, 0.07) for one in towards), (np.array([0, 0, 1.0]), 0.35)]:
        along = points @ direction
        beside = np.linalg.norm(points - along[..., None] * direction, axis=-1)
        values = np.maximum(values, np.where(along > 0, width - beside, -1))
    mended = mend(*marching_cubes(values, points))
    return mended.vertices, mended.faces


@pytest.mark.parametrize("unit", [2.0**-20, 1.0, 2.0**20])
def test_a_ball_with_a_hole_and_debris_is_a_ball(unit):
    """The hole is closed, and what lies inside it or beside it is no part of the shell."""
    cap = BALL.vertices[BALL.faces].mean(axis=1)[:, 2] < 0.95
    crumbs = [0.05 * BALL.vertices + at for at in ([0, 0, 0], [0.5, 0, 0], [0, 1.6, 0])]
    vertices = np.concatenate([BALL.vertices, 0.5 * BALL.vertices, *crumbs])
    faces = [BALL.faces + i * BALL.n_vertices for i in range(5)]
    shell = wrap(unit * vertices, np.concatenate([faces[0][cap], *faces[1:]]), n_cells=60)
    assert_shell(shell)
    assert euler(shell.faces) == 2
    cell = 2.65 / 60
    assert shell.radius == pytest.approx(6 * cell * unit)
    radii = np.linalg.norm(shell.vertices, axis=1) / unit
    assert radii.max() < 1.01
    below = shell.vertices[:, 2] < 0.9 * unit
    assert radii[below].min() > 0.98
    assert radii.min() > 0.85  # over the hole
    used = np.unique(faces[0][cap])
    assert distances(unit * vertices[used], shell).max() < cell * unit


def test_what_is_open_by_half_is_closed_by_the_winding_number():
    half = BALL.vertices[BALL.faces].mean(axis=1)[:, 2] < 0.3
    shell = wrap(BALL.vertices, BALL.faces[half], n_cells=50)
    assert_shell(shell)
    assert euler(shell.faces) == 2
    # From the disc within a flat rim half of all directions end on the surface.
    below = 2 / 3 + 0.3 - 0.3**3 / 3
    assert signed_volume(shell.vertices, shell.faces) == pytest.approx(np.pi * below, rel=0.02)


@pytest.mark.parametrize(("radius", "expected"), [(None, 0), (0.5, 0), (1.2, 2)])
def test_a_torus_keeps_its_hole_unless_no_ball_covers_it(radius, expected):
    vertices, faces = torus(1.0, 0.4)
    shell = wrap(vertices, faces, n_cells=60, radius=radius)
    assert_shell(shell)
    assert euler(shell.faces) == expected
    outer = np.linalg.norm(vertices[:, :2], axis=1) > 1
    assert distances(vertices[outer], shell).max() < 0.05
    if expected == 0:
        assert distances(vertices, shell).max() < 0.05
        assert signed_volume(shell.vertices, shell.faces) == pytest.approx(
            2 * np.pi**2 * 0.4**2, rel=0.03
        )


def test_a_hollow_ball_with_pores_is_its_outer_wall(hollow):
    vertices, faces = hollow
    assert "handles" in wants_wrapping(faces)
    shell = wrap(vertices, faces, n_cells=60)
    assert_shell(shell)
    assert euler(shell.faces) == 2
    assert wants_wrapping(shell.faces) == ""
    assert signed_volume(shell.vertices, shell.faces) == pytest.approx(4 / 3 * np.pi, rel=0.05)
    outer = np.linalg.norm(vertices, axis=1) > 0.999
    assert distances(vertices[outer], shell).max() < 2.4 / 60


def test_an_opening_that_is_as_wide_as_what_lies_behind_it_stays_open():
    """A cup is no chamber: whatever finds room inside can leave."""
    cup = BALL.vertices[BALL.faces].mean(axis=1)[:, 2] < 0.2
    inside = 0.8 * BALL.vertices
    edges = boundary_pieces(BALL.faces[cup])[0]
    n = BALL.n_vertices
    a, b = edges.T
    rim = np.concatenate([np.stack([b, a, a + n], axis=1), np.stack([b, a + n, b + n], axis=1)])
    faces = np.concatenate([BALL.faces[cup], BALL.faces[cup][:, ::-1] + n, rim])
    vertices = np.concatenate([BALL.vertices, inside])
    shell = wrap(vertices, faces, n_cells=60)
    assert_shell(shell)
    assert distances(vertices[np.unique(faces)], shell).max() < 0.1
    assert distances(np.zeros((1, 3)), shell)[0] > 0.7


@given(generators, st.integers(1, 60))
@settings(max_examples=10, deadline=None)
def test_whatever_triangles_there_are_the_shell_is_closed(rng, n):
    corners = rng.uniform(-1, 1, (n, 1, 3)) + 0.5 * rng.standard_normal((n, 3, 3))
    shell = wrap(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3), n_cells=25)
    assert_shell(shell)
    assert not wants_wrapping(shell.faces) or n > 10


def test_bodies_do_not_want_wrapping():
    for mesh in make_creatures(3, n_vertices=600).meshes:
        mended = mend(mesh.vertices, mesh.faces)
        assert wants_wrapping(mended.faces, mended.tally) == ""
    # Holes are no handles.
    few = np.random.default_rng(0).choice(len(BALL.faces), 60, replace=False)
    mended = mend(BALL.vertices, np.delete(BALL.faces, few, axis=0))
    assert len(boundary_pieces(mended.faces)) > 20
    assert wants_wrapping(mended.faces, mended.tally) == ""


@pytest.mark.parametrize(("n", "size", "wanted"), [(30, 0.08, True), (30, 0.01, False)])
def test_debris_around_the_largest_piece_wants_wrapping_if_it_is_much(n, size, wanted):
    rng = np.random.default_rng(0)
    small = make_sphere(n_subdivisions=1)
    crumbs = [size * small.vertices + rng.uniform(-0.5, 0.5, 3) for _ in range(n)]
    faces = [small.faces + BALL.n_vertices + i * small.n_vertices for i in range(n)]
    mended = mend(np.concatenate([BALL.vertices, *crumbs]), np.concatenate([BALL.faces, *faces]))
    assert bool(wants_wrapping(mended.faces, mended.tally)) == wanted
    assert mended.tally["pieces around"] == n
