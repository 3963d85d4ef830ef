"""What is wrong with a mesh, what it means for a functional map, and what can be mended."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from skfmap._tools.ties import first_of_largest
from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import (
    LARGEST_AREA,
    LARGEST_COORDINATE,
    SMALLEST_AREA,
    as_array,
    as_reals,
    is_finite,
    label,
)
from skfmap.exceptions import MeshError
from skfmap.geometry.faults import (
    boundary_pieces,
    components,
    degenerate_faces,
    duplicate_faces,
    duplicate_vertices,
    is_wound_consistently,
    nonmanifold_edges,
    nonmanifold_vertices,
    repeated_corners,
    slivers,
    sound_faces,
    unreferenced_vertices,
)
from skfmap.geometry.orientation import orient_faces, signed_volume
from skfmap.io import MeshLike, read_arrays
from skfmap.shapes import Mesh

__all__ = ["Fault", "MeshReport", "Repair", "check_mesh", "repair_mesh"]

# A mesh this many times its extent away from the origin has lost six of sixteen digits of its
# coordinates. Only a note hangs on it; other numbers were never tried.
_FAR = 1e6
# Share of the vertices that a repair may remove before it asks whether the mesh is whole; a guess.
_MANY_REMOVED = 0.2


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with a mesh.

    Attributes
    ----------
    kind : str
        What it is.
    level : {"fatal", "robust", "mended", "note"}
        ``"fatal"``: `SpectralBasis` refuses the mesh. ``"robust"``: it refuses it unless
        ``laplacian="robust"``. ``"mended"``: it puts that right by itself, vertices keep their
        numbers. ``"note"``: it is accepted.
    count : int
        How often.
    first : int or None
        The first vertex or face concerned.
    meaning : str
        What it means here, and what to do.
    """

    kind: str
    level: str
    count: int
    first: int | None
    meaning: str

    def __str__(self) -> str:
        """Return one line."""
        first = "" if self.first is None else f", the first is {self.first}"
        count = f" ({self.count}{first})" if first or self.count > 1 else ""
        return f"[{self.level}] {self.kind}{count}: {self.meaning}"


@dataclass(frozen=True)
class MeshReport:
    """All that `check_mesh` found.

    Attributes
    ----------
    name : str or None
        Name of the mesh.
    n_vertices, n_faces : int
        Counts.
    faults : tuple of Fault
        The worst first; empty if nothing is wrong.
    """

    name: str | None
    n_vertices: int
    n_faces: int
    faults: tuple[Fault, ...]

    def usable(self, laplacian: str = "cotangent") -> bool:
        """Return whether `SpectralBasis` takes the mesh as it is, with this Laplacian."""
        refused = ("fatal", "robust") if laplacian == "cotangent" else ("fatal",)
        return not any(fault.level in refused for fault in self.faults)

    def __str__(self) -> str:
        """Return a line for the mesh, and one for each fault."""
        verdict = (
            "sound" if not self.faults else "usable" if self.usable() else "not usable as it is"
        )
        if not self.usable() and self.usable("robust"):
            verdict = "usable with SpectralBasis(laplacian='robust')"
        head = f"{label(self.name)}: {self.n_vertices} vertices, {self.n_faces} faces, {verdict}"
        return "\n".join([head, *(f"  {fault}" for fault in self.faults)])


def check_mesh(mesh: MeshLike) -> MeshReport:
    """Say everything that is wrong with a mesh, and what it means for a functional map.

    Parameters
    ----------
    mesh : Mesh, trimesh.Trimesh, (vertices, faces) or path
        The mesh; arrays may be broken in any way.

    Returns
    -------
    MeshReport
        Print it.

    See Also
    --------
    repair_mesh : Mends what can be mended.

    Examples
    --------
    >>> from skfmap import check_mesh
    >>> vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [9, 9, 9]]
    >>> print(check_mesh((vertices, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])))
    mesh: 5 vertices, 4 faces, not usable as it is
      [fatal] unreferenced vertices (1, the first is 4): no face uses them, so that no function is
      defined there. \
repair_mesh removes them and says how the others are renumbered.
    """
    try:
        vertices, faces, name = _raw(mesh)
    except (MeshError, OSError) as error:
        name = Path(mesh).stem if isinstance(mesh, (str, Path)) else getattr(mesh, "name", None)
        return MeshReport(name, 0, 0, (Fault("unreadable", "fatal", 1, None, str(error)),))
    found = _faults_of_arrays(vertices, faces)
    sound = sound_faces(vertices, faces)
    if len(vertices) and sound.any():
        found += _faults_of_surface(vertices, faces[sound])
    order = ("fatal", "robust", "mended", "note")
    faults = tuple(sorted(found, key=lambda one: order.index(one.level)))
    return MeshReport(name, len(vertices), len(faces), faults)


