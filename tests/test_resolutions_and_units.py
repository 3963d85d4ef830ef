"""Meshes of unequal resolution and of any unit are matched alike."""

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import DescriptorTransformer, Mesh, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import make_creatures


def test_mixed_resolutions_are_matched():
    coarse, fine = make_creatures(4, 600, n_points=600), make_creatures(2, 3000, n_points=600)
    kept = [0, 2, 3]
    meshes = [*(coarse.meshes[i] for i in kept), fine.meshes[1]]
    truths = [*(coarse.correspondences[i] for i in kept), fine.correspondences[1]]
    model = make_pipeline(
        SpectralBasis(40),
        DescriptorTransformer(),
        WeightedFunctionalMapLearner(n_functions=20, tol=1e-3),
    ).fit(meshes[:3], truths[:3])
    (match,) = skfmap.match(model, meshes[3:])
    assert len(match.p2p) == 3000
    assert model.score(meshes[3:], truths[3:]) > -0.15


@pytest.mark.parametrize("unit", [1e-60, 1e-9, 1e9, 1e60])
def test_units_change_nothing(fitted, probed, collection, unit, probe):
    mesh = collection.meshes[5]
    (shape,) = probe([Mesh(unit * mesh.vertices, mesh.faces, name=mesh.name)])
    np.testing.assert_allclose(shape.spectral.evals, probed[5].spectral.evals, rtol=1e-6, atol=1e-6)
    (p2p,), (plain,) = fitted.point_maps([shape]), fitted.point_maps(probed[5:])
    assert np.mean(p2p == plain) > 0.99
