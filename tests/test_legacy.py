"""Models that 0.1.0 saved before its learner was an assembly of parts, in files of then."""

import json
from pathlib import Path
from zipfile import ZipFile

import joblib
import numpy as np
import pytest

import skfmap
from skfmap.exceptions import OutdatedModelError
from skfmap.learner.legacy import upgraded
from skfmap.persistence import load_model, save_model

DATA = Path(__file__).parent / "data"


@pytest.fixture(scope="module")
def new_shape(make_bodies):
    return make_bodies([(120, 0.0), (110, 0.1), (130, -0.1), (140, 0.05)], symmetric=False).meshes[
        3
    ]


# Whoever reads the files has other versions than whoever wrote them.
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.InconsistentVersionWarning")
@pytest.mark.filterwarnings("ignore::skfmap.exceptions.VersionWarning")
@pytest.mark.parametrize("suffix", ["skops", "joblib"])
def test_a_model_of_before_matches_as_it_did(suffix, new_shape, tmp_path):
    path = DATA / f"model-0.1.0.{suffix}"
    if suffix == "skops":
        pytest.importorskip("skops")
    model = load_model(path) if suffix == "skops" else joblib.load(path)
    then = np.load(DATA / "model-0.1.0-match.npz")
    (match,) = skfmap.match(model, [new_shape])
    assert (match.p2p == then["p2p"]).mean() > 0.97, "but for ties between neighbours"
    np.testing.assert_allclose(
        match.expected_error.mean(), then["expected_error"].mean(), rtol=0.02
    )
    np.testing.assert_allclose(match.functional_map, then["functional_map"], atol=1e-6)
    learner = model[-1]
    assert learner.refine_.step == 10
    assert learner.n_training_shapes_ == 2
    assert learner.loss_ == learner.loss_curve_[-1]
    assert "bridge" not in learner.get_params()
    assert learner.get_params()["on_mirrored"] == "warn"
    assert learner.landmarks_ is None
    assert learner.known_maps_ is None
    if suffix == "skops":
        save_model(model, tmp_path / "again.skops")
        (again,) = skfmap.match(load_model(tmp_path / "again.skops"), [new_shape])
        np.testing.assert_array_equal(again.p2p, match.p2p)


def test_a_model_that_went_through_a_bridge_says_that_it_must_be_fitted_again(tmp_path):
    pytest.importorskip("skops")
    path = tmp_path / "bridged.skops"
    with ZipFile(DATA / "model-0.1.0.skops") as old, ZipFile(path, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "schema.json":
                schema = json.loads(content)
                _bridged(schema)
                content = json.dumps(schema)
            new.writestr(name, content)
    with pytest.raises(OutdatedModelError, match=r"Fit it again, with skfmap\.BridgedLearner"):
        load_model(path)


def _bridged(node):
    """Set the parameter ``bridge`` of the learner in a schema to "auto"."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        if key == "bridge":
            value |= {"content": '"auto"', "__id__": 0}  # that of None is shared by all None
        elif isinstance(value, (dict, list)):
            _bridged(value)


def test_an_unfitted_learner_of_before_is_read():
    state = upgraded(
        {"bridge": None, "n_functions": 8, "_skfmap_version": "0.1.0", "_sklearn_version": "1.7"}
    )
    assert state == {
        "n_functions": 8,
        "confidence": "cross-fit",
        "_skfmap_version": "0.1.0",
        "_sklearn_version": "1.7",
    }
