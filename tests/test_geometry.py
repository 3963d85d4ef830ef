"""Kernels on vertices and faces: known answers by hand, theorems, agreement of two routes."""

import igl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from skfmap.geometry.curvature import (
    clip_by_area,
    gaussian_curvature,
    log_magnitude,
    mean_curvature,
)
from skfmap.geometry.faults import (
    boundary_vertices,
    count_components,
    degenerate_faces,
    edges_of,
    is_wound_consistently,
    nonmanifold_edges,
    repeated_corners,
    unreferenced_vertices,
)
from skfmap.geometry.geodesics import (
    areas_of_landmarks,
    edge_path_distances,
    exact_distances,
    farthest_vertices,
    heat_distances,
)
from skfmap.geometry.laplacian import cotangent_laplacian, robust_mesh_laplacian
from skfmap.geometry.orientation import orient_faces, signed_volume
from skfmap.geometry.oriented import integrated_oriented_products
from skfmap.geometry.saliency import gaussian_averages, mesh_saliency
from skfmap.geometry.sphere import subdivided_octahedron


@pytest.fixture(scope="module")
def sphere():
    return subdivided_octahedron(4)


@pytest.fixture(scope="module")
def torus():
    u, v = np.meshgrid(np.arange(40), np.arange(24), indexing="ij")
    a, b = 2 * np.pi * u / 40, 2 * np.pi * v / 24
    vertices = np.stack(
        [(2 + np.cos(b)) * np.cos(a), (2 + np.cos(b)) * np.sin(a), np.sin(b)], -1
    ).reshape(-1, 3)
    at = lambda i, j: (i % 40) * 24 + j % 24
    lower = np.stack([at(u, v), at(u + 1, v), at(u + 1, v + 1)], -1).reshape(-1, 3)
    upper = np.stack([at(u, v), at(u + 1, v + 1), at(u, v + 1)], -1).reshape(-1, 3)
    return vertices, np.concatenate([lower, upper])


@pytest.mark.parametrize("laplacian", [cotangent_laplacian, robust_mesh_laplacian])
def test_laplacian_is_the_dirichlet_energy(laplacian, sphere):
    vertices, faces = sphere
    stiffness, mass = laplacian(vertices, faces)
    assert mass.sum() == pytest.approx(igl.doublearea(vertices, faces).sum() / 2)
    np.testing.assert_allclose(stiffness @ np.ones(len(vertices)), 0, atol=1e-9)
    assert np.linalg.eigvalsh(stiffness.toarray()).min() > -1e-9
    # The coordinates of a unit sphere have Dirichlet energy 2 * (4 pi / 3).
    assert vertices[:, 0] @ stiffness @ vertices[:, 0] == pytest.approx(8 * np.pi / 3, rel=0.01)


def test_cotangent_laplacian_is_gradient_transposed_times_gradient(torus):
    vertices, faces = torus
    stiffness, _ = cotangent_laplacian(vertices, faces)
    gradient = igl.grad(vertices, faces)
    areas = np.tile(igl.doublearea(vertices, faces) / 2, 3)
    difference = stiffness - gradient.T @ (areas[:, None] * gradient.toarray())
    assert np.abs(difference).max() < 1e-9


@pytest.mark.parametrize(("shape", "euler"), [("sphere", 2), ("torus", 0)])
def test_gauss_bonnet(shape, euler, request):
    vertices, faces = request.getfixturevalue(shape)
    _, mass = cotangent_laplacian(vertices, faces)
    assert gaussian_curvature(vertices, faces, mass) @ mass == pytest.approx(
        2 * np.pi * euler, abs=1e-9
    )


@pytest.mark.parametrize("radius", [0.5, 1.0, 3.0])
def test_curvatures_of_a_sphere(sphere, radius):
    vertices, faces = radius * sphere[0], sphere[1]
    stiffness, mass = cotangent_laplacian(vertices, faces)
    middle = np.median(mean_curvature(vertices, faces, stiffness, mass))
    assert middle == pytest.approx(1 / radius, rel=0.03)
    assert np.median(gaussian_curvature(vertices, faces, mass)) == pytest.approx(
        1 / radius**2, rel=0.05
    )


def test_curvature_on_the_boundary_is_that_of_the_neighbours(sphere):
    vertices, faces = sphere
    open_faces = faces[5:]
    stiffness, mass = cotangent_laplacian(vertices, open_faces)
    rim = boundary_vertices(open_faces, len(vertices))
    assert rim.any()
    for curvature in (
        gaussian_curvature(vertices, open_faces, mass),
        mean_curvature(vertices, open_faces, stiffness, mass),
    ):
        inside = curvature[~rim]
        assert (curvature[rim] >= inside.min()).all()
        assert (curvature[rim] <= inside.max()).all()
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert (
        gaussian_curvature(triangle, np.array([[0, 1, 2]]), np.full(3, 1 / 6)) == 0
    ).all()  # nobody inside


