"""The working mesh of a scan, in units of the reference."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import FloatArray, IntArray
from skfmap.functional.samples import farthest_points
from skfmap.geometry.closest import ClosestPoints
from skfmap.geometry.cutting import keep_faces, rim_length, without_crumbs
from skfmap.geometry.faults import components, sound_faces
from skfmap.geometry.geodesics import edge_path_distances
from skfmap.geometry.local_features import rim_distances
from skfmap.geometry.mending import mend
from skfmap.geometry.normals import vertex_normals
from skfmap.geometry.thinning import thin
from skfmap.partial.recognition import features_of

__all__ = ["Scan", "area_and_rim", "scan_of"]

# Number of points that are recognised, and number of those to which distances are computed.
N_POINTS, N_SAMPLES = 1500, 120
# Components below this fraction of the area are dropped as debris.
_CRUMB = 0.005
# Minimum number of vertices of a component when a scan is thinned.
_LEAST = 20


@dataclass(frozen=True, eq=False, repr=False)
class Scan:
    """The working mesh of a scan, in units of sqrt(area) of the reference.

    Attributes
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        A mesh without unusable faces or debris, of bounded size and with one or more components.
    """

    vertices: FloatArray
    faces: IntArray

    def __getstate__(self) -> dict[str, object]:
        """Return the state without the search tree, which other processes build again."""
        return {name: value for name, value in vars(self).items() if name != "surface"}

    @cached_property
    def normals(self) -> FloatArray:
        """Normals of the vertices."""
        return vertex_normals(self.vertices, self.faces)

    @cached_property
    def surface(self) -> ClosestPoints:
        """Search tree for closest points."""
        return ClosestPoints(self.vertices, self.faces)

    @cached_property
    def features(self) -> npt.NDArray[np.float32]:
        """Local features of all vertices."""
        return features_of(self.vertices, self.faces)

    @cached_property
    def from_rim(self) -> FloatArray:
        """Distances of the vertices from the rim, in sqrt(area) of the reference."""
        return rim_distances(self.vertices, self.faces)

    @cached_property
    def points(self) -> IntArray:
        """Well-spread vertices that are recognised."""
        return farthest_points(self.vertices, N_POINTS)

    @cached_property
    def distances(self) -> FloatArray:
        """Distances along the scan from ``points`` to the first of them."""
        away = edge_path_distances(self.vertices, self.faces, self.points[:N_SAMPLES])
        return np.asarray(away[:, self.points].T)

    @cached_property
    def straight(self) -> FloatArray:
        """Straight-line distances from ``points`` to the first of them."""
        at = self.vertices[self.points]
        return np.asarray(np.linalg.norm(at[:, None] - at[None, :N_SAMPLES], axis=2))


def scan_of(vertices: FloatArray, faces: IntArray, unit: float, max_vertices: int | None) -> Scan:
    """Return the working mesh of a scan.

    Parameters
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        The given mesh, with at least one usable face.
    unit : float
        Square root of the area of the reference, in the units of the coordinates.
    max_vertices : int or None
        Maximum number of vertices.
    """
    kept = sound_faces(vertices, faces)
    found = keep_faces(vertices / unit, faces, kept)
    areas_unit = area_and_rim(*found)[0]
    found = without_crumbs(*found, _CRUMB * areas_unit)
    if max_vertices is not None and len(found[0]) > max_vertices:
        found = _thinned(*found, max_vertices / len(found[0]))
    return Scan(np.ascontiguousarray(found[0]), np.ascontiguousarray(found[1], dtype=np.int64))


def _thinned(vertices: FloatArray, faces: IntArray, share: float) -> tuple[FloatArray, IntArray]:
    """Return a mesh with the given fraction of its vertices; components are mended if necessary."""
    pieces, found, n = components(faces, len(vertices))[faces[:, 0]], [], 0
    for piece in np.unique(pieces):
        own = keep_faces(vertices, faces, pieces == piece)
        mended = mend(*own)
        thinned = thin(mended.vertices, mended.faces, max(int(share * len(own[0])), _LEAST))
        found.append((thinned.vertices, thinned.faces + n))
        n += len(thinned.vertices)
    all_vertices, all_faces = (np.concatenate(part) for part in zip(*found, strict=True))
    return all_vertices, all_faces


def area_and_rim(vertices: FloatArray, faces: IntArray) -> tuple[float, float]:
    """Return the area of a mesh and the length of its rim."""
    a, b, c = (vertices[faces[:, j]] for j in range(3))
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    return area, rim_length(vertices, faces)
