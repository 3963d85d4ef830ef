"""
A scan with a hole
==================

Scans have holes, loose pieces and rough surfaces. Look at what is wrong with one, match it all the
same, and see where the match suffers.
"""

# %%
# Seven creatures, each meshed on its own, and an eighth that becomes the scan.
import os
import warnings
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap.datasets import load_collection, make_creatures, make_sphere
from skfmap.plotting import Camera, plot_functions

creatures = make_creatures(n_shapes=8, n_vertices=1500)
whole, truth = creatures.meshes[7], creatures.correspondences[7]


# %%
# The scanner did not see a patch of the flank, left noise on the surface, and picked up a crumb
# beside the animal. Vertices keep their numbers: those in the hole are still listed, but no face
# uses them. One scan has a small hole, the other a large one.
def facing(mesh):
    """Return a vertex in the middle of the side that the pictures show."""
    right, up, towards = (Camera().project(mesh.vertices - mesh.vertices.mean(axis=0))).T
    central = np.argsort(np.hypot(right, up))[: mesh.n_vertices // 20]
    return central[towards[central].argmax()]


def scanned(mesh, radius, noise=0.002):
    """Return a mesh with a hole, noise, and a crumb beside it; in parts of its length."""
    rng = np.random.default_rng(0)
    length = np.ptp(mesh.vertices, axis=0).max()
    away = np.linalg.norm(mesh.vertices - mesh.vertices[facing(mesh)], axis=1)
    seen = mesh.faces[(away[mesh.faces] > radius * length).all(axis=1)]
    rough = mesh.vertices + rng.normal(0, noise * length, mesh.vertices.shape)
    crumb = make_sphere(n_subdivisions=1)
    lowest = mesh.vertices[mesh.vertices[:, 2].argmin()]
    beside = lowest + length * (0.02 * crumb.vertices + np.array([0.1, 0, 0]))
    return skfmap.Mesh(
        np.vstack([rough, beside]),
        np.vstack([seen, crumb.faces + mesh.n_vertices]),
        name=f"{mesh.name}, hole {radius:.2f}",
    )


scans = [scanned(whole, radius) for radius in (0.06, 0.1)]

# %%
# `check_mesh` says what is wrong with a mesh, and what will be done about it.
print(skfmap.check_mesh(scans[1]))

# %%
# Nothing has to be repaired by hand. The model mends what it can, says so, and answers on the
# vertices of the scan as it came: -1 and NaN where there is no surface.
model = make_pipeline(
    skfmap.SpectralBasis(),
    skfmap.DescriptorTransformer(),
    skfmap.WeightedFunctionalMapLearner(),
)
model.fit(creatures.meshes[:7], creatures.correspondences[:7])
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    matches = skfmap.match(model, [whole, *scans])
for warning in told:
    print(warning.message, end="\n\n")
for match in matches:
    print(f"{match.name}: {len(match.p2p)} answers, {(match.p2p < 0).sum()} of them none")

# %%
# How far off are they? We know where the vertices belong. Errors are straight distances, in percent
# of sqrt(area).
reference = creatures.meshes[0]
known = truth.join(creatures.correspondences[0])
for match in matches:
    answered = match.p2p[known.vertices_i] >= 0
    at, belongs = known.vertices_i[answered], known.vertices_0[answered]
    off = np.linalg.norm(reference.vertices[match.p2p[at]] - reference.vertices[belongs], axis=1)
    error, expected = (
        100 * off.mean() / np.sqrt(reference.area),
        100 * np.nanmean(match.expected_error),
    )
    print(f"{match.name}: {error:.1f} %, expected {expected:.1f} %, familiar: {match.familiar}")

# %%
# Neither hole costs much here. But the large one changes the eigenfunctions so much that the scan
# is no longer familiar: a warning says so, and larger errors are expected than there are.
plot_functions(
    [whole, *scans],
    [match.expected_error for match in matches],
    captions=["undamaged", "small hole", "large hole"],
    labels=["expected error / sqrt(area)"],
    limits=(0, 0.1),
    cmap="magma_r",
)
plt.show()

# %%
# Labels of the reference come along where the match can be trusted.
front = np.where(reference.vertices[:, 1] > np.median(reference.vertices[:, 1]), "front", "back")
for match in matches:
    carried = match.transfer(front, max_error=0.05)
    n_front, n_back = ((carried.compressed() == label).sum() for label in ("front", "back"))
    print(f"{match.name}: {n_front} front, {n_back} back, {carried.mask.sum()} not trusted")

# %%
# The same with a cat of TOSCA, where ``SKFMAP_DATA`` names the folder that it is in.
data = Path(os.environ.get("SKFMAP_DATA", "")) / "tosca_isometric"
if os.environ.get("SKFMAP_DATA") and data.is_dir():
    cats = load_collection(data, "cat*", reference="cat0")
    model.fit(cats.meshes[:6], cats.correspondences[:6])
    holed = scanned(cats.meshes[8], radius=0.06)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (match,) = skfmap.match(model, [holed])
    plot_functions(
        [holed],
        [match.expected_error],
        captions=[holed.name],
        labels=["expected error / sqrt(area)"],
        limits=(0, 0.08),
        cmap="magma_r",
    )
    plt.show()
