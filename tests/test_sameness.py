"""Results that do not move: over threads, over kernels of the linear algebra, over time."""

import json
import os
import subprocess
import sys
from pathlib import Path

import joblib
import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from skfmap import SpectralBasis
from skfmap.datasets import make_creatures

FROZEN = Path(__file__).with_name("frozen.json")


def _projector_distance(shape, other):
    """Return how far the spaces of the first eigenfunctions are apart, at a gap of the spectrum."""
    gap = 5 + int(np.diff(shape.evals[5:25]).argmax()) + 1
    overlap = shape.evecs[:, :gap].T @ (shape.mass[:, None] * other.evecs[:, :gap])
    return float(np.abs(overlap @ overlap.T - np.eye(gap)).max())


def test_threads_of_the_linear_algebra_change_no_function_space():
    (mesh,) = make_creatures(n_shapes=1, n_vertices=2000).meshes
    with threadpool_limits(limits=1):
        (one,) = SpectralBasis(40).transform([mesh])
    with threadpool_limits(limits=2):
        (two,) = SpectralBasis(40).transform([mesh])
    assert _projector_distance(one, two) < 1e-8
    np.testing.assert_allclose(one.evals, two.evals, atol=1e-8)


# Another process, whose BLAS multiplies with other instructions, in other orders: as good as
# another library.
_ELSEWHERE = """
import sys
import joblib, numpy as np
from threadpoolctl import threadpool_info
import skfmap
from skfmap.functional.objective import LearningProblem

given, out = joblib.load(sys.argv[1]), sys.argv[2]
blas = {info["architecture"] for info in threadpool_info() if info["internal_api"] == "openblas"}
shapes = skfmap.SpectralBasis(30).transform(given["meshes"])
probed = skfmap.DescriptorTransformer().transform(shapes)
learner = skfmap.WeightedFunctionalMapLearner(n_functions=12, tol=1e-3)
learner.fit(probed[:5], given["truths"][:5])
loss, gradient = LearningProblem(*given["problem"]).loss_gradient(given["weights"], 0.1)
joblib.dump({
    "blas": blas, "shapes": shapes, "loss": loss, "gradient": gradient,
    "loaded": given["fitted"].point_maps(probed[5:])[0],
    "fitted": learner.point_maps(probed[5:])[0],
}, out)
"""


def _run_elsewhere(place, given, name, **environment):
    (place / "run.py").write_text(_ELSEWHERE)
    joblib.dump(given, place / "given.joblib")
    command = [
        sys.executable,
        str(place / "run.py"),
        str(place / "given.joblib"),
        str(place / name),
    ]
    subprocess.run(command, check=True, env=os.environ | environment, timeout=300)
    return joblib.load(place / name)


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory, collection, fitted):
    """Return results of this machine's kernels, of the oldest that it has, and of two threads."""
    rng, k, m = np.random.default_rng(0), 12, 20
    maps = np.eye(k) + 0.3 * rng.standard_normal((4, k, k))
    problem = (
        rng.standard_normal((k, m)),
        rng.standard_normal((4, k, m)),
        rng.random((4, k, k)) + 0.01,
        maps,
        np.ones(4),
    )
    weights = np.exp(rng.standard_normal(m))
    given = {
        "meshes": collection.meshes,
        "truths": collection.truths,
        "fitted": fitted,
        "problem": problem,
    }
    place = tmp_path_factory.mktemp("elsewhere")
    one = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    two = {"OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}
    given["weights"] = weights
    return {
        "own": _run_elsewhere(place, given, "own", **one),
        "oldest": _run_elsewhere(place, given, "oldest", OPENBLAS_CORETYPE="PRESCOTT", **one),
        "two threads": _run_elsewhere(place, given, "two", **two),
    }


@pytest.mark.parametrize("where", ["oldest", "two threads"])
def test_another_linear_algebra_gives_the_same_answers(elsewhere, where):
    own, other = elsewhere["own"], elsewhere[where]
    if where == "oldest" and own["blas"] == other["blas"]:
        pytest.skip(f"this BLAS has one set of kernels: {own['blas']}")
    for shape, again in zip(own["shapes"], other["shapes"], strict=True):
        assert _projector_distance(shape, again) < 1e-8
    assert other["loss"] == pytest.approx(own["loss"], rel=1e-10)
    np.testing.assert_allclose(other["gradient"], own["gradient"], rtol=1e-8, atol=1e-10)
    assert np.mean(other["loaded"] == own["loaded"]) >= 0.995
    assert np.mean(other["fitted"] == own["fitted"]) >= 0.995


@pytest.fixture(scope="module")
def results(fitted, probed, collection, make_learner):
    """Return what must stay: spectra, losses at fixed and at learned weights, a point map."""
    naive = make_learner(weighting=None, epsilon=0.1).fit(probed[:5], collection.truths[:5])
    (p2p,) = fitted.point_maps(probed[5:])
    return {
        "evals": [shape.spectral.evals[:10].tolist() for shape in probed],
        "loss_at_ones": naive.loss_,
        "loss": fitted.loss_,
        "p2p": p2p.tolist(),
    }


def test_results_are_what_they_were(results):
    """A change of results goes into the changelog, and the file is made anew by SKFMAP_FREEZE=1."""
    if os.environ.get("SKFMAP_FREEZE"):
        FROZEN.write_text(json.dumps(results) + "\n", encoding="utf-8")
    frozen = json.loads(FROZEN.read_text(encoding="utf-8"))
    np.testing.assert_allclose(results["evals"], frozen["evals"], rtol=1e-8, atol=1e-8)
    assert results["loss_at_ones"] == pytest.approx(frozen["loss_at_ones"], rel=1e-9)
    assert results["loss"] == pytest.approx(frozen["loss"], rel=1e-3)
    assert np.mean(np.array(results["p2p"]) == frozen["p2p"]) >= 0.995
