"""What is wrong with a mesh, what it means for a functional map, and what can be mended."""

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
# coordinates. Only a note hangs on it; other numbers were never tried.
_FAR = 1e6
# Spacing of numbers in single precision, as a share of their size.
_SINGLE = float(np.finfo(np.float32).eps)
# Spacing of numbers as a share of the mean edge from which vertices have run into each other.
_STEP_OF_EDGE = 0.25
# Share of the vertices that a repair may remove before it asks whether the mesh is whole; a guess.
_MANY_REMOVED = 0.2

WOUND = "wound the faces consistently and outwards"
"""What is done without a word: vertices keep their numbers."""


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with a mesh.

    Attributes
    ----------
    kind : str
        What it is.
    level : {"fatal", "mended", "note"}
        ``"fatal"``: the mesh cannot be used. ``"mended"``: `repair_mesh` puts that right.
        ``"note"``: it is accepted.
    count : int
        How often.
    first : int or None
        The first vertex or face concerned.
    meaning : str
        What it means here, and what to do.
    refused_by : tuple of str
        The Laplacians with which `SpectralBasis` refuses a mesh that has it and is not mended.
    """

    kind: str
    level: str
    count: int
    first: int | None
    meaning: str
    refused_by: tuple[str, ...] = ()

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

    def usable(self, laplacian: str = "cotangent", on_invalid: str = "mend") -> bool:
        """Return whether `SpectralBasis` takes the mesh with this Laplacian.

        Parameters
        ----------
        laplacian : {"cotangent", "robust"}, default="cotangent"
            Its Laplacian.
        on_invalid : str, default="mend"
            With ``"raise"``, as it is; with anything else, once it is mended.
        """
        if on_invalid != "raise":
            return not any(fault.level == "fatal" for fault in self.faults)
        return not any(laplacian in fault.refused_by for fault in self.faults)

    def __str__(self) -> str:
        """Return a line for the mesh, and one for each fault."""
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
    mesh: 5 vertices, 4 faces, usable once it is mended
      [mended] unreferenced vertices (1, the first is 4): no face uses them, so that no function is
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
        found.append(_fatal("nothing is left", "none of the faces is sound; leave the shape out."))
    order = ("fatal", "mended", "note")
    faults = tuple(sorted(found, key=lambda one: order.index(one.level)))
    return MeshReport(name, len(vertices), len(faces), faults)


def _raw(mesh: MeshLike) -> tuple[FloatArray, IntArray, str | None]:
    """Return vertices, faces and name, not checked."""
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
    """Return what is wrong with the numbers themselves."""
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
            f"or beyond {LARGEST_COORDINATE:.0e}, where areas overflow. They and their faces are "
            "left out, and have no match.",
            _ALL,
        ),
        *_fault(
            "faces with indices out of range",
            "mended",
            np.flatnonzero(outside),
            f"there are {len(vertices)} vertices (0 to {len(vertices) - 1}); a file that counts "
            "from 1? These faces are left out.",
            _ALL,
        ),
        *_fault(
            "faces that name a vertex twice",
            "mended",
            repeated_corners(faces),
            "they are not triangles, and are left out.",
            _ALL,
        ),
        *_fault(
            "unreferenced vertices",
            "mended",
            unreferenced_vertices(inside, len(vertices)),
            "no face uses them, so that no function is defined there; they are left out, and have "
            "no match.",
            _ALL,
        ),
    ]


def _faults_of_surface(vertices: FloatArray, faces: IntArray) -> list[Fault]:
    """Return what is wrong with the surface that sound faces make."""
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
            "their angles are unknown. Where two vertices lie at one place they are merged; "
            "otherwise the longest edge is flipped.",
            ("cotangent",),
        ),
        *_fault(
            "edges with more than two faces",
            "mended",
            [used[edge[0]] for edge in nonmanifold_edges(local)],
            "the surface branches there. The two faces that continue each other best are kept "
            "together, and the others cut free.",
            ("cotangent",),
        ),
        *_fault(
            "faces that stand there twice",
            "mended",
            duplicate_faces(local),
            "a sheet that covers another counts its area twice; it is cut free or left out.",
        ),
        *_fault(
            "vertices where parts of the surface touch in a point",
            "mended",
            used[nonmanifold_vertices(local, len(used))],
            "functions would be continuous there; the parts are given a vertex each.",
        ),
        *_fault(
            "seams",
            "mended",
            np.full(int(tally.get("seam edges", 0)), -1),
            "edges of a rim that lie on each other, across which functions would jump; they are "
            "joined, and vertices at the same place merged.",
        ),
        *_fault(
            "open seams",
            "note",
            np.full(int(tally.get("open seam edges", 0)), -1),
            "edges of a rim that run along others, too far apart to be joined. If that is a seam, "
            "functions jump across it, and matches are wrong there: weld it.",
        ),
        *_fault(
            "vertices at the same place as another",
            "note",
            used[duplicate_vertices(points)],
            "accepted; they are merged where that closes a seam.",
        ),
        *_fault(
            "slivers",
            "note",
            slivers(points, local),
            "accepted; curvature is noisy there. Many of them: remesh, or laplacian='robust'.",
        ),
        *_faults_of_sides(points, local, tally),
        *_faults_of_boundary(local),
    ]


def _hopeless(points: FloatArray, faces: IntArray) -> list[Fault]:
    """Return what no mending helps against."""
    with np.errstate(all="ignore"):
        area, longest = area_and_longest_edge(points, faces)
        total, edge = float(area.sum()), float(longest.mean() ** 0.5)
        return _faults_of_precision(points, faces, total, edge) or _faults_of_scale(total)


def _faults_of_scale(area: float) -> list[Fault]:
    if SMALLEST_AREA < area < LARGEST_AREA:
        return []
    meaning = f"the area is {area:.2g}, too extreme to compute with; choose another unit of length."
    return [_fatal("extreme scale", meaning)]


def _faults_of_precision(
    points: FloatArray, faces: IntArray, area: float, edge: float
) -> list[Fault]:
    """Find coordinates that lie on a grid, as numbers in single precision are as far apart."""
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
        "the mesh lies so far from the origin that single precision has merged its vertices "
        f"(numbers near {size[axis]:.2g} are {step[axis]:.1g} or more apart, edges are {edge:.1g} "
        "long): subtract an offset before saving."
    )
    flat = len(degenerate_faces(points, faces)) > 0
    refused_by = _ALL if area == 0 else ("cotangent",) if flat else ()
    return [Fault("coordinates without digits", "fatal", 1, None, meaning, refused_by)]


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
        "relate pieces. Those that a seam parts are joined, and the one of most area is kept."
    )
    return [Fault("connected components", "mended", len(counts), None, meaning, _ALL)]


def _faults_of_sides(points: FloatArray, faces: IntArray, tally: dict[str, float]) -> list[Fault]:
    _, consistent, outward = orient_faces(points, faces)
    if not consistent:
        return _faults_of_twists(faces, tally)
    if not is_wound_consistently(faces):
        meaning = "faces are turned."
        return [Fault("inconsistent winding", "mended", 1, None, meaning)]
    if not outward:
        meaning = "the outside cannot be determined; oriented probes may confuse left and right."
        return [Fault("encloses no volume", "note", 1, None, meaning)]
    if signed_volume(points, faces) < 0:
        meaning = "faces are turned outwards."
        return [Fault("inside out", "mended", 1, None, meaning)]
    return []


def _faults_of_twists(faces: IntArray, tally: dict[str, float]) -> list[Fault]:
    n_twisted = int(tally.get("twisted faces", 0))
    if n_twisted:
        meaning = (
            f"without {n_twisted} faces ({tally['twisted area']:.1g} of the area) the rest has an "
            "outside; they are left out."
        )
        return [Fault("cannot be wound consistently", "mended", n_twisted, None, meaning)]
    if len(nonmanifold_edges(faces)):
        return []  # their faces are wound once these edges are mended
    meaning = "there is no outside (as on a Moebius band); use DescriptorTransformer('paper')."
    return [Fault("cannot be wound consistently", "note", 1, None, meaning)]


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
        New number of each vertex of the mesh that was given; -1 where it was removed. The mended
        mesh may have further vertices, copies of some of these, at its end.
    done : tuple of str
        What was done; empty if there was nothing to do.
    tally : dict of str to float
        The same in numbers.
    """

    mesh: Mesh
    vertex_map: IntArray
    done: tuple[str, ...]
    tally: dict[str, float] = field(default_factory=dict)

    @property
    def renumbered(self) -> bool:
        """Whether any vertex has another number than before, or none, or is new."""
        return self.mesh.n_vertices != len(self.vertex_map) or not np.array_equal(
            self.vertex_map, np.arange(len(self.vertex_map))
        )


