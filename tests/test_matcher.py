"""Equation (2) for one shape, and the points that its map matches."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

import skfmap.learner.matcher
from skfmap import Mesh
from skfmap.functional import penalty_of, scale_by, solve_functional_map
from skfmap.functional.residuals import trusted_functions
from skfmap.learner.matcher import embedding_distance
from skfmap.learner.mirrored import odd_probes


def test_equation_2_is_solved_once_per_shape(fitted, probed, monkeypatch):
    """Map, residual, mirrored residual and points come from one factorisation."""
    solved, original = [], skfmap.learner.matcher.MapEquation
    monkeypatch.setattr(
        skfmap.learner.matcher, "MapEquation", lambda *how: solved.append(1) or original(*how)
    )
    fitted.match(probed[4:])
    assert len(solved) == 2
    fitted.predict(probed[4:])
    assert len(solved) == 4


def test_the_mirrored_residual_is_that_of_the_mirrored_probes(fitted, probed):
    shape = probed[5]
    odd = np.array([category == "oriented" for category in shape.probe_categories])
    mirrored = replace(shape, probes=np.where(odd, -shape.probes, shape.probes))
    there, back = (fitted.matcher_.solve(one, mirrored=True) for one in (shape, mirrored))
    assert there.mirrored_residual == pytest.approx(back.residual, rel=1e-12)
    assert there.residual == pytest.approx(back.mirrored_residual, rel=1e-12)


def _equation(matcher, shape):
    """Return scaled probes of the reference and of a shape, and the penalty, from the settings."""
    alpha, normalize, regularizer, *_ = matcher.settings
    k, reference = len(matcher.stable_basis), matcher.reference
    penalty = penalty_of(shape.spectral.evals[:k], reference.spectral.evals[:k], alpha, regularizer)
    scaled = [scale_by(one.probes[:k], one.probes[:k], normalize) for one in (reference, shape)]
    return (*scaled, penalty)


@pytest.mark.parametrize("weighting", [None, "function"])
def test_the_map_is_the_one_that_minimises_equation_2(make_learner, probed, collection, weighting):
    learner = make_learner(weighting=weighting, confidence=None)
    matcher = learner.fit(probed[:4], collection.truths[:4]).matcher_
    probes_0, probes_i, penalty = _equation(matcher, probed[5])
    C, residual, mirrored = matcher.solve(probed[5])[:3]
    assert np.isnan(mirrored), "it was not asked for"
    expected = solve_functional_map(probes_0, probes_i, penalty, matcher.weights)
    np.testing.assert_allclose(C, expected, atol=1e-12)

    def objective(C):
        misses = np.square((C @ probes_0 - probes_i) * matcher.weights).sum()
        return misses + (penalty * np.square(C))[1:, 1:].sum()

    assert residual == pytest.approx(objective(C), rel=1e-12)
    rng = np.random.default_rng(0)
    for step in (1e-3, 1e-2, 0.1):
        other = C.copy()
        other[1:, 1:] += step * rng.standard_normal(other[1:, 1:].shape)
        assert objective(other) > residual


def test_the_reference_is_mapped_to_itself(fitted):
    matcher = fitted.matcher_
    C, k = matcher.solve(matcher.reference).C, len(matcher.stable_basis)
    np.testing.assert_allclose(C, np.eye(k), atol=0.02)
    match, after = matcher.match_points(matcher.reference, np.eye(k))
    np.testing.assert_array_equal(match.p2p, np.arange(len(match.p2p)))
    assert after is match, "without a refinement"
    assert match.refined_map is None
    assert embedding_distance(matcher.reference, match) == 0


def test_a_match_is_the_nearest_point_among_the_functions(fitted, probed):
    matcher, shape = fitted.matcher_, probed[5]
    C, k = matcher.solve(shape).C, len(matcher.stable_basis)
    (match, _) = matcher.match_points(shape, C)
    points_i = shape.spectral.evecs[:, :k] @ C @ matcher.functions
    points_0 = matcher.reference.spectral.evecs[:, :k] @ matcher.functions
    distances, nearest = cKDTree(points_0).query(points_i)
    assert (match.p2p == nearest).mean() > 0.99, "but for ties"
    by_area = np.average(distances, weights=shape.spectral.mass)
    assert embedding_distance(shape, match) == pytest.approx(by_area, rel=1e-6)


def test_the_functions_are_the_first_of_y_or_those_of_trust(make_learner, probed, collection):
    learner = make_learner(matching="cut", n_stable=3, confidence=None)
    matcher = learner.fit(probed[:3], collection.truths[:3]).matcher_
    np.testing.assert_array_equal(matcher.functions, matcher.stable_basis[:, :3])
    soft = replace(matcher, settings=matcher.settings._replace(matching="soft")).functions
    np.testing.assert_array_equal(soft, trusted_functions(matcher.residual_covariance))


def test_a_part_refines_what_was_matched(make_learner, probed, collection):
    learner = make_learner(refine="zoomout", confidence=None)
    matcher = learner.fit(probed[:3], collection.truths[:3]).matcher_
    before, after = matcher.match_points(probed[5], matcher.solve(probed[5]).C)
    assert before.refined_map is None
    assert len(after.refined_map) > len(matcher.stable_basis)


def test_odd_probes_are_those_that_change_sign_in_the_mirror(fitted, probe, probed, collection):
    odd = odd_probes(probed[5])
    assert [probed[5].probe_categories[j] for j in np.flatnonzero(odd)] == ["oriented"] * odd.sum()
    mesh = collection.meshes[5]
    image = Mesh(mesh.vertices * [1, 1, -1], mesh.faces[:, ::-1], name="image")
    (mirrored,) = probe([image])
    signs = np.sign(
        (mirrored.spectral.evecs * probed[5].spectral.mass[:, None]).T @ probed[5].spectral.evecs
    )
    turned = np.diag(signs)[:12, None] * mirrored.probes[:12]
    scale = np.abs(probed[5].probes[:12]).max(axis=0)
    np.testing.assert_allclose(
        turned[:, ~odd] / scale[~odd], probed[5].probes[:12, ~odd] / scale[~odd], atol=1e-5
    )
    np.testing.assert_allclose(
        turned[:, odd] / scale[odd], -probed[5].probes[:12, odd] / scale[odd], atol=1e-5
    )
    even = replace(fitted.reference_, probe_categories=("hks",) * len(odd))
    blind = replace(fitted.matcher_, reference=even)
    assert np.isnan(blind.solve(probed[5], mirrored=True).mirrored_residual)
