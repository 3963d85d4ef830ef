"""Models in files: the same predictions, nothing beside what they need, and who saved them."""

import pickle
import subprocess
import sys
import textwrap
from pathlib import Path

import joblib
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.model_selection import GridSearchCV
from sklearn.preprocessing import FunctionTransformer

import skfmap
from skfmap.descriptors import FunctionProbes, default_families
from skfmap.exceptions import VersionWarning
from skfmap.learner.parameters import WORDS
from skfmap.model_selection import PinnedReference
from skfmap.persistence import TRUSTED_TYPES, load_model, save_model

needs_skops = pytest.mark.skipif(
    "not __import__('importlib.util').util.find_spec('skops')", reason="skops is missing"
)


@pytest.mark.parametrize("dump", ["pickle", "joblib"])
def test_a_saved_model_predicts_bit_by_bit_the_same(model, collection, tmp_path, dump):
    if dump == "pickle":
        again = pickle.loads(pickle.dumps(model))
    else:
        joblib.dump(model, tmp_path / "model.joblib")
        again = joblib.load(tmp_path / "model.joblib")
    assert_array_equal(again.predict(collection.meshes[4:]), model.predict(collection.meshes[4:]))
    for one, other in zip(
        *(skfmap.match(m, collection.meshes[4:]) for m in (again, model)), strict=True
    ):
        assert_array_equal(one.p2p, other.p2p)
        assert_array_equal(one.expected_error, other.expected_error)


def test_a_saved_model_holds_one_mesh(fitted, collection):
    saved = pickle.dumps(fitted)
    for mesh in collection.meshes[1:]:
        assert mesh.vertices.tobytes() not in saved
    assert fitted.reference_.spectral.mesh.vertices.tobytes() in saved


def test_a_model_of_another_version_says_so(fitted, monkeypatch):
    saved = pickle.dumps(fitted)
    assert pickle.loads(saved).get_params() == fitted.get_params()
    monkeypatch.setattr("skfmap._version.__version__", "99.0")
    with pytest.warns(VersionWarning, match=r"saved by skfmap .* loaded by 99\.0"):
        pickle.loads(saved)


_PREDICT = """
    import pathlib, sys
    import joblib, numpy as np
    import skfmap
    from skfmap.persistence import load_model

    path, out = pathlib.Path(sys.argv[1]), sys.argv[2]
    model = load_model(path) if path.suffix == ".skops" else joblib.load(path)
    meshes = [str(p) for p in sorted(path.parent.glob("*.npz"))]
    meshes = [skfmap.Mesh(**np.load(p)) for p in meshes]
    match, = skfmap.match(model, meshes)
    np.savez(out, maps=model.predict(meshes), p2p=match.p2p, expected_error=match.expected_error)
"""


@pytest.mark.parametrize("suffix", ["joblib", pytest.param("skops", marks=needs_skops)])
def test_a_fresh_process_predicts_bit_by_bit_the_same(suffix, model, collection, tmp_path):
    path, new = tmp_path / f"model.{suffix}", collection.meshes[5]
    save_model(model, path) if suffix == "skops" else joblib.dump(model, path)
    np.savez(tmp_path / "new.npz", vertices=new.vertices, faces=new.faces)
    script = tmp_path / "predict.py"
    script.write_text(textwrap.dedent(_PREDICT))
    subprocess.run(
        [sys.executable, str(script), str(path), str(tmp_path / "out")], check=True, timeout=300
    )
    told, (match,) = np.load(tmp_path / "out.npz"), skfmap.match(model, [new])
    assert_array_equal(told["maps"], model.predict([new]))
    assert_array_equal(told["p2p"], match.p2p)
    assert_array_equal(told["expected_error"], match.expected_error)


