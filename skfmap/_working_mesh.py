"""From the given mesh to a working mesh that is sound, connected and of bounded size."""

from typing import NamedTuple

import numpy as np

from skfmap._tools.caching import MemoryLike, cached, hash_of_arrays
from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import LARGEST_AREA, SMALLEST_AREA, label
from skfmap.exceptions import MeshError
from skfmap.geometry.faults import (
    count_components,
    degenerate_faces,
    is_wound_consistently,
    nonmanifold_edges,
    repeated_corners,
    sound_faces,
    unreferenced_vertices,
)
from skfmap.geometry.normals import vertex_normals
from skfmap.geometry.orientation import orient_faces, signed_volume
from skfmap.geometry.places import Surface, places_after_collapse
from skfmap.geometry.thinning import check_thinned, thin
from skfmap.geometry.wrapping import wants_wrapping, wrap
from skfmap.health import WOUND, repair_arrays
from skfmap.shapes import Mesh, Prolongation

__all__ = ["WorkingMesh", "check_sound", "working_mesh"]

# The user is told if walls over more than this fraction of the area are thinner than an edge of the
# working mesh.
_THIN_WALLS = 0.1
# The user is told if thinning moves the surface farther than this anywhere, in sqrt(area); it is
# the length of three edges of a mesh of 5,000 vertices.
_FAR_OFF = 0.05
# Distance, in closing radii, within which a vertex counts as lying on the shell.
_REACH = 2.0

_MENDS = "SpectralBasis(on_invalid='mend')"


class WorkingMesh(NamedTuple):
    """The mesh that is computed on, and how it relates to the given mesh.

    Attributes
    ----------
    mesh : Mesh
        The working mesh, wound consistently and outwards where this can be determined.
    consistent, outward : bool
        Whether the winding is consistent, and outwards.
    prolongation : Prolongation or None
        From the working mesh to the given one; None if their vertices are the same.
    told : tuple of str
        Changes that the user should know of.
    """

    mesh: Mesh
    consistent: bool
    outward: bool
    prolongation: Prolongation | None
    told: tuple[str, ...] = ()


def working_mesh(
    given: Mesh | tuple[FloatArray, IntArray],
    name: str | None,
    *,
    mend: bool,
    wrap: bool,
    max_vertices: int | None,
    laplacian: str,
    memory: MemoryLike = None,
) -> WorkingMesh:
    """Return the working mesh of a given mesh.

    Parameters
    ----------
    given : Mesh, or (vertices, faces)
        The given mesh. Arrays may have any fault if ``mend`` is true.
    name : str or None
        Name of the mesh in messages.
    mend, wrap : bool
        Whether the mesh may be mended, and wrapped if it is not the surface of one body.
    max_vertices : int or None
        Maximum number of vertices of the working mesh; None for any number.
    laplacian : str
        Laplacian that the working mesh must be sound enough for.
    memory : str or joblib.Memory, optional
        Where thinned and wrapped meshes are cached.

    Returns
    -------
    WorkingMesh
        The working mesh; this is the given mesh itself if it is sound and small.

    Raises
    ------
    MeshError
        If the mesh is not sound, and cannot or must not be mended.
    """
    vertices, faces = (given.vertices, given.faces) if isinstance(given, Mesh) else given
    sound = _mended(given, name) if mend else _as_it_is(given, name, laplacian)
    if wrap and sound.reason_to_wrap:
        content_hash = hash_of_arrays(vertices, faces)
        shell = cached(_wrapped, memory)((vertices, faces), content_hash, max_vertices)
        working = _of_shell(shell, name, sound)
        check_sound(working.mesh, laplacian)
        return working
    mesh, vertex_map = sound.mesh, sound.vertex_map
    if max_vertices is None or mesh.n_vertices <= max_vertices:
        faces, consistent, outward = orient_faces(mesh.vertices, mesh.faces)
        if not np.array_equal(faces, mesh.faces):
            mesh = Mesh(mesh.vertices, faces, name)
        prolongation = None if vertex_map is None else Prolongation.of_vertices(vertex_map, faces)
        working = WorkingMesh(mesh, consistent, outward, prolongation, sound.done)
    else:
        small = cached(_thinned, memory)(mesh, mesh.content_hash, max_vertices)
        prolongation = Prolongation.packed(small.face, small.coordinates)
        if vertex_map is not None:
            prolongation = prolongation.renumbered(vertex_map)
        told = (*sound.done, *_told_of_walls(small, mesh))
        mesh = Mesh(small.vertices, small.faces, name)
        working = WorkingMesh(mesh, small.consistent, small.outward, prolongation, told)
    if mend:
        check_sound(working.mesh, laplacian)
    return working


