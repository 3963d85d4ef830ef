"""Where symmetry makes values equal, the last bits, which differ by machine, choose nothing."""

import numpy as np
import pytest

from skfmap import DescriptorTransformer, Mesh, SpectralBasis, repair_mesh
from skfmap._tools.ties import first_of_largest, first_of_least, is_constant
from skfmap.datasets import make_sphere
from skfmap.descriptors import OrientedProducts
from skfmap.functional.eigenbasis import fix_signs
from skfmap.functional.neighbours import nearest as nearest_of
from skfmap.functional.neighbours import nearest_both
from skfmap.functional.stable_basis import stable_basis
from skfmap.geometry.geodesics import farthest_vertices
from skfmap.learner.medoid import medoid_index


@pytest.fixture(scope="module")
def ellipsoid():
    """Return a body of three mirror planes, whose vertices mirror each other exactly."""
    ball = make_sphere(n_subdivisions=3)
    return SpectralBasis(30).transform([Mesh(ball.vertices * [1, 1.25, 1.7], ball.faces)])[0]


def _noisy(values, scale, seeds=8):
    for seed in range(seeds):
        noise = np.random.default_rng(seed).uniform(-1, 1, values.shape)
        yield values * (1 + scale * noise)


def test_the_first_of_equal_values_wins():
    for values in _noisy(np.array([0.1, 2.0, 0.5, 2.0, 2.0]), 1e-13):
        assert first_of_largest(values) == 1
        assert first_of_least(-values) == 1
    assert first_of_largest(np.array([2.0, 2.0 + 1e-6])) == 1
    assert first_of_largest(np.array([1.0, np.inf, np.inf])) == 1
    assert first_of_largest(np.array([0.0, 1.0, -np.inf])) == 1
    assert first_of_largest(np.zeros(3)) == 0


def test_constants_are_told_from_what_is_nearly_constant():
    assert is_constant(np.zeros(3))
    assert is_constant(-0.1 + np.array([0, 1e-16, -1e-16]))
    assert not is_constant(np.array([0.1, 0.1 + 1e-6]))


def test_signs_of_antisymmetric_functions_do_not_hang_on_rounding(ellipsoid):
    """Their largest values are pairs of opposite sign."""
    evecs, mass = ellipsoid.evecs, ellipsoid.mass
    odd = np.abs(mass @ evecs**3) < 1e-6 * (mass @ np.abs(evecs) ** 3)
    assert odd.sum() > 10
    for noisy in _noisy(evecs, 1e-10):
        fixed = fix_signs(noisy * np.where(np.arange(30) % 2, -1, 1), mass)
        assert (mass @ (fixed * evecs) > 0).all()


def test_signs_of_stable_functions_do_not_hang_on_rounding():
    functions = np.array([[1.0, 1, 1, 1], [1, -1, 1, -1], [1, 1, -1, -1], [1, -1, -1, 1]]).T / 2
    differences = (np.diag([1.0, 2, 3, 4]) @ functions.T)[None]
    for noisy in _noisy(differences, 1e-13):
        np.testing.assert_allclose(stable_basis(noisy)[0], functions, atol=1e-9)


def test_well_spread_vertices_do_not_hang_on_rounding():
    ball = make_sphere(n_subdivisions=3)
    expected, _ = farthest_vertices(ball.vertices, ball.faces, np.arange(ball.n_vertices), 40)
    for noisy in _noisy(ball.vertices, 1e-14):
        chosen, _ = farthest_vertices(noisy, ball.faces, np.arange(ball.n_vertices), 40)
        np.testing.assert_array_equal(chosen, expected)


def test_of_two_shapes_the_first_is_the_medoid(probed, collection):
    """Each is as far from the other."""
    for i in range(len(probed) - 1):
        assert medoid_index(probed[i : i + 2], collection.truths[i : i + 2], None) == 0


def test_oriented_products_of_a_body_without_left_and_right_are_nil(ellipsoid):
    """On low functions they are rounding, which would be scaled up to probes of full weight."""
    assert (OrientedProducts().coefficients(ellipsoid)[:10] == 0).all()
    (shape,) = DescriptorTransformer().transform([ellipsoid])
    oriented = np.array([category.startswith("oriented") for category in shape.probe_categories])
    assert (shape.probes[:10, oriented] == 0).all()
    assert (shape.probes[:10, ~oriented] != 0).any(axis=0).all()


def test_of_pieces_of_equal_size_the_first_is_kept():
    ball = make_sphere(n_subdivisions=2)
    faces = np.concatenate([ball.faces, ball.faces + ball.n_vertices])
    for shift in (0.1, 0.3, 3.3, 7.7):
        pair = np.concatenate([ball.vertices + shift, ball.vertices + 3 * shift + 2])
        mended = repair_mesh(Mesh(pair, faces)).mesh
        np.testing.assert_array_equal(mended.vertices, pair[: ball.n_vertices])


def test_of_targets_that_are_equally_near_the_first_is_matched():
    """Points in the middle between two targets, and copies of a target, whatever rounding says."""
    rng = np.random.default_rng(0)
    targets = rng.standard_normal((40, 12))
    targets = np.concatenate([targets, targets])
    points = np.concatenate([targets[:40], (targets[:20] + targets[20:40]) / 2])
    for noisy in _noisy(targets, 1e-14):
        for nearest in (
            nearest_of(points, noisy),
            nearest_both(points, noisy)[0],
            nearest_both(noisy, points)[1],
        ):
            np.testing.assert_array_equal(nearest[:40], np.arange(40))
            assert nearest.max() < 40
    plain = rng.standard_normal((50, 12))
    squared = np.square(plain[:, None] - targets[None, :40]).sum(axis=2)
    np.testing.assert_array_equal(nearest_of(plain, targets[:40]), squared.argmin(axis=1))
    np.testing.assert_array_equal(nearest_of(plain, targets[:1]), 0)
