"""Through a training shape that is near: its own correspondence to the reference is known."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from skfmap._caching import cached, hash_of_arrays
from skfmap._matching import Matcher
from skfmap._ties import first_of_least
from skfmap._training import Training
from skfmap._typing import FloatArray, IntArray
from skfmap.functional.ground_truth import map_from_pairs
from skfmap.functional.regularization import laplacian_mask
from skfmap.functional.residuals import residual_covariance
from skfmap.geometry.geodesics import farthest_vertices, heat_distances
from skfmap.shapes import Correspondence, JoinedPairs, Match, Mesh

__all__ = ["Across", "choose_bridge", "cross", "cross_over", "extend_pairs", "pays"]

# A bridge is taken only if errors on shapes left out are lower by more than their noise.
_WORTH = 0.9
# Landmarks between which correspondences are interpolated, and how many of them place a vertex.
_N_LANDMARKS = 500
_N_NEAREST = 6


def pays(direct: float, through: float) -> bool:
    """Return whether errors through a bridge are lower than direct ones by a margin."""
    return through < _WORTH * direct


def choose_bridge(training: Training, truths: Sequence[Correspondence], k: int) -> int | None:
    """Return the training shape in whose functions the others' known maps leave the least, or None if there is one.

    Parameters
    ----------
    training : Training
        Training shapes; those of no share are not considered.
    truths : sequence of Correspondence
        Where they lie on the template.
    k : int
        Number of functions.

    Returns
    -------
    int or None
        Place in ``training.shapes``.
    """
    used = np.flatnonzero(training.share > 0)
    if len(used) < 3:
        return None
    places = [int(place) for place in used]
    left = [np.sum([_what_is_left(training, truths, i, j, k) for i in places if i != j]) for j in places]
    return places[first_of_least(np.array(left))]


def _what_is_left(training: Training, truths: Sequence[Correspondence], i: int, j: int, k: int) -> float:
    """Return the mean squared residual of the known map from functions on shape j to functions on shape i."""
    join = truths[i].join(truths[j])
    if len(np.unique(join.vertices_i)) < k:
        return np.inf
    spectral_i, spectral_j = training.shapes[i].spectral, training.shapes[j].spectral
    evecs_i, evecs_j = spectral_i.evecs[join.vertices_i, :k], spectral_j.evecs[join.vertices_0, :k]
    areas = join.weights / join.weights.sum()
    C = map_from_pairs(evecs_i, evecs_j, areas, laplacian_mask(spectral_i.evals[:k], spectral_j.evals[:k])).C
    return float(np.trace(residual_covariance(evecs_i, evecs_j, areas, C)))


def extend_pairs(
    mesh_i: Mesh, mesh_0: Mesh, join: JoinedPairs, memory: Any = None
) -> tuple[IntArray, FloatArray, float]:
    """Extend known pairs to all vertices, along the surfaces.

    A vertex without a partner goes where the distances to the partners of the landmarks nearest to it are most like its
    own distances to them. Nothing passes through space, so that fingers stay apart.

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
        Root mean square disagreement of those distances, scaled to the error of landmarks that are placed by others; 0
        at known pairs. In units of sqrt(area).
    error : float
        Mean error of the extension, as landmarks that are placed by others tell it.
    """
    pairs = (join.vertices_i, join.vertices_0)
    key = hash_of_arrays(mesh_i.vertices, mesh_i.faces, mesh_0.vertices, mesh_0.faces, *pairs)
    p2p, uncertainty, error = cached(_extend, memory)((mesh_i, mesh_0, *pairs), key)
    return p2p, uncertainty, error


def _extend(what: tuple[Mesh, Mesh, IntArray, IntArray], content_hash: str) -> tuple[IntArray, FloatArray, float]:  # noqa: ARG001
    mesh_i, mesh_0, vertices_i, vertices_0 = what
    known, first = np.unique(vertices_i, return_index=True)
    chosen, _ = farthest_vertices(mesh_i.vertices, mesh_i.faces, known, _N_LANDMARKS)
    partners = vertices_0[first[np.searchsorted(known, chosen)]]
    distances_i = heat_distances(mesh_i.vertices / np.sqrt(mesh_i.area), mesh_i.faces, chosen)
    distances_0 = heat_distances(mesh_0.vertices / np.sqrt(mesh_0.area), mesh_0.faces, partners)
    p2p, doubt = _place(distances_i, distances_0)
    error, scale = _left_out(distances_i, distances_0, chosen)
    p2p[known] = vertices_0[first]
    doubt[known] = 0.0
    return p2p, scale * doubt, error * float((doubt > 0).mean())


def _left_out(distances_i: FloatArray, distances_0: FloatArray, chosen: IntArray) -> tuple[float, float]:
    """Place every other landmark by the rest, and return the mean error, and by how much it exceeds the doubt.

    Landmarks are then sqrt(2) times as far apart, and errors are taken to grow as that distance does.
    """
    even, odd = np.arange(0, len(chosen), 2), np.arange(1, len(chosen), 2)
    errors, doubts = [], []
    for given, asked in ((even, odd), (odd, even)):
        if len(given) and len(asked):
            p2p, doubt = _place(distances_i[given][:, chosen[asked]], distances_0[given])
            errors.append(distances_0[asked, p2p])
            doubts.append(doubt)
    if not errors:
        return 0.0, 1.0
    error = float(np.concatenate(errors).mean() / np.sqrt(2))
    return error, max(1.0, error / max(float(np.concatenate(doubts).mean()), 1e-12))


def _place(distances_i: FloatArray, distances_0: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return, for each column of the first, the column of the second that is most like it, and how unlike it is."""
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


class Across(NamedTuple):
    """From the bridge to the reference: point map, its uncertainty and mean error, and the point map back."""

    p2p: IntArray
    uncertainty: FloatArray
    error: float
    inverse: IntArray


def cross_over(bridge: Mesh, reference: Mesh, join: JoinedPairs, memory: Any = None) -> Across:
    """Extend the known pairs of the bridge and the reference, both ways."""
    back = JoinedPairs(join.vertices_0, join.vertices_i, join.points, join.weights)
    return Across(*extend_pairs(bridge, reference, join, memory), extend_pairs(reference, bridge, back, memory)[0])


def cross(match: Match, C: FloatArray, matcher: Matcher, across: Across) -> Match:
    """Return the match to the reference that a match to the bridge makes; ``C`` is the direct functional map."""
    n_j, n_0 = len(across.p2p), matcher.reference.spectral.mesh.n_vertices
    step = sp.coo_array((np.ones(n_j), (np.arange(n_j), across.p2p)), shape=(n_j, n_0)).tocsr()
    return replace(
        match,
        p2p=np.append(across.p2p, -1)[match.p2p],  # -1, where a vertex was removed, finds the last
        expected_error=match.expected_error + np.append(across.uncertainty, np.nan)[match.p2p],
        functional_map=C,
        reduced_map=C @ matcher.stable_basis[:, : matcher.settings.n_stable],
        reference_name=matcher.reference.name,
        reference_hash=matcher.reference.spectral.mesh.content_hash,
        refined_map=None,
        matrix=match.matrix @ step,
        inverse=match.inverse[across.inverse],
    )
