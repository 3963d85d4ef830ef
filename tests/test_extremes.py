"""Shapes and correspondences at the edge of what makes sense: each has a stated behaviour."""

import warnings

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import Correspondence, DescriptorTransformer, Mesh, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import make_creatures, make_sphere
from skfmap.exceptions import CorrespondenceError, MeshError, SkippedShapeWarning, UnfamiliarShapeWarning


@pytest.fixture(scope="module")
def creatures():
    return make_creatures(6, 500, n_points=500)


def test_repeated_eigenvalues_give_one_space_whatever_the_mesh():
    """On a sphere whole spaces belong to one eigenvalue; a rotation turns functions within them and no further."""
    sphere = make_sphere(n_subdivisions=4)
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    one, two = SpectralBasis(16).transform([sphere, Mesh(sphere.vertices @ turn.T, sphere.faces)])
    for first, last in ((1, 4), (4, 9), (9, 16)):
        overlap = one.evecs[:, first:last].T @ (one.mass[:, None] * two.evecs[:, first:last])
        np.testing.assert_allclose(overlap @ overlap.T, np.eye(last - first), atol=1e-8)


@pytest.mark.parametrize("n_components", [20, 64, 65])
def test_nearly_as_many_functions_as_vertices(n_components):
    sphere = make_sphere(n_subdivisions=2)  # 66 vertices
    (shape,) = SpectralBasis(n_components).transform([sphere])
    gram = shape.evecs.T @ (shape.mass[:, None] * shape.evecs)
    np.testing.assert_allclose(gram, np.eye(n_components), atol=1e-8)
    (probed,) = DescriptorTransformer().transform([shape])
    assert np.isfinite(probed.probes).all()
    with pytest.raises(MeshError, match="too few for n_components=66"):
        SpectralBasis(66).transform([sphere])


def test_mixed_resolutions_are_matched():
    coarse, fine = make_creatures(4, 600, n_points=600), make_creatures(2, 3000, n_points=600)
    kept = [0, 2, 3]
    meshes = [*(coarse.meshes[i] for i in kept), fine.meshes[1]]
    truths = [*(coarse.correspondences[i] for i in kept), fine.correspondences[1]]
    model = make_pipeline(
        SpectralBasis(40), DescriptorTransformer(), WeightedFunctionalMapLearner(n_functions=20, tol=1e-3)
    ).fit(meshes[:3], truths[:3])
    (match,) = skfmap.match(model, meshes[3:])
    assert len(match.p2p) == 3000
    assert model.score(meshes[3:], truths[3:]) > -0.15


def test_a_shape_that_is_not_like_the_training_shapes_is_told(creatures):
    """Thin limbs are another shape at four times the resolution: matches are wrong, and hopeful, but not in silence."""
    coarse, fine = creatures, make_creatures(5, 2000, n_points=500)
    model = make_pipeline(
        SpectralBasis(60), DescriptorTransformer(), WeightedFunctionalMapLearner(n_functions=30, tol=1e-3)
    ).fit(coarse.meshes[:4], coarse.correspondences[:4])
    assert np.isfinite(model[-1].misfits_).sum() == 3
    (sound,) = skfmap.match(model, coarse.meshes[4:5])  # and not a word
    with pytest.warns(UnfamiliarShapeWarning, match=r"X\[0\] \('cat4'\).*another resolution"):
        (match,) = skfmap.match(model, fine.meshes[4:])
    with pytest.warns(UnfamiliarShapeWarning):
        model.predict(fine.meshes[4:])
    assert sound.expected_error.mean() > 0.5 * -model.score(coarse.meshes[4:5], coarse.correspondences[4:5])
    assert sound.familiar
    assert sound.misfit < 1
    assert not match.familiar
    assert match.misfit > 1.4
    assert "unlike the training shapes" in repr(match)
    assert match.expected_error.mean() > 0.3 * -model.score(fine.meshes[4:], fine.correspondences[4:])


@pytest.fixture(scope="module")
def taught_by_creatures(creatures):
    """Return a model fitted on all creatures but the last."""
    return make_pipeline(
        SpectralBasis(60), DescriptorTransformer(), WeightedFunctionalMapLearner(n_functions=30, tol=1e-3)
    ).fit(creatures.meshes[:5], creatures.correspondences[:5])


@pytest.mark.parametrize("stretch", [1.0, 1.5, 2.0, 3.0])
def test_expected_errors_of_what_was_never_seen_are_raised(creatures, taught_by_creatures, stretch):
    """Stretched bodies are matched the worse the more they are; errors follow, though no training shape showed that."""
    model, body = taught_by_creatures, creatures.meshes[5]
    stretched = Mesh(body.vertices * [1, 1, stretch], body.faces, body.name)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        (match,) = skfmap.match(model, [stretched])
        error = -model.score([stretched], creatures.correspondences[5:])
    assert match.familiar == (not told)
    assert match.familiar == (stretch < 2)
    assert 0.4 < match.expected_error.mean() / error < 2.5
    assert 0 <= match.confidence.min() <= match.confidence.max() <= 1


@pytest.mark.parametrize("unit", [1e-60, 1e-9, 1e9, 1e60])
def test_units_change_nothing(fitted, probed, collection, unit, probe):
    mesh = collection.meshes[5]
    (shape,) = probe([Mesh(unit * mesh.vertices, mesh.faces, name=mesh.name)])
    np.testing.assert_allclose(shape.spectral.evals, probed[5].spectral.evals, rtol=1e-6, atol=1e-6)
    (p2p,), (plain,) = fitted.point_maps([shape]), fitted.point_maps(probed[5:])
    assert np.mean(p2p == plain) > 0.99


# What is wrong with the correspondence of a training shape: what is said.
_WRONG = {
    "out of range": (lambda t: Correspondence(np.add(t.pairs, [10_000, 0])), "refer to vertex"),
    "of another size": (lambda t: Correspondence.from_vertices(np.zeros(7, dtype=int)), "was made for 7 vertices"),
    "unknown everywhere": (lambda t: Correspondence.from_template([-1] * 300), "holds no pairs"),
    "fewer than k": (lambda t: t.restrict(np.arange(5)), "too few for n_functions=12"),
    "of another template": (lambda t: Correspondence(np.add(t.pairs, [0, 900])), "share no template point"),
}


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.SkippedShapeWarning")
@pytest.mark.parametrize("wrong", _WRONG)
def test_a_correspondence_that_does_not_fit_is_refused_or_skipped(collection, probed, make_learner, wrong):
    change, message = _WRONG[wrong]
    truths = [*collection.truths[:2], change(collection.truths[2]), *collection.truths[3:5]]
    with pytest.raises(CorrespondenceError, match=message):
        make_learner().fit(probed[:5], truths)
    with pytest.warns(SkippedShapeWarning, match=rf"X\[2\], shape 'body2'.*{message}"):
        learner = make_learner(on_invalid="skip").fit(probed[:5], truths)
    rest = [0, 1, 3, 4]
    alone = make_learner().fit([probed[i] for i in rest], [collection.truths[i] for i in rest])
    np.testing.assert_array_equal(learner.weights_, alone.weights_)
    first = [change(collection.truths[0]), *collection.truths[1:5]]
    with pytest.raises((MeshError, ValueError)):
        make_learner(on_invalid="skip").fit(probed[:5], first)
