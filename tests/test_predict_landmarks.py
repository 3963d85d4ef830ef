"""Landmarks of new shapes: places, offsets, errors to expect, and what is missing."""

import pickle
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation
from sklearn.base import clone
from sklearn.model_selection import cross_val_score

import skfmap
from skfmap import BridgedLearner, Correspondence, Mesh
from skfmap.exceptions import CorrespondenceError, CoverageWarning, OrientationWarning
from skfmap.functional.left_out import (
    least_calibrating,
    pooled_quantile,
    scales_of_others,
    shrunk_mean,
    shrunk_scales,
)
from skfmap.geometry.normals import vertex_normals
from skfmap.learner import landmark_model
from skfmap.learner.confidence import matchers_without
from skfmap.metrics import get_scorer
from skfmap.model_selection import PinnedReference
from skfmap.persistence import load_model, save_model
from skfmap.refinement import BijectiveZoomOut
from skfmap.registration import Registration
from skfmap.report import evaluate_landmarks
from skfmap.shapes import SkippedShape

BENDS = (0.0, 0.1, -0.1, 0.15, -0.15, 0.05)  # of the collection's bodies
NAMES = tuple(f"mark {i}" for i in range(40))


@pytest.fixture(scope="module")
def measured(collection, points_on_bodies):
    return [
        Correspondence.from_points(points_on_bodies(bend), mesh, NAMES)
        for bend, mesh in zip(BENDS, collection.meshes, strict=True)
    ]


@pytest.fixture(scope="module")
def learner(make_learner):
    return make_learner(n_functions=12, refine="bijective-zoomout", confidence="cross-fit")


@pytest.fixture(scope="module")
def measuring(learner, probed, measured):
    return clone(learner).fit(probed[:5], measured[:5])


def off(marks, points):
    return np.linalg.norm(marks.points - points, axis=1)


def test_new_shapes_are_measured_about_as_well_as_promised(measuring, probed, points_on_bodies):
    (marks,) = measuring.predict_landmarks(probed[5:])
    errors = off(marks, points_on_bodies(BENDS[5]))
    size = np.sqrt(probed[5].spectral.area)
    assert marks.names == NAMES
    assert marks.name == "body5"
    assert errors.mean() < 0.05 * size
    assert 0.4 < marks.expected_error.mean() / errors.mean() < 2.5


def test_the_function_takes_pipelines_and_meshes(collection, measuring, probed):
    direct = measuring.predict_landmarks(probed[5:])[0]
    (marks,) = skfmap.predict_landmarks(measuring, probed[5:])
    assert np.array_equal(direct.points, marks.points)


def test_landmarks_come_in_the_units_and_the_place_of_the_mesh(
    measuring, collection, probe, probed
):
    mesh, turn = collection.meshes[5], Rotation.random(random_state=3).as_matrix()
    moved = Mesh(25.4 * mesh.vertices @ turn.T + [5.0, -7, 300], mesh.faces, name="moved")
    one, other = measuring.predict_landmarks([probed[5], *probe([moved])])
    there = 25.4 * one.points @ turn.T + [5.0, -7, 300]
    np.testing.assert_allclose(other.points, there, atol=1e-3 * 25.4)
    np.testing.assert_allclose(other.expected_error, 25.4 * one.expected_error, rtol=1e-6)


def test_points_off_the_surface_are_predicted_off_it_unless_asked(
    learner, probed, collection, measured
):
    marks = []
    for mesh, truth in zip(collection.meshes, measured, strict=True):
        at, (corners, weights) = truth.coordinates, (truth.places.corners, truth.places.weights)
        normals = vertex_normals(mesh.vertices, mesh.faces)[corners]
        normals = np.einsum("nc,ncd->nd", weights, normals)
        marks.append(Correspondence.from_points(at + 0.2 * normals, mesh, NAMES))
    fitted = clone(learner).fit(probed[:5], marks[:5])
    height = {
        on_surface: Correspondence.from_points(
            fitted.predict_landmarks(probed[5:], on_surface=on_surface)[0], collection.meshes[5]
        ).distance
        for on_surface in (False, True)
    }
    assert 0.1 < np.median(height[False]) < 0.25
    assert height[True].max() < 1e-8


