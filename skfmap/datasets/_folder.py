"""Loading of a collection of shapes from a folder."""

import io
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skfmap._tools.types import (
    Array,
    BoolArray,
    FloatArray,
    IntArray,
    OnInvalid,
)
from skfmap._tools.validation import check_choice, check_index_range
from skfmap._tools.warn import warn
from skfmap.datasets._collection import Collection
from skfmap.datasets._landmark_files import (
    landmark_files,
    landmarks_on,
    only_one,
    unread_landmarks,
)
from skfmap.datasets._vertex_files import read_column
from skfmap.exceptions import (
    CorrespondenceError,
    CoverageWarning,
    MeshError,
    SkippedShapeWarning,
)
from skfmap.geometry.faults import share_of_common_edges
from skfmap.io import (
    MESH_SUFFIXES,
    READ_SUFFIXES,
    as_far_as_sound,
    n_vertices_of,
    read_arrays,
    unread_formats,
)
from skfmap.io.tables import is_table_of_points
from skfmap.io.texts import read_text
from skfmap.shapes import Correspondence, Landmarks, Mesh, SkippedShape
from skfmap.shapes.crowded import crowded_points
from skfmap.shapes.usable import warn_of_repairs, warn_of_skipped

__all__ = ["load_collection"]


def load_collection(
    folder: str | Path,
    pattern: str = "*",
    reference: str | None = None,
    *,
    on_invalid: OnInvalid = "mend",
    by_number: bool = False,
) -> Collection:
    """Load the meshes of a folder with their correspondences, the reference first.

    For each mesh ``NAME.off`` (or any format that `skfmap.io.read_mesh` reads), correspondences are
    read from the first of these files that exists:

    - ``NAME.vts``, and ``NAME.sym.vts`` if there is one: the vertex of each template point, one per
      line, counted from 1, and the vertex of its symmetric counterpart (the format of the TOSCA
      remeshes);
    - ``NAME.vertices.txt`` or ``.npy``: the template point of each vertex, counted from 0; -1 if it
      is unknown;
    - ``NAME.template.txt`` or ``.npy``: the vertex of each template point, counted from 0; -1 if it
      is unknown;
    - ``NAME.txt`` or ``.npy``: two columns, vertex and template point, counted from 0; and
      ``NAME.sym.txt`` or ``.npy`` if there is one: the same for the symmetric counterparts;
    - landmarks in the coordinates of the mesh, in any format of `skfmap.io.read_landmarks`:
      ``NAME.fcsv``, ``NAME.mrk.json``, ``NAME_picked_points.pp``, ``NAME.tps``, ``NAME.pts``,
      ``NAME.csv``, ``NAME.tsv``, or ``NAME.txt`` with at least three columns. ``NAME`` may be
      followed by ``_Landmarks``, ``_LM``, ``_points``, ``_markups`` or ``_fiducials``, in any
      letter case. Each landmark is projected onto the nearest point of the surface
      (`Correspondence.from_points`). Landmarks with the same name correspond; a landmark may be
      missing on some of the meshes.

    In the text files of the first three kinds, the line number identifies the point. An empty line,
    ``NA``, ``nan`` or ``# missing`` marks an unknown point, as does -1 in the second and third
    kinds.

    If no mesh has such a file, and all meshes have the same number of vertices and share most of
    their edges, vertices correspond by number.

    Parameters
    ----------
    folder : str or Path
        Folder with the meshes.
    pattern : str, default="*"
        Pattern of the names of the meshes to load, without suffix, such as ``"cat*"``.
    reference : str, optional
        Name of the mesh to put first. The default is the first name in natural order, in which cat2
        comes before cat10.
    on_invalid : {"mend", "raise", "skip"}, default="mend"
        What to do with a mesh that is not sound. ``"mend"`` accepts NaN coordinates and faces with
        invalid indices, with a warning: these faces are dropped, vertices keep their indices, and
        `SpectralBasis` does all other repairs. ``"raise"`` raises an error. ``"skip"`` mends as
        well, but if a mesh still cannot be used, or its correspondences cannot be read or do not
        agree with those of the other meshes (no file, ``.vts`` files of different lengths, or
        different faces if vertices correspond by number), it is replaced by a
        `skfmap.shapes.SkippedShape`, with a warning. ``SpectralBasis(on_invalid="skip")`` passes
        skipped shapes on, and the learner leaves them out. An unusable reference always raises an
        error.
    by_number : bool, default=False
        Whether vertices correspond by number, regardless of files beside the meshes and of their
        faces. All meshes must then have the same number of vertices.

    Returns
    -------
    Collection
        Collection with ``meshes`` (list of Mesh); ``paths`` (list of str, the files of the meshes,
        which can be used in place of ``meshes`` to save memory); ``correspondences`` (list of
        Correspondence); ``landmarks`` (list of Landmarks, None for meshes without a landmark file);
        ``names`` (list of str); and ``DESCR``, which states the source of the correspondences.

    Raises
    ------
    FileNotFoundError, NotADirectoryError
        If the folder does not exist, is a file, or contains no matching mesh.
    CorrespondenceError
        If a mesh has no correspondences, or they do not belong to it; if ``.vts`` files differ in
        length; if a mesh has several landmark files; if some meshes have named landmarks and others
        numbered points; or if correspondences refer to vertices of an STL mesh, which have no
        fixed order.
    MeshError
        If a mesh cannot be read.

    Warns
    -----
    RepairWarning
        If meshes were mended, or if landmarks lie on their mesh only with x and y negated (the
        coordinate systems LPS and RAS of 3D Slicer), and were negated.
    SkippedShapeWarning
        If meshes were skipped, or if meshes or landmark files have a format that is not read.
    CoverageWarning
        If a template point or a vertex occurs in a large share of the pairs of a mesh, which
        suggests that it stands for "none".

    Examples
    --------
    >>> import tempfile
    >>> from skfmap.datasets import load_collection, make_sphere
    >>> from skfmap.io import write_mesh
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name in ("ball10", "ball2"):
    ...         write_mesh(make_sphere(n_subdivisions=1), f"{folder}/{name}.off")
    ...     load_collection(folder).names
    ['ball2', 'ball10']
    """
    if not isinstance(folder, (str, Path)):
        raise TypeError(f"folder must be a path; got {folder!r}.")
    folder = Path(folder)
    if folder.is_file():
        raise NotADirectoryError(
            f"{folder} is a file. Give the folder that contains it, and select meshes with "
            "`pattern`."
        )
    if not folder.is_dir():
        raise FileNotFoundError(f"There is no folder {folder}.")
    check_choice(on_invalid, "on_invalid", ("mend", "raise", "skip"))
    paths = _mesh_paths(folder, pattern, reference)
    names = [path.stem for path in paths]
    modes = [_REFERENCE[on_invalid], *[on_invalid] * (len(paths) - 1)]
    marked = [[] for _ in paths] if by_number else landmark_files(paths)
    read = [
        _read(path, files, one, by_number)
        for path, files, one in zip(paths, marked, modes, strict=True)
    ]
    bare = [path for path, one in zip(paths, read, strict=True) if one.truth is None]
    if not by_number and (unread := unread_landmarks(bare)):
        warn(unread, SkippedShapeWarning)
    meshes = [one.mesh for one in read]
    beside = any(one.truth is not None for one in read)
    faults = (
        _missing_or_odd(paths, read) if beside else _not_by_number(read, folder, asked=by_number)
    )
    for i, fault in faults.items():
        if on_invalid != "skip" or i == 0:
            raise CorrespondenceError(fault)
        meshes[i] = SkippedShape(names[i], fault, meshes[i].n_vertices)
    warn_of_repairs([(mesh, one.done) for mesh, one in zip(meshes, read, strict=True)])
    warn_of_skipped(meshes)
    sound = [i for i, mesh in enumerate(meshes) if not isinstance(mesh, SkippedShape)]
    if beside:
        _warn_of_crowds(read, sound)
        correspondences = _numbered_alike(read, sound)
        counts = [len(correspondences[i].pairs) for i in sound]
        n_symmetric = sum(truth.has_symmetric for truth in correspondences)
        how = (
            f"{_range(counts)} pairs per mesh read beside them ({_sources(read, sound)}), "
            f"symmetric answers for {n_symmetric} of {len(sound)}"
        )
    else:
        correspondences = [
            Correspondence.from_vertices(np.arange(mesh.n_vertices)) if i in sound else _NONE
            for i, mesh in enumerate(meshes)
        ]
        how = "vertices correspond by number"
    out = f" ({len(meshes) - len(sound)} skipped)" if len(sound) < len(meshes) else ""
    return Collection(
        meshes=meshes,
        paths=[str(path) for path in paths],
        correspondences=correspondences,
        landmarks=[one.landmarks if i in sound else None for i, one in enumerate(read)],
        names=names,
        DESCR=f"{len(meshes)} meshes of {folder}{out}, reference {names[0]!r}; {how}.",
    )


