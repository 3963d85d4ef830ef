"""Errors of point-to-point maps at known pairs, for scores."""

from collections.abc import Sequence

import numpy as np

from skfmap._measures import PairErrors, PlaceDistances, pair_errors, reference_distances
from skfmap._tools.caching import MemoryLike
from skfmap._tools.types import DistanceMethod, IntArray
from skfmap.learner.inputs import check_correspondences
from skfmap.shapes import Correspondence, ProbedShape
from skfmap.shapes.usable import Answer, Usable, put_back

__all__ = ["score_point_maps"]

# For references with at most this many vertices, the distances of all known vertices are computed
# at once: up to 256 MB as float32.
_N_ALL_ROWS = 8000


def score_point_maps(
    p2ps: Sequence[IntArray],
    usable: Usable,
    answers: Sequence[Correspondence],
    reference: ProbedShape,
    truth_0: Correspondence,
    *,
    reference_y: Answer | None = None,
    method: DistanceMethod = "heat",
    memory: MemoryLike = None,
    n_jobs: int | None = None,
) -> list[PairErrors]:
    """Return the errors of point-to-point maps between given meshes at known pairs, by shape."""
    spectral_0 = reference.spectral
    distances = reference_distances(spectral_0.mesh, method, memory=memory, n_jobs=n_jobs)
    if spectral_0.prolongation is not None:
        distances = PlaceDistances(spectral_0, distances)
    if reference_y is not None:
        (truth_0,) = check_correspondences([reference_y], [reference])
    if method == "heat" and spectral_0.mesh.n_vertices <= _N_ALL_ROWS:
        # The same rows for all shapes and folds, so that they are found in the cache.
        distances.rows(_vertices_of(truth_0))
    errors = [
        # Vertices without a match have no pairs.
        pair_errors(np.maximum(p2p, 0), answer, truth_0, distances)
        for p2p, answer in zip(p2ps, answers, strict=True)
    ]
    nothing = PairErrors(np.empty(0, dtype=np.int64), np.empty(0), None, np.empty(0))
    return put_back(errors, usable, lambda _: nothing)


def _vertices_of(truth: Correspondence) -> IntArray:
    symmetric = truth.pairs[:0] if truth.symmetric_pairs is None else truth.symmetric_pairs
    return np.union1d(truth.corners, symmetric[:, 0])
