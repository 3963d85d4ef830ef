"""Known functional maps, fitted to correspondences."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from skfmap._tools.caching import MemoryLike, cached, hash_of_arrays
from skfmap._tools.parallel import map_shapes
from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import label
from skfmap._tools.warn import warn
from skfmap.exceptions import CorrespondenceError, CoverageWarning
from skfmap.functional.ground_truth import map_from_pairs
from skfmap.functional.outliers import wrong_pairs
from skfmap.functional.regularization import laplacian_mask
from skfmap.functional.residuals import residual_covariance
from skfmap.geometry.geodesics import areas_of_landmarks
from skfmap.shapes import Correspondence, JoinedPairs, Mesh, ProbedShape

__all__ = [
    "KnownMap",
    "areas_of_pairs",
    "check_landmarks",
    "coverage_messages",
    "distinct_landmarks",
    "ground_truth_maps",
    "join_with_reference",
    "known_maps",
    "warn_of_coverage",
]


def join_with_reference(
    truth: Correspondence, shape: ProbedShape, truth_0: Correspondence, reference: ProbedShape
) -> JoinedPairs:
    """Return the pairs of places that a shape and the reference share.

    If there are many pairs around one vertex of the shape's working mesh, only the nearest are
    kept. An error that names both shapes is raised if they share no template point.
    """
    joined = truth.join(truth_0)
    if len(joined.points) == 0:
        called = " against ".join(
            ", ".join(one.known_names) or "none" for one in (truth, truth_0) if one.names
        )
        told = f" ({called})" if called else ""
        raise CorrespondenceError(
            f"{label(shape.name, 'shape')} and the reference {reference.name!r} share no template "
            f"point{told}. Check that both are given on the same template "
            "(Correspondence.from_vertices or from_template?)."
        )
    return _thinned_out(joined, shape)


def _thinned_out(joined: JoinedPairs, shape: ProbedShape) -> JoinedPairs:
    spectral = shape.spectral
    if spectral.prolongation is None or len(joined.points) <= _AROUND * spectral.mesh.n_vertices:
        return joined
    corners, weights = spectral.places_of(joined.vertices_i)
    largest = weights.max(axis=1)
    at = np.take_along_axis(corners, weights.argmax(axis=1)[:, None], axis=1)[:, 0]
    order = np.lexsort((-largest, at))
    starts = np.searchsorted(at[order], at[order])  # the first pair of the same vertex
    kept = np.sort(order[np.arange(len(order)) - starts < _AROUND])
    return joined.take(kept)


# Average number of pairs per working vertex, and number of pairs around one of them, beyond which
# pairs are dropped; this is twice what the working mesh can resolve.
_AROUND = 2
# The user is warned if more than this fraction of pairs is left out; fewer are ordinary slips.
_MANY = 0.02


class KnownMap(NamedTuple):
    """A known map, fitted to the pairs of a shape and the reference.

    Attributes
    ----------
    C : ndarray of shape (k, k)
        Functional map, from functions on S_0 to functions on S_i.
    n_observed : int
        Number of the k functions that the pairs determine.
    areas : ndarray of shape (n_pairs,)
        Area of S_i that each pair represents; 0 for pairs that are left out as wrong.
    n_wrong : int
        Number of pairs that are left out.
    truncation : ndarray of shape (n_components, n_components)
        `residual_covariance` of the map fitted to the pairs in all functions of the basis: the
        error of truncating the basis.
    """

    C: FloatArray
    n_observed: int
    areas: FloatArray
    n_wrong: int
    truncation: FloatArray


def ground_truth_maps(
    shapes: Sequence[ProbedShape],
    reference: ProbedShape,
    joins: Sequence[JoinedPairs],
    n_functions: int,
    *,
    memory: MemoryLike = None,
    n_jobs: int | None = None,
) -> FloatArray:
    """Fit the functional maps C_i to known correspondences.

    They take functions on the reference to functions on each shape. They are fitted by
    mass-weighted least squares: each pair is weighted by the area that its vertex represents, so
    that sparse landmarks weight the surface evenly.

    Parameters
    ----------
    shapes, reference : sequence of ProbedShape, ProbedShape
        The shapes S_i, and S_0.
    joins : sequence of JoinedPairs
        Pairs of vertices of each S_i and of S_0, from `Correspondence.join`.
    n_functions : int
        Number of eigenfunctions, k.
    memory : str or joblib.Memory, optional
        Where maps are cached, by the content of shapes and pairs.
    n_jobs : int, optional
        Number of shapes processed in parallel; see joblib.

    Returns
    -------
    maps : ndarray of shape (n_shapes, k, k)
        The maps C_i.

    Raises
    ------
    CorrespondenceError
        If a shape shares fewer than ``n_functions`` distinct landmarks with the reference.

    Warns
    -----
    CoverageWarning
        If many pairs were left out as wrong, or if the pairs of a shape determine fewer than k
        functions. The remaining ones are then filled in assuming an isometry.
    """
    known = known_maps(shapes, reference, joins, n_functions, memory=memory, n_jobs=n_jobs)
    warn_of_coverage(known, [label(shape.name, "shape") for shape in shapes], n_functions)
    return np.stack([one.C for one in known])


def known_maps(
    shapes: Sequence[ProbedShape],
    reference: ProbedShape,
    joins: Sequence[JoinedPairs],
    n_functions: int,
    *,
    memory: MemoryLike = None,
    n_jobs: int | None = None,
) -> list[KnownMap]:
    """Return the maps of `ground_truth_maps` with further results of the fit."""
    arguments = (
        (s, reference, join, n_functions, memory) for s, join in zip(shapes, joins, strict=True)
    )
    known: list[KnownMap] = map_shapes(
        _known_map, arguments, n_jobs=n_jobs, verbose=0, prefer="threads"
    )
    return known


def coverage_messages(known: Sequence[KnownMap], names: Sequence[str], k: int) -> list[str]:
    """Return messages about known maps that the user should read.

    They concern shapes with many pairs left out, and functions that no pairs determine.
    """
    wrong = [
        f"{one.n_wrong} of the {len(one.areas)} pairs of {name}"
        for name, one in zip(names, known, strict=True)
        if one.n_wrong > _MANY * len(one.areas)
    ]
    partial = [
        f"{name} {one.n_observed}"
        for name, one in zip(names, known, strict=True)
        if one.n_observed < k
    ]
    messages = []
    if wrong:
        messages.append(
            f"{', '.join(wrong)} are far from where a smooth map puts them, and were left out; "
            "check the correspondence if you did not expect this."
        )
    if partial:
        messages.append(
            f"The pairs of these shapes determine fewer than the {k} functions requested: "
            f"{', '.join(partial)}. The rest of each known map assumes an isometry. Give more "
            "pairs, or spread them better, lower n_functions, or leave the shapes out."
        )
    return messages


def warn_of_coverage(known: Sequence[KnownMap], names: Sequence[str], k: int) -> None:
    """Issue the `coverage_messages` as warnings."""
    for message in coverage_messages(known, names, k):
        warn(message, CoverageWarning)


def distinct_landmarks(join: JoinedPairs) -> int:
    """Return the number of distinct landmarks; each place on either shape counts once."""
    return min(len(np.unique(part)) for part in (join.vertices_i, join.vertices_0, join.points))


def areas_of_pairs(shape: ProbedShape, join: JoinedPairs) -> FloatArray:
    """Return the area of S_i that each pair represents: the points nearest to its vertex."""
    spectral = shape.spectral
    vertices_i = spectral.working_vertices(join.vertices_i)
    return _shares(spectral.mesh, spectral.mass, vertices_i, join.weights)


def check_landmarks(shape: ProbedShape, reference: ProbedShape, join: JoinedPairs, k: int) -> int:
    """Return the number of distinct landmarks that a shape and the reference share.

    Raise CorrespondenceError if there are fewer than k.
    """
    n_distinct = distinct_landmarks(join)
    if n_distinct < k:
        raise CorrespondenceError(
            f"{label(shape.name, 'shape')} and {reference.name!r} share {n_distinct} distinct "
            f"landmarks, which is too few for n_functions={k}; give more pairs, or lower "
            f"n_functions to well below {n_distinct}."
        )
    return n_distinct


def _known_map(
    shape: ProbedShape, reference: ProbedShape, join: JoinedPairs, k: int, memory: Any
) -> KnownMap:
    n_distinct = check_landmarks(shape, reference, join, k)
    spectral, spectral_0 = shape.spectral, reference.spectral
    n_components = min(spectral.n_components, spectral_0.n_components)
    pairs = _Pairs(
        spectral.mesh,
        spectral.mass,
        spectral.working_vertices(join.vertices_i),
        join.weights,
        spectral.evecs_at(join.vertices_i, n_components, join.places_i),
        spectral_0.evecs_at(join.vertices_0, n_components, join.places_0),
        laplacian_mask(spectral.evals[:k], spectral_0.evals[:k]),
        np.array([k, n_distinct]),
    )
    compute = cached(_fit_pairs, memory)
    return compute(pairs, hash_of_arrays(spectral.mesh.vertices, spectral.mesh.faces, *pairs[1:]))


class _Pairs(NamedTuple):
    """Data that a known map is fitted to; ``vertices_i`` are vertices of the working mesh."""

    mesh: Mesh
    mass: FloatArray
    vertices_i: IntArray
    weights: FloatArray
    evecs_i: FloatArray
    evecs_0: FloatArray
    mask: FloatArray
    counts: IntArray  # k, and the number of distinct landmarks


def _fit_pairs(pairs: _Pairs, content_hash: str) -> KnownMap:  # noqa: ARG001
    k, n_distinct = (int(n) for n in pairs.counts)
    share = _shares(pairs.mesh, pairs.mass, pairs.vertices_i, pairs.weights)
    wrong = wrong_pairs(pairs.evecs_i, pairs.evecs_0, share)
    share[wrong] = 0.0
    right = pairs._replace(
        vertices_i=pairs.vertices_i[~wrong],
        evecs_i=pairs.evecs_i[~wrong],
        evecs_0=pairs.evecs_0[~wrong],
    )
    truth = map_from_pairs(right.evecs_i[:, :k], right.evecs_0[:, :k], share[~wrong], pairs.mask)
    truncation = _truncation(
        right, share[~wrong], min(n_distinct, len(np.unique(right.vertices_i)))
    )
    return KnownMap(truth.C, truth.n_observed, share, int(wrong.sum()), truncation)


def _shares(mesh: Mesh, mass: FloatArray, vertices_i: IntArray, weights: FloatArray) -> FloatArray:
    """Return the area that each pair represents: the area of its vertex, divided by weight."""
    landmarks, inverse = np.unique(vertices_i, return_inverse=True)
    areas = areas_of_landmarks(mesh.vertices, mesh.faces, mass, landmarks)
    per_vertex = np.bincount(inverse, weights)
    return np.asarray(areas[inverse] * weights / np.maximum(per_vertex[inverse], 1e-300))


def _truncation(pairs: _Pairs, areas: FloatArray, n_distinct: int) -> FloatArray:
    """Return the covariance of residuals in as many functions as the pairs determine.

    Higher functions are assumed to have the mean variance of the last ten of these.
    """
    n_components = pairs.evecs_i.shape[1]
    n_told = min(n_components, max(2, n_distinct // 2))
    evecs_i, evecs_0 = pairs.evecs_i[:, :n_told], pairs.evecs_0[:, :n_told]
    gram = (areas[:, None] * evecs_i).T @ evecs_i
    C = np.linalg.solve(gram + 1e-9 * np.eye(n_told), (areas[:, None] * evecs_i).T @ evecs_0)
    told = residual_covariance(
        evecs_i, evecs_0, areas, np.asarray(C, dtype=np.float64), leverage_of=gram
    )
    last = float(np.diag(told)[-10:].mean())
    covariance = np.diag(np.full(n_components, last))
    covariance[:n_told, :n_told] = told
    return covariance
