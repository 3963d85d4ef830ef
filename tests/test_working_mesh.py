"""Any mesh in, answers on that mesh out: given meshes, working meshes, and what lies between."""

import pickle
from dataclasses import replace

import joblib
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import (
    BridgedLearner,
    Correspondence,
    DescriptorTransformer,
    Mesh,
    SpectralBasis,
)
from skfmap._measures import GeodesicDistances, PlaceDistances
from skfmap.datasets import make_sphere
from skfmap.descriptors import FunctionProbes
from skfmap.exceptions import MeshError
from skfmap.geometry.thinning import thin
from skfmap.ground_truth import join_with_reference, known_maps
from skfmap.io import open_given, write_mesh
from skfmap.persistence import load_model, save_model
from skfmap.report import evaluate, write_report
from skfmap.shapes import GivenMesh, Prolongation

_MOST = 400


@pytest.fixture(scope="module")
def dense(make_bodies):
    """Five bodies of some 2,000 vertices."""
    poses = [(2000, 0.0), (1800, 0.1), (2200, -0.1), (1900, 0.15), (2100, 0.05)]
    return make_bodies(poses, symmetric=False)


@pytest.fixture(scope="module")
def thinned(dense):
    """The same on working meshes of 400 vertices."""
    shapes = SpectralBasis(30, max_vertices=_MOST).transform(dense.meshes)
    return DescriptorTransformer().transform(shapes)


@pytest.fixture(scope="module")
def learner(make_learner, thinned, dense):
    return make_learner(memory=None).fit(thinned[:4], dense.truths[:4])


# The prolongation


@given(st.lists(st.integers(-1, 3), min_size=1, max_size=12))
def test_a_renumbering_is_a_prolongation_with_one_entry_in_a_row(numbers):
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    vertex_map = np.array(numbers)
    places = Prolongation.of_vertices(vertex_map, faces)
    expected = np.eye(5)[:, :4][vertex_map]  # row -1 is empty
    np.testing.assert_array_equal(places.matrix(faces, 4).toarray(), expected)
    np.testing.assert_array_equal(places.nearest_corner(faces), vertex_map)
    assert places.one_each
    twice = places.renumbered(np.array([0, -1, len(numbers) - 1]))
    np.testing.assert_array_equal(twice.nearest_corner(faces), [vertex_map[0], -1, vertex_map[-1]])


def test_rows_sum_to_one_and_lead_back_to_the_given_vertices(thinned, dense):
    for shape, mesh in zip(thinned, dense.meshes, strict=True):
        spectral = shape.spectral
        assert spectral.mesh.n_vertices <= _MOST
        assert spectral.n_given == mesh.n_vertices
        matrix = spectral.prolongation_matrix
        np.testing.assert_allclose(np.asarray(matrix.sum(axis=1)).ravel(), 1, atol=1e-6)
        assert (matrix.data >= 0).all()
        away = np.linalg.norm(matrix @ spectral.mesh.vertices - mesh.vertices, axis=1)
        assert away.mean() < 0.01 * np.sqrt(mesh.area)
        assert away.max() < 0.05 * np.sqrt(mesh.area)


def test_smooth_functions_come_back_from_the_working_mesh(thinned, dense):
    spectral, mesh = thinned[0].spectral, dense.meshes[0]
    height = mesh.vertices[:, 2]
    coarse = spectral.restrict(height)
    assert coarse.shape == (spectral.mesh.n_vertices,)
    np.testing.assert_allclose(coarse, spectral.mesh.vertices[:, 2], atol=0.1)
    back = spectral.prolong(coarse)
    assert np.abs(back - height).mean() < 0.05
    both = spectral.restrict(np.column_stack([height, 2 * height]))
    np.testing.assert_allclose(both, np.column_stack([coarse, 2 * coarse]))
    with pytest.raises(ValueError, match="one entry or row for each of the 2000 vertices"):
        spectral.restrict(np.ones(5))


def test_restricting_the_values_of_a_shape_that_is_its_own_working_mesh_changes_nothing(probed):
    values = np.arange(500.0)
    np.testing.assert_array_equal(probed[0].spectral.restrict(values), values)
    np.testing.assert_array_equal(probed[0].spectral.prolong(values), values)


