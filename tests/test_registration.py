"""The reference laid onto new shapes, from the refinement to the meshes, on small bodies."""

import copy
import pickle
import re
import warnings
import weakref

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import (
    BridgedLearner,
    Correspondence,
    DescriptorTransformer,
    Mesh,
    SpectralBasis,
    WeightedFunctionalMapLearner,
)
from skfmap._tools.part import Part
from skfmap.datasets import make_creatures
from skfmap.exceptions import (
    MeshError,
    OrientationWarning,
    RepairWarning,
    SkippedShapeWarning,
    UnfamiliarShapeWarning,
)
from skfmap.geometry.closest import ClosestPoints, face_normals
from skfmap.geometry.normals import vertex_normals
from skfmap.geometry.sphere import subdivided_octahedron
from skfmap.learner import laid_out
from skfmap.learner.given_answers import given_reference
from skfmap.persistence import load_model, save_model
from skfmap.refinement import BijectiveZoomOut, ZoomOut, match_points
from skfmap.registration import Deformation, Limits, Quality, Registration, part
from skfmap.registration.alignment import nearest_poses, principal_axes

GIVEN = {"n_functions": 20, "tol": 1e-2}


def learner_that(registration="register", **parameters):
    return WeightedFunctionalMapLearner(refine=registration, **{**GIVEN, **parameters})


def probed_of(meshes, **how):
    shapes = SpectralBasis(40, **how).transform(meshes)
    return DescriptorTransformer().transform(shapes)


def distance_to(mesh, points):
    return ClosestPoints(mesh.vertices, mesh.faces).of(points).distances


def edge_of(mesh):
    a, b = mesh.vertices[mesh.faces[:, 0]], mesh.vertices[mesh.faces[:, 1]]
    return np.linalg.norm(a - b, axis=1).mean()


def error_of(learner, shapes, truths, **how):
    return np.mean([one.mean("direct") for one in learner.pair_errors(shapes, truths, **how)])


@pytest.fixture(scope="module")
def creatures():
    """Return six creatures, in poses but for the first, and their probed shapes."""
    made = make_creatures(6, 500, n_points=500)
    return made.meshes, made.correspondences, probed_of(made.meshes)


@pytest.fixture(scope="module")
def taught(creatures):
    """Return a learner fitted on all creatures but the last; do not fit it again or change it."""
    _, truths, shapes = creatures
    return learner_that().fit(shapes[:5], truths[:5])


@pytest.fixture(scope="module")
def laid(taught, creatures):
    """Return the reference on the creature that was left out."""
    (one,) = taught.register(creatures[2][5:])
    return one


# What it is for


def test_it_is_no_worse_than_what_it_begins_with(taught, creatures):
    _, truths, shapes = creatures
    start = taught.refine_.start_
    assert isinstance(start, BijectiveZoomOut)
    before = error_of(taught, shapes[5:], truths[5:], refine="bijective-zoomout")
    after = error_of(taught, shapes[5:], truths[5:])
    assert after < 0.97 * before
    assert after == -taught.score(shapes[5:], truths[5:])


def test_registered_vertices_lie_on_the_shape_where_they_belong(laid, creatures):
    meshes, truths, _ = creatures
    assert laid.vertices.shape == meshes[0].vertices.shape
    np.testing.assert_array_equal(laid.faces, meshes[0].faces)
    np.testing.assert_allclose(laid.distance, distance_to(meshes[5], laid.vertices), atol=1e-9)
    assert np.median(laid.distance) < 0.1 * edge_of(meshes[5])
    assert laid.n_flipped == 0
    # Where known pairs put the reference's vertices, which the learner never saw for this shape.
    answers = [dict(map(tuple, np.asarray(truth.pairs)[:, ::-1])) for truth in truths]
    both = sorted(answers[0].keys() & answers[5].keys())
    there = meshes[5].vertices[[answers[5][point] for point in both]]
    off = np.linalg.norm(laid.vertices[[answers[0][point] for point in both]] - there, axis=1)
    assert np.median(off) < 1.5 * edge_of(meshes[5])


def test_folds_are_taken_out_and_those_that_are_left_counted(taught, laid, creatures, monkeypatch):
    faces, drawn = taught.reference_.spectral.mesh.faces, part._drawn

    def folded(*given):
        vertices = drawn(*given)
        face = faces[300]
        vertices[face[0]] += 1.3 * (vertices[face[1:]].mean(axis=0) - vertices[face[0]])
        return vertices

    monkeypatch.setattr(part, "_drawn", folded)
    (mended,) = taught.register(creatures[2][5:])
    assert mended.n_flipped == 0
    monkeypatch.setattr(part, "unfold", lambda deformation, faces, vertices: vertices)
    (left,) = taught.register(creatures[2][5:])
    assert left.n_flipped == 1
    monkeypatch.setattr(part, "_drawn", drawn)
    (smooth,) = taught.register(creatures[2][5:])
    moved = np.linalg.norm(left.vertices - smooth.vertices, axis=1) > 0
    np.testing.assert_array_equal(np.flatnonzero(moved), [faces[300, 0]])
    assert np.abs(mended.vertices - laid.vertices).max() < edge_of(creatures[0][5])


