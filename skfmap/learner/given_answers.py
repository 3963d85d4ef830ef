"""Transfer of answers from working meshes to the given meshes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.spatial import KDTree

from skfmap._measures import PairErrors
from skfmap._tools.types import FloatArray, IntArray, SparseMatrix
from skfmap.geometry.faults import sound_faces
from skfmap.geometry.geodesics import mean_edge_length
from skfmap.geometry.normals import vertex_normals
from skfmap.geometry.places import Places, Surface, surface_of_places
from skfmap.io import open_given
from skfmap.shapes import Correspondence, GivenMesh, Match, Mesh, ProbedShape, SpectralShape

__all__ = [
    "GivenReference",
    "drawn_on_working_meshes",
    "errors_on_working_mesh",
    "given_reference",
    "given_surface",
    "on_given_meshes",
    "on_working_mesh",
    "point_map_on_given",
]

# A point within a face is mapped between the images of its corners if these are at most this many
# edges of the reference's working mesh apart. Otherwise the map is torn there, and the point
# follows its nearest corner. Smooth maps stretch faces to two or three edges.
_TORN = 6.0


@dataclass(frozen=True, eq=False)
class GivenReference:
    """The given mesh of the reference, for answers on it.

    Attributes
    ----------
    shape : SpectralShape
        The reference on its working mesh.
    """

    shape: SpectralShape

    @cached_property
    def arrays(self) -> tuple[FloatArray, IntArray]:
        """Vertices and sound faces of the given mesh, which is opened if necessary."""
        mesh = self.shape.mesh if self.shape.given is None else open_given(self.shape.given)
        vertices, faces = (mesh.vertices, mesh.faces) if isinstance(mesh, Mesh) else mesh
        return vertices, faces[sound_faces(vertices, faces)]

    @cached_property
    def surface(self) -> Surface:
        """The given mesh, placed on the working mesh, to look up places of both."""
        mesh, prolongation = self.shape.mesh, self.shape.prolongation
        if prolongation is None:
            return Surface(mesh.vertices, mesh.faces)
        places = Places(prolongation.face, prolongation.coordinates, np.empty(0))
        return surface_of_places(self.arrays[1], places, mesh.vertices, mesh.faces)

    @property
    def is_working(self) -> bool:
        """Whether the given mesh is the working mesh itself, vertex by vertex."""
        return self.shape.prolongation is None

    def places(self, points: FloatArray, normals: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the given vertices nearest to points, and their weights, both of shape (n, 3)."""
        face, coordinates, _ = self.surface.locate(points, normals)
        last_two = coordinates.astype(np.float64)
        weights = np.column_stack([np.maximum(1 - last_two.sum(axis=1), 0.0), last_two])
        weights /= weights.sum(axis=1, keepdims=True)  # coordinates are in single precision
        return self.arrays[1][face], weights

    def of_working_vertices(self) -> IntArray:
        """Return the given vertex nearest to each working vertex."""
        mesh = self.shape.mesh
        if self.shape.keeps_vertices:
            return self.shape.given_vertices()
        normals = vertex_normals(mesh.vertices, mesh.faces)
        return self.nearest_corners(*self.places(mesh.vertices, normals))

    def nearest_corners(self, corners: IntArray, weights: FloatArray) -> IntArray:
        """Return which of the three given vertices is nearest to each place."""
        at = self.arrays[0][corners]
        away = np.linalg.norm(at - np.einsum("nc,ncd->nd", weights, at)[:, None], axis=2)
        return np.take_along_axis(corners, np.argmin(away, axis=1)[:, None], axis=1)[:, 0]


def given_surface(spectral: SpectralShape) -> tuple[FloatArray, IntArray]:
    """Return the used vertices and sound faces of a shape's given mesh."""
    mesh = spectral.mesh if spectral.given is None else open_given(spectral.given)
    vertices, faces = (mesh.vertices, mesh.faces) if isinstance(mesh, Mesh) else mesh
    faces = faces[sound_faces(vertices, faces)]
    used, back = np.unique(faces, return_inverse=True)
    return vertices[used], back.reshape(-1, 3)


