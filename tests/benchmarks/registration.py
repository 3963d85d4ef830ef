"""Errors of registered matches beside those of the start, on shapes left out.

    python tests/benchmarks/registration.py cats
    python tests/benchmarks/registration.py faust

Cats and horses are left out in turn. Of FAUST, people 0 to 2 are learned from in four poses each,
and people 3 and 4 are scored in four others. Needs the data folder (``SKFMAP_DATA``, else
``../shared/data`` beside the checkout).
"""

import argparse
import time
import warnings

import numpy as np
from joblib import Parallel, delayed
from paper_experiment import DATA
from scipy.stats import spearmanr
from threadpoolctl import threadpool_limits

from skfmap import DescriptorTransformer, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import load_collection
from skfmap.geometry.geodesics import mean_edge_length

FOLDERS = {
    "cats": ("tosca_isometric", "cat*", "cat0"),
    "horses": ("tosca_isometric", "horse*", "horse0"),
    "faust": ("faust", "tr_reg_0[0-4]*", "tr_reg_000"),
}
LEARNED_FROM = [10 * person + pose for person in (0, 1, 2) for pose in (0, 3, 6, 9)]
SCORED = [10 * person + pose for person in (3, 4) for pose in (1, 4, 7, 8)]


def folds(kind, n):
    """Return the shapes to learn from and to score, the reference first."""
    if kind == "faust":
        return [(LEARNED_FROM, SCORED)]
    return [([j for j in range(n) if j != i], [i]) for i in range(1, n)]


def one_fold(shapes, truths, train, test):
    """Return, for each shape, what the start and the registration are like."""
    rows = []
    with threadpool_limits(limits=1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        learner = WeightedFunctionalMapLearner(refine="register")
        learner.fit([shapes[i] for i in train], [truths[i] for i in train])
        for i in test:
            new, truth = [shapes[i]], [truths[i]]
            start, own = (
                learner.pair_errors(new, truth, method="dijkstra", refine=refine)[0]
                for refine in ("bijective-zoomout", "fitted")
            )
            (match,) = learner.match(new)
            started = time.perf_counter()
            (laid,) = learner.register(new)
            seconds = time.perf_counter() - started
            mesh = shapes[i].spectral.mesh
            rows.append(
                {
                    "name": shapes[i].name,
                    "start": 100 * start.mean(),
                    "registered": 100 * own.mean(),
                    "expected": 100 * float(np.mean(match.expected_error[own.vertices])),
                    "rank": spearmanr(match.expected_error[own.vertices], own.direct)[0],
                    "distance": np.median(laid.distance)
                    / mean_edge_length(mesh.vertices, mesh.faces),
                    "flipped": 100 * laid.n_flipped / len(laid.faces),
                    "fits": laid.fits,
                    "stiffness": learner.refine_.stiffness_,
                    "seconds": seconds,
                }
            )
    return rows


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("kind", choices=FOLDERS)
    kind = parser.parse_args().kind
    collection = load_collection(DATA / FOLDERS[kind][0], *FOLDERS[kind][1:])
    bases = SpectralBasis(n_jobs=2).transform(collection.meshes)
    shapes, truths = DescriptorTransformer(n_jobs=2).transform(bases), collection.correspondences
    found = Parallel(n_jobs=2)(
        delayed(one_fold)(shapes, truths, *fold) for fold in folds(kind, len(shapes))
    )
    rows = [row for fold in found for row in fold]
    columns = [name for name in rows[0] if name != "name"]
    print(f"{'':<14}" + "".join(f"{name:>12}" for name in columns))
    for row in rows:
        print(f"{row['name']:<14}" + "".join(f"{float(row[name]):>12.3f}" for name in columns))
    print(f"{'mean':<14}" + "".join(f"{np.mean([r[c] for r in rows]):>12.3f}" for c in columns))
    ratio = np.mean([r["registered"] for r in rows]) / np.mean([r["start"] for r in rows])
    print(f"registered over start: {ratio:.3f}")


if __name__ == "__main__":
    main()