def test_the_answer_says_what_it_is(laid, creatures):
    assert (laid.name, laid.reference_name) == ("cat5", "cat0")
    assert repr(laid).startswith("Registered('cat0' on 'cat5', fits=True, n_flipped=0, off=0.00")
    assert isinstance(laid.mesh, Mesh)
    assert laid.mesh.name == "cat5"
    np.testing.assert_array_equal(laid.mesh.vertices, laid.vertices)
    assert laid.fits
    assert max(laid.off, laid.uncovered, laid.stretched) < 0.05


def test_points_are_the_nearest_in_space_and_by_normals(taught, creatures):
    """By brute force over positions and scaled normals of both meshes; both ways."""
    _, _, shapes = creatures
    reference, new = taught.reference_.spectral, shapes[5].spectral
    before, after = taught.matcher_.match_points(shapes[5], taught.matcher_.solve(shapes[5]).C)
    vertices_0 = taught.refine_.vertices_on(taught.matcher_, new, before)
    edges = 4 * np.sqrt(2 / len(vertices_0)) / 2
    points_0, points = (
        np.hstack([vertices, edges * vertex_normals(vertices, faces)])
        for vertices, faces in ((vertices_0, reference.mesh.faces), (new.vertices, new.mesh.faces))
    )
    apart = np.linalg.norm(points[:, None] - points_0[None], axis=2)
    np.testing.assert_array_equal(after.p2p, apart.argmin(axis=1))
    np.testing.assert_array_equal(after.inverse, apart.argmin(axis=0))
    (match,) = taught.match(shapes[5:])
    np.testing.assert_array_equal(match.p2p, after.p2p)
    np.testing.assert_array_equal(match.inverse, after.inverse)
    assert match.refined_map is not None


def test_the_inverse_is_next_to_each_registered_vertex(taught, laid, creatures):
    meshes, _, shapes = creatures
    (match,) = taught.match(shapes[5:])
    away = np.linalg.norm(meshes[5].vertices[match.inverse] - laid.vertices, axis=1)
    nearest, _ = cKDTree(meshes[5].vertices).query(laid.vertices)
    assert (away < nearest + 1e-9).mean() > 0.6, "but where normals tell otherwise"
    assert away.mean() < 1.3 * nearest.mean()
    assert away.max() < nearest.max() + 2 * edge_of(meshes[5])


# Invariances


def test_the_answer_turns_with_the_shape_and_knows_no_numbers(taught, laid, creatures):
    meshes, _, _ = creatures
    rng, new = np.random.default_rng(0), meshes[5]
    order = rng.permutation(new.n_vertices)
    turn, shift = Rotation.random(random_state=1).as_matrix(), np.array([3.0, -2, 9])
    renumbered = Mesh(
        3 * new.vertices[order] @ turn.T + shift,
        rng.permutation(np.argsort(order)[new.faces]),
        "other",
    )
    (other,) = taught.register(probed_of([renumbered]))
    expected = 3 * laid.vertices @ turn.T + shift
    assert np.linalg.norm(other.vertices - expected, axis=1).max() < 1e-3 * 3 * edge_of(new)
    np.testing.assert_allclose(other.distance, 3 * laid.distance, atol=1e-3 * edge_of(new))


@pytest.mark.parametrize("registration", [Registration(stiffness=0.3)])
def test_the_number_of_jobs_changes_nothing(registration, creatures):
    _, truths, shapes = creatures
    one, two = (
        learner_that(registration, n_jobs=n_jobs).fit(shapes[:3], truths[:3]) for n_jobs in (1, 2)
    )
    np.testing.assert_array_equal(one.refine_.deformation_.modes, two.refine_.deformation_.modes)
    first, second = one.register(shapes[4:]), two.register(shapes[4:])
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.vertices, b.vertices)
    for a, b in zip(one.match(shapes[4:]), two.match(shapes[4:]), strict=True):
        np.testing.assert_array_equal(a.expected_error, b.expected_error)


