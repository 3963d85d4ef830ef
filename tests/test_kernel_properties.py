"""Laws that the kernels keep for random spectra, probes, maps and surfaces."""

import os

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from skfmap.functional import (
    basis_error,
    diffuse,
    epsilon_by_rule,
    heat_kernel_signature,
    laplacian_eigenbasis,
    learn_functional_maps,
    map_from_pairs,
    penalty_of,
    project,
    rank_norm,
    rank_norm_and_gradient,
    residual_covariance,
    scale_by,
    solve_functional_map,
    spectral_embeddings,
    stable_basis,
    trusted_functions,
    wave_kernel_signature,
    weight_groups,
)
from skfmap.functional.objective import LearningProblem
from skfmap.functional.refinement import map_from_point_maps
from skfmap.functional.regularization import penalty_quadratic
from skfmap.geometry.curvature import gaussian_curvature
from skfmap.geometry.faults import components, edges_of
from skfmap.geometry.geodesics import (
    areas_of_landmarks,
    edge_path_distances,
    exact_distances,
    heat_distances,
)
from skfmap.geometry.laplacian import LAPLACIANS
from skfmap.geometry.orientation import orient_faces, signed_volume

# The same cases in every run; SKFMAP_EXAMPLES=20 for twenty times as many, others each time.
_MORE = int(os.environ.get("SKFMAP_EXAMPLES", "1"))
cases = settings(max_examples=100 * _MORE)
few_cases = settings(max_examples=40 * _MORE)

seeds = st.integers(0, 2**32 - 1)
generators = seeds.map(np.random.default_rng)
sizes = st.integers(2, 9)
n_probes = st.integers(1, 12)
positive = st.floats(1e-4, 1e3)
regularizers = st.sampled_from(["laplacian", "resolvent"])


def _spectrum(rng, k, scale=50.0):
    return np.concatenate([[0.0], np.sort(rng.random(k - 1) * scale) + 0.5])


def _probes(rng, k, m):
    g = rng.standard_normal((k, m))
    return scale_by(g, g, "shape")


def _orthogonal(rng, k):
    return np.linalg.qr(rng.standard_normal((k, k)))[0]


def _problem(rng, n, k, m, regularizer="laplacian"):
    evals, evals_0 = np.stack([_spectrum(rng, k) for _ in range(n)]), _spectrum(rng, k)
    maps = np.eye(k) + 0.3 * rng.standard_normal((n, k, k))
    maps[:, :, 0] = np.eye(k)[0]
    return LearningProblem(
        _probes(rng, k, m),
        np.stack([_probes(rng, k, m) for _ in range(n)]),
        np.stack([penalty_of(e, evals_0, 0.05, regularizer) for e in evals]),
        maps,
        rng.random(n) + 0.5,
        penalty_quadratic(evals, evals_0, 0.05, regularizer),
    )


def _body(rng, n_vertices):
    """Return a star-shaped body of random radius, wound outwards."""
    points = np.concatenate(
        [np.eye(3), -np.eye(3), rng.standard_normal((n_vertices - 6, 3))]
    )  # around the origin
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices.astype(np.int64)
    inward = np.linalg.det(points[faces]) < 0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    radius = 1 + 0.5 * np.tanh(points @ rng.standard_normal((3, 2))).sum(axis=1) / 2
    return points * radius[:, None], faces


bodies = st.builds(_body, generators, st.integers(12, 80))


# The maps of equation (2)


@given(generators, sizes, n_probes, regularizers, positive)
@cases
def test_no_map_near_by_has_a_lower_energy(rng, k, m, regularizer, alpha):
    g_0, g_i, weights = _probes(rng, k, m), _probes(rng, k, m), rng.random(m) + 0.1
    penalty = penalty_of(_spectrum(rng, k), _spectrum(rng, k), alpha, regularizer)

    def energy(C):
        return np.sum(((C @ g_0 - g_i) * weights) ** 2) + np.sum(penalty * C**2)

    C = solve_functional_map(g_0, g_i, penalty, weights)
    for size in (1e-3, 1e-1, 10):
        step = size * rng.standard_normal((k, k))
        step[0], step[:, 0] = 0, 0
        assert energy(C + step) >= energy(C) * (1 - 1e-12)


@given(generators, sizes, n_probes)
@cases
def test_probes_may_be_mixed_by_any_rotation(rng, k, m):
    """At D = I only the span of the probes counts, and how long they are."""
    g_0, g_i, Q = _probes(rng, k, m), _probes(rng, k, m), _orthogonal(rng, m)
    penalty = penalty_of(_spectrum(rng, k), _spectrum(rng, k), 0.1, "laplacian")
    one, other = (
        solve_functional_map(a, b, penalty, np.ones(m)) for a, b in ((g_0, g_i), (g_0 @ Q, g_i @ Q))
    )
    assert_allclose(one, other, atol=1e-9 * max(1, np.abs(one).max()))


