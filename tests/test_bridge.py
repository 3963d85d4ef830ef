"""Matches through a training shape that is near, and between shapes of a collection."""

import pickle

import numpy as np
import pytest
from matplotlib import pyplot as plt
from sklearn.base import clone

import skfmap
from skfmap import BridgedLearner, Correspondence
from skfmap.datasets import make_sphere
from skfmap.geometry.geodesics import exact_distances
from skfmap.learner import TrainingSet
from skfmap.learner.across import extend_pairs
from skfmap.learner.bridged import choose_bridge
from skfmap.persistence import load_model, save_model
from skfmap.plotting import (
    BasisErrorDisplay,
    ErrorCurveDisplay,
    SingularValuesDisplay,
    WeightsDisplay,
)


@pytest.fixture(scope="module")
def through(make_learner, probed, collection):
    """Return a learner that is told to go through body2."""
    return BridgedLearner(make_learner(), through="body2").fit(probed[:5], collection.truths[:5])


def test_known_pairs_are_kept_and_the_rest_lies_between_them():
    sphere = make_sphere(4)
    some = np.arange(0, sphere.n_vertices, 15)
    pairs = Correspondence(np.column_stack([some, some]))
    p2p, uncertainty, error = extend_pairs(sphere, sphere, pairs.join(pairs))
    np.testing.assert_array_equal(p2p[some], some)
    assert uncertainty[some].max() == 0
    unit = sphere.vertices / np.sqrt(sphere.area)
    off = np.diag(exact_distances(unit, sphere.faces, np.arange(100))[:, p2p[:100]])
    spacing = np.sqrt(1 / len(some))
    assert off.mean() < 0.15 * spacing
    assert error < 0.15 * spacing


def test_the_error_of_an_extension_is_known_from_landmarks_placed_by_others(collection):
    first, second = collection.truths[0], collection.truths[3]
    given, asked = (
        first.restrict(range(start, 300, 2)).join(second.restrict(range(300))) for start in (0, 1)
    )
    mesh_i, mesh_0 = collection.meshes[0], collection.meshes[3]
    p2p, uncertainty, error = extend_pairs(mesh_i, mesh_0, given)
    distances = exact_distances(
        mesh_0.vertices / np.sqrt(mesh_0.area), mesh_0.faces, asked.vertices_0
    )
    true = distances[np.arange(len(asked.vertices_0)), p2p[asked.vertices_i]]
    assert 0.3 * true.mean() < error < 3 * true.mean()
    assert 0.3 * true.mean() < uncertainty[asked.vertices_i].mean() < 3 * true.mean()


def test_pairs_are_extended_along_the_surface_and_not_through_space():
    """Two fingers, side by side: a vertex of one never goes to the other."""
    n = 40
    x = np.r_[np.linspace(0, 1, n), np.linspace(1, 0, n)]  # a strip folded back on itself
    z = np.r_[np.zeros(n), np.full(n, 0.02)]
    rows = [np.column_stack([x, np.full(2 * n, y), z]) for y in (0.0, 0.05, 0.1)]
    grid = np.arange(6 * n).reshape(3, 2 * n)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    strip = skfmap.Mesh(np.concatenate(rows), faces)
    some = grid[:, ::8].ravel()
    pairs = Correspondence(np.column_stack([some, some]))
    p2p, _, _ = extend_pairs(strip, strip, pairs.join(pairs))
    own, image = np.arange(6 * n) % (2 * n), p2p % (2 * n)
    assert np.abs(own - image).max() <= 2


def test_matches_through_a_bridge_reach_the_reference(through, make_learner, probed, collection):
    assert through.bridge_.reference_.name == "body2"
    assert through.bridge_errors_.keys() == {"direct", "bridge"}
    (match,) = through.match(probed[5:], interpolate="barycentric")
    plain = make_learner().fit(probed[:5], collection.truths[:5])
    n_0 = probed[0].spectral.mesh.n_vertices
    assert match.reference_name == "body0"
    assert match.matrix.shape == (len(match.p2p), n_0)
    np.testing.assert_allclose(match.matrix.sum(axis=1), 1)
    np.testing.assert_array_equal(match.p2p, through.point_maps(probed[5:])[0])
    np.testing.assert_array_equal(match.functional_map, plain.functional_maps(probed[5:])[0])
    (errors,) = through.pair_errors(probed[5:], collection.truths[5:])
    assert errors.mean() < 0.06
    assert -through.score(probed[5:], collection.truths[5:]) == errors.mean()
    assert (match.expected_error >= through.bridge_.match(probed[5:])[0].expected_error).all()


def test_a_bridge_is_dropped_where_it_does_not_pay(make_learner, probed, collection):
    learner = BridgedLearner(make_learner()).fit(probed[:5], collection.truths[:5])
    direct, bridge = (learner.bridge_errors_[way] for way in ("direct", "bridge"))
    assert bridge > 0.9 * direct, "these bodies are alike: a detour can only lose"
    assert learner.bridge_ is None
    plain = make_learner().fit(probed[:5], collection.truths[:5])
    np.testing.assert_array_equal(learner.match(probed[5:])[0].p2p, plain.match(probed[5:])[0].p2p)
    np.testing.assert_array_equal(
        learner.point_maps(probed[5:])[0], plain.point_maps(probed[5:])[0]
    )
    assert learner.score(probed[5:], collection.truths[5:]) == plain.score(
        probed[5:], collection.truths[5:]
    )


