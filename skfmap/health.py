"""Checking and mending of meshes."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import (
    LARGEST_AREA,
    LARGEST_COORDINATE,
    SMALLEST_AREA,
    is_finite,
    label,
)
from skfmap.exceptions import MeshError
from skfmap.geometry.faults import (
    area_and_longest_edge,
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
from skfmap.geometry.mending import mend
from skfmap.geometry.orientation import orient_faces, signed_volume
from skfmap.io import MeshLike, as_arrays
from skfmap.shapes import Mesh

__all__ = ["WOUND", "Fault", "MeshReport", "Repair", "check_mesh", "repair_arrays", "repair_mesh"]

# A mesh this many times its extent away from the origin has lost six of sixteen digits of its
# coordinates. This only triggers a note; other values were never tried.
_FAR = 1e6
# Spacing of numbers in single precision, relative to their size.
_SINGLE = float(np.finfo(np.float32).eps)
# If the spacing of numbers is at least this fraction of the mean edge, vertices may have merged.
_STEP_OF_EDGE = 0.25
# If a repair removes more than this fraction of the vertices, it asks whether the mesh is complete;
# the value is a guess.
_MANY_REMOVED = 0.2

WOUND = "wound the faces consistently and outwards"
"""A repair that needs no warning, because vertices keep their indices."""


@dataclass(frozen=True)
class Fault:
    """One fault of a mesh.

    Attributes
    ----------
    kind : str
        Name of the fault.
    level : {"fatal", "mended", "note"}
        ``"fatal"``: the mesh cannot be used. ``"mended"``: `repair_mesh` mends it. ``"note"``: it
        is accepted.
    count : int
        How often the fault occurs.
    first : int or None
        The first vertex or face with the fault.
    meaning : str
        What the fault means for matching, and what to do.
    refused_by : tuple of str
        The Laplacians with which `SpectralBasis` refuses a mesh that has this fault, unless the
        mesh is mended.
    """

    kind: str
    level: str
    count: int
    first: int | None
    meaning: str
    refused_by: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return a description in one line."""
        first = "" if self.first is None else f", the first is {self.first}"
        count = f" ({self.count}{first})" if first or self.count > 1 else ""
        return f"[{self.level}] {self.kind}{count}: {self.meaning}"


@dataclass(frozen=True)
class MeshReport:
    """The faults that `check_mesh` found in a mesh.

    Attributes
    ----------
    name : str or None
        Name of the mesh.
    n_vertices, n_faces : int
        Number of vertices, and of faces.
    faults : tuple of Fault
        The faults, the worst first; empty if nothing is wrong.
    """

    name: str | None
    n_vertices: int
    n_faces: int
    faults: tuple[Fault, ...]

    def usable(self, laplacian: str = "cotangent", on_invalid: str = "mend") -> bool:
        """Return whether `SpectralBasis` accepts the mesh.

        Parameters
        ----------
        laplacian : {"cotangent", "robust"}, default="cotangent"
            Parameter of `SpectralBasis`.
        on_invalid : str, default="mend"
            Parameter of `SpectralBasis`. With ``"raise"`` the mesh is judged as it is, otherwise
            after mending.

        Returns
        -------
        bool
            Whether the mesh is accepted.
        """
        if on_invalid != "raise":
            return not any(fault.level == "fatal" for fault in self.faults)
        return not any(laplacian in fault.refused_by for fault in self.faults)

    def __str__(self) -> str:
        """Return one line for the mesh, and one for each fault."""
        levels = {fault.level for fault in self.faults}
        verdict = (
            "not usable"
            if "fatal" in levels
            else "usable once it is mended"
            if "mended" in levels
            else "usable"
            if levels
            else "sound"
        )
        head = f"{label(self.name)}: {self.n_vertices} vertices, {self.n_faces} faces, {verdict}"
        return "\n".join([head, *(f"  {fault}" for fault in self.faults)])


