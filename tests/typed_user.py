"""What the type checker tells a user: `.ci/run types` checks this script, strictly."""

from typing import assert_type

import numpy as np
import numpy.typing as npt

import skfmap
from skfmap.datasets import make_creatures
from skfmap.refinement import BijectiveZoomOut


def match_creatures() -> list[skfmap.Match]:
    """Learn from creatures and match the last."""
    creatures = make_creatures(n_shapes=4)
    spectral = skfmap.SpectralBasis().transform(creatures.meshes)
    shapes = skfmap.DescriptorTransformer().transform(spectral)
    learner = skfmap.WeightedFunctionalMapLearner(refine=BijectiveZoomOut(step=20))
    fitted = learner.fit(shapes[:3], creatures.correspondences[:3])
    assert_type(fitted, skfmap.WeightedFunctionalMapLearner)
    assert_type(fitted.weights_, npt.NDArray[np.float64])
    assert_type(fitted.predict(shapes), npt.NDArray[np.float64])
    assert_type(fitted.match(shapes), list[skfmap.Match])
    return skfmap.match(fitted, shapes[3:])
