"""Extension of the known pairs of two shapes to all vertices, along the surfaces."""

from typing import Any, NamedTuple

import numpy as np

from skfmap._tools.caching import cached, hash_of_arrays
from skfmap._tools.types import FloatArray, IntArray
from skfmap.geometry.geodesics import farthest_vertices, heat_distances
from skfmap.shapes import JoinedPairs, Mesh, SpectralShape

__all__ = ["Across", "cross_over", "extend_pairs"]

# Number of landmarks between which correspondences are interpolated, and number of nearest ones
# that locate a vertex: twice the three that a point of a surface needs. Neither was varied.
_N_LANDMARKS = 500
_N_NEAREST = 6


class Across(NamedTuple):
    """Point-to-point map from the bridge to the reference, its uncertainty and error, and inverse.

    The maps are between vertices of the bridge's working mesh and of the reference's given mesh.
    ``inverse`` is -1 if a given vertex of the reference has no place.
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
    """Extend the known pairs of the bridge and the reference, in both directions.

    Parameters
    ----------
    bridge, reference : SpectralShape
        The two shapes.
    join : JoinedPairs
        Known pairs of given vertices of the two.
    given_of_working : ndarray of int, shape (n_working_0,)
        The given vertex nearest to each working vertex of the reference.
    memory : None, str or joblib.Memory
        Where the result is cached.

    Returns
    -------
    Across
        Point-to-point maps between the working vertices of the bridge and the given vertices of the
        reference.
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

    A vertex without a known partner is located by its distances to the nearest landmarks: it is
    mapped to the vertex whose distances to their partners are most similar. All distances are along
    the surfaces, so that fingers, for instance, stay apart.

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
        Root mean square difference of these distances, scaled to the error of landmarks that are
        located by others, in units of sqrt(area); 0 at known pairs.
    error : float
        Mean error of the extension, estimated from landmarks that are located by others.
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
    """Locate each half of the landmarks by the other half, and compare errors with doubts.

    Return the mean error, and the factor by which it exceeds the doubt. With half of the landmarks,
    these are sqrt(2) times as far apart, and errors are assumed to grow in proportion.
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
    """Return the most similar column of ``distances_0`` for each vertex, and the difference."""
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
