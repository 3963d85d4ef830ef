"""Landmarks of new shapes: places, offsets, errors to expect, and what is missing."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation
from sklearn.base import clone
from sklearn.model_selection import cross_val_score

import skfmap
from skfmap import Correspondence, Mesh
from skfmap.exceptions import CorrespondenceError
from skfmap.functional.left_out import (
    least_calibrating,
    pooled_quantile,
    shrunk_mean,
    shrunk_scales,
)
from skfmap.geometry.normals import vertex_normals
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
    assert fitted.landmarks_.names[:1] == NAMES[:1]
    assert sorted(fitted.landmarks_.names) == sorted(NAMES)
    (marks,) = fitted.predict_landmarks(probed[5:])
    true = points_on_bodies(BENDS[5])
    size = np.sqrt(probed[5].spectral.area)
    for name in ("mark 3", "mark 7"):
        assert np.linalg.norm(marks.point(name) - true[NAMES.index(name)]) < 0.1 * size


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
    for copy in copies:
        (marks,) = pickle.loads(pickle.dumps(copy.predict_landmarks(probed[5:])))
        assert np.array_equal(marks.points, expected.points)
        assert np.array_equal(marks.expected_error, expected.expected_error)


def test_without_confidence_nothing_is_promised(learner, probed, measured):
    fitted = clone(learner).set_params(confidence=None).fit(probed[:3], measured[:3])
    (marks,) = fitted.predict_landmarks(probed[5:])
    assert marks.expected_error is None
    assert marks.radius is None
    assert not fitted.landmarks_.offsets.any()


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


def test_shrinking_takes_off_the_noise_of_a_mean():
    true = np.array([[3.0, 0, 0], [0, 0, 0]])
    drawn = true + np.random.default_rng(0).normal(size=(4000, 2, 3))
    mean = shrunk_mean(drawn)
    assert mean[0, 0] == pytest.approx(3, abs=0.1)
    # Of landmarks without an offset more is taken off than is left, in the mean.
    drawn = np.random.default_rng(1).normal(size=(9, 500, 3))
    left = np.square(shrunk_mean(drawn)).sum() / np.square(drawn.mean(axis=0)).sum()
    assert left < 0.4


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
    for _ in range(300):
        # Shapes are harder or easier as a whole, and landmarks too.
        drawn = true * rng.gamma(4, 0.25, (n_shapes + 1, 1)) * rng.rayleigh(size=(n_shapes + 1, 12))
        scales = shrunk_scales(drawn[:-1])
        held.append((drawn[-1] <= pooled_quantile(drawn[:-1], scales, 0.9) * scales).mean())
    assert 0.86 < np.mean(held) < 0.94


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
