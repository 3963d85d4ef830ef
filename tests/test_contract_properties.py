"""Contracts of the package, for random damage, numberings, orders and files."""

import os
import pickle
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.base import clone

import skfmap
from skfmap import (
    Correspondence,
    DescriptorTransformer,
    Mesh,
    SpectralBasis,
    check_mesh,
    repair_mesh,
)
from skfmap.datasets import make_sphere
from skfmap.exceptions import MeshError, OrientationWarning, RepairWarning, SkippedShapeWarning
from skfmap.geometry.faults import sound_faces
from skfmap.io import read_mesh, write_mesh
from skfmap.metrics import (
    coverage,
    error_curve,
    geodesic_error,
    mean_over_shapes,
    reference_distances,
)
from skfmap.shapes import Prolongation, SkippedShape
from skfmap.shapes.usable import pick_usable, put_back

# The same cases in every run; SKFMAP_EXAMPLES=20 for twenty times as many, others each time.
_MORE = int(os.environ.get("SKFMAP_EXAMPLES", "1"))
_FIXTURES = [HealthCheck.function_scoped_fixture]
cases = settings(max_examples=100 * _MORE, suppress_health_check=_FIXTURES)
few_cases = settings(max_examples=25 * _MORE, suppress_health_check=_FIXTURES)

generators = st.integers(0, 2**32 - 1).map(np.random.default_rng)


# Damage of any kind, several at a time


def _lose_faces(vertices, faces, rng):
    return vertices, np.delete(faces, rng.integers(len(faces), size=5), axis=0)


def _repeat_faces(vertices, faces, rng):
    return vertices, np.concatenate([faces, faces[rng.integers(len(faces), size=3)]])


def _turn_faces(vertices, faces, rng):
    turned = faces.copy()
    turned[rng.random(len(faces)) < 0.3] = turned[rng.random(len(faces)) < 0.3][:1, [0, 2, 1]]
    return vertices, turned


def _flip_faces(vertices, faces, rng):
    chosen = rng.random(len(faces)) < 0.3
    return vertices, np.where(chosen[:, None], faces[:, [0, 2, 1]], faces)


def _repeat_corners(vertices, faces, rng):
    changed = faces.copy()
    changed[rng.integers(len(faces)), 0] = changed[rng.integers(len(faces)), 1]
    return vertices, changed


def _lead_nowhere(vertices, faces, rng):
    changed = faces.copy()
    changed[rng.integers(len(faces)), rng.integers(3)] = rng.choice([-1, len(vertices), 2**40])
    return vertices, changed


def _lose_numbers(vertices, faces, rng):
    changed = vertices.copy()
    changed[rng.integers(len(vertices)), rng.integers(3)] = rng.choice(
        [np.nan, np.inf, -np.inf, 1e300]
    )
    return changed, faces


def _add_vertices(vertices, faces, rng):
    at = rng.integers(len(vertices) + 1)
    return np.insert(vertices, at, rng.standard_normal((3, 3)), axis=0), faces + 3 * (faces >= at)


def _split_vertices(vertices, faces, rng):
    """Give some faces their own copies of their corners."""
    own = rng.random(len(faces)) < 0.2
    corners = vertices[np.clip(faces[own], 0, len(vertices) - 1)].reshape(-1, 3)
    changed = faces.copy()
    changed[own] = len(vertices) + np.arange(len(corners)).reshape(-1, 3)
    return np.concatenate([vertices, corners]), changed


def _add_body(vertices, faces, rng):
    return np.concatenate([vertices, vertices * rng.uniform(0.1, 3) + 10]), np.concatenate(
        [faces, faces + len(vertices)]
    )


def _flatten(vertices, faces, rng):
    face = faces[rng.integers(len(faces))]
    changed = vertices.copy()
    if face.min() >= 0 and face.max() < len(vertices):
        changed[face[0]] = changed[face[1:]].mean(axis=0)
    return changed, faces


def _scale(vertices, faces, rng):
    with np.errstate(all="ignore"):
        return vertices * 10.0 ** rng.uniform(-200, 200), faces


def _shift(vertices, faces, rng):
    return vertices + 10.0 ** rng.uniform(0, 12), faces


_DAMAGE = [
    _lose_faces,
    _repeat_faces,
    _turn_faces,
    _flip_faces,
    _repeat_corners,
    _lead_nowhere,
    _lose_numbers,
    _add_vertices,
    _split_vertices,
    _add_body,
    _flatten,
    _scale,
    _shift,
]
damages = st.lists(st.sampled_from(_DAMAGE), min_size=1, max_size=4)
_SPHERE = make_sphere(n_subdivisions=2)


