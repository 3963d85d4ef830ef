"""Reading and writing of landmarks in the formats of common programs."""

import unicodedata
from collections.abc import Callable, Mapping
from pathlib import Path

from skfmap._tools.validation import check_choice, check_folder
from skfmap.exceptions import CorrespondenceError
from skfmap.io.landmark_editor import pts_of, read_pts
from skfmap.io.meshlab import pp_of, read_pp
from skfmap.io.slicer import fcsv_of, mrk_json_of, read_fcsv, read_mrk_json
from skfmap.io.tables import csv_of, read_table
from skfmap.io.texts import ReadLandmarks, moved
from skfmap.io.tps import read_tps, tps_of
from skfmap.shapes import Landmarks

__all__ = [
    "LANDMARK_SUFFIXES",
    "WRITTEN_LANDMARK_SUFFIXES",
    "open_landmarks",
    "read_landmarks",
    "write_landmarks",
]

_READERS: dict[str, Callable[[Path], ReadLandmarks]] = {
    ".fcsv": read_fcsv,
    ".mrk.json": read_mrk_json,
    ".pp": read_pp,
    ".tps": read_tps,
    ".pts": read_pts,
    ".csv": read_table,
    ".tsv": read_table,
    ".txt": read_table,
}
_WRITERS: dict[str, Callable[[Landmarks], str]] = {
    ".fcsv": fcsv_of,
    ".mrk.json": mrk_json_of,
    ".pp": pp_of,
    ".tps": tps_of,
    ".pts": pts_of,
    ".csv": csv_of,
}

LANDMARK_SUFFIXES = tuple(_READERS)
"""Formats that landmarks are read from."""

WRITTEN_LANDMARK_SUFFIXES = tuple(_WRITERS)
"""Formats that landmarks are written as."""

# Unicode categories of line breaks and of characters that text files cannot hold.
_UNWRITABLE = ("Cc", "Cs", "Cn", "Zl", "Zp")


def read_landmarks(
    path: str | Path, *, system: str | None = None, specimen: str | int | None = None
) -> Landmarks:
    r"""Read landmarks from a file of 3D Slicer, MeshLab, tps or Landmark Editor, or from a table.

    ========================  =====================================================================
    ``.fcsv``, ``.mrk.json``  3D Slicer; points that were not placed are missing
    ``.pp``                   MeshLab (``_picked_points.pp``); inactive points are missing
    ``.tps``                  tps in three dimensions (``LM3=``); coordinates are multiplied by
                              ``SCALE``, and points on curves are left out
    ``.pts``                  Landmark Editor; three times 9999 marks a missing point
    ``.csv .tsv .txt``        a table with a header line that names x, y, z and optionally a name;
                              or, without a header, three columns, or four with the name first or
                              last. Columns are separated by commas, semicolons, tabs or blanks.
                              Decimal commas are allowed if columns are not separated by commas.
    ========================  =====================================================================

    In all formats, three coordinates that are blank, NaN, NA, -999 or -9999 mark a missing
    landmark, which keeps its name. Landmarks without a name are named by their number in the file,
    counted from 1.

    Parameters
    ----------
    path : str or Path
        File to read. ``Landmarks.name`` is its stem without endings such as ``_Landmarks`` or
        ``_LM``, or the ``ID`` in a tps file.
    system : {"LPS", "RAS"}, optional
        Coordinate system of the result: x and y are negated if the file states the other system.
        By default, coordinates are returned as written.
    specimen : str or int, optional
        Specimen to read from a tps file with several: its ``ID``, or its ``IMAGE`` without suffix
        if it has no ``ID``; or its index, counted from 0.

    Returns
    -------
    Landmarks
        Landmarks in the order of the file.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    CorrespondenceError
        If the file cannot be read as landmarks (the message names the line and the remedy), a name
        occurs twice, or ``system`` is given but the file does not state its system.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from skfmap.io import read_landmarks
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "cat_Landmarks.csv"
    >>> _ = path.write_text("name,x,y,z\nnose,1,2,3\nchin,NA,NA,NA\n")
    >>> read_landmarks(path)
    Landmarks('cat', n_landmarks=2, 1 missing)
    """
    check_choice(system, "system", (None, "LPS", "RAS"))
    read = open_landmarks(path, specimen)
    if system is None or read.system == system:
        return read.landmarks
    if read.system is None:
        raise CorrespondenceError(
            f"{path} does not say whether it is in LPS or RAS, so it cannot be converted to "
            f"{system}. Leave system out to get the coordinates as written."
        )
    marks = read.landmarks
    return moved(marks, marks.points * [-1, -1, 1], marks.name)


