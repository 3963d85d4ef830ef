"""Mended and skipped shapes, from the match to the report: what is not known stays unknown."""

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import (
    BridgedLearner,
    Correspondence,
    DescriptorTransformer,
    Mesh,
    SpectralBasis,
    WeightedFunctionalMapLearner,
)
from skfmap.exceptions import MeshError, RepairWarning, SkippedShapeWarning
from skfmap.model_selection import PinnedReference
from skfmap.plotting import (
    BasisErrorDisplay,
    ErrorCurveDisplay,
    ReliabilityDisplay,
    SingularValuesDisplay,
)
from skfmap.report import Evaluation, evaluate, write_report


@pytest.fixture(autouse=True)
def _no_figure_stays_open():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def memory(tmp_path_factory):
    return str(tmp_path_factory.mktemp("cache"))


def _loose(mesh, name):
    """Return the mesh with a vertex in front of all others that no face uses."""
    return Mesh(np.concatenate([[[9.0, 9, 9]], mesh.vertices]), mesh.faces + 1, name)


def _tiny(name):
    """Return a mesh that nothing makes large enough."""
    return Mesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        name,
    )


_TINY_TRUTH = Correspondence.from_vertices(np.arange(4))


def _one_higher(truth):
    return Correspondence(np.add(truth.pairs, [1, 0]))


@pytest.fixture(scope="module")
def broken(collection):
    """The last body, and the second, each with a vertex more, and their correspondences."""
    return {
        i: (_loose(collection.meshes[i], f"loose{i}"), _one_higher(collection.truths[i]))
        for i in (1, 5)
    }


@pytest.fixture(scope="module")
def model_that(collection, memory):
    """Return a function that fits a pipeline with `on_invalid` on the first bodies."""

    def make(on_invalid, meshes=None, truths=None, through=None, **parameters):
        given = {"n_functions": 10, "weighting": "category", "tol": 1e-2, "refine": None}
        learner = WeightedFunctionalMapLearner(**{**given, "memory": memory, **parameters})
        learner = learner if through is None else BridgedLearner(learner, through)
        basis = SpectralBasis(20, on_invalid=on_invalid, memory=memory)
        model = make_pipeline(basis, DescriptorTransformer(memory=memory), learner)
        return model.fit(meshes or collection.meshes[:4], truths or collection.truths[:4])

    return make


@pytest.fixture(scope="module")
def matches(model_that, broken, collection):
    """Matches of a mended shape, a skipped one, and a sound one."""
    mending, skipping = model_that("mend"), model_that("skip")
    with pytest.warns(RepairWarning, match="loose5"):
        (mended,) = skfmap.match(mending, [broken[5][0]])
    with pytest.warns(SkippedShapeWarning, match="tiny5"):
        skipped, sound = skfmap.match(skipping, [_tiny("tiny5"), collection.meshes[4]])
    return {"mended": mended, "skipped": skipped, "sound": sound}


# Vertices without a match stay without an answer


@pytest.mark.parametrize(
    "values", [np.arange(500.0), np.arange(500), np.array(["leg", "head"] * 250)]
)
def test_nothing_is_transferred_to_a_vertex_without_a_match(matches, values):
    mended, skipped = (
        matches["mended"].transfer(values),
        matches["skipped"].transfer(values, max_error=10),
    )
    assert mended.mask[0]
    assert not mended.mask[1:].any()
    assert skipped.mask.all()


def test_what_is_masked_on_the_reference_is_masked_where_it_goes(matches):
    values = np.ma.masked_less(np.arange(500.0), 250)
    carried = matches["sound"].transfer(values)
    np.testing.assert_array_equal(carried.mask, matches["sound"].p2p < 250)


def test_a_way_through_a_vertex_without_a_match_leads_nowhere(matches):
    for one, other, lost in (
        ("mended", "sound", [0]),
        ("skipped", "sound", slice(None)),
        ("sound", "skipped", slice(None)),
    ):
        p2p, error = matches[one].to(matches[other])
        assert (p2p[lost] == -1).all()
        assert np.isnan(error[lost]).all()
    p2p, error = matches["mended"].to(matches["sound"])
    assert (p2p[1:] >= 0).all()
    assert np.isfinite(error[1:]).all()


def test_references_of_one_name_and_size_are_told_apart(model_that, collection):
    body, truths = collection.meshes[0], [collection.truths[0], *collection.truths[2:5]]
    one, other = (
        skfmap.match(
            model_that("raise", [reference, *collection.meshes[2:5]], truths), collection.meshes[5:]
        )[0]
        for reference in (
            Mesh(body.vertices, body.faces, "same"),
            Mesh(body.vertices * [1, 1, 1.01], body.faces, "same"),
        )
    )
    with pytest.raises(ValueError, match="must be matched to the same reference"):
        one.to(other)


