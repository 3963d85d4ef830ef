"""Thinning and places on thinned meshes: guarantees, closed forms, thin walls."""

import sys
from concurrent.futures import ThreadPoolExecutor

import igl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from skfmap.geometry.faults import (
    boundary_vertices,
    components,
    degenerate_faces,
    edges_of,
    is_wound_consistently,
    nonmanifold_edges,
    nonmanifold_vertices,
)
from skfmap.geometry.normals import vertex_normals
from skfmap.geometry.places import Surface, places_after_collapse, surface_of_places
from skfmap.geometry.sphere import subdivided_octahedron
from skfmap.geometry.thinning import Thinned, _by_quadrics, _without_folds, check_thinned, thin


def grid(n, width=1.0):
    """Return a flat square in the plane z = 0, n vertices along each side, facing upwards."""
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3) * (width / (n - 1))
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    lower = np.stack([corner, corner + n, corner + n + 1], axis=1)
    upper = np.stack([corner, corner + n + 1, corner + 1], axis=1)
    return points, np.concatenate([lower, upper])


def flat_box(n, thickness):
    """Return two grids, one above the other, joined along the rim; the first n * n are below."""
    points, faces = grid(n)
    at = np.arange(n * n).reshape(n, n)
    rim = np.concatenate([at[:-1, 0], at[-1, :-1], at[:0:-1, -1], at[0, :0:-1]])
    after = np.roll(rim, -1)
    walls = [[rim, after, after + n * n], [rim, after + n * n, rim + n * n]]
    faces = [faces[:, ::-1], faces + n * n, *(np.stack(wall, axis=1) for wall in walls)]
    return np.concatenate([points, points + np.array([0, 0, thickness])]), np.concatenate(faces)