_LARGEST = 2**53  # text is read as floats, in which larger integers are not exact

_MOST = 8  # largest number of names listed in a message

_NO_FACES = np.empty((0, 3), dtype=np.int64)

# The correspondence of a skipped shape.
_NONE = Correspondence(np.empty((0, 2), dtype=np.int64))


# The reference cannot be skipped.
_REFERENCE = {"mend": "mend", "raise": "raise", "skip": "mend"}


class _Read(NamedTuple):
    """Contents of the files of a shape.

    ``faces`` are as stored; ``done`` describes repairs; ``source`` is the file that ``truth`` comes
    from, with NAME in place of the name of the mesh; ``note`` describes conversions that this file
    asks for.
    """

    mesh: Mesh | SkippedShape
    truth: Correspondence | None = None
    faces: IntArray = _NO_FACES
    done: str = ""
    landmarks: Landmarks | None = None
    source: str = ""
    note: str = ""


def _read(path: Path, marked: list[Path], on_invalid: str, by_number: bool) -> _Read:
    """Return a mesh and its correspondence; a skipped shape if it cannot be read.

    ``marked`` are its landmark files. All files are ignored if ``by_number`` is True.
    """
    try:
        arrays = read_arrays(path)
        mesh, done = (_as_it_is if on_invalid == "raise" else as_far_as_sound)(*arrays, path.stem)
        truth, file = (None, None) if by_number else _read_correspondence(path, mesh)
        read = _Read(mesh, truth, arrays[1], done, source=_source(file, path.stem))
        if truth is not None or not marked:
            return read
        return _with_landmarks(read, mesh, only_one(marked, path))
    except (MeshError, CorrespondenceError, OSError) as error:
        if on_invalid != "skip":
            raise
        return _Read(SkippedShape(path.stem, str(error), n_vertices_of(path)))


