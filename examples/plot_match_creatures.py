"""
Match a creature that the model has not seen
============================================

Train on ten poses of a made-up cat, each meshed on its own, and match the eleventh to the
reference.
"""

# %%
# A collection: meshes, and where each lies on the template that they share. The first is the
# reference.
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap.datasets import make_creatures

creatures = make_creatures(n_shapes=11, n_vertices=1000)
print(creatures.meshes[0], creatures.correspondences[0])

# %%
# From meshes to eigenfunctions, from eigenfunctions to probe functions, from probe functions to
# maps.
model = make_pipeline(
    skfmap.SpectralBasis(),
    skfmap.DescriptorTransformer(),
    skfmap.WeightedFunctionalMapLearner(),
)
model.fit(creatures.meshes[:-1], creatures.correspondences[:-1])

# %%
# The two maps point opposite ways. The point map sends vertices of the new shape to vertices of the
# reference; the functional map pulls functions on the reference back to the new shape.
(match,) = skfmap.match(model, creatures.meshes[-1:])
print(match)
print("vertex 0 of the new shape lies on vertex", match.p2p[0], "of the reference")
print("functional map:", match.functional_map.shape, "reduced to", match.reduced_map.shape)

# %%
# How far it is off, in units of the square root of the reference's area.
print("mean error:", -model.score(creatures.meshes[-1:], creatures.correspondences[-1:]))

# %%
# The colours of the reference carried to the new shape, and the error to expect at each of its
# vertices.
from matplotlib import pyplot as plt

from skfmap.plotting import plot_matches

plot_matches([match], creatures.meshes[-1:], creatures.meshes[0])
plt.show()