def given_reference(reference: ProbedShape, shapes: Sequence[ProbedShape] = ()) -> GivenReference:
    """Return the given mesh of the reference, for answers on these shapes.

    Shared results are computed now, before threads need them.
    """
    target = GivenReference(reference.spectral)
    if not all(one.spectral.keeps_vertices for one in (reference, *shapes)):
        target.places(np.zeros((1, 3)), np.array([[0.0, 0, 1]]))
    return target


def on_working_mesh(
    shape: ProbedShape, truth: Correspondence
) -> tuple[ProbedShape, Correspondence]:
    """Return the shape with its working mesh as the given one, and its correspondence there."""
    spectral = shape.spectral
    if spectral.prolongation is None:
        return shape, truth
    to_working = spectral.working_vertices(np.arange(spectral.n_given))
    alone = replace(shape, spectral=replace(spectral, prolongation=None, given=None))
    return alone, truth.renumber(to_working)


def errors_on_working_mesh(errors: PairErrors, spectral: SpectralShape) -> PairErrors:
    """Return errors between given meshes, moved to the nearest working vertices."""
    return replace(errors, vertices=spectral.working_vertices(errors.vertices))


def drawn_on_working_meshes(
    match: Match, spectral: SpectralShape, reference: SpectralShape
) -> Match:
    """Return a match between given meshes as one between working meshes, for plotting.

    Each working vertex gets the answer of the given vertex nearest to it.
    """
    if spectral.prolongation is None and reference.prolongation is None:
        return match
    at = spectral.given_vertices()
    p2p_given = np.append(match.p2p, -1)[at]
    p2p = reference.working_vertices(np.maximum(p2p_given, 0))
    unknown = p2p_given < 0

    def shown(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else np.append(values, np.nan)[at]

    return replace(
        match,
        p2p=np.where(unknown, -1, p2p),
        expected_error=shown(match.expected_error),
        confidence=shown(match.confidence),
        n_supporting=None if match.n_supporting is None else np.append(match.n_supporting, 0)[at],
        matrix=None,
        inverse=None,
        reference_hash=reference.mesh.content_hash,
        given=GivenMesh.of(spectral.mesh),
        reference_given=GivenMesh.of(reference.mesh),
    )


def on_given_meshes(
    match: Match,
    spectral: SpectralShape,
    images: SparseMatrix,
    target: GivenReference,
    interpolate: str | None,
) -> Match:
    """Return a match with answers at the vertices of the given meshes.

    Parameters
    ----------
    match : Match
        The match between the working meshes.
    spectral : SpectralShape
        The shape S_i.
    images : sparse array of shape (n_working_i, n_working_0)
        Place of each working vertex of S_i on the working mesh of S_0; rows sum to 1.
    target : GivenReference
        The given mesh of S_0.
    interpolate : {"barycentric", "soft"} or None
        How ``match.matrix`` is interpolated.

    Returns
    -------
    Match
        The match between the given meshes; -1 and NaN where a given vertex has no place on the
        working mesh.
    """
    p2p, matrix = _point_map(spectral, match.p2p, images, target)
    if interpolate is None:
        matrix = _one_each(p2p, target.shape.n_given)
    elif interpolate == "soft":
        matrix = _of_working(match.matrix, spectral, target)
    return replace(
        match,
        p2p=p2p,
        expected_error=_prolonged(match.expected_error, spectral),
        confidence=_prolonged(match.confidence, spectral),
        n_supporting=_at_nearest(match.n_supporting, spectral),
        matrix=matrix,
        inverse=_inverse(match.inverse, spectral, target),
    )


def point_map_on_given(
    spectral: SpectralShape, p2p: IntArray, images: SparseMatrix, target: GivenReference
) -> IntArray:
    """Return the given vertex of S_0 for each given vertex of S_i; -1 without a place.

    ``p2p`` and ``images`` are the point-to-point map between the working meshes, to vertices and to
    places.
    """
    return _point_map(spectral, p2p, images, target)[0]


def _point_map(
    spectral: SpectralShape, p2p: IntArray, images: SparseMatrix, target: GivenReference
) -> tuple[IntArray, SparseMatrix]:
    """Return the point-to-point map between given meshes, to vertices and to places."""
    reference = target.shape
    if spectral.keeps_vertices and reference.keeps_vertices:
        at = target.of_working_vertices()
        return _at_nearest(at[p2p], spectral, -1), _of_working(images, spectral, target)
    mesh_0 = reference.mesh
    columns = images @ np.hstack([mesh_0.vertices, vertex_normals(mesh_0.vertices, mesh_0.faces)])
    carried, placed = _carried(spectral, columns, mesh_0)
    corners, weights = target.places(carried[:, :3], carried[:, 3:])
    shape = (spectral.n_given, reference.n_given)
    places = sp.coo_array((weights.ravel(), (np.repeat(placed, 3), corners.ravel())), shape=shape)
    matrix = places.tocsr()
    matrix.eliminate_zeros()
    return _filled(target.nearest_corners(corners, weights), placed, shape[0]), matrix


def _inverse(inverse: IntArray, spectral: SpectralShape, target: GivenReference) -> IntArray:
    """Return the given vertex of S_i for each given vertex of S_0; -1 without a place."""
    reference, mesh = target.shape, spectral.mesh
    if spectral.keeps_vertices and reference.keeps_vertices:
        return _at_nearest(spectral.given_vertices()[inverse], reference, -1)
    columns = np.hstack([mesh.vertices, vertex_normals(mesh.vertices, mesh.faces)])
    wanted, placed_0 = _carried(reference, columns[inverse], mesh)
    own, placed = _carried(spectral, columns, None)
    # Distances include the normals, so that the two sides of a wall are not near each other.
    scale = np.array([1, 1, 1, *[mean_edge_length(mesh.vertices, mesh.faces)] * 3])
    _, found = KDTree(own * scale).query(wanted * scale, workers=-1)
    return _filled(placed[found], placed_0, reference.n_given)


def _carried(
    spectral: SpectralShape, columns: FloatArray, onto: Mesh | None
) -> tuple[FloatArray, IntArray]:
    """Return points and normals of working vertices, carried to the given vertices with a place.

    They are interpolated between the corners of a face. If the corners are far apart on the mesh
    ``onto``, those of the nearest corner are used.
    """
    if spectral.prolongation is None:
        return columns, np.arange(len(columns))
    faces, placed = spectral.mesh.faces, np.flatnonzero(spectral.prolongation.placed)
    rows = spectral.prolongation.matrix(faces, spectral.mesh.n_vertices, placed)
    carried = np.asarray(rows @ columns, dtype=np.float64)
    if onto is not None:
        at = columns[:, :3][faces]
        apart = np.linalg.norm(at - np.roll(at, 1, axis=1), axis=2).max(axis=1)
        torn = apart > _TORN * mean_edge_length(onto.vertices, onto.faces)
        alone = torn[spectral.prolongation.face[placed]]
        carried[alone] = columns[spectral.working_vertices(placed[alone])]
    return carried, placed


def _of_working(
    matrix: SparseMatrix, spectral: SpectralShape, target: GivenReference
) -> SparseMatrix:
    """Return a matrix between working meshes as a matrix between the given meshes."""
    step = _one_each(target.of_working_vertices(), target.shape.n_given)
    return (spectral.prolongation_matrix @ matrix @ step).tocsr()


def _one_each(p2p: IntArray, n_0: int) -> SparseMatrix:
    """Return a point-to-point map as a matrix; rows for -1 are empty."""
    known = np.flatnonzero(p2p >= 0)
    return sp.csr_array((np.ones(len(known)), (known, p2p[known])), shape=(len(p2p), n_0))


def _filled(values: IntArray, placed: IntArray, n: int) -> IntArray:
    out = np.full(n, -1, dtype=np.int64)
    out[placed] = values
    return out


def _prolonged(values: FloatArray | None, spectral: SpectralShape) -> FloatArray | None:
    return None if values is None else spectral.prolong(values)


def _at_nearest(values: Any, spectral: SpectralShape, empty: int = 0) -> Any:
    """Return the value at the working vertex nearest to each given vertex; None stays None."""
    if values is None:
        return None
    return np.append(values, empty)[spectral.working_vertices(np.arange(spectral.n_given))]