def test_a_missing_landmark_costs_that_point_on_that_shape(
    learner, measuring, probed, collection, measured, points_on_bodies
):
    def without(i, row):
        points = points_on_bodies(BENDS[i]).copy()
        points[row] = np.nan
        return Correspondence.from_points(points, collection.meshes[i], NAMES)

    some = [without(0, 3), without(1, 7), *measured[2:5]]
    fitted = clone(learner).fit(probed[:5], some)
    assert fitted.landmarks_.names == NAMES  # in the order of the template
    (marks,) = fitted.predict_landmarks(probed[5:])
    true = points_on_bodies(BENDS[5])
    size = np.sqrt(probed[5].spectral.area)
    for name in ("mark 3", "mark 7"):
        assert np.linalg.norm(marks.point(name) - true[NAMES.index(name)]) < 0.1 * size


def test_a_landmark_of_one_shape_alone_is_not_judged_by_itself(
    learner, probed, collection, measured, points_on_bodies
):
    marks = []
    for i, mesh in enumerate(collection.meshes[:5]):
        points = points_on_bodies(BENDS[i]).copy()
        if i != 2:
            points[3] = np.nan
        marks.append(Correspondence.from_points(points, mesh, NAMES))
    model = clone(learner).fit(probed[:5], marks).landmarks_
    distances = model.left_out.distances
    assert np.isnan(distances[:, 3]).all()
    assert not model.offsets[3].any()
    assert model.expected_errors()[3] == pytest.approx(np.nanmean(distances))


def test_landmarks_that_were_found_to_be_wrong_do_not_count(
    learner, probed, collection, measured, points_on_bodies
):
    points = points_on_bodies(BENDS[2]).copy()
    ends = [points[:, 0].argmin(), points[:, 0].argmax()]
    points[ends] = points[ends[::-1]]
    some = list(measured[:5])
    some[2] = Correspondence.from_points(points, collection.meshes[2], NAMES)
    building = clone(learner).set_params(n_functions=25, known_maps="in-space", refine=None)
    with pytest.warns(CoverageWarning, match="swapped"):
        model = building.fit(probed[:5], some).landmarks_
    right, distances = model.left_out.right, model.left_out.distances
    assert (~right).sum() == 2
    assert sorted(np.flatnonzero(~right.all(axis=0))) == sorted(ends)
    assert distances[right].max() < distances[~right].min() / 2
    assert model.expected_errors().max() < distances[right].max()


def test_shapes_without_measured_points_are_learned_from_in_every_fold(learner, probed, measured):
    def spied(training, folds, matcher):
        seen.extend((folds, training.used))
        return matchers_without(training, folds, matcher)

    seen = []
    some = [replace(truth, names=None) for truth in measured[:3]]
    plain = [Correspondence(truth.pairs) for truth in measured[3:5]]  # vertices, not measured
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(landmark_model, "matchers_without", spied)
        clone(learner).fit(probed[:5], [*some, *plain])
    folds, used = seen
    assert sorted(np.concatenate(folds)) == [0, 1]
    assert used.tolist() == [0, 1, 2, 3]


def test_landmarks_that_the_reference_lacks_are_put_without_leaving_shapes_out(
    learner, probed, collection, measured, points_on_bodies
):
    points = points_on_bodies(BENDS[0]).copy()
    points[3] = np.nan
    first = Correspondence.from_points(points, collection.meshes[0], NAMES)
    true, size = points_on_bodies(BENDS[5])[3], np.sqrt(probed[5].spectral.area)
    for n_shapes, confidence in ((4, None), (2, "cross-fit")):
        fitted = clone(learner).set_params(confidence=confidence)
        fitted.fit(probed[:n_shapes], [first, *measured[1:n_shapes]])
        marks = fitted.predict_landmarks(probed[5:])[0]
        assert marks.names == NAMES
        assert np.linalg.norm(marks.point("mark 3") - true) < 0.1 * size


