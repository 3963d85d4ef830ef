"""A verdict is good only where its figures are, and never by accident."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from skfmap.metrics import PairErrors
from skfmap.plotting import ReliabilityDisplay
from skfmap.report import Evaluation, write_report
from skfmap.report._verdict import expected_and_true, findings_of_evaluation, trusted_part

N = 400


def _evaluation(expected, true, *, symmetric=None, naive=(), weights=1.0):
    """Return an evaluation of shapes whose vertices have these expected and true errors."""
    matches, errors = [], []
    for i, (one, own) in enumerate(zip(expected, true, strict=True)):
        n = len(own)
        matches.append(SimpleNamespace(name=f"body{i}", expected_error=np.asarray(one)))
        other = None if symmetric is None else np.full(n, symmetric[i])
        errors.append(PairErrors(np.arange(n), np.asarray(own), other, np.full(n, weights)))
    plain = [PairErrors(np.arange(5), np.full(5, e), None, np.ones(5)) for e in naive]
    return Evaluation([None] * len(matches), matches, errors, plain)


def _told(evaluation):
    return findings_of_evaluation(SimpleNamespace(weighting="function"), evaluation)


def _order(expected, true):
    """Return the last finding: whether expected errors tell good points from bad."""
    return _told(_evaluation([expected], [true]))[-1]


def _related(correlation, n=N, seed=0):
    """Return expected and true errors of about this rank correlation."""
    rng = np.random.default_rng(seed)
    shared, own = rng.standard_normal((2, n))
    other = correlation * shared + np.sqrt(1 - correlation**2) * own
    return 0.03 * np.exp(shared), 0.03 * np.exp(other)


@pytest.mark.parametrize("noise", [0.0, 1e-15, 1e-9])
def test_equal_expected_errors_tell_nothing(noise):
    true = np.linspace(0.0, 0.1, N)
    level, text = _order(0.05 * (1 + noise * np.arange(N) / N), true)
    assert level == "doubtful"
    assert "the same everywhere, so they do not distinguish" in text


@pytest.mark.parametrize("true", [np.zeros(N), np.full(N, 0.02)])
def test_equal_true_errors_show_nothing(true):
    level, text = _order(np.linspace(0.01, 0.03, N), true)
    assert level == "doubtful"
    assert "True errors are the same everywhere" in text


@pytest.mark.parametrize(
    ("correlation", "level"),
    [
        (-0.8, "bad"),
        (-0.07, "bad"),
        (0.0, "bad"),
        (0.28, "doubtful"),
        (0.7, "good"),
        (0.95, "good"),
    ],
)
def test_a_weak_rank_correlation_is_not_good(correlation, level):
    found = _order(*_related(correlation, 4000))
    assert found.level == level
    assert "good from 0.35" in found.text


def test_a_correlation_of_few_points_may_be_chance():
    """Points that have nothing in common are hardly ever called good, however few they are."""
    assert _order(np.arange(1.0, 4), np.arange(1.0, 4)).level == "doubtful"
    for n in (6, 12, 25, 50):
        levels = [_order(*_related(0.0, n, seed)).level for seed in range(100)]
        assert levels.count("good") <= 6, n


def test_the_trusted_half_is_what_the_sentence_says():
    expected, true = np.linspace(0.01, 0.02, N), np.repeat([0.01, 0.04], N // 2)
    assert (
        "more trusted half of the points 1.0 %, of all points 2.5 %" in _order(expected, true).text
    )


def test_points_that_are_trusted_alike_are_one_half():
    assert trusted_part(np.full(6, 0.1) + 1e-15 * np.arange(6)).all()
    np.testing.assert_array_equal(trusted_part(np.arange(4.0)), [True, True, False, False])


def test_vertices_without_an_expectation_do_not_count():
    expected, true = _related(0.9)
    expected[::7], true[3::7] = np.nan, np.nan
    known = np.isfinite(expected) & np.isfinite(true)
    evaluation = _evaluation([expected], [np.nan_to_num(true, nan=0.0)])
    evaluation.errors[0].direct[~np.isfinite(true)] = np.nan
    for found, given in zip(expected_and_true(evaluation), (expected, true), strict=True):
        np.testing.assert_array_equal(found, given[known])


def test_a_model_that_expects_nothing_is_not_good():
    level, text = _order(np.full(N, np.nan), np.full(N, 0.01))
    assert level == "doubtful"
    assert "No point has both an expected and a true error" in text


def test_shapes_without_known_points_are_not_scored():
    expected, true = _related(0.9)
    without = _told(_evaluation([expected, expected[:0]], [true, true[:0]]))
    assert without == _told(_evaluation([expected], [true]))
    (alone,) = _told(_evaluation([expected], [true], weights=0.0))
    assert alone.level == "doubtful"
    assert "No shape left out has known correspondences" in alone.text


def test_one_shape_says_little():
    true = np.full(N, 0.01)
    assert _told(_evaluation([true], [true]))[0].level == "doubtful"
    assert _told(_evaluation([true] * 2, [true] * 2))[0].level == "good"
    assert _told(_evaluation([true], [20 * true]))[0].level == "bad"


@pytest.mark.parametrize(
    ("direct", "symmetric", "level", "words"),
    [
        (0.02, 0.3, "good", "distinguished on every shape"),
        (0.3, 0.02, "bad", "right are exchanged on 2 of 2 shapes"),
        (0.45, 0.4, "doubtful", "are distinguished on 2 of 2 shapes: body0, body1"),
        (0.02, 0.02, "doubtful", "It is unclear whether left and right"),
        (0.02, np.nan, "doubtful", "It is unclear whether left and right"),
    ],
)
def test_sides_are_told_apart_only_where_one_fits_clearly_better(direct, symmetric, level, words):
    errors = [np.full(N, direct)] * 2
    found = _told(_evaluation(errors, errors, symmetric=[symmetric] * 2))[1]
    assert found.level == level
    assert words in found.text


@pytest.mark.parametrize(
    ("before", "level", "words"),
    [
        (0.030, "good", "2.0 % with learned weights and 3.0 % without them."),
        (0.0201, "doubtful", "they do not help"),
        (0.0199, "doubtful", "they do not help"),
        (0.0100, "doubtful", "they make it worse (good is"),
    ],
)
def test_weights_do_not_help_by_a_hair(before, level, words):
    true = [np.full(N, 0.02)] * 2
    found = next(
        one
        for one in _told(_evaluation(true, true, naive=[before] * 2))
        if "with learned weights" in one.text
    )
    assert found.level == level
    assert words in found.text


def test_nothing_stands_out_among_errors_below_an_edge():
    small = [np.full(N, e) for e in (0.0, 0.0, 0.0, 0.01)]
    assert not any("times the median error" in text for _, text in _told(_evaluation(small, small)))
    large = [*small[:3], np.full(N, 0.02)]
    assert any(
        "body3 has more than 2.5 times the median" in text
        for _, text in _told(_evaluation(large, large))
    )


@pytest.mark.parametrize("level", [0.0, 0.05])
def test_equal_expected_errors_can_be_drawn(level):
    true = np.linspace(0.0, 2 * level, N)
    display = ReliabilityDisplay.from_predictions(np.full(N, level), true)
    np.testing.assert_allclose(display.line_.get_xydata(), [[level, level]], atol=1e-15)
    assert display.ax_.get_xlim()[1] > 0
    display.figure_.canvas.draw()


def test_vertices_without_a_value_are_not_drawn():
    expected = np.linspace(0.01, 0.1, N)
    holes = expected.copy()
    holes[::2] = np.nan
    drawn = ReliabilityDisplay.from_predictions(holes, expected)
    kept = ReliabilityDisplay.from_predictions(expected[1::2], expected[1::2])
    np.testing.assert_allclose(drawn.line_.get_xydata(), kept.line_.get_xydata())
    with pytest.raises(ValueError, match="known at only 0 vertices, but 10"):
        ReliabilityDisplay.from_predictions(np.full(N, np.nan), expected)


@pytest.mark.parametrize(
    ("level", "words"), [(0.05, "the same everywhere"), (np.nan, "No point has both")]
)
def test_a_page_is_written_where_expected_errors_say_nothing(
    level, words, fitted, probed, collection, tmp_path
):
    errors = fitted.pair_errors(probed[1:3], collection.truths[1:3])
    matches = [
        replace(one, expected_error=np.full(len(one.p2p), level))
        for one in fitted.match(probed[1:3])
    ]
    evaluation = Evaluation([shape.spectral.mesh for shape in probed[1:3]], matches, errors, [])
    text = write_report(fitted, tmp_path / "r.html", evaluation=evaluation, n_worst=1).read_text(
        encoding="utf-8"
    )
    assert words in text
    assert ">nan<" not in text
