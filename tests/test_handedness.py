"""Mirrored shapes are found out, in training and after it."""

import pickle
import warnings
from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from skfmap import BridgedLearner, DescriptorTransformer, Mesh, SpectralBasis
from skfmap.datasets import make_creatures
from skfmap.exceptions import OrientationWarning
from skfmap.learner.mirrored import mirror_image
from skfmap.persistence import load_model, save_model


@pytest.fixture(scope="module")
def mirrored(collection):
    """Return the last two bodies as a scan with one axis negated has them."""
    meshes = [
        Mesh(m.vertices * [1, -1, 1], m.faces[:, ::-1], name="mirrored " + m.name)
        for m in collection.meshes[4:]
    ]
    return DescriptorTransformer().transform(SpectralBasis(30).transform(meshes))


def test_a_new_mirrored_shape_is_found_out(fitted, mirrored, probed):
    with pytest.warns(
        OrientationWarning,
        match=r"mirror images: X\[0\] \('mirrored body4'\), X\[2\] \('mirrored body5'\)\.",
    ):
        fitted.match([mirrored[0], probed[5], mirrored[1]])


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_a_mirrored_training_shape_is_found_out(make_learner, mirrored, probed, collection):
    with pytest.warns(
        OrientationWarning,
        match=r"The correspondences of X\[\d\] \('mirrored body4'\) confuse left and right",
    ):
        make_learner(max_iter=5).fit([*probed[:4], mirrored[0]], collection.truths[:5])


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.DisagreementWarning")
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_symmetric_answers_given_for_true_ones_are_found_out(
    make_learner, symmetric_probed, symmetric_collection
):
    truths = list(symmetric_collection.truths)
    truths[2] = replace(truths[2], pairs=truths[2].symmetric_pairs, symmetric_pairs=None)
    with pytest.warns(OrientationWarning, match=r"X\[2\] \('body2'\) confuse left and right"):
        make_learner(max_iter=5).fit(symmetric_probed, truths)


def test_sound_shapes_and_paper_probes_raise_no_alarm(
    make_learner, fitted, probed, mirrored, collection
):
    with warnings.catch_warnings():
        warnings.simplefilter("error", OrientationWarning)
        fitted.match(probed)
        paper = DescriptorTransformer("paper").transform(
            [shape.spectral for shape in [*probed[:3], mirrored[0]]]
        )
        make_learner(max_iter=5, tol=1e9).fit(paper, [*collection.truths[:3], collection.truths[4]])


# Of the three that are learned from none bends as far as the fourth.
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.UnfamiliarShapeWarning")
def test_a_body_that_is_its_own_mirror_image_raises_no_alarm(
    make_learner, symmetric_probed, symmetric_collection
):
    learner = make_learner(n_functions=10).fit(
        symmetric_probed[:3], symmetric_collection.truths[:3]
    )
    mesh = symmetric_collection.meshes[3]
    image = Mesh(mesh.vertices * np.array([1, -1, 1]), mesh.faces[:, ::-1])
    with warnings.catch_warnings():
        warnings.simplefilter("error", OrientationWarning)
        learner.match(DescriptorTransformer().transform(SpectralBasis(30).transform([image])))


def _mirrored(mesh):
    return Mesh(mesh.vertices * [1, 1, -1], mesh.faces[:, ::-1], name="mirrored " + mesh.name)


@pytest.fixture(scope="module")
def reflecting(make_learner, probed, collection):
    """Return a learner that reflects, fitted on shapes of one side."""
    return make_learner(on_mirrored="reflect", memory=None).fit(probed[:4], collection.truths[:4])


def test_a_mirrored_new_shape_is_matched_as_the_shape(reflecting, mirrored, probed):
    given, expected = [mirrored[0], probed[4], mirrored[1]], [probed[4], probed[4], probed[5]]
    message = r"were reflected: X\[0\] \('mirrored body4'\), X\[2\] \('mirrored body5'\)\."
    with pytest.warns(OrientationWarning, match=message) as told:
        matches = reflecting.match(given)
    assert len(told) == 1
    assert [match.name for match in matches] == ["mirrored body4", "body4", "mirrored body5"]
    for match, other in zip(matches, reflecting.match(expected), strict=True):
        np.testing.assert_array_equal(match.p2p, other.p2p)
        np.testing.assert_allclose(match.expected_error, other.expected_error, rtol=1e-3)
        assert match.familiar
    with pytest.warns(OrientationWarning, match=message):
        maps = reflecting.point_maps(given)
    for p2p, match in zip(maps, matches, strict=True):
        np.testing.assert_array_equal(p2p, match.p2p)
    with pytest.warns(OrientationWarning, match=message):
        functional_maps = reflecting.functional_maps(given)
    np.testing.assert_array_equal(functional_maps, [match.functional_map for match in matches])


def test_a_mirrored_new_shape_is_scored_as_the_shape(reflecting, mirrored, probed, collection):
    alone = reflecting.score([probed[5]], [collection.truths[5]])
    with pytest.warns(OrientationWarning, match="were reflected"):
        score = reflecting.score([mirrored[1]], [collection.truths[5]])
    np.testing.assert_allclose(score, alone, rtol=1e-6)
    warned = copy(reflecting).set_params(on_mirrored="warn")
    assert warned.score([mirrored[1]], [collection.truths[5]]) < 2 * alone, "no test otherwise"


