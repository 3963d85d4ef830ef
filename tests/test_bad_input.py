"""What users get wrong is answered by the name of the shape and the remedy, never wrongly."""

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

from skfmap import Correspondence, DescriptorTransformer, Mesh, SpectralBasis
from skfmap.descriptors import HeatKernelSignature, WaveKernelSignature, default_families
from skfmap.exceptions import (
    CorrespondenceError,
    CoverageWarning,
    MeshError,
    OrientationWarning,
    RepairWarning,
)
from skfmap.metrics import GeodesicDistances, get_scorer, pair_errors
from skfmap.shapes import ProbedShape


@pytest.fixture
def body(collection):
    return collection.meshes[1]


def changed(truths, index, truth):
    """Return the correspondences with another one at ``index``."""
    return [*truths[:index], truth, *truths[index + 1 :]]


# Meshes


def test_an_unreferenced_vertex_is_named(body):
    loose = Mesh(np.concatenate([body.vertices, [[0.0, 0, 0]]]), body.faces, name="the cat")
    with pytest.raises(
        MeshError, match=f"'the cat' has 1 vertices.*first is vertex {body.n_vertices}"
    ):
        SpectralBasis(10, on_invalid="raise").transform([body, loose])


def test_a_repeated_corner_is_named(body):
    faces = body.faces.copy()
    faces[7, 0] = faces[7, 1]
    with pytest.raises(MeshError, match=r"'the cat' has 1 faces.*first is face 7"):
        SpectralBasis(10, on_invalid="raise").transform(
            [Mesh(body.vertices, faces, name="the cat")]
        )


@pytest.fixture
def flat(body):
    """Return the body with one vertex moved onto its neighbour, so that two faces have no area."""
    vertices = body.vertices.copy()
    vertices[body.faces[7, 0]] = vertices[body.faces[7, 1]]
    return Mesh(vertices, body.faces, name="the cat")


@pytest.fixture
def finned(body):
    """Return the body with a third face on an edge."""
    a, b, c = body.faces[7]
    tip = body.vertices[[a, b]].mean(axis=0) + 0.05 * (body.vertices[a] - body.vertices[c])
    faces = np.concatenate([body.faces, [[b, a, body.n_vertices]]])
    return Mesh(np.concatenate([body.vertices, [tip]]), faces, name="the cat")


def assert_usable(mesh, body, families=None, **parameters):
    sound, shape = SpectralBasis(10, **parameters).transform([body, mesh])
    np.testing.assert_allclose(shape.evals, sound.evals, rtol=0.05, atol=1e-6)
    (probed,) = DescriptorTransformer(families).transform([shape])
    bad = ~np.isfinite(probed.probes).all(axis=0)
    assert not bad.any(), np.array(probed.probe_names)[bad]


def assert_robust_helps(mesh, body):
    assert_usable(mesh, body, "paper", laplacian="robust", on_invalid="raise")


def test_a_face_without_area_needs_the_robust_laplacian_or_mending(flat, body):
    with pytest.raises(MeshError, match=r"'the cat' has 2 faces without area.*robust"):
        SpectralBasis(10, on_invalid="raise").transform([flat])
    assert_robust_helps(flat, body)
    with pytest.warns(RepairWarning, match="'the cat': mended 2 faces without area"):
        assert_usable(flat, body)


def test_a_nonmanifold_edge_needs_the_robust_laplacian_or_mending(finned, body):
    with pytest.raises(MeshError, match=r"'the cat' has 1 edges.*robust"):
        SpectralBasis(10, on_invalid="raise").transform([finned])
    with pytest.warns(OrientationWarning, match="'the cat'"):
        assert_robust_helps(finned, body)
    with pytest.warns(RepairWarning, match="'the cat': separated the surface at 1 edges"):
        assert_usable(finned, body)


def test_oriented_probes_refuse_what_cannot_be_wound(finned):
    with pytest.warns(OrientationWarning, match="'the cat'"):
        shapes = SpectralBasis(10, laplacian="robust", on_invalid="raise").transform([finned])
    with pytest.raises(MeshError, match=r"'the cat'.*paper"):
        DescriptorTransformer().transform(shapes)


