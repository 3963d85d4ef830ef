"""Each call, and what it is given that it cannot use: the error names the remedy."""

import re

import numpy as np
import pandas as pd
import pytest
import trimesh
from matplotlib import pyplot as plt

from skfmap import BridgedLearner, Correspondence, Mesh, SpectralBasis
from skfmap.datasets import load_collection, make_sphere
from skfmap.descriptors import HeatKernelSignature, WaveKernelSignature
from skfmap.io import read_mesh, write_mesh
from skfmap.metrics import PairErrors, coverage, error_curve, get_scorer
from skfmap.persistence import load_model, save_model
from skfmap.plotting import (
    ErrorCurveDisplay,
    ReliabilityDisplay,
    plot_function,
    plot_functions,
    plot_matches,
)
from skfmap.report import evaluate


@pytest.fixture(autouse=True)
def _no_figure_stays_open():
    yield
    plt.close("all")


BALL = make_sphere(n_subdivisions=2)


VALUES = BALL.vertices[:, 0]


CURVE = PairErrors(np.arange(3), np.ones(3), np.full(3, np.nan), np.zeros(3))


CALLS = {
    "ragged pairs": (lambda: Correspondence([[1, 2], [3]]), "pairs must be an array"),
    "ragged vertices": (
        lambda: Correspondence.from_vertices([[1, 2], [3]]),
        "points must be an array",
    ),
    "ragged matrix": (lambda: Correspondence.from_matrix([[1, 2], [3]]), "matrix must be an array"),
    "no matrix": (
        lambda: Correspondence.from_matrix(None),
        "matrix must hold real numbers|must have shape",
    ),
    "text for a matrix": (lambda: Correspondence.from_matrix("a"), "matrix must hold real numbers"),
    "text for weights": (
        lambda: Correspondence([[0, 0]], weights="a"),
        "weights must hold real numbers",
    ),
    "complex weights": (
        lambda: Correspondence([[0, 0]], weights=[1j]),
        "weights must hold real numbers",
    ),
    "n_vertices": (
        lambda: Correspondence([[0, 0]], n_vertices=-4),
        "n_vertices must be an integer at least 0",
    ),
    "shorter symmetric": (
        lambda: Correspondence.from_vertices([1, 2], [1]),
        "must have the same size",
    ),
    "smaller symmetric": (
        lambda: Correspondence.from_matrix(np.eye(3), np.eye(2)),
        "must have the same size",
    ),
    "another map": (
        lambda: Correspondence.from_vertices([0, 1]).renumber([0, 1, 2]),
        "mesh of 3 vertices, but",
    ),
    "below -1": (
        lambda: Correspondence([[0, 1]]).renumber([-2, 1]),
        "only negative value allowed is -1",
    ),
    "ragged map": (
        lambda: Correspondence([[0, 1]]).renumber([[0], [1, 2]]),
        "vertex_map must be an array",
    ),
    "no path": (lambda: read_mesh(None), "path must be the path of a mesh file; got None"),
    "bytes": (lambda: read_mesh(b"a.off"), "path must be the path of a mesh file"),
    "no mesh": (
        lambda: write_mesh((BALL.vertices, BALL.faces), "a.off"),
        "must be a skfmap.Mesh, .*; got tuple. Use Mesh",
    ),
    "no folder for a mesh": (
        lambda: write_mesh(BALL, "no/such/a.off"),
        "There is no folder no/such",
    ),
    "pattern": (lambda: load_collection(".", pattern="**"), "pattern must match names of meshes"),
    "no pattern": (
        lambda: load_collection(".", pattern=None),
        "pattern must match names of meshes",
    ),
    "no folder": (lambda: load_collection(None), "folder must be a path; got None"),
    "zero jobs": (
        lambda: SpectralBasis(8, n_jobs=0).transform([BALL]),
        "n_jobs must be None or an integer other",
    ),
    "word for jobs": (
        lambda: SpectralBasis(8, n_jobs="a").transform([BALL]),
        "n_jobs must be None or an integer",
    ),
    "word for verbose": (
        lambda: SpectralBasis(8, verbose="a").transform([BALL]),
        "verbose must be an integer",
    ),
    "number for memory": (
        lambda: SpectralBasis(8, memory=3).transform([BALL]),
        "memory=3 cannot hold a cache",
    ),
    "array as X": (
        lambda: SpectralBasis(8).transform(np.array(BALL, dtype=object)),
        "must be a sequence of meshes",
    ),
    "meshes in a family": (
        lambda: HeatKernelSignature().transform([BALL]),
        r"X\[0\] is a Mesh, not a SpectralShape",
    ),
    "narrow": (
        lambda: WaveKernelSignature(sigma=1e-300).check_parameters(),
        "sigma must be a number at least 0.001",
    ),
    "short weights": (
        lambda: error_curve([0.1, 0.2], [1.0], np.ones(3)),
        "weights must be 2 non-negative",
    ),
    "NaN errors": (lambda: error_curve([0.1, np.nan], [1.0]), "no NaN"),
    "no errors": (lambda: error_curve([], [1.0]), "at least one error"),
    "empty curve": (lambda: ErrorCurveDisplay.from_predictions([]), "nothing to draw"),
    "no bins": (
        lambda: ReliabilityDisplay(VALUES, VALUES).plot(n_bins=0),
        "n_bins must be an integer at least 1",
    ),
    "limits turned": (
        lambda: plot_function(BALL, VALUES, limits=(3, 1)),
        "limits must be two finite numbers in increasing order",
    ),
    "limits alike": (
        lambda: plot_function(BALL, VALUES, limits=(1, 1)),
        "limits must be two finite numbers",
    ),
    "NaN limits": (
        lambda: plot_function(BALL, VALUES, limits=(np.nan, 1)),
        "limits must be two finite numbers",
    ),
    "one limit": (
        lambda: plot_function(BALL, VALUES, limits=3),
        "limits must be two finite numbers",
    ),
    "colour map": (
        lambda: plot_function(BALL, VALUES, cmap="nope"),
        "cmap must be the name of a matplotlib colour map",
    ),
    "camera": (lambda: plot_function(BALL, VALUES, camera="z"), "camera must be a Camera"),
    "flat": (
        lambda: plot_functions([Mesh(np.zeros((3, 3)), [[0, 1, 2]])], [np.zeros(3)]),
        "has no area",
    ),
    "no page": (
        lambda: plot_functions([BALL], [VALUES], path="no/such/a.png"),
        "There is no folder no/such",
    ),
    "nothing saved": (
        lambda: save_model(None, "a.skops"),
        "model must be a learner, a pipeline or a transformer",
    ),
    "text for trusted": (
        lambda: load_model("a.skops", trusted="abc"),
        "trusted must be a list of full names",
    ),
    "a folder for a model": (lambda: load_model("."), "There is no model file"),
}


