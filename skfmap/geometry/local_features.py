"""Local features of the vertices of a surface, at fixed scales."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu

from skfmap._tools.types import FloatArray, IntArray, SparseMatrix
from skfmap.geometry.faults import boundary_vertices
from skfmap.geometry.geodesics import edge_graph
from skfmap.geometry.laplacian import robust_mesh_laplacian
from skfmap.geometry.normals import vertex_normals

__all__ = ["local_features", "rim_distances"]

# Number of implicit diffusion steps to each scale: the kernel of a single step has a long tail.
_STEPS = 2


def local_features(
    vertices: FloatArray, faces: IntArray, scales: Sequence[float], reach: float
) -> FloatArray:
    """Return local features of each vertex that are invariant to rigid motions.

    Coordinates, their products and normals are averaged by heat diffusion along the surface. The
    features describe these averages relative to the vertex and its normal, and how they rotate from
    scale to scale, to the left or right. They depend only on the surface within a few times the
    largest scale.

    Parameters
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        A triangle mesh, with one or more components.
    scales : sequence of float
        Diffusion distances (standard deviation along a line), ascending, in units of the
        coordinates.
    reach : float
        Distance at which the feature "distance from the rim" is clipped, in the same units.

    Returns
    -------
    ndarray of shape (n_vertices, n_features)
        Dimensionless features.
    """
    stiffness, mass = robust_mesh_laplacian(vertices, faces)
    normals = vertex_normals(vertices, faces)
    from_rim = np.minimum(rim_distances(vertices, faces), reach) / reach
    first = [from_rim]
    products = _products(vertices)
    spread = np.column_stack([vertices, products, normals, from_rim, np.ones(len(vertices))])
    offsets, columns, before = [], [], 0.0
    for scale in scales:
        spread = _diffused(stiffness, mass, spread, (scale**2 - before) / 2)
        before = scale**2
        own, means = _features(vertices, normals, spread, scale)
        columns += own
        offsets.append(means)
    columns += _turns(offsets, normals)
    local = np.column_stack([*first, *columns])
    return np.column_stack([local, _context(stiffness, mass, local, scales)])


def rim_distances(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the distance of each vertex from the rim along edges; infinite if there is no rim."""
    rim = np.flatnonzero(boundary_vertices(faces, len(vertices)))
    if not len(rim):
        return np.full(len(vertices), np.inf)
    return np.asarray(
        dijkstra(edge_graph(vertices, faces), directed=False, indices=rim, min_only=True)
    )


def _diffused(
    stiffness: SparseMatrix, mass: FloatArray, values: FloatArray, time: float
) -> FloatArray:
    """Return values after heat diffusion for a time, by implicit steps."""
    diagonal = sp.diags_array(mass)
    solver = splu((diagonal + (time / _STEPS) * stiffness).tocsc())
    for _ in range(_STEPS):
        values = solver.solve(np.ascontiguousarray(mass[:, None] * values))
    return np.asarray(values)


def _products(vertices: FloatArray) -> FloatArray:
    a, b = np.triu_indices(3)
    return vertices[:, a] * vertices[:, b]


def _features(
    vertices: FloatArray, normals: FloatArray, spread: FloatArray, scale: float
) -> tuple[list[FloatArray], FloatArray]:
    """Return features at one scale, and offsets of the mean coordinates from the vertices."""
    mean, normal = spread[:, :3], spread[:, 9:12]
    offset = (mean - vertices) / scale
    covariance = np.zeros((len(vertices), 3, 3))
    a, b = np.triu_indices(3)
    entries = (spread[:, 3:9] - _products(mean)) / scale**2
    covariance[:, a, b] = covariance[:, b, a] = entries
    sizes, axes = np.linalg.eigh(covariance)
    along = np.einsum("na,na->n", offset, normals)
    square = np.einsum("na,na->n", offset, offset)
    thick = np.einsum("na,nab,nb->n", normals, covariance, normals)
    agree = np.einsum("na,na->n", normal, normals)
    size = np.linalg.norm(normal, axis=1)
    skew = np.einsum(
        "na,na->n", np.cross(offset, np.einsum("nab,nb->na", covariance, offset)), normals
    )
    axis_along = np.abs(np.einsum("nac,na->nc", axes, normals))
    pull = np.einsum("na,nab,nb->n", offset, covariance, offset)
    found = [
        along,
        square,
        thick,
        agree,
        size,
        skew,
        pull,
        *np.sqrt(np.maximum(sizes.T, 0)),
        *axis_along.T,
        spread[:, 12],
    ]
    return found, offset


def _turns(offsets: list[FloatArray], normals: FloatArray) -> list[FloatArray]:
    """Return scalar and triple products of the mean offsets at each pair of scales."""
    found = []
    for i, one in enumerate(offsets):
        for other in offsets[i + 1 :]:
            found.append(np.einsum("na,na->n", one, other))
            found.append(np.einsum("na,na->n", np.cross(one, other), normals))
    return found


def _context(
    stiffness: SparseMatrix, mass: FloatArray, local: FloatArray, scales: Sequence[float]
) -> FloatArray:
    """Return the features averaged over neighbourhoods, at every other scale."""
    return np.column_stack(
        [_diffused(stiffness, mass, local, scale**2 / 2) for scale in scales[2::2]]
    )