def _with_landmarks(read: _Read, mesh: Mesh, file: Path) -> _Read:
    on = landmarks_on(file, mesh)
    return read._replace(
        truth=on.truth,
        done=", ".join(one for one in (read.done, on.turned) if one),
        landmarks=on.landmarks,
        source=_source(file, str(mesh.name)),
        note=on.note,
    )


def _numbered_alike(read: list[_Read], sound: list[int]) -> list[Correspondence]:
    """Return the correspondences, with names of template points numbered alike in all of them."""
    marks = [read[i].landmarks for i in sound]
    names = list(dict.fromkeys(name for one in marks if one is not None for name in one.names))
    out = [(one.truth if i in sound else None) or _NONE for i, one in enumerate(read)]
    return [truth if truth.names is None else truth.number_by(names) for truth in out]


def _source(file: Path | None, stem: str) -> str:
    return "" if file is None else f"NAME{file.name[len(stem) :]}"


def _sources(read: list[_Read], sound: list[int]) -> str:
    """Describe the kinds of files that correspondences come from, and conversions made."""
    kinds = [read[i].source for i in sound]
    counts = [f"{kind} for {kinds.count(kind)}" for kind in dict.fromkeys(kinds)]
    notes = [read[i].note for i in sound if read[i].note]
    return "; ".join(
        [", ".join(counts), *(f"{n} for {notes.count(n)}" for n in dict.fromkeys(notes))]
    )


def _as_it_is(vertices: FloatArray, faces: IntArray, name: str) -> tuple[Mesh, str]:
    return Mesh(vertices, faces, name), ""


def _range(counts: list[int]) -> str:
    return f"{min(counts)}" if min(counts) == max(counts) else f"{min(counts)} to {max(counts)}"


