"""
Figure 4: the most stable function, and where each map puts it
==============================================================

The functions Y are ordered by how well the training maps carry them. Here is the first one that is
not constant, on the reference and carried to a shape that was not trained on: by the naive map, and
by maps of learned weights.
"""

# %%
import os
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from skfmap import DescriptorTransformer, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import load_collection, make_creatures
from skfmap.plotting import plot_functions

STRATEGIES = {"naive": None, "unique": "unique", "category": "category", "function": "function"}


# %%
# On the reference a stable function is ``evecs @ y``; on the other shape it is ``evecs @ X(D) @
# y``, where the functional map X(D) pulls functions on the reference back to the shape. The last
# column is where the *known* map puts the function; beside each row stands how far the two are
# apart.
def figure(collection, which=1):
    """Draw a stable function of each strategy on the reference, and carried to the last shape."""
    shapes = DescriptorTransformer("paper").transform(
        SpectralBasis(60).transform(collection.meshes)
    )
    truths = collection.correspondences
    reference, unseen = (shape.spectral for shape in (shapes[0], shapes[-1]))
    columns, labels = ([], [], []), []
    for name, weighting in STRATEGIES.items():
        learner = WeightedFunctionalMapLearner(weighting=weighting, refine=None)
        learner.fit(shapes[:-1], truths[:-1])
        y = learner.stable_basis_[:, which]
        values = reference.evecs[:, :50] @ y
        y = y * np.sign(values[np.abs(values).argmax()])  # signs mean nothing: here peaks are high
        (X,), (C,) = (
            learner.functional_maps(shapes[-1:]),
            learner.ground_truth_maps(shapes[-1:], truths[-1:]),
        )
        images = (
            reference.evecs[:, :50] @ y,
            unseen.evecs[:, :50] @ X @ y,
            unseen.evecs[:, :50] @ C @ y,
        )
        for column, image in zip(columns, images, strict=True):
            column.append(image)
        labels.append(f"{name}: {np.linalg.norm((X - C) @ y):.2f}")
    plot_functions(
        [reference.mesh, unseen.mesh, unseen.mesh],
        [np.column_stack(column) for column in columns],
        captions=["on the reference", "carried by X(D)", "by the known map"],
        labels=labels,
        limits=(-4, 4),
    )
    plt.show()


figure(make_creatures(n_shapes=11, n_vertices=1000))

# %%
# What the paper saw, and what we see
# -----------------------------------
#
# The paper: with learned weights the most stable functions tell flat parts (the body) from salient
# ones (legs, tail, head), even with a single weight; those of the naive map "are not mapped very
# accurately". We see the same functions: they single out paws and tail on every row. They are
# carried well: on the unseen cat of TOSCA the error (5) of this function is 0.08 for one weight,
# 0.05 per category and 0.04 per function.
#
# The naive map carries its own most stable function well too (0.06). In the paper it did not; see
# the page on figure 3 for how much alpha and the norms of the probes have to do with that. What
# learning improves here are the functions further down: see figure 5.

folder = os.environ.get("SKFMAP_DATA")
if folder:
    figure(load_collection(Path(folder) / "tosca_isometric", "cat*", reference="cat0"))