@given(st.integers(0, 2**31), st.floats(0, 40))
@settings(max_examples=25)
def test_clipping_is_by_area_and_not_by_count(seed, percentile):
    rng = np.random.default_rng(seed)
    values, mass = rng.standard_normal(60), rng.random(60) + 0.1
    clipped = clip_by_area(values, mass, percentile)
    split = clip_by_area(np.repeat(values, 2), np.repeat(mass, 2) / 2, percentile)
    assert values.min() <= clipped.min() <= clipped.max() <= values.max()
    assert np.abs(np.repeat(clipped, 2) - split).max() < 1.0
    if percentile == 0:
        np.testing.assert_allclose(clipped, values)


def test_log_magnitude_has_a_floor():
    np.testing.assert_allclose(log_magnitude(np.array([0.0, -np.e, 0.5]), 1.0), [0, 1, 0])


def test_gaussian_averages_keep_constants_and_integrals_and_damp_known_modes(sphere):
    vertices, faces = sphere
    stiffness, mass = cotangent_laplacian(vertices, faces)
    scales = np.array([0.1, 0.3])
    np.testing.assert_allclose(
        gaussian_averages(np.ones(len(mass)), stiffness, mass, scales), 1, rtol=1e-9
    )
    height = vertices[:, 2]
    averages = gaussian_averages(height, stiffness, mass, scales)
    np.testing.assert_allclose(mass @ averages, 0, atol=1e-9)
    # A coordinate is an eigenfunction with eigenvalue 2: at time sigma^2 / 2 it is damped by
    # exp(-sigma^2).
    damping = (averages * (mass * height)[:, None]).sum(axis=0) / (mass @ height**2)
    np.testing.assert_allclose(damping, np.exp(-(scales**2)), rtol=3e-3)


def test_saliency_is_nil_on_a_sphere_and_not_on_a_bump(sphere):
    vertices, faces = sphere
    stiffness, mass = cotangent_laplacian(vertices, faces)
    scales = np.array([0.1, 0.2])
    assert mesh_saliency(np.ones(len(mass)), stiffness, mass, scales).max() < 1e-9
    bump = np.exp(-((vertices - vertices[0]) ** 2).sum(axis=1) / 0.02)
    saliency = mesh_saliency(bump, stiffness, mass, scales)
    assert (saliency.argmax(axis=0) == 0).all()


def test_oriented_product_integrates_the_bracket_of_coordinates(sphere):
    vertices, faces = sphere
    x, y, z = vertices.T
    # On the unit sphere <grad x x grad y, n> = z, so its integral against z is 4 pi / 3, and
    # against x it is nil.
    integral = integrated_oriented_products(x[:, None], y[:, None], faces)[:, 0]
    assert integral @ z == pytest.approx(4 * np.pi / 3, rel=0.02)
    assert abs(integral @ x) < 1e-9


def test_oriented_product_is_antisymmetric_and_changes_sign_with_the_winding(torus):
    vertices, faces = torus
    f, g = np.random.default_rng(0).standard_normal((2, len(vertices), 3))
    product = integrated_oriented_products(f, g, faces)
    np.testing.assert_allclose(integrated_oriented_products(g, f, faces), -product, atol=1e-12)
    np.testing.assert_allclose(
        integrated_oriented_products(f, g, faces[:, [0, 2, 1]]), -product, atol=1e-12
    )
    np.testing.assert_allclose(product.sum(axis=0), 0, atol=1e-9)


def test_signed_volume_of_a_sphere_and_of_one_with_a_hole(sphere):
    vertices, faces = sphere
    assert signed_volume(vertices + 7, faces) == pytest.approx(4 * np.pi / 3, rel=0.02)
    assert signed_volume(vertices - 3, faces[4:]) == pytest.approx(4 * np.pi / 3, rel=0.03)
    assert signed_volume(vertices, faces[:, ::-1]) == pytest.approx(-signed_volume(vertices, faces))


@pytest.mark.parametrize("n_missing", [0, 6])
@given(seed=st.integers(0, 2**31))
@settings(max_examples=10)
def test_any_winding_is_turned_outwards(n_missing, seed):
    vertices, faces = subdivided_octahedron(2)
    faces = faces[n_missing:]
    flipped = np.where(
        np.random.default_rng(seed).random(len(faces))[:, None] < 0.5, faces[:, ::-1], faces
    )
    oriented, consistent, outward = orient_faces(vertices, flipped)
    assert consistent
    assert outward
    assert signed_volume(vertices, oriented) > 0
    np.testing.assert_array_equal(np.sort(oriented, axis=1), np.sort(faces, axis=1))


