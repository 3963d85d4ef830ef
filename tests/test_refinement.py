"""Trusted functions, maps fitted to points, refinement, interpolation, and transfer."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from scipy.stats import spearmanr
from sklearn.model_selection import GridSearchCV, LeaveOneOut

import skfmap
from skfmap import Mesh, WeightedFunctionalMapLearner
from skfmap.functional import (
    map_from_point_maps,
    nearest_on_triangles,
    nearest_orthogonal,
    residual_covariance,
    stable_basis,
    trusted_functions,
)
from skfmap.learner.signs import count_supporting
from skfmap.metrics import coverage
from skfmap.model_selection import PinnedReference
from skfmap.refinement import BijectiveZoomOut

REFINEMENTS = ("icp", "zoomout", "bijective-zoomout")


def _orthonormal(rng, n, k):
    """Return functions orthonormal for equal areas, the first constant."""
    values = rng.standard_normal((n, k))
    values[:, 0] = 1
    return np.linalg.qr(values)[0] * np.sqrt(n) * np.sign(values[0, 0])


def test_the_covariance_is_the_stable_basis_where_nothing_is_cut():
    rng = np.random.default_rng(0)
    evecs, C, areas = _orthonormal(rng, 40, 6), rng.standard_normal((6, 6)), np.full(40, 1 / 40)
    E = rng.standard_normal((6, 6))
    covariance = residual_covariance(evecs, evecs @ C, areas, C + E)
    Y, s = stable_basis(E[None])
    np.testing.assert_allclose(covariance, (Y * s**2) @ Y.T, atol=1e-12)


def test_leverage_gives_the_residuals_of_pairs_left_out():
    rng = np.random.default_rng(1)
    A, B, areas = (
        rng.standard_normal((15, 4)),
        rng.standard_normal((15, 4)),
        rng.uniform(0.5, 1.5, 15),
    )
    gram = (areas[:, None] * A).T @ A
    expected = np.zeros((4, 4))
    for q in range(15):
        rest = np.arange(15) != q
        w = np.sqrt(areas[rest])[:, None]
        C = np.linalg.lstsq(w * A[rest], w * B[rest], rcond=None)[0]
        residual = A[q] @ C - B[q]
        expected += areas[q] * np.outer(residual, residual) / areas.sum()
    C = np.linalg.solve(gram, (areas[:, None] * A).T @ B)
    np.testing.assert_allclose(
        residual_covariance(A, B, areas, C, leverage_of=gram), expected, rtol=1e-9
    )


def test_functions_are_trusted_less_the_more_they_err():
    functions = trusted_functions(np.diag([1.0, 0.0, 5.0]))
    np.testing.assert_allclose(np.abs(functions).sum(axis=0), [1, 0.4 / 1.4, 0.4 / 5.4])
    np.testing.assert_array_equal(trusted_functions(np.zeros((3, 3))), np.eye(3))


def test_trusted_functions_do_not_depend_on_the_unit_of_errors():
    covariance = np.cov(np.random.default_rng(2).standard_normal((5, 30)))
    first, second = trusted_functions(covariance), trusted_functions(7 * covariance)
    np.testing.assert_allclose(first @ first.T, second @ second.T, atol=1e-12)


def test_a_map_fitted_to_both_point_maps_is_the_least_of_both_terms():
    rng = np.random.default_rng(3)
    evecs_i, evecs_0 = rng.standard_normal((12, 3)), rng.standard_normal((9, 3))
    mass_i, mass_0 = rng.uniform(0.1, 1, 12), rng.uniform(0.1, 1, 9)
    p2p, inverse = rng.integers(0, 9, 12), rng.integers(0, 12, 9)

    def energy(x):
        C = x.reshape(3, 3)
        first = (mass_i[:, None] * (evecs_i @ C - evecs_0[p2p]) ** 2).sum()
        return first + (mass_0[:, None] * (evecs_i[inverse] @ C - evecs_0) ** 2).sum()

    C = map_from_point_maps(evecs_i, evecs_0, mass_i, mass_0, p2p, inverse)
    np.testing.assert_allclose(C.ravel(), minimize(energy, np.zeros(9), tol=1e-12).x, atol=1e-5)


def test_constants_map_to_constants_whatever_the_points():
    rng = np.random.default_rng(4)
    evecs, mass = _orthonormal(rng, 20, 5), np.full(20, 1 / 20)
    for inverse in (None, rng.integers(0, 20, 20)):
        C = map_from_point_maps(evecs, evecs, mass, mass, rng.integers(0, 20, 20), inverse)
        np.testing.assert_allclose(C[:, 0], np.eye(5)[0], atol=1e-12)


def test_a_renumbering_gives_an_orthogonal_map_in_either_direction():
    rng = np.random.default_rng(5)
    order = rng.permutation(30)
    evecs_0, mass = _orthonormal(rng, 30, 6), np.full(30, 1 / 30)
    back = np.argsort(order)
    for inverse in (None, back):
        C = map_from_point_maps(evecs_0[order], evecs_0, mass, mass, order, inverse)
        np.testing.assert_allclose(C, np.eye(6), atol=1e-12)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_the_nearest_orthogonal_map_is_nearer_than_others(seed):
    rng = np.random.default_rng(seed)
    C, other = rng.standard_normal((4, 4)), np.linalg.qr(rng.standard_normal((4, 4)))[0]
    nearest = nearest_orthogonal(C)
    np.testing.assert_allclose(nearest.T @ nearest, np.eye(4), atol=1e-12)
    assert np.linalg.norm(C - nearest) <= np.linalg.norm(C - other) + 1e-12


@given(st.integers(0, 2**32 - 1), st.integers(2, 6))
@settings(max_examples=50)
def test_the_nearest_point_of_a_triangle_is_nearer_than_others(seed, d):
    rng = np.random.default_rng(seed)
    corners, point = rng.standard_normal((1, 3, d)), 2 * rng.standard_normal((1, d))
    barycentric, squared = nearest_on_triangles(point, corners)
    assert barycentric.min() >= 0
    np.testing.assert_allclose(barycentric.sum(), 1)
    np.testing.assert_allclose(
        np.square(barycentric[0] @ corners[0] - point[0]).sum(), squared[0], atol=1e-14
    )
    others = rng.dirichlet(np.full(3, 0.5), 200) @ corners[0]
    assert squared[0] <= np.square(others - point[0]).sum(axis=1).min() + 1e-12


@pytest.mark.parametrize("corners", [np.zeros((1, 3, 2)), np.array([[[0.0, 0], [1, 0], [2, 0]]])])
def test_degenerate_triangles_have_a_nearest_point(corners):
    barycentric, squared = nearest_on_triangles(np.array([[1.5, 1.0]]), corners)
    assert np.isfinite(barycentric).all()
    np.testing.assert_allclose(squared, 1.0 if corners.any() else 3.25)


@pytest.fixture(scope="module")
def refined(make_learner, probed, collection):
    """Return a learner of few functions, with the rest of the basis left to refinement."""
    return make_learner(n_functions=8, refine="bijective-zoomout").fit(
        probed[:5], collection.truths[:5]
    )


def test_refinement_lowers_the_error_on_an_unseen_shape(make_learner, probed, collection):
    # Four functions without learned weights leave something to refine.
    rough = {"n_functions": 4, "weighting": None}
    few = make_learner(**rough, refine="bijective-zoomout").fit(probed[:5], collection.truths[:5])

    def error(refine):
        return few.pair_errors(probed[5:], collection.truths[5:], refine=refine)[0].mean("direct")

    assert error("bijective-zoomout") < 0.9 * error(None)
    assert error("fitted") == error("bijective-zoomout")
    assert -few.score(probed[5:], collection.truths[5:]) == error("fitted")


@pytest.mark.parametrize("refine", REFINEMENTS)
def test_every_refinement_can_be_asked_for(refined, make_model, probed, collection, refine):
    (match,) = refined.match(probed[5:], refine=refine)
    size = 8 if refine == "icp" else probed[5].spectral.n_components
    assert match.refined_map.shape == (size, size)
    np.testing.assert_allclose(match.refined_map[:, 0], np.eye(size)[0], atol=1e-9)
    np.testing.assert_array_equal(match.functional_map, refined.functional_maps(probed[5:])[0])
    np.testing.assert_array_equal(match.p2p, refined.point_maps(probed[5:], refine=refine)[0])
    assert np.isfinite(match.expected_error).all()


def test_the_override_of_match_is_the_parameter_of_the_learner(
    refined, make_learner, probed, collection
):
    plain = make_learner(n_functions=8).fit(probed[:5], collection.truths[:5])
    (asked,) = skfmap.match(plain, probed[5:], refine="bijective-zoomout")
    (fitted,) = refined.match(probed[5:])
    (undone,) = skfmap.match(refined, probed[5:], refine=None)
    np.testing.assert_array_equal(asked.p2p, fitted.p2p)
    np.testing.assert_array_equal(undone.p2p, plain.match(probed[5:])[0].p2p)
    np.testing.assert_array_equal(undone.expected_error, plain.match(probed[5:])[0].expected_error)
    # Not calibrated by this model: the errors are those of the match before.
    np.testing.assert_array_equal(asked.expected_error, undone.expected_error)
    assert not np.array_equal(fitted.expected_error, undone.expected_error)


def test_a_shape_is_refined_onto_itself(refined, probed):
    (match,) = refined.match([refined.reference_])
    assert (match.p2p == np.arange(len(match.p2p))).mean() > 0.99
    assert coverage(match.p2p, refined.reference_.spectral.mass) > 0.99


def test_refinement_does_not_depend_on_pose_scale_and_numbering(make_model, collection, refined):
    model = make_model(n_functions=8, refine="bijective-zoomout").fit(
        collection.meshes[:5], collection.truths[:5]
    )
    mesh = collection.meshes[5]
    order = np.random.default_rng(0).permutation(mesh.n_vertices)
    moved = mesh.vertices @ Rotation.from_rotvec([1.0, 2, 3]).as_matrix().T * 30 + 5
    other = Mesh(moved[order], np.argsort(order)[mesh.faces])
    (plain,), (changed,) = skfmap.match(model, [mesh]), skfmap.match(model, [other])
    assert (changed.p2p == plain.p2p[order]).mean() > 0.995


def test_refine_can_be_searched(make_learner, probed, collection):
    learner = make_learner(n_functions=4, weighting=None)
    search = GridSearchCV(
        learner,
        {"refine": [None, "bijective-zoomout"]},
        cv=PinnedReference(LeaveOneOut()),
        refit=False,
    ).fit(probed[:4], collection.truths[:4])
    assert search.best_params_ == {"refine": "bijective-zoomout"}


@pytest.mark.parametrize("how", [{"refine": "magic"}, {"interpolate": "splines"}])
def test_unknown_ways_are_refused(refined, probed, how):
    with pytest.raises(ValueError, match=next(iter(how))):
        refined.match(probed[5:], **how)
    with pytest.raises(ValueError, match=next(iter(how))):
        skfmap.match(refined, probed[5:], **how)


@pytest.mark.parametrize("interpolate", [None, "barycentric", "soft"])
def test_matrices_pull_constants_and_coordinates_back(refined, probed, interpolate):
    (match,) = refined.match(probed[5:], interpolate=interpolate)
    n_i, n_0 = (shape.spectral.mesh.n_vertices for shape in (probed[5], refined.reference_))
    assert match.matrix.shape == (n_i, n_0)
    np.testing.assert_allclose(match.matrix.sum(axis=1), 1)
    assert match.matrix.min() >= 0
    vertices = refined.reference_.spectral.vertices
    apart = np.linalg.norm(match.matrix @ vertices - vertices[match.p2p], axis=1)
    assert apart.max() < {None: 1e-12, "barycentric": 0.2, "soft": 0.5}[interpolate]
    if interpolate == "barycentric":
        evecs = refined.reference_.spectral.evecs
        points = probed[5].spectral.evecs @ match.refined_map
        functions = trusted_functions(refined.truncation_covariance_)
        to_vertex, to_triangle = (
            np.linalg.norm((points - image) @ functions, axis=1)
            for image in (evecs[match.p2p], match.matrix @ evecs)
        )
        assert (to_triangle <= to_vertex + 1e-9).all()
        assert to_triangle.mean() < 0.95 * to_vertex.mean()


def test_functions_are_transferred_with_the_doubtful_part_marked(refined, probed):
    (match,) = refined.match(probed[5:], interpolate="barycentric")
    heights = refined.reference_.spectral.vertices
    limit = float(np.median(match.expected_error))
    moved = match.transfer(heights, max_error=limit)
    np.testing.assert_allclose(moved.data, match.matrix @ heights)
    np.testing.assert_array_equal(moved.mask[:, 0], match.expected_error > limit)
    assert match.transfer(heights[:, 0]).mask.sum() == 0
    labels = np.where(heights[:, 2] > 0, "top", "bottom")
    moved = match.transfer(labels)
    assert set(np.unique(moved)) <= {"top", "bottom"}
    assert (moved.data == labels[match.p2p]).mean() > 0.9
    flags = match.transfer(heights[:, 2] > 0)
    np.testing.assert_array_equal(flags.data, moved.data == "top")


@pytest.mark.parametrize("wrong", [np.zeros(3), np.zeros(()), [1.0, 2.0]])
def test_functions_that_are_not_on_the_reference_are_refused(refined, probed, wrong):
    (match,) = refined.match(probed[5:])
    with pytest.raises(
        ValueError, match=r"values must have one entry or row for each of the .* vertices"
    ):
        match.transfer(wrong)


def test_stable_functions_support_good_matches_more(refined, probed):
    matcher = refined.matcher_
    match, _ = matcher.match_points(probed[5], matcher.solve(probed[5]).C)
    shuffled = match._replace(p2p=np.random.default_rng(0).permutation(match.p2p))
    right, wrong = (count_supporting(matcher, probed[5], one) for one in (match, shuffled))
    assert 0 <= wrong.min() <= right.max() <= 8
    assert right.mean() > wrong.mean() + 2


def test_errors_are_expected_from_shapes_left_out(make_learner, probed, collection):
    several = make_learner(weighting=None).fit(probed[:4], collection.truths[:4])
    one = make_learner(weighting=None).fit(probed[:2], collection.truths[:2])
    assert several.error_models_["unrefined"].cross_validated
    assert not one.error_models_["unrefined"].cross_validated
    for learner in (several, one):
        (match,) = learner.match(probed[5:])
        assert np.isfinite(match.expected_error).all()
        assert match.expected_error.min() >= 0


def test_expected_errors_rank_true_ones(refined, probed, collection):
    (match,) = refined.match(probed[5:])
    (errors,) = refined.pair_errors(probed[5:], collection.truths[5:])
    expected = match.expected_error[errors.vertices]
    assert spearmanr(expected, errors.direct)[0] > 0.2
    trusted = expected <= np.median(expected)
    assert errors.direct[trusted].mean() < 0.85 * errors.direct.mean()


def test_sparse_landmarks_can_be_refined(make_learner, probed, collection):
    some = [truth.restrict(truth.pairs[::40, 1]) for truth in collection.truths]
    learner = make_learner(n_functions=8, weighting=None, refine="bijective-zoomout").fit(
        probed[:4], some[:4]
    )
    assert np.linalg.eigvalsh(learner.truncation_covariance_).min() > -1e-12
    dense = learner.pair_errors(probed[5:], collection.truths[5:], reference_y=collection.truths[0])
    assert dense[0].mean("direct") < 0.1


def test_learners_are_not_needed_for_the_match(refined):
    assert isinstance(refined, WeightedFunctionalMapLearner)
    assert refined.truncation_covariance_.shape == (refined.reference_.spectral.n_components,) * 2


def test_a_match_made_by_hand_says_what_it_lacks(refined, probed):
    (match,) = refined.match(probed[5:])
    bare = skfmap.Match(
        match.p2p, match.expected_error, match.confidence, match.functional_map, match.reduced_map
    )
    with pytest.raises(ValueError, match="has no matrix"):
        bare.transfer(np.zeros(3))
    with pytest.raises(ValueError, match="need a matrix and an inverse"):
        match.to(bare)


def _energy(learned, spectral, match):
    """Return what a step lowers: squared distances of matched points in both directions."""
    to, back = match.points_0[match.p2p], match.points_i[match.inverse]
    mass_i, mass_0 = spectral.mass, learned.reference.spectral.mass
    return mass_i @ np.square(match.points_i - to).sum(axis=1) + mass_0 @ np.square(
        match.points_0 - back
    ).sum(axis=1)


def test_each_step_on_all_vertices_lowers_the_squared_distances(refined, probed):
    """Steps beyond the fitted map do so too, as long as they do not go twice as far."""
    matcher, spectral = refined.matcher_, probed[5].spectral
    start = matcher.match_points(probed[5], matcher.solve(probed[5]).C)[0]
    energies = [
        _energy(matcher, spectral, BijectiveZoomOut(30, n).refine(matcher, spectral, start))
        for n in range(1, 7)
    ]
    assert (np.diff(energies) <= 1e-9 * energies[0]).all()
    assert energies[-1] < 0.99 * energies[0]


def test_samples_find_about_what_all_vertices_find(refined, probed, collection):
    def error(**parameters):
        (errors,) = refined.pair_errors(
            probed[5:], collection.truths[5:], refine=BijectiveZoomOut(**parameters)
        )
        return errors.mean("direct")

    whole = error(n_samples=None)
    assert error(n_samples=10_000) == whole
    assert error(n_samples=190) < 1.1 * whole


def test_references_do_not_outlive_their_use(refined, probed):
    matcher = refined.matcher_
    spectral, shape = probed[5].spectral, replace(matcher.reference.spectral)
    other = replace(matcher, reference=replace(matcher.reference, spectral=shape))
    start = matcher.match_points(probed[5], matcher.solve(probed[5]).C)[0]
    for n_samples in (100, None):
        first = BijectiveZoomOut(n_samples=n_samples).refine(other, spectral, start)
        again = BijectiveZoomOut(n_samples=n_samples).refine(other, spectral, start)
        np.testing.assert_array_equal(first.p2p, again.p2p)
    alive = weakref.ref(shape)
    del shape, other
    gc.collect()
    assert alive() is None