def test_eigenfunctions_at_given_vertices_are_those_of_the_dense_mesh(thinned, dense):
    """Two routes to the first eigenfunctions at the given vertices."""
    (fine,) = SpectralBasis(30, max_vertices=None).transform(dense.meshes[:1])
    coarse = thinned[0].spectral
    at = coarse.evecs_at(np.arange(2000), 6)
    agreement = np.abs(np.linalg.svd(fine.evecs[:, :6].T @ (fine.mass[:, None] * at))[1])
    assert agreement.min() > 0.98


def test_functions_of_ones_own_may_be_on_the_given_vertices(dense):
    (shape,) = SpectralBasis(30, max_vertices=_MOST).transform(dense.meshes[:1])
    heights = {"body0": dense.meshes[0].vertices[:, 2]}
    given, working = (
        FunctionProbes(function)
        for function in (
            lambda shape: heights[shape.name],
            lambda shape: shape.restrict(heights[shape.name]),
        )
    )
    np.testing.assert_array_equal(given.coefficients(shape), working.coefficients(shape))
    with pytest.raises(ValueError, match="must return finite values of shape"):
        FunctionProbes(lambda shape: np.ones(7)).coefficients(shape)


# Answers


def test_answers_are_on_the_given_meshes(learner, thinned, dense):
    (match,) = learner.match(thinned[4:])
    n_i, n_0 = dense.meshes[4].n_vertices, dense.meshes[0].n_vertices
    assert match.p2p.shape == match.expected_error.shape == match.confidence.shape == (n_i,)
    assert match.n_supporting.shape == (n_i,)
    assert match.inverse.shape == (n_0,)
    assert match.matrix.shape == (n_i, n_0)
    assert ((match.p2p >= 0) & (match.p2p < n_0)).all()
    assert len(np.unique(match.p2p)) > _MOST  # finer than the working meshes
    assert match.transfer(np.arange(float(n_0))).shape == (n_i,)
    np.testing.assert_array_equal(learner.point_maps(thinned[4:])[0], match.p2p)
    assert learner.stability_function().shape == (n_0,)


def test_thinned_shapes_are_matched_about_as_well_as_dense_ones(
    learner, thinned, dense, make_learner, probe
):
    fine = probe(dense.meshes)
    score = (
        make_learner(memory=None).fit(fine[:4], dense.truths[:4]).score(fine[4:], dense.truths[4:])
    )
    assert learner.score(thinned[4:], dense.truths[4:]) > score - 0.02


def test_places_on_the_reference_are_finer_than_its_vertices(learner, thinned, dense):
    (match,) = learner.match(thinned[4:], interpolate="barycentric")
    counts = np.diff(match.matrix.indptr)
    assert counts.max() == 3
    np.testing.assert_allclose(match.matrix.sum(axis=1), 1, atol=1e-6)
    places = match.matrix @ dense.meshes[0].vertices
    to_vertex = np.linalg.norm(places - dense.meshes[0].vertices[match.p2p], axis=1)
    edge = np.sqrt(dense.meshes[0].area / dense.meshes[0].n_vertices)
    assert 0 < to_vertex.mean() < edge
    (soft,) = learner.match(thinned[4:], interpolate="soft")
    np.testing.assert_allclose(soft.matrix.sum(axis=1), 1, atol=1e-6)


def test_a_copy_of_the_reference_is_matched_to_itself(learner, thinned, dense):
    (match,) = learner.match(thinned[:1])
    places = learner.match(thinned[:1], interpolate="barycentric")[0].matrix
    away = np.linalg.norm(places @ dense.meshes[0].vertices - dense.meshes[0].vertices, axis=1)
    assert np.median(away) < 0.01 * np.sqrt(dense.meshes[0].area)
    assert np.median(np.abs(match.inverse[match.p2p] - np.arange(2000)) == 0) == 1


def test_pieces_that_were_left_out_have_no_answer(learner, dense):
    mesh = dense.meshes[4]
    speck = [[9.0, 9, 9], [9.1, 9, 9], [9, 9.1, 9]]
    n = mesh.n_vertices
    dirty = np.vstack([mesh.vertices, speck]), np.vstack([mesh.faces, [[n, n + 1, n + 2]]])
    model = make_pipeline(SpectralBasis(30, max_vertices=_MOST), DescriptorTransformer(), learner)
    with pytest.warns(skfmap.exceptions.RepairWarning, match="shape 0"):
        (match,) = skfmap.match(model, [dirty])
    assert match.p2p.shape == (n + 3,)
    assert (match.p2p[n:] == -1).all()
    assert np.isnan(match.expected_error[n:]).all()
    assert (match.p2p[:n] >= 0).all()
    assert match.transfer(np.ones(2000)).mask.tolist() == [*[False] * n, True, True, True]


