"""From a functional map to points: nearest neighbours among trusted functions, and the refinement of such matches."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from sklearn.neighbors import NearestNeighbors

from skfmap._typing import FloatArray, IntArray
from skfmap.functional.embedding import spectral_embeddings
from skfmap.functional.fmap import solve_functional_map
from skfmap.functional.normalization import scale_by
from skfmap.functional.refinement import map_from_point_maps, nearest_orthogonal
from skfmap.functional.regularization import penalty_of
from skfmap.functional.residuals import trusted_functions
from skfmap.shapes import ProbedShape, SpectralShape

__all__ = [
    "MATCHINGS",
    "REFINEMENTS",
    "UNREFINED",
    "Matcher",
    "PointMatch",
    "Settings",
    "learned_map",
    "match_points",
    "penalised_error",
]

MATCHINGS = ("soft", "cut")
REFINEMENTS = (None, "icp", "zoomout", "bijective-zoomout")
UNREFINED = "unrefined"

# Functions that each step of ZoomOut adds.
_STEP = 10
# Steps at the full resolution; beyond four, errors on the cats change by less than 0.0005.
_FINAL_STEPS = 4
_ICP_STEPS = 10
# Share of a squared length within which squared distances are equal: what different kernels of the linear algebra leave
# on bodies of 5,000 vertices is a hundredth of it.
_ROUNDING = 1e-9


class Settings(NamedTuple):
    """Parameters that fitted weights and errors belong to; setting them later has no effect before the next fit."""

    alpha: float
    normalize: str
    regularizer: str | Callable[[FloatArray, FloatArray], FloatArray]
    matching: str
    n_stable: int
    refine: str | None


class Matcher(NamedTuple):
    """What matching a new shape needs, all of it learned."""

    reference: ProbedShape
    weights: FloatArray
    stable_basis: FloatArray
    residual_covariance: FloatArray
    truncation_covariance: FloatArray
    settings: Settings


class PointMatch(NamedTuple):
    """Points matched in an embedding.

    ``learned_map`` is X_i(D), ``refined_map`` the functional map that the last step of a refinement matched in, or
    None. Rows of ``points_i`` and ``points_0`` are the vertices of S_i and S_0 there; ``p2p`` holds the nearest of the
    second for each of the first, ``inverse`` the nearest of the first for each of the second.
    """

    learned_map: FloatArray
    refined_map: FloatArray | None
    points_i: FloatArray
    points_0: FloatArray
    p2p: IntArray
    inverse: IntArray


def learned_map(matcher: Matcher, shape: ProbedShape) -> FloatArray:
    """Return X_i(D) of equation (2), shape (k, k)."""
    return solve_functional_map(*_equation_2(matcher, shape), matcher.weights)


def penalised_error(matcher: Matcher, shape: ProbedShape) -> float:
    """Return the value of equation (2) at its minimum: how well the shape fits what was learned."""
    probes_0, probes_i, penalty = _equation_2(matcher, shape)
    C = solve_functional_map(probes_0, probes_i, penalty, matcher.weights)
    residual = (C @ probes_0 - probes_i) * matcher.weights
    return float(np.square(residual).sum() + (penalty[1:, 1:] * np.square(C[1:, 1:])).sum())


def embedding_distance(shape: ProbedShape, match: PointMatch) -> float:
    """Return the mean distance, by area, between the points of a shape and those that they are matched to."""
    distances = np.linalg.norm(match.points_i - match.points_0[match.p2p], axis=1)
    return float(np.average(distances, weights=shape.spectral.mass))


def _equation_2(matcher: Matcher, shape: ProbedShape) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return normalised probes of the reference and of the shape, and the regulariser's diagonals."""
    k, reference, settings = len(matcher.stable_basis), matcher.reference, matcher.settings
    probes_0, probes_i = reference.probes[:k], shape.probes[:k]
    penalty = penalty_of(shape.spectral.evals[:k], reference.spectral.evals[:k], settings.alpha, settings.regularizer)
    return (
        scale_by(probes_0, probes_0, settings.normalize),
        scale_by(probes_0, probes_i, settings.normalize),
        penalty,
    )


def match_points(matcher: Matcher, shape: ProbedShape) -> tuple[PointMatch, PointMatch]:
    """Match the points of a shape in the learned functions, and refine as the settings say; return both matches."""
    C = learned_map(matcher, shape)
    match = PointMatch(C, None, *_nearest_both(shape.spectral, matcher.reference.spectral, C, _functions_of(matcher)))
    return match, _REFINE[matcher.settings.refine](matcher, shape.spectral, match)