def check_mesh(mesh: MeshLike) -> MeshReport:
    """Find everything that is wrong with a mesh, and what it means for matching.

    Parameters
    ----------
    mesh : Mesh, trimesh.Trimesh, (vertices, faces) or path
        The mesh; arrays may have any fault.

    Returns
    -------
    MeshReport
        The faults; print the report to read it.

    See Also
    --------
    repair_mesh : Mends what can be mended.

    Examples
    --------
    >>> from skfmap import check_mesh
    >>> vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [9, 9, 9]]
    >>> print(check_mesh((vertices, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])))
    mesh: 5 vertices, 4 faces, usable once it is mended
      [mended] unreferenced vertices (1, the first is 4): no face uses them, so no function is
      defined there; they are left out, and have no match.
    """
    try:
        vertices, faces, name = _raw(mesh)
    except (MeshError, OSError, TypeError) as error:
        name = Path(mesh).stem if isinstance(mesh, (str, Path)) else getattr(mesh, "name", None)
        return MeshReport(name, 0, 0, (_fatal("unreadable", str(error)),))
    found = _faults_of_arrays(vertices, faces)
    sound = sound_faces(vertices, faces)
    if len(vertices) and sound.any():
        found += _faults_of_surface(vertices, faces[sound])
    elif not any(fault.level == "fatal" for fault in found):
        found.append(_fatal("nothing is left", "no face is sound; leave the shape out."))
    order = ("fatal", "mended", "note")
    faults = tuple(sorted(found, key=lambda one: order.index(one.level)))
    return MeshReport(name, len(vertices), len(faces), faults)


def _raw(mesh: MeshLike) -> tuple[FloatArray, IntArray, str | None]:
    """Return vertices, faces and name, without checks."""
    name = Path(mesh).stem if isinstance(mesh, (str, Path)) else getattr(mesh, "name", None)
    given = as_arrays(mesh)
    return *((given.vertices, given.faces) if isinstance(given, Mesh) else given), name


_ALL = ("cotangent", "robust")


def _fatal(kind: str, meaning: str) -> Fault:
    return Fault(kind, "fatal", 1, None, meaning, _ALL)


def _fault(
    kind: str, level: str, where: npt.ArrayLike, meaning: str, refused_by: tuple[str, ...] = ()
) -> list[Fault]:
    """Return a fault of the vertices or faces with these indices, if there are any."""
    indices = np.asarray(where).ravel()
    if len(indices) == 0:
        return []
    return [Fault(kind, level, len(indices), int(indices[0]), meaning, refused_by)]


def _faults_of_arrays(vertices: FloatArray, faces: IntArray) -> list[Fault]:
    """Return the faults of the arrays themselves."""
    if len(vertices) == 0 or len(faces) == 0:
        what = "vertices" if len(vertices) == 0 else "faces"
        return [_fatal("empty", f"there are no {what}; leave the shape out.")]
    outside = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
    inside = faces[~outside]
    return [
        *_fault(
            "vertices with NaN or infinite coordinates",
            "mended",
            np.flatnonzero(~is_finite(vertices)),
            f"or coordinates beyond {LARGEST_COORDINATE:.0e}, where areas overflow. These vertices "
            "and their faces are left out, and have no match.",
            _ALL,
        ),
        *_fault(
            "faces with indices out of range",
            "mended",
            np.flatnonzero(outside),
            f"there are {len(vertices)} vertices (0 to {len(vertices) - 1}); perhaps the file "
            "counts from 1. These faces are left out.",
            _ALL,
        ),
        *_fault(
            "faces with a repeated vertex",
            "mended",
            repeated_corners(faces),
            "they are not triangles, and are left out.",
            _ALL,
        ),
        *_fault(
            "unreferenced vertices",
            "mended",
            unreferenced_vertices(inside, len(vertices)),
            "no face uses them, so no function is defined there; they are left out, and have no "
            "match.",
            _ALL,
        ),
    ]


