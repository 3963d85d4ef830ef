"""Maps of shapes that were not learned from: to the reference, and between all pairs of them.

    python tests/benchmarks/unseen.py cats --refine register
    python tests/benchmarks/unseen.py animals
    python tests/benchmarks/unseen.py faust --training 10

Cats, horses and animals are left out in three or four parts. Of FAUST, people 0 to 4 are learned
from (in ten poses each, or in fewer) and people 5 to 9 are scored; ``faust-dev`` learns from people
0 to 2 and scores 3 and 4. Errors are direct, along edges, times 100 over sqrt(area) of the shape
that a map goes to, at 1,000 template points; every ordered pair counts, pairs of a shape with
itself do not. The floor is what repeated rows of the correspondences cost any map of vertices.
Intervals of 95 % are bootstrapped over shapes. Needs the data folder (``SKFMAP_DATA``, else
``../shared/data`` beside the checkout).
"""

import argparse
import itertools
import time
import warnings

import numpy as np
import scipy.sparse as sp
from joblib import Parallel, delayed
from paper_experiment import DATA
from scipy.sparse.csgraph import dijkstra
from scipy.stats import spearmanr
from threadpoolctl import threadpool_limits

from skfmap import DescriptorTransformer, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import load_collection

FOLDERS = {
    "cats": ("tosca_isometric", "cat*", "cat0", 3),
    "horses": ("tosca_isometric", "horse*", "horse0", 3),
    "animals": ("smal_train", "*", None, 4),
    "faust": ("faust", "tr_reg_*", "tr_reg_000", None),
    "faust-dev": ("faust", "tr_reg_0[0-4]*", "tr_reg_000", None),
}
PEOPLE = {"faust": (5, 10), "faust-dev": (3, 5)}
N_POINTS, N_RESAMPLED = 1000, 1000


def splits(kind, names, n_training):
    """Return the shapes to learn from, the reference first, and those to score."""
    n_parts = FOLDERS[kind][3]
    if n_parts is None:
        learned, end = PEOPLE[kind]
        person = [int(name[-2]) for name in names]
        train = [i for i, one in enumerate(person) if one < learned]
        if n_training is not None:
            train = [train[j] for j in np.linspace(0, len(train) - 1, n_training).astype(int)]
        return [(train, [i for i, one in enumerate(person) if learned <= one < end])]
    first = 0 if kind == "animals" else 1  # cat0 and horse0 stand, and are always learned from
    others = range(first, len(names))
    return [
        ([i for i in range(len(names)) if i not in others[part::n_parts]], [*others[part::n_parts]])
        for part in range(n_parts)
    ]


class Target:
    """A shape that maps go to: distances of all vertices from where template points lie."""

    def __init__(self, shape, truth, points):
        mesh = shape.spectral.mesh
        corners = mesh.vertices[mesh.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        scale = np.sqrt(np.linalg.norm(normals, axis=1).sum() / 2)
        ends = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, 1, 1)], 2).reshape(-1, 2), axis=1)
        ends = np.unique(ends, axis=0)
        lengths = np.linalg.norm(np.diff(mesh.vertices[ends], axis=1)[:, 0], axis=1)
        graph = sp.coo_array((lengths, tuple(ends.T)), shape=(mesh.n_vertices,) * 2).tocsr()
        self.at = np.full(points.max() + 1, -1)
        known = truth.pairs[truth.pairs[:, 1] <= points.max()]
        self.at[known[:, 1]] = known[:, 0]
        self.at = self.at[points]
        rows, self.row = np.unique(np.maximum(self.at, 0), return_inverse=True)
        self.distances = dijkstra(graph, directed=False, indices=rows) / scale

    def errors(self, source, p2p):
        """Return the errors of a map from a shape to this one, at the points that both know."""
        both = (source.at >= 0) & (self.at >= 0)
        return self.distances[self.row[both], p2p[source.at[both]]], source.at[both]

    def floor(self, source):
        """Return the mean error of the best map of vertices."""
        both = np.flatnonzero((source.at >= 0) & (self.at >= 0))
        lost = 0.0
        for vertex in np.unique(source.at[both]):
            rows = both[source.at[both] == vertex]
            if len(rows) > 1:
                lost += self.distances[np.ix_(self.row[rows], self.at[rows])].sum(axis=0).min()
        return lost / len(both)


def interval(errors, n, rng):
    """Return the bootstrap interval of a mean over pairs, shapes drawn again."""
    table = np.full((n, n), np.nan)
    for (a, b), error in errors.items():
        table[a, b] = error
    means = []
    for _ in range(N_RESAMPLED):
        drawn = rng.integers(n, size=n)
        if len(np.unique(drawn)) > 1:
            means.append(np.nanmean(table[np.ix_(drawn, drawn)]))
    return np.nanquantile(means, [0.025, 0.975])