@pytest.mark.parametrize("confidence", [None, "cross-fit"])
def test_matches_that_are_not_refined_put_landmarks_too(
    learner, probed, measured, points_on_bodies, confidence
):
    fitted = clone(learner).set_params(refine=None, confidence=confidence)
    (marks,) = fitted.fit(probed[:4], measured[:4]).predict_landmarks(probed[5:])
    assert off(marks, points_on_bodies(BENDS[5])).mean() < 0.1 * np.sqrt(probed[5].spectral.area)


def test_mirrored_shapes_are_told(measuring, probe, collection, points_on_bodies):
    mesh, flip = collection.meshes[5], np.array([1, -1, 1])
    mirrored = probe([Mesh(mesh.vertices * flip, mesh.faces[:, ::-1], name="mirrored")])
    with pytest.warns(OrientationWarning, match="mirrored"):
        measuring.predict_landmarks(mirrored)
    reflecting = copy(measuring).set_params(on_mirrored="reflect")
    with pytest.warns(OrientationWarning, match="reflected"):
        (marks,) = reflecting.predict_landmarks(mirrored)
    size = np.sqrt(probe([mesh])[0].spectral.area)
    assert off(marks, points_on_bodies(BENDS[5]) * flip).mean() < 0.05 * size


def test_measured_points_are_registered_by_default(probed, collection, measured):
    learner = skfmap.WeightedFunctionalMapLearner(n_functions=12, confidence=None)
    fitted = {
        what: clone(learner).fit(probed[:3], truths[:3])
        for what, truths in (("measured", measured), ("vertices", collection.truths))
    }
    assert isinstance(fitted["measured"].refine_, Registration)
    assert isinstance(fitted["vertices"].refine_, BijectiveZoomOut)
    assert fitted["measured"].refine == "auto"
    (laid,) = fitted["measured"].register(probed[5:])
    assert laid.fits
    with pytest.raises(ValueError, match="refine must be one of"):
        fitted["vertices"].match(probed[5:], refine="auto")


def test_results_are_the_same_for_every_number_of_jobs(learner, probed, measured, measuring):
    other = clone(learner).set_params(n_jobs=2).fit(probed[:5], measured[:5])
    one, two = (each.predict_landmarks(probed[5:])[0] for each in (measuring, other))
    np.testing.assert_allclose(one.points, two.points, atol=1e-9)
    np.testing.assert_allclose(one.expected_error, two.expected_error, rtol=1e-9)


def test_models_and_landmarks_persist(measuring, probed, tmp_path):
    save_model(measuring, tmp_path / "model.skops")
    copies = [pickle.loads(pickle.dumps(measuring)), load_model(tmp_path / "model.skops")]
    expected = measuring.predict_landmarks(probed[5:])[0]
    for one in copies:
        (marks,) = pickle.loads(pickle.dumps(one.predict_landmarks(probed[5:])))
        assert np.array_equal(marks.points, expected.points)
        assert np.array_equal(marks.expected_error, expected.expected_error)


def test_without_confidence_nothing_is_promised(learner, probed, measured, tmp_path):
    fitted = clone(learner).set_params(confidence=None).fit(probed[:3], measured[:3])
    (marks,) = fitted.predict_landmarks(probed[5:])
    assert marks.expected_error is None
    assert marks.radius is None
    assert not fitted.landmarks_.offsets.any()
    save_model(fitted, tmp_path / "model.skops")
    (again,) = load_model(tmp_path / "model.skops").predict_landmarks(probed[5:])
    assert np.array_equal(again.points, marks.points)


def test_radii_need_nine_shapes_left_out_for_nine_in_ten(measuring, probed):
    (marks,) = measuring.predict_landmarks(probed[5:])
    assert marks.radius is None  # four were left out
    (marks,) = measuring.predict_landmarks(probed[5:], coverage=0.75)
    assert marks.coverage == 0.75
    assert (marks.radius > 0).all()
    assert [least_calibrating(share) for share in (0.5, 0.75, 0.8, 0.9, 0.95)] == [1, 3, 4, 9, 19]