@given(generators, sizes, n_probes)
@cases
def test_probes_of_weight_0_are_not_there(rng, k, m):
    g_0, g_i, weights = _probes(rng, k, m + 3), _probes(rng, k, m + 3), rng.random(m + 3)
    weights[m:] = 0
    penalty = penalty_of(_spectrum(rng, k), _spectrum(rng, k), 0.1, "laplacian")
    one = solve_functional_map(g_0, g_i, penalty, weights)
    other = solve_functional_map(g_0[:, :m], g_i[:, :m], penalty, weights[:m])
    assert_allclose(one, other, atol=1e-10 * max(1, np.abs(one).max()))


@given(generators, sizes, positive, regularizers)
@cases
def test_penalties_are_positive_least_on_the_diagonal_of_equals_and_proportional(
    rng, k, alpha, regularizer
):
    evals, evals_0 = _spectrum(rng, k), _spectrum(rng, k)
    penalty = penalty_of(evals, evals_0, alpha, regularizer)
    assert (penalty > 0).all()
    assert_allclose(penalty_of(evals, evals_0, 3 * alpha, regularizer), 3 * penalty, rtol=1e-12)
    same = penalty_of(evals, evals, alpha, regularizer)
    assert (np.diag(same)[:, None] <= same * (1 + 1e-12)).all()


# The objective (3) and its norm (4)


@given(generators, st.integers(1, 3), sizes, n_probes, regularizers, st.floats(1e-2, 10))
@cases
def test_the_gradient_of_the_loss_is_its_slope(rng, n, k, m, regularizer, epsilon):
    problem = _problem(rng, n, k, m, regularizer)
    log_squares, direction = rng.standard_normal(m), rng.standard_normal(m)
    direction /= np.linalg.norm(direction)

    def loss(t):
        return problem.loss(np.exp((log_squares + t * direction) / 2), epsilon)

    _, gradient = problem.loss_gradient(np.exp(log_squares / 2), epsilon)
    slope = float(gradient * np.exp(log_squares) @ direction)
    numeric = (8 * (loss(1e-3) - loss(-1e-3)) - (loss(2e-3) - loss(-2e-3))) / 12e-3
    assert slope == pytest.approx(numeric, rel=1e-5, abs=1e-9 * max(k, 1 / epsilon) * 100)


@given(generators, sizes, sizes, positive)
@cases
def test_the_norm_is_free_of_rotation_between_0_and_the_rank_and_falls_with_epsilon(
    rng, rows, k, epsilon
):
    A = rng.standard_normal((rows, k))
    value = rank_norm(A, epsilon)
    assert 0 <= value <= min(rows, k) + 1e-9
    assert rank_norm(_orthogonal(rng, rows) @ A @ _orthogonal(rng, k), epsilon) == pytest.approx(
        value, rel=1e-9
    )
    assert rank_norm(A, 2 * epsilon) <= value
    assert rank_norm(2 * A, 4 * epsilon) == pytest.approx(value, rel=1e-9)


@given(generators, sizes, sizes, st.floats(1e-2, 1e2))
@cases
def test_the_gradient_of_the_norm_is_its_slope(rng, rows, k, epsilon):
    A, direction = rng.standard_normal((2, rows, k))
    _, gradient = rank_norm_and_gradient(A[None], epsilon)
    step = 1e-3 * np.sqrt(epsilon)
    at = [rank_norm(A + t * step * direction, epsilon) for t in (1, -1, 2, -2)]
    numeric = (8 * (at[0] - at[1]) - (at[2] - at[3])) / (12 * step)
    assert np.sum(gradient[0] * direction) == pytest.approx(numeric, rel=1e-5, abs=1e-7)


@given(generators, st.integers(1, 5), sizes)
@cases
def test_epsilon_leaves_four_fifths_of_the_singular_values_below_nine_tenths(rng, n, k):
    differences = rng.standard_normal((n, k, k))
    epsilon = epsilon_by_rule(differences)
    squares = np.linalg.svd(differences, compute_uv=False).ravel() ** 2
    share = np.mean(squares / (squares + epsilon) <= 0.9 + 1e-12)
    assert share >= 0.8 - 1 / len(squares)
    assert epsilon_by_rule(3 * differences) == pytest.approx(9 * epsilon, rel=1e-9)


