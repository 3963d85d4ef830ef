"""What is kept on disk: nothing computed twice, confused, or lost to an interruption."""

import importlib
import linecache
import subprocess
import sys
import textwrap
import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import joblib
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, LeaveOneOut
from sklearn.pipeline import make_pipeline

import skfmap.basis
import skfmap.descriptors
import skfmap.ground_truth
from skfmap import DescriptorTransformer, Mesh, SpectralBasis
from skfmap._tools import caching
from skfmap.descriptors import FunctionProbes
from skfmap.io import write_mesh
from skfmap.model_selection import PinnedReference


def _square(content, content_hash, power):
    return content**power


def test_code_of_a_function_is_written_by_one_at_a_time(tmp_path, monkeypatch):
    """Two that begin at once: the second waits, however long the first takes to write."""
    monkeypatch.setattr(caching, "_AGREED", set())
    joblib.memory._FUNCTION_HASHES.pop(_square, None)
    backend = joblib._store_backends.FileSystemStoreBackend
    write, read = backend.store_cached_func_code, backend.get_cached_func_code
    writing, both, met = threading.Event(), threading.Barrier(2), []

    def slow_write(self, call_id, func_code=None):
        if func_code is not None:
            met.append(writing.is_set())
            writing.set()
            threading.Event().wait(0.3)  # time for the other to come by
        write(self, call_id, func_code)
        if func_code is not None:
            writing.clear()

    def watched_read(self, call_id):
        met.append(writing.is_set())
        return read(self, call_id)

    monkeypatch.setattr(backend, "store_cached_func_code", slow_write)
    monkeypatch.setattr(backend, "get_cached_func_code", watched_read)

    def one(content):
        recall = caching.cached(_square, str(tmp_path))
        both.wait()
        return recall(content, f"hash of {content}", 2)

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(one, [3, 5])) == [9, 25]
    assert met
    assert not any(met)


@pytest.fixture
def calls(monkeypatch):
    """Count how often a basis and the heat kernel signatures are computed."""
    counts = Counter()

    def count(module, name):
        original = getattr(module, name)

        def counted(*arguments, **keywords):
            counts[name] += 1
            return original(*arguments, **keywords)

        monkeypatch.setattr(module, name, counted)

    count(skfmap.basis, "laplacian_eigenbasis")
    count(skfmap.descriptors.signatures, "heat_kernel_signature")
    return counts


def test_a_cache_gives_the_same_and_computes_once(tmp_path, calls, collection):
    meshes = collection.meshes[:2]
    plain = DescriptorTransformer("paper").transform(SpectralBasis(15).transform(meshes))
    calls.clear()
    for memory in (str(tmp_path), joblib.Memory(str(tmp_path), verbose=0)):
        basis, descriptors = (
            SpectralBasis(15, memory=memory),
            DescriptorTransformer("paper", memory=memory),
        )
        for X in (
            meshes,
            meshes[::-1],
            [Mesh(meshes[0].vertices, meshes[0].faces, name="renamed")],
        ):
            probed = descriptors.transform(basis.transform(X))
            assert_array_equal(probed[-1].probes, plain[0 if X is not meshes else 1].probes)
        assert probed[0].name == "renamed"
    assert calls == {"laplacian_eigenbasis": 2, "heat_kernel_signature": 2}


def test_a_cache_tells_parameters_apart(tmp_path, calls, collection):
    mesh = collection.meshes[:1]

    def run(n_components=15, laplacian="cotangent", **parameters):
        basis = SpectralBasis(n_components, laplacian=laplacian, memory=str(tmp_path))
        descriptors = DescriptorTransformer("paper", memory=str(tmp_path)).set_params(**parameters)
        plain = (
            clone(descriptors)
            .set_params(memory=None)
            .transform(clone(basis).set_params(memory=None).transform(mesh))
        )
        calls.clear()
        (probed,) = descriptors.transform(basis.transform(mesh))
        assert_array_equal(probed.probes, plain[0].probes)
        assert_array_equal(probed.spectral.evecs, plain[0].spectral.evecs)
        return calls["laplacian_eigenbasis"], calls["heat_kernel_signature"]

    assert run() == (1, 1)
    assert run() == (0, 0)
    assert run(n_components=16) == (0, 1)  # a part of the basis that is kept
    assert run(n_components=200) == (1, 1)
    assert run(laplacian="robust") == (1, 1)
    assert run(hks__t_min=0.02) == (0, 1)
    assert run(wks_wide__sigma=0.7) == (0, 1)
    assert run() == (0, 0)