def test_what_was_fitted_before_changes_nothing(creatures):
    """Not the same shapes with other pairs, nor with other matches."""
    _, truths, shapes = creatures
    registration = Registration("zoomout", stiffness=0.3)
    pairs = np.asarray(truths[0].pairs)
    swapped = Correspondence(np.column_stack([pairs[:, 0], pairs[::-1, 1]]))
    fresh = copy.deepcopy(shapes[:3])
    for given, n_functions in (([swapped, *truths[1:3]], 20), (truths[:3], 10)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what is wrong on purpose
            learner_that(registration, n_functions=n_functions, confidence=None).fit(
                shapes[:3], given
            )
    after, alone = (
        learner_that(registration, confidence=None).fit(given, truths[:3])
        for given in (shapes[:3], fresh)
    )
    np.testing.assert_array_equal(
        after.refine_.deformation_.mean.vectors, alone.refine_.deformation_.mean.vectors
    )


@pytest.mark.parametrize("how", ["pickle", "skops"])
def test_a_saved_model_lays_the_same(how, taught, laid, creatures, tmp_path):
    if how == "skops":
        pytest.importorskip("skops")
        save_model(taught, tmp_path / "model.skops")
        again = load_model(tmp_path / "model.skops")
    else:
        again = pickle.loads(pickle.dumps(taught))
    (other,) = again.register(creatures[2][5:])
    np.testing.assert_array_equal(other.vertices, laid.vertices)
    assert (other.fits, other.stretched) == (laid.fits, laid.stretched)
    one, two = (model.match(creatures[2][5:])[0] for model in (taught, again))
    np.testing.assert_array_equal(one.p2p, two.p2p)
    np.testing.assert_array_equal(one.expected_error, two.expected_error)


def test_a_saved_model_holds_no_training_shape(taught, creatures):
    saved = pickle.dumps(taught)
    meshes, _, shapes = creatures
    assert meshes[0].vertices.tobytes() in saved
    for mesh, shape in zip(meshes[1:5], shapes[1:5], strict=True):
        assert mesh.vertices.tobytes() not in saved
        assert shape.spectral.vertices.tobytes() not in saved


# The part


def test_the_word_stands_for_the_object_and_parameters_are_set(taught):
    assert taught.refine == "register"
    assert taught.refine_.get_params() == Registration().get_params()
    learner = learner_that(Registration(pose="free", stiffness=3.0))
    assert clone(learner).refine is not learner.refine
    assert clone(learner).get_params()["refine__stiffness"] == 3.0
    learner.set_params(refine__deformation="as-rigid-as-possible", refine__start=ZoomOut())
    assert learner.set_params(refine__start__step=7).refine.start.step == 7
    assert repr(learner.refine).startswith("Registration(deformation='as-rigid-as-possible'")
    with pytest.raises(ValueError, match=r"refine is 'register'.*refine=Registration\(\)"):
        learner_that().set_params(refine__stiffness=1.0)


def test_a_part_of_a_fold_is_a_fitted_clone():
    class Counting(Part):
        def __init__(self, start=3):
            self.start = start

        def fit(self, training, matcher):
            self.n_ = self.start + training + matcher

    whole = Counting(start=5)
    whole.fit(1, 1)
    of_fold = whole.fit_fold(10, 20)
    assert of_fold is not whole
    assert (whole.n_, of_fold.n_) == (7, 35)


def test_folds_keep_what_all_shapes_chose(creatures, monkeypatch):
    """But deformations, which are learned without the shapes that were left out."""
    _, truths, shapes = creatures
    fits, folds, chosen_by = [], [], []
    fit, fit_fold, validated = Registration.fit, Registration.fit_fold, part._validated

    def fit_and_tell(self, *data):
        fits.append(fit(self, *data))
        self.limits_ = self.limits_.with_usual([Quality(0.1, 0.2, 0.3, 0.0)])
        return self

    def fit_fold_and_tell(self, *data):
        folds.append(fit_fold(self, *data))
        return folds[-1]

    def validated_and_told(deformation, *data):
        chosen_by.append(len(deformation.deviations))
        return validated(deformation, *data)

    monkeypatch.setattr(Registration, "fit", fit_and_tell)
    monkeypatch.setattr(Registration, "fit_fold", fit_fold_and_tell)
    monkeypatch.setattr(part, "_validated", validated_and_told)
    learner = learner_that(confidence=skfmap.learner.CrossFitConfidence(cv=2))
    learner.fit(shapes[:4], truths[:4])
    assert [len(fits), len(folds)] == [1, 2]
    assert chosen_by == [2, 2, 2], "once, and on shapes that the deformation was not learned from"
    whole = learner.refine_
    assert whole is fits[0]
    assert set(learner.error_models_) == {"unrefined", "refined"}
    assert len(whole.deformation_.deviations) == 3
    for fold in folds:
        assert fold.stiffness_ == whole.stiffness_ == min(whole.choices_, key=whole.choices_.get)
        assert (fold.pose_, fold.limits_.usual) == (whole.pose_, whole.limits_.usual)
        assert len(fold.deformation_.deviations) < 3, "without the shapes that were left out"


def test_training_shapes_are_laid_by_their_known_pairs(taught, creatures):
    """Which are met far better than the match meets them."""
    _, truths, shapes = creatures
    training = skfmap.learner.TrainingSet.from_samples(shapes[:3], truths[:3], n_functions=20)
    (sample, other) = part._samples(training, taught.matcher_, None, "free")
    reference = taught.reference_.spectral

    def off(vertices):
        return np.linalg.norm(sample.pairs.places @ vertices - sample.pairs.points, axis=1)

    laid = part._lay_by_pairs(reference, sample)
    matched = sample.spectral.vertices[sample.match.inverse]
    assert off(laid).mean() < 0.5 * off(matched).mean()
    width = np.sqrt(2 / len(laid))
    assert np.median(off(laid)) < 0.5 * width, "half an edge"
    assert not np.array_equal(laid, part._lay_by_pairs(reference, other))


def test_expected_errors_are_of_the_size_of_the_errors(taught, creatures):
    _, truths, shapes = creatures
    (match,) = taught.match(shapes[5:])
    assert match.expected_error.shape == (shapes[5].spectral.mesh.n_vertices,)
    assert (match.expected_error > 0).all()
    error = -taught.score(shapes[5:], truths[5:])
    assert 0.6 * error < match.expected_error.mean() < 1.6 * error
    (before,) = taught.match(shapes[5:], refine=None)
    assert match.expected_error.mean() < before.expected_error.mean()


def test_a_given_stiffness_is_kept(creatures):
    _, truths, shapes = creatures
    learner = learner_that(Registration(None, stiffness=3), confidence=None)
    learner.fit(shapes[:3], truths[:3])
    found = learner.refine_
    assert (found.stiffness_, [*found.choices_], found.start_) == (3.0, [3.0], None)
    assert np.median(learner.register(shapes[5:])[0].distance) < edge_of(creatures[0][5])


def test_stiffness_keeps_the_mesh_from_being_stretched(creatures):
    _, truths, shapes = creatures
    strains = []
    for stiffness in (100.0, 0.01):
        registration = Registration(stiffness=stiffness, deformation="as-rigid-as-possible")
        learner = learner_that(registration, confidence=None).fit(shapes[:3], truths[:3])
        found, matcher = learner.refine_, learner.matcher_
        assert found.deformation_.modes.shape[0] == 0, "nothing was learned of shapes"
        before, _ = matcher.match_points(shapes[5], matcher.solve(shapes[5]).C)
        vertices = found.vertices_on(matcher, shapes[5].spectral, before)
        strains.append(found.deformation_.mean.strains(vertices).mean())
    assert strains[0] < 0.8 * strains[1]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"start": "register"}, "start must be one of 'bijective-zoomout', 'icp', 'zoomout'"),
        ({"start": ZoomOut(step=0)}, "step must be an integer at least 1"),
        ({"deformation": "soft"}, "deformation must be one of 'as-rigid-as-possible', 'learned'"),
        ({"pose": "alike"}, "pose must be one of 'auto', 'free', 'similarity'"),
        ({"stiffness": "high"}, "stiffness must be .*'auto'"),
        ({"stiffness": 0}, "stiffness must be .*above 0"),
        ({"stiffness": -1.0}, "stiffness must be .*above 0"),
        ({"stiffness": float("nan")}, "stiffness must be"),
        ({"stiffness": True}, "stiffness must be"),
        ({"stiffness": None}, "stiffness must be"),
    ],
)
def test_parameters_that_cannot_be_used_are_refused(wrong, told, creatures, monkeypatch):
    """Before anything is learned."""
    _, truths, shapes = creatures
    monkeypatch.setattr(skfmap.learner.TrainingSet, "learn", lambda self, **how: 1 / 0)
    with pytest.raises((ValueError, TypeError), match=told):
        learner_that(Registration(**wrong)).fit(shapes[:3], truths[:3])


