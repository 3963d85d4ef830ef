"""Nearest points of surfaces, the best similarity between points, and shapes laid by one."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from skfmap.functional.similarity import Similarity, best_similarity
from skfmap.geometry.closest import ClosestPoints, face_normals
from skfmap.geometry.normals import vertex_normals
from skfmap.geometry.sphere import subdivided_octahedron
from skfmap.registration.alignment import align, principal_axes


def nearest_by_hand(point, triangle):
    """The point of a triangle that is nearest: inside, or on the nearest of its edges."""
    a, b, c = triangle
    u, v = np.linalg.lstsq(np.stack([b - a, c - a], axis=1), point - a, rcond=None)[0]
    if min(u, v, 1 - u - v) >= 0:
        return a + u * (b - a) + v * (c - a)
    on_edges = []
    for p, q in ((a, b), (b, c), (c, a)):
        share = np.clip((point - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
        on_edges.append(p + share * (q - p))
    return min(on_edges, key=lambda x: np.linalg.norm(x - point))


@pytest.fixture(scope="module")
def square():
    """Return an open square of 5 x 5 vertices in the plane z = 0, facing upwards."""
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0), indexing="ij")
    corner = (np.arange(4)[:, None] * 5 + np.arange(4)).ravel()
    lower = np.stack([corner, corner + 5, corner + 6], axis=1)
    upper = np.stack([corner, corner + 6, corner + 1], axis=1)
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    return vertices, np.concatenate([lower, upper])


def test_the_nearest_points_are_those_of_brute_force(collection):
    mesh = collection.meshes[5]
    points = np.random.default_rng(0).normal(size=(12, 3)) * 1.5
    found = ClosestPoints(mesh.vertices, mesh.faces).of(points)
    for i, point in enumerate(points):
        by_face = [nearest_by_hand(point, mesh.vertices[face]) for face in mesh.faces]
        away = np.linalg.norm(np.array(by_face) - point, axis=1)
        best = int(np.argmin(away))
        np.testing.assert_allclose(found.points[i], by_face[best], atol=1e-9)
        assert found.distances[i] == pytest.approx(away[best], abs=1e-9)
    assert not found.on_rim.any(), "a closed surface has no rim"


def test_the_rim_is_beside_the_square_and_not_above_it(square):
    target = ClosestPoints(*square)
    above = np.array([[2.2, 1.3, 0.7], [0.01, 2.0, -1.0], [1.0, 1.0, 0.0], [2.0, 2.5, 3.0]])
    beside = np.array([[-0.1, 2.3, 0.0], [2.4, 4.5, 0.5], [5, 5, 1], [9.0, 2.0, -2.0], [2, 0, 1]])
    assert not target.of(above).on_rim.any()
    found = target.of(beside)
    assert found.on_rim.all()
    np.testing.assert_allclose(found.points, np.clip(beside, 0, [4, 4, 0]), atol=1e-12)
    np.testing.assert_allclose(found.normals, np.tile([0.0, 0, 1], (5, 1)), atol=1e-12)


def test_normals_are_those_of_vertices_and_between_them(collection):
    """At vertices, at middles of edges and within faces; not those of one of the faces there."""
    mesh = collection.meshes[5]
    target = ClosestPoints(mesh.vertices, mesh.faces)
    normals, corners = vertex_normals(mesh.vertices, mesh.faces), mesh.faces[:50]
    for weights in ([1, 0, 0], [0.5, 0.5, 0], [0.6, 0.3, 0.1]):
        points = np.einsum("c,fca->fa", weights, mesh.vertices[corners])
        expected = np.einsum("c,fca->fa", weights, normals[corners])
        expected /= np.linalg.norm(expected, axis=1, keepdims=True)
        np.testing.assert_allclose(target.of(points).normals, expected, atol=1e-7)


def test_normals_do_not_hang_on_rounding(collection):
    """Above corners of a body many faces are equally near; turned, all is the same."""
    mesh = collection.meshes[5]
    out = vertex_normals(mesh.vertices, mesh.faces)
    points = mesh.vertices + 0.05 * out
    turn = Rotation.random(random_state=3).as_matrix()
    plain = ClosestPoints(mesh.vertices, mesh.faces).of(points)
    turned = ClosestPoints(mesh.vertices @ turn.T + 3, mesh.faces).of(points @ turn.T + 3)
    np.testing.assert_allclose(turned.normals, plain.normals @ turn.T, atol=1e-6)


@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_the_rim_is_found_in_any_unit_and_place(square, scale):
    vertices, faces = square
    turn, shift = Rotation.random(random_state=2).as_matrix(), np.array([3.0, -7, 2]) * scale
    points = np.random.default_rng(1).uniform(-1, 5, size=(200, 3)) * [1, 1, 0.3]
    plain = ClosestPoints(vertices, faces).of(points)
    beside = (points[:, :2] < 0).any(axis=1) | (points[:, :2] > 4).any(axis=1)
    np.testing.assert_array_equal(plain.on_rim, beside)
    there = ClosestPoints(scale * vertices @ turn.T + shift, faces)
    found = there.of(scale * points @ turn.T + shift)
    np.testing.assert_array_equal(found.on_rim, beside)
    np.testing.assert_allclose(found.distances, scale * plain.distances, atol=1e-9 * scale)


def test_normals_of_faces_in_closed_form(square):
    vertices, faces = subdivided_octahedron(4)
    normals = face_normals(vertices, faces)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-12)
    middles = vertices[faces].mean(axis=1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    assert np.einsum("na,na->n", normals, middles).min() > 0.995
    nothing = face_normals(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    np.testing.assert_array_equal(nothing, np.zeros((1, 3)))


# The best similarity


def known_similarity(seed):
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=seed).as_matrix()
    return Similarity(float(rng.uniform(0.2, 5)), rotation, rng.normal(size=3))


@pytest.mark.parametrize("seed", range(5))
def test_a_known_similarity_is_recovered(seed):
    rng, known = np.random.default_rng(seed), known_similarity(seed)
    points = rng.normal(size=(10, 3))
    found = best_similarity(points, known.apply(points), rng.uniform(0.1, 1, size=10))
    assert found.scale == pytest.approx(known.scale)
    np.testing.assert_allclose(found.rotation, known.rotation, atol=1e-10)
    np.testing.assert_allclose(found.shift, known.shift, atol=1e-10)


@pytest.mark.parametrize("mirrored", [False, True])
def test_no_similarity_is_better(mirrored):
    """None near by, and none that a search finds from anywhere, reflections being no rotations."""
    rng = np.random.default_rng(3)
    points, weights = rng.normal(size=(12, 3)), rng.uniform(0.1, 1, size=12)
    onto = known_similarity(3).apply(points * ([-1, 1, 1] if mirrored else 1))
    onto += 0.3 * rng.normal(size=onto.shape)

    def cost(similarity):
        return float(weights @ np.square(similarity.apply(points) - onto).sum(axis=1))

    def searched(x):
        return cost(Similarity(np.exp(x[0]), Rotation.from_rotvec(x[1:4]).as_matrix(), x[4:]))

    found = best_similarity(points, onto, weights)
    assert np.linalg.det(found.rotation) == pytest.approx(1)
    least = min(minimize(searched, rng.normal(size=7)).fun for _ in range(8))
    assert cost(found) == pytest.approx(least, rel=1e-6)


def test_points_of_no_weight_do_not_count():
    rng, known = np.random.default_rng(4), known_similarity(4)
    points = rng.normal(size=(10, 3))
    onto = known.apply(points)
    onto[:3] += 5
    weights = np.r_[np.zeros(3), np.ones(7)]
    np.testing.assert_allclose(
        best_similarity(points, onto, weights).apply(points[3:]), onto[3:], atol=1e-10
    )


def test_points_that_are_all_one_are_moved_there():
    points, onto = np.ones((4, 3)), np.random.default_rng(0).normal(size=(4, 3))
    found = best_similarity(points, onto, np.ones(4))
    np.testing.assert_allclose(found.apply(points), np.tile(onto.mean(axis=0), (4, 1)), atol=1e-9)


# A shape laid by a similarity


def of_unit_area(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, j]] for j in range(3))
    thirds = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    areas = np.bincount(mesh.faces.ravel(), np.repeat(thirds, 3), minlength=mesh.n_vertices)
    return mesh.vertices / np.sqrt(areas.sum()), mesh.faces, areas / areas.sum()


@pytest.mark.parametrize("seed", range(4))
def test_an_asymmetric_shape_is_found_however_it_is_turned(seed, collection):
    """Its own mesh, turned by any angle, resized and moved: back by the similarity that did it."""
    vertices, faces, areas = of_unit_area(collection.meshes[0])
    known = Similarity(
        [0.9, 1.0, 1.1, 1.2][seed],
        Rotation.random(random_state=seed).as_matrix(),
        np.array([4.0, -2, 7]) * seed,
    )
    onto = known.apply(vertices)
    found = align(vertices, faces, ClosestPoints(onto, faces), principal_axes(onto, areas), areas)
    assert np.linalg.norm(found.apply(vertices) - onto, axis=1).max() < 0.01
    assert found.scale == pytest.approx(known.scale, rel=0.01)
    away = Rotation.from_matrix(found.rotation.T @ known.rotation).magnitude()
    assert np.degrees(away) < 0.5


def test_a_start_that_is_given_is_used(collection):
    """A sphere has no axes of its own, but one with a small bump is known by its start."""
    vertices, faces = subdivided_octahedron(3)
    vertices = vertices * (1 + 0.4 * np.exp(-20 * (1 - vertices @ [0.6, 0.0, 0.8])))[:, None]
    vertices /= np.sqrt(4 * np.pi)
    areas = np.ones(len(vertices)) / len(vertices)
    known = Similarity(1.0, Rotation.random(random_state=8).as_matrix(), np.zeros(3))
    onto = known.apply(vertices)
    frame = np.zeros(3), np.eye(3)  # that of the target is not known
    target = ClosestPoints(onto, faces)
    found = align(vertices, faces, target, frame, areas, [known])
    assert np.linalg.norm(found.apply(vertices) - onto, axis=1).max() < 1e-9


def test_principal_axes_in_closed_form():
    points = np.concatenate([np.diag([3.0, 1, 2]), -np.diag([3.0, 1, 2])])
    turn = Rotation.random(random_state=5).as_matrix()
    centre, axes = principal_axes(points @ turn.T + [1, 2, 3], np.ones(6))
    np.testing.assert_allclose(centre, [1, 2, 3], atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1)
    np.testing.assert_allclose(np.abs(axes.T @ turn), np.eye(3)[[1, 2, 0]], atol=1e-12)
