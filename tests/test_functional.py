"""The mathematics on arrays: closed forms, two routes, gradients against finite differences."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from skfmap.functional import (
    LearningProblem,
    basis_error,
    diffuse,
    epsilon_by_rule,
    heat_kernel_signature,
    laplacian_eigenbasis,
    laplacian_mask,
    learn_functional_maps,
    learned_mask,
    map_from_pairs,
    optimize_weights,
    penalty_of,
    project,
    rank_norm,
    rank_norm_and_gradient,
    resolvent_mask,
    scale_by,
    solve_functional_map,
    spectral_embeddings,
    stable_basis,
    wave_kernel_signature,
    weight_groups,
    wrong_pairs,
)
from skfmap.functional.regularization import DIAGONAL_FLOOR

SIZES = st.tuples(st.integers(3, 9), st.integers(1, 12), st.integers(0, 2**31))


def random_problem(rng, n=3, k=7, m=9, alpha=0.05):
    """Return a learning problem with random probes, spectra and maps."""
    evals = np.sort(rng.random((n + 1, k)) * 50, axis=1)
    evals[:, 0] = 0
    probes_0 = rng.standard_normal((k, m))
    probes = rng.standard_normal((n, k, m)) + probes_0
    maps = np.eye(k) + 0.3 * rng.standard_normal((n, k, k))
    maps[:, :, 0] = np.eye(k)[0]
    return LearningProblem(
        scale_by(probes_0, probes_0, "shape"),
        np.stack([scale_by(probes_0, g, "shape") for g in probes]),
        np.stack([penalty_of(e, evals[0], alpha, "laplacian") for e in evals[1:]]),
        maps,
        rng.random(n) + 0.5,
    )


def brute_force_map(probes_0, probes_i, mask, weights, alpha):
    """Solve equation (2), floor included, as one least-squares problem without the constant."""
    k, m = probes_0.shape
    n = k - 1
    data = np.kron(np.eye(n), (probes_0[1:] * weights).T)
    prior = np.sqrt(alpha) * np.diag(np.sqrt(mask[1:, 1:] ** 2 + DIAGONAL_FLOOR).ravel())
    rhs = np.concatenate([(probes_i[1:] * weights).ravel(), np.zeros(n * n)])
    assert data.shape == (n * m, n * n)
    C = np.eye(k)
    C[1:, 1:] = np.linalg.lstsq(np.vstack([data, prior]), rhs, rcond=None)[0].reshape(n, n)
    return C


@given(SIZES)
@settings(max_examples=25)
def test_row_systems_agree_with_one_least_squares_problem(sizes):
    k, m, seed = sizes
    rng = np.random.default_rng(seed)
    evals = np.sort(rng.random((2, k)) * 30, axis=1)
    evals[:, 0] = 0
    g_0, g_i = (scale_by(g, g, "shape") for g in rng.standard_normal((2, k, m)))
    weights = np.exp(rng.standard_normal(m))
    C = solve_functional_map(g_0, g_i, penalty_of(evals[0], evals[1], 0.1, "laplacian"), weights)
    expected = brute_force_map(g_0, g_i, laplacian_mask(*evals), weights, 0.1)
    np.testing.assert_allclose(C, expected, atol=1e-10 * max(1, np.abs(expected).max()))


def test_learning_problem_solves_each_shape_alone():
    problem = random_problem(np.random.default_rng(0))
    weights = np.exp(np.random.default_rng(1).standard_normal(9))
    for C, g, penalty in zip(
        problem.solve(weights), problem.probes, problem.penalties, strict=True
    ):
        np.testing.assert_array_equal(
            C, solve_functional_map(problem.probes_0, g, penalty, weights)
        )


def test_constants_map_to_constants():
    problem = random_problem(np.random.default_rng(3))
    C = problem.solve(np.ones(9))
    np.testing.assert_array_equal(C[:, :, 0], np.tile(np.eye(7)[0], (3, 1)))


def test_map_does_not_depend_on_the_sign_of_the_weights():
    problem = random_problem(np.random.default_rng(4))
    weights = np.random.default_rng(5).standard_normal(9)
    np.testing.assert_allclose(problem.solve(weights), problem.solve(np.abs(weights)), atol=1e-12)


def test_the_floor_shrinks_what_probes_see_and_settles_what_none_sees():
    """One probe, a mask of nil: (1 + alpha delta) C_11 = 2, and all else has its minimum at 0."""
    probes_0, probes_i, evals = np.zeros((3, 1)), np.zeros((3, 1)), np.arange(3.0)
    probes_0[1], probes_i[1] = 1.0, 2.0
    penalty = penalty_of(evals, evals, 100.0, lambda evals_i, evals_0: np.zeros((3, 3)))
    C = solve_functional_map(probes_0, probes_i, penalty, np.ones(1))
    np.testing.assert_allclose(C, np.diag([1, 2 / (1 + 100 * 1e-5), 0]), atol=1e-15)


def test_scaling_weights_is_dividing_alpha_by_the_square():
    rng = np.random.default_rng(6)
    g_0, g_i = (scale_by(g, g, "shape") for g in rng.standard_normal((2, 6, 8)))
    evals = np.arange(6.0)
    one = solve_functional_map(
        g_0, g_i, penalty_of(evals, evals + 0.1, 0.09, "laplacian"), 3 * np.ones(8)
    )
    other = solve_functional_map(
        g_0, g_i, penalty_of(evals, evals + 0.1, 0.01, "laplacian"), np.ones(8)
    )
    np.testing.assert_allclose(one, other, atol=1e-12)


@given(SIZES, st.floats(1e-3, 10))
@settings(max_examples=25)
def test_rank_norm_is_the_sum_over_singular_values(sizes, epsilon):
    k, m, seed = sizes
    A = np.random.default_rng(seed).standard_normal((m, k))
    sigma = np.linalg.svd(A, compute_uv=False)
    assert rank_norm(A, epsilon) == pytest.approx(
        np.sum(sigma**2 / (sigma**2 + epsilon)), rel=1e-9, abs=1e-12
    )


def test_rank_norm_counts_the_rank_when_epsilon_is_small():
    A = np.random.default_rng(0).standard_normal((8, 3)) @ np.random.default_rng(1).standard_normal(
        (3, 8)
    )
    assert rank_norm(A, 1e-8) == pytest.approx(3, abs=1e-6)


@pytest.mark.parametrize("repeated", [False, True])
def test_gradient_of_the_norm_agrees_with_finite_differences(repeated):
    rng = np.random.default_rng(2)
    A = np.eye(5) * 0.7 if repeated else rng.standard_normal((6, 5))
    direction = rng.standard_normal(A.shape)
    _, gradient = rank_norm_and_gradient(A[None], 0.3)
    step = 1e-5
    numeric = (rank_norm(A + step * direction, 0.3) - rank_norm(A - step * direction, 0.3)) / (
        2 * step
    )
    assert (gradient[0] * direction).sum() == pytest.approx(numeric, rel=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_gradient_of_the_loss_agrees_with_finite_differences(seed):
    rng = np.random.default_rng(seed)
    problem = random_problem(rng)
    log_weights, direction = 0.5 * rng.standard_normal(9), rng.standard_normal(9)
    loss, gradient = problem.loss_gradient(np.exp(log_weights), 0.2)
    analytic = direction @ (2 * gradient * np.exp(2 * log_weights))
    assert loss == pytest.approx(problem.loss(np.exp(log_weights), 0.2), rel=1e-12)

    def difference(step):
        ahead = problem.loss(np.exp(log_weights + step * direction), 0.2)
        return (ahead - problem.loss(np.exp(log_weights - step * direction), 0.2)) / (2 * step)

    # Richardson's extrapolation removes the leading error of the central difference.
    numeric = (4 * difference(5e-4) - difference(1e-3)) / 3
    assert analytic == pytest.approx(numeric, rel=1e-6)


def test_epsilon_rule_puts_eighty_percent_of_the_singular_values_below():
    A = np.random.default_rng(0).standard_normal((5, 20, 20))
    epsilon = epsilon_by_rule(A)
    squares = np.linalg.svd(A, compute_uv=False) ** 2
    assert np.mean(squares / (squares + epsilon) <= 0.9) == pytest.approx(0.8, abs=0.01)


def test_weight_groups():
    categories = ["a", "b", "a", "c"]
    assert weight_groups(None, categories).tolist() == [-1] * 4
    assert weight_groups("unique", categories).tolist() == [0] * 4
    assert weight_groups("category", categories).tolist() == [0, 1, 0, 2]
    assert weight_groups("function", categories).tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("weighting", ["unique", "category", "function"])
def test_learning_lowers_the_loss_and_ends_at_a_stationary_point(weighting):
    problem = random_problem(np.random.default_rng(8))
    groups = weight_groups(weighting, ["a"] * 4 + ["b"] * 5)
    optimum = optimize_weights(problem, groups, 0.1, max_iter=500, tol=1e-6)
    assert optimum.converged
    assert optimum.loss_curve[-1] < optimum.loss_curve[0]
    assert optimum.loss_curve[-1] == pytest.approx(problem.loss(optimum.weights, 0.1), rel=1e-9)
    assert optimum.gradient_norm < 1e-4
    for group in range(groups.max() + 1):
        assert np.ptp(optimum.weights[groups == group]) == 0


def test_more_freedom_reaches_a_lower_loss():
    problem = random_problem(np.random.default_rng(9))
    losses = [
        optimize_weights(
            problem, weight_groups(w, ["a"] * 4 + ["b"] * 5), 0.1, max_iter=500, tol=1e-7
        ).loss_curve[-1]
        for w in (None, "unique", "category", "function")
    ]
    assert losses == sorted(losses, reverse=True)


def test_stable_basis_minimises_the_summed_error():
    A = np.random.default_rng(0).standard_normal((4, 6, 6)) * np.array([3, 1, 0.1, 2, 0.5, 1.0])
    Y, stability = stable_basis(A)
    np.testing.assert_allclose(Y.T @ Y, np.eye(6), atol=1e-12)
    assert (np.diff(stability) >= 0).all()
    np.testing.assert_allclose(
        np.sqrt((np.linalg.norm(A @ Y, axis=1) ** 2).sum(axis=0)), stability, atol=1e-12
    )
    gram = np.einsum("nij,nik->jk", A, A)
    np.testing.assert_allclose(np.linalg.eigvalsh(gram), stability**2, rtol=1e-9)


def test_sample_weight_is_repetition_in_the_stable_basis():
    A = np.random.default_rng(1).standard_normal((3, 5, 5))
    _, weighted = stable_basis(A, np.array([2.0, 1.0, 0.0]))
    _, repeated = stable_basis(A[[0, 0, 1]])
    np.testing.assert_allclose(weighted, repeated, rtol=1e-12)


def test_basis_error_is_the_norm_on_each_function():
    rng = np.random.default_rng(2)
    X, C = rng.standard_normal((2, 5, 5))
    Y, _ = np.linalg.qr(rng.standard_normal((5, 5)))
    assert np.sum(basis_error(X, C, Y) ** 2) == pytest.approx(np.linalg.norm(X - C) ** 2)


def test_learning_finds_the_probes_that_are_kept():
    rng = np.random.default_rng(0)
    k, m, n = 8, 24, 6
    probes_0, evals = rng.standard_normal((k, m)), np.arange(float(k))
    rotation, _ = np.linalg.qr(rng.standard_normal((n, k - 1, k - 1)))
    maps = np.tile(np.eye(k), (n, 1, 1))
    maps[:, 1:, 1:] = rotation
    noise = np.where(np.arange(m) < m // 2, 0.01, 2.0)
    probes = maps @ probes_0 + noise * rng.standard_normal((n, k, m))
    flat = lambda evals_i, evals_0: np.ones((len(evals_i), len(evals_0)))
    arguments = (probes_0, probes, evals, np.tile(evals, (n, 1)), maps)
    learned = learn_functional_maps(*arguments, regularizer=flat)
    naive = learn_functional_maps(*arguments, regularizer=flat, weighting=None)
    assert learned.weights[: m // 2].min() > learned.weights[m // 2 :].max()
    assert np.linalg.norm(learned.maps - maps) < 0.2 * np.linalg.norm(naive.maps - maps)
    np.testing.assert_array_equal(naive.weights, np.ones(m))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weighting": "all"}, "weighting must be one of"),
        ({"weighting": "category"}, "needs the category"),
        ({"categories": ["a"]}, "must name all"),
        ({"regularizer": lambda _i, _0: np.ones(3)}, "must return finite real values of shape"),
    ],
)
def test_learning_says_what_is_wrong_with_its_choices(change, message):
    g, evals = np.random.default_rng(0).standard_normal((3, 4, 5)), np.arange(4.0)
    with pytest.raises(ValueError, match=message):
        learn_functional_maps(
            g[0], g[1:], evals, np.tile(evals, (2, 1)), np.tile(np.eye(4), (2, 1, 1)), **change
        )


def test_learning_says_which_array_does_not_fit():
    g, evals = np.random.default_rng(0).standard_normal((3, 4, 5)), np.arange(4.0)
    with pytest.raises(ValueError, match="have different k"):
        learn_functional_maps(
            g[0], g[1:, :3], evals, np.tile(evals, (2, 1)), np.tile(np.eye(4), (2, 1, 1))
        )
    with pytest.raises(ValueError, match="maps contains NaN"):
        learn_functional_maps(
            g[0], g[1:], evals, np.tile(evals, (2, 1)), np.full((2, 4, 4), np.nan)
        )
    with pytest.raises(ValueError, match="no maps to learn from"):
        learn_functional_maps(g[0], g[:0], evals, np.empty((0, 4)), np.empty((0, 4, 4)))


@given(SIZES)
@settings(max_examples=25)
def test_normalised_columns_have_one_norm_and_no_constant(sizes):
    k, m, seed = sizes
    raw = np.random.default_rng(seed).standard_normal((k, m)) * np.logspace(-6, 6, m)
    out = scale_by(raw, raw, "shape")
    np.testing.assert_allclose(np.linalg.norm(out, axis=0), 1 / np.sqrt(m), rtol=1e-9)
    assert (out[0] == 0).all()


def test_normalising_by_the_reference_keeps_amplitudes():
    raw_0 = np.random.default_rng(0).standard_normal((5, 4))
    np.testing.assert_allclose(
        scale_by(raw_0, 3 * raw_0, "reference"), 3 * scale_by(raw_0, raw_0, "reference")
    )
    np.testing.assert_allclose(scale_by(raw_0, 3 * raw_0, "shape"), scale_by(raw_0, raw_0, "shape"))


def test_a_probe_that_is_constant_on_one_shape_is_dropped_on_both():
    raw_0, raw_i = np.random.default_rng(0).standard_normal((2, 5, 4))
    raw_i[1:, 2] = 0
    assert (scale_by(raw_0, raw_i, "reference")[:, 2] == 0).all()
    assert np.isfinite(scale_by(raw_0, raw_i, "shape")).all()


def path_laplacian(n):
    """Return stiffness and mass of a path of n vertices and length 1 with free ends."""
    stiffness = sp.diags_array(
        [-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1]
    ).tolil()
    stiffness[0, 0] = stiffness[n - 1, n - 1] = 1
    mass = np.full(n, 1 / (n - 1))
    mass[[0, -1]] /= 2
    return sp.csc_array(stiffness * (n - 1)), mass


def test_eigenbasis_of_a_path_is_the_cosines():
    n = 400
    stiffness, mass = path_laplacian(n)
    evals, evecs = laplacian_eigenbasis(stiffness, mass, 6)
    np.testing.assert_allclose(evals[1:], (np.arange(1, 6) * np.pi) ** 2, rtol=1e-3)
    np.testing.assert_allclose(evecs.T @ (mass[:, None] * evecs), np.eye(6), atol=1e-9)
    cosines = np.sqrt(2) * np.cos(np.outer(np.linspace(0, 1, n), np.arange(1, 6) * np.pi))
    np.testing.assert_allclose(
        np.abs(evecs[:, 1:].T @ (mass[:, None] * cosines)), np.eye(5), atol=1e-4
    )
    assert evals[0] == 0
    assert np.ptp(evecs[:, 0]) == 0


def test_eigenbasis_is_the_same_on_every_run():
    first, second = (laplacian_eigenbasis(*path_laplacian(100), 8) for _ in range(2))
    np.testing.assert_array_equal(first[1], second[1])


def test_signatures_against_their_sums():
    evals, evecs = np.array([0.0, 2, 5]), np.random.default_rng(0).standard_normal((4, 3))
    times, energies, sigma = np.array([0.1, 1.0]), np.log([3.0, 1e6]), 0.4
    hks = heat_kernel_signature(evals, evecs, times)
    wks = wave_kernel_signature(evals, evecs, energies, sigma)
    for v in range(4):
        for j in range(2):
            assert hks[v, j] == pytest.approx(
                sum(np.exp(-times[j] * evals[l]) * evecs[v, l] ** 2 for l in (1, 2))
            )
        weights = [
            np.exp(-((energies[0] - np.log(evals[l])) ** 2) / (2 * sigma**2)) for l in (1, 2)
        ]
        assert wks[v, 0] == pytest.approx(np.average(evecs[v, 1:] ** 2, weights=weights))
    # Far above the spectrum the last eigenfunction decides, instead of 0 / 0.
    np.testing.assert_allclose(wks[:, 1], evecs[:, 2] ** 2)


def test_diffusion_is_a_semigroup_and_projection_inverts_reconstruction():
    stiffness, mass = path_laplacian(60)
    evals, evecs = laplacian_eigenbasis(stiffness, mass, 6)
    coefficients = np.random.default_rng(0).standard_normal(6)
    once = diffuse(coefficients, evals, np.array([0.3]))[:, 0]
    twice = diffuse(diffuse(coefficients, evals, np.array([0.1]))[:, 0], evals, np.array([0.2]))[
        :, 0
    ]
    np.testing.assert_allclose(once, twice)
    np.testing.assert_allclose(project(evecs @ coefficients, evecs, mass), coefficients, atol=1e-12)
    np.testing.assert_allclose(project(evecs, evecs, mass), np.eye(6), atol=1e-9)


def test_map_from_pairs_is_the_projection_for_a_full_correspondence():
    stiffness, mass = path_laplacian(80)
    _, evecs = laplacian_eigenbasis(stiffness, mass, 7)
    truth = map_from_pairs(evecs, evecs[::-1], mass, np.ones((7, 7)))
    np.testing.assert_allclose(truth.C, evecs.T @ (mass[:, None] * evecs[::-1]), atol=1e-9)
    assert truth.n_observed == 7


def test_map_from_pairs_tells_what_half_a_correspondence_determines():
    stiffness, mass = path_laplacian(80)
    evals, evecs = laplacian_eigenbasis(stiffness, mass, 12)
    half = slice(0, 40)
    truth = map_from_pairs(evecs[half], evecs[half], mass[half], laplacian_mask(evals, evals))
    assert 4 < truth.n_observed < 12
    assert np.isfinite(truth.C).all()
    # On the half that was seen, the map carries functions as it should.
    assert np.abs(evecs[half] @ truth.C - evecs[half])[:, :6].max() < 0.2


def test_embedding_of_the_true_map_puts_points_on_their_images():
    stiffness, mass = path_laplacian(50)
    _, evecs = laplacian_eigenbasis(stiffness, mass, 10)
    permutation = np.random.default_rng(0).permutation(50)
    C = map_from_pairs(
        evecs[permutation], evecs[permutation], mass[permutation], np.ones((10, 10))
    ).C
    Y, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((10, 10)))
    points_i, points_0 = spectral_embeddings(evecs[permutation], evecs, C, Y)
    np.testing.assert_allclose(points_i, points_0[permutation], atol=1e-8)


def test_the_resolvent_mask_vanishes_on_equal_spectra_and_stays_bounded():
    evals = np.array([0.0, 3.0, 10.0, 40.0])
    mask = resolvent_mask(evals, evals)
    np.testing.assert_allclose(np.diag(mask), 0, atol=1e-15)
    assert resolvent_mask(100 * evals, evals).max() <= np.sqrt(2)
    # The distance of the resolvents 1 / (sqrt(lambda) - i) of the commutator, for one pair.
    a, b = np.sqrt(3 / 40), np.sqrt(10 / 40)
    np.testing.assert_allclose(mask[1, 2], abs(1 / (a - 1j) - 1 / (b - 1j)))


def test_the_learned_mask_is_larger_where_known_maps_are_smaller():
    maps = np.tile(np.eye(12), (4, 1, 1))
    mask = learned_mask(maps)(np.arange(12.0), np.arange(12.0))
    assert np.diag(mask).max() < np.abs(mask[0, 5:]).min()
    share = np.array([1.0, 0, 0, 0])
    np.testing.assert_allclose(
        learned_mask(np.random.default_rng(0).standard_normal((4, 12, 12)), share).mask,
        learned_mask(np.random.default_rng(0).standard_normal((4, 12, 12))[:1]).mask,
    )


def test_the_learned_mask_is_its_closed_form():
    """Against a Gaussian of standard deviation 1 written out, whose border entries repeat."""
    k, share = 9, np.array([1.0, 2.0, 0.5])
    maps = 0.1 * np.random.default_rng(1).standard_normal((3, k, k))
    offsets = np.arange(-4, 5)
    bell = np.exp(-(offsets**2) / 2)
    average = np.zeros((k, k))
    for row in range(k):
        np.add.at(average[row], np.clip(row + offsets, 0, k - 1), bell / bell.sum())
    variance = average @ np.average(maps**2, axis=0, weights=share) @ average.T
    expected = 1e-3 / (variance + 1e-4)
    np.testing.assert_allclose(learned_mask(maps, share).mask ** 2, expected, rtol=1e-12)
    np.testing.assert_allclose(learned_mask(np.zeros((1, k, k))).mask ** 2, 10, rtol=1e-12)


@pytest.mark.parametrize("regularizer", ["resolvent", "learned"])
def test_learning_goes_by_the_named_regularizer(regularizer):
    rng = np.random.default_rng(6)
    probes_0, evals = rng.standard_normal((6, 16)), np.arange(6.0)
    noisy = probes_0 + 0.3 * rng.standard_normal((5, 6, 16))
    maps = np.tile(np.eye(6), (5, 1, 1))
    arguments = (probes_0, noisy, evals, np.tile(evals, (5, 1)), maps)
    named = learn_functional_maps(*arguments, regularizer=regularizer)
    mask = resolvent_mask if regularizer == "resolvent" else learned_mask(maps)
    given = learn_functional_maps(*arguments, regularizer=mask)
    np.testing.assert_array_equal(named.maps, given.maps)
    assert not np.allclose(named.maps, learn_functional_maps(*arguments).maps)


def test_the_prior_on_few_pairs_is_the_one_that_predicts_pairs_left_out():
    """Against a search that leaves each pair out in turn."""
    rng = np.random.default_rng(8)
    evals = np.arange(8.0)
    mask = laplacian_mask(evals, evals)
    evecs_i = rng.standard_normal((20, 8))
    evecs_0 = evecs_i + 0.5 * rng.standard_normal((20, 8))
    areas = np.full(20, 1 / 20)
    chosen = map_from_pairs(evecs_i, evecs_0, areas, mask).C

    def fitted(rows, strength):
        gram = (areas[rows, None] * evecs_i[rows]).T @ evecs_i[rows]
        rhs = (areas[rows, None] * evecs_i[rows]).T @ evecs_0[rows]
        penalty = strength * (mask**2 + 1e-6)
        return np.stack(
            [np.linalg.solve(gram + np.diag(p), r) for p, r in zip(penalty.T, rhs.T, strict=True)],
            axis=1,
        )

    def left_out(strength):
        errors = [evecs_i[q] @ fitted(np.arange(20) != q, strength) - evecs_0[q] for q in range(20)]
        return np.square(errors).sum()

    strengths = (0.0, *np.geomspace(1e-4, 1.0, 9))
    best = min(strengths, key=left_out)
    assert best > 0
    np.testing.assert_allclose(chosen, fitted(np.arange(20), best), atol=1e-9)


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_random_pairs_among_right_ones_are_told(share):
    rng = np.random.default_rng(9)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 600))
    evecs = np.column_stack(
        [np.ones(600), *(f(n * angle) for n in range(1, 11) for f in (np.cos, np.sin))]
    )
    bent = angle + 0.2 * np.sin(angle)
    images = np.column_stack(
        [np.ones(600), *(f(n * bent) for n in range(1, 11) for f in (np.cos, np.sin))]
    )
    wrong = rng.random(600) < share
    mixed = np.where(wrong[:, None], images[rng.integers(0, 600, 600)], images)
    found = wrong_pairs(evecs, mixed, np.ones(600))
    assert found[wrong].mean() > 0.8
    assert found[~wrong].mean() < 0.02
    assert not wrong_pairs(evecs[:40], mixed[:40], np.ones(40)).any()  # too few to tell


def test_nothing_is_wrong_with_a_renumbering():
    evecs = np.random.default_rng(10).standard_normal((300, 12))
    assert not wrong_pairs(evecs, evecs, np.ones(300)).any()


@pytest.fixture
def arrays():
    rng = np.random.default_rng(0)
    evals = np.linspace(0, 10, 6)
    return {
        "probes_0": rng.normal(size=(6, 4)),
        "probes": rng.normal(size=(2, 6, 4)),
        "evals_0": evals,
        "evals": np.stack([evals + 0.1, evals + 0.2]),
        "maps": np.stack([np.eye(6)] * 2),
    }


def test_coefficients_that_overflow_are_named(arrays):
    arrays["probes"] = arrays["probes"] * 1e200
    arrays["probes"][0, 1, 1] = np.inf
    with (
        np.errstate(all="ignore"),
        pytest.raises(
            (ValueError, np.linalg.LinAlgError),
            match=r"extreme coefficients|NaN or infinite|finite",
        ),
    ):
        learn_functional_maps(**arrays)