def _raw(mesh: MeshLike) -> tuple[FloatArray, IntArray, str | None]:
    """Return vertices, faces and name, not checked."""
    name = getattr(mesh, "name", None)
    if isinstance(mesh, (str, Path)):
        name, mesh = Path(mesh).stem, read_arrays(mesh)
    if isinstance(mesh, (tuple, list)) and len(mesh) == 2:
        given = mesh[0], mesh[1]
    else:
        given = getattr(mesh, "vertices", None), getattr(mesh, "faces", None)
    vertices = as_reals(given[0], f"The vertices of {label(name)}", MeshError)
    faces = as_array(given[1], f"The faces of {label(name)}", MeshError)
    vertices, faces = (
        array.reshape(0, 3) if array.size == 0 else array for array in (vertices, faces)
    )
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(
            f"{label(name)} must have vertices of shape (n, 3) and triangles of shape (m, 3); got "
            f"{vertices.shape} and {faces.shape}. Triangulate it first."
        )
    if faces.size and not np.issubdtype(faces.dtype, np.integer):
        raise MeshError(f"The faces of {label(name)} must be integers; got dtype {faces.dtype}.")
    return vertices, faces.astype(np.int64), name if isinstance(name, str) else None


def _fault(kind: str, level: str, where: npt.ArrayLike, meaning: str) -> list[Fault]:
    """Return a fault of the vertices or faces with these indices, if there are any."""
    indices = np.asarray(where).ravel()
    return [Fault(kind, level, len(indices), int(indices[0]), meaning)] if len(indices) else []


def _faults_of_arrays(vertices: FloatArray, faces: IntArray) -> list[Fault]:
    """Return what is wrong with the numbers themselves."""
    if len(vertices) == 0 or len(faces) == 0:
        what = "vertices" if len(vertices) == 0 else "faces"
        return [Fault("empty", "fatal", 1, None, f"there are no {what}; leave the shape out.")]
    outside = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
    inside = faces[~outside]
    return [
        *_fault(
            "vertices with NaN or infinite coordinates",
            "fatal",
            np.flatnonzero(~is_finite(vertices)),
            f"or beyond {LARGEST_COORDINATE:.0e}, where areas overflow. repair_mesh removes them "
            "and their faces.",
        ),
        *_fault(
            "faces with indices out of range",
            "fatal",
            np.flatnonzero(outside),
            f"there are {len(vertices)} vertices (0 to {len(vertices) - 1}); a file that counts "
            "from 1? repair_mesh removes these faces.",
        ),
        *_fault(
            "faces that name a vertex twice",
            "fatal",
            repeated_corners(faces),
            "they are no triangles. repair_mesh removes them; vertices keep their numbers.",
        ),
        *_fault(
            "unreferenced vertices",
            "fatal",
            unreferenced_vertices(inside, len(vertices)),
            "no face uses them, so that no function is defined there. repair_mesh removes them "
            "and says how the others are renumbered.",
        ),
    ]


def _faults_of_surface(vertices: FloatArray, faces: IntArray) -> list[Fault]:
    """Return what is wrong with the surface that sound faces make."""
    used = np.unique(faces)
    points = vertices[used]
    local = np.searchsorted(used, faces)
    if extreme := _faults_of_scale(points, local):
        return extreme
    return [
        *_faults_of_distance(points),
        *_faults_of_pieces(used, local),
        *_fault(
            "faces without area",
            "robust",
            degenerate_faces(points, local),
            "their angles are unknown; laplacian='robust' copes.",
        ),
        *_fault(
            "edges with more than two faces",
            "robust",
            [used[edge[0]] for edge in nonmanifold_edges(local)],
            "the surface branches there; laplacian='robust' copes, without oriented probes if the "
            "faces cannot be wound consistently.",
        ),
        *_fault(
            "faces that stand there twice",
            "robust",
            duplicate_faces(local),
            "a sheet that covers another counts its area twice. repair_mesh keeps the first; "
            "vertices keep their numbers.",
        ),
        *_fault(
            "vertices where parts of the surface touch in a point",
            "note",
            used[nonmanifold_vertices(local, len(used))],
            "accepted; functions are continuous there, and curvature means little.",
        ),
        *_fault(
            "vertices at the same place as another",
            "note",
            used[duplicate_vertices(points)],
            "accepted; where they split the surface along a seam, functions may jump across it. "
            "repair_mesh merges them if that joins components.",
        ),
        *_fault(
            "slivers",
            "note",
            slivers(points, local),
            "accepted; curvature is noisy there. Many of them: remesh, or laplacian='robust'.",
        ),
        *_faults_of_sides(points, local),
        *_faults_of_boundary(local),
    ]


