"""Whether the verdicts of a report on expected errors are right, on shapes left out.

    python tests/benchmarks/verdicts.py

Creatures need no data. Cats, people 0 to 4 and animals are added where the data folder is found
(``SKFMAP_DATA``, else ``../shared/data`` beside the checkout). A few shapes of each, three folds, a
thousand points scored; the thresholds of ``skfmap/report/_verdict.py`` were chosen by this table.
Columns, over the points of all shapes left out, times 100 where they are errors: mean true and
expected error and their ratio; rank correlation of the two, and the lowest of a single shape; true
mean error of the half of the points that is trusted more, over that of all points; mean error
without learned weights over that with them, and on how many shapes weights helped; error of the
worst shape over the median; and the largest share that the error is of the one against the
symmetric answer, where that is known.
"""

import argparse
import warnings
from functools import partial

import numpy as np
from problems import DATA, MEMORY
from scipy.stats import spearmanr
from threadpoolctl import threadpool_limits

from skfmap import (
    Correspondence,
    DescriptorTransformer,
    Mesh,
    SpectralBasis,
    WeightedFunctionalMapLearner,
)
from skfmap.datasets import load_collection, make_creatures, make_sphere
from skfmap.geometry.geodesics import farthest_vertices
from skfmap.model_selection import PinnedReference

REFINEMENTS = (None, "bijective-zoomout")
N_SCORED = 1000
# name: folder, names of shapes, the reference first
FOLDERS = {
    "cats": ("tosca_isometric", ["cat0", "cat1", "cat3", "cat5", "cat6", "cat8", "cat10"]),
    "one person": ("faust", [f"tr_reg_00{pose}" for pose in range(7)]),
    "five people": (
        "faust",
        [f"tr_reg_0{person}{pose}" for person, pose in zip("0123401", "0312546", strict=True)],
    ),
    "animals": ("smal_train", None),
}


def ellipsoids():
    """Return bodies of a symmetry that no probe can break: every answer is a guess."""
    ball = make_sphere(n_subdivisions=3)
    meshes = [Mesh(ball.vertices * [1, 1 + 0.1 * i, 1.5], ball.faces, f"ball{i}") for i in range(6)]
    return meshes, [Correspondence.from_vertices(np.arange(ball.n_vertices))] * len(meshes)


def creatures(n_vertices, **options):
    """Return seven creatures."""
    made = make_creatures(7, n_vertices, **options)
    return made.meshes, made.correspondences


def from_folder(name):
    """Return the chosen shapes of a folder, the reference first."""
    folder, names = FOLDERS[name]
    found = load_collection(DATA / folder, reference=None if names is None else names[0])
    wanted = found.names[::5] if names is None else names
    places = [found.names.index(one) for one in wanted]
    return [found.meshes[i] for i in places], [found.correspondences[i] for i in places]


def landmarks(meshes, truths, n):
    """Return correspondences on a few well-spread template points."""
    at = truths[0].pairs
    spread, _ = farthest_vertices(meshes[0].vertices, meshes[0].faces, np.unique(at[:, 0]), n)
    vertices, first = np.unique(at[:, 0], return_index=True)
    points = at[first[np.searchsorted(vertices, spread)], 1]
    return [truth.restrict(points) for truth in truths]


def spoiled(truths, share):
    """Return correspondences of which a part is exchanged at random, but for the reference's."""
    out = [truths[0]]
    for i, truth in enumerate(truths[1:]):
        pairs, rng = truth.pairs.copy(), np.random.default_rng(i)
        wrong = rng.random(len(pairs)) < share
        pairs[wrong, 0] = rng.permutation(pairs[wrong, 0])
        out.append(Correspondence(pairs))
    return out