# What asks for it


def test_a_model_with_another_refinement_says_so(fitted, probed):
    told = r"register needs a learner that was fitted with refine='register'; here refine is None"
    for ask in (fitted.register, lambda X: skfmap.register(fitted, X)):
        with pytest.raises(ValueError, match=told):
            ask(probed[5:])


def test_a_refinement_that_was_set_after_the_fit_says_so(fitted, probed):
    changed = copy.copy(fitted).set_params(refine="register")
    with pytest.raises(ValueError, match=r"refine is 'register' since the fit\. Fit again\."):
        changed.register(probed[5:])


def test_a_bridge_lays_no_meshes(creatures):
    _, truths, shapes = creatures
    bridged = BridgedLearner(WeightedFunctionalMapLearner(**GIVEN, refine=None), shapes[1].name)
    bridged.fit(shapes[:4], truths[:4])
    with pytest.raises(TypeError, match="BridgedLearner cannot lay meshes onto shapes; fit its"):
        skfmap.register(bridged, shapes[5:])


def test_any_model_lays_from_meshes(taught, laid, creatures):
    model = make_pipeline(SpectralBasis(40), DescriptorTransformer(), taught)
    (other,) = skfmap.register(model, creatures[0][5:])
    np.testing.assert_array_equal(other.vertices, laid.vertices)


def test_it_refines_only_where_it_was_fitted(fitted, probed):
    with pytest.raises(ValueError, match="Registration"):
        fitted.match(probed[5:], refine="register")


# Shapes that stand alike