def test_a_reference_unlike_the_rest_is_reached_through_a_bridge(make_learner, probe, collection):
    """The reference is a ball, the others are bodies: their known maps are far from isometries."""
    ball = collection.meshes[0]
    radius = np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    directions = ball.vertices / radius
    stretched = skfmap.Mesh(
        directions * (1 + 0.9 * directions[:, :1] ** 3) * [1, 0.5, 2.0], ball.faces, name="odd"
    )
    shapes = probe([stretched, *collection.meshes[1:5]])
    learner = BridgedLearner(make_learner()).fit(shapes, collection.truths[:5])
    assert learner.bridge_errors_["bridge"] < learner.bridge_errors_["direct"]


def test_the_bridge_is_the_shape_that_leaves_least(probed, collection):
    truths = collection.truths[:5]
    training = TrainingSet.from_samples(probed[:5], truths, n_functions=12)
    bridge = choose_bridge(training)
    # Twisted by 0.1 and -0.1; the others by 0.15 and -0.15.
    assert training.shapes[bridge].name in {"body1", "body2"}
    assert choose_bridge(TrainingSet.from_samples(probed[:3], truths[:3], n_functions=12)) is None


@pytest.mark.parametrize("name", ["body0", "nobody"])
def test_a_bridge_must_be_a_training_shape(make_learner, probed, collection, name):
    learner = make_learner(max_iter=3, tol=1e9, confidence=None)
    with pytest.raises(ValueError, match=r"through=.* must name exactly one training shape"):
        BridgedLearner(learner, through=name).fit(probed[:4], collection.truths[:4])


def test_a_bridge_is_not_chosen_without_expected_errors(make_learner, probed, collection):
    with pytest.raises(
        ValueError, match=r"compares expected errors.*confidence='cross-fit', or name"
    ):
        BridgedLearner(make_learner(confidence=None)).fit(probed[:4], collection.truths[:4])
    named = BridgedLearner(make_learner(confidence=None), through="body2").fit(
        probed[:4], collection.truths[:4]
    )
    (match,) = named.match(probed[5:])
    assert match.expected_error is None
    assert match.familiar is None
    assert named.bridge_errors_ == {}


def test_a_bridged_learner_takes_a_learner(probed, collection):
    with pytest.raises(
        TypeError, match=r"estimator must be a WeightedFunctionalMapLearner.*got str"
    ):
        BridgedLearner("learner").fit(probed[:4], collection.truths[:4])


def test_a_learner_with_a_bridge_is_saved_and_cloned(through, probed, tmp_path):
    again = pickle.loads(pickle.dumps(through))
    np.testing.assert_array_equal(again.match(probed[5:])[0].p2p, through.match(probed[5:])[0].p2p)
    assert clone(through).through == "body2"


def test_any_shape_maps_to_any_other_of_the_collection(fitted, probed, collection):
    first, second = fitted.match(probed[4:])
    p2p, expected = first.to(second)
    assert p2p.shape == first.p2p.shape
    assert p2p.max() < probed[5].spectral.mesh.n_vertices
    assert (expected >= first.expected_error).all()
    joined = collection.truths[4].join(collection.truths[5])
    vertices = probed[5].spectral.vertices
    off = np.linalg.norm(vertices[p2p[joined.vertices_i]] - vertices[joined.vertices_0], axis=1)
    assert off.mean() < 0.06


def test_shapes_matched_to_unequal_references_do_not_compose(fitted, through, probed):
    (first,) = fitted.match(probed[5:])
    (second,) = through.bridge_.match(probed[5:])
    with pytest.raises(ValueError, match="matched to the same reference"):
        first.to(second)


def test_a_learner_with_a_bridge_is_saved_in_a_safe_file(through, probed, tmp_path):
    pytest.importorskip("skops")
    save_model(through, tmp_path / "through.skops")
    again = load_model(tmp_path / "through.skops")
    np.testing.assert_array_equal(again.match(probed[5:])[0].p2p, through.match(probed[5:])[0].p2p)


def test_neither_maps_nor_expected_errors_depend_on_n_jobs(make_learner, probed, collection):
    one, two = (
        make_learner(n_functions=8, refine="bijective-zoomout", n_jobs=n_jobs).fit(
            probed[:4], collection.truths[:4]
        )
        for n_jobs in (1, 2)
    )
    for first, second in zip(one.match(probed[4:]), two.match(probed[4:]), strict=True):
        np.testing.assert_array_equal(first.p2p, second.p2p)
        np.testing.assert_array_equal(first.expected_error, second.expected_error)


def test_displays_take_a_bridged_learner(through, probed, collection):
    X, y = probed[5:], collection.truths[5:]
    assert WeightsDisplay.from_estimator(through).figure_ is not None
    for display in (SingularValuesDisplay, BasisErrorDisplay, ErrorCurveDisplay):
        assert display.from_estimator(through, X, y).figure_ is not None
    plt.close("all")
    assert through.n_stable_ == 6
    assert through.training_errors_.shape == (5,)
    with pytest.raises(AttributeError, match="has no attribute 'nothing_'"):
        _ = through.nothing_
