"""What a reviewer who wanted to break the package tried: each is answered in the package's own words."""

import re

import numpy as np
import pandas as pd
import pytest
import trimesh
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
    check_mesh,
    repair_mesh,
)
from skfmap.__main__ import main
from skfmap.datasets import load_collection, make_sphere
from skfmap.descriptors import FunctionProbes, HeatKernelSignature, WaveKernelSignature
from skfmap.exceptions import CorrespondenceError, MeshError, RepairWarning, SkippedShapeWarning, StabilityWarning
from skfmap.io import read_mesh, write_mesh
from skfmap.metrics import GeodesicDistances, PairErrors, coverage, error_curve, get_scorer
from skfmap.model_selection import PinnedReference
from skfmap.persistence import load_model, save_model
from skfmap.plotting import (
    BasisErrorDisplay,
    ErrorCurveDisplay,
    ReliabilityDisplay,
    SingularValuesDisplay,
    plot_function,
    plot_functions,
    plot_matches,
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


def _one_higher(truth):
    return Correspondence(np.add(truth.pairs, [1, 0]))


@pytest.fixture(scope="module")
def broken(collection):
    """The last body, and the second, each with a vertex more, and their correspondences."""
    return {i: (_loose(collection.meshes[i], f"loose{i}"), _one_higher(collection.truths[i])) for i in (1, 5)}


@pytest.fixture(scope="module")
def model_that(collection, memory):
    """Return a function that fits a pipeline with `on_invalid` on the first bodies."""

    def make(on_invalid, meshes=None, truths=None, through=None, **parameters):
        learner = WeightedFunctionalMapLearner(
            n_functions=10, weighting="category", tol=1e-2, memory=memory, **parameters
        )
        learner = learner if through is None else BridgedLearner(learner, through)
        basis = SpectralBasis(20, on_invalid=on_invalid, memory=memory)
        model = make_pipeline(basis, DescriptorTransformer(memory=memory), learner)
        return model.fit(meshes or collection.meshes[:4], truths or collection.truths[:4])

    return make


@pytest.fixture(scope="module")
def matches(model_that, broken, collection):
    """Matches of a mended shape, a skipped one, and a sound one."""
    repairing, skipping = model_that("repair"), model_that("skip")
    with pytest.warns(RepairWarning):
        (mended,) = skfmap.match(repairing, [broken[5][0]])
    with pytest.warns(SkippedShapeWarning):
        skipped, sound = skfmap.match(skipping, [broken[5][0], collection.meshes[4]])
    return {"mended": mended, "skipped": skipped, "sound": sound}


# Vertices without a match stay without an answer


@pytest.mark.parametrize("values", [np.arange(500.0), np.arange(500), np.array(["leg", "head"] * 250)])
def test_nothing_is_transferred_to_a_vertex_without_a_match(matches, values):
    mended, skipped = matches["mended"].transfer(values), matches["skipped"].transfer(values, max_error=10)
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
    named = [Mesh(mesh.vertices, mesh.faces, "same") for mesh in collection.meshes[:2]]
    size = min(mesh.n_vertices for mesh in named)
    one, other = (
        skfmap.match(model_that("raise", [first, *collection.meshes[2:5]], truths), collection.meshes[5:])[0]
        for first, truths in (
            (named[0], [collection.truths[0], *collection.truths[2:5]]),
            (
                Mesh(named[0].vertices * [1, 1, 1.01], named[0].faces, "same"),
                [collection.truths[0], *collection.truths[2:5]],
            ),
        )
    )
    assert size
    with pytest.raises(ValueError, match="must be matched to one reference"):
        one.to(other)


@pytest.mark.parametrize("bridge", ["body2", "loose1", "auto"])
def test_a_bridge_and_mended_shapes(model_that, broken, collection, bridge):
    (mesh, truth), (new, _) = broken[1], broken[5]
    meshes = [collection.meshes[0], mesh, *collection.meshes[2:5]]
    with pytest.warns(RepairWarning):
        model = model_that("repair", meshes, [collection.truths[0], truth, *collection.truths[2:5]], through=bridge)
    plain = model_that("raise", collection.meshes[:5], collection.truths[:5], through=bridge.replace("loose", "body"))
    with pytest.warns(RepairWarning):
        (match,) = skfmap.match(model, [new])
    (expected,) = skfmap.match(plain, collection.meshes[5:])
    assert match.p2p[0] == -1
    np.testing.assert_array_equal(match.p2p[1:], expected.p2p)
    np.testing.assert_allclose(match.expected_error[1:], expected.expected_error)
    with pytest.warns(RepairWarning):
        (p2p,) = model[-1].point_maps(model[:-1].transform([new]))
    np.testing.assert_array_equal(p2p, match.p2p)


# Reports, pictures and searches of collections with broken shapes


def test_a_report_of_mended_and_of_skipped_shapes(model_that, broken, collection, tmp_path):
    mesh, truth = broken[1]
    meshes, truths = (
        [collection.meshes[0], mesh, *collection.meshes[2:5]],
        [
            collection.truths[0],
            truth,
            *collection.truths[2:5],
        ],
    )
    with pytest.warns(RepairWarning):
        model = model_that("repair", meshes, truths)
    with pytest.warns(RepairWarning):
        evaluation = evaluate(model, meshes, pd.Series(truths, index=[4, 3, 2, 1, 0]), cv=2, naive=False)
    plain = model_that("raise", collection.meshes[:5], collection.truths[:5])
    sound = evaluate(plain, collection.meshes[:5], collection.truths[:5], cv=2, naive=False)
    for one, other in zip(evaluation.errors, sound.errors, strict=True):
        np.testing.assert_array_equal(one.direct, other.direct)
    assert write_report(model, tmp_path / "r.html", evaluation=evaluation).stat().st_size > 10_000

    skipping = model_that("skip")
    with pytest.warns(SkippedShapeWarning):
        shapes = skipping[:-1].transform([broken[5][0], collection.meshes[4]])
    learner, answers = skipping[-1], [broken[5][1], collection.truths[4]]
    by_hand = Evaluation(
        [broken[5][0], collection.meshes[4]], learner.match(shapes), learner.pair_errors(shapes, answers), []
    )
    page = write_report(skipping, tmp_path / "s.html", evaluation=by_hand).read_text()
    assert "loose5" not in page
    nothing = Evaluation(by_hand.meshes[:1], by_hand.matches[:1], by_hand.errors[:1], [])
    with pytest.raises(ValueError, match="holds no shape that could be matched and scored"):
        write_report(skipping, tmp_path / "t.html", evaluation=nothing)
    for display in (SingularValuesDisplay, BasisErrorDisplay, ErrorCurveDisplay, ReliabilityDisplay):
        with pytest.warns(SkippedShapeWarning):
            both = display.from_estimator(skipping, [broken[5][0], collection.meshes[4]], answers)
        alone = display.from_estimator(skipping, [collection.meshes[4]], answers[1:])
        np.testing.assert_array_equal(both.line_.get_ydata(), alone.line_.get_ydata())
    for display in (SingularValuesDisplay, BasisErrorDisplay, ErrorCurveDisplay):
        with pytest.warns(SkippedShapeWarning), pytest.raises(ValueError, match="There is nothing to draw"):
            display.from_estimator(skipping, [broken[5][0]], answers[:1])


def test_a_correspondence_that_does_not_fit_is_skipped_where_the_fit_skipped_it(probed, collection, make_learner):
    truths = [*collection.truths[:4], Correspondence([[10**5, 1]])]
    with pytest.warns(SkippedShapeWarning, match=r"X\[4\], shape 'body4': The pairs of y\[4\]"):
        learner = make_learner(on_invalid="skip").fit(probed[:5], truths)
    assert len(evaluate(learner, probed[:5], truths, cv=2, naive=False).meshes) == 3
    with pytest.warns(SkippedShapeWarning):
        assert learner.score(probed[:5], truths) == learner.score(probed[:4], truths[:4])


def test_shapes_that_were_skipped_are_in_no_fold(probed, broken):
    with pytest.warns(SkippedShapeWarning):
        (skipped,) = SpectralBasis(20, on_invalid="skip").transform([broken[5][0]])
    shapes = [*probed[:3], skipped, *probed[3:5]]
    splits = PinnedReference(2)
    assert splits.get_n_splits(shapes) == 2
    for train, test in splits.split(pd.Series(shapes, index=list("rabcde"))):
        assert 3 not in train
        assert 3 not in test


def test_no_shape_that_can_be_used_is_said(model_that, broken):
    with pytest.warns(SkippedShapeWarning), pytest.raises(MeshError, match=r"No shape can be used: .*no face uses"):
        model_that("skip", [broken[1][0], broken[5][0]], [broken[1][1], broken[5][1]], reference="medoid")


def test_one_mesh_without_correspondences_does_not_lose_the_folder(tmp_path, collection):
    for i in range(3):
        write_mesh(collection.meshes[i], tmp_path / f"body{i}.off")
    for i in range(2):
        np.savetxt(tmp_path / f"body{i}.txt", collection.truths[i].pairs, fmt="%d")
    (tmp_path / "._body0.off").write_bytes(b"what another system leaves")
    (tmp_path / "folder.off").mkdir()
    with pytest.raises(CorrespondenceError, match=r"none for \['body2'\]"):
        load_collection(tmp_path)
    with pytest.warns(SkippedShapeWarning, match=r"1 of 3 shapes are left out. X\[2\]"):
        assert load_collection(tmp_path, on_invalid="skip").names == ["body0", "body1", "body2"]
    for i in range(3):
        np.savetxt(tmp_path / f"body{i}.vts", 1 + np.arange(9 + (i == 1)), fmt="%d")
    with pytest.warns(SkippedShapeWarning, match=r"X\[1\].*'body1.vts': 10"):
        load_collection(tmp_path, on_invalid="skip")
    for path in [*tmp_path.glob("*.vts"), *tmp_path.glob("*.txt")]:
        path.unlink()
    with pytest.warns(SkippedShapeWarning, match=r"2 of 3 shapes are left out.*other faces"):
        load_collection(tmp_path, on_invalid="skip")
    (tmp_path / "body0.sym.vts").write_text("1\n")
    with pytest.raises(CorrespondenceError, match=r"body0.sym.vts has no body0.vts beside it"):
        load_collection(tmp_path)


@pytest.mark.parametrize("on_invalid", ["repair", "skip"])
def test_the_command_line_goes_on_without_a_broken_mesh(tmp_path, collection, broken, capsys, on_invalid):
    folder = tmp_path / "meshes"
    folder.mkdir()
    parts = [(collection.meshes[i], collection.truths[i]) for i in range(4)]
    parts[1] = broken[1]
    for i, (mesh, truth) in enumerate(parts):
        write_mesh(mesh, folder / f"body{i}.off")
        np.savetxt(folder / f"body{i}.txt", truth.pairs, fmt="%d")
    options = [str(folder), "--functions", "10", "--folds", "1", "--output", str(tmp_path / "out"), "--jobs", "1"]
    assert main(options) == 2
    with pytest.warns((RepairWarning, SkippedShapeWarning)):
        assert main([*options, "--on-invalid", on_invalid]) == 0
    said = capsys.readouterr().out
    assert ("mended: body1" if on_invalid == "repair" else "left out: body1\n") in said
    assert (tmp_path / "out" / "report.html").exists()


def test_the_command_line_says_what_is_wrong_before_it_computes(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["--output", str(tmp_path / "file")]) == 2
    assert "--output" in capsys.readouterr().err
    assert main([str(tmp_path), "--pattern", "/x", "--output", str(tmp_path / "out")]) == 2
    assert "pattern must be the name of meshes" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.DisagreementWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.UnfamiliarShapeWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.StabilityWarning")
def test_the_command_line_takes_small_meshes(tmp_path, capsys):
    folder = tmp_path / "balls"
    folder.mkdir()
    for i in range(4):
        ball = make_sphere(n_subdivisions=2)
        write_mesh(Mesh(ball.vertices * [1, 1 + 0.2 * i, 1.5], ball.faces), folder / f"ball{i}.off")
    assert (
        main([str(folder), "--functions", "8", "--folds", "1", "--output", str(tmp_path / "out"), "--jobs", "1"]) == 0
    )


# Distances


@pytest.mark.parametrize("method", ["heat", "exact", "dijkstra"])
def test_distances_from_what_is_no_vertex_are_refused(method):
    """What lies beneath follows a wrong number out of its memory."""
    ball = make_sphere(n_subdivisions=2)
    distances = GeodesicDistances(ball, method)
    for points, sources in (([0], [-1]), ([0], [66]), ([-1], [0]), ([66], [0])):
        with pytest.raises(ValueError, match=r"refer to vertex (-1|66), but there are 66"):
            distances.between(points, sources)
    with pytest.raises(ValueError, match="one source for each point"):
        distances.between([0, 1], [0])
    with pytest.raises(ValueError, match="1-D array of vertex numbers"):
        distances.between([0.5], [0])
    assert len(distances.between([], [])) == 0
    two = Mesh(np.concatenate([ball.vertices, ball.vertices + 9]), np.concatenate([ball.faces, ball.faces + 66]))
    for mesh in (two, _loose(ball, "loose"), Mesh(np.zeros((3, 3)), [[0, 1, 2]])):
        with pytest.raises(MeshError, match="No distances are defined"):
            GeodesicDistances(mesh, method).between([1], [0])


# Arrays that are no arrays


MASKED = np.ma.masked_array([4, 5, 6], mask=[0, 1, 1])


def test_what_is_masked_is_unknown_or_refused():
    assert Correspondence.from_vertices(MASKED).pairs.tolist() == [[0, 4]]
    assert Correspondence.from_template(MASKED).pairs.tolist() == [[4, 0]]
    ball = make_sphere(n_subdivisions=2)
    vertices, faces = np.ma.masked_greater(np.array(ball.vertices), 0.9), np.ma.masked_less(np.array(ball.faces), 3)
    for mesh in ((vertices, ball.faces), (ball.vertices, faces)):
        with pytest.raises(MeshError, match="must not be masked"):
            Mesh(*mesh)
        assert not check_mesh(mesh).usable()
    pairs = np.ma.masked_array([[0, 0], [1, 1]], mask=[[0, 0], [1, 1]])
    with pytest.raises(CorrespondenceError, match="pairs must not be masked"):
        Correspondence(pairs)
    with pytest.raises(CorrespondenceError, match="weights must not be masked"):
        Correspondence([[0, 0], [1, 1]], weights=np.ma.masked_array([1.0, 2], mask=[0, 1]))


@pytest.mark.parametrize(
    "change", [lambda v: v + 1j, lambda v: v.astype("M8[s]"), lambda v: v > 0, lambda v: v.astype(str)]
)
def test_coordinates_are_real_numbers(change):
    ball = make_sphere(n_subdivisions=2)
    with pytest.raises(MeshError, match="must hold real numbers"):
        Mesh(change(ball.vertices), ball.faces)
    assert not check_mesh((change(ball.vertices), ball.faces)).usable()
    with pytest.raises(MeshError):
        repair_mesh((change(ball.vertices), ball.faces))


def test_a_list_of_two_tables_is_a_mesh_everywhere():
    ball = _loose(make_sphere(n_subdivisions=2), "ball")
    pair = [ball.vertices.tolist(), ball.faces.tolist()]
    assert [fault.kind for fault in check_mesh(pair).faults] == ["unreferenced vertices"]
    with pytest.warns(RepairWarning):
        (shape,) = SpectralBasis(10, on_invalid="repair").transform([pair])
    assert shape.mesh.n_vertices == 66


def test_template_points_may_have_any_numbers(probed, collection, make_learner):
    """Keys of a data base: no table as long as the largest is made."""
    far = [Correspondence(np.add(truth.pairs, [0, 2**40])) for truth in collection.truths]
    one = make_learner(weighting=None).fit(probed[:3], far[:3])
    other = make_learner(weighting=None).fit(probed[:3], collection.truths[:3])
    np.testing.assert_array_equal(one.predict(probed[3:]), other.predict(probed[3:]))


def test_a_reference_is_no_unordered_set_and_no_generator(collection, model, probed):
    with pytest.raises(TypeError, match=r"got a set. Make it a list: list\(X\)"):
        SpectralBasis(20).transform(set(collection.meshes))
    for call in (
        lambda: SpectralBasis(20).fit(mesh for mesh in collection.meshes),
        lambda: model.predict(mesh for mesh in collection.meshes),
        lambda: model[-1].score((shape for shape in probed), collection.truths),
    ):
        with pytest.raises(TypeError, match="got a generator"):
            call()


# Each call, and what it is given that it cannot use

BALL = make_sphere(n_subdivisions=2)
VALUES = BALL.vertices[:, 0]
CURVE = PairErrors(np.arange(3), np.ones(3), np.full(3, np.nan), np.zeros(3))
CALLS = {
    "ragged pairs": (lambda: Correspondence([[1, 2], [3]]), "pairs must be an array"),
    "ragged vertices": (lambda: Correspondence.from_vertices([[1, 2], [3]]), "points must be an array"),
    "ragged matrix": (lambda: Correspondence.from_matrix([[1, 2], [3]]), "matrix must be an array"),
    "no matrix": (lambda: Correspondence.from_matrix(None), "matrix must hold real numbers|must have shape"),
    "text for a matrix": (lambda: Correspondence.from_matrix("a"), "matrix must hold real numbers"),
    "text for weights": (lambda: Correspondence([[0, 0]], weights="a"), "weights must hold real numbers"),
    "complex weights": (lambda: Correspondence([[0, 0]], weights=[1j]), "weights must hold real numbers"),
    "n_vertices": (lambda: Correspondence([[0, 0]], n_vertices=-4), "n_vertices must be an integer at least 0"),
    "shorter symmetric": (lambda: Correspondence.from_vertices([1, 2], [1]), "must be as long as the other"),
    "smaller symmetric": (lambda: Correspondence.from_matrix(np.eye(3), np.eye(2)), "must be as long as the other"),
    "another map": (lambda: Correspondence.from_vertices([0, 1]).renumber([0, 1, 2]), "mesh of 3 vertices, but"),
    "below -1": (lambda: Correspondence([[0, 1]]).renumber([-2, 1]), "only negative value allowed is -1"),
    "ragged map": (lambda: Correspondence([[0, 1]]).renumber([[0], [1, 2]]), "vertex_map must be an array"),
    "no path": (lambda: read_mesh(None), "A mesh is read from a path; got None"),
    "bytes": (lambda: read_mesh(b"a.off"), "A mesh is read from a path"),
    "no mesh": (lambda: write_mesh((BALL.vertices, BALL.faces), "a.off"), "A skfmap.Mesh is written; got tuple"),
    "no folder for a mesh": (lambda: write_mesh(BALL, "no/such/a.off"), "There is no folder no/such"),
    "pattern": (lambda: load_collection(".", pattern="**"), "pattern must be the name of meshes"),
    "no pattern": (lambda: load_collection(".", pattern=None), "pattern must be the name of meshes"),
    "no folder": (lambda: load_collection(None), "folder must be a path; got None"),
    "zero jobs": (lambda: SpectralBasis(8, n_jobs=0).transform([BALL]), "n_jobs must be None or an integer other"),
    "word for jobs": (lambda: SpectralBasis(8, n_jobs="a").transform([BALL]), "n_jobs must be None or an integer"),
    "word for verbose": (lambda: SpectralBasis(8, verbose="a").transform([BALL]), "verbose must be an integer"),
    "number for memory": (lambda: SpectralBasis(8, memory=3).transform([BALL]), "memory=3 cannot hold a cache"),
    "array as X": (lambda: SpectralBasis(8).transform(np.array(BALL, dtype=object)), "must be a sequence of meshes"),
    "meshes in a family": (lambda: HeatKernelSignature().transform([BALL]), r"X\[0\] is a Mesh, not a SpectralShape"),
    "narrow": (lambda: WaveKernelSignature(sigma=1e-300).check_parameters(), "sigma must be a number at least 0.001"),
    "short weights": (lambda: error_curve([0.1, 0.2], [1.0], np.ones(3)), "weights must be 2 non-negative"),
    "NaN errors": (lambda: error_curve([0.1, np.nan], [1.0]), "no NaN"),
    "no errors": (lambda: error_curve([], [1.0]), "one error at least"),
    "empty curve": (lambda: ErrorCurveDisplay.from_predictions([]), "nothing to draw"),
    "no bins": (lambda: ReliabilityDisplay(VALUES, VALUES).plot(n_bins=0), "n_bins must be an integer at least 1"),
    "limits turned": (
        lambda: plot_function(BALL, VALUES, limits=(3, 1)),
        "limits must be two numbers, the lower first",
    ),
    "limits alike": (lambda: plot_function(BALL, VALUES, limits=(1, 1)), "limits must be two numbers"),
    "NaN limits": (lambda: plot_function(BALL, VALUES, limits=(np.nan, 1)), "limits must be two numbers"),
    "one limit": (lambda: plot_function(BALL, VALUES, limits=3), "limits must be two numbers"),
    "colour map": (lambda: plot_function(BALL, VALUES, cmap="nope"), "cmap must be the name of a colour map"),
    "camera": (lambda: plot_function(BALL, VALUES, camera="z"), "camera must be a Camera"),
    "flat": (lambda: plot_functions([Mesh(np.zeros((3, 3)), [[0, 1, 2]])], [np.zeros(3)]), "has no area"),
    "no page": (lambda: plot_functions([BALL], [VALUES], path="no/such/a.png"), "There is no folder no/such"),
    "nothing saved": (lambda: save_model(None, "a.skops"), "A learner, a pipeline or a transformer is saved"),
    "text for trusted": (lambda: load_model("a.skops", trusted="abc"), "trusted must be a list of full names"),
    "a folder for a model": (lambda: load_model("."), "There is no model file"),
}


@pytest.mark.parametrize("name", CALLS)
def test_errors_are_the_packages_own(name):
    call, message = CALLS[name]
    with pytest.raises((ValueError, TypeError, OSError), match=message) as told:
        call()
    assert "skfmap" in str(told.traceback[-1].path)


def _fits(**parameters):
    return lambda probed, truths, make_learner: make_learner(**parameters).fit(probed[:3], truths[:3])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (_fits(weighting=lambda names, categories: None), "weighting must return one label for each probe"),
        (_fits(weighting=[[1]] * 105), "labels of weighting must be texts or numbers"),
        (_fits(regularizer=lambda a, b: np.full((len(a), len(b)), 1j)), "finite real values"),
        (_fits(reference=np.array(["a", "b"])), "reference must be the name of a shape"),
        (
            lambda p, t, make: BridgedLearner(make(), through=3).fit(p[:3], t[:3]),
            "through must be 'auto' or the name of a training shape; got 3",
        ),
        (_fits(n_jobs=0), "n_jobs must be None or an integer"),
        (lambda p, t, make: make().fit(p[:3], t[:3], sample_weight="ab"), "sample_weight must hold real numbers"),
        (lambda p, t, make: make().fit(p[:3], t[:3], sample_weight={1: 2}), "sample_weight must hold real numbers"),
        (lambda p, t, make: make().fit(p[:3], t[:3], sample_weight=(w for w in [1, 1, 1])), "must hold real numbers"),
        (lambda p, t, make: make().fit(p[:3], [[[0, 1], [2]], *t[1:3]]), r"y\[0\] \(of 'body0'\) must be an array"),
    ],
)
def test_a_fit_says_what_is_wrong_in_its_own_words(probed, collection, make_learner, call, message):
    with pytest.raises((ValueError, TypeError), match=message):
        call(probed, collection.truths, make_learner)


