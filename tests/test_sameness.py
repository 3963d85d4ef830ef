"""Results that do not move: over threads, over time."""

import json
import os
from pathlib import Path

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


@pytest.fixture(scope="module")
def results(fitted, probed, collection, make_learner):
    """Return what is compared with what it was: spectra, the loss at fixed weights, the learned loss, a point map."""
    naive = make_learner(weighting=None, epsilon=0.1).fit(probed[:5], collection.truths[:5])
    (p2p,) = fitted.point_maps(probed[5:])
    return {
        "evals": [shape.spectral.evals[:10].tolist() for shape in probed],
        "loss_at_ones": naive.loss_,
        "loss": fitted.loss_,
        "p2p": p2p.tolist(),
    }


def test_results_are_what_they_were(results):
    """A difference is a change of results: say it in the changelog, and write the file anew with SKFMAP_FREEZE=1."""
    if os.environ.get("SKFMAP_FREEZE"):
        FROZEN.write_text(json.dumps(results) + "\n", encoding="utf-8")
    frozen = json.loads(FROZEN.read_text(encoding="utf-8"))
    np.testing.assert_allclose(results["evals"], frozen["evals"], rtol=1e-8, atol=1e-8)
    assert results["loss_at_ones"] == pytest.approx(frozen["loss_at_ones"], rel=1e-9)
    assert results["loss"] == pytest.approx(frozen["loss"], rel=1e-3)
    assert np.mean(np.array(results["p2p"]) == frozen["p2p"]) >= 0.995
