"""Known functional maps, from where the shapes lie on the template."""

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from skfmap._caching import cached, hash_of_arrays
from skfmap._parallel import map_shapes
from skfmap._typing import FloatArray, IntArray
from skfmap._validation import label
from skfmap.exceptions import CorrespondenceError, CoverageWarning
from skfmap.functional.ground_truth import GroundTruth, map_from_pairs
from skfmap.functional.regularization import laplacian_mask
from skfmap.geometry.geodesics import areas_of_landmarks
from skfmap.shapes import Correspondence, JoinedPairs, Mesh, ProbedShape

__all__ = ["ground_truth_maps", "join_with_reference"]


def join_with_reference(
    truth: Correspondence, shape: ProbedShape, truth_0: Correspondence, reference: ProbedShape
) -> JoinedPairs:
    """Return the pairs of vertices of a shape and of the reference; none at all is an error that names both."""
    joined = truth.join(truth_0)
    if len(joined.points) == 0:
        raise CorrespondenceError(
            f"{label(shape.name, 'shape')} and the reference {reference.name!r} share no template point. "
            "Check that both are given on the same template (Correspondence.from_vertices or from_template?)."
        )
    return joined


def ground_truth_maps(
    shapes: Sequence[ProbedShape],
    reference: ProbedShape,
    joins: Sequence[JoinedPairs],
    n_functions: int,
    *,
    memory: Any = None,
    n_jobs: int | None = None,
) -> FloatArray:
    """Fit the functional maps C_i that known correspondences make, from functions on the reference to each shape.

    Mass-weighted least squares: each pair counts by the area that its vertex stands for, so that sparse landmarks weigh
    the surface evenly.

    Parameters
    ----------
    shapes, reference : sequence of ProbedShape, ProbedShape
        The shapes S_i, and S_0.
    joins : sequence of JoinedPairs
        Pairs of vertices of each S_i and of S_0, from `Correspondence.join`.
    n_functions : int
        k.
    memory : str or joblib.Memory, optional
        Where maps are cached, by the content of shapes and pairs.
    n_jobs : int, optional
        Shapes at a time; see joblib.

    Returns
    -------
    maps : ndarray of shape (n_shapes, k, k)
        C_i.

    Raises
    ------
    CorrespondenceError
        If a shape has fewer distinct vertices with a partner than ``n_functions``.

    Warns
    -----
    CoverageWarning
        If the pairs of a shape determine fewer than k functions; the rest is a guess by isometry.
    """
    arguments = ((s, reference, join, n_functions, memory) for s, join in zip(shapes, joins, strict=True))
    truths = map_shapes(_ground_truth, arguments, n_jobs=n_jobs, verbose=0)
    for shape, truth in zip(shapes, truths, strict=True):
        if truth.n_observed < n_functions:
            warnings.warn(
                f"The correspondences of {label(shape.name, 'shape')} determine {truth.n_observed} of {n_functions} "
                "functions; the rest of its ground-truth map is a guess by isometry. Give more or better spread "
                "pairs, lower n_functions, or leave the shape out.",
                CoverageWarning,
                stacklevel=3,
            )
    return np.stack([truth.C for truth in truths])


def _ground_truth(shape: ProbedShape, reference: ProbedShape, join: JoinedPairs, k: int, memory: Any) -> GroundTruth:
    landmarks = np.unique(join.vertices_i)
    n_distinct = min(len(landmarks), len(np.unique(join.vertices_0)), len(np.unique(join.points)))
    if n_distinct < k:
        raise CorrespondenceError(
            f"{label(shape.name, 'shape')} and {reference.name!r} share {n_distinct} distinct landmarks, too few for "
            f"n_functions={k}; give more pairs, or lower n_functions to well below {n_distinct}."
        )
    spectral, spectral_0 = shape.spectral, reference.spectral
    pairs = _Pairs(
        spectral.mesh,
        spectral.mass,
        join.vertices_i,
        join.weights,
        spectral.evecs[join.vertices_i, :k],
        spectral_0.evecs[join.vertices_0, :k],
        laplacian_mask(spectral.evals[:k], spectral_0.evals[:k]),
    )
    compute = cached(_fit_pairs, memory)
    return cast(GroundTruth, compute(pairs, hash_of_arrays(spectral.mesh.vertices, spectral.mesh.faces, *pairs[1:])))


class _Pairs(NamedTuple):
    """What a ground-truth map is made of."""

    mesh: Mesh
    mass: FloatArray
    vertices_i: IntArray
    weights: FloatArray
    evecs_i: FloatArray
    evecs_0: FloatArray
    mask: FloatArray


def _fit_pairs(pairs: _Pairs, content_hash: str) -> GroundTruth:  # noqa: ARG001
    landmarks, inverse = np.unique(pairs.vertices_i, return_inverse=True)
    areas = areas_of_landmarks(pairs.mesh.vertices, pairs.mesh.faces, pairs.mass, landmarks)
    per_vertex = np.bincount(inverse, pairs.weights)
    share = areas[inverse] * pairs.weights / np.maximum(per_vertex[inverse], 1e-300)
    return map_from_pairs(pairs.evecs_i, pairs.evecs_0, share, pairs.mask)