def _faults_of_surface(vertices: FloatArray, faces: IntArray) -> list[Fault]:
    """Return the faults of the surface that consists of the sound faces."""
    used = np.unique(faces)
    points = vertices[used]
    local = np.searchsorted(used, faces)
    if hopeless := _hopeless(points, local):
        return hopeless
    tally = mend(points, local).tally
    return [
        *_faults_of_distance(points),
        *_faults_of_pieces(used, local),
        *_fault(
            "faces without area",
            "mended",
            degenerate_faces(points, local),
            "their angles are undefined. If two of the vertices coincide they are merged; "
            "otherwise the longest edge is flipped.",
            ("cotangent",),
        ),
        *_fault(
            "edges with more than two faces",
            "mended",
            [used[edge[0]] for edge in nonmanifold_edges(local)],
            "the surface branches there. The two faces that form the smoothest surface stay "
            "together, and the others are cut free.",
            ("cotangent",),
        ),
        *_fault(
            "duplicate faces",
            "mended",
            duplicate_faces(local),
            "their area would count twice; they are cut free or left out.",
        ),
        *_fault(
            "vertices where parts of the surface touch at a point",
            "mended",
            used[nonmanifold_vertices(local, len(used))],
            "functions would be continuous across the point; each part gets a vertex of its own.",
        ),
        *_fault(
            "seams",
            "mended",
            np.full(int(tally.get("seam edges", 0)), -1),
            "boundary edges that coincide, across which functions would jump; they are joined, and "
            "coinciding vertices are merged.",
        ),
        *_fault(
            "open seams",
            "note",
            np.full(int(tally.get("open seam edges", 0)), -1),
            "boundary edges that run along others, but too far apart to be joined. If this is a "
            "seam, functions jump across it, and matches are wrong there: weld it.",
        ),
        *_fault(
            "duplicate vertices",
            "note",
            used[duplicate_vertices(points)],
            "accepted; they are merged if that closes a seam.",
        ),
        *_fault(
            "slivers",
            "note",
            slivers(points, local),
            "accepted; curvature is noisy there. If there are many, remesh, or use "
            "laplacian='robust'.",
        ),
        *_faults_of_sides(points, local, tally),
        *_faults_of_boundary(local),
    ]


def _hopeless(points: FloatArray, faces: IntArray) -> list[Fault]:
    """Return the faults that cannot be mended."""
    with np.errstate(all="ignore"):
        area, longest = area_and_longest_edge(points, faces)
        total, edge = float(area.sum()), float(longest.mean() ** 0.5)
        return _faults_of_precision(points, faces, total, edge) or _faults_of_scale(total)


def _faults_of_scale(area: float) -> list[Fault]:
    if SMALLEST_AREA < area < LARGEST_AREA:
        return []
    meaning = f"its area of {area:.2g} is too extreme to compute with; choose another unit."
    return [_fatal("extreme scale", meaning)]


def _faults_of_precision(
    points: FloatArray, faces: IntArray, area: float, edge: float
) -> list[Fault]:
    """Find coordinates that lie on the grid of single-precision numbers."""
    size = np.abs(points).max(axis=0)
    step = _SINGLE * size / 2
    values = [np.unique(points[:, axis]) for axis in range(3)]
    far = [
        axis
        for axis in np.flatnonzero((step >= _STEP_OF_EDGE * edge) & (edge > 0))
        if (np.diff(values[axis]) >= step[axis] / 2).all()
    ]
    if not far:
        return []
    axis = max(far, key=lambda one: float(step[one]))
    meaning = (
        "the mesh is so far from the origin that single precision has merged its vertices "
        f"(numbers near {size[axis]:.2g} are {step[axis]:.1g} or more apart, edges are {edge:.1g} "
        "long): subtract an offset before saving."
    )
    flat = len(degenerate_faces(points, faces)) > 0
    refused_by = _ALL if area == 0 else ("cotangent",) if flat else ()
    return [Fault("coordinates without precision", "fatal", 1, None, meaning, refused_by)]


