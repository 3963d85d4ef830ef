"""
A texture from Blender, on every scan
=====================================

A model that was unwrapped and painted in Blender is laid onto a scan. Its file keeps the texture
coordinates and the material; only the positions of the vertices change.
"""

# %%
# What Blender exports: a file with vertices (``v``), texture coordinates of the corners of its
# faces (``vt``), and a picture. We make one here. The coordinates go once around the body's long
# axis, so that there is a seam, where a vertex has two.
import os
import tempfile
from pathlib import Path

import igl
import numpy as np
from matplotlib import pyplot as plt
from scipy.spatial.transform import Rotation
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap.datasets import load_collection, make_creatures
from skfmap.io import read_mesh
from skfmap.plotting import plot_function

folder = Path(tempfile.mkdtemp())
creatures = make_creatures(n_shapes=7, n_vertices=1500)


def unwrapped(mesh):
    """Return texture coordinates of the corners, around the longest axis and along it."""
    centred = mesh.vertices - mesh.vertices.mean(axis=0)
    across, up, along = centred[:, np.argsort(np.ptp(centred, axis=0))].T
    around = np.arctan2(across, up) / (2 * np.pi) + 0.5
    corners = np.stack([around, (along - along.min()) / np.ptp(along)], axis=1)[mesh.faces]
    crosses = np.ptp(corners[:, :, 0], axis=1) > 0.5  # the seam: count on past one turn
    corners[crosses, :, 0] += corners[crosses, :, 0] < 0.5
    return corners


def write_textured(path, vertices, faces, corners):
    """Write what Blender's exporter writes: an OBJ file and its material."""
    lines = [f"mtllib {path.stem}.mtl", "usemtl paint"]
    lines += ["v {:.6f} {:.6f} {:.6f}".format(*row) for row in vertices]
    lines += ["vt {:.6f} {:.6f}".format(*row) for row in corners.reshape(-1, 2)]
    numbers = np.arange(1, faces.size + 1).reshape(-1, 3)
    for face, of_texture in zip(faces + 1, numbers, strict=True):
        lines.append("f " + " ".join(f"{v}/{t}" for v, t in zip(face, of_texture, strict=True)))
    path.write_text("\n".join(lines) + "\n")
    path.with_suffix(".mtl").write_text("newmtl paint\nmap_Kd paint.png\n")


rows, columns = np.mgrid[0:256, 0:256] / 256
stripes = (np.sin(2 * np.pi * (9 * rows + 0.35 * np.sin(4 * np.pi * columns))) > 0.2)[..., None]
paint = np.where(stripes, [0.35, 0.2, 0.1], [0.95, 0.75, 0.4])
plt.imsave(folder / "paint.png", paint)
drawn = creatures.meshes[0]
write_textured(folder / "tiger.obj", drawn.vertices, drawn.faces, unwrapped(drawn))

# %%
# The file is the reference. Texture coordinates split no vertices when it is read, so that it has
# the numbers of vertices that Blender shows.
reference = read_mesh(folder / "tiger.obj")
print(reference)
model = make_pipeline(
    skfmap.SpectralBasis(),
    skfmap.DescriptorTransformer(),
    skfmap.WeightedFunctionalMapLearner(refine="register", confidence=None),
)
model.fit([reference, *creatures.meshes[1:5]], creatures.correspondences[:5])

# %%
# Lay it onto scans that the model has not seen.
registered = skfmap.register(model, creatures.meshes[5:])
for one in registered:
    print(one)


# %%
# Write each as the same file with other vertices. Seams, material and picture stay as they are, and
# Blender opens it painted.
def write_moved(path, original, vertices):
    """Write a copy of an OBJ file with its vertices in other places."""
    moved = iter("v {:.6f} {:.6f} {:.6f}".format(*row) for row in vertices)
    lines = original.read_text().splitlines()
    path.write_text("\n".join(next(moved) if one.startswith("v ") else one for one in lines) + "\n")


for one in registered:
    write_moved(folder / f"{one.name}.obj", folder / "tiger.obj", one.vertices)


# %%
# What Blender will show, read back from the files.
def draw_textured(ax, path, onto=None):
    """Draw an OBJ file with its picture, turned as another mesh stands."""
    words = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([one[1:] for one in words if one[0] == "v"], dtype=float)
    coordinates = np.array([one[1:] for one in words if one[0] == "vt"], dtype=float)
    corners = np.array(
        [[c.split("/") for c in one[1:]] for one in words if one[0] == "f"], dtype=int
    )
    faces, of_texture = corners[:, :, 0].ravel() - 1, corners[:, :, 1].ravel() - 1
    vertices -= vertices.mean(axis=0)
    if onto is not None:
        turn, _ = Rotation.align_vectors(onto.vertices - onto.vertices.mean(axis=0), vertices)
        vertices = turn.apply(vertices)
    apart = np.arange(len(faces)).reshape(-1, 3)  # each face by itself, as the seam needs
    fine, fine_faces = igl.upsample(vertices[faces], apart, 2)
    flat = np.column_stack([coordinates[of_texture], np.zeros(len(faces))])
    at = igl.upsample(flat, apart, 2)[0][:, :2]
    picture = plt.imread(path.with_name("paint.png"))[..., :3]
    pixel = (at % 1 * 256).astype(int).clip(0, 255)
    plot_function(skfmap.Mesh(fine, fine_faces), picture[pixel[:, 1], pixel[:, 0]], ax=ax)
    ax.set_title(path.name, fontsize=10)


figure, axes = plt.subplots(1, 3, figsize=(11, 3.2), layout="constrained")
draw_textured(axes[0], folder / "tiger.obj")
for ax, one in zip(axes[1:], registered, strict=True):
    draw_textured(ax, folder / f"{one.name}.obj", onto=reference)
plt.show()

# %%
# The same on cats of TOSCA, where ``SKFMAP_DATA`` names the folder that they are in.
data = Path(os.environ.get("SKFMAP_DATA", "")) / "tosca_isometric"
if os.environ.get("SKFMAP_DATA") and data.is_dir():
    cats = load_collection(data, "cat*", reference="cat0")
    drawn = cats.meshes[0]
    write_textured(folder / "cat0.obj", drawn.vertices, drawn.faces, unwrapped(drawn))
    model.fit(cats.meshes[:6], cats.correspondences[:6])
    registered = skfmap.register(model, cats.meshes[7:9])
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.2), layout="constrained")
    draw_textured(axes[0], folder / "cat0.obj")
    for ax, one in zip(axes[1:], registered, strict=True):
        write_moved(folder / f"{one.name}.obj", folder / "cat0.obj", one.vertices)
        draw_textured(ax, folder / f"{one.name}.obj", onto=drawn)
    plt.show()