@pytest.fixture(scope="module")
def copies():
    """Return five copies of a body, rigidly moved, with a little noise, and their answers."""
    rng = np.random.default_rng(0)
    vertices, faces = subdivided_octahedron(3)
    bumps = np.array([[1, 0.2, 0.1], [-0.4, 0.9, 0.2], [0.1, -0.3, -1]])
    bumps /= np.linalg.norm(bumps, axis=1, keepdims=True)
    radius = 1 + (np.array([0.8, 0.5, 0.3]) * np.exp(6 * (vertices @ bumps.T - 1))).sum(axis=1)
    body = vertices * radius[:, None] * [1.3, 1.0, 0.8]
    meshes = [
        Mesh(
            (1 + 0.2 * seed) * (body + 0.01 * rng.normal(size=body.shape)) @ turn.T + seed,
            faces,
            f"copy{seed}",
        )
        for seed, turn in enumerate(Rotation.random(5, random_state=4).as_matrix())
    ]
    return meshes, [Correspondence.from_vertices(np.arange(len(body)))] * 5


@pytest.fixture(scope="module")
def stiff(copies):
    """Return a learner that was taught by four of the copies, and the fifth."""
    meshes, truths = copies
    shapes = SpectralBasis(30).transform(meshes)
    shapes = DescriptorTransformer().transform(shapes)
    learner = learner_that(n_functions=15, confidence=None).fit(shapes[:4], truths[:4])
    return learner, shapes[4]


def test_a_similarity_is_found_to_explain_copies_and_not_poses(stiff, taught):
    assert stiff[0].refine_.pose_ == "similarity"
    assert taught.refine_.pose_ == "free"


def test_stiff_shapes_are_laid_within_their_noise(stiff, copies):
    learner, shape = stiff
    (one,) = learner.register([shape])
    off = np.linalg.norm(one.vertices - copies[0][4].vertices, axis=1)
    assert np.sqrt(np.square(off).mean()) < 0.04 * 1.8, "noise of 0.01 in three coordinates, twice"
    assert one.fits


def test_stiff_shapes_are_found_whatever_the_match_says(stiff, copies):
    """Space tells where to begin: with a match that is nonsense, all is the same."""
    learner, shape = stiff
    found = copy.copy(learner.refine_)
    found.start_ = None
    matcher = learner.matcher_
    match, _ = matcher.match_points(shape, matcher.solve(shape).C)
    rng = np.random.default_rng(1)
    nonsense = match._replace(
        p2p=rng.permutation(match.p2p), inverse=rng.permutation(match.inverse)
    )
    laid, blind = (found.vertices_on(matcher, shape.spectral, one) for one in (match, nonsense))
    # Of two starts that differ by a little, two ends: some hundredths of an edge apart.
    np.testing.assert_allclose(blind, laid, atol=3e-3)


@pytest.mark.parametrize("max_vertices", [6000, 200])
def test_the_mirror_image_of_a_shape_is_laid_onto_the_given_mesh(copies, max_vertices):
    meshes, truths = copies
    image = Mesh(meshes[4].vertices * [1, -1, 1], meshes[4].faces[:, ::-1], "image")
    basis = SpectralBasis(30, max_vertices=max_vertices)
    shapes = DescriptorTransformer().transform(basis.transform([*meshes[:4], image]))
    assert (shapes[4].spectral.mesh.n_vertices < image.n_vertices) == (max_vertices == 200)
    learner = learner_that(n_functions=15, confidence=None, on_mirrored="reflect")
    learner.fit(shapes[:4], truths[:4])
    with pytest.warns(OrientationWarning, match="image"):
        (one,) = learner.register(shapes[4:])
    assert np.linalg.norm(one.vertices - image.vertices, axis=1).max() < 0.2
    np.testing.assert_allclose(one.distance, distance_to(image, one.vertices), atol=1e-9)
    np.testing.assert_array_equal(one.faces, meshes[0].faces)
    outward = np.einsum(
        "na,na->n", face_normals(one.vertices, one.faces), face_normals(*_arrays(image))
    )
    assert outward.mean() < -0.9, "faces of the reference point inwards there"
    assert one.fits
    assert one.n_flipped == 0


def _arrays(mesh):
    """Return vertices, and faces in the order in which the copies have them."""
    return mesh.vertices, mesh.faces[:, ::-1][:, [0, 2, 1]]


# Shapes that the reference does not fit


def test_another_kind_of_body_is_told_and_does_not_fit(taught):
    vertices, faces = subdivided_octahedron(3)
    blob = Mesh(vertices * [1.5, 1, 0.7] + 0.1 * vertices**2, faces, "blob")
    with pytest.warns(UnfamiliarShapeWarning, match=r"does not fit.*X\[0\] \('blob'\) \(.*%"):
        (one,) = taught.register(probed_of([blob]))
    assert not one.fits
    assert max(one.off, one.uncovered, one.stretched) > 0.05


def test_a_creature_that_was_cut_in_half_is_told(taught, creatures):
    whole = creatures[0][5]
    front = whole.vertices[:, 0] > np.median(whole.vertices[:, 0])
    kept = whole.faces[front[whole.faces].all(axis=1)]
    used, faces = np.unique(kept, return_inverse=True)
    half = Mesh(whole.vertices[used], faces.reshape(-1, 3), "half")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        half_shape, whole_shape = probed_of([half])[0], creatures[2][5]
        one, sound = taught.register([half_shape, whole_shape])
    (message,) = (str(w.message) for w in told if w.category is UnfamiliarShapeWarning)
    assert "X[0] ('half')" in message
    assert "cat5" not in message
    assert not one.fits
    assert sound.fits


