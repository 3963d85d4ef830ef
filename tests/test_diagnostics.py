"""What a fit shows that a person should know, from small training sets that show it."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sklearn.exceptions import ConvergenceWarning

from skfmap import Correspondence
from skfmap.exceptions import DisagreementWarning, SkippedShapeWarning, StabilityWarning
from skfmap.learner import LearningOptions, TrainingSet
from skfmap.learner.diagnostics import Finding, diagnose, diagnose_new_shapes, is_mirrored, report
from skfmap.learner.matcher import Solution
from skfmap.registration import Quality
from skfmap.shapes.usable import pick_usable

_OPTIONS = LearningOptions(tol=1e-3)


@pytest.fixture(scope="module")
def training(probed, collection):
    return TrainingSet.from_samples(
        probed[:5], collection.truths[:5], n_functions=12, options=_OPTIONS
    )


@pytest.fixture(scope="module")
def learned(training):
    return training.learn(max_iter=30)


def _of(category, findings):
    return [finding.message for finding in findings if finding.category is category]


def test_a_sound_fit_has_nothing_to_tell(training):
    learned = training.learn(max_iter=1000)
    assert learned.optimum.converged
    assert diagnose(training, learned, np.array([np.nan, 0.02, 0.03, 0.02, 0.03])) == []


def test_weights_at_their_bounds_are_told(training, learned):
    for logs, told in (
        ([7.0, 7, 0], "upper bound of the search; lower alpha"),
        ([-7.0, -7, 0], "lower bound"),
    ):
        at_bounds = replace(learned, weights=np.exp(logs))
        (message,) = _of(StabilityWarning, diagnose(training, at_bounds, None))
        assert message.startswith(f"2 of 3 weights are at the {told}")


def test_a_search_that_did_not_converge_is_told_with_its_tolerance(training, learned):
    stuck = replace(
        learned, optimum=replace(learned.optimum, converged=False, n_iter=7, message="too few")
    )
    (message,) = _of(ConvergenceWarning, diagnose(training, stuck, None))
    assert "in 7 iterations" in message
    assert "tol 0.001" in message
    stopped = replace(stuck, optimum=replace(stuck.optimum, stopped=True))
    assert _of(ConvergenceWarning, diagnose(training, stopped, None)) == []


def test_an_epsilon_that_sees_nothing_is_told(training, learned):
    blind = replace(training, options=training.options._replace(epsilon=1e9))
    at_start = replace(learned.optimum, n_iter=0, loss_curve=[1e-9])
    (message,) = _of(StabilityWarning, diagnose(blind, replace(learned, optimum=at_start), None))
    assert message.startswith("No weight was changed")
    assert _of(StabilityWarning, diagnose(training, replace(learned, optimum=at_start), None)) == []


def test_one_training_shape_far_above_the_others_is_named_by_its_index(training, learned):
    errors = np.array([np.nan, 0.02, 0.03, 0.3, 0.02])
    (message,) = _of(DisagreementWarning, diagnose(training, learned, errors))
    assert "X[3] ('body3') (0.30); the typical value is 0.03" in message
    (message,) = _of(
        DisagreementWarning, diagnose(training, learned, np.where(np.isnan(errors), errors, 0.3))
    )
    assert "reference first" in message
    one_known = np.array([np.nan, 0.9, np.nan, np.nan, np.nan])
    assert _of(DisagreementWarning, diagnose(training, learned, one_known)) == []


def test_shapes_that_were_left_out_are_told(training, learned):
    skipped = replace(training, skipped="1 of 6 shapes are left out. X[5]: why")
    assert _of(SkippedShapeWarning, diagnose(skipped, learned, None)) == [skipped.skipped]


def test_a_mirror_image_fits_much_better_or_nothing_is_said():
    C = np.eye(2)
    assert is_mirrored(Solution(C, 1.0, 0.5))
    assert not is_mirrored(Solution(C, 1.0, 0.9))
    assert not is_mirrored(Solution(C, 1.0, np.nan)), (
        "without oriented probes nothing tells sides apart"
    )


def test_a_mirrored_shape_is_not_called_unfamiliar_as_well(probed):
    usable = pick_usable(probed[:3])
    findings = diagnose_new_shapes(usable, [True, False, False], [False, False, None])
    assert [finding.category.__name__ for finding in findings] == [
        "OrientationWarning",
        "UnfamiliarShapeWarning",
    ]
    assert "X[0] ('body0')" in findings[0].message
    assert "X[1] ('body1')" in findings[1].message
    assert "body2" not in findings[1].message, "without calibration nobody knows"


def test_a_shape_that_the_reference_does_not_fit_is_named_once_with_its_shares(probed):
    usable, bad = pick_usable(probed[:3]), Quality(0.25, 0.5, 0.125, 0.0)
    _, *findings = diagnose_new_shapes(
        usable, [True, False, False], [False, False, False], [bad, bad, None]
    )
    strange, (_, ill_laid) = findings
    assert "these shapes much worse than any held-out training shape: X[2] ('body2')." in (
        strange.message
    )
    assert "as well as the training shapes: X[1] ('body1') (25% of the reference off" in ill_laid
    assert "50% of the shape off the reference, 12% stretched)." in ill_laid
    assert "body0" not in ill_laid, "a mirrored shape is called that alone"


def test_a_report_warns_of_each_finding():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        report([Finding(UserWarning, "one"), Finding(StabilityWarning, "two")])
    assert [str(warning.message) for warning in caught] == ["one", "two"]
    assert {warning.filename for warning in caught} == {__file__}


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.CoverageWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.DisagreementWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.OrientationWarning")
def test_correspondences_of_another_numbering_leave_nothing_stable(
    probed, collection, make_learner
):
    rng = np.random.default_rng(0)
    shuffled = [
        Correspondence(np.column_stack([rng.permutation(truth.pairs[:, 0]), truth.pairs[:, 1]]))
        for truth in collection.truths[1:5]
    ]
    with pytest.warns(
        StabilityWarning, match=r"No function is mapped stably.*vertex indices start at 0"
    ):
        make_learner().fit(probed[:5], [collection.truths[0], *shuffled])


def _mirrored(truth, mesh):
    mirror = cKDTree(mesh.vertices).query(mesh.vertices * [1, -1, 1])[1]
    return Correspondence(np.column_stack([mirror[truth.pairs[:, 0]], truth.pairs[:, 1]]))


def _shuffled(truth, mesh):
    rng = np.random.default_rng(0)
    return Correspondence(np.column_stack([rng.permutation(truth.pairs[:, 0]), truth.pairs[:, 1]]))


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.CoverageWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.OrientationWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.StabilityWarning")
@pytest.mark.parametrize("wrong", [_mirrored, _shuffled])
@pytest.mark.parametrize("reference", ["body0", "body2"])
def test_a_correspondence_that_contradicts_the_others_is_named(
    probed, collection, make_learner, wrong, reference
):
    truths = list(collection.truths[:5])
    truths[3] = wrong(truths[3], collection.meshes[3])
    with pytest.warns(
        DisagreementWarning,
        match=r"say: X\[3\] \('body3'\) \(0\.[234]\d\); the typical value is 0\.0",
    ):
        learner = make_learner(reference=reference).fit(probed[:5], truths)
    errors = learner.training_errors_
    assert errors.shape == (5,)
    assert (
        np.flatnonzero(np.isnan(errors))
        == np.flatnonzero(np.isnan(learner.misfits_))
        == learner.reference_index_
    )
    assert np.nanargmax(errors) == 3
    truths[learner.reference_index_] = wrong(
        collection.truths[learner.reference_index_], collection.meshes[learner.reference_index_]
    )
    truths[3] = collection.truths[3]
    with pytest.warns(DisagreementWarning, match="Check the correspondence of the reference first"):
        make_learner(reference=reference).fit(probed[:5], truths)


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.DisagreementWarning")
def test_a_strength_that_leaves_no_room_for_probes_is_told(probed, collection, make_learner):
    with pytest.warns(StabilityWarning, match="No function is mapped stably"):
        make_learner(alpha=1e9).fit(probed[:5], collection.truths[:5])


def test_an_epsilon_that_sees_no_singular_value_is_told(probed, collection, make_learner):
    for epsilon in (1e-300, 1e-20, 1e20):
        with pytest.warns(StabilityWarning, match="No weight was changed: at epsilon="):
            make_learner(epsilon=epsilon).fit(probed[:3], collection.truths[:3])