def one_split(kind, shapes, truths, train, test, refine):
    """Return errors to the reference and between pairs, and what was expected of them."""
    points = np.sort(
        np.random.default_rng(0).choice(
            min(truth.pairs[:, 1].max() + 1 for truth in truths), N_POINTS, replace=False
        )
    )
    targets = Parallel(n_jobs=2)(
        delayed(Target)(shapes[i], truths[i], points) for i in [train[0], *test]
    )
    reference, targets = targets[0], targets[1:]
    with threadpool_limits(limits=1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        started = time.perf_counter()
        learner = WeightedFunctionalMapLearner(refine=refine, n_jobs=2)
        learner.fit([shapes[i] for i in train], [truths[i] for i in train])
        fitted = time.perf_counter()
        matches = learner.match([shapes[i] for i in test])
        matched = time.perf_counter()
        pairs = list(itertools.permutations(range(len(test)), 2))
        between = learner.match_between([shapes[i] for i in test], pairs)
        ended = time.perf_counter()
    rows = []
    for i, source, match in zip(test, targets, matches, strict=True):
        errors, vertices = reference.errors(source, match.p2p)
        expected = match.expected_error[vertices]
        half = errors[np.argsort(expected, kind="stable")[: len(errors) // 2]].mean()
        rows.append(
            {
                "name": shapes[i].name,
                "error": errors.mean(),
                "expected": expected.mean(),
                "trusted half": half / errors.mean(),
                "rank": spearmanr(expected, errors)[0],
                "familiar": match.familiar,
            }
        )
    chained, direct, told, floors = {}, {}, {}, {}
    for (a, b), match in zip(pairs, between, strict=True):
        chained[a, b] = targets[b].errors(targets[a], matches[a].to(matches[b])[0])[0].mean()
        errors, vertices = targets[b].errors(targets[a], match.p2p)
        direct[a, b], told[a, b] = errors.mean(), match.expected_error[vertices].mean()
        floors[a, b] = targets[b].floor(targets[a])
    seconds = fitted - started, (matched - fitted) / len(test), (ended - matched) / len(pairs)
    return rows, (chained, direct, told, floors), seconds


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("kind", choices=FOLDERS)
    parser.add_argument("--refine", default="register")
    parser.add_argument("--training", type=int, help="shapes of FAUST to learn from")
    options = parser.parse_args()
    folder, pattern, reference, _ = FOLDERS[options.kind]
    collection = load_collection(DATA / folder, pattern, reference)
    bases = SpectralBasis(n_jobs=2).transform(collection.meshes)
    shapes, truths = DescriptorTransformer(n_jobs=2).transform(bases), collection.correspondences
    to_reference, between, told, rng = [], [], [], np.random.default_rng(0)
    for train, test in splits(options.kind, [one.name for one in shapes], options.training):
        rows, pairs, seconds = one_split(options.kind, shapes, truths, train, test, options.refine)
        for row in rows:
            print(
                f"{row['name']:<34} error {100 * row['error']:5.2f}  expected "
                f"{100 * row['expected']:5.2f}  trusted half {row['trusted half']:.2f}  "
                f"rank {row['rank']:.2f}  familiar {row['familiar']}"
            )
        means = [100 * np.mean(list(one.values())) for one in pairs]
        low, high = 100 * interval(pairs[1], len(test), rng)
        print(
            f"learned from {len(train)}: chained {means[0]:.2f}, between {means[1]:.2f} "
            f"[{low:.2f}, {high:.2f}], worst {100 * max(pairs[1].values()):.2f}, expected "
            f"{means[2]:.2f}, floor {means[3]:.2f}; fit {seconds[0]:.0f} s, a match "
            f"{seconds[1]:.2f} s, a pair {seconds[2]:.2f} s on two cores",
            flush=True,
        )
        to_reference += [(row["error"], row["expected"], row["trusted half"]) for row in rows]
        between += list(pairs[1].values())
        told += list(pairs[2].values())
    errors, expected, halves = np.transpose(to_reference)
    resampled = rng.integers(len(errors), size=(N_RESAMPLED, len(errors)))
    low, high = np.quantile(100 * errors[resampled].mean(axis=1), [0.025, 0.975])
    print(
        f"{options.kind}, {options.refine}: to the reference {100 * errors.mean():.2f} "
        f"[{low:.2f}, {high:.2f}], worst shape {100 * errors.max():.2f}, expected over true "
        f"{expected.mean() / errors.mean():.2f}, trusted half {halves.mean():.2f}; pairs "
        f"{100 * np.mean(between):.2f}, median {100 * np.median(between):.2f}, expected over true "
        f"{np.mean(told) / np.mean(between):.2f}"
    )


if __name__ == "__main__":
    main()