def repair_mesh(mesh: MeshLike) -> Repair:
    """Mend what can be mended, and say what was done.

    In this order:

    1. Faces that are no triangles, or lead to no vertex or to one with NaN, are removed, and so are
       faces that stand there twice.
    2. Of a face without area, vertices at one place are merged, or the longest edge is flipped.
    3. At an edge with more than two faces the two that continue each other best stay together; the
       others are paired likewise, or cut free.
    4. Seams and cracks are closed: edges of a rim that lie on each other are joined, and their
       vertices merged. Vertices that merely touch are not.
    5. Where parts of the surface touch in a point, each has a vertex of its own.
    6. If a few faces (1 % of the area) are all that keeps the others from being wound consistently,
       they are left out.
    7. The piece of most area is kept, and the others, debris, are left out.
    8. Vertices that no face uses are removed; faces are wound consistently and outwards.

    No vertex is moved (where a crack is closed, its first vertex stands for all). A mended mesh is
    mended no further.

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
        If nothing is left, if the mesh cannot be read, or if its coordinates have lost their
        digits.

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
    return repair_arrays(*_raw(mesh))


def repair_arrays(vertices: FloatArray, faces: IntArray, name: str | None) -> Repair:
    """Mend vertices and faces, which messages call ``name``; see `repair_mesh`."""
    sound = sound_faces(vertices, faces)
    done = []
    if not sound.all():
        n_lost = int((~sound).sum())
        done.append(f"removed {n_lost} faces that were not triangles or led nowhere")
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
        doubt = f" ({share:.0%} of all: is the mesh whole?)" if share > _MANY_REMOVED else ""
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
    """Return in words what was done."""
    lost = tally.get("debris", 0)
    words = {
        "faces twice": "removed {:.0f} faces that stood there twice",
        "flat faces": "mended {:.0f} faces without area",
        "crowded edges": "parted the surface at {:.0f} edges with more than two faces",
        "seam edges": "joined {:.0f} edges along seams",
        "merged vertices": "merged {:.0f} duplicate vertices",
        "touching vertices": "parted the surface at {:.0f} vertices where it touched itself",
        "twisted faces": "left out {:.0f} faces around which no winding is consistent",
        "open seam edges": (
            "found {:.0f} edges of a rim that run along others, too far apart to be joined (weld "
            "them if that is a seam: functions jump there)"
        ),
        "pieces": f"kept the largest of {{:.0f}} pieces, {1 - lost:.1%} of the area",
    }
    return [form.format(tally[what]) for what, form in words.items() if what in tally]
