"""The estimators in scikit-learn's searches, cross-validations and splitters."""

from dataclasses import replace

import numpy as np
import pytest
import sklearn
from numpy.testing import assert_array_equal
from sklearn.base import clone
from sklearn.experimental import enable_halving_search_cv  # noqa: F401
from sklearn.model_selection import (
    GridSearchCV,
    HalvingGridSearchCV,
    KFold,
    LeaveOneOut,
    LeavePOut,
    RandomizedSearchCV,
    RepeatedKFold,
    ShuffleSplit,
    cross_val_predict,
    cross_val_score,
    cross_validate,
)
from sklearn.pipeline import Pipeline, make_pipeline

import skfmap
from skfmap import SpectralBasis
from skfmap.descriptors import HeatKernelSignature, WaveKernelSignature
from skfmap.metrics import get_scorer, get_scorer_names, multi_scorer
from skfmap.model_selection import PinnedReference


@pytest.fixture(scope="session")
def make_learner(make_learner):
    """Return the function that makes learners; searches compare scores, and calibrate nothing."""
    return lambda **parameters: make_learner(**{"confidence": None, **parameters})


@pytest.fixture(scope="module")
def fitted(make_learner, probed, collection):
    """Return a learner of these; the one of the session would be without errors for all tests."""
    return make_learner(memory=None).fit(probed[:5], collection.truths[:5])


@pytest.fixture(scope="module")
def memory(tmp_path_factory):
    """Return a cache of bases and probes, which these tests do not change."""
    return str(tmp_path_factory.mktemp("cache"))


def test_cross_validation_with_one_reference(make_learner, fitted, probed, collection):
    cv = PinnedReference(LeaveOneOut())
    scores = cross_val_score(make_learner(), probed, collection.truths, cv=cv, error_score="raise")
    assert scores.shape == (5,)
    assert (scores < 0).all()
    assert (scores > -0.1).all()
    assert scores[-1] == fitted.score(probed[5:], collection.truths[5:])


def test_plain_cross_validation_works_too(make_learner, probed, collection):
    scores = cross_val_score(make_learner(), probed, collection.truths, cv=3, error_score="raise")
    assert (scores > -0.15).all()


@pytest.mark.parametrize(
    "grid",
    [
        {"learner__epsilon": ["auto", 1.0]},
        {"learner__weighting": [None, "category"], "learner__matching": ["cut"]},
        {"probes__hks__n_functions": [2, 5], "probes__families": ["paper"]},
        {
            "probes__families": [
                None,
                "paper",
                [("hks", HeatKernelSignature(20)), ("wks", WaveKernelSignature(20))],
            ]
        },
        {"basis__n_components": [20, 30], "basis__laplacian": ["cotangent", "robust"]},
    ],
    ids="+".join,
)
def test_grid_search(make_model, collection, grid, memory):
    X, y = collection.meshes[:4], collection.truths[:4]
    model = make_model(memory=memory, weighting="unique")
    search = GridSearchCV(model, grid, cv=PinnedReference(2), error_score="raise")
    search.fit(X, y)
    assert np.isfinite(search.cv_results_["mean_test_score"]).all()
    best = clone(search.estimator).set_params(**clone(search.best_params_, safe=False)).fit(X, y)
    assert_array_equal(search.predict(collection.meshes[:1]), best.predict(collection.meshes[:1]))


def test_scorers_in_a_search(make_learner, symmetric_probed, symmetric_collection):
    scoring = {
        kind: get_scorer(f"neg_{kind}geodesic_error") for kind in ("", "consistent_", "per_vertex_")
    }
    search = GridSearchCV(
        make_learner(),
        {"weighting": [None]},
        cv=PinnedReference(LeaveOneOut()),
        scoring=scoring,
        refit="consistent_",
        error_score="raise",
    ).fit(symmetric_probed, symmetric_collection.truths)
    direct, consistent, per_vertex = (
        search.cv_results_[f"mean_test_{kind}"][0] for kind in scoring
    )
    assert direct <= consistent <= per_vertex < 0