class _Sound(NamedTuple):
    """A sound mesh, the new index of each given vertex, and what was done.

    ``reason_to_wrap`` says why it is not the surface of one body; it is empty if it is one.
    """

    mesh: Mesh
    vertex_map: IntArray | None
    done: tuple[str, ...] = ()
    reason_to_wrap: str = ""


def _as_it_is(
    given: Mesh | tuple[FloatArray, IntArray], name: str | None, laplacian: str
) -> _Sound:
    mesh = given if isinstance(given, Mesh) else Mesh(*given, name)
    check_sound(mesh, laplacian)
    return _Sound(mesh, None)


def _mended(given: Mesh | tuple[FloatArray, IntArray], name: str | None) -> _Sound:
    vertices, faces = (given.vertices, given.faces) if isinstance(given, Mesh) else given
    repair = repair_arrays(vertices, faces, name)
    mesh = given if isinstance(given, Mesh) and not repair.done else repair.mesh
    done = tuple(one for one in repair.done if one != WOUND)
    vertex_map = repair.vertex_map if repair.renumbered else None
    return _Sound(mesh, vertex_map, done, wants_wrapping(mesh.faces, repair.tally))


class _Thinned(NamedTuple):
    """A thinned mesh, its winding, and the place on it of each original vertex.

    ``thin_walls`` is a fraction of the area; ``hausdorff`` is the largest distance between the
    thinned and the original surface, in sqrt(area).
    """

    vertices: FloatArray
    faces: IntArray
    consistent: bool
    outward: bool
    face: IntArray
    coordinates: FloatArray
    thin_walls: float
    hausdorff: float


def _thinned(mesh: Mesh, content_hash: str, n_vertices: int) -> _Thinned:  # noqa: ARG001
    """Thin a mesh, and find the place of each original vertex by following the collapses.

    The nearest point in space would not do: it may be on the other side of a thin wall.
    """
    given = mesh.faces
    if not is_wound_consistently(given):
        given, _, _ = orient_faces(mesh.vertices, given)
    try:
        small = thin(mesh.vertices, given, n_vertices)
    except ValueError as error:
        raise _not_thinned(mesh, n_vertices, str(error)) from error
    faces, consistent, outward = orient_faces(small.vertices, small.faces)
    # An open surface may have been wound inwards.
    flipped = -1.0 if outward and signed_volume(small.vertices, small.faces) < 0 else 1.0
    normals = flipped * vertex_normals(mesh.vertices, given)
    places = places_after_collapse(mesh.vertices, normals, small.vertices, faces, small.vertex_map)
    report = check_thinned(mesh.vertices, given, small, places.distance)
    if not report.manifold or report.n_pieces > 1:
        raise _not_thinned(mesh, n_vertices, "its surface would come apart")
    return _Thinned(
        small.vertices,
        faces,
        consistent,
        outward,
        places.face.astype(np.int64),
        places.coordinates.astype(np.float64),
        report.thin_wall_share,
        max(report.hausdorff),
    )


def _not_thinned(mesh: Mesh, n_vertices: int, why: str) -> MeshError:
    return MeshError(
        f"{label(mesh.name)} cannot be thinned to {n_vertices} vertices: {why}. Mend it "
        f"({_MENDS}), or set max_vertices=None."
    )


def _told_of_walls(small: _Thinned, mesh: Mesh) -> list[str]:
    thinned = f"thinned to {len(small.vertices)} of {mesh.n_vertices} vertices"
    told = []
    if small.thin_walls > _THIN_WALLS:
        told.append(
            f"{thinned}; walls over {small.thin_walls:.0%} of the area are thinner than an edge, "
            "and their two sides may be confused (increase max_vertices of SpectralBasis to "
            "separate them)"
        )
    if small.hausdorff > _FAR_OFF:
        told.append(
            f"{thinned}; part of the surface moved by {small.hausdorff:.2f} sqrt(area), because "
            "it is too thin for so few vertices"
        )
    return told