def cases():
    """Yield (name, maker of shapes and correspondences, given parameters, n_functions)."""
    for n in (500, 1000, 2000):
        yield f"creatures of {n}", lambda n=n: creatures(n), None, 30
    yield "creatures of 1000, k = 50", lambda: creatures(1000), None, 50
    yield (
        "cats and horses of 1000",
        lambda: creatures(1000, body=["cat", "horse"] * 3 + ["cat"]),
        None,
        30,
    )
    yield (
        "creatures, 36 landmarks, k = 18",
        lambda: creatures(1000),
        lambda *of: landmarks(*of, 36),
        18,
    )
    yield (
        "creatures, a third of pairs wrong",
        lambda: creatures(1000),
        lambda _, truths: spoiled(truths, 0.33),
        30,
    )
    yield (
        "creatures, all pairs wrong",
        lambda: creatures(1000),
        lambda _, truths: spoiled(truths, 1.0),
        30,
    )
    yield "ellipsoids", ellipsoids, None, 12
    for name, (folder, _) in FOLDERS.items():
        if (DATA / folder).is_dir():
            make = partial(from_folder, name)
            yield f"{name}, k = 50", make, None, 50
            yield f"{name}, 36 landmarks, k = 18", make, lambda *of: landmarks(*of, 36), 18


@MEMORY.cache(ignore=["make", "give"])
def left_out(name, make, give, k):
    """Return for each refinement a pair of arrays a shape, and the errors without weights."""
    meshes, truths = make()
    given = truths if give is None else give(meshes, truths)
    points = np.unique(truths[0].pairs[:, 1])
    points = np.random.default_rng(0).choice(points, min(N_SCORED, len(points)), replace=False)
    scored = [truth.restrict(points) for truth in truths]
    shapes = DescriptorTransformer(memory=MEMORY).transform(
        SpectralBasis(100, memory=MEMORY).transform(meshes)
    )
    found = {refine: [] for refine in REFINEMENTS}
    for train, test in PinnedReference(3).split(shapes, truths):
        learned = WeightedFunctionalMapLearner(n_functions=k, refine=REFINEMENTS[-1], memory=MEMORY)
        plain = WeightedFunctionalMapLearner(
            n_functions=k, weighting=None, refine=None, memory=MEMORY
        )
        for learner in (learned, plain):
            learner.fit([shapes[i] for i in train], [given[i] for i in train])
        new, answers = [shapes[i] for i in test], [scored[i] for i in test]
        for refine, shown in found.items():
            options = {"reference_y": scored[0], "refine": refine}
            matches, errors = (
                learned.match(new, refine=refine),
                learned.pair_errors(new, answers, **options),
            )
            without = plain.pair_errors(new, answers, **options)
            shown += [
                (match.expected_error[own.vertices], own.direct, one.mean(), _side(own))
                for match, own, one in zip(matches, errors, without, strict=True)
            ]
    return found


def _side(errors):
    """Return the mean error over that against the symmetric answer."""
    return np.nan if errors.symmetric is None else errors.mean() / np.nanmean(errors.symmetric)


def correlation(expected, true):
    """Return the rank correlation; NaN of constants."""
    return spearmanr(expected, true).statistic if np.ptp(expected) > 0 < np.ptp(true) else np.nan


def row(shown):
    """Return the figures of one setting."""
    expected, true = (np.concatenate([one[j] for one in shown]) for j in (0, 1))
    means, plain = np.array([one[1].mean() for one in shown]), np.array([one[2] for one in shown])
    trusted = expected <= np.median(expected)
    return (
        100 * true.mean(),
        100 * expected.mean(),
        expected.mean() / true.mean(),
        correlation(expected, true),
        min(correlation(*one[:2]) for one in shown),
        true[trusted].mean() / true.mean(),
        plain.mean() / means.mean(),
        (means < plain).mean(),
        means.max() / np.median(means),
        max(one[3] for one in shown),
    )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", help="run the settings whose name contains this")
    options = parser.parse_args()
    heads = (
        "true",
        "expect.",
        "ratio",
        "rank",
        "lowest",
        "trusted",
        "plain",
        "helped",
        "worst",
        "side",
    )
    print(f"{'':<54}" + "".join(f"{head:>9}" for head in heads))
    with threadpool_limits(limits=1, user_api="blas"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, make, give, k in cases():
            if options.only not in name:
                continue
            for refine, shown in left_out(name, make, give, k).items():
                print(
                    f"{name:<36}{refine!s:<18}" + "".join(f"{value:>9.2f}" for value in row(shown)),
                    flush=True,
                )


if __name__ == "__main__":
    main()