def test_a_dense_mesh_between_coarse_ones(fitted, thinned, dense, probed, collection):
    """Thinned or not, shapes of one kind are matched by one model."""
    (one,) = fitted.match(thinned[4:])
    assert one.matrix.shape == (2100, 500)
    assert (
        fitted.score(thinned[4:], dense.truths[4:])
        > fitted.score(probed[5:], collection.truths[5:]) - 0.03
    )


def test_a_bridge_of_thinned_shapes(make_learner, thinned, dense):
    bridged = BridgedLearner(make_learner(memory=None), "body2").fit(thinned[:4], dense.truths[:4])
    (match,) = bridged.match(thinned[4:])
    assert match.matrix.shape == (2100, 2000)
    assert match.inverse.shape == (2000,)
    assert match.inverse.max() < 2100
    assert bridged.score(thinned[4:], dense.truths[4:]) > -0.1


def test_a_report_of_thinned_shapes(learner, thinned, dense, tmp_path):
    evaluation = evaluate(learner, thinned[:4], dense.truths[:4], cv=3, naive=False)
    for mesh, match in zip(evaluation.meshes, evaluation.matches, strict=True):
        assert len(match.p2p) == mesh.n_vertices <= _MOST
        assert match.p2p.max() < learner.reference_.spectral.mesh.n_vertices
    page = write_report(learner, tmp_path / "r.html", evaluation=evaluation)
    assert page.stat().st_size > 10_000


# Distances between places


def test_distances_between_places_are_those_of_the_vertices_they_are_at(thinned, dense):
    spectral, mesh = thinned[0].spectral, dense.meshes[0]
    rng = np.random.default_rng(0)
    a, b = rng.choice(2000, (2, 60))
    within = GeodesicDistances(spectral.mesh, "exact")
    measured = PlaceDistances(spectral, within)
    exact = GeodesicDistances(mesh, "exact").between(a, b)
    np.testing.assert_allclose(measured.between(a, b), exact, atol=0.03)
    np.testing.assert_allclose(measured.between(a, b), measured.between(b, a), atol=1e-6)
    np.testing.assert_allclose(measured.between(a, a), 0, atol=1e-12)


def test_distances_without_thinning_are_those_between_vertices(probed):
    spectral = probed[0].spectral
    within = GeodesicDistances(spectral.mesh)
    a, b = np.array([0, 7, 100]), np.array([3, 3, 450])
    np.testing.assert_array_equal(
        PlaceDistances(spectral, within).between(a, b), within.between(a, b)
    )


# What is kept


def test_a_shape_keeps_twelve_bytes_of_each_given_vertex(dense):
    (shape,) = SpectralBasis(30, max_vertices=_MOST, n_jobs=2).transform([*dense.meshes[:1]])
    alone = replace(shape, given=None)
    size = len(pickle.dumps(alone.prolongation))
    assert size < 12 * 2000 + 1000


def test_a_model_holds_both_meshes_of_the_reference_and_works_without_its_file(
    dense, make_learner, tmp_path
):
    paths = []
    for mesh in dense.meshes:
        write_mesh(mesh, tmp_path / f"{mesh.name}.off")
        paths.append(str(tmp_path / f"{mesh.name}.off"))
    model = make_pipeline(
        SpectralBasis(30, max_vertices=_MOST), DescriptorTransformer(), make_learner(memory=None)
    )
    model.fit(paths[:4], dense.truths[:4])
    (before,) = skfmap.match(model, paths[4:])
    for path in paths[:4]:
        (tmp_path / path).unlink()
    joblib.dump(model, tmp_path / "model.joblib")
    (after,) = skfmap.match(joblib.load(tmp_path / "model.joblib"), paths[4:])
    np.testing.assert_array_equal(before.p2p, after.p2p)
    kept = model[-1].reference_.spectral.given
    assert kept.n_vertices == 2000
    pytest.importorskip("skops")
    save_model(model, tmp_path / "model.skops")
    (again,) = skfmap.match(load_model(tmp_path / "model.skops"), paths[4:])
    np.testing.assert_array_equal(before.p2p, again.p2p)