def _faults_of_distance(points: FloatArray) -> list[Fault]:
    extent, distance = float(np.ptp(points, axis=0).max()), float(np.abs(points).max())
    if distance <= _FAR * extent:
        return []
    meaning = (
        f"the mesh is {distance / extent:.0e} times its own size away from the origin, so its "
        "coordinates have lost as many digits; move it to the origin before it is saved."
    )
    return [Fault("far from the origin", "note", 1, None, meaning)]


def _faults_of_pieces(used: IntArray, faces: IntArray) -> list[Fault]:
    piece = components(faces, len(used))
    counts = np.bincount(piece)
    if len(counts) == 1:
        return []
    meaning = (
        f"the largest has {counts.max() / len(used):.0%} of the vertices; a functional map cannot "
        "relate components. Those separated by a seam are joined, and the one with the largest "
        "area is kept."
    )
    return [Fault("connected components", "mended", len(counts), None, meaning, _ALL)]


def _faults_of_sides(points: FloatArray, faces: IntArray, tally: dict[str, float]) -> list[Fault]:
    _, consistent, outward = orient_faces(points, faces)
    if not consistent:
        return _faults_of_twists(faces, tally)
    if not is_wound_consistently(faces):
        meaning = "faces are flipped."
        return [Fault("inconsistent winding", "mended", 1, None, meaning)]
    if not outward:
        meaning = "the outside cannot be determined; oriented probes may confuse left and right."
        return [Fault("encloses no volume", "note", 1, None, meaning)]
    if signed_volume(points, faces) < 0:
        meaning = "faces are flipped outwards."
        return [Fault("inside out", "mended", 1, None, meaning)]
    return []


def _faults_of_twists(faces: IntArray, tally: dict[str, float]) -> list[Fault]:
    n_twisted = int(tally.get("twisted faces", 0))
    if n_twisted:
        meaning = (
            f"{n_twisted} faces ({tally['twisted area']:.1g} of the area) are left out; the rest "
            "then has an outside."
        )
        return [Fault("cannot be wound consistently", "mended", n_twisted, None, meaning)]
    if len(nonmanifold_edges(faces)):
        return []  # the faces are wound after these edges have been mended
    meaning = "there is no outside (as for a Moebius band); use DescriptorTransformer('paper')."
    return [Fault("cannot be wound consistently", "note", 1, None, meaning)]


def _faults_of_boundary(faces: IntArray) -> list[Fault]:
    n_loops = len(boundary_pieces(faces))
    if n_loops == 0:
        return []
    meaning = "holes, or an open boundary: accepted; curvature there is taken from the neighbours."
    return [Fault("boundary loops", "note", n_loops, None, meaning)]


@dataclass(frozen=True, eq=False)
class Repair:
    """A mended mesh, and the new index of each vertex.

    Attributes
    ----------
    mesh : Mesh
        The mended mesh.
    vertex_map : ndarray of int, shape (n_vertices,)
        New index of each vertex of the given mesh; -1 if it was removed. The mended mesh may have
        additional vertices at its end, which are copies of some of these.
    done : tuple of str
        Descriptions of the changes; empty if there were none.
    tally : dict of str to float
        Counts of the changes.
    """

    mesh: Mesh
    vertex_map: IntArray
    done: tuple[str, ...]
    tally: dict[str, float] = field(default_factory=dict)

    @property
    def renumbered(self) -> bool:
        """Whether any vertex has a new index, was removed, or was added."""
        return self.mesh.n_vertices != len(self.vertex_map) or not np.array_equal(
            self.vertex_map, np.arange(len(self.vertex_map))
        )