def test_match_takes_learners_pipelines_and_searches(model, collection, probed):
    search = GridSearchCV(clone(model), {"learner__epsilon": ["auto"]}, cv=[([0, 1], [2])])
    search.fit(collection.meshes[:5], collection.truths[:5])
    inner = GridSearchCV(clone(model[-1]), {"epsilon": ["auto"]}, cv=[([0, 1], [2])])
    inner.fit(probed[:5], collection.truths[:5])
    expected = model[-1].match(probed[5:])[0]
    given = [
        (model[-1], probed[5:]),
        (Pipeline([("learner", model[-1])]), probed[5:]),
        (model, collection.meshes[5:]),
        (search, collection.meshes[5:]),
        (inner, probed[5:]),
    ]
    for form, X in given:
        (match,) = skfmap.match(form, X)
        assert_array_equal(match.p2p, expected.p2p)
        assert match.name == "body5"
        assert match.reference_name == "body0"
        assert_array_equal(skfmap.functional_maps(form, X)[0], expected.functional_map)


def test_match_refuses_other_models(probed):
    for other in (SpectralBasis(), make_pipeline(SpectralBasis()), None, "model"):
        with pytest.raises(TypeError, match="WeightedFunctionalMapLearner"):
            skfmap.match(other, probed)


def test_sample_weights_are_routed(make_learner, probed, collection):
    share, cv = np.array([1.0, 1, 1, 5, 1, 1]), PinnedReference(2)
    with sklearn.config_context(enable_metadata_routing=True):
        learner = (
            make_learner(weighting=None)
            .set_fit_request(sample_weight=True)
            .set_score_request(sample_weight=True)
        )
        search = GridSearchCV(learner, {"epsilon": ["auto"]}, cv=cv, error_score="raise")
        search.fit(probed, collection.truths, sample_weight=share)
    (train, test), _ = cv.split(probed)
    part = make_learner(weighting=None)
    part.fit(
        [probed[i] for i in train],
        [collection.truths[i] for i in train],
        sample_weight=share[train],
    )
    by_hand = part.score(
        [probed[i] for i in test], [collection.truths[i] for i in test], sample_weight=share[test]
    )
    assert search.cv_results_["split0_test_score"][0] == by_hand


def test_cross_validate_returns_fitted_models_that_match(make_model, collection):
    result = cross_validate(
        make_model(weighting=None),
        collection.meshes[:4],
        collection.truths[:4],
        cv=PinnedReference(LeaveOneOut()),
        scoring={"error": get_scorer("neg_geodesic_error")},
        return_estimator=True,
        return_train_score=True,
        error_score="raise",
    )
    assert (result["train_error"] < 0).all()
    for model in result["estimator"]:
        (match,) = skfmap.match(model, collection.meshes[5:])
        assert match.reference_name == "body0"


@pytest.mark.parametrize(
    "cv",
    [
        2,
        LeaveOneOut(),
        LeavePOut(2),
        KFold(2, shuffle=True, random_state=1),
        RepeatedKFold(n_splits=2, n_repeats=2, random_state=0),
        ShuffleSplit(2, test_size=1, random_state=0),
        [([0, 1], [2])],
    ],
    ids=lambda cv: type(cv).__name__,
)
def test_any_splitter(cv, make_learner, probed, collection):
    scores = cross_val_score(
        make_learner(weighting=None),
        probed[:4],
        collection.truths[:4],
        cv=PinnedReference(cv),
        error_score="raise",
    )
    assert (scores < 0).all()


@pytest.mark.parametrize("container", [list, tuple, "array"])
def test_searches_take_lists_tuples_and_object_arrays(container, make_model, collection, memory):
    def wrap(items):
        if container != "array":
            return container(items)
        array = np.empty(len(items), dtype=object)
        array[:] = items
        return array

    X, y = wrap(collection.meshes[:4]), wrap(collection.truths[:4])
    search = GridSearchCV(
        make_model(memory=memory),
        {"learner__weighting": [None]},
        cv=PinnedReference(2),
        error_score="raise",
    ).fit(X, y)
    assert search.score(X, y) < 0
    assert len(skfmap.match(search, X)) == 4


def test_ragged_correspondences_as_plain_arrays(make_learner, probed, collection):
    y = [truth.pairs[: 300 - 20 * i] for i, truth in enumerate(collection.truths[:4])]
    scores = cross_val_score(
        make_learner(weighting=None), probed[:4], y, cv=PinnedReference(3), error_score="raise"
    )
    assert (scores < 0).all()


