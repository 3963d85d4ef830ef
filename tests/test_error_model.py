"""From signs to expected errors: planted relations are found, and nothing is made of noise."""

import numpy as np
import pytest

from skfmap.learner.error_model import ErrorModel, fit_error_model
from skfmap.learner.observation import Observation, Watch


def _observed(rng, n=400, n_watched=20, slope=0.5):
    """One sign that tells the error, and one that is noise."""
    sign = rng.normal(size=n)
    errors = 0.05 * np.exp(slope * sign) * rng.gamma(50.0, 1 / 50, size=n)
    watched = rng.integers(0, n_watched, n)
    return Observation(
        np.column_stack([sign, rng.normal(size=n)]), errors, np.ones(n), watched, watched
    )


@pytest.fixture(scope="module")
def watch():
    line = np.arange(20.0)
    return Watch(np.arange(20), np.abs(line[:, None] - line) / 20)


def test_an_error_model_finds_the_sign_that_tells_the_error(watch):
    rng = np.random.default_rng(0)
    model = fit_error_model(
        [_observed(rng) for _ in range(3)], watch, worst_distance=1.0, cross_validated=True
    )
    new = _observed(rng)
    expected, confidence = model.predict(new.signs, new.matched, 1.0)
    truth = 0.05 * np.exp(0.5 * new.signs[:, 0])
    assert np.corrcoef(np.log(expected), np.log(truth))[0, 1] > 0.95
    assert expected.mean() == pytest.approx(new.errors.mean(), rel=0.1)
    order = np.argsort(expected)
    assert (np.diff(confidence[order]) <= 1e-12).all(), (
        "the larger the error, the smaller the confidence"
    )
    assert abs(model.coefficients[1]) < 0.1 * abs(model.coefficients[0])


def test_signs_that_never_differ_say_nothing_and_are_no_error(watch):
    rng = np.random.default_rng(0)
    alike = [
        one._replace(signs=np.zeros_like(one.signs))
        for one in (_observed(rng, slope=0.0) for _ in range(3))
    ]
    model = fit_error_model(alike, watch, worst_distance=1.0, cross_validated=True)
    expected, _ = model.predict(np.zeros((5, 2)), np.zeros(5, dtype=int), 1.0)
    assert np.ptp(expected) < 1e-12


def test_errors_beyond_the_training_shapes_are_raised_by_the_square_of_the_misfit():
    flat = np.array([0.1, 0.1])
    model = ErrorModel(
        *(
            np.zeros(2),
            np.ones(2),
            np.ones(2),
            np.array([0.0, 1.0]),
            flat,
            1 - flat,
            np.full(4, 0.1),
        ),
        *(True, 0.1, 2.0, 0.5),
    )
    signs, p2p = np.zeros((3, 1)), np.zeros(3, dtype=int)
    assert model.misfit(3.0) == 1.5
    for misfit, factor in ((0.5, 1), (1.0, 1), (2.0, 4), (3.0, 5)):
        expected, confidence = model.predict(signs, p2p, misfit)
        np.testing.assert_allclose(expected, min(0.1 * factor, 0.5))  # up to chance
        np.testing.assert_allclose(confidence, 0.9 / max(1.0, misfit) ** 2)
