"""Three ways to solve the row systems of equation (2), and the search that they serve."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skfmap.functional import (
    LearningProblem,
    PenaltyQuadratic,
    QuadraticSystems,
    RowSystems,
    SharedRowSystems,
    learned_mask,
    optimize_weights,
    penalty_of,
    penalty_quadratic,
    scale_by,
    weight_groups,
)
from skfmap.functional.weighting import coarse_groups

QUADRATIC = ["laplacian", "resolvent"]


def spectra(rng, n, k):
    """Return eigenvalues of a reference and of shapes that are like it."""
    evals_0 = np.cumsum(rng.random(k) + 0.1) * 10
    evals_0 -= evals_0[0]
    return evals_0, evals_0 * (1 + 0.05 * rng.standard_normal((n, 1)))


def make_problem(rng, n=30, k=30, m=20, regularizer="laplacian", **more):
    """Return a problem that is large enough for one decomposition to serve all shapes."""
    evals_0, evals = spectra(rng, n, k)
    probes_0 = rng.standard_normal((k, m))
    probes = probes_0 + 0.3 * rng.standard_normal((n, k, m))
    maps = np.eye(k) + 0.1 * rng.standard_normal((n, k, k))
    maps[:, :, 0] = np.eye(k)[0]
    mask = learned_mask(maps) if regularizer == "learned" else regularizer
    return LearningProblem(
        scale_by(probes_0, probes_0, "shape"),
        np.stack([scale_by(probes_0, g, "shape") for g in probes]),
        np.stack([penalty_of(e, evals_0, 0.01, mask) for e in evals]),
        maps,
        rng.random(n) + 0.5,
        penalty_quadratic(evals, evals_0, 0.01, mask),
        **more,
    )


def row_by_row(problem):
    """Return the problem with regularisers that share nothing, so that each row is factorised."""
    penalties = problem.penalties.copy()
    penalties[0] *= 1 + 1e-14
    return replace(problem, penalties=penalties, quadratic=None)


@pytest.mark.parametrize("regularizer", QUADRATIC)
def test_penalties_are_values_of_the_quadratic(regularizer):
    evals_0, evals = spectra(np.random.default_rng(0), 3, 12)
    t, a, b, c, growth = penalty_quadratic(evals, evals_0, 0.2, regularizer)
    t = t[:, :, None]
    expected = np.stack([penalty_of(e, evals_0, 0.2, regularizer) for e in evals])
    np.testing.assert_allclose(
        (a * t**2 - 2 * b * t + c) / (1 + growth * t**2), expected, atol=1e-14
    )


def test_other_regularisers_have_no_quadratic():
    evals_0, evals = spectra(np.random.default_rng(0), 3, 12)
    assert (
        penalty_quadratic(evals, evals_0, 0.2, lambda evals_i, evals_0: np.ones((12, 12))) is None
    )


@given(st.integers(2, 40), st.integers(1, 50), st.sampled_from(QUADRATIC), st.integers(0, 2**31))
@settings(max_examples=40)
def test_one_decomposition_solves_the_systems_that_factorisations_solve(k, m, regularizer, seed):
    rng = np.random.default_rng(seed)
    evals_0, evals = spectra(rng, 3, k)
    weighted = scale_by(*[rng.standard_normal((k, m))] * 2, "shape") * np.exp(rng.uniform(-3, 3, m))
    gram = weighted @ weighted.T
    quadratic = penalty_quadratic(evals, evals_0, 0.01, regularizer)
    t = quadratic.t.ravel()
    penalty = np.concatenate([penalty_of(e, evals_0, 0.01, regularizer) for e in evals])
    truth = rng.standard_normal((3 * k, k))
    rhs = truth @ gram + penalty * truth
    x = QuadraticSystems(gram, quadratic).solve(rhs, penalty, t, 1 + quadratic.growth * t**2)
    # Backward error: what is left of each row, against the size of its system.
    size = (np.abs(gram).sum() + penalty.max()) * np.abs(x).max(axis=1) + np.abs(rhs).max(axis=1)
    left = np.abs(x @ gram + penalty * x - rhs).max(axis=1)
    assert (left <= 1e-12 * size).all()
    by_row = RowSystems(gram, penalty).solve(rhs)
    condition = np.abs(gram).sum() / penalty.min()
    np.testing.assert_allclose(x, by_row, atol=1e-13 * max(condition, 1) * np.abs(by_row).max())


def test_rows_that_are_off_the_quadratic_are_solved_all_the_same():
    rng = np.random.default_rng(1)
    evals_0, evals = spectra(rng, 1, 15)
    quadratic = penalty_quadratic(evals, evals_0, 0.01, "laplacian")
    gram = np.cov(rng.standard_normal((15, 40)))
    penalty = penalty_of(evals[0], evals_0, 0.01, "laplacian") + 10 * rng.random((15, 15))
    rhs = rng.standard_normal((15, 15))
    x = QuadraticSystems(gram, quadratic).solve(rhs, penalty, quadratic.t[0], np.ones(15))
    np.testing.assert_allclose(x @ gram + penalty * x, rhs, atol=1e-11)


def test_systems_that_are_not_definite_are_refused():
    quadratic = PenaltyQuadratic(
        np.zeros((1, 3)), np.ones(3), np.arange(3.0), np.arange(3.0) ** 2, 0.0
    )
    with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
        QuadraticSystems(-np.eye(3), quadratic)
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        QuadraticSystems(np.full((3, 3), np.nan), quadratic)


def test_shared_penalties_need_one_factor_for_each_row():
    rng = np.random.default_rng(2)
    gram, penalty = np.cov(rng.standard_normal((9, 30))), rng.random((9, 9)) + 0.1
    rhs = rng.standard_normal((4, 9, 9))
    shared = SharedRowSystems(gram, penalty).solve(rhs)
    for one, b in zip(shared, rhs, strict=True):
        np.testing.assert_allclose(one, RowSystems(gram, penalty).solve(b), atol=1e-12)


@pytest.fixture
def decomposed(monkeypatch):
    """Return a list that grows with each use of one decomposition for all shapes."""
    uses, solve = [], QuadraticSystems.solve

    def counted(self, *arguments):
        uses.append(len(arguments[0]))
        return solve(self, *arguments)

    monkeypatch.setattr(QuadraticSystems, "solve", counted)
    return uses


@pytest.mark.parametrize("regularizer", [*QUADRATIC, "learned"])
def test_loss_and_gradient_do_not_depend_on_how_rows_are_solved(regularizer, decomposed):
    rng = np.random.default_rng(3)
    problem = make_problem(rng, regularizer=regularizer)
    weights = np.exp(rng.standard_normal(20))
    other_loss, other_gradient = row_by_row(problem).loss_gradient(weights, 0.1)
    assert not decomposed
    loss, gradient = problem.loss_gradient(weights, 0.1)
    assert bool(decomposed) == (regularizer in QUADRATIC)
    assert loss == pytest.approx(other_loss, rel=1e-9)
    np.testing.assert_allclose(gradient, other_gradient, atol=1e-8 * np.abs(other_gradient).max())
    np.testing.assert_allclose(
        problem.solve(weights), row_by_row(problem).solve(weights), atol=1e-8
    )


@pytest.mark.parametrize("regularizer", QUADRATIC)
@pytest.mark.parametrize("route", ["decomposition", "rows"])
def test_the_gradient_of_each_route_is_the_slope_of_the_loss(route, regularizer, decomposed):
    rng = np.random.default_rng(10)
    problem = make_problem(rng, regularizer=regularizer)
    if route == "rows":
        problem = row_by_row(problem)
    log_squares, direction = rng.standard_normal((2, 20))

    def loss(step):
        return problem.loss(np.exp((log_squares + step * direction) / 2), 0.1)

    _, gradient = problem.loss_gradient(np.exp(log_squares / 2), 0.1)
    # The central difference of fourth order.
    numeric = (8 * (loss(1e-3) - loss(-1e-3)) - (loss(2e-3) - loss(-2e-3))) / 12e-3
    assert (gradient * np.exp(log_squares)) @ direction == pytest.approx(numeric, rel=1e-7)
    assert bool(decomposed) == (route == "decomposition")


def test_few_shapes_are_solved_row_by_row(decomposed):
    make_problem(np.random.default_rng(11), n=3, k=10).loss_gradient(np.ones(20), 0.1)
    assert not decomposed


def test_threads_change_nothing_to_the_last_bit():
    problem = make_problem(np.random.default_rng(4), n=130)
    weights = np.exp(np.random.default_rng(5).standard_normal(20))
    loss, gradient = problem.loss_gradient(weights, 0.1)
    for n_threads in (2, 3):
        threaded = replace(problem, n_threads=n_threads)
        assert threaded.loss_gradient(weights, 0.1)[0] == loss
        np.testing.assert_array_equal(threaded.loss_gradient(weights, 0.1)[1], gradient)
        np.testing.assert_array_equal(threaded.solve(weights), problem.solve(weights))


def test_shapes_in_two_chunks_add_up():
    rng = np.random.default_rng(6)
    problem = make_problem(rng, n=40)
    weights = np.exp(rng.standard_normal(20))
    halves = [
        replace(
            problem,
            probes=problem.probes[half],
            penalties=problem.penalties[half],
            maps=problem.maps[half],
            sample_weight=problem.sample_weight[half],
            quadratic=problem.quadratic._replace(t=problem.quadratic.t[half]),
        ).loss_gradient(weights, 0.1)
        for half in (slice(0, 20), slice(20, 40))
    ]
    loss, gradient = problem.loss_gradient(weights, 0.1)
    assert loss == pytest.approx(sum(one[0] for one in halves), rel=1e-10)
    np.testing.assert_allclose(
        gradient, sum(one[1] for one in halves), atol=1e-9 * np.abs(gradient).max()
    )


def test_coarse_groups_hold_whole_groups():
    categories = ["a", "a", "b", "b"]
    assert coarse_groups(np.arange(4), categories).tolist() == [0, 0, 1, 1]
    assert coarse_groups(np.array([0, 0, 1, 1]), categories) is None  # no fewer
    assert coarse_groups(np.array([0, 1, 1, 2]), categories) is None  # group 1 is in both
    assert coarse_groups(np.zeros(4, dtype=int), categories) is None


def test_weights_that_begin_coarse_end_converged_in_every_weight():
    rng = np.random.default_rng(7)
    problem = make_problem(rng, n=4, k=10)
    labels = ["a"] * 10 + ["b"] * 10
    groups = weight_groups("function", labels)
    told = []
    optimum = optimize_weights(
        problem,
        groups,
        0.1,
        coarse=coarse_groups(groups, labels),
        max_iter=500,
        tol=1e-5,
        callback=lambda iteration, loss, weights: told.append(
            (iteration, loss, len(np.unique(weights)))
        ),
    )
    assert optimum.converged
    assert optimum.gradient_norm <= 1e-5
    assert [iteration for iteration, *_ in told] == list(range(1, optimum.n_iter + 1))
    assert [loss for _, loss, _ in told] == optimum.loss_curve[1:]
    assert (np.diff(optimum.loss_curve) <= 1e-9).all()
    assert told[0][2] <= 2  # one weight for each category
    assert told[-1][2] > 2  # one for each probe; some meet the bounds


def test_a_search_from_its_own_end_ends_at_once():
    problem = make_problem(np.random.default_rng(7), n=4, k=10)
    labels = ["a"] * 10 + ["b"] * 10
    groups = weight_groups("function", labels)
    given = {"coarse": coarse_groups(groups, labels), "max_iter": 500, "tol": 1e-4}
    first = optimize_weights(problem, groups, 0.1, **given)
    again = optimize_weights(problem, groups, 0.1, start=first.weights, **given)
    assert first.n_evaluations > 5
    assert again.n_evaluations == 1
    np.testing.assert_allclose(again.weights, first.weights, rtol=1e-12)
    onward = optimize_weights(problem, groups, 0.1, start=first.weights, **{**given, "tol": 1e-6})
    assert onward.loss_curve[0] == pytest.approx(first.loss_curve[-1])
    assert onward.loss_curve[-1] < first.loss_curve[-1]


@pytest.mark.parametrize("most", [1, 3])
def test_iterations_over_categories_count(most):
    problem = make_problem(np.random.default_rng(8), n=4, k=10)
    labels = ["a"] * 10 + ["b"] * 10
    groups = weight_groups("function", labels)
    optimum = optimize_weights(
        problem, groups, 0.1, coarse=coarse_groups(groups, labels), max_iter=most, tol=1e-12
    )
    assert optimum.n_iter == most
    assert not optimum.converged
    assert np.isfinite(optimum.gradient_norm)


def test_a_row_system_that_is_not_definite_says_what_to_raise():
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite; raise alpha"):
        RowSystems(np.zeros((3, 3)), np.zeros((1, 3)))
