"""
How far to trust each part of a match
=====================================

Expected errors against true ones on creatures that the model has not seen, what refinement changes,
and a segmentation carried over with its doubtful part marked.
"""

# %%
# Train on seven creatures, keep four. The first is the reference.
import numpy as np
from matplotlib import pyplot as plt
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap.datasets import make_creatures
from skfmap.plotting import ReliabilityDisplay

creatures = make_creatures(n_shapes=11, n_vertices=1000)
model = make_pipeline(
    skfmap.SpectralBasis(),
    skfmap.DescriptorTransformer(),
    skfmap.WeightedFunctionalMapLearner(),
)
model.fit(creatures.meshes[:7], creatures.correspondences[:7])
new_meshes, new_truths = creatures.meshes[7:], creatures.correspondences[7:]

# %%
# The learner refines as it was told; ``refine=None`` shows the match before. Errors of both were
# calibrated during `fit`, on training shapes that were left out of the learning in turn.
learner, shapes = model[-1], model[:-1].transform(new_meshes)
figure, axes = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
for ax, refine in zip(axes, (None, "bijective-zoomout"), strict=True):
    matches = skfmap.match(model, new_meshes, refine=refine)
    errors = learner.pair_errors(shapes, new_truths, refine=refine)
    expected = np.concatenate(
        [m.expected_error[e.vertices] for m, e in zip(matches, errors, strict=True)]
    )
    true = np.concatenate([e.direct for e in errors])
    ReliabilityDisplay.from_predictions(expected, true, ax=ax)
    ax.set_title(f"refine={refine}")
    trusted = expected <= np.median(expected)
    print(
        f"refine={refine}: mean error {true.mean():.4f}, "
        f"of the half most trusted {true[trusted].mean():.4f}"
    )
plt.show()

# %%
# A segmentation of the reference, carried to a new creature. Vertices whose expected error is above
# the limit are masked.
reference = learner.reference_.spectral
segments = np.where(reference.vertices[:, 0] > np.median(reference.vertices[:, 0]), "front", "back")
carried = matches[0].transfer(
    segments, max_error=float(np.quantile(matches[0].expected_error, 0.9))
)
for segment in ("front", "back"):
    print(segment, (carried.compressed() == segment).sum(), "vertices")
print("masked", carried.mask.sum(), "vertices")

# %%
# Where on the reference maps err, as the singular values of Y tell it: a function to look at.
print(
    "least and most stable:", learner.stability_function().max(), learner.stability_function().min()
)