def face_normals(vertices, faces):
    a, b, c = (vertices[faces[:, j]] for j in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def prolong(values, faces, places):
    """Bring values at thinned vertices to the places."""
    second, third = places.coordinates.T.astype(float)
    weights = np.stack([1 - second - third, second, third], axis=1)
    return np.einsum("ij,ij...->i...", weights, values[faces[places.face]])


def euler(faces):
    return len(np.unique(faces)) - len(edges_of(faces)) + len(faces)


def assert_sound(vertices, faces):
    assert np.array_equal(np.unique(faces), np.arange(len(vertices)))
    assert len(np.unique(components(faces, len(vertices)))) == 1
    assert is_wound_consistently(faces)
    assert len(nonmanifold_edges(faces)) == 0
    assert len(nonmanifold_vertices(faces, len(vertices))) == 0
    assert len(degenerate_faces(vertices, faces)) == 0


SHAPES = {"sphere": subdivided_octahedron(5), "square": grid(60), "box": flat_box(40, 0.05)}


@pytest.mark.parametrize("n_vertices", [60, 300])
@pytest.mark.parametrize("shape", SHAPES)
def test_thinned_surfaces_are_sound(shape, n_vertices):
    vertices, faces = SHAPES[shape]
    thinned = thin(vertices, faces, n_vertices)
    assert 0.9 * n_vertices <= len(thinned.vertices) <= n_vertices
    assert_sound(thinned.vertices, thinned.faces)
    assert euler(thinned.faces) == euler(faces)
    assert thinned.vertex_map.shape == (len(vertices),)
    assert np.array_equal(np.unique(thinned.vertex_map), np.arange(len(thinned.vertices)))


@pytest.mark.parametrize("n_vertices", [60, 100, 300])
@pytest.mark.parametrize("shape", ["sphere", "square"])
def test_thinned_faces_are_well_shaped(shape, n_vertices):
    vertices, faces, _ = thin(*SHAPES[shape], n_vertices)
    corners = vertices[faces]
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert lengths.max() < 3 * np.median(lengths)
    assert lengths.min() > np.median(lengths) / 3
    assert (igl.doublearea(vertices, faces) > 0.02 * lengths.max(axis=1) ** 2).all()


def test_thinned_sphere_faces_outwards():
    thinned = thin(*SHAPES["sphere"], 200)
    middles = thinned.vertices[thinned.faces].mean(axis=1)
    assert ((face_normals(thinned.vertices, thinned.faces) * middles).sum(axis=1) > 0.9).all()


def test_boundaries_are_not_drawn_inwards():
    vertices, faces = SHAPES["square"]
    thinned = thin(vertices, faces, 200)
    assert boundary_vertices(thinned.faces, len(thinned.vertices)).sum() < 60
    area = igl.doublearea(thinned.vertices, thinned.faces).sum() / 2
    assert 0.99 < area <= 1 + 1e-9


def test_units_and_offsets_do_not_matter():
    vertices, faces = SHAPES["sphere"]
    thinned = thin(vertices, faces, 150)
    moved = thin(vertices * 1024 + [2**20, -(2**22), 0], faces, 150)
    assert np.array_equal(moved.faces, thinned.faces)
    assert np.array_equal(moved.vertex_map, thinned.vertex_map)


def test_small_meshes_stay_as_they_are():
    vertices, faces = subdivided_octahedron(1)
    thinned = thin(vertices, faces, 18)
    assert np.array_equal(thinned.vertices, vertices)
    assert np.array_equal(thinned.faces, faces)
    assert np.array_equal(thinned.vertex_map, np.arange(18))


def test_linear_functions_are_prolonged_exactly_on_a_plane():
    vertices, faces = SHAPES["square"]
    thinned = thin(vertices, faces, 200)
    places = places_after_collapse(vertices, vertex_normals(vertices, faces), *thinned)
    inside = places.distance < 1e-6  # all but those beyond the thinned rim
    assert inside[abs(vertices[:, :2] - 0.5).max(axis=1) < 0.45].all()
    function = lambda points: 2 + points @ [1.0, -3.0, 5.0]
    error = prolong(function(thinned.vertices), thinned.faces, places) - function(vertices)
    assert abs(error[inside]).max() < 1e-6


def test_a_mesh_is_its_own_place():
    vertices, faces = SHAPES["sphere"]
    places = places_after_collapse(
        vertices, vertex_normals(vertices, faces), vertices, faces, np.arange(len(vertices))
    )
    assert places.distance.max() < 1e-9
    assert abs(prolong(vertices, faces, places) - vertices).max() < 1e-6


def test_error_on_a_sphere_is_of_second_order():
    vertices, faces = subdivided_octahedron(6)
    errors = []
    for n_vertices in (100, 400, 1600):
        thinned = thin(vertices, faces, n_vertices)
        places = places_after_collapse(vertices, vertex_normals(vertices, faces), *thinned)
        error = prolong(thinned.vertices, thinned.faces, places) - vertices
        errors.append(np.linalg.norm(error, axis=1).mean())
    assert errors[1] < errors[0] / 3
    assert errors[2] < errors[1] / 3


def test_places_do_not_jump_through_thin_walls():
    vertices, faces = flat_box(60, 0.01)
    thinned = thin(vertices, faces, 200)
    assert np.linalg.norm(vertices[0] - vertices[1]) < 0.02
    normals = vertex_normals(vertices, faces)
    places = places_after_collapse(vertices, normals, *thinned)
    there = face_normals(thinned.vertices, thinned.faces)[places.face]
    flat = abs(normals[:, 2]) > 0.9
    assert flat.mean() > 0.9
    assert (there[flat, 2] * normals[flat, 2] > 0).all()


def test_vertices_without_a_place():
    vertices, faces = subdivided_octahedron(2)
    nowhere = np.arange(len(vertices))
    nowhere[::5] = -1
    places = places_after_collapse(vertices, vertices, vertices, faces, nowhere)
    assert np.array_equal(places.face == -1, nowhere == -1)
    assert np.array_equal(np.isnan(places.coordinates).all(axis=1), nowhere == -1)
    assert np.array_equal(np.isnan(places.distance), nowhere == -1)


def test_handles_stay():
    """The fast collapse to 400 vertices folds and pinches this torus, and so is not used."""
    n = 2000
    u, v = np.meshgrid(np.arange(n), np.arange(3), indexing="ij")
    a, b = 2 * np.pi * u / n, 2 * np.pi * v / 3
    radius = 1 + 1e-3 * np.cos(b)
    points = np.stack([radius * np.cos(a), radius * np.sin(a), 1e-3 * np.sin(b)], axis=-1)
    at = lambda i, j: (i % n) * 3 + j % 3
    lower = np.stack([at(u, v), at(u + 1, v), at(u + 1, v + 1)], axis=-1).reshape(-1, 3)
    upper = np.stack([at(u, v), at(u + 1, v + 1), at(u, v + 1)], axis=-1).reshape(-1, 3)
    thinned = thin(points.reshape(-1, 3), np.concatenate([lower, upper]), 40)
    assert_sound(thinned.vertices, thinned.faces)
    assert len(thinned.vertices) <= 40
    assert euler(thinned.faces) == 0


def test_faces_that_lie_on_each_other_are_cut_off():
    """A vertex inside face 0 of an octahedron, pulled over its first edge: as collapses do."""
    _, faces = subdivided_octahedron(0)
    a, b, c = faces[0]
    flap = [[a, b, 6], [b, a, 6]]
    pocket = [[a, b, c], [b, a, 7], [a, c, 7], [c, b, 7], [b, c, 8], [c, b, 8]]
    assert np.array_equal(_without_folds(np.array([*faces, *flap])), faces)
    left = _without_folds(np.array([*faces[1:], *pocket]))
    assert np.array_equal(left, [*faces[1:], *pocket[:4]])


@settings(max_examples=8)
@given(st.integers(0, 10**6), st.sampled_from([40, 150, 700]), st.floats(0.0, 0.3))
def test_noisy_surfaces_stay_sound(seed, n_vertices, noise):
    rng = np.random.default_rng(seed)
    vertices, faces = SHAPES["sphere"]
    order = rng.permutation(len(vertices))
    noisy = vertices[order] + noise * 0.04 * rng.standard_normal(vertices.shape)
    faces = np.argsort(order)[faces]
    faces = faces[~np.isin(faces, faces[0]).any(axis=1)]  # a hole
    used, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3)
    thinned = thin(noisy[used], faces, n_vertices)
    assert_sound(thinned.vertices, thinned.faces)
    assert len(thinned.vertices) <= n_vertices
    assert euler(thinned.faces) == euler(faces) == 1
    away = np.linalg.norm(thinned.vertices[thinned.vertex_map] - noisy[used], axis=1)
    assert away.max() < 6 * np.sqrt(4 * np.pi / n_vertices)


