"""Memory against the number of training shapes: paths of large meshes, read, thinned and dropped.

    python tests/benchmarks/many.py [MOST]

Creatures are subdivided to 100,000 vertices and written to a folder; models are fitted on 10, 50
and 200 of the paths, up to MOST, each in a process of its own. Workers are counted too.
"""

import multiprocessing
import os
import sys
import tempfile
import threading
import time
import warnings
from pathlib import Path

import igl
import numpy as np
import trimesh
from sklearn.pipeline import make_pipeline

from skfmap import Correspondence, DescriptorTransformer, SpectralBasis
from skfmap import WeightedFunctionalMapLearner as Learner
from skfmap.datasets import make_creatures

N_TRAINING = (10, 50, 200)


def write(folder, n):
    """Write n scans of some 100,000 vertices, and return their paths and correspondences.

    Ten bodies, each roughened anew.
    """
    creatures = make_creatures(n_shapes=10, n_vertices=6300)
    rng, paths, truths = np.random.default_rng(0), [], []
    for i in range(n):
        body, truth = creatures.meshes[i % 10], creatures.correspondences[i % 10]
        vertices, faces = igl.upsample(body.vertices, body.faces, 2)
        edge = np.sqrt(body.area / len(vertices))
        vertices = vertices + 0.1 * edge * rng.standard_normal(vertices.shape)
        paths.append(str(Path(folder) / f"scan{i:03}.ply"))
        trimesh.Trimesh(vertices, faces, process=False).export(paths[-1])
        truths.append(Correspondence(truth.pairs))
    return paths, truths


def memory(pid):
    """Return the bytes that a process and its children hold, shared ones once at least."""
    total = 0
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
        except OSError:
            continue
        if int(lines["Pid"]) == pid or int(lines["PPid"]) == pid:
            total += 1024 * int(lines.get("VmRSS", "0 kB").split()[0])
    return total


def one_fit(paths, truths):
    """Fit a model, and print what it took."""
    warnings.simplefilter("ignore")
    peak, done = [0], threading.Event()

    def watch():
        while not done.wait(0.2):
            peak[0] = max(peak[0], memory(os.getpid()))

    watcher = threading.Thread(target=watch)
    watcher.start()
    started = time.perf_counter()
    shapes = DescriptorTransformer(n_jobs=2).transform(SpectralBasis(n_jobs=2).transform(paths))
    prepared = time.perf_counter() - started
    each = shapes[1].spectral
    held = each.evecs.nbytes + each.mesh.vertices.nbytes + each.mesh.faces.nbytes + each.mass.nbytes
    held += 12 * each.stiffness.nnz + shapes[1].probes.nbytes
    started = time.perf_counter()
    make_pipeline(Learner(n_jobs=2)).fit(shapes, truths)
    done.set()
    watcher.join()
    print(
        f"{len(paths):>6}{prepared:>14.1f}{time.perf_counter() - started:>10.1f}"
        f"{peak[0] / 2**30:>10.2f}{held / 2**20:>14.1f}"
        f"{(each.prolongation.face.nbytes + each.prolongation.coordinates.nbytes) / 2**20:>8.1f}",
        flush=True,
    )


def main():
    most = int(sys.argv[1]) if len(sys.argv) > 1 else max(N_TRAINING)
    with tempfile.TemporaryDirectory() as folder:
        paths, truths = write(folder, most)
        print("shapes  bases, probes s   fit s  peak GiB  MiB per shape  places")
        context = multiprocessing.get_context("spawn")
        for n in (n for n in N_TRAINING if n <= most):
            process = context.Process(target=one_fit, args=(paths[:n], truths[:n]))
            process.start()
            process.join()


if __name__ == "__main__":
    main()