def test_a_flat_sheet_has_no_outside_and_a_moebius_band_no_winding():
    sheet = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    _, consistent, outward = orient_faces(sheet, np.array([[0, 1, 2], [0, 2, 3]]))
    assert consistent
    assert not outward
    n = 12
    angle = 2 * np.pi * np.arange(n) / n
    across = np.stack(
        [np.cos(angle / 2) * np.cos(angle), np.cos(angle / 2) * np.sin(angle), np.sin(angle / 2)], 1
    )
    middle = 2 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    band = np.concatenate([middle - 0.3 * across, middle + 0.3 * across])
    here = np.arange(n)
    nxt, swap = (here + 1) % n, here == n - 1
    low, high = np.where(swap, nxt + n, nxt), np.where(swap, nxt, nxt + n)
    faces = np.concatenate([np.stack([here, low, high], 1), np.stack([here, high, here + n], 1)])
    assert not orient_faces(band, faces)[1]


def test_faults_by_hand():
    faces = np.array([[0, 1, 2], [0, 2, 1], [3, 3, 4]])
    assert unreferenced_vertices(faces, 7).tolist() == [5, 6]
    assert repeated_corners(faces).tolist() == [2]
    assert count_components(np.array([[0, 1, 2], [3, 4, 5]]), 7) == 3
    assert not is_wound_consistently(np.array([[0, 1, 2], [0, 1, 3]]))
    assert nonmanifold_edges(np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]])).tolist() == [[0, 1]]
    assert edges_of(np.array([[0, 1, 2], [2, 1, 3]])).tolist() == [
        [0, 1],
        [0, 2],
        [1, 2],
        [1, 3],
        [2, 3],
    ]
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]])
    assert degenerate_faces(flat, np.array([[0, 1, 2], [0, 1, 3]])).tolist() == [0]


def test_degeneracy_does_not_depend_on_units():
    needle = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-4, 0]])
    for unit in (1e-6, 1.0, 1e6):
        assert len(degenerate_faces(unit * needle, np.array([[0, 1, 2]]))) == 0


def test_exact_distances_on_a_sphere_are_arc_lengths(sphere):
    vertices, faces = sphere
    distances = exact_distances(vertices, faces, np.array([0]))[0]
    arcs = np.arccos(np.clip(vertices @ vertices[0], -1, 1))
    assert np.abs(distances - arcs).max() < 0.02


def test_faster_distances_disagree_with_exact_ones_as_stated(torus):
    vertices, faces = torus
    sources = np.array([0, 333, 700])
    exact = exact_distances(vertices, faces, sources)
    heat = heat_distances(vertices, faces, sources)
    paths = edge_path_distances(vertices, faces, sources)
    # A coarse torus; on a cat of 5,000 vertices the disagreement is 0.015.
    assert np.abs(heat - exact).mean() < 0.06 * exact.mean()
    straight = np.linalg.norm(vertices[sources][:, None] - vertices, axis=2)
    assert (heat >= straight - 1e-9).all()
    assert (heat <= paths + 1e-9).all()
    assert (paths >= exact - 1e-9).all()
    assert 1.02 < paths.mean() / exact.mean() < 1.15


def test_landmarks_share_all_the_area(sphere):
    vertices, faces = sphere
    _, mass = cotangent_laplacian(vertices, faces)
    landmarks = np.array([3, 100, 55, 700])
    areas = areas_of_landmarks(vertices, faces, mass, landmarks)
    assert areas.sum() == pytest.approx(mass.sum())
    np.testing.assert_allclose(
        areas_of_landmarks(vertices, faces, mass, np.arange(len(mass))), mass
    )


def test_farthest_vertices_are_spread(sphere):
    vertices, faces = sphere
    chosen, distances = farthest_vertices(vertices, faces, np.arange(len(vertices)), 6)
    # Six well-spread points of a sphere are the corners of an octahedron, a right angle apart.
    gaps = vertices[chosen] @ vertices[chosen].T - 2 * np.eye(6)
    assert gaps.max() < 0.3
    np.testing.assert_allclose(distances, edge_path_distances(vertices, faces, chosen))
    assert len(farthest_vertices(vertices, faces, np.array([4, 9]), 6)[0]) == 2


@given(st.integers(0, 2**31), st.floats(0.01, 100))
@settings(max_examples=10)
def test_curvature_does_not_change_under_rigid_motion(seed, scale):
    vertices, faces = subdivided_octahedron(2)
    vertices = vertices * [1.0, 0.7, 0.5]
    rng = np.random.default_rng(seed)
    moved = scale * Rotation.random(random_state=rng).apply(vertices) + rng.standard_normal(3)

    def curvatures(points):
        stiffness, mass = cotangent_laplacian(points, faces)
        return gaussian_curvature(points, faces, mass), mean_curvature(
            points, faces, stiffness, mass
        )

    for before, after, power in zip(curvatures(vertices), curvatures(moved), (2, 1), strict=True):
        np.testing.assert_allclose(after * scale**power, before, rtol=1e-6, atol=1e-6)
