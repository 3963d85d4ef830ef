"""Known functional maps, from where the shapes lie on the template."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from skfmap._parallel import map_shapes
from skfmap._typing import FloatArray
from skfmap._validation import label
from skfmap.exceptions import CorrespondenceError, CoverageWarning
from skfmap.functional.ground_truth import map_from_pairs
from skfmap.functional.regularization import laplacian_mask
from skfmap.geometry.geodesics import areas_of_landmarks
from skfmap.shapes import Correspondence, JoinedPairs, ProbedShape

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
    arguments = ((s, reference, join, n_functions) for s, join in zip(shapes, joins, strict=True))
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


def _ground_truth(shape: ProbedShape, reference: ProbedShape, join: JoinedPairs, k: int) -> Any:
    landmarks, inverse = np.unique(join.vertices_i, return_inverse=True)
    n_distinct = min(len(landmarks), len(np.unique(join.vertices_0)), len(np.unique(join.points)))
    if n_distinct < k:
        raise CorrespondenceError(
            f"{label(shape.name, 'shape')} and {reference.name!r} share {n_distinct} distinct landmarks, too few for "
            f"n_functions={k}; give more pairs, or lower n_functions to well below {n_distinct}."
        )
    mesh = shape.spectral.mesh
    areas = areas_of_landmarks(mesh.vertices, mesh.faces, shape.spectral.mass, landmarks)
    per_vertex = np.bincount(inverse, join.weights)
    share = areas[inverse] * join.weights / np.maximum(per_vertex[inverse], 1e-300)
    evals_i, evals_0 = shape.spectral.evals[:k], reference.spectral.evals[:k]
    return map_from_pairs(
        shape.spectral.evecs[join.vertices_i, :k],
        reference.spectral.evecs[join.vertices_0, :k],
        share,
        laplacian_mask(evals_i, evals_0),
    )