def test_a_mirrored_training_shape_teaches_what_the_shape_teaches(
    make_learner, mirrored, probed, collection
):
    shapes = [*probed[:3], mirrored[0]]
    truths = [*collection.truths[:3], collection.truths[4]]
    learner = make_learner(on_mirrored="reflect", memory=None)
    with pytest.warns(OrientationWarning, match=r"were reflected: X\[3\] \('mirrored body4'\)\."):
        learner.fit(shapes, truths)
    alone = make_learner(memory=None).fit([*probed[:3], probed[4]], truths)
    np.testing.assert_allclose(learner.weights_, alone.weights_, rtol=0.02)  # of one search's tol
    np.testing.assert_allclose(learner.training_errors_, alone.training_errors_, rtol=0.02)
    (match,), (other,) = learner.match([probed[5]]), alone.match([probed[5]])
    np.testing.assert_array_equal(match.p2p, other.p2p)
    with pytest.warns(OrientationWarning, match="were reflected"):
        threaded = make_learner(on_mirrored="reflect", memory=None, n_jobs=2).fit(shapes, truths)
    np.testing.assert_array_equal(threaded.weights_, learner.weights_)
    with pytest.warns(OrientationWarning, match="were reflected"):
        (two,) = threaded.match([mirrored[1]])
    with pytest.warns(OrientationWarning, match="were reflected"):
        (one,) = learner.match([mirrored[1]])
    np.testing.assert_array_equal(one.p2p, two.p2p)


# Of the three that are learned from none bends as far as the fourth.
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.UnfamiliarShapeWarning")
def test_a_body_that_is_its_own_mirror_image_is_not_reflected(
    make_learner, symmetric_probed, symmetric_collection
):
    warn, reflect = (
        make_learner(n_functions=10, on_mirrored=word).fit(
            symmetric_probed[:3], symmetric_collection.truths[:3]
        )
        for word in ("warn", "reflect")
    )
    np.testing.assert_array_equal(warn.weights_, reflect.weights_)
    image = _mirrored(symmetric_collection.meshes[3])
    shapes = [
        symmetric_probed[3],
        *DescriptorTransformer().transform(SpectralBasis(30).transform([image])),
    ]
    for one, other in zip(warn.match(shapes), reflect.match(shapes), strict=True):
        np.testing.assert_array_equal(one.p2p, other.p2p)


def test_a_mirrored_shape_goes_through_a_bridge_as_the_shape(
    make_learner, mirrored, probed, collection
):
    learner = BridgedLearner(make_learner(on_mirrored="reflect"), through="mirrored body4")
    with pytest.warns(OrientationWarning, match=r"were reflected: X\[2\] \('mirrored body4'\)\."):
        learner.fit(
            [*probed[:2], mirrored[0], probed[2]], [collection.truths[i] for i in (0, 1, 4, 2)]
        )
    (expected,) = learner.match([probed[5]])
    with pytest.warns(OrientationWarning, match=r"were reflected: X\[0\]"):
        (match,) = learner.match([mirrored[1]])
    np.testing.assert_array_equal(match.p2p, expected.p2p)
    with pytest.warns(OrientationWarning, match=r"were reflected: X\[0\]"):
        (p2p,) = learner.point_maps([mirrored[1]])
    np.testing.assert_array_equal(p2p, expected.p2p)


def test_creatures_have_two_sides_that_are_alike_and_are_not_reflected(make_learner):
    creatures = make_creatures(n_shapes=4, n_vertices=500)
    shapes = DescriptorTransformer().transform(SpectralBasis(30).transform(creatures.meshes))
    warn, reflect = (
        make_learner(on_mirrored=word, confidence=None, memory=None).fit(
            shapes[:3], creatures.correspondences[:3]
        )
        for word in ("warn", "reflect")
    )
    np.testing.assert_array_equal(warn.weights_, reflect.weights_)
    np.testing.assert_array_equal(*(one.match(shapes[3:])[0].p2p for one in (warn, reflect)))


# Thinned, so small a body has other curvatures than those learned from.
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.UnfamiliarShapeWarning")
def test_a_mirrored_scan_that_is_thinned_is_answered_at_its_own_vertices(reflecting, collection):
    spectral = SpectralBasis(30, max_vertices=500).transform(collection.meshes[4:5])
    (shape,) = DescriptorTransformer().transform(spectral)
    scan = replace(mirror_image(shape), reflected=False)
    with pytest.warns(OrientationWarning, match=r"were reflected: X\[0\]"):
        (match,) = reflecting.match([scan], interpolate="barycentric")
    (expected,) = reflecting.match([shape], interpolate="barycentric")
    assert len(match.p2p) == collection.meshes[4].n_vertices > shape.spectral.mesh.n_vertices
    np.testing.assert_array_equal(match.p2p, expected.p2p)
    np.testing.assert_array_equal(match.inverse, expected.inverse)
    np.testing.assert_allclose(match.expected_error, expected.expected_error, rtol=1e-6)
    assert abs(match.matrix - expected.matrix).max() < 1e-5


def test_a_learner_that_reflects_is_saved_and_checked(reflecting, mirrored, make_learner, tmp_path):
    pytest.importorskip("skops")
    save_model(reflecting, tmp_path / "model.skops")
    again = load_model(tmp_path / "model.skops")
    assert again.on_mirrored == "reflect"
    for one in (again, pickle.loads(pickle.dumps(reflecting))):
        with pytest.warns(OrientationWarning, match="were reflected"):
            (match,) = one.match(mirrored[1:])
        with pytest.warns(OrientationWarning, match="were reflected"):
            (expected,) = reflecting.match(mirrored[1:])
        np.testing.assert_array_equal(match.p2p, expected.p2p)
    with pytest.raises(ValueError, match="on_mirrored"):
        make_learner(on_mirrored="turn").fit([], [])