@pytest.mark.parametrize("bridge", ["body2", "loose1", "auto"])
def test_a_bridge_and_mended_shapes(model_that, broken, collection, bridge):
    (mesh, truth), (new, _) = broken[1], broken[5]
    meshes = [collection.meshes[0], mesh, *collection.meshes[2:5]]
    with pytest.warns(RepairWarning, match="loose1"):
        model = model_that(
            "mend", meshes, [collection.truths[0], truth, *collection.truths[2:5]], through=bridge
        )
    plain = model_that(
        "raise",
        collection.meshes[:5],
        collection.truths[:5],
        through=bridge.replace("loose", "body"),
    )
    with pytest.warns(RepairWarning, match="loose5"):
        (match,) = skfmap.match(model, [new])
    (expected,) = skfmap.match(plain, collection.meshes[5:])
    assert match.p2p[0] == -1
    np.testing.assert_array_equal(match.p2p[1:], expected.p2p)
    np.testing.assert_allclose(match.expected_error[1:], expected.expected_error)
    with pytest.warns(RepairWarning, match="loose5"):
        (p2p,) = model[-1].point_maps(model[:-1].transform([new]))
    np.testing.assert_array_equal(p2p, match.p2p)


# Reports, pictures and searches of collections with broken shapes


def test_a_report_of_mended_and_of_skipped_shapes(model_that, broken, collection, tmp_path):
    mesh, truth = broken[1]
    meshes = [collection.meshes[0], mesh, *collection.meshes[2:5]]
    truths = [collection.truths[0], truth, *collection.truths[2:5]]
    with pytest.warns(RepairWarning, match="loose1"):
        model = model_that("mend", meshes, truths)
    with pytest.warns(RepairWarning, match="loose1"):
        evaluation = evaluate(
            model, meshes, pd.Series(truths, index=[4, 3, 2, 1, 0]), cv=2, naive=False
        )
    plain = model_that("raise", collection.meshes[:5], collection.truths[:5])
    sound = evaluate(plain, collection.meshes[:5], collection.truths[:5], cv=2, naive=False)
    for one, other in zip(evaluation.errors, sound.errors, strict=True):
        np.testing.assert_array_equal(one.direct, other.direct)
    assert write_report(model, tmp_path / "r.html", evaluation=evaluation).stat().st_size > 10_000

    skipping = model_that("skip")
    tiny = _tiny("tiny5")
    with pytest.warns(SkippedShapeWarning, match="tiny5"):
        shapes = skipping[:-1].transform([tiny, collection.meshes[4]])
    learner, answers = skipping[-1], [_TINY_TRUTH, collection.truths[4]]
    by_hand = Evaluation(
        [tiny, collection.meshes[4]],
        learner.match(shapes),
        learner.pair_errors(shapes, answers),
        [],
    )
    page = write_report(skipping, tmp_path / "s.html", evaluation=by_hand).read_text()
    assert "tiny5" not in page
    nothing = Evaluation(by_hand.meshes[:1], by_hand.matches[:1], by_hand.errors[:1], [])
    with pytest.raises(ValueError, match="contains no shape that could be matched and scored"):
        write_report(skipping, tmp_path / "t.html", evaluation=nothing)
    for display in (
        SingularValuesDisplay,
        BasisErrorDisplay,
        ErrorCurveDisplay,
        ReliabilityDisplay,
    ):
        with pytest.warns(SkippedShapeWarning, match="tiny5"):
            both = display.from_estimator(skipping, [tiny, collection.meshes[4]], answers)
        alone = display.from_estimator(skipping, [collection.meshes[4]], answers[1:])
        np.testing.assert_array_equal(both.line_.get_ydata(), alone.line_.get_ydata())
    for display in (SingularValuesDisplay, BasisErrorDisplay, ErrorCurveDisplay):
        with (
            pytest.warns(SkippedShapeWarning, match="tiny5"),
            pytest.raises(ValueError, match="There is nothing to draw"),
        ):
            display.from_estimator(skipping, [tiny], answers[:1])


def test_a_correspondence_that_does_not_fit_is_skipped_where_the_fit_skipped_it(
    probed, collection, make_learner
):
    truths = [*collection.truths[:4], Correspondence([[10**5, 1]])]
    with pytest.warns(SkippedShapeWarning, match=r"X\[4\], shape 'body4': The pairs of y\[4\]"):
        learner = make_learner(on_invalid="skip").fit(probed[:5], truths)
    assert len(evaluate(learner, probed[:5], truths, cv=2, naive=False).meshes) == 3
    with pytest.warns(SkippedShapeWarning, match="body4"):
        assert learner.score(probed[:5], truths) == learner.score(probed[:4], truths[:4])


def test_shapes_that_were_skipped_are_in_no_fold(probed):
    with pytest.warns(SkippedShapeWarning, match="tiny5"):
        (skipped,) = SpectralBasis(20, on_invalid="skip").transform([_tiny("tiny5")])
    shapes = [*probed[:3], skipped, *probed[3:5]]
    splits = PinnedReference(2)
    assert splits.get_n_splits(shapes) == 2
    for train, test in splits.split(pd.Series(shapes, index=list("rabcde"))):
        assert 3 not in train
        assert 3 not in test


def test_no_shape_that_can_be_used_is_said(model_that):
    with (
        pytest.warns(SkippedShapeWarning, match="tiny1"),
        pytest.raises(MeshError, match=r"No shape can be used\. .*too few"),
    ):
        model_that("skip", [_tiny("tiny1"), _tiny("tiny5")], [_TINY_TRUTH] * 2, reference="medoid")