@pytest.mark.parametrize("confidence", ["cross-fit", None])
def test_a_match_through_a_mesh_that_does_not_fit_is_told_once(confidence, taught, creatures):
    """With the numbers that `register` tells; plain matches of it do not know."""
    learner = copy.copy(taught)
    if confidence is None:
        learner.confidence_ = None
    vertices, faces = subdivided_octahedron(3)
    blob = Mesh(vertices * [1.5, 1, 0.7] + 0.1 * vertices**2, faces, "blob")
    shapes = [*probed_of([blob]), creatures[2][5]]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        learner.register(shapes)
        strange, usual = learner.match(shapes)
    of_meshes, of_matches = (str(w.message) for w in told)
    assert {w.category for w in told} == {UnfamiliarShapeWarning}
    shares = re.search(r"X\[0\] \('blob'\) \(.*stretched\)", of_meshes).group()
    assert shares in of_matches
    assert "Do not use their registered meshes" in of_meshes
    assert "Do not trust their matches" in of_matches
    assert "cat5" not in of_matches
    assert (strange.familiar, usual.familiar) == (False, True)
    assert repr(strange).endswith("unlike the training shapes)")
    if confidence is None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            (plain, _) = learner.match(shapes, refine="bijective-zoomout")
        assert plain.familiar is None


def test_limits_are_three_times_the_usual_and_five_percent_at_least():
    seen = [
        Quality(0.0, 0.04, 0.01, 0.0),
        Quality(0.0, 0.9, 0.03, 0.0),
        Quality(0.0, 0.02, 0.03, 0.0),
    ]
    limits = Limits(0.5, Quality(0.0, 0.0, 0.0, 0.0)).with_usual(seen)
    assert limits.usual == Quality(0.0, 0.04, 0.03, 0.0)
    assert not limits.with_usual([Quality(0.5, 0.5, 0.5, 0.0)]).allow(Quality(0.21, 0, 0, 0.0))
    assert limits.allow(Quality(0.05, 0.12, 0.09, 0.0))
    for wrong in (Quality(0.051, 0, 0, 0.0), Quality(0, 0.121, 0, 0.0), Quality(0, 0, 0.091, 0.0)):
        assert not limits.allow(wrong)


def test_qualities_in_closed_form():
    """A sphere on one that is moved away, and on a larger one."""
    vertices, faces = subdivided_octahedron(3)
    rest, areas = Deformation.of_reference(vertices, faces), np.ones(len(vertices))
    assert Limits.shown_by(rest, [1.01 * vertices]).strain == 0.1
    limits = Limits.shown_by(rest, [1.15 * vertices])
    assert limits.strain == pytest.approx(np.log(1.15))

    def quality(laid, onto):
        found = skfmap.registration.quality.assess(
            rest, limits, (laid, faces, areas), (onto, faces, areas)
        )
        return tuple(found)

    energy = rest.mean.weights @ np.square(rest.mean.vectors).sum(axis=1)
    assert quality(vertices, vertices) == pytest.approx((0, 0, 0, 0))
    assert quality(1.05 * vertices, vertices) == pytest.approx((0, 0, 0, 0.05**2 * energy))
    assert quality(1.2 * vertices, 1.2 * vertices) == pytest.approx((0, 0, 1, 0.2**2 * energy))
    assert quality(vertices, vertices + np.array([9, 0, 0])) == pytest.approx((1, 1, 0, 0))


def test_a_misfit_is_one_where_a_reference_lies_as_usual():
    usual = Quality(0.04, 0.06, 0.01, 0.03)
    limits = Limits(0.5, usual)
    assert limits.misfit(usual) == pytest.approx(1.0)
    assert limits.doubt(usual._replace(energy=0.09)) == pytest.approx(2.0)
    assert limits.doubt(usual._replace(stretched=0.9)) == pytest.approx(1.0)
    # What does not fit is in doubt whatever its misfit.
    assert limits.doubt(usual._replace(uncovered=0.4)) == np.inf
    # Kinds that hardly vary: nothing is doubtful that is off by less than a few in a hundred.
    still = Limits(0.5, Quality(0.0, 0.0, 0.0, 0.0))
    assert still.doubt(Quality(0.02, 0.02, 0.0, 0.01)) < 1.5


class Scrambled(BijectiveZoomOut):
    """A start that puts the vertices of the reference at the other end at first."""

    def refine(self, learned, spectral, match):
        found = super().refine(learned, spectral, match)
        if match.points_i.shape[1] == 6:  # a match in space, which a registration has led to
            return found
        order = np.argsort(spectral.vertices[:, 2])
        opposite = np.empty_like(order)
        opposite[order] = order[::-1]
        return found._replace(inverse=opposite[found.inverse])