def _damaged(damage, rng):
    vertices, faces = _SPHERE.vertices * [1.0, 1.3, 0.8], _SPHERE.faces.copy()
    for hurt in damage:
        with np.errstate(all="ignore"):
            vertices, faces = hurt(vertices, faces, rng)
    return vertices, faces


def _answer(function):
    """Return what a function returns, or its error if it is ours; warnings of numpy are errors."""
    with warnings.catch_warnings():
        for category in (OrientationWarning, RepairWarning, SkippedShapeWarning):
            warnings.simplefilter("ignore", category)
        try:
            return function()
        except MeshError as error:
            return error


@given(
    damages,
    generators,
    st.sampled_from(["cotangent", "robust"]),
    st.sampled_from(["mend", "raise"]),
)
@cases
def test_a_damaged_mesh_has_a_basis_or_is_refused_by_name_and_the_report_knows(
    damage, rng, laplacian, on_invalid
):
    mesh = _damaged(damage, rng)
    told = check_mesh(mesh)
    assert str(told)
    basis = SpectralBasis(8, laplacian=laplacian, on_invalid=on_invalid)
    answer = _answer(lambda: basis.transform([mesh]))
    usable = told.usable(laplacian, on_invalid)
    if isinstance(answer, MeshError):
        assert "shape 0" in str(answer)
        # What comes to light only in the eigenfunctions is not in the report, nor how many of them
        # are asked for.
        later = "eigen" in str(answer) or "too few for n_components=8" in str(answer)
        assert not usable or later, (str(answer), str(told))
        return
    assert usable, str(told)
    (shape,) = answer
    assert shape.n_given == len(mesh[0])
    assert on_invalid == "mend" or shape.prolongation is None
    assert np.isfinite(shape.evecs).all()
    assert_allclose(shape.evecs.T @ (shape.mass[:, None] * shape.evecs), np.eye(8), atol=1e-6)


def _used(vertices, faces):
    return np.unique(faces[sound_faces(vertices, faces)])


@given(damages, generators)
@cases
def test_what_is_mended_is_whole_and_keeps_count(damage, rng):
    vertices, faces = _damaged(damage, rng)
    before = vertices.copy(), faces.copy()
    repair = _answer(lambda: repair_mesh((vertices, faces)))
    assert_array_equal(vertices, before[0])
    assert_array_equal(faces, before[1])
    if isinstance(repair, MeshError):
        assert "Nothing is left" in str(repair) or "cannot be mended" in str(repair)
        assert not check_mesh((vertices, faces)).usable()
        return
    assert check_mesh((vertices, faces)).usable()
    kept = repair.vertex_map >= 0
    assert len(repair.vertex_map) == len(vertices)
    assert repair.vertex_map.max() < repair.mesh.n_vertices
    crack = 1e-5 * np.linalg.norm(np.ptp(vertices[_used(vertices, faces)], axis=0))
    assert_allclose(
        repair.mesh.vertices[repair.vertex_map[kept]], vertices[kept], rtol=0, atol=crack
    )
    again = repair_mesh(repair.mesh)
    assert again.done == ()
    assert not again.renumbered
    faults = check_mesh(repair.mesh).faults
    assert {fault.level for fault in faults} <= {"note"}, str(check_mesh(repair.mesh))


@given(damages, generators)
@few_cases
def test_skip_never_raises_and_mends_what_mend_does(damage, rng):
    mesh = _damaged(damage, rng)
    sound, other = _answer(lambda: SpectralBasis(8, on_invalid="skip").transform([_SPHERE, mesh]))
    mended = _answer(lambda: SpectralBasis(8).transform([_SPHERE, mesh]))
    assert not isinstance(sound, SkippedShape)
    if isinstance(other, SkippedShape):
        assert other.name == "shape 1"
        assert other.n_vertices == len(mesh[0])
        assert other.reason == str(mended)
        return
    assert other.n_given == len(mesh[0])
    assert_array_equal(other.evecs, mended[1].evecs)
    assert_array_equal(
        other.working_vertices(np.arange(other.n_given)),
        mended[1].working_vertices(np.arange(other.n_given)),
    )


# Places of shapes, numbers of vertices


