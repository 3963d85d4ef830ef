"""Errors of predicted landmarks, and the page that shows them."""

import re

import numpy as np
import pytest

from skfmap import Landmarks
from skfmap.datasets import make_sphere
from skfmap.report import LandmarkEvaluation, landmark_table, write_landmarks_page


@pytest.fixture
def evaluation():
    """Two balls: predictions are off by known lengths, in another order, and partly missing."""
    missing = [np.nan] * 3
    true = [
        Landmarks([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]], ["a", "b", "c"], name="first"),
        Landmarks([[1.0, 0, 0], missing, [0, 0, 1]], ["a", "b", "c"], name="<second>"),
    ]
    predicted = [
        Landmarks(
            [[0, 1, 0.3], [1, 0.4, 0], missing],
            ["b", "a", "c"],
            expected_error=[0.2, 0.5, np.nan],
            radius=[0.25, 0.45, np.nan],
        ),
        Landmarks([[1, 0, 0], [0, 1, 0], [2, 0, 1]], ["a", "b", "c"]),
    ]
    ball = make_sphere(n_subdivisions=2)
    return LandmarkEvaluation([ball, ball], predicted, true)


def test_errors_are_distances_between_landmarks_of_one_name(evaluation):
    assert evaluation.names == ("a", "b", "c")
    np.testing.assert_allclose(evaluation.errors, [[0.4, 0.3, np.nan], [0, np.nan, 2]], atol=1e-15)
    np.testing.assert_array_equal(evaluation.expected, [[0.5, 0.2, np.nan], [np.nan] * 3])
    np.testing.assert_array_equal(evaluation.radius, [[0.45, 0.25, np.nan], [np.nan] * 3])


def test_the_table_has_a_row_for_each_landmark(evaluation):
    header, rows = landmark_table(evaluation)
    a, b, c = (dict(zip(header, row, strict=True)) for row in rows)
    assert (a["n"], b["n"], c["n"]) == (2, 1, 1)
    assert (a["mean"], a["median"], a["largest"]) == pytest.approx((0.2, 0.2, 0.4))
    assert (a["on"], c["on"]) == ("first", "<second>")
    assert (a["within radius"], b["within radius"], c["within radius"]) == (1.0, 0.0, None)
    assert (a["expected"], b["expected"], c["expected"]) == (0.5, 0.2, None)


def test_errors_are_in_the_units_of_the_meshes(evaluation):
    scaled = LandmarkEvaluation(
        evaluation.meshes,
        [Landmarks(1000 * one.points, one.names) for one in evaluation.predicted],
        [Landmarks(1000 * one.points, one.names) for one in evaluation.true],
    )
    np.testing.assert_allclose(scaled.errors, 1000 * evaluation.errors, atol=1e-9)


def test_the_page_shows_the_worst_first_and_escapes_names(evaluation, tmp_path):
    text = write_landmarks_page(evaluation, tmp_path / "page.html").read_text(encoding="utf-8")
    headings = re.findall(r"<h3>(.*?)</h3>", text)
    assert headings == [
        "specimen &#x27;&lt;second&gt;&#x27;: mean error 1",
        "specimen &#x27;first&#x27;: mean error 0.35",
    ]
    assert text.count("data:image/png;base64,") == 2
    assert "<second>" not in text
    one = write_landmarks_page(evaluation, tmp_path / "one.html", n_worst=1).read_text()
    assert one.count("data:image/png;base64,") == 1


def test_a_page_of_specimens_without_a_known_landmark_says_so(tmp_path):
    ball = make_sphere(n_subdivisions=2)
    unknown = Landmarks([[np.nan] * 3], ["a"])
    evaluation = LandmarkEvaluation([ball], [unknown], [unknown])
    text = write_landmarks_page(evaluation, tmp_path / "page.html").read_text(encoding="utf-8")
    assert "No landmark is both predicted and known." in text
    assert landmark_table(evaluation)[1] == [("a", 0, *[None] * 6)]
