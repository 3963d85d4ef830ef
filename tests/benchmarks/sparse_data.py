"""How errors grow with fewer landmarks or shapes and with wrong correspondences, on the cats.

    python tests/benchmarks/sparse_data.py

Needs the data folder (``SKFMAP_DATA``, else ``../shared/data`` beside the checkout). Every other
cat is left out in turn; all of its pairs are scored.
"""

import argparse
import warnings

import numpy as np
from joblib import Parallel, delayed
from paper_experiment import DATA, SETS
from threadpoolctl import threadpool_limits

from skfmap import (
    Correspondence,
    DescriptorTransformer,
    SpectralBasis,
    WeightedFunctionalMapLearner,
)
from skfmap.datasets import load_collection
from skfmap.geometry.geodesics import farthest_vertices
from skfmap.metrics import pair_errors, reference_distances

# name: landmarks, training shapes beside the reference, share of wrong pairs, number of functions
SETTINGS = {
    "all pairs": (None, 9, 0.0, 50),
    "900 landmarks": (900, 9, 0.0, 50),
    "100 landmarks": (100, 9, 0.0, 50),
    "100 landmarks, k = 25": (100, 9, 0.0, 25),
    "36 landmarks, k = 18": (36, 9, 0.0, 18),
    "5 training shapes": (None, 4, 0.0, 50),
    "2 training shapes": (None, 1, 0.0, 50),
    "10 % wrong": (None, 9, 0.1, 50),
    "900 landmarks, 10 % wrong": (900, 9, 0.1, 50),
}


def spoiled(truths, points, share, seed):
    """Return correspondences on some template points, some of their vertices swapped at random."""
    out = []
    for i, truth in enumerate(truths):
        kept = truth.restrict(points)
        pairs, rng = kept.pairs.copy(), np.random.default_rng([seed, i])
        wrong = rng.random(len(pairs)) < (share if i else 0.0)
        pairs[wrong, 0] = rng.permutation(pairs[wrong, 0])
        out.append(Correspondence(pairs))
    return out


def run_fold(shapes, truths, points, setting, test, table):
    """Train without one shape and return its errors, before and after refinement."""
    _, n_training, share, k = setting
    train = [0, *[j for j in range(1, len(shapes)) if j != test][:n_training]]
    given = spoiled([truths[j] for j in train], points, share, test)
    with threadpool_limits(limits=1, user_api="blas"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        learner = WeightedFunctionalMapLearner(n_functions=k).fit([shapes[j] for j in train], given)
        p2ps = [
            learner.point_maps([shapes[test]], refine=refine)[0]
            for refine in (None, "bijective-zoomout")
        ]
        expected = learner.match([shapes[test]])[0].expected_error.mean()
    errors = [pair_errors(p2p, truths[test], truths[0], table) for p2p in p2ps]
    return [*(e.mean(kind) for e in errors for kind in ("direct", "consistent")), expected]


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--jobs", type=int, default=2, help="folds at a time")
    options = parser.parse_args()
    folder, pattern, reference = SETS["cats"]
    collection = load_collection(DATA / folder, pattern, reference)
    mesh, truths = collection.meshes[0], collection.correspondences
    shapes = DescriptorTransformer(n_jobs=2).transform(
        SpectralBasis(n_jobs=2).transform(collection.meshes)
    )
    table = reference_distances(mesh, n_jobs=2)
    table.rows(np.arange(mesh.n_vertices))
    print(
        "x 100 / sqrt(area)"
        + " " * 24
        + "match, direct / consistent    refined, direct / consistent    expected"
    )
    for name, setting in SETTINGS.items():
        points = truths[0].pairs[:, 1]
        if setting[0] is not None:
            spread, _ = farthest_vertices(
                mesh.vertices, mesh.faces, np.unique(truths[0].pairs[:, 0]), setting[0]
            )
            vertices, first = np.unique(truths[0].pairs[:, 0], return_index=True)
            points = truths[0].pairs[first[np.searchsorted(vertices, spread)], 1]
        calls = (
            delayed(run_fold)(shapes, truths, points, setting, i, table)
            for i in range(1, len(shapes), 2)
        )
        row = 100 * np.mean(Parallel(n_jobs=options.jobs)(calls), axis=0)
        print(f"{name:<34}" + "".join(f"{value:>14.2f}" for value in row), flush=True)


if __name__ == "__main__":
    main()