def test_a_file_that_changed_since_is_not_taken_for_the_same(dense, tmp_path):
    path = tmp_path / "body.off"
    write_mesh(dense.meshes[0], path)
    (shape,) = SpectralBasis(30, max_vertices=_MOST).transform([path])
    vertices, _ = open_given(shape.given)
    np.testing.assert_allclose(vertices, dense.meshes[0].vertices, atol=1e-15)
    write_mesh(Mesh(2 * dense.meshes[0].vertices, dense.meshes[0].faces), path)
    with pytest.raises(MeshError, match=r"'body' has changed since .*body\.off"):
        open_given(shape.given)
    with pytest.raises(MeshError, match="was not kept"):
        open_given(GivenMesh("gone", 1, 1, ""))


def test_answers_do_not_depend_on_the_number_of_workers(dense, learner, thinned):
    shapes = SpectralBasis(30, max_vertices=_MOST, n_jobs=2).transform(dense.meshes[3:])
    for one, other in zip(shapes, thinned[3:], strict=True):
        np.testing.assert_array_equal(one.evecs, other.spectral.evecs)
        np.testing.assert_array_equal(one.prolongation.face, other.spectral.prolongation.face)


def test_units_and_place_do_not_matter(dense, learner):
    mesh = dense.meshes[4]
    moved = Mesh(1000 * mesh.vertices + [5e4, -3e4, 1e3], mesh.faces, mesh.name)
    model = make_pipeline(SpectralBasis(30, max_vertices=_MOST), DescriptorTransformer(), learner)
    one, other = skfmap.match(model, [mesh, moved])
    same = (one.p2p == other.p2p).mean()
    assert same > 0.9


def test_a_small_sound_mesh_is_its_own_working_mesh():
    ball = make_sphere(n_subdivisions=3)
    (shape,) = SpectralBasis(10).transform([ball])
    assert shape.mesh is ball
    assert shape.prolongation is None
    assert shape.given is None


def test_of_dense_pairs_those_nearest_to_working_vertices_are_learned_from(thinned, dense):
    shape, reference = thinned[0], thinned[0]
    everywhere = Correspondence.from_vertices(np.arange(2000))
    joined = join_with_reference(everywhere, shape, everywhere, reference)
    np.testing.assert_array_equal(joined.vertices_i, joined.vertices_0)
    at = shape.spectral.working_vertices(joined.vertices_i)
    counts = np.bincount(at, minlength=shape.spectral.mesh.n_vertices)
    assert counts.max() == 2
    weights = shape.spectral.prolongation_matrix.max(axis=1).toarray().ravel()
    everyone = shape.spectral.working_vertices(np.arange(2000))
    for vertex in np.flatnonzero(counts == 2)[:20]:
        best = np.sort(weights[everyone == vertex])[-2:]
        np.testing.assert_array_equal(np.sort(weights[joined.vertices_i[at == vertex]]), best)
    (known,) = known_maps([shape], reference, [joined], 12)
    np.testing.assert_allclose(known.C, np.eye(12), atol=1e-6)


def test_a_body_full_of_tunnels_is_wrapped_if_asked(dense):
    """Debris all around, inside and out, with a tenth of the area."""
    body = dense.meshes[4]
    speck = make_sphere(n_subdivisions=1)
    rng = np.random.default_rng(0)
    parts, n = [(body.vertices, body.faces)], body.n_vertices
    for place in rng.uniform(-0.5, 0.5, (60, 3)):
        parts.append((0.08 * speck.vertices + place, speck.faces + n))
        n += speck.n_vertices
    dirty = tuple(np.vstack(part) for part in zip(*parts, strict=True))
    basis = SpectralBasis(30, max_vertices=_MOST, wrap="auto")
    with pytest.warns(skfmap.exceptions.RepairWarning, match="wrapped, because .* components with"):
        (shape,) = basis.transform([dirty])
    assert shape.n_given == n
    placed = shape.prolongation.placed
    assert placed[: body.n_vertices].mean() > 0.95
    assert placed[body.n_vertices :].mean() < 0.2  # what lies inside is hardly reached
    away = shape.prolongation_matrix @ shape.mesh.vertices - dirty[0]
    assert np.linalg.norm(away[placed], axis=1).max() < 0.1 * np.sqrt(body.area)
    with pytest.warns(skfmap.exceptions.RepairWarning, match="kept the largest of"):
        (plain,) = SpectralBasis(30, max_vertices=_MOST).transform([dirty])
    assert plain.prolongation.placed.sum() == body.n_vertices


