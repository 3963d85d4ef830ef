"""Errors of matches: closed forms, brute force, and the order that the three kinds must have."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.pipeline import make_pipeline

from skfmap import Correspondence, DescriptorTransformer, Mesh, SpectralBasis
from skfmap.datasets import make_sphere
from skfmap.exceptions import CorrespondenceError, MeshError
from skfmap.geometry.geodesics import DISTANCES
from skfmap.metrics import (
    ERROR_KINDS,
    GeodesicDistances,
    basis_error,
    continuity,
    coverage,
    error_curve,
    geodesic_error,
    get_scorer,
    get_scorer_names,
    pair_errors,
    reference_distances,
    singular_value_profile,
)

quick = settings(max_examples=30)
SQRT_AREA = np.sqrt(4 * np.pi)


@pytest.fixture(scope="module")
def sphere():
    return make_sphere(3)


@pytest.fixture(scope="module")
def distances(sphere):
    return GeodesicDistances(sphere)


@pytest.fixture(scope="module")
def truth(sphere):
    """Return the identity as correspondence, with the mirror image in x = 0 as symmetric answer."""
    n = sphere.n_vertices
    mirrored = np.linalg.norm(
        sphere.vertices[:, None] - sphere.vertices * [-1, 1, 1], axis=2
    ).argmin(axis=1)
    return Correspondence.from_template(np.arange(n), mirrored)


def pairs_of(sphere, n=300):
    rng = np.random.default_rng(0)
    return rng.integers(0, sphere.n_vertices, n), rng.choice(
        rng.integers(0, sphere.n_vertices, 12), n
    )


def arcs(sphere, points, sources):
    cosines = (sphere.vertices[points] * sphere.vertices[sources]).sum(axis=1)
    return np.arccos(np.clip(cosines, -1, 1)) / SQRT_AREA


# Distances


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_exact_distances_are_arcs_in_units_of_the_root_of_the_area(sphere, scale):
    mesh = Mesh(scale * sphere.vertices, sphere.faces)
    points, sources = pairs_of(sphere)
    measured = GeodesicDistances(mesh, "exact").between(points, sources)
    np.testing.assert_allclose(measured, arcs(sphere, points, sources), rtol=0.03, atol=1e-6)


def test_heat_distances_are_near_exact_ones_and_dijkstras_too_long(collection):
    mesh = collection.meshes[0]
    points, sources = pairs_of(mesh)
    exact, heat, dijkstra = (
        GeodesicDistances(mesh, method).between(points, sources)
        for method in ("exact", "heat", "dijkstra")
    )
    assert np.abs(heat - exact).mean() < 0.03 * exact.mean()
    assert (dijkstra >= exact - 1e-6).all()
    assert 1.02 < dijkstra.mean() / exact.mean() < 1.2


def test_rows_do_not_depend_on_what_was_asked_before(sphere):
    one, other = GeodesicDistances(sphere), GeodesicDistances(sphere)
    one.rows(np.array([3, 200, 7]))
    one.rows(np.array([9]))
    np.testing.assert_array_equal(one.rows(np.array([7, 9, 1])), other.rows(np.array([7, 9, 1])))


def test_rows_are_computed_once(sphere, monkeypatch):
    asked, original = [], DISTANCES["heat"]

    def heat(vertices, faces, sources):
        asked.extend(sources.tolist())
        return original(vertices, faces, sources)

    monkeypatch.setitem(DISTANCES, "heat", heat)
    distances = GeodesicDistances(sphere)
    distances.between([1, 2, 3], [5, 5, 6])
    distances.between([7, 2], [6, 8])
    assert sorted(asked) == [5, 6, 8]


def test_cached_distances_are_the_same(sphere, tmp_path):
    sources = np.array([3, 200, 7])
    plain = GeodesicDistances(sphere).rows(sources)
    for _ in range(2):
        np.testing.assert_array_equal(
            GeodesicDistances(sphere, memory=str(tmp_path)).rows(sources), plain
        )


def test_distances_are_shared_by_content_and_method(sphere):
    renamed = Mesh(sphere.vertices, sphere.faces, name="renamed")
    assert reference_distances(sphere) is reference_distances(renamed)
    assert reference_distances(sphere) is not reference_distances(sphere, "dijkstra")
    other = Mesh(sphere.vertices * [1, 1, 2], sphere.faces, name=sphere.name)
    assert reference_distances(sphere) is not reference_distances(other)


def test_unknown_methods_are_refused(sphere):
    with pytest.raises(ValueError, match=r"method.*dijkstra"):
        GeodesicDistances(sphere, "fast")


# Errors


def test_the_truth_has_no_error(sphere, truth, distances):
    identity = np.arange(sphere.n_vertices)
    assert [
        geodesic_error(identity, truth, truth, distances, kind=kind) for kind in ERROR_KINDS
    ] == [0, 0, 0]


def test_the_symmetric_answer_is_forgiven_by_two_kinds(sphere, truth, distances):
    mirrored = truth.symmetric_pairs[np.argsort(truth.symmetric_pairs[:, 1]), 0]
    direct, consistent, per_vertex = (
        geodesic_error(mirrored, truth, truth, distances, kind=k) for k in ERROR_KINDS
    )
    assert direct == pytest.approx(
        arcs(sphere, mirrored, np.arange(sphere.n_vertices)).mean(), rel=0.05
    )
    assert consistent == per_vertex == 0


def test_half_a_symmetric_answer_is_forgiven_per_vertex_only(sphere, truth, distances):
    mirrored = truth.symmetric_pairs[np.argsort(truth.symmetric_pairs[:, 1]), 0]
    folded = np.where(sphere.vertices[:, 1] > 0, mirrored, np.arange(sphere.n_vertices))
    errors = pair_errors(folded, truth, truth, distances)
    assert errors.mean("per_vertex") == 0
    assert errors.mean("consistent") > 0.05


@quick
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_kinds_are_ordered(sphere, truth, distances, seed, partial):
    rng = np.random.default_rng(seed)
    p2p = rng.integers(0, sphere.n_vertices, sphere.n_vertices)
    reference = truth
    if partial:  # the symmetric answer is known at some points only
        reference = Correspondence(
            truth.pairs, truth.symmetric_pairs[rng.random(len(truth.pairs)) < 0.3]
        )
    own = Correspondence(truth.pairs[rng.random(len(truth.pairs)) < 0.5], weights=None)
    errors = pair_errors(p2p, own, reference, distances)
    assert errors.mean("per_vertex") <= errors.mean("consistent") + 1e-12
    assert errors.mean("consistent") <= errors.mean("direct") + 1e-12
    assert all(np.isfinite(errors.of_kind(kind)).all() for kind in ERROR_KINDS)


def test_errors_are_distances_from_the_true_vertex(sphere, distances):
    p2p = np.arange(sphere.n_vertices)[::-1]
    own, other = Correspondence([[4, 0], [9, 1]]), Correspondence([[30, 1], [50, 0], [70, 2]])
    errors = pair_errors(p2p, own, other, distances)
    assert errors.vertices.tolist() == [4, 9]
    expected = distances.between(p2p[[4, 9]], [50, 30])
    np.testing.assert_allclose(errors.direct, expected, rtol=1e-6)
    assert errors.mean() == pytest.approx(expected.mean())


def test_several_vertices_on_one_point_share_its_weight(sphere, distances):
    """A point that stands on two vertices of S_0 is one pair, and its error is the mean of both."""
    p2p = np.full(sphere.n_vertices, 7)
    own, other = Correspondence([[0, 5], [1, 6]]), Correspondence([[10, 5], [20, 5], [30, 6]])
    d10, d20, d30 = distances.between([7, 7, 7], [10, 20, 30])
    errors = pair_errors(p2p, own, other, distances)
    np.testing.assert_allclose(errors.direct, [(d10 + d20) / 2, d30], rtol=1e-6)


def test_weights_of_soft_correspondences_count(sphere, distances):
    p2p = np.full(sphere.n_vertices, 7)
    own = Correspondence([[0, 5], [1, 6]], weights=[3.0, 1.0])
    other = Correspondence([[10, 5], [30, 6]])
    d10, d30 = distances.between([7, 7], [10, 30])
    assert geodesic_error(p2p, own, other, distances) == pytest.approx(
        (3 * d10 + d30) / 4, rel=1e-6
    )


def test_missing_symmetric_answers_are_an_error_where_they_are_needed(sphere, truth, distances):
    identity, bare = np.arange(sphere.n_vertices), Correspondence(truth.pairs)
    assert geodesic_error(identity, truth, bare, distances) == 0
    assert (
        geodesic_error(identity, bare, truth, distances, kind="per_vertex") == 0
    )  # that of the reference counts
    for kind in ("consistent", "per_vertex"):
        with pytest.raises(CorrespondenceError, match="symmetric"):
            geodesic_error(identity, truth, bare, distances, kind=kind)
    with pytest.raises(ValueError, match="kind"):
        geodesic_error(identity, truth, truth, distances, kind="symmetric")


def test_nothing_to_score_is_an_error(sphere, truth, distances):
    with pytest.raises(CorrespondenceError, match="no template point"):
        geodesic_error(np.arange(sphere.n_vertices), Correspondence([[0, 9999]]), truth, distances)


# Curves and single figures

_values = st.lists(st.integers(0, 6), min_size=1, max_size=20)


def test_a_mesh_in_the_place_of_its_distances_is_told_apart(sphere, truth):
    p2p = np.arange(sphere.n_vertices)
    with pytest.raises(
        TypeError,
        match=r"Expected a GeodesicDistances; got Mesh\. Create it with GeodesicDistances\(mesh\)",
    ):
        geodesic_error(p2p, truth, truth, sphere)
    with pytest.raises(TypeError, match="Expected a Correspondence; got ndarray"):
        geodesic_error(p2p, truth, truth.pairs, GeodesicDistances(sphere))


@quick
@given(_values, _values, st.booleans(), st.randoms())
def test_error_curve_agrees_with_brute_force(errors, thresholds, weighted, random):
    errors, thresholds = np.array(errors, float), np.array(thresholds, float)
    weights = np.array([random.randint(1, 4) for _ in errors], float) if weighted else None
    share = np.ones(len(errors)) if weights is None else weights
    expected = [share[errors <= threshold].sum() / share.sum() for threshold in thresholds]
    np.testing.assert_allclose(error_curve(errors, thresholds, weights), expected, atol=1e-12)


def test_singular_value_profile_rises_from_0_to_1():
    rng = np.random.default_rng(0)
    X, C = rng.standard_normal((2, 8, 8))
    largest = np.linalg.norm(X - C, 2)
    profile = singular_value_profile(X, C, np.linspace(0, 1.001 * largest, 30))
    assert (np.diff(profile) >= 0).all()
    assert profile[0] == 0
    assert profile[-1] == 1
    assert singular_value_profile(X, C, np.array([0.999 * largest]))[0] == 7 / 8
    assert singular_value_profile(X, X, np.array([0.0]))[0] == 1


def test_basis_errors_sum_to_the_frobenius_norm():
    rng = np.random.default_rng(0)
    X, C = rng.standard_normal((2, 8, 8))
    Y = np.linalg.qr(rng.standard_normal((8, 8)))[0]
    assert (basis_error(X, C, Y) ** 2).sum() == pytest.approx(np.linalg.norm(X - C) ** 2)
    assert basis_error(X, C, Y[:, :3]).shape == (3,)
    assert basis_error(X, C, Y)[2] == pytest.approx(np.linalg.norm((X - C) @ Y[:, 2]))


def test_coverage_is_the_share_of_area_that_is_hit(probed):
    mass = probed[0].spectral.mass
    assert coverage(np.arange(500), mass) == pytest.approx(1)
    assert coverage(np.repeat([4, 8], 100), mass) == pytest.approx(mass[[4, 8]].sum())
    assert coverage(np.arange(500), 3 * mass) == pytest.approx(1)


def test_continuity_of_the_identity_is_1(sphere):
    exact = GeodesicDistances(sphere, "exact")
    identity = np.arange(sphere.n_vertices)
    assert continuity(identity, sphere, exact) == pytest.approx(1, abs=1e-3)
    assert continuity(identity, Mesh(9 * sphere.vertices, sphere.faces), exact) == pytest.approx(
        1, abs=1e-3
    )
    assert continuity(np.zeros_like(identity), sphere, exact) == 0
    shuffled = np.random.default_rng(0).permutation(identity)
    assert continuity(shuffled, sphere, exact) > 3


# Scorers


def test_scorers_agree_with_the_errors(fitted, probed, collection):
    scorer = get_scorer("neg_geodesic_error")
    assert scorer(fitted, probed[4:], collection.truths[4:]) == fitted.score(
        probed[4:], collection.truths[4:]
    )
    weighted = scorer(fitted, probed[4:], collection.truths[4:], sample_weight=[1, 0])
    assert weighted == fitted.score(probed[4:5], collection.truths[4:5])


def test_scorers_are_ordered(make_learner, symmetric_probed, symmetric_collection):
    X, y = symmetric_probed, symmetric_collection.truths
    learner = make_learner(weighting=None).fit(X, y)
    scores = [
        get_scorer(f"neg_{kind}geodesic_error")(learner, X, y)
        for kind in ("", "consistent_", "per_vertex_")
    ]
    assert scores == sorted(scores)
    assert scores[0] == learner.score(X, y)
    assert scores[1] > -0.2
    assert scores[2] < 0


def test_scorers_take_pipelines(make_learner, collection):
    X, y = collection.meshes[:2], collection.truths[:2]
    model = make_pipeline(
        SpectralBasis(20), DescriptorTransformer("paper"), make_learner(weighting=None)
    ).fit(X, y)
    assert get_scorer("neg_geodesic_error")(model, X, y) == model.score(X, y) < 0


def test_scorers_that_need_symmetric_answers_say_so(fitted, probed, collection):
    with pytest.raises(CorrespondenceError, match="symmetric"):
        get_scorer("neg_consistent_geodesic_error")(fitted, probed[4:], collection.truths[4:])


def test_names_of_scorers():
    assert len(get_scorer_names()) == 4
    for name in get_scorer_names():
        assert callable(get_scorer(name))
        assert get_scorer(name) == get_scorer(name)
    with pytest.raises(ValueError, match="neg_geodesic_error"):
        get_scorer("accuracy")


def test_pair_errors_of_the_learner_say_how_they_were_measured(fitted, probed, collection):
    heat, dijkstra = (
        fitted.pair_errors(probed[5:], collection.truths[5:], method=method)[0]
        for method in ("heat", "dijkstra")
    )
    assert len(heat.direct) == len(dijkstra.direct) == 300
    assert dijkstra.mean() == pytest.approx(heat.mean(), rel=0.4)
    assert dijkstra.mean() != heat.mean()
    everything = fitted.pair_errors(
        probed[5:], collection.truths[5:], matching="cut", n_stable=1.0
    )[0]
    assert everything.mean() != heat.mean()


@pytest.mark.parametrize("method", ["heat", "exact", "dijkstra"])
def test_distances_from_what_is_no_vertex_are_refused(method):
    """What lies beneath follows a wrong number out of its memory."""
    ball = make_sphere(n_subdivisions=2)
    distances = GeodesicDistances(ball, method)
    for points, sources in (([0], [-1]), ([0], [66]), ([-1], [0]), ([66], [0])):
        with pytest.raises(ValueError, match=r"refer to vertex (-1|66), but there are 66"):
            distances.between(points, sources)
    with pytest.raises(ValueError, match="one source for each point"):
        distances.between([0, 1], [0])
    with pytest.raises(ValueError, match="1-D array of vertex indices"):
        distances.between([0.5], [0])
    assert len(distances.between([], [])) == 0
    two = Mesh(
        np.concatenate([ball.vertices, ball.vertices + 9]),
        np.concatenate([ball.faces, ball.faces + 66]),
    )
    loose = Mesh(np.concatenate([ball.vertices, [[9.0, 9, 9]]]), ball.faces)
    for mesh in (two, loose, Mesh(np.zeros((3, 3)), [[0, 1, 2]])):
        with pytest.raises(MeshError, match="Distances are not defined"):
            GeodesicDistances(mesh, method).between([1], [0])