def test_two_components_are_refused_or_the_larger_is_kept(body):
    n = body.n_vertices
    vertices = np.concatenate([0.9 * body.vertices + 9, body.vertices])
    two = Mesh(vertices, np.concatenate([body.faces, body.faces + n]), name="the cat")
    for laplacian in ("cotangent", "robust"):
        with pytest.raises(MeshError, match="'the cat' has 2 connected components"):
            SpectralBasis(10, laplacian=laplacian, on_invalid="raise").transform([two])
        with pytest.warns(
            RepairWarning, match="'the cat': kept the largest of 2 components, 55.2%"
        ):
            (shape,) = SpectralBasis(10, laplacian=laplacian).transform([two])
        kept = shape.working_vertices(np.arange(2 * n))
        np.testing.assert_array_equal(kept, [*[-1] * n, *range(n)])


def test_too_few_vertices_for_the_basis(tetrahedron):
    mesh = Mesh(*tetrahedron, name="the cat")
    for n_components in (4, 5, 120):
        with pytest.raises(
            MeshError, match=f"'the cat' has 4 vertices.*n_components={n_components}"
        ):
            SpectralBasis(n_components).transform([mesh])


def test_the_largest_basis_that_fits(tetrahedron):
    (shape,) = SpectralBasis(3).transform([Mesh(*tetrahedron)])
    np.testing.assert_allclose(
        shape.evecs.T @ (shape.mass[:, None] * shape.evecs), np.eye(3), atol=1e-8
    )


@pytest.mark.parametrize("X", [[], ()])
def test_empty_input_is_refused_everywhere(X, make_learner, fitted):
    for call in (
        lambda: SpectralBasis().fit(X),
        lambda: SpectralBasis().transform(X),
        lambda: DescriptorTransformer().transform(X),
        lambda: make_learner().fit(X, X),
        lambda: fitted.predict(X),
        lambda: fitted.match(X),
        lambda: fitted.score(X, X),
    ):
        with pytest.raises(ValueError, match="empty"):
            call()


def test_one_bare_sample_is_refused_at_every_step(collection, probed, fitted):
    mesh, shape, truth = collection.meshes[0], probed[0], collection.truths[0]
    for call in (
        lambda: SpectralBasis().fit(mesh),
        lambda: SpectralBasis().transform((mesh.vertices, mesh.faces)),
        lambda: DescriptorTransformer().transform(shape.spectral),
        lambda: fitted.predict(shape),
        lambda: fitted.score([shape], truth),
    ):
        with pytest.raises(TypeError, match=r"(?i)wrap it in a list"):
            call()


def test_steps_in_the_wrong_order_are_told_apart(collection, probed, make_learner, fitted):
    with pytest.raises(TypeError, match=r"X\[0\] is a Mesh.*put SpectralBasis before"):
        DescriptorTransformer().transform(collection.meshes)
    with pytest.raises(TypeError, match=r"X\[0\] is a SpectralShape.*DescriptorTransformer"):
        make_learner().fit([shape.spectral for shape in probed], collection.truths)
    with pytest.raises(TypeError, match=r"X\[0\] is a Mesh"):
        fitted.predict(collection.meshes)
    with pytest.raises(TypeError, match="ProbedShape"):
        SpectralBasis().transform(probed)


# Winding


def p2p_of(fitted, probe, mesh):
    return fitted.match(probe([mesh]))[0].p2p


def test_inconsistently_wound_faces_are_mended_and_vertices_keep_their_numbers(
    fitted, probe, probed, collection
):
    mesh = collection.meshes[5]
    faces = mesh.faces.copy()
    flipped = np.random.default_rng(0).random(len(faces)) < 0.5
    faces[flipped] = faces[flipped][:, ::-1]
    (shape,) = probe([Mesh(mesh.vertices, faces)])
    np.testing.assert_array_equal(shape.spectral.mesh.vertices, mesh.vertices)
    np.testing.assert_array_equal(
        np.sort(shape.spectral.mesh.faces, axis=1), np.sort(mesh.faces, axis=1)
    )
    assert shape.spectral.oriented
    agreement = (fitted.match([shape])[0].p2p == fitted.match(probed[5:])[0].p2p).mean()
    assert agreement > 0.99


def test_an_inside_out_copy_matches_as_the_outward_one(fitted, probe, probed, collection):
    mesh = collection.meshes[5]
    inside_out = p2p_of(fitted, probe, Mesh(mesh.vertices, mesh.faces[:, ::-1]))
    assert (inside_out == fitted.match(probed[5:])[0].p2p).mean() > 0.99