def test_scores_and_matches_say_what_is_wrong_in_their_own_words(fitted, probed, collection, matches, tmp_path):
    score = get_scorer("neg_geodesic_error")
    for weights in ([-1, 1], [np.nan, 1], [1, 2, 3]):
        with pytest.raises(ValueError, match="sample_weight must be 2 finite, non-negative numbers"):
            score(fitted, probed[4:], collection.truths[4:], sample_weight=weights)
    with pytest.raises(ValueError, match="X has 5 shapes, but y has 2"):
        evaluate(fitted, probed[:5], collection.truths[:2])
    with pytest.raises(ValueError, match="y is None"):
        evaluate(fitted, probed[:5], None)
    match = matches["sound"]
    with pytest.raises(TypeError, match="max_error must be a number"):
        match.transfer(np.arange(500.0), max_error="a")
    with pytest.raises(ValueError, match="max_error must be a number"):
        match.transfer(np.arange(500.0), max_error=np.nan)
    with pytest.raises(TypeError, match="labels that are all text"):
        match.transfer([None] * 500)
    with pytest.raises(ValueError, match=re.escape("got shape (500, 0)")):
        match.transfer(np.zeros((500, 0), dtype=int))
    assert match.transfer(pd.Series(["leg"] * 500)).tolist() == ["leg"] * len(match.p2p)
    with pytest.raises(ValueError, match="show must hold one at least"):
        plot_matches([match], collection.meshes[4:5], collection.meshes[0], show=())
    assert np.isnan(CURVE.mean("direct"))
    assert coverage([0, 0], [1.0, 1.0]) == 0.5
    ball = trimesh.Trimesh(BALL.vertices, BALL.faces, process=False)
    ball.metadata = None
    assert SpectralBasis(8).transform([ball])[0].name == "shape 0"