def _faults_of_scale(points: FloatArray, faces: IntArray) -> list[Fault]:
    with np.errstate(all="ignore"):
        corners = points[faces]
        crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = float(np.linalg.norm(crosses, axis=1).sum() / 2)
    if SMALLEST_AREA < area < LARGEST_AREA:
        return []
    meaning = f"the area is {area:.2g}, too extreme to compute with; choose another unit of length."
    return [Fault("extreme scale", "fatal", 1, None, meaning)]


def _faults_of_distance(points: FloatArray) -> list[Fault]:
    extent, distance = float(np.ptp(points, axis=0).max()), float(np.abs(points).max())
    if distance <= _FAR * extent:
        return []
    meaning = (
        f"the mesh is {distance / extent:.0e} times its own size away from the origin, so that its "
        "coordinates have lost as many digits; move it there before it is stored."
    )
    return [Fault("far from the origin", "note", 1, None, meaning)]


def _faults_of_pieces(used: IntArray, faces: IntArray) -> list[Fault]:
    piece = components(faces, len(used))
    counts = np.bincount(piece)
    if len(counts) == 1:
        return []
    meaning = (
        f"the largest has {counts.max() / len(used):.0%} of the vertices; a functional map cannot "
        "relate components. repair_mesh merges duplicate vertices if that joins them, and keeps "
        "the largest."
    )
    return [Fault("connected components", "fatal", len(counts), None, meaning)]


def _faults_of_sides(points: FloatArray, faces: IntArray) -> list[Fault]:
    _, consistent, outward = orient_faces(points, faces)
    if not consistent:
        meaning = "there is no outside (as on a Moebius band); use DescriptorTransformer('paper')."
        return [Fault("cannot be wound consistently", "note", 1, None, meaning)]
    if not is_wound_consistently(faces):
        meaning = "faces are turned; vertices keep their numbers."
        return [Fault("inconsistent winding", "mended", 1, None, meaning)]
    if not outward:
        meaning = (
            "which side is the outside cannot be told; oriented probes may take left for right."
        )
        return [Fault("encloses no volume", "note", 1, None, meaning)]
    if signed_volume(points, faces) < 0:
        meaning = "faces are turned outwards; vertices keep their numbers."
        return [Fault("inside out", "mended", 1, None, meaning)]
    return []


def _faults_of_boundary(faces: IntArray) -> list[Fault]:
    n_loops = len(boundary_pieces(faces))
    if n_loops == 0:
        return []
    meaning = "holes, or a rim: accepted; curvature there is that of the neighbours."
    return [Fault("boundary loops", "note", n_loops, None, meaning)]


@dataclass(frozen=True, eq=False)
class Repair:
    """A mended mesh, and what became of the vertices.

    Attributes
    ----------
    mesh : Mesh
        The mended mesh.
    vertex_map : ndarray of int, shape (n_vertices,)
        New number of each vertex of the mesh that was given; -1 where it was removed.
    done : tuple of str
        What was done; empty if there was nothing to do.
    """

    mesh: Mesh
    vertex_map: IntArray
    done: tuple[str, ...]

    @property
    def renumbered(self) -> bool:
        """Whether any vertex has another number than before, or none."""
        return not np.array_equal(self.vertex_map, np.arange(len(self.vertex_map)))