def test_a_reference_that_is_inside_out_teaches_the_same(
    fitted, probe, make_learner, probed, collection
):
    mesh = collection.meshes[0]
    turned = probe([Mesh(mesh.vertices, mesh.faces[:, ::-1], name="turned")])
    other = make_learner().fit([*turned, *probed[1:5]], collection.truths[:5])
    assert (other.match(probed[5:])[0].p2p == fitted.match(probed[5:])[0].p2p).mean() > 0.97


# Correspondences


def fails(make_learner, probed, truths, message, error=CorrespondenceError):
    with pytest.raises(error, match=message) as caught:
        make_learner().fit(probed, truths)
    return str(caught.value)


def test_there_is_one_correspondence_for_each_shape(make_learner, probed, collection):
    fails(make_learner, probed, None, "y is None", ValueError)
    fails(make_learner, probed, collection.truths[:5], "6 shapes, but y has 5", ValueError)
    fails(make_learner, probed, collection.truths[0], "(?i)wrap it in a list", TypeError)


@pytest.mark.parametrize("wrong", ["one", "none", "table"])
def test_messages_about_y_say_y(make_learner, probed, collection, wrong):
    pairs = collection.truths[0].pairs
    y = {"one": collection.truths[0], "none": [], "table": np.stack([pairs] * 6).astype(float)}[
        wrong
    ]
    with pytest.raises((TypeError, ValueError), match=r"^y"):
        make_learner().fit(probed, y)


def test_correspondences_out_of_range_name_the_shape(make_learner, probed, collection):
    pairs = collection.truths[2].pairs.copy()
    n_vertices = collection.meshes[2].n_vertices
    pairs[3, 0] = n_vertices
    message = fails(
        make_learner, probed, changed(collection.truths, 2, pairs), f"vertex {n_vertices}"
    )
    assert "y[2]" in message
    assert "'body2'" in message
    symmetric = Correspondence(collection.truths[2].pairs, pairs)
    fails(
        make_learner, probed, changed(collection.truths, 2, symmetric), "symmetric pairs.*'body2'"
    )


def test_one_dimensional_correspondences_are_refused_by_place_and_name(
    make_learner, probed, collection
):
    column = collection.truths[2].pairs[:, 0]
    message = fails(
        make_learner, probed, changed(collection.truths, 2, column), "from_vertices", TypeError
    )
    assert "from_template" in message
    assert "'body2'" in message


def test_float_pairs_are_refused_by_name(make_learner, probed, collection):
    pairs = collection.truths[2].pairs.astype(float)
    fails(
        make_learner, probed, changed(collection.truths, 2, pairs), "'body2'.*integers", TypeError
    )


def test_empty_correspondences_are_refused_by_name(make_learner, probed, collection):
    nothing = Correspondence(np.empty((0, 2), int))
    fails(make_learner, probed, changed(collection.truths, 2, nothing), "'body2'.*no pairs")


def test_an_empty_join_names_both_shapes(make_learner, probed, collection):
    elsewhere = Correspondence(collection.truths[2].pairs + np.array([0, 1000]))
    message = fails(
        make_learner, probed, changed(collection.truths, 2, elsewhere), "share no template point"
    )
    assert "'body2'" in message
    assert "'body0'" in message


def test_too_few_pairs_for_k_name_the_shape(make_learner, probed, collection):
    few = collection.truths[2].restrict(np.arange(0, 70, 10))
    assert len(few.pairs) == 7
    fails(
        make_learner,
        probed,
        changed(collection.truths, 2, few),
        "'body2'.* share 7 distinct landmarks.*n_functions=12",
    )


def test_a_partial_correspondence_warns_and_is_used(make_learner, probed, collection):
    truth = collection.truths[2]
    left = collection.meshes[2].vertices[truth.pairs[:, 0], 0] < 0
    partial = Correspondence(truth.pairs[left])
    with pytest.warns(
        CoverageWarning, match=r"fewer than the 12 functions requested: X\[2\] \('body2'\) 8\."
    ):
        learner = make_learner().fit(probed[:5], changed(collection.truths[:5], 2, partial))
    assert learner.score(probed[5:], collection.truths[5:]) > -0.1


def test_sparse_well_spread_landmarks_do_not_warn(make_learner, probed, collection):
    points = np.arange(0, 300, 4)
    learner = make_learner().fit(
        probed[:5], [truth.restrict(points) for truth in collection.truths[:5]]
    )
    assert learner.score(probed[5:], collection.truths[5:]) > -0.1