def repair_mesh(mesh: MeshLike) -> Repair:
    """Mend what can be mended, and report what was done.

    The steps are:

    1. Faces that are not triangles, have an index out of range, or use a vertex with NaN are
       removed, and so are duplicate faces.
    2. If a face has no area, its coinciding vertices are merged, or its longest edge is flipped.
    3. If an edge has more than two faces, the two that form the smoothest surface stay together;
       the others are paired in the same way, or cut free.
    4. Seams and cracks are closed: boundary edges that coincide are joined, and their vertices are
       merged. Vertices that merely touch are not merged.
    5. If parts of the surface touch at a point, each part gets a vertex of its own.
    6. If only a few faces (1 % of the area) prevent a consistent winding, they are left out.
    7. The component with the largest area is kept; the others are left out as debris.
    8. Vertices that no face uses are removed, and faces are wound consistently and outwards.

    No vertex is moved; where a crack is closed, the first vertex replaces the others. Mending a
    mended mesh changes nothing.

    Parameters
    ----------
    mesh : Mesh, trimesh.Trimesh, (vertices, faces) or path
        The mesh; arrays may have any fault.

    Returns
    -------
    Repair
        The mended mesh, the new index of each vertex, and what was done. Pass the indices to
        `Correspondence.renumber`.

    Raises
    ------
    MeshError
        If nothing is left, if the mesh cannot be read, or if its coordinates have lost their
        precision.

    See Also
    --------
    check_mesh : Lists the faults of a mesh.

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
    return repair_arrays(*_raw(mesh))


def repair_arrays(vertices: FloatArray, faces: IntArray, name: str | None) -> Repair:
    """Mend vertices and faces as `repair_mesh` does; ``name`` is used in messages."""
    sound = sound_faces(vertices, faces)
    done = []
    if not sound.all():
        n_lost = int((~sound).sum())
        done.append(f"removed {n_lost} faces that were not triangles or had no valid vertices")
        faces = faces[sound]
    if len(faces) and (hopeless := _hopeless_of(vertices, faces)):
        raise MeshError(f"{label(name)} cannot be mended: {hopeless}")
    mended = mend(vertices, faces)
    done += _told(mended.tally)
    if len(mended.faces) == 0:
        raise MeshError(
            f"Nothing is left of {label(name)}: {'; '.join(done) or 'it has no faces'}. Leave it "
            "out."
        )
    n_dropped = int((mended.vertex_map < 0).sum())
    if n_dropped:
        share = n_dropped / len(vertices)
        doubt = f" ({share:.0%} of all: is the mesh complete?)" if share > _MANY_REMOVED else ""
        done.append(f"removed {n_dropped} vertices that no face used{doubt}")
    wound, _, _ = orient_faces(mended.vertices, mended.faces, mended.edges)
    if "turned faces" in mended.tally or wound is not mended.faces:
        done.append(WOUND)
    mesh = Mesh(mended.vertices, wound, name)
    return Repair(mesh, mended.vertex_map, tuple(done), mended.tally)


def _hopeless_of(vertices: FloatArray, faces: IntArray) -> str:
    unused = unreferenced_vertices(faces, len(vertices))
    if len(unused):
        used = np.delete(np.arange(len(vertices)), unused)
        vertices, faces = vertices[used], np.searchsorted(used, faces)
    return "; ".join(fault.meaning for fault in _hopeless(vertices, faces))


def _told(tally: dict[str, float]) -> list[str]:
    """Return descriptions of what was done."""
    lost = tally.get("debris", 0)
    words = {
        "faces twice": "removed {:.0f} duplicate faces",
        "flat faces": "mended {:.0f} faces without area",
        "crowded edges": "separated the surface at {:.0f} edges with more than two faces",
        "seam edges": "joined {:.0f} edges along seams",
        "merged vertices": "merged {:.0f} duplicate vertices",
        "touching vertices": "separated the surface at {:.0f} vertices where it touched itself",
        "twisted faces": "left out {:.0f} faces that prevented a consistent winding",
        "open seam edges": (
            "found {:.0f} boundary edges that run along others, but too far apart to be joined "
            "(if this is a seam, functions jump there: weld it)"
        ),
        "pieces": f"kept the largest of {{:.0f}} components, {1 - lost:.1%} of the area",
    }
    return [form.format(tally[what]) for what, form in words.items() if what in tally]
