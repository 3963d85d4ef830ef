"""Known pairs of two shapes extended to all vertices, along the surfaces."""

from typing import Any, NamedTuple

import numpy as np

from skfmap._tools.caching import cached, hash_of_arrays
from skfmap._tools.types import FloatArray, IntArray
from skfmap.geometry.geodesics import farthest_vertices, heat_distances
from skfmap.shapes import JoinedPairs, Mesh, SpectralShape

__all__ = ["Across", "cross_over", "extend_pairs"]

# Landmarks between which correspondences are interpolated, and how many of them locate a vertex:
# twice the three that a point of a surface needs. Neither was varied.
_N_LANDMARKS = 500
_N_NEAREST = 6


class Across(NamedTuple):
    """From the bridge to the given reference: point map, uncertainty, mean error; the way back.

    The bridge is taken on its working mesh. Where a given vertex of the reference has no place, the
    way back is -1.
    """

    p2p: IntArray
    uncertainty: FloatArray
    error: float
    inverse: IntArray


def cross_over(
    bridge: SpectralShape,
    reference: SpectralShape,
    join: JoinedPairs,
    given_of_working: IntArray,
    memory: Any = None,
) -> Across:
    """Extend the known pairs of the bridge and the reference, both ways.

    Parameters
    ----------
    bridge, reference : SpectralShape
        The two shapes.
    join : JoinedPairs
        Known pairs of given vertices of the two.
    given_of_working : ndarray of int, shape (n_working_0,)
        The given vertex nearest to each working one of the reference.
    memory : None, str or joblib.Memory
        Where the result is cached.

    Returns
    -------
    Across
        Point maps between the working vertices of the bridge and the given ones of the reference.
    """
    at, at_0 = bridge.working_vertices(join.vertices_i), reference.working_vertices(join.vertices_0)
    there = JoinedPairs(at, at_0, join.points, join.weights)
    back = JoinedPairs(at_0, at, join.points, join.weights)
    p2p, uncertainty, error = extend_pairs(bridge.mesh, reference.mesh, there, memory)
    inverse, _, _ = extend_pairs(reference.mesh, bridge.mesh, back, memory)
    to_working = reference.working_vertices(np.arange(reference.n_given))
    return Across(given_of_working[p2p], uncertainty, error, np.append(inverse, -1)[to_working])


def extend_pairs(
    mesh_i: Mesh, mesh_0: Mesh, join: JoinedPairs, memory: Any = None
) -> tuple[IntArray, FloatArray, float]:
    """Extend known pairs to all vertices, along the surfaces.

    A vertex without a partner goes where the distances to the partners of the landmarks nearest to
    it are most like its own distances to them. Nothing passes through space, so that fingers stay
    apart.

    Parameters
    ----------
    mesh_i, mesh_0 : Mesh
        The two shapes.
    join : JoinedPairs
        Known pairs.
    memory : None, str or joblib.Memory
        Where the result is cached.

    Returns
    -------
    p2p : ndarray of int, shape (n_vertices_i,)
        Vertex of S_0 for each vertex of S_i.
    uncertainty : ndarray of shape (n_vertices_i,)
        Root mean square disagreement of those distances, scaled to the error of landmarks that are
        located by others; 0 at known pairs. In units of sqrt(area).
    error : float
        Mean error of the extension, as landmarks that are located by others tell it.
    """
    pairs = (join.vertices_i, join.vertices_0)
    key = hash_of_arrays(mesh_i.vertices, mesh_i.faces, mesh_0.vertices, mesh_0.faces, *pairs)
    p2p, uncertainty, error = cached(_extend, memory)((mesh_i, mesh_0, *pairs), key)
    return p2p, uncertainty, error


def _extend(
    what: tuple[Mesh, Mesh, IntArray, IntArray],
    content_hash: str,  # noqa: ARG001
) -> tuple[IntArray, FloatArray, float]:
    mesh_i, mesh_0, vertices_i, vertices_0 = what
    known, first = np.unique(vertices_i, return_index=True)
    chosen, _ = farthest_vertices(mesh_i.vertices, mesh_i.faces, known, _N_LANDMARKS)
    partners = vertices_0[first[np.searchsorted(known, chosen)]]
    distances_i = heat_distances(mesh_i.vertices / np.sqrt(mesh_i.area), mesh_i.faces, chosen)
    distances_0 = heat_distances(mesh_0.vertices / np.sqrt(mesh_0.area), mesh_0.faces, partners)
    p2p, doubt = _locate(distances_i, distances_0)
    error, scale = _left_out(distances_i, distances_0, chosen)
    p2p[known] = vertices_0[first]
    doubt[known] = 0.0
    return p2p, scale * doubt, error * float((doubt > 0).mean())


def _left_out(
    distances_i: FloatArray, distances_0: FloatArray, chosen: IntArray
) -> tuple[float, float]:
    """Locate every other landmark by the rest, and compare errors with doubts.

    Return the mean error, and by how much it exceeds the doubt.

    Landmarks are then sqrt(2) times as far apart, and errors are taken to grow as that distance
    does.
    """
    even, odd = np.arange(0, len(chosen), 2), np.arange(1, len(chosen), 2)
    errors, doubts = [], []
    for given, asked in ((even, odd), (odd, even)):
        if len(given) and len(asked):
            p2p, doubt = _locate(distances_i[given][:, chosen[asked]], distances_0[given])
            errors.append(distances_0[asked, p2p])
            doubts.append(doubt)
    if not errors:
        return 0.0, 1.0
    error = float(np.concatenate(errors).mean() / np.sqrt(2))
    return error, max(1.0, error / max(float(np.concatenate(doubts).mean()), 1e-12))


def _locate(distances_i: FloatArray, distances_0: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the most similar column of the second for each of the first, and how unlike it is."""
    n_nearest = min(_N_NEAREST, len(distances_i))
    nearest = np.argpartition(distances_i, n_nearest - 1, axis=0)[:n_nearest].T
    p2p, doubt = np.empty(distances_i.shape[1], dtype=np.int64), np.zeros(distances_i.shape[1])
    for vertex, landmarks in enumerate(nearest):
        own = distances_i[landmarks, vertex]
        weights = 1 / (own + 1e-3) ** 2
        cost = (weights / weights.sum()) @ np.square(distances_0[landmarks] - own[:, None])
        p2p[vertex] = np.argmin(cost)
        doubt[vertex] = np.sqrt(cost[p2p[vertex]])
    return p2p, doubt
