"""A grid search over epsilon and weighting on the cats: its table, time and computed bases.

    python tests/benchmarks/grid_search.py [--jobs N] [--creatures]

20 settings in 5 folds, all on one reference. Then the same search inside an outer loop, which
scores its winner on shapes that the search did not see, against the default parameters.
``--creatures`` runs it on the embedded collection.
"""

import argparse
import contextlib
import io
import os
import sys
import tempfile
import time
from pathlib import Path

import joblib
import numpy as np
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, KFold
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap.datasets import load_collection, make_creatures
from skfmap.metrics import get_scorer
from skfmap.model_selection import PinnedReference

LEARNER = "weightedfunctionalmaplearner"
GRID = [
    {f"{LEARNER}__weighting": [None], f"{LEARNER}__alpha": [1e-4, 1e-3, 1e-2, 1e-1, 1.0]},
    {
        f"{LEARNER}__weighting": ["unique", "category", "function"],
        f"{LEARNER}__epsilon": ["auto", 0.03, 0.1, 0.3, 1.0],
    },
]
SCORER = get_scorer("neg_consistent_geodesic_error")
DATA = Path(os.environ.get("SKFMAP_DATA", Path(__file__).parents[3] / "shared" / "data"))


def make_model(location):
    memory = joblib.Memory(location, verbose=1)  # tells each call that is not in the cache
    return make_pipeline(
        skfmap.SpectralBasis(memory=memory),
        skfmap.DescriptorTransformer("paper", memory=memory),
        skfmap.WeightedFunctionalMapLearner(refine=None, memory=location),
    )


def search_of(model, n_splits, n_jobs):
    cv = PinnedReference(KFold(n_splits))
    return GridSearchCV(model, GRID, scoring=SCORER, cv=cv, n_jobs=n_jobs, error_score="raise")


@contextlib.contextmanager
def counted_calls(counts):
    """Count the calls that reach no cache, from this process and its workers, in one file."""
    with tempfile.TemporaryFile("w+") as told:
        sys.stdout.flush()
        kept = os.dup(1)
        os.dup2(told.fileno(), 1)
        try:
            yield
        finally:
            sys.stdout.flush()
            os.dup2(kept, 1)
            told.seek(0)
            text = told.read()
            counts["bases"] = text.count("Calling skfmap.basis._eigenbasis")
            counts["descriptors"] = text.count("Calling skfmap.descriptors._stacked")


def told(params):
    return ", ".join(f"{key.split('__')[1]}={value}" for key, value in params.items())


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument(
        "--creatures", action="store_true", help="the embedded collection instead of the cats"
    )
    parser.add_argument("--no-outer", action="store_true", help="the search alone")
    options = parser.parse_args()
    if options.creatures or not DATA.exists():
        data = make_creatures(n_shapes=11, n_vertices=2000)
    else:
        data = load_collection(DATA / "tosca_isometric", "cat*", reference="cat0")
    X, y = data.meshes, data.correspondences
    with tempfile.TemporaryDirectory() as location:
        counts, begun = {}, time.perf_counter()
        with counted_calls(counts):
            search = search_of(make_model(location), 5, options.jobs).fit(X, y)
        seconds = time.perf_counter() - begun
        results = search.cv_results_
        print(
            f"{len(results['params'])} settings x 5 folds on {len(X)} shapes, "
            f"n_jobs={options.jobs}: {seconds:.0f} s,"
        )
        print(
            f"from a cold cache {counts['bases']} bases and {counts['descriptors']} sets of "
            "probes computed.\n"
        )
        for i in np.argsort(results["rank_test_score"]):
            print(
                f"{-100 * results['mean_test_score'][i]:8.2f} +- "
                f"{100 * results['std_test_score'][i]:5.2f}  fit "
                f"{results['mean_fit_time'][i]:5.1f} s   {told(results['params'][i])}"
            )
        if options.no_outer:
            return
        print(
            "\nOuter loop: consistent error x 100 of the winner on shapes that its search did not "
            "see"
        )
        winners, defaults = [], []
        outer = PinnedReference(KFold(5))
        with contextlib.redirect_stdout(io.StringIO()):
            plain = make_model(location)
        for train, test in outer.split(X, y):
            part = [[items[i] for i in train] for items in (X, y)]
            rest = [[items[i] for i in test] for items in (X, y)]
            with counted_calls({}):
                inner = search_of(plain, 4, options.jobs).fit(*part)
                winners.append(-100 * inner.score(*rest))
                defaults.append(-100 * SCORER(clone(plain).fit(*part), *rest))
            print(
                f"{winners[-1]:8.2f} winner, {defaults[-1]:8.2f} default   "
                f"{told(inner.best_params_)}",
                flush=True,
            )
        print(f"{np.mean(winners):8.2f} winner, {np.mean(defaults):8.2f} default   mean")


if __name__ == "__main__":
    main()
