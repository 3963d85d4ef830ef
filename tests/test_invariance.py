"""Rotation, uniform scaling and numbering change nothing; shapes that are hard to match."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from skfmap import (
    Correspondence,
    DescriptorTransformer,
    Mesh,
    SpectralBasis,
    WeightedFunctionalMapLearner,
)
from skfmap.datasets import make_sphere


def transformed(mesh, truth, seed):
    """Return a mesh moved and renumbered, its correspondence, and the new index of each vertex."""
    rng = np.random.default_rng(seed)
    number = rng.permutation(mesh.n_vertices)
    vertices = np.empty_like(mesh.vertices)
    vertices[number] = rng.uniform(0.1, 50) * Rotation.random(random_state=rng).apply(
        np.array(mesh.vertices)
    )
    faces = np.roll(number[mesh.faces], rng.integers(3), axis=1)[rng.permutation(mesh.n_faces)]
    pairs = np.column_stack([number[truth.pairs[:, 0]], truth.pairs[:, 1]])
    return Mesh(vertices + rng.standard_normal(3), faces, mesh.name), Correspondence(pairs), number


def operator(learner, shape):
    """Return Phi_i C Y_p Y_p^T Phi_0^T M_0, from functions on S_0 to functions on S_i."""
    reference, k = learner.reference_.spectral, learner.n_functions
    stable = learner.stable_basis_[:, : learner.n_stable_]
    C = learner.functional_maps([shape])[0]
    return (
        shape.spectral.evecs[:, :k]
        @ C
        @ stable
        @ stable.T
        @ reference.evecs[:, :k].T
        * reference.mass
    )


@pytest.fixture(scope="module")
def moved(collection, probe):
    triples = [
        transformed(m, t, i)
        for i, (m, t) in enumerate(zip(collection.meshes, collection.truths, strict=True))
    ]
    meshes, truths, numbers = zip(*triples, strict=True)
    return probe(list(meshes)), list(truths), numbers


def test_a_moved_shape_has_the_same_operator_and_point_map(fitted, probed, moved):
    after, _, numbers = moved
    before = operator(fitted, probed[5])
    np.testing.assert_allclose(
        operator(fitted, after[5])[numbers[5]], before, atol=1e-7 * np.abs(before).max()
    )
    (old,), (new,) = fitted.match(probed[5:]), fitted.match(after[5:])
    assert np.mean(new.p2p[numbers[5]] == old.p2p) > 0.995


@pytest.mark.parametrize("weighting", [None, "category"])
def test_learning_on_moved_shapes_gives_the_same_operator(
    weighting, make_learner, collection, probed, moved
):
    after, truths, numbers = moved
    # Converged far, so that both searches end at one point.
    one = make_learner(weighting=weighting, tol=1e-8).fit(probed[:5], collection.truths[:5])
    other = make_learner(weighting=weighting, tol=1e-8).fit(after[:5], truths[:5])
    before = operator(one, probed[5])
    renumbered = operator(other, after[5])[np.ix_(numbers[5], numbers[0])]
    np.testing.assert_allclose(renumbered, before, atol=1e-3 * np.abs(before).max())
    np.testing.assert_allclose(other.stability_, one.stability_, rtol=1e-3, atol=1e-6)


def test_the_reference_is_matched_to_itself_and_to_a_moved_copy(fitted, probed, moved):
    (itself,) = fitted.match(probed[:1])
    assert np.mean(itself.p2p == np.arange(len(itself.p2p))) > 0.95
    after, _, numbers = moved
    (copy,) = fitted.match(after[:1])
    assert np.mean(copy.p2p[numbers[0]] == itself.p2p) > 0.995


def test_an_exactly_symmetric_mesh_works():
    sphere = make_sphere(3)
    bump = (
        1
        + 0.6 * np.exp(5 * sphere.vertices @ [0.6, 0, 0.8] - 5)
        + 0.3 * np.exp(9 * sphere.vertices[:, 0] - 9)
    )
    meshes = [
        Mesh(sphere.vertices * bump[:, None] * [2, 1, c], sphere.faces, f"egg{c}")
        for c in (0.7, 0.75, 0.8)
    ]
    shapes = DescriptorTransformer("paper").transform(SpectralBasis(30).transform(meshes))
    distances, partner = cKDTree(sphere.vertices).query(sphere.vertices * [1, -1, 1])
    assert distances.max() < 1e-9
    truths = [Correspondence.from_vertices(np.arange(len(partner)), symmetric=partner)] * 3
    learner = WeightedFunctionalMapLearner(n_functions=15, refine=None).fit(shapes[:2], truths[:2])
    (errors,) = learner.pair_errors(shapes[2:], truths[2:])
    # Either side may be chosen at each point, but the point is found up to the symmetry.
    assert errors.mean("per_vertex") < 0.06
    assert np.isfinite(learner.functional_maps(shapes)).all()


def test_a_sphere_where_every_eigenvalue_is_repeated_gives_finite_maps():
    spheres = [make_sphere(3), make_sphere(3)]
    shapes = DescriptorTransformer().transform(SpectralBasis(20).transform(spheres))
    truths = [Correspondence.from_vertices(np.arange(258))] * 2
    learner = WeightedFunctionalMapLearner(n_functions=9).fit(shapes, truths)
    assert np.isfinite(learner.predict(shapes)).all()