def test_a_cache_is_not_confused_by_two_meshes_of_one_name(tmp_path, collection):
    first, second = (Mesh(m.vertices, m.faces, name="cat") for m in collection.meshes[:2])
    cached, plain = (
        DescriptorTransformer("paper", memory=memory).transform(
            SpectralBasis(15, memory=memory).transform([first, second])
        )
        for memory in (str(tmp_path), None)
    )
    for one, other in zip(cached, plain, strict=True):
        assert_array_equal(one.probes, other.probes)
        assert_array_equal(one.spectral.evals, other.spectral.evals)


def test_a_search_computes_each_basis_once(tmp_path, calls, make_model, collection):
    grid = {"learner__weighting": [None, "category"]}
    search = GridSearchCV(
        make_model(memory=str(tmp_path)), grid, cv=PinnedReference(2), error_score="raise"
    )
    search.fit(collection.meshes[:4], collection.truths[:4])
    assert calls == {"laplacian_eigenbasis": 4, "heat_kernel_signature": 4}


def test_the_memory_of_a_pipeline_works_too(tmp_path, calls, make_learner, collection):
    model = make_pipeline(
        SpectralBasis(20), DescriptorTransformer("paper"), make_learner(), memory=str(tmp_path)
    )
    fresh = [Mesh(mesh.vertices, mesh.faces, mesh.name) for mesh in collection.meshes[:3]]
    first = model.fit(fresh, collection.truths[:3]).predict(collection.meshes[5:])
    calls.clear()
    second = model.fit(fresh, collection.truths[:3])
    assert not calls
    assert_array_equal(second.predict(collection.meshes[5:]), first)


def test_who_asks_for_one_basis_at_once_shares_one_computation(tmp_path, collection, monkeypatch):
    computed = []
    original = skfmap.basis.laplacian_eigenbasis
    monkeypatch.setattr(
        skfmap.basis, "laplacian_eigenbasis", lambda *a: computed.append(a) or original(*a)
    )
    ask = lambda _: SpectralBasis(20, memory=tmp_path).transform(collection.meshes[:2])
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(ask, range(4)))
    assert len(computed) == 2
    for shapes in results[1:]:
        assert_array_equal(shapes[0].evecs, results[0][0].evecs)


def test_ground_truth_is_fitted_once_for_all_grid_points_and_folds(
    tmp_path, make_learner, probed, collection, monkeypatch
):
    fitted_pairs = Counter()
    original = skfmap.ground_truth.map_from_pairs
    monkeypatch.setattr(
        skfmap.ground_truth,
        "map_from_pairs",
        lambda *a: fitted_pairs.update(["map"]) or original(*a),
    )
    probed, truths = probed[:4], collection.truths[:4]
    grid = {"weighting": [None, "unique"], "alpha": [1e-3]}
    cv = PinnedReference(LeaveOneOut())
    search = GridSearchCV(
        make_learner(memory=str(tmp_path)), grid, cv=cv, error_score="raise", refit=False
    )
    search.fit(probed, truths)
    assert fitted_pairs["map"] == 3
    plain = GridSearchCV(
        make_learner(memory=None), grid, cv=cv, error_score="raise", refit=False
    ).fit(probed, truths)
    assert_array_equal(search.cv_results_["mean_test_score"], plain.cv_results_["mean_test_score"])
    assert fitted_pairs["map"] == 3 + 3 * 2 * 2


def test_ground_truth_in_a_cache_is_told_apart_by_pairs_and_size(
    tmp_path, make_learner, probed, collection
):
    fewer = [truth.restrict(truth.pairs[::2, 1]) for truth in collection.truths]
    for truths, k in ((collection.truths, 12), (fewer, 12), (collection.truths, 10)):
        cached, plain = (
            make_learner(weighting=None, n_functions=k, memory=memory).fit(probed[:4], truths[:4])
            for memory in (str(tmp_path), None)
        )
        assert_array_equal(cached.stable_basis_, plain.stable_basis_)
        assert_array_equal(
            cached.error_models_["unrefined"].confidence,
            plain.error_models_["unrefined"].confidence,
        )