def _mesh_paths(folder: Path, pattern: str, reference: str | None) -> list[Path]:
    if not isinstance(pattern, str) or not pattern or "/" in pattern or "**" in pattern:
        raise ValueError(
            "pattern must match names of meshes in the folder, with '*' for any characters; got "
            f"{pattern!r}."
        )
    for suffix in READ_SUFFIXES:
        pattern = pattern.removesuffix(suffix)
    # Operating systems leave hidden files beside others, so names that begin with a dot are left
    # out. Broken links are kept; they raise an error when they are read.
    seen = [p for p in folder.glob(pattern + ".*") if p.is_symlink() or p.is_file()]
    paths = sorted(
        (p for p in seen if p.suffix.lower() in READ_SUFFIXES and p.name[0] != "."), key=_natural
    )
    paths, twins = _without_twins(paths)
    other = unread_formats(folder, seen, paths)
    if not paths:
        raise FileNotFoundError(
            f"{folder} contains no mesh {pattern!r} with suffix {', '.join(READ_SUFFIXES)}."
            + (f" {other}" if other else "")
        )
    if other:
        warn(other, SkippedShapeWarning)
    if twins:
        warn(
            f"{folder}: {', '.join(path.name for path in twins[:_MOST])}"
            f"{' and others' if len(twins) > _MOST else ''} are left out, because the folder also "
            f"has meshes of the same names in one of the formats {', '.join(MESH_SUFFIXES)}.",
            SkippedShapeWarning,
        )
    stems = [path.stem for path in paths]
    twice = sorted({stem for stem in stems if stems.count(stem) > 1})
    if twice:
        raise ValueError(
            f"{folder} contains {twice} in more than one format. Keep one file of each, so that "
            "names are unique."
        )
    if reference is None:
        return paths
    if reference not in stems:
        raise ValueError(f"reference={reference!r} is not one of the meshes found: {stems}.")
    first = stems.index(reference)
    return [paths[first], *paths[:first], *paths[first + 1 :]]


def _without_twins(paths: list[Path]) -> tuple[list[Path], list[Path]]:
    """Split off copies of meshes in formats that are only read, such as those for viewing."""
    stems = {path.stem for path in paths if path.suffix.lower() in MESH_SUFFIXES}
    twins = [
        path for path in paths if path.stem in stems and path.suffix.lower() not in MESH_SUFFIXES
    ]
    return [path for path in paths if path not in twins], twins


def _natural(path: Path) -> list[tuple[int, int | str]]:
    parts = re.split(r"(\d+)", path.name)
    return [(0, int(part)) if part.isdecimal() else (1, part) for part in parts]


def _read_correspondence(path: Path, mesh: Mesh) -> tuple[Correspondence | None, Path | None]:
    truth, file = _find_correspondence(path, mesh)
    if truth is not None and path.suffix.lower() == ".stl":
        raise CorrespondenceError(
            f"{path} has correspondences beside it, but the vertices of an STL file have no fixed "
            "order. Use the OFF, OBJ or PLY file that the correspondences were made for."
        )
    return truth, file


def _find_correspondence(path: Path, mesh: Mesh) -> tuple[Correspondence | None, Path | None]:
    """Return the correspondence from a file of vertex indices, and that file; None without one."""
    if (vts := path.with_suffix(".vts")).is_file():
        sym = path.with_suffix(".sym.vts")
        symmetric = _read_vts(sym, mesh) if sym.is_file() else None
        return Correspondence.from_template(_read_vts(vts, mesh), symmetric), vts
    if path.with_suffix(".sym.vts").is_file():
        raise CorrespondenceError(
            f"{path.with_suffix('.sym.vts')} has no {path.with_suffix('.vts').name} beside it. Add "
            "that file, or remove this one."
        )
    for kind in ("vertices", "template", "pairs"):
        stem = path.stem if kind == "pairs" else f"{path.stem}.{kind}"
        for suffix in (".npy", ".txt"):
            if (file := path.with_name(stem + suffix)).is_file():
                if kind == "pairs" and suffix == ".txt" and is_table_of_points(file):
                    continue
                try:
                    if kind == "pairs":
                        return _of_pairs(file, mesh), file
                    return _of_kind(kind, _read_column(file)[0], file, mesh), file
                except CorrespondenceError as error:
                    raise CorrespondenceError(
                        str(error) if str(file) in str(error) else f"{file}: {error}"
                    ) from None
    return None, None


