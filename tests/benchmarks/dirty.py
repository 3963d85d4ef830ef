"""Mouse skulls as found: what was done to each, and landmark errors with each left out in turn.

    python tests/benchmarks/dirty.py [--functions K] [--vertices N] [--wrap auto|none]

Needs the skulls. Each landmark of the skull that is left out is where the one of the reference goes
(`Match.inverse`), and where the hand-placed one comes from (`Match.p2p`); errors are straight
lines in millimetres. Beside them, the distance of hand-placed landmarks from the vertices nearest
to them, and the landmarks of the reference put in place by a similarity that is fitted to the
skull's own.
"""

import argparse
import json
import tempfile
import time
import warnings

import numpy as np
from problems import DATA

from skfmap import DescriptorTransformer, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import load_collection


def positions(name):
    """Return hand-placed landmarks by label."""
    markup = json.loads((DATA / "skulls" / f"{name}.mrk.json").read_text())["markups"][0]
    return {p["label"]: np.array(p["position"]) for p in markup["controlPoints"]}


def by_similarity(points, onto):
    """Return points moved, turned and scaled onto others, by least squares."""
    a, b = points - points.mean(axis=0), onto - onto.mean(axis=0)
    U, s, Vt = np.linalg.svd(a.T @ b)
    sign = np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))])
    scale = (s * np.diag(sign)).sum() / (a**2).sum()
    return scale * a @ U @ sign @ Vt + onto.mean(axis=0)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--functions", type=int, default=30)
    parser.add_argument("--vertices", type=int, default=SpectralBasis().max_vertices)
    parser.add_argument("--wrap", choices=["auto", "none"], default="none")
    options = parser.parse_args()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        data = load_collection(DATA / "skulls")
        started = time.perf_counter()
        wrap = None if options.wrap == "none" else options.wrap
        basis = SpectralBasis(max_vertices=options.vertices, wrap=wrap, n_jobs=2)
        shapes = DescriptorTransformer(n_jobs=2).transform(basis.transform(data.meshes))
        print(f"bases and probes of 11 skulls: {time.perf_counter() - started:.1f} s")
    for one in told:
        print(*str(one.message).split("; "), sep="\n  ")
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        learner = WeightedFunctionalMapLearner(
            n_functions=options.functions, memory=cache, n_jobs=2
        )
        print(
            f"{'skull':<10}{'places':>8}{'inverse':>9}{'median':>8}{'p2p':>8}{'vertex':>8}{'similar':>8}"
        )
        for i in range(1, len(shapes)):
            rest = [j for j in range(len(shapes)) if j != i]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                learner.fit([shapes[j] for j in rest], [data.correspondences[j] for j in rest])
                (match,) = learner.match([shapes[i]])
            rows.append(errors(data, shapes, i, match))
            print(f"{data.names[i]:<10}" + "".join(f"{x:>8.3f}" for x in rows[-1]), flush=True)
    print(f"{'mean':<10}" + "".join(f"{x:>8.3f}" for x in np.mean(rows, axis=0)))


def errors(data, shapes, i, match):
    """Return the share of vertices with a place, and errors in millimetres."""
    own, reference = positions(data.names[i]), positions(data.names[0])
    labels = [label for label in reference if label in own]
    at, at_0 = (np.stack([one[label] for label in labels]) for one in (own, reference))
    vertices, vertices_0 = data.meshes[i].vertices, data.meshes[0].vertices
    nearest, nearest_0 = (
        np.argmin(((points[:, None] - mesh[None]) ** 2).sum(axis=2), axis=1)
        for points, mesh in ((at, vertices), (at_0, vertices_0))
    )
    there = match.inverse[nearest_0]
    inverse = np.linalg.norm(vertices[there] - at, axis=1)[there >= 0]
    back = match.p2p[nearest]
    forth = np.linalg.norm(vertices_0[back] - at_0, axis=1)[back >= 0]
    similar = np.linalg.norm(by_similarity(at_0, at) - at, axis=1)
    to_vertex = np.linalg.norm(vertices[nearest] - at, axis=1)
    placed = shapes[i].spectral.prolongation.placed.mean()
    return [
        placed,
        inverse.mean(),
        np.median(inverse),
        forth.mean(),
        to_vertex.mean(),
        similar.mean(),
    ]


if __name__ == "__main__":
    main()