def test_a_file_that_changes_is_read_again(tmp_path, collection):
    path, basis = tmp_path / "body.off", SpectralBasis(15, memory=str(tmp_path / "cache"))
    evals = []
    for mesh in collection.meshes[:2]:
        write_mesh(mesh, path)
        evals.append(basis.transform([path])[0].evals)
    assert not np.array_equal(*evals)


_SEARCH = """
    import sys
    import joblib
    from sklearn.model_selection import GridSearchCV
    from sklearn.pipeline import make_pipeline
    import skfmap
    from skfmap.model_selection import PinnedReference

    if __name__ == "__main__":
        location = sys.argv[1]
        meshes, truths = joblib.load(sys.argv[2])
        memory = joblib.Memory(location, verbose=1)  # tells each call that is not in the cache
        model = make_pipeline(
            skfmap.SpectralBasis(30, memory=memory),
            skfmap.DescriptorTransformer("paper", memory=memory),
            skfmap.WeightedFunctionalMapLearner(
                n_functions=10, weighting=None, refine=None, memory=location
            ),
        )
        grid = {
            "weightedfunctionalmaplearner__alpha": [1e-3, 1e-2],
            "spectralbasis__n_components": [20, 30],
        }
        search = GridSearchCV(model, grid, cv=PinnedReference(2), n_jobs=2, error_score="raise")
        search.fit(meshes, truths)
        print("best", search.best_params_, search.best_score_.hex())
"""


def test_a_search_from_a_cold_cache_computes_each_basis_once_in_two_processes(tmp_path, collection):
    script = tmp_path / "search.py"
    script.write_text(textwrap.dedent(_SEARCH))
    command = [sys.executable, str(script), str(tmp_path / "cache"), str(tmp_path / "given.joblib")]
    joblib.dump((collection.meshes[:5], collection.truths[:5]), tmp_path / "given.joblib")
    told = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout
    assert told.count("Calling skfmap.basis._eigenbasis") == 5
    assert (
        told.count("Calling skfmap.descriptors.transformer._stacked") == 5 * 2
    )  # two numbers of components


def test_an_interruption_keeps_what_is_finished(tmp_path, collection, monkeypatch):
    computed, original = [], skfmap.basis.laplacian_eigenbasis

    def interrupted_at_the_third(*arguments):
        computed.append(1)
        if len(computed) == 3:
            raise KeyboardInterrupt
        return original(*arguments)

    monkeypatch.setattr(skfmap.basis, "laplacian_eigenbasis", interrupted_at_the_third)
    basis = SpectralBasis(20, memory=str(tmp_path))
    with pytest.raises(KeyboardInterrupt):
        basis.transform(collection.meshes)
    shapes = basis.transform(collection.meshes)
    assert len(computed) == 2 + 1 + 4  # two finished, one interrupted, four after it
    for shape, plain in zip(shapes, SpectralBasis(20).transform(collection.meshes), strict=True):
        assert_array_equal(shape.evecs, plain.evecs)


def test_a_cache_notices_that_what_a_function_calls_has_changed(collection, tmp_path, monkeypatch):
    """A helper in the same module, a constant, and a module of one's own."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    shapes = SpectralBasis(10).transform(collection.meshes[:1])

    def probe(body, other="AXIS = 0\n"):
        (tmp_path / "own_probes.py").write_text(body)
        (tmp_path / "own_helpers.py").write_text(other)
        linecache.clearcache()
        for name in ("own_probes", "own_helpers"):
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        function = importlib.import_module("own_probes").height
        family = [("own", FunctionProbes(function))]
        cached, plain = (
            DescriptorTransformer(family, memory=memory)
            for memory in (str(tmp_path / "cache"), None)
        )
        np.testing.assert_array_equal(
            cached.transform(shapes)[0].probes, plain.transform(shapes)[0].probes
        )
        return plain.transform(shapes)[0].probes

    helper = (
        "def helper(shape): return shape.vertices[:, {}]\ndef height(shape): return helper(shape)\n"
    )
    constant = "AXIS = {}\ndef height(shape): return shape.vertices[:, AXIS]\n"
    imported = "import own_helpers\ndef height(shape): return shape.vertices[:, own_helpers.AXIS]\n"
    for bodies in ((helper.format(0), helper.format(2)), (constant.format(0), constant.format(2))):
        one, other = (probe(body) for body in bodies)
        assert np.abs(one - other).max() > 0.01
    one, other = probe(imported), probe(imported, "AXIS = 2\n")
    assert np.abs(one - other).max() > 0.01