def test_bad_input_is_told(measuring, probed, collection, learner, measured):
    with pytest.raises(ValueError, match="below 1"):
        measuring.predict_landmarks(probed[5:], coverage=1.0)
    with pytest.raises(ValueError, match="above 0"):
        measuring.predict_landmarks(probed[5:], coverage=0)
    unmeasured = clone(learner).set_params(confidence=None).fit(probed[:3], collection.truths[:3])
    with pytest.raises(ValueError, match="measured points"):
        unmeasured.predict_landmarks(probed[5:])
    with pytest.raises(CorrespondenceError, match="from_points"):
        get_scorer("neg_landmark_error")(measuring, probed[5:], collection.truths[5:])
    with pytest.raises(ValueError, match="reference_y"):
        get_scorer("neg_landmark_error", reference_y=measured[0])
    unnamed = replace(measured[5], names=None)
    with pytest.raises(
        CorrespondenceError, match=r"No landmark of y was learned: y has 1, 2, .*mark 0"
    ):
        get_scorer("neg_landmark_error")(measuring, probed[5:], [unnamed])
    with pytest.raises(TypeError, match=r"y\[1\].*from_points\(landmarks, mesh\)"):
        clone(learner).fit(probed[:2], [measured[0], measured[1].landmarks])
    plain = clone(learner).set_params(confidence=None, refine=None)
    bridged = BridgedLearner(plain, through="body1")
    bridged.fit(probed[:3], measured[:3])
    with pytest.raises(TypeError, match="BridgedLearner cannot place landmarks"):
        get_scorer("neg_landmark_error")(bridged, probed[5:], measured[5:])
    with pytest.raises(CorrespondenceError, match="point 1 has 2 pairs with coordinates"):
        Correspondence([[4, 1], [5, 1], [6, 2]], coordinates=np.zeros((3, 3)))


def test_shapes_that_were_left_out_have_no_landmarks(measuring, probed):
    left = SkippedShape("broken", "no faces", 5)
    marks, nothing = measuring.predict_landmarks([probed[5], left])
    assert marks.placed.all()
    assert nothing.name == "broken"
    assert not nothing.placed.any()


def test_the_scorer_is_minus_the_mean_distance(measuring, learner, probed, measured):
    scorer = get_scorer("neg_landmark_error")
    found = measuring.predict_landmarks(probed[4:])
    means = [
        off(marks, truth.coordinates).mean()
        for marks, truth in zip(found, measured[4:], strict=True)
    ]
    assert scorer(measuring, probed[4:], measured[4:]) == pytest.approx(-np.mean(means))
    weighted = scorer(measuring, probed[4:], measured[4:], sample_weight=[1, 3])
    assert weighted == pytest.approx(-np.average(means, weights=[1, 3]))
    scores = cross_val_score(
        clone(learner).set_params(confidence=None),
        probed,
        measured,
        scoring=scorer,
        cv=PinnedReference(2),
    )
    assert scores.shape == (2,)
    assert (scores < 0).all()


finite = st.floats(-10, 10, allow_nan=False).map(lambda x: round(x, 3))


@given(arrays(float, st.tuples(st.integers(2, 6), st.integers(1, 4), st.just(3)), elements=finite))
def test_shrunk_means_lie_between_zero_and_the_mean(residuals):
    mean, shrunk = residuals.mean(axis=0), shrunk_mean(residuals)
    share = (shrunk * mean).sum(axis=1) / np.maximum(np.square(mean).sum(axis=1), 1e-300)
    assert (share >= 0).all()
    assert (share <= 1 + 1e-9).all()
    np.testing.assert_allclose(shrunk, share[:, None] * mean, atol=1e-9)