def test_weights_that_are_all_zero_are_refused(make_learner, probed, collection):
    pairs = collection.truths[2].pairs
    nil = Correspondence(pairs, weights=np.zeros(len(pairs)))
    fails(make_learner, probed, changed(collection.truths, 2, nil), "body2")


def test_mirrored_and_plain_answers_do_not_mix(
    make_learner, symmetric_probed, symmetric_collection
):
    """Symmetric pairs are for metrics: fits with and without them are the same."""
    truths = symmetric_collection.truths
    bare = [Correspondence(truth.pairs) for truth in truths]
    one, other = (make_learner().fit(symmetric_probed, y) for y in (truths, bare))
    np.testing.assert_array_equal(one.weights_, other.weights_)


# Shapes that do not fit each other


def test_shapes_of_different_probes_are_refused(make_learner, probe, probed, collection):
    (other,) = probe(collection.meshes[2:3], "paper")
    with pytest.raises(ValueError, match=r"'body2'.*different probe functions"):
        make_learner().fit([*probed[:2], other, *probed[3:]], collection.truths)


def test_new_shapes_of_different_probes_are_refused_by_name(fitted, probe, collection):
    with pytest.raises(
        ValueError, match=r"different probe functions.*one DescriptorTransformer"
    ) as error:
        fitted.predict(probe(collection.meshes[2:3], "paper"))
    assert "body2" in str(error.value)


def test_too_small_a_basis_is_refused_by_name(make_learner, fitted, probed, collection):
    shape = probed[2]
    small = ProbedShape(
        shape.spectral.truncate(11), shape.probes[:11], shape.probe_names, shape.probe_categories
    )
    message = "'body2'.* has 11 eigenfunctions, fewer than n_functions=12"
    with pytest.raises(ValueError, match=message):
        make_learner().fit([*probed[:2], small, *probed[3:]], collection.truths)
    with pytest.raises(ValueError, match=message):
        fitted.predict([small])


def test_bases_of_unequal_size_are_cut_to_k(fitted, probed):
    shape = probed[5]
    small = ProbedShape(
        shape.spectral.truncate(20), shape.probes[:20], shape.probe_names, shape.probe_categories
    )
    np.testing.assert_array_equal(fitted.predict([small]), fitted.predict([shape]))


def test_probes_that_are_not_finite_are_refused_by_name(fitted, probed):
    shape = probed[2]
    probes = np.where(np.arange(shape.probes.shape[1]) == 3, np.nan, shape.probes)
    broken = ProbedShape(shape.spectral, probes, shape.probe_names, shape.probe_categories)
    with pytest.raises(ValueError, match=r"'body2'.*NaN"):
        fitted.predict([broken])


def test_one_shape_alone_teaches_nothing(make_learner, probed, collection):
    with pytest.raises(ValueError, match="at least two usable shapes"):
        make_learner().fit(probed[:1], collection.truths[:1])


def test_two_shapes_are_enough(make_learner, probed, collection):
    learner = make_learner().fit(probed[:2], collection.truths[:2])
    assert learner.predict(probed[:1]).shape == (1, 12, 6)


def test_a_copy_of_the_reference_teaches_nothing_wrong(make_learner, probed, collection):
    """All maps are then exact: the rule for epsilon and the row systems would be singular."""
    learner = make_learner().fit([probed[0], probed[0]], [collection.truths[0]] * 2)
    assert np.isfinite(learner.weights_).all()
    assert (learner.match(probed[:1])[0].p2p == np.arange(500)).all()


@pytest.mark.parametrize(
    "weights", [[1, 1], [1] * 5 + [-1], [1] * 5 + [np.nan], [0] * 6, [1, 0, 0, 0, 0, 0], [[1]] * 6]
)
def test_bad_sample_weights_are_refused(make_learner, probed, collection, weights):
    with pytest.raises(ValueError, match="sample_weight"):
        make_learner().fit(probed, collection.truths, sample_weight=weights)


# Parameters