def test_an_epsilon_that_sees_no_singular_value_is_told(probed, collection, make_learner):
    for epsilon in (1e-300, 1e-20, 1e20):
        with pytest.warns(StabilityWarning, match="No weight was changed: at epsilon="):
            make_learner(epsilon=epsilon).fit(probed[:3], collection.truths[:3])


def test_probes_that_are_no_numbers_are_named(probed):
    shape = probed[0].spectral

    def half(given):
        return np.where(given.vertices[:, 0] > 0, np.nan, 1.0)

    for function in (half, lambda given: given.vertices[:, 0] * 1j):
        with pytest.raises(ValueError, match=r"FunctionProbes.*body0|must hold real numbers|finite"):
            DescriptorTransformer([("own", FunctionProbes(function))]).transform([shape])


def test_functions_without_a_name_are_told_apart(probed, collection, make_learner):
    """Two lambdas are two probes, though both are called <lambda>."""
    shapes = [shape.spectral for shape in probed]
    one, other = (
        DescriptorTransformer([("hks", HeatKernelSignature()), ("own", FunctionProbes(function))]).transform(shapes)
        for function in (lambda shape: shape.vertices[:, 0], lambda shape: shape.vertices[:, 1])
    )
    learner = make_learner(weighting=None).fit(one[:3], collection.truths[:3])
    learner.predict(one[3:])
    with pytest.raises(ValueError, match="made with other parameters"):
        learner.predict(other[3:])