@given(
    generators,
    st.integers(1, 3),
    sizes,
    n_probes,
    st.sampled_from(["unique", "category", "function"]),
)
@few_cases
def test_learning_never_ends_above_where_it_began(rng, n, k, m, weighting):
    categories = [f"family {j % 3}" for j in range(m)]
    groups = weight_groups(weighting, categories)
    evals, evals_0 = np.stack([_spectrum(rng, k) for _ in range(n)]), _spectrum(rng, k)
    maps = np.eye(k) + 0.3 * rng.standard_normal((n, k, k))
    maps[:, :, 0] = np.eye(k)[0]
    learned = learn_functional_maps(
        rng.standard_normal((k, m)),
        rng.standard_normal((n, k, m)),
        evals_0,
        evals,
        maps,
        weighting=weighting,
        categories=categories,
        max_iter=1000,
    )
    assert learned.optimum.loss_curve[-1] <= learned.optimum.loss_curve[0]
    assert (np.diff(learned.optimum.loss_curve) <= 1e-9 * learned.optimum.loss_curve[0]).all()
    assert (learned.weights > 0).all()
    for group in np.unique(groups):
        assert np.ptp(learned.weights[groups == group]) == 0


@given(
    st.lists(st.text(max_size=3), min_size=1, max_size=15),
    st.sampled_from([None, "unique", "category", "function"]),
)
@cases
def test_groups_are_numbered_without_gaps_and_follow_their_labels(categories, weighting):
    groups = weight_groups(weighting, categories)
    assert len(groups) == len(categories)
    if weighting is None:
        assert (groups == -1).all()
        return
    assert sorted(set(groups)) == list(range(max(groups) + 1))
    same = weight_groups(categories, ["x"] * len(categories))
    assert weighting != "category" or groups.tolist() == same.tolist()


# Stable functions, section 4.1, and equation (5)


@given(generators, st.integers(1, 4), sizes)
@cases
def test_stable_functions_are_the_best_of_any_number(rng, n, k):
    """Of all orthonormal sets of p functions the first p have the least error (Ky Fan)."""
    differences = rng.standard_normal((n, k, k))
    Y, stability = stable_basis(differences)
    assert_allclose(Y.T @ Y, np.eye(k), atol=1e-10)
    assert (np.diff(stability) >= -1e-12).all()
    p, other = rng.integers(1, k + 1), _orthogonal(rng, k)
    zero = np.zeros((k, k))
    error, others = (
        sum(np.sum(basis_error(A, zero, B[:, :p]) ** 2) for A in differences) for B in (Y, other)
    )
    assert error <= others * (1 + 1e-9)
    assert error == pytest.approx(np.sum(stability[:p] ** 2), rel=1e-9)


@given(generators, st.integers(1, 4), sizes)
@cases
def test_shapes_in_another_order_or_counted_twice_have_the_same_stable_functions(rng, n, k):
    differences = rng.standard_normal((n, k, k))
    _, stability = stable_basis(differences)
    assert_allclose(
        stable_basis(differences[rng.permutation(n)])[1], stability, rtol=1e-9, atol=1e-12
    )
    twice = np.concatenate([differences, differences[:1]])
    weighted = np.array([2.0, *np.ones(n - 1)])
    assert_allclose(
        stable_basis(twice)[1], stable_basis(differences, weighted)[1], rtol=1e-9, atol=1e-12
    )


# Known maps, points, residuals


@given(generators, sizes, st.integers(10, 20))
@cases
def test_pairs_that_a_map_holds_exactly_give_that_map_in_any_order(rng, k, per_function):
    n = per_function * k
    C, mask = _orthogonal(rng, k) * rng.uniform(0.5, 2, k), rng.random((k, k))
    areas = rng.random(n) + 0.1
    areas /= areas.sum()
    evecs_i = np.linalg.qr(rng.standard_normal((n, k)))[0] / np.sqrt(areas)[:, None]
    found = map_from_pairs(evecs_i, evecs_i @ C, areas, mask)
    assert_allclose(found.C, C, atol=1e-8)
    order = rng.permutation(n)
    again = map_from_pairs(evecs_i[order], (evecs_i @ C)[order], areas[order], mask)
    assert_allclose(again.C, found.C, atol=1e-8)
    assert again.n_observed == found.n_observed == k