@pytest.mark.parametrize(
    ("parameters", "error"),
    [
        ({"n_functions": 1}, ValueError),
        ({"n_functions": 12.0}, TypeError),
        ({"n_functions": True}, TypeError),
        ({"weighting": "probe"}, ValueError),
        ({"weighting": "None"}, ValueError),
        ({"epsilon": 0}, ValueError),
        ({"epsilon": "automatic"}, ValueError),
        ({"epsilon": None}, TypeError),
        ({"epsilon": np.nan}, ValueError),
        ({"alpha": 0}, ValueError),
        ({"alpha": -1.0}, ValueError),
        ({"alpha": "1"}, TypeError),
        ({"regularizer": "elastic"}, ValueError),
        ({"regularizer": None}, ValueError),
        ({"normalize": "none"}, ValueError),
        ({"matching": "hard"}, ValueError),
        ({"refine": "magic"}, ValueError),
        ({"reference": "nobody"}, ValueError),
        ({"reference": 0}, ValueError),
        ({"max_iter": 0}, ValueError),
        ({"tol": -1}, ValueError),
        ({"n_stable": 0}, ValueError),
        ({"n_stable": 13}, ValueError),
        ({"n_stable": 0.0}, ValueError),
        ({"n_stable": 1.5}, ValueError),
        ({"n_stable": True}, TypeError),
        ({"n_stable": "half"}, TypeError),
    ],
)
def test_bad_parameters_are_refused_at_fit_and_not_before(
    make_learner, probed, collection, parameters, error
):
    learner = make_learner(**parameters)
    with pytest.raises(error, match=next(iter(parameters))):
        learner.fit(probed, collection.truths)
    assert not hasattr(learner, "weights_")


@pytest.mark.parametrize(
    ("parameters", "error"),
    [
        ({"n_components": 1}, ValueError),
        ({"n_components": 5.5}, TypeError),
        ({"laplacian": "cotan"}, ValueError),
        ({"laplacian": None}, ValueError),
    ],
)
def test_bad_parameters_of_the_basis(collection, parameters, error):
    for method in ("fit", "transform"):
        with pytest.raises(error, match=next(iter(parameters))):
            getattr(SpectralBasis(**parameters), method)(collection.meshes)


@pytest.mark.parametrize("families", ["all", [], [("hks", 3)], 5, [HeatKernelSignature()]])
def test_bad_families_are_refused(probed, families):
    with pytest.raises((TypeError, ValueError), match="amil"):
        DescriptorTransformer(families).fit([shape.spectral for shape in probed])


@pytest.mark.parametrize(
    "parameters",
    [
        {"hks__n_functions": 0},
        {"hks__t_min": 2.0},
        {"hks__t_min": -1.0},
        {"wks_wide__sigma": 0},
        {"wks_wide__lambda_max": 1.0},
        {"gaussian_curvature__kind": "normal"},
        {"mean_curvature__percentile": 50},
        {"log_mean_curvature__floor": 0.0},
        {"saliency__sigma_max": 0.001},
        {"oriented__n_sources": 1},
    ],
)
def test_bad_parameters_of_families_are_refused(probed, parameters):
    transformer = DescriptorTransformer().set_params(**parameters)
    name = next(iter(parameters)).split("__")[1]
    with pytest.raises((TypeError, ValueError), match=name):
        transformer.fit([probed[0].spectral])


def test_a_callable_regularizer_of_the_wrong_shape_is_refused(make_learner, probed, collection):
    for wrong in (lambda a, b: np.ones(3), lambda a, b: np.full((len(a), len(b)), np.nan)):
        with pytest.raises(ValueError, match="regularizer must return"):
            make_learner(regularizer=wrong).fit(probed, collection.truths)


def test_scoring_on_other_points_is_refused(fitted, probed, collection):
    elsewhere = Correspondence(collection.truths[5].pairs + np.array([0, 1000]))
    with pytest.raises(CorrespondenceError, match="no template point"):
        fitted.score(probed[5:], [elsewhere])


def test_the_pipeline_says_the_same_as_its_steps(make_learner, collection):
    model = make_pipeline(SpectralBasis(20), DescriptorTransformer("paper"), make_learner())
    loose = Mesh(np.eye(4, 3), [[0, 1, 2]], name="the cat")
    with pytest.raises(MeshError, match="'the cat'"):
        model.fit([*collection.meshes, loose], [*collection.truths, collection.truths[0]])


def test_labels_of_parts_are_too_few_for_k(make_learner, probed, collection):
    # Five parts of many vertices each: thousands of pairs, five places.
    parts = [
        Correspondence.from_vertices(np.arange(mesh.n_vertices) % 5) for mesh in collection.meshes
    ]
    with pytest.raises(CorrespondenceError, match="share 5 distinct landmarks"):
        make_learner().fit(probed, parts)