def _moebius(n, m):
    """Return vertices and faces of a band with one side."""
    angle, across = np.meshgrid(2 * np.pi * np.arange(n) / n, np.linspace(-0.4, 0.4, m))
    radius = 1 + across * np.cos(angle / 2)
    vertices = np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), across * np.sin(angle / 2)], axis=-1
    )
    faces = []
    for j in range(m - 1):
        for i in range(n):
            a, b = (j, i), (j + 1, i)
            c, d = ((j, i + 1), (j + 1, i + 1)) if i + 1 < n else ((m - 1 - j, 0), (m - 2 - j, 0))
            numbers = [row * n + column for row, column in (a, b, c, d)]
            faces += [[numbers[0], numbers[2], numbers[1]], [numbers[1], numbers[2], numbers[3]]]
    return vertices.reshape(-1, 3), np.array(faces)


def test_a_mesh_that_is_wound_otherwise_somewhere_is_turned_before_it_is_thinned():
    ball = make_sphere(n_subdivisions=4)
    faces = ball.faces.copy()
    faces[7] = faces[7][::-1]
    for on_invalid in ("mend", "raise"):
        basis = SpectralBasis(30, max_vertices=_MOST, on_invalid=on_invalid)
        (shape,) = basis.transform([(ball.vertices, faces)])
        assert shape.mesh.n_vertices <= _MOST
        assert shape.oriented


def test_a_surface_without_an_outside_is_not_thinned_and_says_so():
    basis = SpectralBasis(30, max_vertices=300)
    with pytest.raises(MeshError, match=r"'shape 0' cannot be thinned .* no consistent winding"):
        basis.transform([_moebius(40, 30)])


@pytest.mark.parametrize("width", [3, 5, 10])
def test_narrow_strips_keep_about_as_many_vertices_as_asked_for(width):
    x, y = np.meshgrid(np.arange(1000) / 100, np.arange(width) / 100)
    vertices = np.stack([x, y, 0.1 * np.sin(5 * x)], axis=-1).reshape(-1, 3)
    corner = (np.arange(width - 1)[:, None] * 1000 + np.arange(999)).ravel()
    a, b, c, d = corner, corner + 1, corner + 1000, corner + 1001
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
    small = thin(vertices, faces, 400)
    assert 200 < len(small.vertices) <= 400


def test_threads_and_one_after_another_answer_alike(learner, thinned):
    shapes = [*thinned[1:], *thinned[1:]]
    one, two = (clone(learner).set_params(n_jobs=n) for n in (None, 2))
    for each in (one, two):
        each.__dict__.update({k: v for k, v in vars(learner).items() if k.endswith("_")})
    for a, b in zip(one.match(shapes), two.match(shapes), strict=True):
        np.testing.assert_array_equal(a.p2p, b.p2p)
        np.testing.assert_array_equal(a.inverse, b.inverse)


def test_fewer_vertices_than_functions_are_told_by_the_parameter():
    with pytest.raises(ValueError, match="max_vertices=100 leaves too few vertices for n_comp"):
        SpectralBasis(max_vertices=100).fit([make_sphere()])


def test_pairs_at_pieces_that_were_left_out_are_told(learner, dense):
    mesh, truth = dense.meshes[4], dense.truths[4]
    n = mesh.n_vertices
    speck = make_sphere(n_subdivisions=1)
    dirty = (
        np.vstack([mesh.vertices, 0.01 * speck.vertices + 5]),
        np.vstack([mesh.faces, speck.faces + n]),
    )
    with pytest.warns(skfmap.exceptions.RepairWarning):
        shapes = DescriptorTransformer().transform(
            SpectralBasis(30, max_vertices=_MOST).transform([dirty])
        )
    pairs = truth.pairs.copy()
    pairs[:30, 0] = n
    with pytest.warns(skfmap.exceptions.CoverageWarning, match="30 of the 300 pairs of X"):
        (errors,) = learner.pair_errors(shapes, [Correspondence(pairs)])
    assert len(errors.direct) == 270
