"""Projection of measured points onto the surface of their shape, with checks of plausibility."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import as_array, as_reals, label
from skfmap.exceptions import CorrespondenceError, MeshError
from skfmap.geometry.closest import nearest_places
from skfmap.geometry.faults import sound_faces
from skfmap.shapes.mesh import Mesh
from skfmap.shapes.surface_places import SurfacePlaces

__all__ = ["MeshArrays", "mesh_arrays", "put_on_surface"]

# Largest plausible median distance of landmarks from their mesh, as a fraction of its extent; it
# is 0.002 for mouse skulls.
_AWAY = 0.05
# Above the first median distance, landmarks are rejected if converted ones are that many times
# nearer.
_BESIDE, _NEARER = 0.01, 5.0
# Conversions that a file may have missed: factors of units, and signs of axes.
_UNITS = {
    1000.0: "metres against millimetres",
    100.0: "metres against centimetres",
    25.4: "inches against millimetres",
    10.0: "centimetres against millimetres",
}
_LPS_RAS = np.array([-1.0, -1.0, 1.0])
# Range of plausible extents of the landmarks, as fractions of the extent of the mesh.
_NARROWEST, _WIDEST = 0.1, 1.5


class MeshArrays(NamedTuple):
    """Vertices, faces and name of a given mesh, which need not be sound."""

    vertices: FloatArray
    faces: IntArray
    name: str | None


def mesh_arrays(mesh: Any, name: str | None = None) -> MeshArrays:
    """Return the arrays of a `Mesh`, of an object with ``vertices`` and ``faces``, or of a pair.

    Raises
    ------
    TypeError
        If ``mesh`` has another type, for instance if it is a path.
    MeshError
        If the arrays are not a triangle mesh, or none of its faces is sound.
    """
    if isinstance(mesh, Mesh):
        return _with_sound_face(MeshArrays(mesh.vertices, mesh.faces, mesh.name or name))
    given = (mesh.vertices, mesh.faces) if hasattr(mesh, "faces") else mesh
    if isinstance(given, str) or not isinstance(given, Sequence) or len(given) != 2:
        raise TypeError(
            "mesh must be a Mesh, a trimesh.Trimesh or (vertices, faces); got "
            f"{type(mesh).__name__}. Read files with skfmap.io.read_mesh."
        )
    who = label(name)
    vertices = as_reals(given[0], f"The vertices of {who}", MeshError)
    faces = as_array(given[1], f"The faces of {who}", MeshError)
    for what, array in (("vertices", vertices), ("faces", faces)):
        if array.ndim != 2 or array.shape[1] != 3:
            raise MeshError(f"The {what} of {who} must have shape (n, 3); got {array.shape}.")
    if not np.issubdtype(faces.dtype, np.integer):
        raise MeshError(f"The faces of {who} must be integers; got dtype {faces.dtype}.")
    return _with_sound_face(MeshArrays(vertices, faces.astype(np.int64), name))


def _with_sound_face(mesh: MeshArrays) -> MeshArrays:
    if not sound_faces(mesh.vertices, mesh.faces).any():
        raise MeshError(
            f"{label(mesh.name)} has no sound face that a point could lie on. Check the file."
        )
    return mesh


def put_on_surface(
    points: FloatArray, names: Sequence[str], mesh: MeshArrays, max_distance: float
) -> tuple[SurfacePlaces, FloatArray]:
    """Return the places on a mesh nearest to some points, and the distances from the points.

    Parameters
    ----------
    points : ndarray of shape (n, 3)
        Finite coordinates.
    names : sequence of str
        Names of the points in messages.
    mesh : MeshArrays
        The mesh.
    max_distance : float
        Largest allowed distance, as a fraction of the largest extent of the mesh.

    Returns
    -------
    places : SurfacePlaces
        Nearest places on the given mesh.
    distances : ndarray of shape (n,)
        Distances of the points from them, in the units of the mesh.

    Raises
    ------
    CorrespondenceError
        If the points as a whole lie off the surface, or one lies farther than ``max_distance``
        away.
    """
    if len(points) == 0:
        return SurfacePlaces.at_vertices(np.empty(0, dtype=np.int64)), np.empty(0)
    found = nearest_places(points, mesh.vertices, mesh.faces)
    extent = _extent(mesh.vertices[mesh.faces[sound_faces(mesh.vertices, mesh.faces)]])
    _check_all(points, found.distances, mesh, extent)
    far = np.flatnonzero(found.distances > max_distance * extent)
    if len(far):
        told = ", ".join(f"{names[i]!r} ({found.distances[i] / extent:.0%})" for i in far.tolist())
        raise CorrespondenceError(
            f"These landmarks of {label(mesh.name, 'shape')} lie farther from the surface than "
            f"{max_distance:.0%} of its largest extent: {told}. They may be misplaced, or not "
            "placed at all. Correct them, give NaN for missing ones, or raise max_distance of "
            "Correspondence.from_points."
        )
    return SurfacePlaces(found.corners, found.weights), found.distances


def _check_all(points: FloatArray, distances: FloatArray, mesh: MeshArrays, extent: float) -> None:
    """Raise an error if the points as a whole do not lie on the mesh."""
    away = float(np.median(distances)) / extent
    if away <= _BESIDE:
        return
    least, reason = _best_reason(points, mesh, extent)
    explained = least < min(_AWAY, away / _NEARER)
    if away <= _AWAY and not explained:
        return
    if not explained:
        times = _extent(points) / extent
        sizes = "" if times <= _WIDEST else f" They span {times:.3g} times its extent."
        reason = (
            f"{sizes} Check that the file belongs to this specimen, and that the mesh was not "
            "moved, rotated or scaled afterwards."
        )
    raise CorrespondenceError(
        f"The landmarks do not lie on {label(mesh.name, 'shape')}: half of them are at least "
        f"{away:.3g} times its largest extent away.{reason} Nothing was changed."
    )


def _best_reason(points: FloatArray, mesh: MeshArrays, extent: float) -> tuple[float, str]:
    """Return the least median distance after a change of units or signs, and describe it."""
    tried = [(np.inf, "")]
    factors = {1.0: ""}
    for factor, units in _UNITS.items():
        factors |= {
            factor: f"multiplied by {factor:g} ({units}?)",
            1 / factor: f"divided by {factor:g} ({units}?)",
        }
    for factor, scaled in factors.items():
        if not _NARROWEST <= factor * _extent(points) / extent <= _WIDEST:
            continue
        for signs, turned in ((1.0, ""), (_LPS_RAS, "with x and y negated (RAS against LPS?)")):
            done = " and ".join(one for one in (scaled, turned) if one)
            if done:
                there = nearest_places(points * factor * signs, mesh.vertices, mesh.faces)
                away = float(np.median(there.distances)) / extent
                tried.append((away, f" They do if {done}."))
    return min(tried)


def _extent(points: FloatArray) -> float:
    """Return the largest extent along an axis."""
    return max(float(np.ptp(points.reshape(-1, 3), axis=0).max()), 1e-300)
