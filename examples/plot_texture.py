"""
A texture carried from the reference to a scan
==============================================

Paint the reference, lay its mesh onto a creature in another pose, and the paint comes along: as it
was on the reference's mesh, which has the scan's form now, and on the scan's own vertices.
"""

# %%
# Train on six creatures, each meshed on its own, and keep another: the scan. ``refine="register"``
# lays the mesh of the reference, the first, onto every shape that is matched.
import igl
import numpy as np
from matplotlib import pyplot as plt
from scipy.spatial.transform import Rotation
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap.datasets import make_creatures
from skfmap.plotting import plot_function

creatures = make_creatures(n_shapes=8, n_vertices=1500)
model = make_pipeline(
    skfmap.SpectralBasis(),
    skfmap.DescriptorTransformer(),
    skfmap.WeightedFunctionalMapLearner(refine="register", confidence=None),
)
model.fit(creatures.meshes[:6], creatures.correspondences[:6])
reference, scan = creatures.meshes[0], creatures.meshes[7]

# %%
# The mesh laid onto the scan has the reference's vertices, in new places, and its faces. Whatever
# is tied to these, such as a texture or a skeleton, needs nothing else.
(laid,) = skfmap.register(model, [scan])
print(laid)
print("median distance to the scan:", np.median(laid.distance).round(3), "cm")

# %%
# Texture coordinates, here those of a picture that is thrown on from the side. `Match.transfer`
# takes them to the vertices of the scan, from between the vertices of the reference: through the
# registered mesh, and by the match as it is without one.
texture = reference.vertices[:, 1:]
(through_mesh,) = skfmap.match(model, [scan], interpolate="barycentric")
(plain,) = skfmap.match(model, [scan], refine="bijective-zoomout", interpolate="barycentric")


# %%
# The creatures are made up, so that we know which vertices correspond, and how far off the texture
# is.
at, at_0 = (creatures.correspondences[i].pairs[:, 0] for i in (7, 0))
for name, match in (("through the mesh", through_mesh), ("plain", plain)):
    off = np.linalg.norm(match.transfer(texture)[at] - texture[at_0], axis=1)
    print(f"{name}: {off.mean():.2f} cm, 95 % within {np.quantile(off, 0.95):.2f} cm")


# %%
# The texture is a checkerboard, looked up between vertices as well. The scan is turned as the
# reference stands. The two ways of painting it differ at the tips: paws, ears and tail.
def turned(vertices):
    """Return vertices of the scan as the reference stands."""
    return vertices @ turn.as_matrix().T


centred = [shape.vertices - shape.vertices.mean(axis=0) for shape in (reference, laid)]
turn, _ = Rotation.align_vectors(*centred)


def draw(ax, vertices, faces, coordinates, title):
    """Draw a mesh with the checkerboard at its texture coordinates."""
    with_depth = np.column_stack([coordinates, np.zeros(len(vertices))])
    fine, fine_faces = igl.upsample(vertices, faces, 3)
    columns, rows, _ = np.floor(igl.upsample(with_depth, faces, 3)[0] / 8).T.astype(int)
    colours = np.array([[0.95, 0.9, 0.8], [0.15, 0.35, 0.6]])[(columns + rows) % 2]
    plot_function(skfmap.Mesh(fine, fine_faces), colours, ax=ax)
    ax.set_title(title, fontsize=10)


figure, axes = plt.subplots(2, 2, figsize=(10, 7), layout="constrained")
draw(axes[0, 0], reference.vertices, reference.faces, texture, "the reference, painted")
draw(axes[0, 1], turned(laid.vertices), laid.faces, texture, "its mesh, laid onto the scan")
for ax, match, title in (
    (axes[1, 0], through_mesh, "the scan, through that mesh"),
    (axes[1, 1], plain, "the scan, by the plain match"),
):
    draw(ax, turned(scan.vertices), scan.faces, match.transfer(texture).data, title)
plt.show()
