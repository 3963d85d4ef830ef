"""Errors to expect: calibrated on shapes left out, or not at all."""

from dataclasses import replace

import numpy as np
import pytest

import skfmap.learner.observation
import skfmap.learner.training_set
from skfmap.exceptions import CoverageWarning
from skfmap.learner import CrossFitConfidence, TrainingSet
from skfmap.learner.error_model import ErrorModel, fit_error_model
from skfmap.learner.familiarity import is_familiar
from skfmap.learner.observation import Observation, Watch
from skfmap.learner.signs import vertex_signs


@pytest.fixture(scope="module")
def plain(make_learner, probed, collection):
    """A learner without calibration."""
    return make_learner(confidence=None).fit(probed[:5], collection.truths[:5])


def test_a_fit_without_calibration_learns_once(make_learner, probed, collection, monkeypatch):
    learned, original = [], skfmap.learner.training_set.learn_functional_maps
    monkeypatch.setattr(
        skfmap.learner.training_set, "learn_functional_maps", lambda **how: learned.append(1) or original(**how)
    )
    for confidence, n_times in ((None, 1), ("cross-fit", 4), (CrossFitConfidence(cv=2), 3)):
        learned.clear()
        make_learner(n_functions=8, tol=1e-2, confidence=confidence).fit(probed[:4], collection.truths[:4])
        assert len(learned) == n_times


def test_maps_and_matches_do_not_depend_on_the_calibration(plain, fitted, probed, collection):
    np.testing.assert_array_equal(plain.weights_, fitted.weights_)
    np.testing.assert_array_equal(plain.predict(probed[5:]), fitted.predict(probed[5:]))
    np.testing.assert_array_equal(plain.match(probed[5:])[0].p2p, fitted.match(probed[5:])[0].p2p)
    assert plain.score(probed[5:], collection.truths[5:]) == fitted.score(probed[5:], collection.truths[5:])


def test_without_calibration_nothing_is_said_of_errors(plain, probed):
    (match, other) = plain.match(probed[4:])
    assert match.expected_error is None
    assert match.confidence is None
    assert match.familiar is None
    assert f"{len(match.p2p)} vertices" in repr(match)
    heights = plain.reference_.spectral.vertices[:, 2]
    assert not match.transfer(heights).mask.any()
    with pytest.raises(ValueError, match=r"'body4' has no expected errors.*confidence='cross-fit', or leave max_error"):
        match.transfer(heights, max_error=0.1)
    p2p, expected = match.to(other)
    assert expected is None
    assert (p2p >= 0).all()
    for name in ("error_models_", "misfits_", "training_errors_"):
        with pytest.raises(AttributeError, match=f"{name}.*switched off"):
            getattr(plain, name)


def test_attributes_of_a_fit_do_not_exist_before_it(make_learner):
    learner = make_learner()
    for name in ("weights_", "stable_basis_", "reference_", "loss_", "error_models_", "matcher_", "confidence_"):
        assert not hasattr(learner, name)


def test_the_words_and_the_object_are_the_same(make_learner, probed, collection, fitted):
    learner = make_learner(confidence=CrossFitConfidence(cv=3)).fit(probed[:5], collection.truths[:5])
    np.testing.assert_array_equal(learner.misfits_, fitted.misfits_)
    (one,), (other,) = learner.match(probed[5:]), fitted.match(probed[5:])
    np.testing.assert_array_equal(one.expected_error, other.expected_error)


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.CoverageWarning")
def test_a_sparse_training_shape_may_have_no_pair_at_a_watched_vertex(make_learner, probed, collection, monkeypatch):
    """Its error is unknown then; nothing is divided by zero."""
    monkeypatch.setattr(skfmap.learner.observation, "_N_WATCHED", 20)
    training = TrainingSet.from_samples(probed[:4], collection.truths[:4], n_functions=8)
    watch = skfmap.learner.observation.watch_reference(training.reference, training.joins, None)
    away = ~np.isin(training.joins[2].vertices_0, watch.vertices)
    sparse = collection.truths[3].restrict(training.joins[2].points[away][::6])
    truths = [*collection.truths[:3], sparse]
    learner = make_learner(n_functions=8, tol=1e-2).fit(probed[:4], truths)
    assert np.isnan(learner.training_errors_[3])
    assert np.isfinite(learner.training_errors_[1:3]).all()
    assert np.isfinite(learner.match(probed[5:])[0].expected_error).all()


def _observed(rng, n=400, n_watched=20, slope=0.5):
    """One sign that tells the error, and one that is noise."""
    sign = rng.normal(size=n)
    errors = 0.05 * np.exp(slope * sign) * rng.gamma(50.0, 1 / 50, size=n)
    watched = rng.integers(0, n_watched, n)
    return Observation(np.column_stack([sign, rng.normal(size=n)]), errors, np.ones(n), watched, watched)


@pytest.fixture(scope="module")
def watch():
    line = np.arange(20.0)
    return Watch(np.arange(20), np.abs(line[:, None] - line) / 20)