def test_pairs_of_no_weight_change_nothing(make_learner, probed, collection):
    rng = np.random.default_rng(0)
    truths = []
    for mesh, truth in zip(collection.meshes, collection.truths, strict=True):
        wrong = np.column_stack([rng.integers(0, mesh.n_vertices, 200), rng.integers(0, 300, 200)])
        weights = np.repeat([1.0, 0.0], [len(truth.pairs), len(wrong)])
        truths.append(Correspondence(np.concatenate([truth.pairs, wrong]), weights=weights))
    plain = make_learner().fit(probed[:5], collection.truths[:5])
    weighted = make_learner().fit(probed[:5], truths[:5])
    np.testing.assert_array_equal(weighted.weights_, plain.weights_)
    models = [learner.error_models_["unrefined"] for learner in (weighted, plain)]
    np.testing.assert_array_equal(models[0].expected_error, models[1].expected_error)


def test_probes_of_other_parameters_are_told_apart(fitted, collection, probe):
    families = [
        (n, f.set_params(sigma=0.9) if isinstance(f, WaveKernelSignature) else f)
        for n, f in default_families()
    ]
    with pytest.raises(ValueError, match=r"computed with different parameters.*sigma"):
        fitted.predict(probe(collection.meshes[5:], families))


@pytest.mark.parametrize(
    ("p2p", "error"),
    [(np.zeros(3, int), ValueError), (np.full(380, -1), ValueError), (np.zeros(380), TypeError)],
)
def test_point_maps_are_checked_before_they_are_scored(p2p, error, collection):
    distances = GeodesicDistances(collection.meshes[0])
    with pytest.raises(error, match="p2p"):
        pair_errors(p2p, collection.truths[5], collection.truths[0], distances)


def test_a_correspondence_made_for_another_number_of_vertices_is_refused(fitted, probed):
    wrong = Correspondence.from_vertices(np.arange(100))
    with pytest.raises(
        CorrespondenceError, match=r"made for 100 vertices, but the shape has 380.*from_template"
    ):
        fitted.score(probed[5:], [wrong])


def test_the_half_that_was_not_fitted_can_be_scored(make_learner, probed, collection):
    fit, held_out = (
        [truth.restrict(np.arange(first, 300, 2)) for truth in collection.truths]
        for first in (0, 1)
    )
    learner = make_learner().fit(probed[:5], fit[:5])
    score = learner.score(probed[5:], held_out[5:], reference_y=held_out[0])
    assert score == get_scorer("neg_geodesic_error", reference_y=held_out[0])(
        learner, probed[5:], held_out[5:]
    )
    assert -0.2 < score < 0
    with pytest.raises(CorrespondenceError, match="share no template point"):
        learner.score(probed[5:], held_out[5:])


def test_parameters_set_after_fit_wait_for_the_next_fit(make_learner, probed, collection):
    learner = make_learner().fit(probed[:5], collection.truths[:5])
    before = learner.predict(probed[5:])
    learner.set_params(alpha=10.0, normalize="reference", matching="cut")
    np.testing.assert_array_equal(learner.predict(probed[5:]), before)


def test_wrong_pairs_are_left_out_with_a_warning(make_learner, probed, collection):
    rng = np.random.default_rng(0)
    truths = list(collection.truths[:4])
    pairs = truths[1].pairs.copy()
    swapped = rng.choice(len(pairs), len(pairs) // 10, replace=False)
    pairs[swapped, 0] = rng.permutation(pairs[swapped, 0])
    truths[1] = Correspondence(pairs)
    with pytest.warns(
        CoverageWarning,
        match=r"pairs of X\[1\] \('body1'\) are far from where a smooth map puts them",
    ):
        noisy = make_learner(weighting=None).fit(probed[:4], truths)
    clean = make_learner(weighting=None).fit(probed[:4], collection.truths[:4])
    errors = [
        learner.pair_errors(probed[5:], collection.truths[5:])[0].mean()
        for learner in (noisy, clean)
    ]
    assert errors[0] < 1.1 * errors[1]


@pytest.mark.parametrize("value", ["1", True, None, 1j])
def test_objects_that_are_no_numbers_are_no_coordinates(value):
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, value, 0]], dtype=object)
    with pytest.raises(MeshError, match="must hold real numbers"):
        Mesh(vertices, [[0, 1, 2]])
    vertices[2, 1] = 1
    assert Mesh(vertices, [[0, 1, 2]]).vertices.dtype == np.float64
