"""The training shapes beside the reference, and what learning from some of them gives."""

from typing import Any, NamedTuple

import numpy as np

from skfmap._matching import Matcher, Settings
from skfmap._typing import FloatArray, IntArray
from skfmap.functional.learning import LearnedMaps, learn_functional_maps
from skfmap.functional.residuals import residual_covariance
from skfmap.ground_truth import KnownMap
from skfmap.shapes import Correspondence, JoinedPairs, ProbedShape

__all__ = ["Training", "learn_from_rows", "learning_arrays", "matcher_from"]


class Training(NamedTuple):
    """The reference, its place in X, where it lies on the template; the other shapes and what is known of them."""

    place: int
    reference: ProbedShape
    truth_0: Correspondence
    shapes: list[ProbedShape]
    joins: list[JoinedPairs]
    known: list[KnownMap]
    share: FloatArray


def learning_arrays(training: Training, k: int) -> dict[str, Any]:
    """Return what equation (3) is about, as `learn_functional_maps` takes it."""
    return {
        "probes_0": training.reference.probes[:k],
        "probes": np.stack([shape.probes[:k] for shape in training.shapes]),
        "evals_0": training.reference.spectral.evals[:k],
        "evals": np.stack([shape.spectral.evals[:k] for shape in training.shapes]),
        "maps": np.stack([one.C for one in training.known]),
        "sample_weight": training.share,
    }


def learn_from_rows(arrays: dict[str, Any], rows: IntArray, options: dict[str, Any]) -> LearnedMaps:
    """Learn from some of the training shapes only."""
    of_shapes = {name: arrays[name][rows] for name in ("probes", "evals", "maps", "sample_weight")}
    return learn_functional_maps(**{**arrays, **of_shapes}, **options)


def matcher_from(
    training: Training, rows: IntArray, maps: FloatArray, learned: LearnedMaps, settings: Settings
) -> Matcher:
    """Return what matches new shapes, as learned from the given training shapes; ``maps`` are their X_i(D)."""
    k, spectral_0 = maps.shape[1], training.reference.spectral
    residuals = [
        residual_covariance(
            training.shapes[i].spectral.evecs[training.joins[i].vertices_i, :k],
            spectral_0.evecs[training.joins[i].vertices_0, :k],
            training.known[i].areas,
            C,
        )
        for i, C in zip(rows, maps, strict=True)
    ]
    size = min(len(training.known[i].truncation) for i in rows)
    truncations = [training.known[i].truncation[:size, :size] for i in rows]
    share = training.share[rows]
    return Matcher(
        training.reference,
        learned.weights,
        learned.stable_basis,
        np.average(residuals, axis=0, weights=share),
        np.average(truncations, axis=0, weights=share),
        settings,
    )