def test_an_error_model_finds_the_sign_that_tells_the_error(watch):
    rng = np.random.default_rng(0)
    model = fit_error_model([_observed(rng) for _ in range(3)], watch, worst_distance=1.0, cross_validated=True)
    new = _observed(rng)
    expected, confidence = model.predict(new.signs, new.matched, 1.0)
    truth = 0.05 * np.exp(0.5 * new.signs[:, 0])
    assert np.corrcoef(np.log(expected), np.log(truth))[0, 1] > 0.95
    assert expected.mean() == pytest.approx(new.errors.mean(), rel=0.1)
    order = np.argsort(expected)
    assert (np.diff(confidence[order]) <= 1e-12).all(), "the larger the error, the smaller the confidence"
    assert abs(model.coefficients[1]) < 0.1 * abs(model.coefficients[0])


def test_signs_that_never_differ_say_nothing_and_are_no_error(watch):
    rng = np.random.default_rng(0)
    alike = [one._replace(signs=np.zeros_like(one.signs)) for one in (_observed(rng, slope=0.0) for _ in range(3))]
    model = fit_error_model(alike, watch, worst_distance=1.0, cross_validated=True)
    expected, _ = model.predict(np.zeros((5, 2)), np.zeros(5, dtype=int), 1.0)
    assert np.ptp(expected) < 1e-12


def test_errors_beyond_the_training_shapes_are_raised_by_the_square_of_the_misfit():
    flat = np.array([0.1, 0.1])
    model = ErrorModel(
        *(np.zeros(2), np.ones(2), np.ones(2), np.array([0.0, 1.0]), flat, 1 - flat, np.full(4, 0.1)),
        *(True, 0.1, 2.0, 0.5),
    )
    signs, p2p = np.zeros((3, 1)), np.zeros(3, dtype=int)
    assert model.misfit(3.0) == 1.5
    for misfit, factor in ((0.5, 1), (1.0, 1), (2.0, 4), (3.0, 5)):
        expected, confidence = model.predict(signs, p2p, misfit)
        np.testing.assert_allclose(expected, min(0.1 * factor, 0.5))  # up to chance
        np.testing.assert_allclose(confidence, 0.9 / max(1.0, misfit) ** 2)


def test_a_shape_is_familiar_up_to_a_multiple_of_the_worst_training_shape():
    residuals = np.array([np.nan, 1.0, 2.0, 1.5, 1.0])  # of four; the limit is 2 * 1.5 * (1 + 1 / 3) = 4
    assert is_familiar(residuals, 3.9)
    assert not is_familiar(residuals, 4.1)
    assert is_familiar(residuals, 1.0, misfit=1.5)  # the limit is 1.25 * (1 + 1 / 4)
    assert not is_familiar(residuals, 1.0, misfit=1.6)
    one = np.array([np.nan, 2.0])
    assert is_familiar(one, 7.9)
    assert not is_familiar(one, 8.1)


def test_signs_grow_where_a_match_is_wrong(fitted, probed):
    matcher, shape = fitted.matcher_, probed[5]
    match, _ = matcher.match(shape, matcher.solve(shape).C)
    wrong = match.p2p.copy()
    wrong[:100] = np.random.default_rng(0).permutation(wrong[:100])
    right_signs, wrong_signs = (vertex_signs(matcher, shape, match._replace(p2p=p2p)) for p2p in (match.p2p, wrong))
    assert right_signs.shape == (shape.spectral.mesh.n_vertices, 6)
    assert (wrong_signs[:100, :3].mean(axis=0) > right_signs[:100, :3].mean(axis=0) + 0.3).all()
    far = np.linalg.norm(shape.spectral.vertices - shape.spectral.vertices[:100].mean(axis=0), axis=1).argmax()
    np.testing.assert_allclose(wrong_signs[far, :2], right_signs[far, :2])


def test_equation_2_is_solved_once_per_shape(fitted, probed, monkeypatch):
    """Map, residual, mirrored residual and points come from one factorisation."""
    solved, original = [], skfmap.learner.matcher.MapEquation
    monkeypatch.setattr(skfmap.learner.matcher, "MapEquation", lambda *how: solved.append(1) or original(*how))
    fitted.match(probed[4:])
    assert len(solved) == 2
    fitted.predict(probed[4:])
    assert len(solved) == 4


def test_the_mirrored_residual_is_that_of_the_mirrored_probes(fitted, probed):
    shape = probed[5]
    odd = np.array([category == "oriented" for category in shape.probe_categories])
    mirrored = replace(shape, probes=np.where(odd, -shape.probes, shape.probes))
    there, back = (fitted.matcher_.solve(one, mirrored=True) for one in (shape, mirrored))
    assert there.mirrored_residual == pytest.approx(back.residual, rel=1e-12)
    assert there.residual == pytest.approx(back.mirrored_residual, rel=1e-12)


def test_coverage_is_told_once_for_all_shapes(make_learner, probed, collection):
    sparse = [truth.restrict(truth.pairs[::20, 1]) for truth in collection.truths[:4]]
    with pytest.warns(CoverageWarning, match=r"X\[1\] \('body1'\).*X\[3\] \('body3'\)") as caught:
        make_learner(confidence=None, weighting=None).fit(probed[:4], sparse)
    assert len([one for one in caught if issubclass(one.category, CoverageWarning)]) == 1