def test_a_model_is_no_larger_than_its_reference_in_its_basis(
    fitted, make_learner, probed, collection
):
    """The reference, Y, and tables: no other shape, no distances, however many taught it."""
    fitted.score(probed[5:], collection.truths[5:])  # computes distances, and must not keep them
    size = len(pickle.dumps(fitted))
    reference = len(pickle.dumps((fitted.reference_, fitted.reference_correspondence_)))
    n, k = fitted.reference_.spectral.mesh.n_vertices, fitted.n_functions
    assert size < reference + 8 * (k * k + 2 * len(fitted.weights_) + 1000) + 20_000
    assert size < 8 * n * n / 4
    assert (
        abs(len(pickle.dumps(make_learner().fit(probed[:3], collection.truths[:3]))) - size)
        < 10_000
    )


@needs_skops
def test_skops_says_which_version_saved_a_model(fitted, tmp_path, monkeypatch):
    save_model(fitted, tmp_path / "model.skops")
    monkeypatch.setattr("skfmap._version.__version__", "99.0")
    with pytest.warns(VersionWarning, match=r"saved by skfmap .* loaded by 99\.0"):
        load_model(tmp_path / "model.skops")


@needs_skops
def test_skops_holds_every_family_and_a_search(make_model, collection, tmp_path):
    model = make_model(weighting="category").set_params(
        probes__families=default_families(), basis__laplacian="robust"
    )
    model.fit(collection.meshes[:3], collection.truths[:3])
    save_model(model, tmp_path / "model.skops")
    again = load_model(tmp_path / "model.skops")
    assert_array_equal(again.predict(collection.meshes[3:]), model.predict(collection.meshes[3:]))
    assert again["learner"].loss_curve_ == model["learner"].loss_curve_
    assert not again["learner"].reference_.spectral.mesh.vertices.flags.writeable


def height(shape):
    return shape.vertices[:, 2]


@needs_skops
def test_a_file_with_strange_things_in_it_is_refused_before_it_is_loaded(tmp_path):
    path = tmp_path / "model.skops"
    save_model(FunctionTransformer(subprocess.run), path)
    with pytest.raises(
        TypeError, match=r"not part of a skfmap model: .*FunctionTransformer, subprocess\.run"
    ):
        load_model(path)
    save_model(FunctionProbes(height), path)
    with pytest.raises(TypeError, match="height"):
        load_model(path)
    own = f"{height.__module__}.height"
    if (
        height.__module__ in sys.modules
        and getattr(sys.modules[height.__module__], "height", None) is height
    ):
        assert (
            load_model(path, trusted=[own, "skfmap.descriptors.FunctionProbes"]).function is height
        )


def test_every_part_that_a_word_stands_for_can_be_loaded_again():
    for parts in WORDS.values():
        assert {f"{part.__module__}.{part.__qualname__}" for part in parts.values()} <= set(
            TRUSTED_TYPES
        )


def test_without_skops_the_message_says_what_to_install(fitted, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "skops.io", None)
    with pytest.raises(ImportError, match=r"pip install 'skfmap\[skops\]'"):
        save_model(fitted, tmp_path / "model.skops")


@needs_skops
def test_a_search_is_saved_by_its_best_estimator(make_learner, probed, collection, tmp_path):
    search = GridSearchCV(
        make_learner(weighting=None), {"alpha": [1e-2, 1e-1]}, cv=PinnedReference(2)
    )
    search.fit(probed[:4], collection.truths[:4])
    save_model(search.best_estimator_, tmp_path / "best.skops")
    assert_array_equal(
        load_model(tmp_path / "best.skops").predict(probed[4:]), search.predict(probed[4:])
    )


@needs_skops
def test_a_model_is_replaced_by_a_whole_one_only(fitted, tmp_path, monkeypatch):
    skops_io = pytest.importorskip("skops.io")
    path = tmp_path / "model.skops"
    save_model(fitted, path)
    before = path.read_bytes()

    def interrupted(model, file):
        Path(file).write_bytes(b"half")
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(skops_io, "dump", interrupted)
        with pytest.raises(KeyboardInterrupt):
            save_model(fitted, path)
    assert path.read_bytes() == before
    save_model(fitted, path)
    assert [file.name for file in tmp_path.iterdir()] == ["model.skops"]
