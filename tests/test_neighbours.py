"""Nearest neighbours in both directions from one product in single precision."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skfmap.functional import areas_of_samples, farthest_points, nearest, nearest_both


def _brute(points, targets):
    """Return the first of the nearest, by differences in double precision."""
    squared = np.square(points[:, None] - targets[None]).sum(axis=2)
    slack = 1e-9 * np.square(points).sum(axis=1)
    return (squared <= (squared.min(axis=1) + slack)[:, None]).argmax(axis=1)


def _assert_as_brute(points, targets):
    there, back = nearest_both(points, targets)
    np.testing.assert_array_equal(there, _brute(points, targets))
    np.testing.assert_array_equal(back, _brute(targets, points))
    np.testing.assert_array_equal(nearest(points, targets), there)


@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(1, 60), st.integers(1, 30))
@settings(max_examples=100)
def test_the_nearest_are_those_of_all_distances(seed, n_points, n_targets, d):
    rng = np.random.default_rng(seed)
    scales = np.exp(rng.uniform(-4, 4, d))
    _assert_as_brute(
        scales * rng.standard_normal((n_points, d)), scales * rng.standard_normal((n_targets, d))
    )


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50)
def test_of_equals_the_first_is_taken_in_both_directions(seed):
    """On a coarse grid most points have several nearest, at exactly the same distance."""
    rng = np.random.default_rng(seed)
    _assert_as_brute(*(rng.integers(-2, 3, (50, 2)).astype(float) for _ in range(2)))


def test_what_single_precision_cannot_tell_is_decided_in_double():
    """Two clusters a thousand times as far apart as the points within them."""
    rng = np.random.default_rng(0)
    clusters = np.repeat([[-1.0], [1.0]], 100, axis=0)
    points, targets = (clusters + 1e-3 * rng.standard_normal((200, 8)) for _ in range(2))
    a, b = points.astype(np.float32), targets.astype(np.float32)
    single = (np.square(b).sum(axis=1) / 2 - a @ b.T).argmin(axis=1)
    assert (single != _brute(points, targets)).any()
    _assert_as_brute(points, targets)


@pytest.mark.parametrize("scale", [1e-120, 1e-30, 1e30, 1e120])
def test_units_do_not_matter(scale):
    rng = np.random.default_rng(1)
    points, targets = rng.standard_normal((70, 5)), rng.standard_normal((90, 5))
    for one, other in zip(
        nearest_both(points, targets), nearest_both(scale * points, scale * targets), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_where_all_points_coincide_the_first_is_taken():
    there, back = nearest_both(np.full((7, 3), 2.0), np.full((5, 3), 2.0))
    assert not there.any()
    assert not back.any()


def test_threads_change_nothing():
    rng = np.random.default_rng(2)
    points, targets = rng.standard_normal((300, 6)), rng.standard_normal((200, 6))
    for one, other in zip(
        nearest_both(points, targets), nearest_both(points, targets, n_threads=3), strict=True
    ):
        np.testing.assert_array_equal(one, other)


@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(1, 70))
@settings(max_examples=50)
def test_each_sample_is_farthest_from_those_before(seed, n_points, n_samples):
    points = np.random.default_rng(seed).standard_normal((n_points, 3))
    chosen = farthest_points(points, n_samples)
    assert len(np.unique(chosen)) == len(chosen) == min(n_samples, n_points)
    assert chosen[0] == np.linalg.norm(points - points.mean(axis=0), axis=1).argmax()
    for i in range(1, len(chosen)):
        distances = np.linalg.norm(points[:, None] - points[chosen[:i]], axis=2).min(axis=1)
        assert distances[chosen[i]] >= (1 - 1e-6) * distances.max()


def test_samples_do_not_hang_on_rounding_or_numbers():
    """On a lattice many points are as far, and the first is taken; else numbers do not matter."""
    lattice = np.stack(np.meshgrid(*3 * [np.arange(5.0)]), axis=-1).reshape(-1, 3)
    expected = farthest_points(lattice, 60)
    for seed in range(5):
        noise = np.random.default_rng(seed).uniform(-1e-14, 1e-14, lattice.shape)
        np.testing.assert_array_equal(farthest_points(lattice + noise, 60), expected)
    rng = np.random.default_rng(3)
    points, order = rng.standard_normal((50, 3)), rng.permutation(50)
    np.testing.assert_array_equal(
        order[farthest_points(points[order], 20)], farthest_points(points, 20)
    )


def test_coincident_points_are_sampled_once_each():
    chosen = farthest_points(np.repeat(np.eye(3), 4, axis=0), 12)
    assert sorted(chosen) == list(range(12))


def test_samples_stand_for_the_area_of_what_is_nearest():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [4, 0, 0]])
    areas = np.array([1.0, 2, 4, 8])
    np.testing.assert_array_equal(areas_of_samples(points, areas, np.array([1, 3])), [3, 12])
