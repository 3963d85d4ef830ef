"""Model files from strangers: refused before anything in them runs, whatever they are made of."""

import json
import pickle
import sys
import warnings
import zipfile
from functools import partial
from io import BytesIO
from operator import attrgetter

import joblib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.ensemble import RandomForestClassifier
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap.exceptions import VersionWarning
from skfmap.persistence import load_model, save_model

skops_io = pytest.importorskip("skops.io")


@pytest.fixture(scope="module")
def saved(fitted, tmp_path_factory):
    """Return the bytes of a sound file of a fitted learner."""
    path = tmp_path_factory.mktemp("saved") / "model.skops"
    save_model(fitted, path)
    return path.read_bytes()


def _members(content):
    with zipfile.ZipFile(BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def _write(path, members, compression=zipfile.ZIP_STORED):
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def _with_schema(path, schema):
    return _write(
        path, {"schema.json": json.dumps({**schema, "protocol": 2, "_skops_version": "0.13.0"})}
    )


class Runs:
    """Unpickling this leaves a mark."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return open, (str(self.mark), "w")


@pytest.mark.parametrize("dump", [pickle.dump, joblib.dump])
def test_a_pickle_is_not_loaded(tmp_path, dump):
    mark, path = tmp_path / "mark", tmp_path / "model.skops"
    with path.open("wb") as file:
        dump(Runs(mark), file)
    with pytest.raises(
        ValueError,
        match=r"is not a valid file of save_model: BadZipFile.*Was it written by joblib or",
    ):
        load_model(path)
    assert not mark.exists()


# How each loader of skops would be told to reach a module that leaves a mark when it is imported.
def _attacks(module):
    evil = {"__class__": "run", "__module__": module}
    number = {
        "__class__": "str",
        "__module__": "builtins",
        "__loader__": "JsonNode",
        "content": "1",
        "is_json": True,
    }
    arguments = {
        "__class__": "tuple",
        "__module__": "builtins",
        "__loader__": "TupleNode",
        "content": [number],
    }
    function = {
        **evil,
        "__loader__": "FunctionNode",
        "content": {"module_path": module, "function": "run"},
    }
    keys = {"__class__": "list", "__module__": "builtins", "__loader__": "ListNode", "content": []}
    contents = {
        "content": arguments,
        "type": "numpy",
        "file": "1.npy",
        "shape": arguments,
        "constructor": function,
        "args": arguments,
        "reduce": {"args": arguments, "state": None},
        "func": function,
        "kwds": {},
        "namespace": {},
        "attrs": arguments,
        "key_types": keys,
        "obj": function,
        "default_factory": function,
        "state": number,
        "content_type": "state",
    }
    for loader, protocol in sorted(set(skops_io._audit.NODE_TYPE_MAPPING)):
        yield (
            f"{loader}, protocol {protocol}",
            {**contents, **evil, "__loader__": loader, "protocol": protocol},
        )
        nested = {"func": function, "obj": function}
        inside = {
            **function,
            "content": {**nested, "module_path": module, "function": "run"},
            "__loader__": loader,
        }
        yield (
            f"{loader} in a list, protocol {protocol}",
            {**keys, "content": [inside], "protocol": protocol},
        )


def test_no_loader_reaches_a_module_that_is_no_part_of_a_model(tmp_path, monkeypatch):
    """Neither the audit nor the loading imports what a file names."""
    (tmp_path / "evil_module.py").write_text(
        f"open({str(tmp_path / 'mark')!r}, 'w')\ndef run(*a, **k): pass\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    attacks = dict(_attacks("evil_module"))
    assert len(attacks) > 40
    for attack, schema in attacks.items():
        path = tmp_path / "model.skops"
        _write(
            path, {"schema.json": json.dumps({"_skops_version": "0.13.0", **schema}), "1.npy": b""}
        )
        with pytest.raises(
            (TypeError, ValueError), match=r"not part of a skfmap model: .*run|not a valid file"
        ):
            load_model(path)
        assert "evil_module" not in sys.modules, attack
        assert not (tmp_path / "mark").exists(), attack


@pytest.mark.parametrize(
    "stranger",
    [
        partial(print, "called"),
        attrgetter("__globals__"),
        np.fromfile,
        [].append,
        RandomForestClassifier(2, max_depth=2).fit([[0.0], [1.0]], [0, 1]),
        slice(1, 2),
    ],
    ids=lambda item: type(item).__name__,
)
def test_what_no_model_is_made_of_is_refused(tmp_path, stranger):
    """Also what skops trusts: trees of scikit-learn crash on indices that a file made up."""
    path = tmp_path / "model.skops"
    skops_io.dump({"step": stranger}, path)
    with pytest.raises(
        (TypeError, ValueError), match=r"not part of a skfmap model|is not a valid file"
    ):
        load_model(path)


def test_a_file_cannot_name_a_cache(fitted, collection, tmp_path, monkeypatch):
    """A cache is read with pickle: a model with one beside it would run what lies there."""
    basis = skfmap.SpectralBasis(30, memory=str(tmp_path / "cache"))
    model = make_pipeline(
        basis, skfmap.DescriptorTransformer(), fitted, memory=str(tmp_path / "steps")
    )
    path = tmp_path / "model.skops"
    skops_io.dump(model, path)  # as a stranger would
    loaded = load_model(path)
    assert loaded.memory is None
    assert loaded[0].memory is None
    loaded.predict(collection.meshes[:1])
    assert not (tmp_path / "cache").exists()
    own = load_model(path, memory=str(tmp_path / "own"))
    assert [step.memory for step in own] == [str(tmp_path / "own")] * 3
    own.predict(collection.meshes[:1])
    assert (tmp_path / "own").exists()


def test_a_step_in_an_array_of_objects_is_refused(fitted, tmp_path):
    """Arrays of objects hold names of probes; an estimator there would bring its own cache."""
    model = make_pipeline(skfmap.SpectralBasis(30, memory=str(tmp_path / "cache")), fitted)
    step = np.empty(2, dtype=object)
    step[:] = list(model.steps[0])
    model.steps = [step, model.steps[1]]
    skops_io.dump(model, tmp_path / "model.skops")
    with pytest.raises(TypeError, match=r"not part of a skfmap model.*skfmap.basis.SpectralBasis"):
        load_model(tmp_path / "model.skops")


def test_a_mesh_is_made_by_its_constructor_alone(saved, tmp_path):
    """One made from a state would not be checked, and could bring a hash of its own."""
    members = _members(saved)
    schema = json.loads(members["schema.json"])
    spectral = schema["content"]["content"]["matcher_"]["content"]["content"]["reference"][
        "content"
    ]["content"]["spectral"]["content"]["content"]
    spectral["mesh"] |= {"__loader__": "ObjectNode"}
    members["schema.json"] = json.dumps(schema).encode()
    with pytest.raises(TypeError, match=r"not part of a skfmap model: skfmap.shapes.mesh.Mesh"):
        load_model(_write(tmp_path / "model.skops", members))


def test_what_a_shape_computes_of_itself_is_not_read(fitted, tmp_path):
    reference = fitted.reference_
    vars(reference.spectral)["vertices"] = np.zeros((3, 3))
    try:
        skops_io.dump(fitted, tmp_path / "model.skops")
    finally:
        del vars(reference.spectral)["vertices"]
    loaded = load_model(tmp_path / "model.skops").reference_.spectral
    np.testing.assert_array_equal(loaded.vertices, reference.spectral.vertices)


def test_one_array_that_is_read_many_times_cannot_fill_the_memory(saved, tmp_path):
    members = _members(saved)
    name = next(name for name in members if name.endswith(".npy"))
    node = {
        "__class__": "ndarray",
        "__module__": "numpy",
        "__loader__": "NdArrayNode",
        "type": "numpy",
        "file": name,
    }
    schema = {
        "__class__": "list",
        "__module__": "builtins",
        "__loader__": "ListNode",
        "content": [node, node],
    }
    members["schema.json"] = json.dumps(json.loads(members["schema.json"]) | schema).encode()
    with pytest.raises(
        ValueError, match="it uses one array several times, which save_model never does"
    ):
        load_model(_write(tmp_path / "model.skops", members))


@pytest.mark.parametrize("kind", [str, joblib.Memory, lambda folder: folder])
def test_a_model_with_a_cache_is_saved_without_it(tmp_path, kind):
    basis = skfmap.SpectralBasis(30, memory=kind(tmp_path / "cache"))
    save_model(basis, tmp_path / "basis.skops")
    assert basis.memory is not None
    assert load_model(tmp_path / "basis.skops").memory is None


def test_a_packed_file_cannot_fill_the_memory(saved, tmp_path):
    path = _write(tmp_path / "model.skops", _members(saved), zipfile.ZIP_DEFLATED)
    with pytest.raises(ValueError, match="it is compressed, but save_model never compresses"):
        load_model(path)


@pytest.mark.parametrize(
    "head",
    [
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }",
        b"{'descr': '|O', 'shape': (2,)}",
    ],
)
def test_arrays_that_say_more_than_they_hold_are_errors(saved, tmp_path, head):
    members = _members(saved)
    name = next(name for name in members if name.endswith(".npy"))
    members[name] = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + b"\x80\x04."
    with pytest.raises(ValueError, match="is not a valid file of save_model"):
        load_model(_write(tmp_path / "model.skops", members))


def _swap_array(members, path, change):
    """Rewrite the array at a path in the tree of a saved learner."""
    node = json.loads(members["schema.json"])
    for key in path:
        node = node["content"]["content"][key]
    buffer = BytesIO()
    np.save(buffer, change(np.load(BytesIO(members[node["file"]]))))
    members[node["file"]] = buffer.getvalue()


def _out_of_range(array):
    array = array.copy()
    array.flat[3] = 10**6
    return array


@pytest.mark.parametrize(
    ("path", "change", "message"),
    [
        (["matcher_", "reference", "spectral", "evecs"], lambda a: a[:-1], "eigenfunctions"),
        (["matcher_", "reference", "spectral", "evals"], lambda a: a[:-1], "probes"),
        (["matcher_", "reference", "spectral", "mass"], lambda a: a.astype(complex), "mass"),
        (["matcher_", "reference", "probes"], lambda a: a.T[:2], "probes"),
    ],
    ids=["evecs", "evals", "mass", "probes"],
)
def test_parts_that_do_not_fit_are_errors(saved, tmp_path, path, change, message):
    members = _members(saved)
    _swap_array(members, path, change)
    with pytest.raises(
        ValueError, match=f"is not a valid file of save_model: ValueError: the {message} have shape"
    ):
        load_model(_write(tmp_path / "model.skops", members))


def test_indices_that_compiled_code_would_follow_are_checked(saved, tmp_path):
    """Faces of the reference, and the sparse stiffness matrix."""
    members = _members(saved)
    faces = next(
        name
        for name, array in _arrays(members)
        if array.dtype.kind == "i" and array.shape[-1:] == (3,)
    )
    buffer = BytesIO()
    np.save(buffer, _out_of_range(np.load(BytesIO(members[faces]))))
    with pytest.raises(ValueError, match="is not a valid file of save_model: MeshError"):
        load_model(_write(tmp_path / "model.skops", {**members, faces: buffer.getvalue()}))
    with pytest.raises(ValueError, match="is not a valid file of save_model"):
        load_model(_write(tmp_path / "model.skops", _with_stray_indices(members)))


def _with_stray_indices(members):
    """Return a file whose sparse matrix leads nowhere; older skops writes its arrays one by one."""
    buffer = BytesIO()
    if sparse := [name for name in members if name.endswith(".npz")]:
        with np.load(BytesIO(members[sparse[0]])) as stored:
            parts = dict(stored)
        np.savez(buffer, **{**parts, "indices": _out_of_range(parts["indices"])})
        return {**members, sparse[0]: buffer.getvalue()}
    flat = [
        (name, array)
        for name, array in _arrays(members)
        if array.dtype.kind == "i" and array.ndim == 1
    ]
    name, indices = max(flat, key=lambda one: one[1].size)
    np.save(buffer, _out_of_range(indices))
    return {**members, name: buffer.getvalue()}


def _arrays(members):
    for name, content in members.items():
        if name.endswith(".npy"):
            yield name, np.load(BytesIO(content))


_CHANGES = st.lists(
    st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), min_size=1, max_size=4
)


@given(changes=_CHANGES, kept=st.floats(0.01, 1), in_tree=st.booleans(), whole=st.booleans())
@settings(max_examples=150)
def test_damaged_files_are_loaded_whole_or_refused(
    saved, tmp_path_factory, changes, kept, in_tree, whole
):
    """Cut short, or with bytes changed: one error, or a learner."""
    content = bytearray(saved if whole else saved[: int(kept * len(saved))])
    # The tree lies at the end of the file: what is changed there is structure, elsewhere numbers.
    first = len(saved) - len(_members(saved)["schema.json"]) if in_tree and whole else 0
    for place, flipped in changes:
        content[first + int(place * (len(content) - first))] ^= flipped
    path = tmp_path_factory.getbasetemp() / "damaged.skops"
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", VersionWarning)
        told, model = _load_or_complain(path)
    assert told is None or str(path) in told
    assert told is not None or isinstance(model, skfmap.WeightedFunctionalMapLearner)


def _load_or_complain(path):
    try:
        return None, load_model(path)
    except (TypeError, ValueError) as error:
        return str(error), None


@pytest.mark.parametrize("content", [b"", b"PK", b"{}", b"\x00" * 1000])
def test_what_is_no_model_file_is_said_to_be_none(tmp_path, content):
    (tmp_path / "model.skops").write_bytes(content)
    with pytest.raises(ValueError, match="is not a valid file of save_model"):
        load_model(tmp_path / "model.skops")
    with pytest.raises(FileNotFoundError, match="There is no model file"):
        load_model(tmp_path / "none.skops")


@pytest.mark.parametrize(
    "schema", [[], {}, "x", {"__loader__": "ObjectNode"}, {"__loader__": 3}, {"content": [[[]]]}]
)
def test_trees_without_a_model_are_errors(tmp_path, schema):
    path = _write(tmp_path / "model.skops", {"schema.json": json.dumps(schema)})
    with pytest.raises((TypeError, ValueError), match=r"is not a valid file|not part of a model"):
        load_model(path)
    deep = _write(tmp_path / "deep.skops", {"schema.json": "[" * 100_000 + "]" * 100_000})
    with pytest.raises(ValueError, match="RecursionError"):
        load_model(deep)
