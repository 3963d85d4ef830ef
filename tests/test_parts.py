"""Parts of the learner: refinements and confidences by word, by object, or of one's own."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV

import skfmap
from skfmap.learner import Confidence, CrossFitConfidence, Trust
from skfmap.learner.parts import make_part, same_part
from skfmap.model_selection import PinnedReference
from skfmap.refinement import (
    ICP,
    REFINEMENTS,
    BijectiveZoomOut,
    Refinement,
    ZoomOut,
    rematch_points,
)


class AllAlike(Refinement):
    """Match in all k functions alike, and count the fits."""

    def fit(self, training, matcher):
        self.n_training_ = len(training.shapes)  # returns nothing, as people forget to

    def refine(self, learned, spectral, match):
        C = match.learned_map
        return rematch_points(match, spectral, learned.reference.spectral, C, np.eye(len(C)))


@pytest.mark.parametrize(
    ("word", "part"),
    [("icp", ICP()), ("zoomout", ZoomOut()), ("bijective-zoomout", BijectiveZoomOut())],
)
def test_a_word_stands_for_its_object(make_learner, probed, collection, word, part):
    by_word, by_object = (
        make_learner(n_functions=8, refine=refine, confidence=None, tol=1e-2).fit(
            probed[:3], collection.truths[:3]
        )
        for refine in (word, part)
    )
    assert by_word.refine == word, "the parameter stays as it was given"
    assert by_object.refine is part
    assert by_object.refine_ is not part, "a clone is fitted"
    assert same_part(by_word.refine_, by_object.refine_)
    first, second = (learner.match(probed[5:])[0] for learner in (by_word, by_object))
    np.testing.assert_array_equal(first.p2p, second.p2p)
    np.testing.assert_array_equal(by_object.match(probed[5:], refine=word)[0].p2p, first.p2p)


def test_the_parameter_of_a_part_is_searched(make_model, collection):
    model = make_model(n_functions=8, refine=ZoomOut(), confidence=None, tol=1e-2)
    grid = {
        "learner__refine__step": [4, 11],
        "learner__refine": [ZoomOut(), BijectiveZoomOut(final_steps=1)],
    }
    search = GridSearchCV(model, grid, cv=PinnedReference(2), error_score="raise")
    search.fit(collection.meshes[:4], collection.truths[:4])
    assert search.cv_results_["mean_test_score"].shape == (4,)
    assert search.best_estimator_[-1].refine_.step == search.best_params_["learner__refine__step"]


@pytest.mark.parametrize(
    ("given", "told"),
    [({"refine": "zoomout"}, r"refine is 'zoomout'.*refine=ZoomOut\(\)"), ({}, "refine is None")],
)
def test_a_word_has_no_parameters_and_says_so(make_learner, given, told):
    with pytest.raises(ValueError, match=f"refine__step cannot be set while {told}"):
        make_learner(**given).set_params(refine__step=5)
    both = make_learner(**given).set_params(refine=ZoomOut(), refine__step=5)
    assert both.refine.step == 5


def test_a_refinement_of_ones_own_plugs_in(make_learner, probed, collection):
    learner = make_learner(n_functions=8, refine=AllAlike()).fit(probed[:4], collection.truths[:4])
    assert learner.refine_.n_training_ == 3
    (match,) = learner.match(probed[5:])
    (alike,) = learner.point_maps(probed[5:], matching="cut", n_stable=1.0, refine=None)
    assert (match.p2p == alike).mean() > 0.99, "an orthogonal basis does not change who is nearest"
    assert set(learner.error_models_) == {"unrefined", "refined"}
    assert clone(learner).refine is not learner.refine


def test_what_is_no_part_is_refused_with_the_words(make_learner, probed, collection):
    for wrong in ("better", 3, ZoomOut):
        with pytest.raises(ValueError, match=r"refine must be one of .*'bijective-zoomout'.*None"):
            make_learner(refine=wrong).fit(probed[:3], collection.truths[:3])
    with pytest.raises(ValueError, match="confidence must be one of 'cross-fit', None"):
        make_learner(confidence="sure").fit(probed[:3], collection.truths[:3])
    with pytest.raises(ValueError, match="step must be an integer at least 1"):
        make_learner(refine=ZoomOut(step=0)).fit(probed[:3], collection.truths[:3])
    with pytest.raises(ValueError, match="cv must be an integer at least 2"):
        make_learner(confidence=CrossFitConfidence(cv=1)).fit(probed[:3], collection.truths[:3])


def test_fitted_is_the_default_everywhere_and_none_switches_off(make_learner, probed, collection):
    learner = make_learner(
        n_functions=8, refine=ZoomOut(), n_stable=3, matching="cut", confidence=None
    )
    learner.fit(probed[:3], collection.truths[:3])
    fitted, off = learner.point_maps(probed[5:])[0], learner.point_maps(probed[5:], refine=None)[0]
    assert not np.array_equal(fitted, off)
    assert learner.match(probed[5:], refine=None)[0].refined_map is None
    explicit = learner.point_maps(
        probed[5:], matching="fitted", n_stable="fitted", refine="fitted"
    )[0]
    np.testing.assert_array_equal(explicit, fitted)
    half = learner.point_maps(probed[5:], n_stable=None, refine=None)[0]
    np.testing.assert_array_equal(half, learner.point_maps(probed[5:], n_stable=4, refine=None)[0])
    with pytest.raises(ValueError, match="matching must be one of 'cut', 'soft'; got None"):
        learner.point_maps(probed[5:], matching=None)


def test_a_word_makes_an_object_and_an_object_is_itself():
    given = ZoomOut(step=7)
    assert make_part(given, "refine", REFINEMENTS, Refinement) is given
    assert make_part(None, "refine", REFINEMENTS, Refinement) is None
    assert isinstance(make_part("zoomout", "refine", REFINEMENTS, Refinement), ZoomOut)


def test_parts_are_the_same_by_class_and_parameters():
    assert same_part(None, None)
    assert same_part(ZoomOut(step=3), ZoomOut(step=3))
    assert not same_part(ZoomOut(step=3), ZoomOut())
    assert not same_part(ZoomOut(), ICP())
    assert not same_part(None, ICP())
    weights = np.zeros(5000)
    assert not same_part(ZoomOut(step=weights), ZoomOut(step=np.where(np.arange(5000) == 7, 1, 0)))
    assert same_part(ZoomOut(step=weights), ZoomOut(step=weights.copy()))
    assert not same_part(ZoomOut(step=lambda: 1), ZoomOut(step=lambda: 1)), "nothing tells"


def test_matches_refined_otherwise_get_the_errors_of_the_match_before(
    make_learner, probed, collection
):
    learner = make_learner(n_functions=8, refine=ZoomOut(step=20)).fit(
        probed[:4], collection.truths[:4]
    )
    plain, other = (learner.match(probed[5:], refine=refine)[0] for refine in (None, "icp"))
    np.testing.assert_array_equal(plain.expected_error, other.expected_error)
    assert not np.array_equal(plain.expected_error, learner.match(probed[5:])[0].expected_error)
    again = skfmap.match(learner, probed[5:], refine=ZoomOut(step=20))[0]
    np.testing.assert_array_equal(again.expected_error, learner.match(probed[5:])[0].expected_error)


def test_an_override_is_checked_and_learns_nothing(make_learner, probed, collection):
    learner = make_learner(n_functions=8, refine=AllAlike(), confidence=None)
    learner.fit(probed[:3], collection.truths[:3])
    for wrong in (ZoomOut(step=0), ICP(n_steps=0), BijectiveZoomOut(final_steps=-1)):
        with pytest.raises(ValueError, match="must be an integer at least 1"):
            learner.match(probed[5:], refine=wrong)
    (fitted,) = learner.match(probed[5:])
    for same in (AllAlike(), learner.refine_):
        np.testing.assert_array_equal(learner.match(probed[5:], refine=same)[0].p2p, fitted.p2p)
    other = make_learner(n_functions=8, confidence=None).fit(probed[:3], collection.truths[:3])
    with pytest.raises(
        ValueError, match=r"AllAlike\(\) learns from training shapes; give it to the"
    ):
        other.match(probed[5:], refine=AllAlike())


@pytest.mark.parametrize(
    "parts", [{"refine": ZoomOut(step=0)}, {"confidence": CrossFitConfidence(cv=1)}]
)
def test_parameters_of_parts_are_checked_before_anything_is_learned(
    make_learner, probed, collection, parts, monkeypatch
):
    monkeypatch.setattr(skfmap.learner.TrainingSet, "learn", lambda self, **how: 1 / 0)
    with pytest.raises(ValueError, match="must be an integer at least"):
        make_learner(**parts).fit(probed[:3], collection.truths[:3])


class Sometimes(Refinement):
    """Leave the matches of some shapes alone."""

    def refine(self, learned, spectral, match):
        return (
            match if spectral.mesh.n_vertices < 500 else ZoomOut().refine(learned, spectral, match)
        )


def test_a_refinement_may_leave_a_match_alone(make_learner, probed, collection):
    learner = make_learner(n_functions=8, refine=Sometimes()).fit(probed[:5], collection.truths[:5])
    for match in learner.match(probed[4:]):
        assert np.isfinite(match.expected_error).all()


class Flat(Confidence):
    """Expect the same everywhere."""

    def fit(self, training, matcher):
        self.n_training_ = len(training.shapes)

    def assess(self, matcher, shape, solution, before, after, *, refined):
        flat = np.full(len(after.p2p), 0.1)
        return Trust(flat, 1 - flat, 1.0, self.is_familiar(solution))


def test_a_confidence_of_ones_own_plugs_in(make_learner, probed, collection):
    learner = make_learner(n_functions=8, confidence=Flat()).fit(probed[:4], collection.truths[:4])
    assert learner.confidence_.n_training_ == 3
    (match,) = learner.match(probed[5:])
    assert (match.expected_error == 0.1).all()
    assert match.familiar
    with pytest.raises(
        AttributeError, match=r"no attribute 'error_models_': its confidence_ .* has none"
    ):
        _ = learner.error_models_
    with pytest.raises(
        ValueError,
        match=r"through='auto' compares expected errors.*Flat\(\) of the learner does not provide",
    ):
        skfmap.BridgedLearner(learner).fit(probed[:4], collection.truths[:4])
    through = skfmap.BridgedLearner(learner, through="body2").fit(probed[:4], collection.truths[:4])
    assert through.bridge_errors_ == {}
    assert np.isfinite(through.match(probed[5:])[0].expected_error).all()


def test_what_is_read_from_a_part_cannot_be_set(fitted):
    with pytest.raises(AttributeError, match=r"weights_ is read from matcher_.weights, and cannot"):
        fitted.weights_ = np.ones(3)


class Nothing(Refinement):
    """Forget to return the match."""

    def refine(self, learned, spectral, match):
        pass


class TooMany(Refinement):
    """Ask for more functions than there are."""

    def refine(self, learned, spectral, match):
        n = 31
        return rematch_points(match, spectral, learned.reference.spectral, np.eye(n), np.eye(n))


@pytest.mark.parametrize(
    ("refine", "told"),
    [
        (Nothing(), r"refine\(\) of Nothing\(\) must return a PointMatch.*got NoneType"),
        (TooMany(), r"at most 30 \(the functions of SpectralBasis\); got shapes \(31, 31\)"),
    ],
)
def test_what_a_refinement_of_ones_own_does_wrong_is_told(fitted, probed, refine, told):
    with pytest.raises((TypeError, ValueError), match=told):
        fitted.match(probed[5:], refine=refine)


def test_matches_are_refined_by_default(probed, collection):
    learner = skfmap.WeightedFunctionalMapLearner(n_functions=8, tol=1e-2, confidence=None)
    learner.fit(probed[:4], collection.truths[:4])
    assert isinstance(learner.refine_, BijectiveZoomOut)
    assert learner.match(probed[5:])[0].refined_map is not None
    assert learner.match(probed[5:], refine=None)[0].refined_map is None


def test_a_refinement_saved_before_there_were_samples_matches_all_vertices():
    part = BijectiveZoomOut(final_steps=4)
    del part.__dict__["n_samples"]
    assert part.get_params() == {"step": 10, "final_steps": 4, "n_samples": None}
