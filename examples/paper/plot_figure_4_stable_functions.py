"""
Figure 4: the most stable function, and where each map puts it
==============================================================

The functions Y are ordered by how well the training maps carry them. Here is the first one that is not constant, on the
reference and carried to a shape that was not trained on: by the naive map, and by maps of learned weights.
"""

# %%
import os
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from skfmap import DescriptorTransformer, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import load_collection, make_creatures
from skfmap.plotting import plot_functions

STRATEGIES = {"naive": None, "unique weight": "unique", "per category": "category", "per function": "function"}


# %%
# On the reference a stable function is ``evecs @ y``; on the other shape it is ``evecs @ X(D) @ y``, where the
# functional map X(D) pulls functions on the reference back to the shape. The last row is where the *known* map puts
# the function.
def figure(collection, which=1):
    """Draw a stable function of each strategy on the reference, and carried to the last shape."""
    shapes = DescriptorTransformer("paper").transform(SpectralBasis(60).transform(collection.meshes))
    truths = collection.correspondences
    reference, unseen = (shape.spectral for shape in (shapes[0], shapes[-1]))
    on_reference, on_unseen, captions = [], [], []
    for name, weighting in STRATEGIES.items():
        learner = WeightedFunctionalMapLearner(weighting=weighting).fit(shapes[:-1], truths[:-1])
        y = learner.stable_basis_[:, which]
        y = y * np.sign((reference.evecs[:, :50] @ y)[np.abs(reference.evecs[:, :50] @ y).argmax()])
        (X,), (C,) = learner.functional_maps(shapes[-1:]), learner.ground_truth_maps(shapes[-1:], truths[-1:])
        on_reference.append(reference.evecs[:, :50] @ y)
        on_unseen.append(unseen.evecs[:, :50] @ np.column_stack([X @ y, C @ y]))
        captions.append(f"{name}\nerror (5): {np.linalg.norm((X - C) @ y):.2f}")
    limits = (-4, 4)
    plot_functions([reference.mesh] * 4, on_reference, captions=captions, labels=["on the reference"], limits=limits)
    plot_functions(
        [unseen.mesh] * 4, on_unseen, captions=[""] * 4, labels=["by X(D)", "by the known map"], limits=limits
    )
    plt.show()


figure(make_creatures(n_shapes=11, n_vertices=1000))

# %%
# What the paper saw, and what we see
# -----------------------------------
#
# The paper: with learned weights the most stable functions tell flat parts (the body) from salient ones (legs, tail,
# head), even with a single weight; those of the naive map "are not mapped very accurately". We see the same
# functions: they single out paws and tail on every row. They are carried well: on the unseen cat of TOSCA the error
# (5) of this function is 0.08 for one weight, 0.05 per category and 0.04 per function.
#
# The naive map carries its own most stable function well too (0.06). In the paper it did not; see the page on figure
# 3 for how much alpha and the norms of the probes have to do with that. What learning improves here are the functions
# further down: see figure 5.

folder = os.environ.get("SKFMAP_DATA")
if folder:
    figure(load_collection(Path(folder) / "tosca_isometric", "cat*", reference="cat0"))
