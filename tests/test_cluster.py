"""The same numbers on a cluster: dask's, on this machine."""

import joblib
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV

import skfmap.functional.learning
from skfmap.model_selection import PinnedReference

distributed = pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*:DeprecationWarning"),
    pytest.mark.filterwarnings("ignore:.*:ResourceWarning"),
    pytest.mark.filterwarnings("ignore:Sending large graph:UserWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def client():
    """Return a client of two workers in processes of their own."""
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def test_a_fit_on_a_cluster_gives_the_same_and_keeps_its_gradients(
    client, make_model, collection, monkeypatch
):
    X, y = collection.meshes[:4], collection.truths[:4]
    serial = make_model().fit(X, y)
    at_home, original = [], skfmap.functional.learning.optimize_weights
    monkeypatch.setattr(
        skfmap.functional.learning,
        "optimize_weights",
        lambda *a, **k: at_home.append(1) or original(*a, **k),
    )
    with joblib.parallel_config(backend="dask"):
        spread = make_model().fit(X, y)
        matches = skfmap.match(spread, collection.meshes[4:])
    assert at_home == [1]
    assert_array_equal(spread["learner"].weights_, serial["learner"].weights_)
    assert spread["learner"].loss_curve_ == serial["learner"].loss_curve_
    for one, other in zip(matches, skfmap.match(serial, collection.meshes[4:]), strict=True):
        assert_array_equal(one.p2p, other.p2p)
        assert_array_equal(one.expected_error, other.expected_error)
    for modules in client.run(_loaded).values():
        assert {
            "skfmap.basis",
            "skfmap.descriptors",
            "skfmap.ground_truth",
        } <= modules  # workers took part


def _loaded():
    import sys  # noqa: PLC0415

    return {name for name in sys.modules if name.startswith("skfmap.")}


@pytest.mark.usefixtures("client")
def test_a_grid_search_on_a_cluster_gives_the_same(make_model, collection, tmp_path):
    X, y = collection.meshes[:4], collection.truths[:4]
    search = GridSearchCV(
        make_model(memory=str(tmp_path)),
        {"learner__weighting": [None, "unique"]},
        cv=PinnedReference(2),
        error_score="raise",
    )
    with joblib.parallel_config(backend="dask"):
        spread = clone(search).fit(X, y)
    serial = clone(search).fit(X, y)
    for split in range(2):
        key = f"split{split}_test_score"
        assert_array_equal(spread.cv_results_[key], serial.cv_results_[key])
    assert spread.best_params_ == serial.best_params_
    assert np.isfinite(spread.best_score_)