@given(generators, sizes)
@cases
def test_points_and_their_images_meet_in_every_set_of_functions(rng, k):
    n = 5 * k
    evecs_0, order = rng.standard_normal((n, k)), rng.permutation(n)
    C, functions = _orthogonal(rng, k), rng.standard_normal((k, rng.integers(1, k + 1)))
    evecs_i = evecs_0[order] @ C.T  # so that Phi_i C = Phi_0(T)
    points_i, points_0 = spectral_embeddings(evecs_i, evecs_0, C, functions)
    assert_allclose(points_i, points_0[order], atol=1e-10)
    mass = np.full(n, 1 / n)
    fitted = map_from_point_maps(evecs_i, evecs_0, mass, mass, order, np.argsort(order))
    assert_allclose(fitted, C, atol=1e-8)


@given(generators, sizes, st.integers(1, 40))
@cases
def test_residuals_are_semi_definite_and_more_trust_goes_where_they_are_less(rng, k, n):
    evecs_i, evecs_0, areas = (
        rng.standard_normal((n, k)),
        rng.standard_normal((n, k)),
        rng.random(n) + 0.01,
    )
    covariance = residual_covariance(evecs_i, evecs_0, areas, rng.standard_normal((k, k)))
    assert np.linalg.eigvalsh(covariance).min() >= -1e-9 * np.trace(covariance)
    functions = trusted_functions(covariance)
    lengths = np.linalg.norm(functions, axis=0)
    assert (np.diff(lengths) <= 1e-9).all()
    assert lengths.max() <= 1 + 1e-9
    errors = np.einsum("kp,kl,lp->p", functions, covariance, functions) / lengths**2
    assert (np.diff(errors) >= -1e-9 * np.trace(covariance)).all()


# Functions and signatures in the basis


@given(generators, sizes, st.floats(0, 0.1), st.floats(0, 0.1))
@cases
def test_heat_flows_on_from_where_it_was(rng, k, s, t):
    evals, start = _spectrum(rng, k), rng.standard_normal(k)
    (both,) = diffuse(start, evals, np.array([s + t])).T
    (first,) = diffuse(start, evals, np.array([s])).T
    assert_allclose(diffuse(first, evals, np.array([t]))[:, 0], both, atol=1e-12)
    assert abs(both[0] - start[0]) < 1e-12


@given(generators, sizes, st.integers(1, 5))
@cases
def test_signatures_know_no_signs_and_no_rotation_of_equal_eigenvalues(rng, k, n_times):
    evals, evecs = _spectrum(rng, k), rng.standard_normal((20, k))
    times, energies = np.sort(rng.random(n_times)) + 1e-3, np.log(np.linspace(1, 60, n_times))
    heat, wave = (
        heat_kernel_signature(evals, evecs, times),
        wave_kernel_signature(evals, evecs, energies, 1.0),
    )
    assert (heat >= 0).all()
    assert (np.diff(heat, axis=1) <= 0).all()
    bounds = (evecs[:, 1:] ** 2).min(axis=1), (evecs[:, 1:] ** 2).max(axis=1)
    assert (wave >= bounds[0][:, None] - 1e-12).all()
    assert (wave <= bounds[1][:, None] + 1e-12).all()
    signs = rng.choice([-1.0, 1.0], k)
    assert_allclose(heat_kernel_signature(evals, evecs * signs, times), heat, atol=1e-12)
    if k > 2:
        evals[2] = evals[1]
        turned = evecs.copy()
        turned[:, 1:3] = evecs[:, 1:3] @ _orthogonal(rng, 2)
        for signature in (
            lambda phi: heat_kernel_signature(evals, phi, times),
            lambda phi: wave_kernel_signature(evals, phi, energies, 1.0),
        ):
            assert_allclose(signature(turned), signature(evecs), atol=1e-10)


# Surfaces


@given(bodies, generators, st.sampled_from(sorted(LAPLACIANS)))
@cases
def test_the_laplacian_knows_no_motion_and_no_numbering(body, rng, laplacian):
    (vertices, faces), operator = body, LAPLACIANS[laplacian]
    stiffness, mass = operator(vertices, faces)
    dense = stiffness.toarray()
    assert_allclose(dense, dense.T, atol=1e-9)
    assert_allclose(dense.sum(axis=1), 0, atol=1e-8 * np.abs(dense).max())
    assert np.linalg.eigvalsh(dense).min() >= -1e-8 * np.abs(dense).max()
    assert (mass > 0).all()
    scale, order = 10.0 ** rng.uniform(-2, 2), rng.permutation(len(vertices))
    moved = (
        scale * vertices @ Rotation.random(random_state=rng.integers(2**31)).as_matrix().T
        + rng.random(3)
    )[order]
    again, mass_again = operator(moved, np.argsort(order)[faces])
    assert_allclose(again.toarray(), dense[np.ix_(order, order)], atol=1e-6 * np.abs(dense).max())
    assert_allclose(mass_again, scale**2 * mass[order], rtol=1e-6)


