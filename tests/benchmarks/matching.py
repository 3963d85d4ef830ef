"""Errors of maps, of their refinement and of the expectation, on shapes left out in turn.

    python tests/benchmarks/matching.py cats
    python tests/benchmarks/matching.py horses
    python tests/benchmarks/matching.py women-split
    python tests/benchmarks/matching.py women-split --bridge
    python tests/benchmarks/matching.py cats --routes

The last compares the first route of matching with the one of today, in one run.

Needs the data folder (``SKFMAP_DATA``, else ``../shared/data`` beside the checkout). Cats are the
development set: every default, and both settings below, were chosen on them. Of the women, one half
of the landmarks is given to ``fit``, the other half is scored; all twelve are left out in turn.
"""

import argparse
import time
import warnings

import numpy as np
from joblib import Parallel, delayed
from paper_experiment import DATA, SETS, halves
from scipy.stats import spearmanr
from sklearn.model_selection import LeaveOneOut
from sklearn.neighbors import NearestNeighbors
from threadpoolctl import threadpool_limits

from skfmap import (
    BridgedLearner,
    DescriptorTransformer,
    SpectralBasis,
    WeightedFunctionalMapLearner,
)
from skfmap.datasets import load_collection
from skfmap.functional import map_from_point_maps, spectral_embeddings, trusted_functions
from skfmap.metrics import pair_errors, reference_distances
from skfmap.model_selection import PinnedReference
from skfmap.refinement import BijectiveZoomOut, Refinement, match_points

SETTINGS = {
    "default, 50 functions": {},
    "80 functions, resolvent": {"n_functions": 80, "regularizer": "resolvent"},
}
REFINEMENTS = (None, "icp", "zoomout", "bijective-zoomout")


class OldRoute(Refinement):
    """Eleven single steps on all vertices, with scikit-learn's search in each direction."""

    def refine(self, learned, spectral, match):
        spectral_0, n, p2p, inverse = learned.reference.spectral, 0, match.p2p, match.inverse
        most, k = len(learned.truncation_covariance), len(learned.stable_basis)
        for n in [*range(k, most, 10), *4 * [most]]:
            evecs, evecs_0 = spectral.evecs[:, :n], spectral_0.evecs[:, :n]
            C = map_from_point_maps(evecs, evecs_0, spectral.mass, spectral_0.mass, p2p, inverse)
            functions = trusted_functions(learned.truncation_covariance[:n, :n])
            points, points_0 = spectral_embeddings(evecs, evecs_0, C, functions)
            p2p, inverse = old_search(points, points_0), old_search(points_0, points)
        return match._replace(
            refined_map=C, points_i=points, points_0=points_0, p2p=p2p, inverse=inverse
        )


def old_search(points, targets):
    """Return the nearest target of each point, as it was found at first."""
    search = NearestNeighbors(n_neighbors=2, algorithm="brute").fit(targets)
    distances, found = search.kneighbors(points)
    slack = 1e-9 * np.square(points).sum(axis=1)
    first = found[:, 0].copy()
    for row in np.flatnonzero(np.ptp(np.square(distances), axis=1) <= slack):
        squared = np.square(targets - points[row]).sum(axis=1)
        first[row] = np.argmax(squared <= squared.min() + slack[row])
    return first


