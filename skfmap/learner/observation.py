"""Observed errors and signs of matches at well-spread vertices of the reference."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from skfmap._tools.caching import cached, hash_of_arrays
from skfmap._tools.types import FloatArray, IntArray
from skfmap.geometry.geodesics import farthest_vertices, heat_distances
from skfmap.learner.matcher import Matcher
from skfmap.learner.signs import vertex_signs
from skfmap.refinement import PointMatch
from skfmap.shapes import JoinedPairs, Mesh, ProbedShape

__all__ = ["Observation", "Watch", "observe", "watch_reference"]

# Number of vertices of the reference at which errors are observed. They are about sqrt(area) / 22
# apart, less than the width over which errors are averaged; their distances take 10 MB for 5,000
# vertices.
_N_WATCHED = 500


class Watch(NamedTuple):
    """Well-spread vertices of the reference, and their distances to all vertices, at unit area."""

    vertices: IntArray
    distances: FloatArray


class Observation(NamedTuple):
    """Observations on a training shape, at the pairs that lead to watched vertices.

    They are the signs, errors and weights of pairs, the vertex that each is matched to, and its row
    in the watch.
    """

    signs: FloatArray
    errors: FloatArray
    weights: FloatArray
    matched: IntArray
    watched: IntArray

    @property
    def mean_error(self) -> float:
        """Mean error; NaN if no pair with a positive area leads to a watched vertex."""
        return (
            float(np.average(self.errors, weights=self.weights))
            if self.weights.any()
            else float("nan")
        )


def watch_reference(reference: ProbedShape, joins: Sequence[JoinedPairs], memory: Any) -> Watch:
    """Choose vertices of the reference with known partners, at which errors are observed."""
    mesh = reference.spectral.mesh
    spectral = reference.spectral
    known = np.unique(
        np.concatenate([spectral.working_vertices(join.vertices_0) for join in joins])
    )
    content_hash = hash_of_arrays(mesh.vertices, mesh.faces, known)
    return Watch(*cached(_distances_from_some, memory)((mesh, known), content_hash))


def _distances_from_some(
    where: tuple[Mesh, IntArray],
    content_hash: str,  # noqa: ARG001
) -> tuple[IntArray, FloatArray]:
    mesh, known = where
    at_unit_area = mesh.vertices / np.sqrt(mesh.area)
    chosen, edge_paths = farthest_vertices(at_unit_area, mesh.faces, known, _N_WATCHED)
    order = np.argsort(chosen)
    return chosen[order], heat_distances(at_unit_area, mesh.faces, chosen[order], edge_paths[order])


def observe(
    matcher: Matcher,
    shape: ProbedShape,
    join: JoinedPairs,
    areas: FloatArray,
    match: PointMatch,
    watch: Watch,
    *,
    refined: bool,
) -> Observation:
    """Return signs and errors at the known pairs that lead to watched vertices.

    Pairs without an area, which were left out as wrong, do not count.
    """
    spectral_0 = matcher.reference.spectral
    vertices_0 = spectral_0.working_vertices(join.vertices_0)
    rows = np.flatnonzero(np.isin(vertices_0, watch.vertices) & (areas > 0))
    join, vertices_0 = join.take(rows), vertices_0[rows]
    at = shape.spectral.working_vertices(join.vertices_i)
    watched = np.searchsorted(watch.vertices, vertices_0)
    matched = match.p2p[at]
    signs = vertex_signs(matcher, shape, match, refined=refined)[at]
    errors = watch.distances[watched, matched]
    if join.places_i is not None or join.places_0 is not None:
        # Measured between places instead of vertices: a straight line corrects the difference.
        x0 = spectral_0.vertices
        to_corners = shape.spectral.place_matrix(join.vertices_i, join.places_i)
        found = np.asarray(to_corners @ x0[match.p2p])
        true = spectral_0.vertices_at(join.vertices_0, join.places_0)
        detour = errors - np.linalg.norm(x0[matched] - x0[vertices_0], axis=1)
        errors = np.linalg.norm(found - true, axis=1) + np.maximum(detour, 0.0)
    return Observation(signs, errors, join.weights, matched, watched)