def test_other_starts_are_tried_where_the_first_does_not_fit(creatures, monkeypatch):
    _, truths, shapes = creatures
    learner = learner_that(Registration(Scrambled(), stiffness=0.3), confidence=None)
    learner.fit(shapes[:5], truths[:5])
    monkeypatch.setattr(Limits, "doubt", lambda *_: 0.0)  # nothing else is tried then
    with pytest.warns(UnfamiliarShapeWarning, match="does not fit"):
        with_one = learner.register(shapes[5:])[0]
    monkeypatch.undo()
    assert with_one.off + with_one.uncovered > 0.3
    (laid,) = learner.register(shapes[5:])
    plain = learner_that(Registration(stiffness=0.3), confidence=None).fit(shapes[:5], truths[:5])
    (wanted,) = plain.register(shapes[5:])
    assert laid.fits
    assert laid.off + laid.uncovered <= wanted.off + wanted.uncovered + 0.05


def test_poses_are_found_however_they_are_turned(taught, creatures):
    """Each lies nearest to a turned, moved and larger copy of itself."""
    spectral_0 = creatures[2][0].spectral
    faces, areas, poses = spectral_0.mesh.faces, spectral_0.mass, taught.refine_.poses_
    assert poses.shape == (4, *spectral_0.vertices.shape)
    for number, pose in enumerate(poses):
        turn = Rotation.random(random_state=number).as_matrix()
        there = 1.1 * pose @ turn.T + [3.0, -1.0, 2.0]
        frame = principal_axes(there, areas)
        found = nearest_poses(poses, faces, ClosestPoints(there, faces), frame, areas, 4)
        assert len(found) == 4
        assert np.linalg.norm(found[0] - there, axis=1).mean() < 0.01


def test_where_a_match_is_wrong_everywhere_a_pose_is_the_start(creatures, monkeypatch):
    """One end of the body is matched to the other, and no other refinement mends it."""
    _, truths, shapes = creatures
    learner = learner_that(Registration(None, stiffness=0.3), confidence=None)
    learner.fit(shapes[:5], truths[:5])
    registration, matcher, spectral = learner.refine_, learner.matcher_, shapes[5].spectral
    spectral_0, C = matcher.reference.spectral, matcher.solve(shapes[5]).C
    right = match_points(spectral, spectral_0, C, matcher.functions)
    order, opposite = np.argsort(spectral.vertices[:, 2]), np.empty(len(spectral.mass), dtype=int)
    opposite[order] = order[::-1]
    wrong = right._replace(inverse=opposite[right.inverse], p2p=right.p2p[opposite])
    monkeypatch.setattr(part, "ICP", lambda: None)
    monkeypatch.setattr(part, "ZoomOut", lambda: None)
    wanted, found = (registration.vertices_on(matcher, spectral, match) for match in (right, wrong))
    assert np.linalg.norm(found - wanted, axis=1).mean() < 0.05
    monkeypatch.setattr(Registration, "_poses_near", lambda *_: [wanted + 9.0])
    lost = registration.vertices_on(matcher, spectral, wrong)
    assert np.linalg.norm(lost - wanted, axis=1).mean() > 0.2


def test_training_shapes_with_many_pairs_are_laid_once_for_all_folds(creatures, monkeypatch):
    _, truths, shapes = creatures
    laid, by_pairs = [], part._by_pairs
    monkeypatch.setattr(part, "_LAID", weakref.WeakKeyDictionary())
    monkeypatch.setattr(part, "_by_pairs", lambda *given: laid.append(given) or by_pairs(*given))
    learner_that(confidence=skfmap.learner.CrossFitConfidence(cv=3)).fit(shapes[:4], truths[:4])
    assert len(laid) == 3


def test_a_shape_that_was_skipped_keeps_its_place(taught, laid, creatures):
    tiny = Mesh(np.eye(4, 3), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], "tiny")
    with pytest.warns(SkippedShapeWarning, match="tiny"):
        shapes = probed_of([tiny, creatures[0][5]], on_invalid="skip")
    nothing, sound = taught.register(shapes)
    np.testing.assert_array_equal(sound.vertices, laid.vertices)
    assert np.isnan(nothing.vertices).all()
    assert nothing.vertices.shape == laid.vertices.shape
    assert np.isnan(nothing.distance).all()
    assert np.isnan([nothing.off, nothing.uncovered, nothing.stretched]).all()
    np.testing.assert_array_equal(nothing.faces, laid.faces)
    assert (nothing.fits, nothing.name, nothing.reference_name) == (False, "tiny", "cat0")
    with pytest.raises(MeshError, match="'tiny' was skipped, so it has no registered mesh"):
        nothing.mesh  # noqa: B018


# References that are computed on another mesh than the given one