def _functions_of(matcher: Matcher) -> FloatArray:
    """Return the functions that points are matched in, shape (k, k) or (k, p)."""
    if matcher.settings.matching == "cut":
        return matcher.stable_basis[:, : matcher.settings.n_stable]
    return trusted_functions(matcher.residual_covariance)


def _nearest_both(
    spectral: SpectralShape, spectral_0: SpectralShape, C: FloatArray, functions: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    k = len(C)
    points_i, points_0 = spectral_embeddings(spectral.evecs[:, :k], spectral_0.evecs[:, :k], C, functions)
    return points_i, points_0, _nearest(points_i, points_0), _nearest(points_0, points_i)


def _nearest(points: FloatArray, targets: FloatArray) -> IntArray:
    """Return the nearest target of each point; the first of those that are as near but for rounding."""
    neighbours = NearestNeighbors(n_neighbors=min(2, len(targets)), algorithm="brute").fit(targets)
    distances, found = neighbours.kneighbors(points)
    # Squared distances that come from a matrix product are off by rounding of this size.
    slack = _ROUNDING * np.square(points).sum(axis=1)
    nearest = np.array(found[:, 0], dtype=np.int64)
    for row in np.flatnonzero(np.ptp(np.square(distances), axis=1) <= slack):
        squared = np.square(targets - points[row]).sum(axis=1)
        nearest[row] = np.argmax(squared <= squared.min() + slack[row])
    return nearest


def _unrefined(matcher: Matcher, spectral: SpectralShape, match: PointMatch) -> PointMatch:  # noqa: ARG001
    return match


def _icp(matcher: Matcher, spectral: SpectralShape, match: PointMatch) -> PointMatch:
    """Match by orthogonal maps of k functions (Ovsjanikov et al. 2012)."""
    k = len(match.learned_map)
    for _ in range(_ICP_STEPS):
        C = np.eye(k)  # constants map to constants
        C[1:, 1:] = nearest_orthogonal(_fit(spectral, matcher.reference.spectral, k, match.p2p, None)[1:, 1:])
        previous, match = match, _step(matcher, spectral, match, C, np.eye(k))
        if np.array_equal(previous.p2p, match.p2p):
            break
    return match


def _zoomout(matcher: Matcher, spectral: SpectralShape, match: PointMatch) -> PointMatch:
    """Fit maps of growing size, each to the point map before (Melzi et al. 2019)."""
    for k in _resolutions(matcher, spectral):
        C = _fit(spectral, matcher.reference.spectral, k, match.p2p, None)
        match = _step(matcher, spectral, match, C, np.eye(k))
    return match


def _bijective_zoomout(matcher: Matcher, spectral: SpectralShape, match: PointMatch) -> PointMatch:
    """Fit maps of growing size to the point maps of both directions, and match points in functions weighted as learned.

    Without the learned weights the steps favour maps that are as isometric as can be, and drift away even from the
    truth.
    """
    sizes = [*_resolutions(matcher, spectral)]
    for k in [*sizes, *[sizes[-1]] * (_FINAL_STEPS - 1)]:
        C = _fit(spectral, matcher.reference.spectral, k, match.p2p, match.inverse)
        match = _step(matcher, spectral, match, C, trusted_functions(matcher.truncation_covariance[:k, :k]))
    return match


_REFINE = {None: _unrefined, "icp": _icp, "zoomout": _zoomout, "bijective-zoomout": _bijective_zoomout}


def _resolutions(matcher: Matcher, spectral: SpectralShape) -> Iterator[int]:
    """Yield the sizes of the maps, from that of the learned one to the resolution that both bases hold."""
    k, most = len(matcher.stable_basis), min(spectral.n_components, len(matcher.truncation_covariance))
    yield from range(k, most, _STEP)
    yield most


def _fit(
    spectral: SpectralShape, spectral_0: SpectralShape, k: int, p2p: IntArray, inverse: IntArray | None
) -> FloatArray:
    return map_from_point_maps(
        spectral.evecs[:, :k], spectral_0.evecs[:, :k], spectral.mass, spectral_0.mass, p2p, inverse
    )


def _step(
    matcher: Matcher, spectral: SpectralShape, match: PointMatch, C: FloatArray, functions: FloatArray
) -> PointMatch:
    """Return the points matched anew under the map ``C``."""
    return PointMatch(match.learned_map, C, *_nearest_both(spectral, matcher.reference.spectral, C, functions))