def test_a_list_of_grids_asks_whether_learning_pays(make_learner, probed, collection):
    """The naive baseline has no epsilon to search, and learned weights need no other alpha."""
    grids = [
        {"weighting": [None], "alpha": [1e-3, 1e-2]},
        {"weighting": ["unique", "category"], "epsilon": ["auto"]},
    ]
    search = GridSearchCV(make_learner(), grids, cv=PinnedReference(2), error_score="raise")
    search.fit(probed[:4], collection.truths[:4])
    assert len(search.cv_results_["params"]) == 4
    assert search.best_score_ == search.cv_results_["mean_test_score"].max()
    (best,) = skfmap.match(search, probed[5:])
    again = (
        clone(search.estimator)
        .set_params(**search.best_params_)
        .fit(probed[:4], collection.truths[:4])
    )
    assert_array_equal(best.p2p, again.match(probed[5:])[0].p2p)


def test_results_of_a_search_make_a_frame(make_learner, probed, collection):
    pandas = pytest.importorskip("pandas")
    search = GridSearchCV(
        make_learner(), {"weighting": [None, "unique"]}, cv=PinnedReference(2), error_score="raise"
    )
    frame = pandas.DataFrame(search.fit(probed[:4], collection.truths[:4]).cv_results_)
    assert [params["weighting"] for params in frame["params"]] == [
        None,
        "unique",
    ]  # "param_weighting" has NaN for None
    assert frame["rank_test_score"].min() == 1


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.DisagreementWarning")
def test_stable_functions_are_searched_over_without_another_fit_changing(
    make_learner, probed, collection
):
    search = GridSearchCV(
        make_learner(weighting=None, matching="cut"),
        {"n_stable": [2, 0.5, 1.0]},
        cv=PinnedReference(2),
    ).fit(probed[:5], collection.truths[:5])
    assert (
        search.cv_results_["mean_test_score"][0] < search.best_score_
    )  # two functions tell no points apart


def test_randomized_search_is_repeatable(make_learner, probed, collection):
    space = {"epsilon": [0.01, 0.1, 1.0, "auto"], "weighting": ["unique", "category"]}
    runs = [
        RandomizedSearchCV(
            make_learner(),
            space,
            n_iter=2,
            random_state=0,
            cv=PinnedReference(2),
            n_jobs=n_jobs,
            error_score="raise",
        ).fit(probed[:4], collection.truths[:4])
        for n_jobs in (1, 2)
    ]
    assert runs[0].cv_results_["params"] == runs[1].cv_results_["params"]
    assert_array_equal(
        runs[0].cv_results_["mean_test_score"], runs[1].cv_results_["mean_test_score"]
    )


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_successive_halving_over_iterations(make_learner, probed, collection):
    search = HalvingGridSearchCV(
        Pipeline([("learner", make_learner())]),
        {"learner__weighting": ["unique", "category"], "learner__alpha": [1e-3, 1e-2]},
        resource="learner__max_iter",
        min_resources=4,
        max_resources=16,
        factor=2,
        cv=PinnedReference(2),
        error_score="raise",
    ).fit(probed[:4], collection.truths[:4])
    assert search.n_resources_ == [4, 8, 16]
    assert search.best_estimator_["learner"].max_iter == 16
    assert len(skfmap.match(search, probed[4:])) == 2


def test_successive_halving_over_samples_loses_the_reference(make_learner, probed, collection):
    """Its subsamples are drawn at random: fold by fold another reference. The docs say not to."""
    learner = make_learner(weighting=None, reference="body0")
    search = HalvingGridSearchCV(
        learner,
        {"alpha": [1e-3, 1e-2]},
        min_resources=4,
        max_resources=6,
        factor=1.5,
        cv=PinnedReference(2),
        random_state=0,
        error_score="raise",
    )
    with pytest.raises(
        ValueError, match=r"must name exactly one of the training shapes.*PinnedReference"
    ):
        search.fit(probed, collection.truths)


