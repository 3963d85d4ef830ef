"""Thinning and places on thinned meshes: guarantees, closed forms, thin walls."""

import igl
import numpy as np
import pytest

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
from skfmap.geometry.places import places_after_collapse
from skfmap.geometry.sphere import subdivided_octahedron
from skfmap.geometry.thinning import thin


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
