"""Warnings point at the line of whoever called, whichever way the call came in."""

import warnings
from pathlib import Path

import joblib
import numpy as np
import pytest
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import DescriptorTransformer, Mesh, SpectralBasis
from skfmap._tools.warn import warn
from skfmap.exceptions import (
    OrientationWarning,
    SkippedShapeWarning,
    UnfamiliarShapeWarning,
    VersionWarning,
)
from skfmap.model_selection import PinnedReference
from skfmap.persistence import load_model, save_model


def _lines_of(function, category):
    """Return the files and the lines that warnings of a category point at."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        function()
    return [
        (Path(one.filename), one.lineno) for one in caught if issubclass(one.category, category)
    ]


def _line_of(function):
    return Path(__file__), function.__code__.co_firstlineno


@pytest.fixture(scope="module")
def stretched(collection):
    """A shape that is not like the training shapes."""
    body = collection.meshes[5]
    return Mesh(body.vertices * [3.0, 1, 1], body.faces, name="stretched")


@pytest.fixture(scope="module")
def search(collection, make_model):
    grid = {"learner__alpha": [0.01]}
    search = GridSearchCV(make_model(confidence="cross-fit"), grid, cv=PinnedReference(2))
    return search.fit(collection.meshes[:5], collection.truths[:5])


def test_a_warning_from_nowhere_else_points_here():
    route = lambda: warn("told", UserWarning)
    assert _lines_of(route, UserWarning) == [_line_of(route)]


def test_warnings_of_new_shapes_point_at_the_call(model, search, probe, stretched):
    learner, shapes = model[-1], probe([stretched])
    routes = [
        lambda: learner.match(shapes),
        lambda: learner.predict(shapes),
        lambda: learner.functional_maps(shapes),
        lambda: model.predict([stretched]),
        lambda: search.predict([stretched]),
        lambda: search.best_estimator_.predict([stretched]),
        lambda: skfmap.match(model, [stretched]),
        lambda: skfmap.match(search, [stretched]),
        lambda: skfmap.functional_maps(model, [stretched]),
    ]
    for route in routes:
        assert _lines_of(route, UnfamiliarShapeWarning) == [_line_of(route)]


def test_warnings_of_a_fit_point_at_the_call(collection, make_model, make_learner, probe):
    """Through the wrapper of scikit-learn's callbacks, a pipeline, a search."""
    mirrored = Mesh(
        collection.meshes[2].vertices * [1, 1, -1],
        collection.meshes[2].faces[:, ::-1],
        name="mirrored",
    )
    meshes = [*collection.meshes[:2], mirrored, *collection.meshes[3:5]]
    shapes, truths = probe(meshes), collection.truths[:5]
    model, learner = make_model(confidence=None), make_learner(confidence=None)
    search = GridSearchCV(model, {"learner__alpha": [0.01]}, cv=[(np.arange(4), [4])], refit=True)
    for route in (
        lambda: learner.fit(shapes, truths),
        lambda: model.fit(meshes, truths),
    ):
        assert _lines_of(route, OrientationWarning) == [_line_of(route)]
    route = lambda: search.fit(meshes, truths)
    told = _lines_of(route, OrientationWarning)
    assert len(told) == 2, "one fold and the last fit"
    assert set(told) == {_line_of(route)}


def test_warnings_of_transformers_point_at_the_call(collection):
    broken = Mesh(np.eye(3), [[0, 1, 2]], name="broken")  # nothing makes it large enough
    basis = SpectralBasis(20, on_invalid="skip")
    pipeline = make_pipeline(basis, DescriptorTransformer("paper"))
    for route in (
        lambda: basis.transform([collection.meshes[1], broken]),
        lambda: basis.fit_transform([collection.meshes[1], broken]),
        lambda: pipeline.transform([collection.meshes[1], broken]),
    ):
        assert _lines_of(route, SkippedShapeWarning) == [_line_of(route)]


def test_shapes_given_as_arrays_are_told_by_their_index(collection, make_model):
    arrays = [(mesh.vertices, mesh.faces) for mesh in collection.meshes[:5]]
    arrays[3] = (arrays[3][0] * [1, 1, -1], arrays[3][1][:, ::-1])
    with pytest.warns(
        OrientationWarning, match=r"correspondences of X\[3\] \('shape 3'\) confuse left and right"
    ):
        make_model(confidence=None).fit(arrays, collection.truths[:5])


def test_warnings_of_files_point_at_the_call(tmp_path, monkeypatch, fitted):
    pytest.importorskip("skops")
    save_model(fitted, tmp_path / "model.skops")
    joblib.dump(fitted, tmp_path / "model.joblib")
    monkeypatch.setattr("skfmap._version.__version__", "99.0")
    for route in (
        lambda: load_model(tmp_path / "model.skops"),
        lambda: joblib.load(tmp_path / "model.joblib"),
    ):
        assert set(_lines_of(route, VersionWarning)) == {_line_of(route)}