@pytest.mark.parametrize("name", CALLS)
def test_errors_are_the_packages_own(name):
    call, message = CALLS[name]
    with pytest.raises((ValueError, TypeError, OSError), match=message) as told:
        call()
    assert "skfmap" in str(told.traceback[-1].path)


def _fits(**parameters):
    return lambda probed, truths, make_learner: make_learner(**parameters).fit(
        probed[:3], truths[:3]
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            _fits(weighting=lambda names, categories: None),
            "weighting must return one label for each probe",
        ),
        (_fits(weighting=[[1]] * 105), "labels of weighting must be strings or numbers"),
        (_fits(regularizer=lambda a, b: np.full((len(a), len(b)), 1j)), "finite real values"),
        (_fits(reference=np.array(["a", "b"])), "reference must be 'first'"),
        (
            lambda p, t, make: BridgedLearner(make(), through=3).fit(p[:3], t[:3]),
            "through must be 'auto' or the name of a training shape; got 3",
        ),
        (_fits(n_jobs=0), "n_jobs must be None or an integer"),
        (
            lambda p, t, make: make().fit(p[:3], t[:3], sample_weight="ab"),
            "sample_weight must hold real numbers",
        ),
        (
            lambda p, t, make: make().fit(p[:3], t[:3], sample_weight={1: 2}),
            "sample_weight must hold real numbers",
        ),
        (
            lambda p, t, make: make().fit(p[:3], t[:3], sample_weight=(w for w in [1, 1, 1])),
            "must hold real numbers",
        ),
        (
            lambda p, t, make: make().fit(p[:3], [[[0, 1], [2]], *t[1:3]]),
            r"y\[0\] \(of 'body0'\) must be an array",
        ),
    ],
)
def test_a_fit_says_what_is_wrong_in_its_own_words(probed, collection, make_learner, call, message):
    with pytest.raises((ValueError, TypeError), match=message):
        call(probed, collection.truths, make_learner)


def test_scores_and_matches_say_what_is_wrong_in_their_own_words(fitted, probed, collection):
    score = get_scorer("neg_geodesic_error")
    for weights in ([-1, 1], [np.nan, 1], [1, 2, 3]):
        with pytest.raises(
            ValueError, match="sample_weight must be 2 finite, non-negative numbers"
        ):
            score(fitted, probed[4:], collection.truths[4:], sample_weight=weights)
    with pytest.raises(ValueError, match="X has 5 shapes, but y has 2"):
        evaluate(fitted, probed[:5], collection.truths[:2])
    with pytest.raises(ValueError, match="y is None"):
        evaluate(fitted, probed[:5], None)
    (match,) = fitted.match(probed[5:])
    with pytest.raises(TypeError, match="max_error must be a number"):
        match.transfer(np.arange(500.0), max_error="a")
    with pytest.raises(ValueError, match="max_error must be a number"):
        match.transfer(np.arange(500.0), max_error=np.nan)
    with pytest.raises(TypeError, match="labels that are strings"):
        match.transfer([None] * 500)
    with pytest.raises(ValueError, match=re.escape("got shape (500, 0)")):
        match.transfer(np.zeros((500, 0), dtype=int))
    assert match.transfer(pd.Series(["leg"] * 500)).tolist() == ["leg"] * len(match.p2p)
    with pytest.raises(ValueError, match="show must be a list of at least one"):
        plot_matches([match], collection.meshes[5:], collection.meshes[0], show=())
    assert np.isnan(CURVE.mean("direct"))
    assert coverage([0, 0], [1.0, 1.0]) == 0.5
    ball = trimesh.Trimesh(BALL.vertices, BALL.faces, process=False)
    ball.metadata = None
    assert SpectralBasis(8).transform([ball])[0].name == "shape 0"