def repair_mesh(mesh: MeshLike) -> Repair:
    """Mend what can be mended, and say what was done.

    In this order: faces that are no triangles, lead nowhere or stand there twice are removed;
    duplicate vertices are merged if that joins components; the component of most area is kept;
    vertices that no face uses are removed; faces are wound consistently and outwards. No vertex is
    moved. Faces without area and edges with more than two faces are left as they are: the robust
    Laplacian copes with them.

    Parameters
    ----------
    mesh : Mesh, trimesh.Trimesh, (vertices, faces) or path
        The mesh; arrays may be broken in any way.

    Returns
    -------
    Repair
        The mesh, the new number of each vertex, and what was done. `Correspondence.renumber` takes
        the numbers.

    Raises
    ------
    MeshError
        If nothing is left, or if the mesh cannot be read.

    See Also
    --------
    check_mesh : Says what is wrong.

    Examples
    --------
    >>> from skfmap import repair_mesh
    >>> vertices = [[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> repair = repair_mesh((vertices, [[1, 3, 2], [1, 2, 4], [1, 4, 3], [2, 3, 4]]))
    >>> repair.vertex_map.tolist()
    [-1, 0, 1, 2, 3]
    >>> repair.done
    ('removed 1 vertices that no face used',)
    """
    vertices, faces, name = _raw(mesh)
    done: list[str] = []
    target = np.arange(len(vertices))
    for step in (_drop_unsound, _drop_twice, _merge_seams, _keep_largest):
        faces, target, told = step(vertices, faces, target)
        done += told
        if len(faces) == 0:
            raise MeshError(
                f"Nothing is left of {label(name)}: {'; '.join(done) or 'it has no faces'}. Leave "
                "it out."
            )
    used = np.unique(faces)
    renumber = np.full(len(vertices) + 1, -1)
    renumber[used] = np.arange(len(used))
    vertex_map = renumber[target]
    n_dropped = int((vertex_map < 0).sum())
    if n_dropped:
        share = n_dropped / len(vertices)
        doubt = f" ({share:.0%} of all: is the mesh whole?)" if share > _MANY_REMOVED else ""
        done.append(f"removed {n_dropped} vertices that no face used{doubt}")
    points, faces = vertices[used], renumber[faces]
    wound, _, _ = orient_faces(points, faces)
    if not np.array_equal(wound, faces):
        done.append("wound the faces consistently and outwards")
    return Repair(Mesh(points, wound, name), vertex_map, tuple(done))


_Step = tuple[IntArray, IntArray, list[str]]


def _drop_unsound(vertices: FloatArray, faces: IntArray, target: IntArray) -> _Step:
    sound = sound_faces(vertices, faces)
    n_lost = int((~sound).sum())
    told = [f"removed {n_lost} faces that were no triangles or led nowhere"] if n_lost else []
    return faces[sound], target, told


def _drop_twice(vertices: FloatArray, faces: IntArray, target: IntArray) -> _Step:  # noqa: ARG001
    twice = duplicate_faces(faces)
    told = [f"removed {len(twice)} faces that stood there twice"] if len(twice) else []
    return np.delete(faces, twice, axis=0), target, told


def _merge_seams(vertices: FloatArray, faces: IntArray, target: IntArray) -> _Step:
    """Merge vertices with the same coordinates if that joins components."""
    used = np.unique(faces)
    before = len(np.unique(components(faces, len(vertices))[used]))
    _, first, point = np.unique(vertices[used], axis=0, return_index=True, return_inverse=True)
    if before == 1 or len(first) == len(used):
        return faces, target, []
    merged = np.arange(len(vertices))
    merged[used] = used[first][point.ravel()]
    joined = merged[faces]
    joined = np.delete(joined, repeated_corners(joined), axis=0)
    joined = np.delete(joined, duplicate_faces(joined), axis=0)
    after = len(np.unique(components(joined, len(vertices))[np.unique(joined)]))
    if after == before:
        return faces, target, []
    n = len(used) - len(first)
    told = f"merged {n} duplicate vertices, which joined {before} components to {after}"
    return joined, merged[target], [told]


def _keep_largest(vertices: FloatArray, faces: IntArray, target: IntArray) -> _Step:
    piece = components(faces, len(vertices))[faces[:, 0]]
    corners = vertices[faces]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    numbers, inverse = np.unique(piece, return_inverse=True)
    if len(numbers) == 1:
        return faces, target, []
    sizes = np.asarray(np.bincount(inverse, areas), dtype=np.float64)
    largest = first_of_largest(sizes)  # of a pair of equal size, the one that comes first
    kept = inverse == largest
    share = areas[kept].sum() / max(areas.sum(), 1e-300)  # there may be no area at all
    told = f"kept the largest of {len(numbers)} components, {share:.1%} of the area"
    return faces[kept], target, [told]