def _missing_or_odd(paths: list[Path], read: list[_Read]) -> dict[int, str]:
    """Return, by index, faults of the correspondence files of meshes.

    A mesh has no file, it has named landmarks but the first mesh numbered points or the reverse,
    or its .vts file has another length.
    """
    sound = [i for i, one in enumerate(read) if isinstance(one.mesh, Mesh)]
    missing = [paths[i].stem for i in sound if read[i].truth is None]
    faults = {
        i: f"{paths[i].parent} has correspondence files for some meshes, but none for {missing}. "
        "Add them, or select meshes with `pattern`."
        for i in sound
        if read[i].truth is None
    }
    by = ("numbered points", "named landmarks")
    for i in sound:
        by_name = read[i].landmarks is not None
        if i not in faults and (fault := _no_common_name(read[i], read[0])):
            faults[i] = f"{paths[i].parent}: {fault}"
        if i not in faults and by_name != (read[0].landmarks is not None):
            faults[i] = (
                f"{paths[i].stem!r} has {by[by_name]} ({read[i].source}), but {paths[0].stem!r} "
                f"has {by[not by_name]} ({read[0].source}), so it is not known which correspond. "
                "Give all meshes files of the same kind."
            )
    lengths = {i: _vts_lengths(paths[i]) for i in sound}
    every = [length for own in lengths.values() for length in own.values()]
    for i, own in lengths.items():
        usual = max(every, key=every.count) if every else 0
        odd = {name: length for name, length in own.items() if length != usual}
        if odd:
            faults[i] = (
                f".vts files must have one line per template point, {usual} here; these differ: "
                f"{odd}. Write NA, or leave the line empty, for points that a shape lacks."
            )
    return faults


def _no_common_name(one: _Read, first: _Read) -> str:
    """Return a message if two meshes have landmarks but none with the same name; else nothing."""
    if one.landmarks is None or first.landmarks is None:
        return ""
    if set(one.landmarks.names) & set(first.landmarks.names):
        return ""
    has, wanted = (", ".join(marks.names[:_MOST]) for marks in (one.landmarks, first.landmarks))
    return (
        f"{one.mesh.name!r} and {first.mesh.name!r} have no landmark name in common: {has} against "
        f"{wanted}. Give corresponding landmarks the same name."
    )


def _vts_lengths(path: Path) -> dict[str, int]:
    """Return the number of lines of the .vts and .sym.vts files of a mesh."""
    files = (path.with_suffix(suffix) for suffix in (".vts", ".sym.vts"))
    return {file.name: len(read_column(file)) for file in files if file.is_file()}


def _read_vts(path: Path, mesh: Mesh) -> IntArray:
    """Return the vertex of each template point; -1 where it is unknown."""
    indices, known = _read_column(path)
    if indices[known].min() == 0:
        raise CorrespondenceError(
            f"{path} contains 0, but vertices in .vts files are counted from 1, here up to "
            f"{mesh.n_vertices}. If it counts from 0, rename it to "
            f"{path.name.split('.')[0]}.template.txt, or add 1 to every line."
        )
    low, high = int(indices[known].min()), int(indices[known].max())
    if low < 1 or high > mesh.n_vertices:
        raise CorrespondenceError(
            f"{path} must contain one vertex per line, counted from 1 up to {mesh.n_vertices}; got "
            f"{low} to {high}. Write NA, or leave the line empty, for points that a shape lacks."
        )
    return np.where(known, indices - 1, -1)


def _read_column(path: Path) -> tuple[IntArray, BoolArray]:
    """Return one integer per line, -1 if it is unknown, and a mask of those that are known."""
    values: Array = read_column(path) if path.suffix != ".npy" else _read_numbers(path)
    known = np.isfinite(values) if values.dtype.kind == "f" else np.ones(values.shape, dtype=bool)
    if not known.any():
        raise CorrespondenceError(f"{path} holds no numbers: all its points are missing.")
    return _as_integers(np.where(known, values, -1), path), known


def _read_integers(path: Path) -> IntArray:
    return _as_integers(_read_numbers(path), path)


def _read_numbers(path: Path) -> Array:
    content = path.read_bytes()
    if not content.strip():
        raise CorrespondenceError(f"{path} is empty.")
    try:
        file = io.BytesIO(content)
        values = (
            np.load(file, allow_pickle=False)
            if path.suffix == ".npy"
            else np.loadtxt(read_text(path), ndmin=2)
        )
    except Exception as error:
        said = str(error).rstrip(".")
        raise CorrespondenceError(
            f"{path} cannot be read as numbers separated by blanks, without a header line: "
            f"{type(error).__name__}: {said}."
        ) from error
    if not isinstance(values, np.ndarray):
        raise CorrespondenceError(
            f"{path} is an archive of arrays (.npz). Save a single array with numpy.save."
        )
    if values.size == 0:
        raise CorrespondenceError(f"{path} is empty.")
    return values


