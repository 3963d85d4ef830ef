"""
A collection of bones, from landmarks to a table
================================================

Half of a collection has landmarks that were placed by hand. The other half is measured by what they
teach: size, shape and a table for the statistics.
"""

# %%
# Ten bones, made up: a shaft with two heads, a crest and a process, in another size and build
# for each specimen, meshed and lying differently. An observer places ten landmarks, good to about
# half a percent of the length.
import os
import tempfile
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from scipy.spatial.transform import Rotation
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap.datasets import load_collection, make_sphere
from skfmap.io import write_landmarks, write_mesh
from skfmap.landmarks import align_landmarks, centroid_sizes, stack_landmarks, write_table
from skfmap.plotting import Camera, plot_function

PLACES = {
    "head": [0.95, 0.3, 0.1],
    "greater tubercle": [0.9, -0.35, 0.2],
    "lesser tubercle": [0.85, 0, 0.5],
    "crest": [0.3, 0.1, 0.95],
    "nutrient foramen": [0, -1, 0.1],
    "process": [-0.55, 0.8, 0.2],
    "medial epicondyle": [-0.9, 0.4, 0],
    "lateral epicondyle": [-0.9, -0.42, 0.1],
    "trochlea": [-0.98, 0, 0.2],
    "fossa": [-0.75, 0, -0.65],
}
DIRECTIONS = np.array([np.divide(place, np.linalg.norm(place)) for place in PLACES.values()])


def bone_surface(directions, build):
    """Return points of a bone's surface, one for each direction from its middle."""
    along, across = directions[:, :1], directions[:, 1:]
    around = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    thick = np.sqrt(np.maximum(1 - along**6, 0)) * (1 + 1.1 * along**4)
    shaft = np.hstack([10 * along, around * thick * [0.9, 1.2]])
    bumps = np.exp(14 * (directions @ DIRECTIONS.T - 1)) @ (DIRECTIONS * build[:-2, None])
    return build[-2] * (shaft + bumps + build[-1] * along**2 * [0, 0.5, 1])


def make_bones(n_bones, n_subdivisions=4):
    """Return meshes of bones, and the landmarks that an observer placed on them."""
    rng, sphere = np.random.default_rng(1), make_sphere(n_subdivisions=n_subdivisions)
    typical = np.array([1.6, 1.2, 0.9, 0.8, 0.1, 1.4, 1.1, 1.0, 0.5, -0.5, 1.0, 1.0])
    meshes, placed = [], []
    for i in range(n_bones):
        build = typical * rng.normal(1, [0.15] * 10 + [0.12, 0.2])
        turns = Rotation.random(2, random_state=rng)
        mesh = bone_surface(turns[0].apply(sphere.vertices.copy()), build)
        marks = bone_surface(DIRECTIONS, build) + rng.normal(0, 0.05, (10, 3))
        name = f"bone{i:02d}"
        meshes.append(skfmap.Mesh(turns[1].apply(mesh), sphere.faces, name=name))
        placed.append(skfmap.Landmarks(turns[1].apply(marks), list(PLACES), name=name))
    return meshes, placed


bones, placed = make_bones(10)

# %%
# On disk a collection looks like this, whichever program the landmarks were placed with: a mesh for
# each specimen, and its landmarks beside it, here as 3D Slicer writes them.
folder = Path(tempfile.mkdtemp())
for bone, marks in zip(bones[:5], placed, strict=False):
    write_mesh(bone, folder / f"{bone.name}.ply")
    write_landmarks(marks, folder / f"{bone.name}_Landmarks.fcsv")
collection = load_collection(folder)
print(collection.DESCR)


# %%
# Learn from these five, and place the landmarks on the other five. Bones are stiff, so that the
# known maps of the training shapes can be built from ten landmarks; few eigenfunctions are enough.
def measured(collection, new, n_functions=12):
    """Return the landmarks of new specimens, and the model."""
    model = make_pipeline(
        skfmap.SpectralBasis(60, max_vertices=2000),
        skfmap.DescriptorTransformer(),
        skfmap.WeightedFunctionalMapLearner(n_functions=n_functions),
    )
    model.fit(collection.meshes, collection.correspondences)
    return skfmap.predict_landmarks(model, new), model