@given(st.lists(st.booleans(), max_size=12))
@cases
def test_skipped_shapes_keep_their_places(pattern):
    X = [SkippedShape(f"s{i}", "broken") if skipped else i for i, skipped in enumerate(pattern)]
    answers = put_back(
        [10 * shape for shape in pick_usable(X).shapes], pick_usable(X), lambda shape: shape.name
    )
    assert answers == [f"s{i}" if skipped else 10 * i for i, skipped in enumerate(pattern)]


@given(generators)
@cases
def test_values_go_to_the_vertices_that_they_belong_to(ball, rng):
    """Whatever was removed or merged, each given vertex has the value of what it became."""
    n = ball.mesh.n_vertices
    vertex_map = np.concatenate([np.arange(n), rng.integers(-1, n, size=rng.integers(0, 30))])
    rng.shuffle(vertex_map)
    shape = replace(ball, prolongation=Prolongation.of_vertices(vertex_map, ball.mesh.faces))
    assert shape.n_given == len(vertex_map)
    values = rng.random((n, 2))
    spread_out = shape.prolong(values)
    assert_array_equal(spread_out[vertex_map >= 0], values[vertex_map[vertex_map >= 0]])
    assert np.isnan(spread_out[vertex_map < 0]).all()
    assert_allclose(shape.restrict(np.nan_to_num(spread_out)), values, rtol=1e-12)
    assert_array_equal(shape.working_vertices(np.arange(len(vertex_map))), vertex_map)
    assert_array_equal(vertex_map[shape.given_vertices()], np.arange(n))


@pytest.fixture(scope="module")
def ball():
    (shape,) = SpectralBasis(8).transform([_SPHERE])
    return shape


@given(generators, st.integers(1, 30), st.integers(1, 20))
@cases
def test_correspondences_survive_every_renumbering(rng, n, n_points):
    pairs = np.column_stack([rng.integers(n, size=25), rng.integers(n_points, size=25)])
    truth = Correspondence(pairs, pairs[::-1])
    order = rng.permutation(n)
    there = truth.renumber(order)
    assert_array_equal(there.pairs[:, 0], order[pairs[:, 0]])
    assert_array_equal(there.renumber(np.argsort(order)).pairs, truth.pairs)
    again = pickle.loads(pickle.dumps(there))
    assert_array_equal(again.symmetric_pairs, there.symmetric_pairs)
    joined, back = truth.join(there), there.join(truth)
    assert sorted(zip(joined.vertices_i, joined.vertices_0, strict=True)) == sorted(
        zip(back.vertices_0, back.vertices_i, strict=True)
    )


# Scores


@given(generators, st.integers(2, 30))
@cases
def test_errors_are_nil_for_the_truth_and_free_of_order(rng, n):
    mesh = _SPHERE
    truth = Correspondence(np.column_stack([rng.permutation(mesh.n_vertices)[:n], np.arange(n)]))
    truth_0 = Correspondence(np.column_stack([rng.permutation(mesh.n_vertices)[:n], np.arange(n)]))
    p2p = rng.integers(mesh.n_vertices, size=mesh.n_vertices)
    right = p2p.copy()
    right[truth.pairs[:, 0]] = truth_0.pairs[:, 0]
    distances = reference_distances(mesh)
    assert geodesic_error(right, truth, truth_0, distances) == 0
    error = geodesic_error(p2p, truth, truth_0, distances)
    shuffled = Correspondence(truth.pairs[rng.permutation(n)])
    assert geodesic_error(p2p, shuffled, truth_0, distances) == pytest.approx(error, rel=1e-12)
    assert 0 < coverage(p2p, np.full(mesh.n_vertices, 1 / mesh.n_vertices)) <= 1


@given(
    st.lists(st.floats(0, 10), min_size=1, max_size=30),
    st.lists(st.floats(0, 10), min_size=1, max_size=10),
)
@cases
def test_error_curves_rise_to_one(errors, thresholds):
    curve = error_curve(np.array(errors), np.sort([*thresholds, 10.0]))
    assert (np.diff(curve) >= 0).all()
    assert curve[-1] == 1


@given(st.lists(st.one_of(st.floats(0, 1), st.just(np.nan)), min_size=1, max_size=10), st.randoms())
@cases
def test_the_mean_over_shapes_passes_over_those_without_an_answer(means, random):
    known = [mean for mean in means if not np.isnan(mean)]
    expected = np.mean(known) if known else np.nan
    assert mean_over_shapes(means) == pytest.approx(expected, rel=1e-12, abs=1e-15, nan_ok=True)
    random.shuffle(means)
    assert mean_over_shapes(means) == pytest.approx(expected, rel=1e-12, abs=1e-15, nan_ok=True)