class _Shell(NamedTuple):
    """The thinned shell around a mesh, and the place on it of each vertex."""

    vertices: FloatArray
    faces: IntArray
    face: IntArray
    coordinates: FloatArray
    radius: float


def _wrapped(
    given: tuple[FloatArray, IntArray],
    content_hash: str,  # noqa: ARG001
    max_vertices: int | None,
) -> _Shell:
    """Wrap a mesh, and place the vertices that the shell reaches with agreeing normals on it."""
    vertices, faces = given
    faces = faces[sound_faces(vertices, faces)]
    shell = wrap(vertices, faces)
    points, triangles = shell.vertices, shell.faces
    if max_vertices is not None and len(points) > max_vertices:
        points, triangles, _ = thin(points, triangles, max_vertices)
    used = np.unique(faces)
    face, coordinates = np.full(len(vertices), -1), np.zeros((len(vertices), 2))
    at, where, distances = Surface(points, triangles).locate(
        vertices[used], vertex_normals(vertices, faces)[used], agreeing=True
    )
    reached = distances <= _REACH * shell.radius  # False for vertices without a place
    face[used[reached]], coordinates[used[reached]] = at[reached], where[reached]
    return _Shell(points, triangles, face, coordinates, shell.radius)


def _of_shell(shell: _Shell, name: str | None, sound: _Sound) -> WorkingMesh:
    if (shell.face < 0).all():
        raise MeshError(
            f"{label(name)} cannot be wrapped: the shell reaches none of its vertices. Use "
            "SpectralBasis(wrap=None)."
        )
    told = (
        f"wrapped, because {sound.reason_to_wrap}: openings narrower than {2 * shell.radius:.3g} "
        f"of its units are closed, and {(shell.face < 0).sum()} of {len(shell.face)} vertices "
        "have no answer, because the shell does not reach them"
    )
    mesh = Mesh(shell.vertices, shell.faces, name)
    prolongation = Prolongation.packed(shell.face, shell.coordinates)
    return WorkingMesh(mesh, True, True, prolongation, (*sound.done, told))


def check_sound(mesh: Mesh, laplacian: str) -> None:
    """Raise if an eigenbasis of the mesh would be wrong, or would crash the libraries."""
    who = label(mesh.name)
    if len(loose := unreferenced_vertices(mesh.faces, mesh.n_vertices)):
        raise MeshError(
            f"{who} has {len(loose)} vertices that no face uses; the first is vertex {loose[0]}. "
            "Remove them and renumber its correspondences accordingly, or leave that to "
            f"{_MENDS}."
        )
    if len(repeated := repeated_corners(mesh.faces)):
        raise MeshError(
            f"{who} has {len(repeated)} faces with a repeated vertex; the first is face "
            f"{repeated[0]}. Remove these faces (vertex indices do not change), or leave that to "
            f"{_MENDS}."
        )
    if (n_parts := count_components(mesh.faces, mesh.n_vertices)) > 1:
        raise MeshError(
            f"{who} has {n_parts} connected components, which a functional map cannot relate. Keep "
            "the largest, or merge duplicate vertices if they split the surface along seams, or "
            f"leave that to {_MENDS}."
        )
    if not SMALLEST_AREA < mesh.area < LARGEST_AREA:
        raise MeshError(
            f"{who} has an area of {mesh.area:.2g}, which is too extreme to compute with; check "
            "its coordinates, or choose another unit of length."
        )
    if laplacian == "cotangent":
        _check_cotangent(mesh, who)


def _check_cotangent(mesh: Mesh, who: str) -> None:
    remedy = f"Mend them ({_MENDS}), or use SpectralBasis(laplacian='robust')."
    if len(flat := degenerate_faces(mesh.vertices, mesh.faces)):
        raise MeshError(
            f"{who} has {len(flat)} faces without area; the first is face {flat[0]}. {remedy}"
        )
    if len(edges := nonmanifold_edges(mesh.faces)):
        raise MeshError(
            f"{who} has {len(edges)} edges with more than two faces; the first is "
            f"{edges[0].tolist()}. {remedy}"
        )