def test_nested_searches_pin_both_loops(make_learner, probed, collection):
    X, y = probed[:4], collection.truths[:4]
    inner = GridSearchCV(
        make_learner(),
        {"weighting": [None, "unique"]},
        cv=PinnedReference(2),
        n_jobs=1,
        error_score="raise",
    )
    result = cross_validate(
        inner,
        X,
        y,
        cv=PinnedReference(LeaveOneOut()),
        n_jobs=2,
        return_estimator=True,
        error_score="raise",
    )
    assert (result["test_score"] > -0.15).all()
    first, *_ = searches = result["estimator"]
    assert [search.best_estimator_.reference_.name for search in searches] == ["body0"] * 3
    by_hand = clone(inner).fit([X[0], *X[2:]], [y[0], *y[2:]])
    assert_array_equal(by_hand.cv_results_["mean_test_score"], first.cv_results_["mean_test_score"])


@pytest.mark.parametrize("name", get_scorer_names())
def test_every_scorer_works_in_a_search(name, make_learner, symmetric_probed, symmetric_collection):
    truths = symmetric_collection.truths
    if name == "neg_landmark_error":  # of points that were measured at vertices
        truths = [
            replace(truth, coordinates=mesh.vertices[truth.pairs[:, 0]])
            for truth, mesh in zip(truths, symmetric_collection.meshes, strict=True)
        ]
    scores = cross_val_score(
        make_learner(weighting=None),
        symmetric_probed,
        truths,
        cv=PinnedReference(3),
        scoring=get_scorer(name),
        error_score="raise",
    )
    assert np.isfinite(scores).all()


def test_scorers_that_forgive_symmetry_need_symmetric_answers(fitted, probed, collection):
    for name in ("neg_consistent_geodesic_error", "neg_per_vertex_geodesic_error"):
        with pytest.raises(ValueError, match="symmetric"):
            get_scorer(name)(fitted, probed[5:], collection.truths[5:])


def test_predictions_of_a_cross_validation_are_of_the_left_out_shapes(
    make_learner, probed, collection
):
    """Without a pin each sample is left out once, the reference too: its fold has another one."""
    maps = cross_val_predict(make_learner(weighting=None), probed, collection.truths, cv=KFold(3))
    assert maps.shape == (6, 12, 6)


# Several scores of one matching

_FORGIVING = [f"neg_{kind}geodesic_error" for kind in ("", "consistent_", "per_vertex_")]


def test_several_scores_are_those_of_the_single_scorers(
    make_learner, symmetric_probed, symmetric_collection, monkeypatch
):
    truths, share = symmetric_collection.truths, [1.0, 3.0]
    learner = make_learner(weighting=None).fit(symmetric_probed[:2], truths[:2])
    X, y = symmetric_probed[2:], truths[2:]
    single = {name: get_scorer(name)(learner, X, y, share) for name in _FORGIVING}
    usual, calls = type(learner).pair_errors, []

    def counted(*given, **how):
        calls.append(given)
        return usual(*given, **how)

    monkeypatch.setattr(type(learner), "pair_errors", counted)
    assert multi_scorer(*_FORGIVING)(learner, X, y, share) == single
    assert len(calls) == 1


def test_a_search_takes_several_scores(make_learner, probed, collection):
    search = GridSearchCV(
        make_learner(),
        {"n_stable": [5, 10]},
        cv=PinnedReference(2),
        scoring=multi_scorer("neg_geodesic_error"),
        refit="neg_geodesic_error",
        error_score="raise",
    ).fit(probed, collection.truths)
    alone = GridSearchCV(
        make_learner(),
        {"n_stable": [5, 10]},
        cv=PinnedReference(2),
        scoring=get_scorer("neg_geodesic_error"),
        error_score="raise",
    ).fit(probed, collection.truths)
    assert_array_equal(
        search.cv_results_["mean_test_neg_geodesic_error"], alone.cv_results_["mean_test_score"]
    )
    assert search.best_params_ == alone.best_params_


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "distinct names"),
        (["neg_geodesic_error"] * 2, "distinct names"),
        (["accuracy"], "must be one of"),
    ],
)
def test_several_scores_are_named_each_once(names, message):
    with pytest.raises(ValueError, match=message):
        multi_scorer(*names)
    with pytest.raises(ValueError, match="does not take reference_y"):
        multi_scorer("neg_landmark_error", reference_y=[[0, 0]])