# The order of shapes, bit for bit


@given(st.lists(st.integers(0, 5), min_size=1, max_size=4))
@settings(few_cases, max_examples=6 * _MORE)
def test_transform_predict_and_match_know_no_order_and_no_company(model, collection, alone, chosen):
    """Any shapes in any order, some twice: each gets what it gets alone."""
    meshes = [collection.meshes[i] for i in chosen]
    for i, shape, reduced, match in zip(
        chosen,
        model[:-1].transform(meshes),
        model.predict(meshes),
        skfmap.match(model, meshes),
        strict=True,
    ):
        assert_array_equal(shape.probes, alone[i].shape.probes)
        assert_array_equal(shape.spectral.evecs, alone[i].shape.spectral.evecs)
        assert_array_equal(reduced, alone[i].reduced)
        for name in (
            "p2p",
            "expected_error",
            "confidence",
            "functional_map",
            "inverse",
            "n_supporting",
        ):
            assert_array_equal(getattr(match, name), getattr(alone[i].match, name), err_msg=name)
        assert (match.matrix != alone[i].match.matrix).nnz == 0


@pytest.fixture(scope="module")
def alone(model, collection):
    """Return what each body gets when it is the only one."""
    return [
        SimpleNamespace(
            shape=model[:-1].transform([mesh])[0],
            reduced=model.predict([mesh])[0],
            match=skfmap.match(model, [mesh])[0],
        )
        for mesh in collection.meshes
    ]


@given(st.permutations(range(1, 5)))
@settings(max_examples=3 * _MORE, suppress_health_check=_FIXTURES)
def test_training_shapes_behind_the_reference_come_in_any_order(
    make_learner, fitted, probed, collection, order
):
    """Sums over shapes are rounded in another order, and so the search ends a little elsewhere."""
    order = [0, *order]
    learner = make_learner().fit([probed[i] for i in order], [collection.truths[i] for i in order])
    assert learner.loss_ == pytest.approx(fitted.loss_, rel=1e-3)
    assert learner.epsilon_ == pytest.approx(fitted.epsilon_, rel=1e-12)
    same = np.mean(learner.point_maps(probed[5:])[0] == fitted.point_maps(probed[5:])[0])
    assert same >= 0.995


# Files


@given(generators, st.sampled_from(["off", "obj", "ply"]), st.integers(-60, 60))
@cases
def test_what_is_written_is_read_in_any_unit_or_not_written(
    tmp_path_factory, rng, suffix, exponent
):
    vertices = (
        rng.standard_normal((_SPHERE.n_vertices, 3)) + 10 * rng.standard_normal(3)
    ) * 10.0**exponent
    faces = rng.permutation(_SPHERE.n_vertices)[_SPHERE.faces][rng.permutation(_SPHERE.n_faces)]
    path = tmp_path_factory.getbasetemp() / f"written.{suffix}"
    assume(suffix != "ply" or not 35 < abs(exponent) < 46)  # about where single precision ends
    if suffix == "ply" and abs(exponent) > 35:
        with pytest.raises(ValueError, match="in single precision, which distorts its shape"):
            write_mesh(Mesh(vertices, faces), path)
        return
    write_mesh(Mesh(vertices, faces), path)
    again = read_mesh(path)
    assert_array_equal(again.faces, faces)
    kept = 1e-4 if suffix == "ply" else 1e-13
    assert_allclose(again.vertices, vertices, rtol=0, atol=kept * np.ptp(vertices, axis=0).max())


# Estimators


@given(
    st.integers(2, 40),
    st.sampled_from(["cotangent", "robust"]),
    st.sampled_from(["mend", "raise", "skip"]),
    st.sampled_from(["paper", None]),
    st.floats(1e-6, 1e3),
    st.sampled_from(["unique", "category", "function", None]),
)
@cases
def test_parameters_are_what_was_given(k, laplacian, on_invalid, families, alpha, weighting):
    for estimator in (
        SpectralBasis(k, laplacian=laplacian, on_invalid=on_invalid),
        DescriptorTransformer(families),
        skfmap.WeightedFunctionalMapLearner(n_functions=k, alpha=alpha, weighting=weighting),
    ):
        again = type(estimator)(**estimator.get_params(deep=False))
        assert clone(estimator).get_params(deep=False).keys() == again.get_params(deep=False).keys()
        assert (
            repr(clone(estimator))
            == repr(estimator)
            == repr(again)
            == repr(pickle.loads(pickle.dumps(estimator)))
        )