@given(bodies, st.integers(2, 8))
@cases
def test_eigenfunctions_are_orthonormal_and_hold_what_is_projected(body, k):
    stiffness, mass = LAPLACIANS["cotangent"](*body)
    mass = mass / mass.sum()
    evals, evecs = laplacian_eigenbasis(sp.csc_array(stiffness), mass, k)
    assert (np.diff(evals) >= -1e-9).all()
    assert_allclose(evecs[:, 0], 1, atol=1e-9)
    assert_allclose(evecs.T @ (mass[:, None] * evecs), np.eye(k), atol=1e-8)
    residual = stiffness @ evecs - mass[:, None] * evecs * evals
    assert np.abs(residual).max() <= 1e-6 * max(evals[-1], 1)
    coefficients = np.arange(1.0, k + 1)
    assert_allclose(project(evecs @ coefficients, evecs, mass), coefficients, atol=1e-7)


@given(bodies)
@cases
def test_curvature_sums_to_that_of_the_sphere(body):
    vertices, faces = body
    _, mass = LAPLACIANS["cotangent"](vertices, faces)
    assert np.sum(gaussian_curvature(vertices, faces, mass) * mass) == pytest.approx(
        4 * np.pi, rel=1e-8
    )


@given(bodies, generators)
@few_cases
def test_distances_are_distances(body, rng):
    vertices, faces = body
    everywhere = np.arange(len(vertices))
    edges, exact = (
        edge_path_distances(vertices, faces, everywhere),
        exact_distances(vertices, faces, everywhere),
    )
    heat = heat_distances(vertices, faces, everywhere[:4])
    straight = np.linalg.norm(vertices[:, None] - vertices[None], axis=2)
    near = 1e-6 * straight.max()
    for d in (edges, exact):
        assert_allclose(d, d.T, atol=1e-4 * straight.max())
        assert_allclose(np.diag(d), 0, atol=near)
        i, j, between = rng.integers(len(vertices), size=(3, 50))
        assert (d[i, j] <= d[i, between] + d[between, j] + 1e-4 * straight.max()).all()
    assert (straight <= exact + near).all()
    assert (exact <= edges + near).all()
    assert (straight[:4] <= heat + near).all()
    assert (heat <= edges[:4] + near).all()
    assert_allclose(
        edge_path_distances(3 * vertices, faces, everywhere), 3 * edges, rtol=1e-9, atol=1e-12
    )


@given(bodies, generators)
@cases
def test_landmarks_share_the_whole_area(body, rng):
    vertices, faces = body
    _, mass = LAPLACIANS["cotangent"](vertices, faces)
    landmarks = rng.permutation(len(vertices))[: rng.integers(1, len(vertices) + 1)]
    areas = areas_of_landmarks(vertices, faces, mass, landmarks)
    assert areas.sum() == pytest.approx(mass.sum(), rel=1e-9)
    assert (areas >= mass[landmarks] * (1 - 1e-9)).all()


@given(bodies, generators)
@cases
def test_winding_and_volume_know_no_place_and_no_order(body, rng):
    vertices, faces = body
    volume = signed_volume(vertices, faces)
    assert volume > 0
    assert signed_volume(vertices + 5 * rng.standard_normal(3), faces) == pytest.approx(
        volume, rel=1e-6
    )
    assert signed_volume(vertices, faces[:, [0, 2, 1]]) == pytest.approx(-volume, rel=1e-9)
    turned = faces.copy()
    flipped = rng.random(len(faces)) < rng.random()
    turned[flipped] = turned[flipped][:, [0, 2, 1]]
    wound, consistent, outward = orient_faces(vertices, turned)
    assert consistent
    assert outward
    assert {tuple(np.roll(face, -face.argmin())) for face in wound} == {
        tuple(np.roll(face, -face.argmin())) for face in faces
    }


@given(st.lists(bodies, min_size=1, max_size=4), generators)
@few_cases
def test_components_and_edges_are_counted_whatever_the_numbering(several, rng):
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in several])
    faces = np.concatenate(
        [faces + start for (_, faces), start in zip(several, starts, strict=False)]
    )
    order = rng.permutation(starts[-1])
    shuffled = order[faces][rng.permutation(len(faces))]
    assert len(np.unique(components(shuffled, starts[-1]))) == len(several)
    # Euler: V - E + F = 2 for each of them.
    assert starts[-1] - len(edges_of(shuffled)) + len(faces) == 2 * len(several)
