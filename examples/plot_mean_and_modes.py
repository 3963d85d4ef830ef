"""
The mean of a collection, and how its shapes vary
=================================================

Lay one mesh onto all shapes of a collection, so that their vertices correspond, and split what they
differ in into principal modes.
"""

# %%
# Eight creatures that move a little and differ a little in build, each meshed on its own. Five of
# them, with known correspondences, train the model that lays the first one's mesh onto all.
import os
import tempfile
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from scipy.spatial import KDTree
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap.datasets import make_creatures
from skfmap.geometry.normals import vertex_normals
from skfmap.io import read_mesh, write_mesh
from skfmap.plotting import Camera, plot_functions
from skfmap.shape_space import ShapeSpace, stack


def lay_onto_all(meshes, truths, n_training, max_vertices=6000, k=50):
    """Return the mesh of the first shape, laid onto all."""
    model = make_pipeline(
        skfmap.SpectralBasis(max_vertices=max_vertices),
        skfmap.DescriptorTransformer(),
        skfmap.WeightedFunctionalMapLearner(n_functions=k, refine="register", confidence=None),
    )
    return skfmap.register(model.fit(meshes[:n_training], truths[:n_training]), meshes)


creatures = make_creatures(n_shapes=8, n_vertices=1000, pose_strength=0.3, variation=0.2)
registered = lay_onto_all(creatures.meshes, creatures.correspondences, 5)

# %%
# One mesh for each shape, in its own place. All have the faces of the first, so their vertices make
# one array; what does not fit is refused by name.
folder = Path(tempfile.mkdtemp())
for one in registered:
    write_mesh(one.mesh, folder / f"{one.name}.ply")
print(stack(registered).shape)

# %%
# `ShapeSpace` turns and shifts them onto their mean and takes principal components. Each vertex
# counts as much as the area around it, and size is a part of the shape.
space = ShapeSpace().fit(registered)
print("share of variance:", space.explained_variance_ratio_.round(3))


# %%
# The mean, and two standard deviations to both sides of it along the first mode. Colours tell how
# far the surface has moved outwards, in the units of the meshes.
def plot_mode(space, mode=0, camera=None):
    """Draw the mean between two of its variations."""
    deviations = (-2.0, 0.0, 2.0)
    step = space.standard_deviations_[mode] * space.modes_[mode]
    outwards = (step * vertex_normals(space.mean_, space.faces_)).sum(axis=1)
    return plot_functions(
        [space.mode_mesh(mode, t) for t in deviations],
        [t * outwards for t in deviations],
        captions=["mean - 2 sd", "mean", "mean + 2 sd"],
        labels=["moved outwards"],
        camera=camera,
    )


plot_mode(space)
plt.show()

# %%
# Scores say where each shape lies along the modes, and lead back to it.
scores = space.transform(registered)
shapes = space.inverse_transform(scores)
print(space.get_feature_names_out()[:3], scores[1, :3].round(2))

# %%
# Mouse mandibles, half of a jaw each, with thirteen landmarks placed by hand, where ``SKFMAP_DATA``
# names the folder that they are in: of one size here, since the first mode would be growth
# otherwise.
data = Path(os.environ.get("SKFMAP_DATA", "")) / "mandibles"
if data.is_dir():
    meshes, truths = [], []
    for path in sorted(data.glob("*.ply"))[:10]:
        mesh = read_mesh(path)
        landmarks = np.loadtxt(
            path.with_name(f"{path.stem}_Landmarks.fcsv"), delimiter=",", usecols=(1, 2, 3)
        )
        meshes.append(mesh)
        truths.append(
            skfmap.Correspondence.from_template(KDTree(mesh.vertices).query(landmarks)[1])
        )
    registered = lay_onto_all(meshes, truths, 5, max_vertices=2000, k=12)
    mandibles = ShapeSpace(scale=True).fit(registered)
    print("share of variance:", mandibles.explained_variance_ratio_.round(3))
    plot_mode(mandibles, camera=Camera(up="y", azimuth=0))
    plt.show()