# Files that contradict themselves


@pytest.mark.parametrize(
    ("name", "content", "faces"),
    [
        (
            "relative.obj",
            "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 0 0 5\nv 1 0 5\nv 1 1 5\nf -3 -2 -1\n",
            [[0, 1, 2], [3, 4, 5]],
        ),
        ("comments.obj", "v 0 0 0 # one\nv 1 0 0\nv 1 1 0\nf 1 2 3 # face\n# end", [[0, 1, 2]]),
        ("returns.obj", "v 0 0 0\rv 1 0 0\rv 1 1 0\rf 1 2 3\r", [[0, 1, 2]]),
        ("longer.off", "OFF\n4 1 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 2\n3 1 2 3\n", "but more lines follow"),
        (
            "fraction.ply",
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
            "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2.7\n",
            "no whole numbers",
        ),
        ("before.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -4 -2 -1\n", "vertex 0"),
    ],
)
def test_files_say_one_thing(tmp_path, name, content, faces):
    path = tmp_path / name
    path.write_bytes(content.encode())
    if isinstance(faces, str):
        with pytest.raises(MeshError, match=faces):
            read_mesh(path)
    else:
        assert read_mesh(path).faces.tolist() == faces


@pytest.mark.parametrize(
    ("name", "content"),
    [("f.template.txt", "-5\n"), ("f.vertices.txt", "3\n"), ("f.txt", "1 -2\n"), ("f.vertices.txt", "1e30\n")],
)
def test_faults_in_correspondence_files_name_the_file(tmp_path, name, content):
    write_mesh(BALL, tmp_path / "f.off")
    (tmp_path / name).write_text(content)
    with pytest.raises(CorrespondenceError, match=re.escape(name)):
        load_collection(tmp_path)


def test_names_with_odd_digits_are_sorted(tmp_path):
    write_mesh(BALL, tmp_path / "1²2.off")
    assert load_collection(tmp_path).names == ["1²2"]