def _as_integers(values: Array, path: Path) -> IntArray:
    if (
        values.dtype.kind not in "iuf"
        or not (np.isfinite(values) & (values == np.round(values))).all()
    ):
        raise CorrespondenceError(f"{path} must contain only whole numbers.")
    if np.abs(values.astype(np.float64)).max() > _LARGEST:
        raise CorrespondenceError(
            f"{path} contains numbers too large for a vertex: {values.min():g} to {values.max():g}."
        )
    return values.astype(np.int64)


def _of_pairs(path: Path, mesh: Mesh) -> Correspondence:
    """Return the pairs of a file, with the symmetric pairs from the file beside it, if any."""
    beside = path.with_name(f"{path.stem}.sym{path.suffix}")
    symmetric = _read_pairs(beside, mesh) if beside.is_file() else None
    return Correspondence(_read_pairs(path, mesh), symmetric)


def _read_pairs(path: Path, mesh: Mesh) -> IntArray:
    values = _read_integers(path)
    if values.ndim != 2 or values.shape[1] != 2:
        raise CorrespondenceError(
            f"{path} must have two columns, vertex and template point; got shape "
            f"{values.shape}. Name a file of one column {path.stem}.vertices{path.suffix} "
            f"(template point of each vertex) or {path.stem}.template{path.suffix} (vertex of "
            "each template point)."
        )
    check_index_range(values[:, 0], mesh.n_vertices, f"The pairs of {path}")
    return values


def _of_kind(kind: str, values: IntArray, path: Path, mesh: Mesh) -> Correspondence:
    if kind == "template":
        check_index_range(values[values >= 0], mesh.n_vertices, f"The entries of {path}")
        return Correspondence.from_template(values)
    if values.shape != (mesh.n_vertices,):
        raise CorrespondenceError(
            f"{path} must contain one template point for each of the {mesh.n_vertices} vertices; "
            f"got shape {values.shape}."
        )
    return Correspondence.from_vertices(values)


# Fraction of common edges above which meshes are taken to have the same vertex order. Unrelated
# meshes share almost none; quads split along different diagonals share two thirds.
_ALIKE = 0.5


def _not_by_number(read: list[_Read], folder: Path, *, asked: bool) -> dict[int, str]:
    """Return, by index, faults of meshes whose vertices do not correspond to the first by number.

    Meshes are compared by their edges, so that the order of faces and corners does not matter and
    some faces may be missing. If ``asked`` is True, only the number of vertices is compared.
    """
    first = read[0]
    n_first = first.mesh.n_vertices
    faults = {}
    for i, one in enumerate(read):
        if not isinstance(one.mesh, Mesh) or np.array_equal(one.faces, first.faces):
            continue
        n_own = one.mesh.n_vertices
        if asked and n_own != n_first:
            faults[i] = (
                f"by_number=True: {one.mesh.name!r} has {n_own} vertices, but {first.mesh.name!r} "
                f"has {n_first}. Leave it out, or add correspondence files to the folder."
            )
        elif not asked and (
            n_own != n_first or share_of_common_edges(one.faces, first.faces) < _ALIKE
        ):
            said = f"{one.mesh.name!r} has other faces than {first.mesh.name!r}"
            # Only the first message explains what to do.
            faults[i] = (
                f"{said} as well."
                if faults
                else f"{folder} has no correspondence files, and {said}, so vertices do not "
                "correspond by number. Add a file for each mesh: NAME.vts, NAME.vertices.txt, "
                "NAME.template.txt, NAME.txt or landmarks; help(skfmap.datasets.load_collection) "
                "explains them. If vertices do correspond, use by_number=True (--by-number). New "
                "meshes, to which a trained model is applied, need no such files."
            )
    return faults


def _warn_of_crowds(read: list[_Read], sound: list[int]) -> None:
    """Warn of meshes in which one template point stands for too many vertices, or the reverse."""
    told = [
        f"{read[i].mesh.name!r} ({said})"
        for i in sound
        if (truth := read[i].truth) is not None and (said := crowded_points(*truth.pairs.T))
    ]
    if told:
        warn(
            f'Suspicious correspondences: {"; ".join(told)}. If the number stands for "none", '
            "write -1 instead (NA in .vts files), because wrong pairs spoil the learning.",
            CoverageWarning,
        )