predicted, model = measured(collection, bones[5:])
away = np.linalg.norm(stack_landmarks(predicted) - stack_landmarks(placed[5:]), axis=2)
expected = np.array([one.expected_error for one in predicted])
for name, error, told in zip(PLACES, away.mean(axis=0), expected.mean(axis=0), strict=True):
    print(f"{name:20} off by {error:.2f} mm, expected {told:.2f} mm")


# %%
# Before the table is trusted, look at the specimens, turned as the first one lies.
def draw_measured(new, by_hand, predicted, onto, n_shown=3):
    """Draw specimens with the landmarks placed by hand, and those predicted."""
    _, axes = plt.subplots(1, n_shown, figsize=(11, 2.8), layout="constrained")
    long = np.linalg.svd(onto.points - onto.points.mean(axis=0), full_matrices=False)[2]
    lying = Rotation.from_matrix(long * [[1], [1], [np.linalg.det(long)]])
    target = lying.apply(onto.points - onto.points.mean(axis=0))
    for ax, mesh, hand, model_s in zip(axes, new, by_hand, predicted, strict=False):
        middle = model_s.points.mean(axis=0)
        turn, _ = Rotation.align_vectors(target, model_s.points - middle)
        shown = skfmap.Mesh(turn.apply(mesh.vertices - middle)[:, [0, 2, 1]], mesh.faces[:, ::-1])
        camera = Camera(azimuth=0, elevation=0)
        plot_function(shown, np.full((mesh.n_vertices, 3), 0.8), ax=ax, camera=camera)
        for marks, label, style in ((hand, "by hand", "k+"), (model_s, "predicted", "C1.")):
            x, y, _ = camera.project(turn.apply(marks.points - middle)[:, [0, 2, 1]]).T
            ax.plot(x, y, style, zorder=3, label=label)
        ax.set_title(mesh.name, fontsize=10)
    axes[0].legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 0), ncols=2)


draw_measured(bones[5:], placed[5:], predicted, onto=placed[0])
plt.show()

# %%
# Size and shape of all ten. Aligned and scaled to unit size, landmarks leave shape, whose first
# two principal components are drawn. Whether predicted specimens vary as much as they should is
# what `skfmap.landmarks.shrinkage` measures, where some also have landmarks placed by hand.
array = stack_landmarks([*placed[:5], *predicted])
sizes = centroid_sizes(array)
shapes = align_landmarks(array) / sizes[:, None, None]
deviations = (shapes - shapes.mean(axis=0)).reshape(len(shapes), -1)
scores = deviations @ np.linalg.svd(deviations, full_matrices=False)[2][:2].T
figure, ax = plt.subplots(figsize=(5, 4), layout="constrained")
for who, label in ((slice(5), "by hand"), (slice(5, None), "predicted")):
    ax.scatter(*scores[who].T, s=sizes[who] * 2, alpha=0.7, label=label)
ax.set(xlabel="first component of shape", ylabel="second component")
ax.legend()
plt.show()

# %%
# The table: one row for each specimen, for geomorph, Morpho, geomstats or pandas.
write_table([*placed[:5], *predicted], folder / "landmarks.csv")
for line in (folder / "landmarks.csv").read_text().splitlines()[:3]:
    print(line[:90], "...")

# %%
# The same with mouse mandibles, where ``SKFMAP_DATA`` names the folder that they are in: some with
# their landmarks are learned from, four others are measured.
data = Path(os.environ.get("SKFMAP_DATA", "")) / "mandibles"
if os.environ.get("SKFMAP_DATA") and data.is_dir():
    known, new = (load_collection(data, pattern) for pattern in ("158_*", "152_*"))
    predicted, _ = measured(known, new.meshes)
    away = np.linalg.norm(stack_landmarks(predicted) - stack_landmarks(new.landmarks), axis=2)
    expected = np.mean([one.expected_error for one in predicted])
    print(f"{len(known.meshes)} learned from: off by {away.mean():.3f} mm, expected {expected:.3f}")
    draw_measured(new.meshes, new.landmarks, predicted, onto=known.landmarks[0])
    plt.show()