def test_threads_do_not_disturb_each_other():
    vertices, faces = SHAPES["sphere"]
    mesh = Thinned(vertices, faces, np.arange(len(vertices)))
    sizes = [500, 700, 1000, 1500] * 6
    alone = [_by_quadrics(mesh, size) for size in sizes]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            together = list(pool.map(lambda size: _by_quadrics(mesh, size), sizes))
    finally:
        sys.setswitchinterval(interval)
    for one, other in zip(alone, together, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@settings(max_examples=50)
@given(
    arrays(float, (3, 3), elements=st.integers(-4, 4)),
    arrays(float, (5, 3), elements=st.floats(-9, 9)),
)
def test_nearest_points_of_a_triangle(corners, points):
    """Also of triangles that are segments or points, as where places coincide."""
    surface = Surface(corners, np.array([[0, 1, 2]]))
    places = surface.around(points, np.zeros((5, 3)), np.zeros(5, dtype=np.int64))
    second, third = places.coordinates.T.astype(float)
    found = np.stack([1 - second - third, second, third], axis=1) @ corners
    assert places.coordinates.min() >= 0
    assert places.coordinates.sum(axis=1).max() <= 1 + 1e-6
    assert np.allclose(np.linalg.norm(found - points, axis=1), places.distance, atol=1e-5)
    steps = np.linspace(0, 1, 41)
    s, t = (grid[np.add.outer(steps, steps) <= 1] for grid in np.meshgrid(steps, steps))
    others = corners[0] + s[:, None] * (corners[1] - corners[0])
    others += t[:, None] * (corners[2] - corners[0])
    distances = np.linalg.norm(others - points[:, None], axis=2).min(axis=1)
    assert (places.distance <= distances + 1e-6).all()


def test_located_points_do_not_jump_through_thin_walls():
    vertices, faces = flat_box(30, 0.002)
    surface = Surface(vertices, faces)
    points = np.random.default_rng(0).random((500, 3)) * [0.9, 0.9, 0.002] + [0.05, 0.05, 0]
    for z in (-1.0, 1.0):
        places = surface.locate(points, np.tile([0, 0, z], (500, 1)))
        there = vertices[faces[places.face]].mean(axis=1)
        assert np.array_equal(there[:, 2], np.full(500, 0.001 * (1 + z)))
        assert abs(prolong(vertices, faces, places) - points)[:, :2].max() < 1e-6


def test_places_can_be_asked_to_agree():
    vertices, faces = SHAPES["square"]
    surface = Surface(vertices, faces)
    points = vertices[[800, 801, 802, 803]]
    tilted = np.array([[0, 0, 1.0], [0, 0.8, 0.6], [0, 1, 0], [0, 0, -1]])
    assert (surface.locate(points, tilted).face >= 0).all()
    places = surface.locate(points, tilted, agreeing=True)
    assert np.array_equal(places.face >= 0, [True, True, False, False])
    assert np.isnan(places.distance[2:]).all()


def test_points_that_are_not_finite_have_no_place():
    vertices, faces = subdivided_octahedron(2)
    points = vertices.copy()
    points[7] = np.nan
    places = Surface(vertices, faces).locate(points, vertices)
    assert np.array_equal(np.flatnonzero(places.face < 0), [7])


def test_the_way_back_finds_given_vertices():
    vertices, faces = SHAPES["sphere"]
    thinned = thin(vertices, faces, 300)
    places = places_after_collapse(vertices, vertex_normals(vertices, faces), *thinned)
    surface = surface_of_places(faces, places, thinned.vertices, thinned.faces)
    positions = prolong(thinned.vertices, thinned.faces, places)
    normals = face_normals(thinned.vertices, thinned.faces)[places.face]
    back = surface.locate(positions, normals)
    assert back.distance.max() < 1e-6
    assert abs(prolong(positions, faces, back) - positions).max() < 1e-6
    # And points in between lie in given faces that are really there.
    middles = thinned.vertices[thinned.faces].mean(axis=1)
    back = surface.locate(middles, face_normals(thinned.vertices, thinned.faces))
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    assert np.linalg.norm(prolong(vertices, faces, back) - middles, axis=1).max() < 0.05


def test_the_way_back_leaves_out_vertices_without_a_place():
    vertices, faces = subdivided_octahedron(3)
    nearby = np.where(vertices[:, 2] > 0.5, -1, np.arange(len(vertices)))
    places = places_after_collapse(vertices, vertices, vertices, faces, nearby)
    back = surface_of_places(faces, places, vertices, faces).locate(vertices, vertices)
    assert (vertices[faces[back.face], 2] <= 0.5).all()
    assert back.distance[nearby >= 0].max() < 1e-6
    assert back.distance[nearby < 0].min() > 1e-3


def test_hausdorff_distances():
    vertices, faces = SHAPES["sphere"]
    thinned = thin(vertices, faces, 100)
    places = places_after_collapse(vertices, vertex_normals(vertices, faces), *thinned)
    report = check_thinned(vertices, faces, thinned, places.distance)
    to_thinned = igl.point_mesh_squared_distance(vertices, thinned.vertices, thinned.faces)[0]
    to_given = igl.point_mesh_squared_distance(thinned.vertices, vertices, faces)[0]
    size = np.sqrt(igl.doublearea(vertices, faces).sum() / 2)
    exact = np.sqrt([to_thinned.max(), to_given.max()]) / size
    assert np.allclose(report.hausdorff, exact, rtol=1e-6)


@pytest.mark.parametrize(("thickness", "least", "most"), [(0.01, 0.7, 1.0), (0.4, 0.0, 0.0)])
def test_share_of_thin_walls(thickness, least, most):
    vertices, faces = flat_box(40, thickness)
    thinned = thin(vertices, faces, 400)
    report = check_thinned(vertices, faces, thinned, np.zeros(len(vertices)))
    assert least <= report.thin_wall_share <= most
    assert report.n_pieces == 1
    assert report.manifold


def test_what_is_wrong_with_a_thinned_mesh_is_told():
    vertices, faces = subdivided_octahedron(2)
    two = Thinned(
        np.concatenate([vertices, vertices + 3.0]),
        np.concatenate([faces, faces[:, ::-1] + len(vertices), faces[:1]]),
        np.arange(len(vertices)),
    )
    report = check_thinned(vertices, faces, two, np.zeros(len(vertices)))
    assert report.n_pieces == 2
    assert not report.manifold
