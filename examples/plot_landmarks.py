"""
Landmarks on new specimens, and semilandmarks between them
==========================================================

Learn from a few specimens with landmarks, measure others, and look at how much of the variation is
left; then points between landmarks, which slide, and a table.
"""

# %%
# Ten creatures at rest that differ in build, each meshed on its own. An observer has put fourteen
# landmarks on them, two of them on the midline: vertices, which are never quite the same place.
import tempfile
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap.datasets import make_creatures
from skfmap.functional import farthest_points
from skfmap.landmarks import (
    align_landmarks,
    asymmetric_component,
    bending_energy,
    carry_points,
    centroid_sizes,
    propose_pairing,
    shrinkage,
    slide,
    stack_landmarks,
    write_table,
)

creatures = make_creatures(n_shapes=10, n_vertices=1000, pose_strength=0, variation=0.2)
meshes, truths = creatures.meshes, creatures.correspondences
half = len(creatures.template_points) // 2
template_points = {"nose": 1, "tail": 8}
left = {"ear": 7, "shoulder": 6, "front paw": 4, "flank": 11, "hip": 5, "hind paw": 2}
for name, point in left.items():
    template_points |= {f"{name} L": point, f"{name} R": point + half}
placed = []
for mesh, truth in zip(meshes, truths, strict=True):
    vertex_of = {point: vertex for vertex, point in truth.pairs}
    at = mesh.vertices[[vertex_of[point] for point in template_points.values()]]
    placed.append(skfmap.Landmarks(at, list(template_points), name=mesh.name))

# %%
# Five of them are learned from, and the landmarks of the others are predicted, in the units and the
# place of each mesh, with the error to expect.
measured = [
    skfmap.Correspondence.from_points(marks, mesh)
    for marks, mesh in zip(placed, meshes, strict=True)
]
model = make_pipeline(
    skfmap.SpectralBasis(),
    skfmap.DescriptorTransformer(),
    skfmap.WeightedFunctionalMapLearner(n_functions=20, refine="register"),
)
model.fit(meshes[:5], measured[:5])
predicted = skfmap.predict_landmarks(model, meshes[5:])
away = np.linalg.norm(stack_landmarks(predicted) - stack_landmarks(placed[5:]), axis=2)
expected = np.mean([one.expected_error for one in predicted])
print(f"mean error {away.mean():.1f}, expected {expected:.1f}")
print("centroid sizes:", centroid_sizes(stack_landmarks(predicted)).round())

# %%
# A mean error hides whether specimens are told apart. Predictions nearer to the mean than they
# should be have a ratio of variances below one, and so have those that do not repeat the slips of
# the observer's hand, which are large here; errors of the predictions raise it.
print(shrinkage(predicted, placed[5:]))


# %%
# The same as a picture, from the side. Specimens lie anywhere; for this they are turned and shifted
# onto their mean, in their own size.
def plot_aligned(panels, fixed=None):
    """Draw landmarks of all specimens about their means, seen from the side."""
    _, axes = plt.subplots(len(panels), 1, figsize=(6, 2.4 * len(panels)), sharex=True, sharey=True)
    for ax, (title, marks) in zip(axes, panels.items(), strict=True):
        aligned = align_landmarks(stack_landmarks(marks))
        mean = aligned.mean(axis=0)
        for i, point in enumerate(mean):
            known = fixed is None or marks[0].names[i] in fixed
            colour = "C0" if known else "C1"
            ax.scatter(*aligned[:, i, 1:].T, s=6, color=colour)
            ax.scatter(*point[1:], marker="+", color="black")
        ax.set(title=title, aspect="equal", xlabel="y", ylabel="z")


# All begin with the reference, so that all are turned alike.
plot_aligned({"placed by hand": placed[:1] + placed[5:], "predicted": placed[:1] + predicted})
plt.tight_layout()
plt.show()

# %%
# The model lays the mesh of the first specimen, the reference, onto all, and a patch of forty
# semilandmarks that is put there once comes out on all. They slide on each specimen's surface until
# the thin-plate spline from the mean bends least; landmarks stay.
reference, registered = meshes[0], skfmap.register(model, meshes)
spread = farthest_points(reference.vertices, 40)
patch = skfmap.Landmarks(reference.vertices[spread], [f"s{i}" for i in range(40)])
carried = carry_points(registered, patch, reference, meshes)
before = [
    skfmap.Landmarks([*a.points, *b.points], [*a.names, *b.names], name=a.name)
    for a, b in zip(placed[:5] + predicted, carried, strict=True)
]
after = slide(before, meshes, surfaces=patch.names)
mean = align_landmarks(stack_landmarks(after)).mean(axis=0)
energies = [[bending_energy(one.points, mean) for one in marks] for marks in (before, after)]
print("bending energy, as carried and slid:", np.mean(energies, axis=1).round(1))
plot_aligned({"as carried": before, "slid": after}, fixed=template_points)
plt.tight_layout()
plt.show()

# %%
# Landmarks that mirror each other are known by their names. What is asymmetric in these creatures
# is where the vertices happened to be.
pairing = propose_pairing(placed[0].names)
print(pairing)
asymmetry = asymmetric_component(align_landmarks(stack_landmarks(placed)), pairing)
print("asymmetry per specimen:", np.linalg.norm(asymmetry, axis=2).mean(axis=1).round(1))

# %%
# The table for geomorph, Morpho, geomstats or pandas: in the units of the meshes, size kept.
folder = Path(tempfile.mkdtemp())
write_table(after, folder / "landmarks.csv")
print((folder / "landmarks.csv").read_text()[:80])