def _subdivided(mesh, truth):
    """Return a mesh with a vertex in the middle of each edge, and the truth, which still holds."""
    a, b, c = (mesh.faces[:, j] for j in range(3))
    sides = np.sort(np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    edges, back = np.unique(sides, axis=0, return_inverse=True)
    ab, bc, ca = mesh.n_vertices + back.ravel().reshape(3, -1)
    faces = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    vertices = np.concatenate([mesh.vertices, mesh.vertices[edges].mean(axis=1)])
    faces = np.concatenate([np.stack(three, axis=1) for three in faces])
    return Mesh(vertices, faces, mesh.name), truth


@pytest.mark.parametrize("step", [1, -1], ids=["outwards", "inside out"])
def test_a_reference_that_was_thinned_comes_back_as_it_was_given(step, creatures):
    meshes, truths, _ = creatures
    fine, truth = _subdivided(meshes[0], truths[0])
    fine = Mesh(fine.vertices, fine.faces[:, ::step], fine.name)
    given = [fine, *meshes[1:3], meshes[5]]
    shapes = probed_of(given, max_vertices=500)
    assert shapes[0].spectral.mesh.n_vertices <= 500 < fine.n_vertices
    learner = learner_that(Registration(stiffness=0.3), confidence=None)
    learner.fit(shapes[:3], [truth, *truths[1:3]])
    (one,) = learner.register(shapes[3:])
    assert one.vertices.shape == fine.vertices.shape
    np.testing.assert_array_equal(one.faces, fine.faces)
    np.testing.assert_allclose(one.distance, distance_to(meshes[5], one.vertices), atol=1e-9)
    assert np.mean(one.distance < 1e-9) > 0.7, "drawn onto the given surface where it is near"
    # Middles of edges stay between their ends: the given mesh is carried as a whole.
    n = meshes[0].n_vertices
    ends = np.concatenate([fine.faces[:, [0, 1]], fine.faces[:, [0, 2]]])
    ends = ends[ends[:, 0] < n]
    longest = np.linalg.norm(one.vertices[ends[:, 0]] - one.vertices[ends[:, 1]], axis=1)
    assert np.quantile(longest, 0.99) < 2 * edge_of(meshes[5])


def test_what_is_given_beyond_the_working_mesh_turns_with_it(creatures):
    """A rigid motion of the working mesh is that of the given one, its loose vertices too."""
    fine, _ = _subdivided(creatures[0][0], None)
    given = Mesh(np.concatenate([[[90.0, 9, 9]], fine.vertices]), fine.faces + 1, "loose")
    with pytest.warns(RepairWarning, match="loose"):
        (shape,) = probed_of([given], max_vertices=500)
    spectral, turn = shape.spectral, Rotation.random(random_state=2).as_matrix()
    moved = laid_out._with_detail(given_reference(shape, [shape]), spectral.vertices @ turn.T + 3)
    expected = given.vertices / np.sqrt(spectral.area) @ turn.T + 3
    np.testing.assert_allclose(moved, expected, atol=1e-5)


def test_a_thinned_shape_gets_the_mesh_onto_what_was_given(stiff, copies):
    """Also if it was given inside out."""
    learner, body = stiff[0], copies[0][4]
    fine, _ = _subdivided(body, None)
    wound = [fine, Mesh(fine.vertices, fine.faces[:, ::-1], fine.name)]
    shapes = DescriptorTransformer().transform(SpectralBasis(30, max_vertices=300).transform(wound))
    assert shapes[0].spectral.mesh.n_vertices <= 300 < fine.n_vertices
    for one in learner.register(shapes):
        surface = distance_to(fine, one.vertices)
        np.testing.assert_allclose(one.distance, surface, atol=1e-9)
        assert np.mean(surface < 1e-9) > 0.95, "on the given surface, and not beside it"
        assert np.linalg.norm(one.vertices - body.vertices, axis=1).max() < edge_of(body)


def test_a_reference_that_was_mended_comes_back_as_it_was_given(creatures):
    """With a vertex that no face uses, one without coordinates, a face given twice, and faces
    wound both ways."""
    meshes, truths, shapes = creatures
    body = meshes[0]
    faces = body.faces + 2
    faces = np.concatenate([faces[:100, ::-1], faces[100:], faces[200:201]])
    given = Mesh(np.concatenate([[[9.0, 9, 9], [0, 0, 0]], body.vertices]), faces, "broken")
    truth = Correspondence(np.add(truths[0].pairs, [2, 0]))
    with pytest.warns(RepairWarning, match="broken"):
        (reference,) = probed_of([given])
    learner = learner_that(Registration(stiffness=0.3), confidence=None)
    learner.fit([reference, *shapes[1:3]], [truth, *truths[1:3]])
    plain = learner_that(Registration(stiffness=0.3), confidence=None)
    plain.fit(shapes[:3], truths[:3])
    (one,), (sound,) = learner.register(shapes[5:]), plain.register(shapes[5:])
    assert one.vertices.shape == given.vertices.shape
    np.testing.assert_array_equal(one.faces, given.faces)
    assert np.isfinite(one.vertices).all()
    off = np.linalg.norm(one.vertices[2:] - sound.vertices, axis=1)
    assert off.max() < 0.01 * edge_of(meshes[5])
    assert re.search("fits=True", repr(one))
