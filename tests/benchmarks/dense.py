"""Scans of up to a million vertices: time and peak memory of each stage, and errors.

    python tests/benchmarks/dense.py [MOST]

A creature that was not trained on is subdivided and roughened until it has 10,000 vertices and
more, up to MOST (1,300,000), written as a binary PLY file, and matched by a model of five creatures
of 5,000. Each size is a process of its own. Then the same by hand: the mesh thinned to the working
size, matched, and each vertex given the answer of the nearest one in space.
"""

import multiprocessing
import pickle
import resource
import sys
import tempfile
import time
import warnings
from pathlib import Path

import igl
import numpy as np
import trimesh
from scipy.spatial import KDTree
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import DescriptorTransformer, Mesh, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import make_creatures
from skfmap.geometry.thinning import thin
from skfmap.io import read_mesh

# Vertices of the creature that is subdivided, how often, and about how many it has then.
SIZES = ((2500, 1), (7500, 1), (6250, 2), (4700, 3), (20000, 2), (5000, 4))


def make_scan(n_vertices, times, path):
    """Write a dense, rough creature; its first vertices are those of the creature itself."""
    creatures = make_creatures(n_shapes=6, n_vertices=n_vertices)
    body, truth = creatures.meshes[5], creatures.correspondences[5]
    vertices, faces = igl.upsample(body.vertices, body.faces, times)
    edge = np.sqrt(body.area / len(vertices))
    vertices = vertices + 0.1 * edge * np.random.default_rng(0).standard_normal(vertices.shape)
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    return truth


def stages(model, path):
    """Yield the name of each stage, and its result, from the file to the refined match."""
    basis, probes, learner = (step for _, step in model.steps)
    mesh = yield "read", lambda: read_mesh(path)
    shapes = yield "working mesh and basis", lambda: basis.transform([mesh])
    shapes = yield "probes", lambda: probes.transform(shapes)
    yield "match", lambda: learner.match(shapes)


def one_scan(model_file, n_vertices, times):
    """Print a line for one size."""
    warnings.simplefilter("ignore")
    model, reference, truth_0 = pickle.loads(Path(model_file).read_bytes())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scan.ply"
        truth = make_scan(n_vertices, times, path)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        seconds, match = [], None
        run = stages(model, path)
        _, stage = next(run)
        while True:
            started = time.perf_counter()
            match = stage()
            seconds.append(time.perf_counter() - started)
            try:
                _, stage = run.send(match)
            except StopIteration:
                break
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        by_hand = thinned_by_hand(model, read_mesh(path))
        errors = [error(p2p, truth, reference, truth_0) for p2p in (match[0].p2p, by_hand)]
        print(
            f"{len(match[0].p2p):>9}"
            + "".join(f"{one:>8.2f}" for one in (*seconds, sum(seconds)))
            + f"{max(before, peak) / 2**20:>8.2f}"
            + "".join(f"{100 * one:>9.2f}" for one in errors),
            flush=True,
        )


def thinned_by_hand(model, mesh):
    """Return the point map of the thinned mesh, carried over to the nearest vertices in space."""
    small = thin(mesh.vertices, mesh.faces, model[0].max_vertices)
    (match,) = skfmap.match(model, [Mesh(small.vertices, small.faces, "thinned")])
    return match.p2p[KDTree(small.vertices).query(mesh.vertices)[1]]


def error(p2p, truth, reference, truth_0):
    """Return the mean error of a point map at the vertices of the creature, over sqrt(area)."""
    joined = truth.join(truth_0)
    at = reference.vertices[p2p[joined.vertices_i]] - reference.vertices[joined.vertices_0]
    return float(np.linalg.norm(at, axis=1).mean() / np.sqrt(reference.area))


def main():
    most = int(sys.argv[1]) if len(sys.argv) > 1 else 1_300_000
    creatures = make_creatures(n_shapes=5, n_vertices=5000)
    model = make_pipeline(SpectralBasis(), DescriptorTransformer(), WeightedFunctionalMapLearner())
    started = time.perf_counter()
    model.fit(creatures.meshes, creatures.correspondences)
    print(f"fit on five creatures of 5,000 vertices: {time.perf_counter() - started:.1f} s")
    stored = model, creatures.meshes[0], creatures.correspondences[0]
    names = ("read", "basis", "probes", "match", "all", "GiB", "error", "by hand")
    widths = [8] * 6 + [9] * 2
    heads = [f"{name:>{width}}" for name, width in zip(names, widths, strict=True)]
    print(f"{'vertices':>9}" + "".join(heads))
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.pickle"
        file.write_bytes(pickle.dumps(stored))
        for n_vertices, times in SIZES:
            if n_vertices * 4**times <= most:
                process = context.Process(target=one_scan, args=(file, n_vertices, times))
                process.start()
                process.join()


if __name__ == "__main__":
    main()
