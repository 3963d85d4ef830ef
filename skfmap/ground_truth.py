"""Known functional maps, from where the shapes lie on the template."""

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
    """Return the pairs of places of a shape and of the reference.

    Of many pairs around one vertex of the shape's working mesh those nearest to it are enough.
    Sharing no template point at all is an error that names both.
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
    starts = np.searchsorted(at[order], at[order])  # where the pairs of the same vertex begin
    kept = np.sort(order[np.arange(len(order)) - starts < _AROUND])
    return joined.take(kept)


# Pairs around each working vertex that known maps are made of: twice what they could tell apart.
_AROUND = 2
# Share of pairs that may be left out without a word: slips that a person would not look for.
_MANY = 0.02


class KnownMap(NamedTuple):
    """What the known pairs of a shape and of the reference determine.

    Attributes
    ----------
    C : ndarray of shape (k, k)
        Functional map, from functions on S_0 to functions on S_i.
    n_observed : int
        How many of the k functions the pairs determine.
    areas : ndarray of shape (n_pairs,)
        Area of S_i that each pair stands for; 0 for pairs that are left out as wrong.
    n_wrong : int
        How many pairs are left out.
    truncation : ndarray of shape (n_components, n_components)
        `residual_covariance` of the map that the pairs make in all functions held: what the cut
        costs.
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
    """Fit the functional maps C_i that known correspondences make.

    They run from functions on the reference to functions on each shape.

    Mass-weighted least squares: each pair counts by the area that its vertex stands for, so that
    sparse landmarks weigh the surface evenly.

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
    """Return `ground_truth_maps` with what else the pairs tell."""
    arguments = (
        (s, reference, join, n_functions, memory) for s, join in zip(shapes, joins, strict=True)
    )
    known: list[KnownMap] = map_shapes(
        _known_map, arguments, n_jobs=n_jobs, verbose=0, prefer="threads"
    )
    return known


def coverage_messages(known: Sequence[KnownMap], names: Sequence[str], k: int) -> list[str]:
    """Return what a person should know of known maps.

    That is: many pairs were left out, or no pairs determine some of the functions.
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
            f"{', '.join(wrong)} lie far from where a smooth map puts them and are left out; "
            "check the correspondence if that surprises you."
        )
    if partial:
        messages.append(
            f"The pairs of these shapes determine fewer than the {k} functions asked for: "
            f"{', '.join(partial)}. The rest of each known map is a guess by isometry. Give more "
            "or better spread pairs, lower n_functions, or leave the shapes out."
        )
    return messages


def warn_of_coverage(known: Sequence[KnownMap], names: Sequence[str], k: int) -> None:
    """Warn of what `coverage_messages` says."""
    for message in coverage_messages(known, names, k):
        warn(message, CoverageWarning)


def distinct_landmarks(join: JoinedPairs) -> int:
    """Return how many distinct landmarks are joined: places on either shape count once."""
    return min(len(np.unique(part)) for part in (join.vertices_i, join.vertices_0, join.points))


def areas_of_pairs(shape: ProbedShape, join: JoinedPairs) -> FloatArray:
    """Return the area of S_i that each pair stands for, as its vertex is the nearest one."""
    spectral = shape.spectral
    vertices_i = spectral.working_vertices(join.vertices_i)
    return _shares(spectral.mesh, spectral.mass, vertices_i, join.weights)


def check_landmarks(shape: ProbedShape, reference: ProbedShape, join: JoinedPairs, k: int) -> int:
    """Return how many distinct landmarks a shape and the reference share.

    Fewer than k are an error.
    """
    n_distinct = distinct_landmarks(join)
    if n_distinct < k:
        raise CorrespondenceError(
            f"{label(shape.name, 'shape')} and {reference.name!r} share {n_distinct} distinct "
            f"landmarks, too few for n_functions={k}; give more pairs, or lower n_functions to "
            f"well below {n_distinct}."
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
    """What a ground-truth map is made of; ``vertices_i`` are those of the working mesh."""

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
    """Return the area that each pair stands for: that of its vertex, shared by weight."""
    landmarks, inverse = np.unique(vertices_i, return_inverse=True)
    areas = areas_of_landmarks(mesh.vertices, mesh.faces, mass, landmarks)
    per_vertex = np.bincount(inverse, weights)
    return np.asarray(areas[inverse] * weights / np.maximum(per_vertex[inverse], 1e-300))


def _truncation(pairs: _Pairs, areas: FloatArray, n_distinct: int) -> FloatArray:
    """Return the covariance of residuals in as many functions as the pairs can tell.

    Beyond these, functions are taken to err as the last ones do.
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
