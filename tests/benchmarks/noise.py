"""Scans with many small holes, and scans in which parts that are close in space are fused."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra

import skfmap
from skfmap.geometry.cutting import clip
from skfmap.geometry.faults import edges_of
from skfmap.geometry.geodesics import edge_graph, farthest_vertices
from skfmap.geometry.normals import vertex_normals
from skfmap.geometry.thinning import thin
from skfmap.geometry.wrapping import wrap
from skfmap.partial.body import nearest_with_normals
from skfmap.partial.tears import faces_with_edges
from skfmap.registration.deformation import Deformation
from skfmap.registration.laying import Anchors, lay_on_points

N_HOLES = 30
N_TIPS, N_PAIRS, TIP = 8, 4, 0.08  # ends of limbs, pairs tried, and size of an end in sqrt(area)
FAR = 0.3  # distance on a shape, in sqrt(area), beyond which points are not neighbours
LEAST_GLUED = 0.001  # minimum fraction of the area in faces that join distant points
N_CELLS = 110


def with_holes(mesh, share, rng):
    """Return a mesh from which about thirty discs of equal radius are removed."""
    vertices, faces = mesh.vertices, mesh.faces
    centres = rng.choice(mesh.n_vertices, N_HOLES, replace=False)
    away = dijkstra(edge_graph(vertices, faces), directed=False, indices=centres).min(axis=0)
    low, high = 0.0, float(away.max())
    for _ in range(30):
        radius = (low + high) / 2
        left = skfmap.Mesh(*clip(vertices, faces, away - radius)).area / mesh.area
        low, high = (radius, high) if left > share else (low, radius)
    return clip(vertices, faces, away - radius)


def glued(mesh, radius, n_vertices, rng):
    """Return a mesh with all gaps filled that no ball of the given radius, in sqrt(area), enters.

    If that does not join distant points, the ends of two limbs are first moved together, like a
    hand that is laid on a thigh. The second mesh is the given one in the resulting pose.
    """
    tips, away = _limbs(mesh, rng)
    for drawn in (0.0, 0.6, 0.8, 0.95):
        posed = skfmap.Mesh(_drawn_together(mesh, away, tips, drawn), mesh.faces, mesh.name)
        shell = wrap(posed.vertices, mesh.faces, n_cells=N_CELLS, radius=radius * mesh.area**0.5)
        if _share(*shell[:2], posed) >= LEAST_GLUED:
            break
    return thin(*shell[:2], n_vertices)[:2], posed


def true_tears(vertices, faces, posed):
    """Return which faces have corners that are far apart on a mesh, shape (n_faces,)."""
    unit, faces_0 = posed.area**0.5, posed.faces
    normals, normals_0 = vertex_normals(vertices, faces), vertex_normals(posed.vertices, faces_0)
    own = nearest_with_normals(vertices / unit, normals, posed.vertices / unit, normals_0)
    edges = edges_of(faces)
    asked, back = np.unique(own[edges[:, 0]], return_inverse=True)
    graph = edge_graph(posed.vertices / unit, faces_0)
    ways = dijkstra(graph, directed=False, indices=asked, limit=FAR)
    return faces_with_edges(faces, edges[np.isinf(ways[back, own[edges[:, 1]]])], len(vertices))


def _share(vertices, faces, posed):
    a, b, c = (vertices[faces[:, j]] for j in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas[true_tears(vertices, faces, posed)].sum() / areas.sum()


def _limbs(mesh, rng):
    """Return the ends of two limbs that are close in space, and distances from them."""
    vertices = mesh.vertices / mesh.area**0.5
    start = farthest_vertices(vertices, mesh.faces, rng.integers(mesh.n_vertices, size=1), 1)[1]
    candidates = np.append(start[0].argmax(), np.arange(mesh.n_vertices))
    tips, away = farthest_vertices(vertices, mesh.faces, candidates, N_TIPS)
    gaps = np.linalg.norm(vertices[tips][:, None] - vertices[tips], axis=2)
    gaps[away[:, tips] < 2 * FAR] = np.inf
    pairs = np.argwhere(np.triu(np.isfinite(gaps), 1))
    pairs = pairs[np.argsort(gaps[tuple(pairs.T)])][:N_PAIRS]
    pair = pairs[rng.integers(len(pairs))]
    return tips[pair], away[pair]


def _drawn_together(mesh, away, tips, share):
    """Return vertices of a mesh deformed as rigidly as possible so that two ends come close."""
    if not share:
        return mesh.vertices
    unit = mesh.area**0.5
    vertices = mesh.vertices / unit
    shift = share / 2 * (vertices[tips[1]] - vertices[tips[0]])
    ends = [np.flatnonzero(one < TIP) for one in away]
    nearest = away.min(axis=0)
    rest = np.flatnonzero(nearest > 0.6 * nearest.max())
    rows = np.concatenate([*ends, rest])
    points = np.concatenate([vertices[ends[0]] + shift, vertices[ends[1]] - shift, vertices[rest]])
    weights = np.concatenate([np.full(len(rows) - len(rest), 10.0), np.ones(len(rest))])
    shape = len(rows), mesh.n_vertices
    places = sp.csr_array((np.ones(len(rows)), (np.arange(len(rows)), rows)), shape=shape)
    at_rest = Deformation.of_reference(vertices, mesh.faces)
    return lay_on_points(at_rest, Anchors(places, points, weights), vertices) * unit
