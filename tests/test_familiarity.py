"""Shapes that are not like those that were learned from: said, and expected to be wrong."""

import warnings

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

import skfmap
import skfmap.functional.eigenbasis
import skfmap.learner.observation
import skfmap.learner.training_set
from skfmap import DescriptorTransformer, Mesh, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import make_creatures
from skfmap.exceptions import UnfamiliarShapeWarning
from skfmap.learner.familiarity import is_familiar


@pytest.fixture(scope="module")
def creatures():
    return make_creatures(6, 500, n_points=500)


def test_a_shape_that_is_not_like_the_training_shapes_is_told(creatures):
    """Thin limbs are another shape at four times the resolution: matches are wrong, but told."""
    coarse, fine = creatures, make_creatures(5, 2000, n_points=500)
    model = make_pipeline(
        SpectralBasis(60),
        DescriptorTransformer(),
        WeightedFunctionalMapLearner(n_functions=30, tol=1e-3, refine=None),
    ).fit(coarse.meshes[:4], coarse.correspondences[:4])
    assert np.isfinite(model[-1].misfits_).sum() == 3
    (sound,) = skfmap.match(model, coarse.meshes[4:5])  # and not a word
    with pytest.warns(UnfamiliarShapeWarning, match=r"X\[0\] \('cat4'\).*another resolution"):
        (match,) = skfmap.match(model, fine.meshes[4:])
    with pytest.warns(UnfamiliarShapeWarning, match="cat4"):
        model.predict(fine.meshes[4:])
    assert sound.expected_error.mean() > 0.5 * -model.score(
        coarse.meshes[4:5], coarse.correspondences[4:5]
    )
    assert sound.familiar
    assert sound.misfit < 1
    assert not match.familiar
    assert match.misfit > 1.4
    assert "unlike the training shapes" in repr(match)
    assert match.expected_error.mean() > 0.3 * -model.score(
        fine.meshes[4:], fine.correspondences[4:]
    )


@pytest.fixture(scope="module")
def taught_by_creatures(creatures):
    """Return a model fitted on all creatures but the last."""
    return make_pipeline(
        SpectralBasis(60),
        DescriptorTransformer(),
        WeightedFunctionalMapLearner(n_functions=30, tol=1e-3, refine=None),
    ).fit(creatures.meshes[:5], creatures.correspondences[:5])


@pytest.mark.parametrize("stretch", [1.0, 1.5, 2.0, 3.0])
def test_expected_errors_of_what_was_never_seen_are_raised(creatures, taught_by_creatures, stretch):
    """The more bodies are stretched, the worse the match: expected errors follow."""
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


def test_a_shape_is_familiar_up_to_a_multiple_of_the_worst_training_shape():
    residuals = np.array(
        [np.nan, 1.0, 2.0, 1.5, 1.0]
    )  # of four; the limit is 2 * 1.5 * (1 + 1 / 3) = 4
    assert is_familiar(residuals, 3.9)
    assert not is_familiar(residuals, 4.1)
    assert is_familiar(residuals, 1.0, misfit=1.5)  # the limit is 1.25 * (1 + 1 / 4)
    assert not is_familiar(residuals, 1.0, misfit=1.6)
    one = np.array([np.nan, 2.0])
    assert is_familiar(one, 7.9)
    assert not is_familiar(one, 8.1)