def compare_routes(shapes, given, scored, folds, table):
    """Print errors and processor time of the old and of the new route, by turns in one run."""
    rows = []
    for train, (test,) in folds:
        with threadpool_limits(limits=1, user_api="blas"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            learner = WeightedFunctionalMapLearner(confidence=None)
            learner.fit([shapes[j] for j in train], [given[j] for j in train])
            matcher, spectral = learner.matcher_, shapes[test].spectral
            known = spectral, matcher.reference.spectral
            C, functions = matcher.solve(shapes[test]).C, matcher.functions
            before, new_search = timed(match_points, *known, C, functions)
            points, points_0 = before.points_i, before.points_0
            p2p, one = timed(old_search, points, points_0)
            inverse, other = timed(old_search, points_0, points)
            same = (p2p == before.p2p).all() and (inverse == before.inverse).all()
            old, old_seconds = timed(OldRoute().refine, matcher, spectral, before)
            new, new_seconds = timed(BijectiveZoomOut().refine, matcher, spectral, before)
            errors = [
                pair_errors(match.p2p, scored[test], scored[0], table).mean("direct")
                for match in (old, new)
            ]
            rows.append(
                [
                    one + other,
                    new_search,
                    same,
                    old_seconds,
                    new_seconds,
                    *(100 * error for error in errors),
                    (old.p2p == new.p2p).mean(),
                ]
            )
    names = (
        "search in both directions, old: processor seconds",
        "search in both directions, new",
        "share of shapes whose matches are the same to the last",
        "refinement, old: processor seconds",
        "refinement, new",
        "error x 100 / sqrt(area), old (heat method)",
        "error, new",
        "share of vertices matched alike",
    )
    for name, values in zip(names, zip(*rows, strict=True), strict=True):
        print(f"{name:<58}{np.mean(values):>8.3f}")


def timed(function, *arguments):
    """Return what a function returns, and the processor time that it took."""
    started = time.process_time()
    result = function(*arguments)
    return result, time.process_time() - started


def run_fold(shapes, given, scored, split, parameters, tables, refinements, bridge):
    """Train on one fold, match the shape left out, and return what each refinement showed."""
    train, (test,) = split
    with threadpool_limits(limits=1, user_api="blas"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        started = time.perf_counter()
        learner = WeightedFunctionalMapLearner(**parameters, refine=refinements[-1])
        learner = BridgedLearner(learner) if bridge else learner
        learner.fit([shapes[j] for j in train], [given[j] for j in train])
        fitting, found = time.perf_counter() - started, {}
        for refine in refinements:
            started = time.perf_counter()
            (match,) = learner.match([shapes[test]], refine=refine)
            seconds = time.perf_counter() - started
            heat, edges = (
                pair_errors(match.p2p, scored[test], scored[0], table) for table in tables
            )
            means = [
                errors.mean(kind) for errors in (heat, edges) for kind in ("direct", "consistent")
            ]
            expected = (
                match.expected_error[heat.vertices] if refine in (None, refinements[-1]) else None
            )
            found[refine] = (means, seconds, heat.direct, expected)
    return (
        found,
        fitting,
        getattr(learner, "bridge_errors_", {}),
        getattr(learner, "bridge_", None) is not None,
    )


def report(name, folds, refinements):
    """Print the rows of one setting."""
    for refine in refinements:
        rows = [found[refine] for found, *_ in folds]
        cells = "".join(
            f"{value:>9.2f}" for value in 100 * np.mean([means for means, *_ in rows], axis=0)
        )
        seconds = np.median([time for _, time, *_ in rows])
        print(f"{name:<26}{refine!s:<20}{cells}{seconds:>8.2f} s")
        if rows[0][3] is None:
            continue
        errors, expected = (np.concatenate([row[j] for row in rows]) for j in (2, 3))
        trusted = expected <= np.median(expected)
        print(
            f"{'':<46}expected {100 * expected.mean():.2f}, true {100 * errors.mean():.2f}; the "
            f"half most trusted has {errors[trusted].mean() / errors.mean():.3f} of the mean "
            f"error; rank correlation {spearmanr(expected, errors)[0]:.3f}"
        )
        for part in np.array_split(np.argsort(expected), 5):
            print(
                f"{'':<46}  expected {100 * expected[part].mean():6.2f}  true "
                f"{100 * errors[part].mean():6.2f}"
            )
    print(f"{'':<26}fit {np.median([fitting for _, fitting, *_ in folds]):.1f} s", flush=True)
    if folds[0][2]:
        ways = {
            way: round(100 * np.mean([errors[way] for *_, errors, _ in folds]), 2)
            for way in folds[0][2]
        }
        print(
            f"{'':<26}errors on training shapes left out {ways}; bridges taken "
            f"{sum(taken for *_, taken in folds)}"
        )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", choices=[name for name in SETS if name != "women"])
    parser.add_argument("--jobs", type=int, default=2, help="folds at a time")
    parser.add_argument("--bridge", action="store_true", help="let the learner look for a bridge")
    parser.add_argument("--register", action="store_true", help="also laid; defaults alone")
    parser.add_argument("--all", action="store_true", help="also ICP and ZoomOut as published")
    parser.add_argument("--routes", action="store_true", help="compare old and new route")
    parser.add_argument("--components", type=int, default=120)
    options = parser.parse_args()
    folder, pattern, reference = SETS[options.dataset]
    collection = load_collection(DATA / folder, pattern, reference)
    given, scored = halves(collection.correspondences, "noniso" in folder)
    spectral = SpectralBasis(options.components, n_jobs=2).transform(collection.meshes)
    shapes = DescriptorTransformer(n_jobs=2).transform(spectral)
    tables = [
        reference_distances(collection.meshes[0], method, n_jobs=2)
        for method in ("heat", "dijkstra")
    ]
    for table in tables:
        table.rows(np.arange(collection.meshes[0].n_vertices))
    folds = list(PinnedReference(LeaveOneOut()).split(range(len(shapes))))
    if options.routes:
        return compare_routes(shapes, given, scored, folds, tables[0])
    refinements = REFINEMENTS if options.all else (None, "bijective-zoomout")
    settings = list(SETTINGS.items())
    if options.register:
        refinements, settings = (*refinements, "register"), settings[:1]
    print(
        f"{options.dataset}: {len(shapes) - 1} shapes left out in turn, reference {reference}; x "
        "100 / sqrt(area)"
    )
    print(
        f"{'':<46}{'heat method':^18}{'edge paths':^18}\n{'':<46}"
        + f"{'direct':>9}{'consist.':>9}" * 2
        + "   match"
    )
    for name, parameters in settings:
        how = (parameters, tables, refinements, options.bridge)
        calls = (delayed(run_fold)(shapes, given, scored, split, *how) for split in folds)
        report(name, Parallel(n_jobs=options.jobs)(calls), refinements)
    return None


if __name__ == "__main__":
    main()
