"""Cats left out in turn, with few landmarks on each training shape instead of all pairs.

    python tests/benchmarks/few_landmarks.py
    python tests/benchmarks/few_landmarks.py --counts 13 --tested 2

Needs the data folder (``SKFMAP_DATA``, else ``../shared/data`` beside the checkout). Landmarks are
farthest points of the reference along edges, the first of the template's begins. Errors are refined
ones, direct, over all vertices of the cat left out. Intervals are of the bootstrap over the cats
left out, 95 %; the last is of the difference to all pairs, cat by cat. Seconds are of fits that
find the maps of some shapes in a cache, as other folds have built them.
"""

import argparse
import tempfile
import time
import warnings

import numpy as np
from joblib import Parallel, delayed
from paper_experiment import DATA, SETS
from sklearn.model_selection import LeaveOneOut
from threadpoolctl import threadpool_limits

from skfmap import DescriptorTransformer, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import load_collection
from skfmap.geometry.geodesics import farthest_vertices
from skfmap.metrics import pair_errors, reference_distances
from skfmap.model_selection import PinnedReference

COUNTS = (13, 25, 50)


def well_spread(mesh, truth, n_points):
    """Return template points, each of which is farthest on a mesh from those before it."""
    point_of = dict(truth.pairs.tolist())
    at_unit_area = mesh.vertices / np.sqrt(mesh.area)
    chosen, _ = farthest_vertices(at_unit_area, mesh.faces, truth.pairs[:, 0], n_points)
    return [point_of[vertex] for vertex in chosen]


def run_fold(shapes, given, scored, split, tables, memory):
    """Train on a fold; return errors, what was expected, landmark errors and seconds."""
    train, (test,) = split
    with threadpool_limits(limits=1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        started = time.perf_counter()
        learner = WeightedFunctionalMapLearner(memory=memory)
        learner.fit([shapes[j] for j in train], [given[j] for j in train])
        seconds = time.perf_counter() - started
        (match,) = learner.match([shapes[test]])
        heat, edges = (pair_errors(match.p2p, scored[test], scored[0], table) for table in tables)
        expected = match.expected_error[heat.vertices].mean()
    means = heat.mean("direct"), edges.mean("direct"), expected
    return *means, learner.known_maps_.mean_error, seconds


def interval(values, n_samples=2000):
    """Return the 95 % interval of the mean."""
    rows = np.random.default_rng(0).integers(0, len(values), (n_samples, len(values)))
    return np.quantile(np.asarray(values)[rows].mean(axis=1), [0.025, 0.975])


def report(name, folds, whole):
    """Print a row."""
    heat, edges, expected, left_out, seconds = np.array(folds).T
    more = edges - whole
    print(
        f"{name:<12}{edges.mean():>8.4f}  [{interval(edges)[0]:.4f}, {interval(edges)[1]:.4f}]"
        f"{heat.mean():>9.4f}{expected.mean():>10.4f}{expected.mean() / heat.mean():>7.2f}"
        f"{left_out.mean():>11.3f}{more.mean():>+10.4f}  [{interval(more)[0]:+.4f}, "
        f"{interval(more)[1]:+.4f}]{np.median(seconds):>8.1f} s",
        flush=True,
    )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--counts", type=int, nargs="*", default=COUNTS, help="landmarks")
    parser.add_argument("--tested", type=int, default=None, help="cats left out; all by default")
    parser.add_argument("--jobs", type=int, default=2, help="folds at a time")
    options = parser.parse_args()
    folder, pattern, reference = SETS["cats"]
    collection = load_collection(DATA / folder, pattern, reference)
    meshes, truths = collection.meshes, collection.correspondences
    spectral = SpectralBasis(n_jobs=options.jobs).transform(meshes)
    shapes = DescriptorTransformer(n_jobs=options.jobs).transform(spectral)
    tables = [reference_distances(meshes[0], method) for method in ("heat", "dijkstra")]
    for table in tables:
        table.rows(np.arange(meshes[0].n_vertices))
    points = well_spread(meshes[0], truths[0], max(options.counts))
    folds = list(PinnedReference(LeaveOneOut()).split(range(len(shapes))))[: options.tested]
    print(
        f"{len(folds)} cats left out in turn, reference {reference}; sqrt(area)\n"
        f"{'landmarks':<12}{'by edge paths':>26}{'heat':>9}{'expected':>10}{'ratio':>7}"
        f"{'left out':>11}{'more than all pairs':>28}{'fit':>10}"
    )
    whole = None
    for n in (None, *options.counts):
        given = truths if n is None else [truth.restrict(points[:n]) for truth in truths]
        with tempfile.TemporaryDirectory() as memory:  # folds share the maps that are built
            how = (tables, memory)
            calls = (delayed(run_fold)(shapes, given, truths, split, *how) for split in folds)
            found = Parallel(n_jobs=options.jobs)(calls)
        whole = np.array(found)[:, 1] if n is None else whole
        report("all pairs" if n is None else str(n), found, whole)


if __name__ == "__main__":
    main()
