"""scikit-learn's callbacks (from 1.9), and fits that are interrupted."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning, NotFittedError
from sklearn.model_selection import GridSearchCV

import skfmap.learner
from skfmap.metrics import get_scorer
from skfmap.model_selection import PinnedReference

sklearn_callback = pytest.importorskip(
    "sklearn.callback", reason="callbacks came with scikit-learn 1.9"
)
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:sklearn")


class Recorder:
    """Keeps what it is told, and stops after some iterations."""

    def __init__(self, last=None):
        self.last, self.begun, self.models, self.data = last, [], [], []
        self.torn_down = 0

    def setup(self, estimator, context):
        self.root = context

    def teardown(self, estimator, context):
        self.torn_down += 1

    def on_fit_task_begin(self, estimator, context):
        self.begun.append((context.task_name, context.task_id))

    def on_fit_task_end(
        self, estimator, context, *, X=None, y=None, metadata=None, fitted_estimator=None
    ):
        self.models.append(fitted_estimator)
        self.data.append((X, y, metadata))
        return (
            self.last is not None
            and context.task_name == "iteration"
            and context.task_id + 1 >= self.last
        )


def test_every_iteration_is_told_with_a_model_that_predicts(
    make_learner, fitted, probed, collection
):
    recorder, learner = Recorder(), make_learner()
    X, y = probed[:5], collection.truths[:5]
    learner.set_callbacks(recorder).fit(X, y)
    assert_array_equal(learner.weights_, fitted.weights_)  # being watched changes nothing
    assert recorder.begun == [("fit", 0)] + [("iteration", i) for i in range(learner.n_iter_ + 1)]
    *iterations, unfinished, whole = recorder.models
    assert unfinished is None
    assert [model.loss_ for model in iterations] == learner.loss_curve_[1:]
    assert_array_equal(whole.predict(probed), learner.predict(probed))
    assert_array_equal(iterations[-1].predict(probed), learner.predict(probed))
    assert not np.array_equal(iterations[0].predict(probed), learner.predict(probed))
    assert recorder.data[0] == (X, y, None)
    assert recorder.torn_down == 1


def test_a_callback_stops_the_search_without_a_warning(make_learner, probed, collection):
    learner = make_learner(tol=1e-9).set_callbacks(Recorder(last=3))
    with warnings.catch_warnings():
        warnings.simplefilter("error", ConvergenceWarning)
        learner.fit(probed[:4], collection.truths[:4])
    assert learner.n_iter_ == 3
    same = make_learner(tol=1e-9, max_iter=3)
    with pytest.warns(ConvergenceWarning, match="in 3 iterations"):
        same.fit(probed[:4], collection.truths[:4])
    assert_array_equal(learner.weights_, same.weights_)


def test_sample_weights_are_handed_on(make_learner, probed, collection):
    recorder, share = Recorder(last=1), [1.0, 2.0, 1.0]
    make_learner().set_callbacks(recorder).fit(
        probed[:3], collection.truths[:3], sample_weight=share
    )
    assert recorder.data[0][2] == {"sample_weight": share}


def test_scores_are_monitored_over_the_iterations(make_learner, probed, collection):
    monitor = sklearn_callback.ScoringMonitor(scoring={"error": get_scorer("neg_geodesic_error")})
    learner = make_learner().set_callbacks(monitor).fit(probed[:4], collection.truths[:4])
    log = monitor.get_logs()
    rows = [row for row in log.data if row["task_name"] == "iteration"]
    assert len(rows) == learner.n_iter_
    assert rows[-1]["error"] == learner.score(probed[:4], collection.truths[:4])


def test_progress_bars_and_clones_and_pipelines(make_model, collection, capsys):
    pytest.importorskip("rich")
    model = make_model(weighting="unique")
    model.set_callbacks(sklearn_callback.ProgressBar())
    model.fit(collection.meshes[:3], collection.truths[:3])
    assert "WeightedFunctionalMapLearner" in capsys.readouterr().out


def test_callbacks_of_a_search_reach_the_learner(make_learner, probed, collection):
    recorder = Recorder()
    search = GridSearchCV(
        make_learner().set_callbacks(recorder), {"weighting": ["unique"]}, cv=PinnedReference(2)
    )
    search.fit(probed[:4], collection.truths[:4])
    assert ("iteration", 0) in recorder.begun


@pytest.mark.parametrize(
    ("holder", "at"),
    [(skfmap.learner.TrainingSet, "learn"), (skfmap.learner.CrossFitConfidence, "fit")],
    ids=["learning", "calibrating"],
)
def test_an_interrupted_fit_leaves_nothing_behind(
    holder, at, make_learner, probed, collection, monkeypatch
):
    def interrupt(*arguments, **keywords):
        raise KeyboardInterrupt

    learner, recorder = make_learner(), Recorder()
    before = clone(learner).fit(probed[:3], collection.truths[:3])
    expected = before.predict(probed)
    learner.set_callbacks(recorder)
    with monkeypatch.context() as patch:
        patch.setattr(holder, at, interrupt)
        for interrupted in (learner, before):
            with pytest.raises(KeyboardInterrupt):
                interrupted.fit(probed[:4], collection.truths[:4])
    assert recorder.torn_down == 1
    with pytest.raises(NotFittedError, match="not fitted yet"):
        learner.predict(probed)
    assert_array_equal(before.predict(probed), expected)
