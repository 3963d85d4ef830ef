"""The report says what the figures say, and nothing in it can do harm."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from skfmap import Correspondence, WeightedFunctionalMapLearner
from skfmap.metrics import PairErrors
from skfmap.model_selection import PinnedReference
from skfmap.report import Evaluation, evaluate, thin_out, write_report
from skfmap.report._verdict import findings_of_evaluation, findings_of_model


@pytest.fixture(scope="module")
def evaluation(fitted, probed, collection):
    return evaluate(fitted, probed[:5], collection.truths[:5], cv=2)


class _Reader(HTMLParser):
    """Collects texts, and counts tags that are not closed."""

    def __init__(self, text):
        super().__init__()
        self.texts, self.open, self.tags = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def test_each_shape_is_matched_by_a_model_that_has_not_seen_it(
    evaluation, fitted, probed, collection
):
    train, test = next(iter(PinnedReference(2).split(probed[:5])))
    own = clone(fitted).fit([probed[i] for i in train], [collection.truths[i] for i in train])
    for match, i in zip(own.match([probed[i] for i in test]), test, strict=True):
        np.testing.assert_array_equal(evaluation.matches[i - 1].p2p, match.p2p)
    assert [match.name for match in evaluation.matches] == collection.names[1:5]
    plain = own.set_params(weighting=None).fit(
        [probed[i] for i in train], [collection.truths[i] for i in train]
    )
    errors = plain.pair_errors([probed[i] for i in test], [collection.truths[i] for i in test])
    np.testing.assert_allclose(evaluation.naive_errors[test[0] - 1].direct, errors[0].direct)


def test_the_reference_of_the_model_is_kept_wherever_it_stands(
    fitted, probed, collection, evaluation
):
    order = [3, 2, 0, 1, 4]
    shuffled = evaluate(
        fitted, [probed[i] for i in order], [collection.truths[i] for i in order], cv=4, naive=False
    )
    assert {match.reference_name for match in shuffled.matches} == {"body0"}
    assert [match.name for match in shuffled.matches] == ["body3", "body2", "body1", "body4"]
    assert shuffled.naive_errors == []


def test_a_collection_without_the_reference_is_refused(fitted, probed, collection):
    with pytest.raises(ValueError, match="does not contain the model's reference, shape 'body0'"):
        evaluate(fitted, probed[1:5], collection.truths[1:5])


def test_other_points_are_scored_than_were_given(fitted, probed, collection):
    given = [truth.restrict(np.arange(0, 300, 2)) for truth in collection.truths[:5]]
    scored = [truth.restrict(np.arange(1, 300, 2)) for truth in collection.truths[:5]]
    result = evaluate(fitted, probed[:5], given, cv=2, y_scored=scored, naive=False)
    assert set(result.errors[0].vertices) <= set(scored[1].pairs[:, 0])


def test_many_points_are_thinned_out_alike():
    dense = Correspondence.from_template(np.arange(6000))
    one, other = thin_out([dense, dense])
    assert len(one.pairs) == 5000
    np.testing.assert_array_equal(one.pairs, other.pairs)


def test_the_page_is_whole_and_holds_what_it_shows(
    fitted, probed, collection, tmp_path, evaluation
):
    path = write_report(
        fitted, tmp_path / "report.html", probed[:5], collection.truths[:5], cv=2, n_worst=2
    )
    reader = _Reader(path.read_text(encoding="utf-8"))
    assert reader.open == []
    texts = " ".join(reader.texts)
    for heading in (
        "Can it be trusted?",
        "Worst matches",
        "Stable functions",
        "Weights",
        "Collection",
        "How the model was",
    ):
        assert heading in texts
    for errors in evaluation.errors:
        assert f"{100 * errors.mean():.1f}" in texts
    sources = [attrs["src"] for tag, attrs in reader.tags if tag == "img"]
    assert len(sources) == 5
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert not [tag for tag, _ in reader.tags if tag in ("script", "link", "iframe")]


def test_a_model_alone_has_a_page_too(model, tmp_path):
    text = write_report(model, tmp_path / "report.html").read_text(encoding="utf-8")
    assert "This page was written without cross-validation" in text
    assert "Worst matches" not in text


def test_names_are_escaped(fitted, tmp_path, evaluation):
    hostile = "<img src=x onerror=alert(1)>"
    matches = [replace(match, name=hostile) for match in evaluation.matches]
    told = Evaluation(evaluation.meshes, matches, evaluation.errors, [])
    text = write_report(fitted, tmp_path / "r.html", evaluation=told, title="<script>").read_text(
        encoding="utf-8"
    )
    assert hostile not in text
    assert "&lt;img src=x" in text
    assert "<script>" not in text


def test_half_of_the_data_or_no_model_is_refused(fitted, probed, tmp_path):
    with pytest.raises(ValueError, match="Give both X and y"):
        write_report(fitted, tmp_path / "r.html", probed[:5])
    with pytest.raises(NotFittedError, match="not fitted yet"):
        write_report(WeightedFunctionalMapLearner(), tmp_path / "r.html")
    with pytest.raises(ValueError, match="n_worst"):
        write_report(fitted, tmp_path / "r.html", n_worst=-1)


def _told(fitted, evaluation, errors, symmetric=None, naive=()):
    """Return levels and texts for made-up errors, one number for each shape."""
    made = [
        PairErrors(
            one.vertices,
            np.full(len(one.vertices), e),
            None if symmetric is None else np.full(len(one.vertices), s),
            one.weights,
        )
        for one, e, s in zip(evaluation.errors, errors, symmetric or errors, strict=True)
    ]
    plain = [
        replace(one, direct=np.full(len(one.direct), e))
        for one, e in zip(made, naive, strict=False)
    ]
    found = findings_of_evaluation(
        fitted, Evaluation(evaluation.meshes, evaluation.matches, made, plain)
    )
    return [(level, text) for level, text in found]


@pytest.mark.filterwarnings("ignore:An input array is constant")
@pytest.mark.parametrize(
    ("errors", "options", "level", "words"),
    [
        ([0.02] * 4, {}, "good", "2.0 % of sqrt"),
        ([0.07] * 4, {}, "doubtful", "7.0 % of sqrt"),
        ([0.3] * 4, {}, "bad", "30.0 % of sqrt"),
        ([0.02, 0.02, 0.02, 0.2], {}, "doubtful", "body4 has more than 2.5 times"),
        (
            [0.3, 0.02, 0.02, 0.02],
            {"symmetric": [0.02] * 4},
            "bad",
            "Left and right are exchanged on 1 of 4 shapes: body1",
        ),
        ([0.02] * 4, {"symmetric": [0.3] * 4}, "good", "distinguished on every shape"),
        (
            [0.02] * 4,
            {"naive": [0.05] * 4},
            "good",
            "with learned weights and 5.0 % without them",
        ),
        (
            [0.05] * 4,
            {"naive": [0.02] * 4},
            "doubtful",
            "with learned weights and 2.0 % without them",
        ),
        ([0.9] * 4, {}, "doubtful", "too low"),
        ([0.0001] * 4, {}, "doubtful", "too high"),
    ],
)
def test_sentences_say_what_the_figures_say(fitted, evaluation, errors, options, level, words):
    told = _told(fitted, evaluation, errors, **options)
    assert any(one == level and words in text for one, text in told), told


def test_a_model_says_what_it_knows_of_itself(fitted, make_learner, probed, collection):
    assert [level for level, _ in findings_of_model(fitted)] == ["good"]
    with pytest.warns(match="did not converge"):
        hasty = make_learner(max_iter=1, tol=0).fit(probed[:2], collection.truths[:2])
    texts = [text for level, text in findings_of_model(hasty) if level == "doubtful"]
    assert any("without converging" in text for text in texts)
    assert any("only one training shape besides the reference" in text for text in texts)
    at_bounds = np.exp(np.full(len(hasty.weights_), 7.0))
    hasty.matcher_ = replace(hasty.matcher_, weights=at_bounds)
    assert any(
        re.search(r"of \d+ weights are at the bounds", text) for _, text in findings_of_model(hasty)
    )