def open_landmarks(path: str | Path, specimen: str | int | None = None) -> ReadLandmarks:
    """Return the landmarks of a file as written, their coordinate system, and conversions made."""
    if not isinstance(path, (str, Path)):
        raise TypeError(f"path must be the path of a landmark file; got {path!r}.")
    path = Path(path)
    suffix = _suffix(path, _READERS)
    if suffix is None:
        raise CorrespondenceError(
            f"{path} has the suffix {path.suffix!r}; landmarks are read from "
            f"{', '.join(LANDMARK_SUFFIXES)}."
        )
    if not path.is_file():
        raise FileNotFoundError(f"There is no landmark file {path}.")
    if suffix == ".tps":
        return read_tps(path, specimen)
    if specimen is not None:
        raise ValueError(
            f"specimen={specimen!r} selects from a tps file, but {path} is not one. Leave it out."
        )
    return _READERS[suffix](path)


def write_landmarks(landmarks: Landmarks, path: str | Path, *, overwrite: bool = False) -> None:
    """Write landmarks to a file; the suffix of ``path`` selects the format.

    All formats keep all digits, and each marks missing landmarks in its own way. Expected errors
    and radii are written to columns of ``.csv`` and to the descriptions of points in 3D Slicer's
    formats; other formats cannot hold them. ``.tps`` has no names: its landmarks are numbered when
    they are read again. Files for 3D Slicer state LPS, the system in which it reads meshes.

    Parameters
    ----------
    landmarks : Landmarks
        Landmarks to write.
    path : str or Path
        File to write: .fcsv, .mrk.json, .pp, .tps, .pts or .csv.
    overwrite : bool, default=False
        Whether an existing file may be replaced.

    Raises
    ------
    FileExistsError
        If the file exists and ``overwrite`` is False.
    FileNotFoundError
        If the folder does not exist.
    ValueError
        If the suffix is not supported, or a name could not be read back because it is empty, or
        contains line breaks or surrounding blanks.
    TypeError
        If ``landmarks`` is not a `Landmarks`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from skfmap import Landmarks
    >>> from skfmap.io import read_landmarks, write_landmarks
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "cat.fcsv"
    >>> write_landmarks(Landmarks([[0.1, 0, 0]], ["nose"]), path)
    >>> read_landmarks(path).point("nose").tolist()
    [0.1, 0.0, 0.0]
    """
    if not isinstance(landmarks, Landmarks):
        raise TypeError(f"landmarks must be skfmap.Landmarks; got {type(landmarks).__name__}.")
    path = Path(path)
    suffix = _suffix(path, _WRITERS)
    if suffix is None:
        raise ValueError(
            f"{path} has the suffix {path.suffix!r}; landmarks are written as "
            f"{', '.join(_WRITERS)}."
        )
    of_shape = landmarks.name if suffix == ".tps" else None
    for name in (*landmarks.names, *([] if of_shape is None else [of_shape])):
        _check_name(name, path)
    if not landmarks.names:
        raise ValueError(f"There are no landmarks to write to {path}.")
    check_folder(path)
    text = _WRITERS[suffix](landmarks)
    try:
        with path.open("w" if overwrite else "x", encoding="utf-8", newline="\n") as file:
            file.write(text)
    except FileExistsError:
        raise FileExistsError(
            f"{path} already exists; write to another file, or pass overwrite=True."
        ) from None


def _suffix(path: Path, known: Mapping[str, object]) -> str | None:
    name = path.name.lower()
    return next((suffix for suffix in known if name.endswith(suffix)), None)


def _check_name(name: str, path: Path) -> None:
    odd = [c for c in name if unicodedata.category(c) in _UNWRITABLE]
    if not name or name != name.strip() or odd:
        raise ValueError(
            f"The name {name!r} cannot be written to {path} and read again: names must not be "
            "empty, and must not contain line breaks or surrounding blanks. Rename it."
        )
