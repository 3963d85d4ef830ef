"""Errors to expect: calibrated on shapes left out, or not at all."""

import numpy as np
import pytest

import skfmap.functional.eigenbasis
import skfmap.learner.observation
import skfmap.learner.training_set
from skfmap.exceptions import CoverageWarning
from skfmap.learner import CrossFitConfidence, TrainingSet


@pytest.fixture(scope="module")
def plain(make_learner, probed, collection):
    """A learner without calibration."""
    return make_learner(confidence=None).fit(probed[:5], collection.truths[:5])


def test_a_fit_without_calibration_learns_once(make_learner, probed, collection, monkeypatch):
    learned, original = [], skfmap.learner.training_set.learn_functional_maps
    monkeypatch.setattr(
        skfmap.learner.training_set,
        "learn_functional_maps",
        lambda **how: learned.append(1) or original(**how),
    )
    for confidence, n_times in ((None, 1), ("cross-fit", 4), (CrossFitConfidence(cv=2), 3)):
        learned.clear()
        make_learner(n_functions=8, tol=1e-2, confidence=confidence).fit(
            probed[:4], collection.truths[:4]
        )
        assert len(learned) == n_times


def test_maps_and_matches_do_not_depend_on_the_calibration(plain, fitted, probed, collection):
    np.testing.assert_array_equal(plain.weights_, fitted.weights_)
    np.testing.assert_array_equal(plain.predict(probed[5:]), fitted.predict(probed[5:]))
    np.testing.assert_array_equal(plain.match(probed[5:])[0].p2p, fitted.match(probed[5:])[0].p2p)
    assert plain.score(probed[5:], collection.truths[5:]) == fitted.score(
        probed[5:], collection.truths[5:]
    )


def test_without_calibration_nothing_is_said_of_errors(plain, probed):
    (match, other) = plain.match(probed[4:])
    assert match.expected_error is None
    assert match.confidence is None
    assert match.familiar is None
    assert f"{len(match.p2p)} vertices" in repr(match)
    heights = plain.reference_.spectral.vertices[:, 2]
    assert not match.transfer(heights).mask.any()
    with pytest.raises(
        ValueError,
        match=r"'body4' has no expected errors.*confidence='cross-fit', or leave max_error",
    ):
        match.transfer(heights, max_error=0.1)
    p2p, expected = match.to(other)
    assert expected is None
    assert (p2p >= 0).all()
    for name in ("error_models_", "misfits_", "training_errors_"):
        with pytest.raises(AttributeError, match=f"{name}.*its confidence_ .* has none"):
            getattr(plain, name)


def test_attributes_of_a_fit_do_not_exist_before_it(make_learner):
    learner = make_learner()
    for name in (
        "weights_",
        "stable_basis_",
        "reference_",
        "loss_",
        "error_models_",
        "matcher_",
        "confidence_",
    ):
        assert not hasattr(learner, name)


def test_the_words_and_the_object_are_the_same(make_learner, probed, collection, fitted):
    learner = make_learner(confidence=CrossFitConfidence(cv=3)).fit(
        probed[:5], collection.truths[:5]
    )
    np.testing.assert_array_equal(learner.misfits_, fitted.misfits_)
    (one,), (other,) = learner.match(probed[5:]), fitted.match(probed[5:])
    np.testing.assert_array_equal(one.expected_error, other.expected_error)


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.CoverageWarning")
def test_a_sparse_training_shape_may_have_no_pair_at_a_watched_vertex(
    make_learner, probed, collection, monkeypatch
):
    """Its error is unknown then; nothing is divided by zero."""
    monkeypatch.setattr(skfmap.learner.observation, "_N_WATCHED", 20)
    training = TrainingSet.from_samples(probed[:4], collection.truths[:4], n_functions=8)
    watch = skfmap.learner.observation.watch_reference(training.reference, training.joins, None)
    away = ~np.isin(training.joins[2].vertices_0, watch.vertices)
    sparse = collection.truths[3].restrict(training.joins[2].points[away][::6])
    truths = [*collection.truths[:3], sparse]
    # In the cache of all tests the watched vertices are more.
    learner = make_learner(n_functions=8, tol=1e-2, memory=None).fit(probed[:4], truths)
    assert np.isnan(learner.training_errors_[3])
    assert np.isfinite(learner.training_errors_[1:3]).all()
    assert np.isfinite(learner.match(probed[5:])[0].expected_error).all()


def test_coverage_is_told_once_for_all_shapes(make_learner, probed, collection):
    sparse = [truth.restrict(truth.pairs[::20, 1]) for truth in collection.truths[:4]]
    learner = make_learner(confidence=None, weighting=None, known_maps="pairs")
    with pytest.warns(CoverageWarning, match=r"X\[1\] \('body1'\).*X\[3\] \('body3'\)") as caught:
        learner.fit(probed[:4], sparse)
    assert len([one for one in caught if issubclass(one.category, CoverageWarning)]) == 1


def test_errors_of_training_shapes_are_those_of_matches_left_out(probed, collection, make_learner):
    """Two beside the reference: each is matched by what the other taught."""
    learner = make_learner(tol=1e-2).fit(probed[:3], collection.truths[:3])
    for left_out in (1, 2):
        rows = [0, 3 - left_out]
        other = make_learner(tol=1e-2).fit(
            [probed[i] for i in rows], [collection.truths[i] for i in rows]
        )
        (errors,) = other.pair_errors([probed[left_out]], [collection.truths[left_out]])
        # There, errors are seen at some of the landmarks and by heat distances.
        assert learner.training_errors_[left_out] == pytest.approx(errors.direct.mean(), rel=0.3)