@pytest.mark.parametrize(("n_shapes", "ratio"), [(2, 0.4), (1000, 1.0)])
def test_shrinking_helps_where_shapes_are_few_and_is_gone_where_they_are_many(n_shapes, ratio):
    rng = np.random.default_rng(0)
    true = 0.5 * rng.normal(size=(400, 3))  # half as large as what single shapes add
    drawn = true + rng.normal(size=(n_shapes, 400, 3))
    shrunk, plain = (
        np.square(one - true).mean() for one in (shrunk_mean(drawn), drawn.mean(axis=0))
    )
    assert shrunk / plain == pytest.approx(ratio, abs=0.05)


def test_missing_landmarks_do_not_count():
    residuals = np.random.default_rng(2).normal(size=(5, 3, 3)) + 5
    with_gap = np.concatenate([residuals, np.full((2, 3, 3), np.nan)])
    np.testing.assert_allclose(shrunk_mean(with_gap), shrunk_mean(residuals))
    distances = np.linalg.norm(residuals, axis=2)
    gaps = np.linalg.norm(with_gap, axis=2)
    np.testing.assert_allclose(shrunk_scales(gaps), shrunk_scales(distances))
    scales = shrunk_scales(distances)
    assert pooled_quantile(gaps, scales, 0.8) == pooled_quantile(distances, scales, 0.8)


@pytest.mark.parametrize("n_shapes", [9, 20, 40])
def test_radii_hold_what_they_promise(n_shapes):
    rng, held = np.random.default_rng(n_shapes), []
    true = rng.uniform(0.5, 2, size=12)
    for _ in range(1000):
        # Shapes are harder or easier as a whole, and landmarks too.
        drawn = true * rng.gamma(4, 0.25, (n_shapes + 1, 1)) * rng.rayleigh(size=(n_shapes + 1, 12))
        times = pooled_quantile(drawn[:-1], scales_of_others(drawn[:-1]), 0.9)
        held.append((drawn[-1] <= times * shrunk_scales(drawn[:-1])).mean())
    assert 0.88 < np.mean(held) < 0.94


def test_what_the_fit_left_out_is_about_what_fits_without_it_find(
    measuring, probed, measured, points_on_bodies
):
    marks = [truth.landmarks for truth in measured[:5]]
    fitted = evaluate_landmarks(measuring, probed[:5], measured[:5], marks)
    anew = evaluate_landmarks(measuring, probed[:5], measured[:5], marks, cv=4)
    assert [one.name for one in fitted.predicted] == [f"body{i}" for i in range(1, 5)]
    left, sizes = measuring.landmarks_.left_out, [np.sqrt(s.spectral.area) for s in probed[1:5]]
    order = np.argsort(left.indices)
    np.testing.assert_allclose(fitted.errors, left.distances[order] * np.array(sizes)[:, None])
    assert 0.7 < fitted.errors.mean() / anew.errors.mean() < 1.4
    # Another observer's landmarks change what is compared with, not what was predicted.
    moved = [skfmap.Landmarks(one.points + 0.1, one.names) for one in marks]
    again = evaluate_landmarks(measuring, probed[:5], measured[:5], moved)
    for one, other in zip(fitted.predicted, again.predicted, strict=True):
        np.testing.assert_allclose(one.points, other.points)
    # Errors to expect of a specimen are those of the others.
    own = shrunk_scales(left.distances[order][1:])
    np.testing.assert_allclose(fitted.expected[0], sizes[0] * own)


@pytest.mark.parametrize("confidence", [None, "cross-fit"])
def test_unrefined_models_measure_and_are_saved(
    make_learner, probed, measured, points_on_bodies, tmp_path, confidence
):
    learner = make_learner(refine=None, confidence=confidence).fit(probed[:5], measured[:5])
    (marks,) = learner.predict_landmarks(probed[5:])
    errors = off(marks, points_on_bodies(BENDS[5]))
    assert errors.mean() < 0.1 * np.sqrt(probed[5].spectral.area)
    save_model(learner, tmp_path / "model.skops")
    (again,) = load_model(tmp_path / "model.skops").predict_landmarks(probed[5:])
    assert np.array_equal(again.points, marks.points)
