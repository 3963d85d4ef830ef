"""Reading and writing landmarks in the formats of those who place them."""

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

# Line breaks and what no text holds.
_UNWRITABLE = ("Cc", "Cs", "Cn", "Zl", "Zp")


def read_landmarks(
    path: str | Path, *, system: str | None = None, specimen: str | int | None = None
) -> Landmarks:
    r"""Read landmarks from a file of 3D Slicer, MeshLab, tps, Landmark Editor, or from a table.

    ========================  =====================================================================
    ``.fcsv``, ``.mrk.json``  3D Slicer; points that were not placed are missing
    ``.pp``                   MeshLab (``_picked_points.pp``); inactive points are missing
    ``.tps``                  tps in three dimensions (``LM3=``); coordinates are multiplied by
                              ``SCALE``, and points on curves left out
    ``.pts``                  Landmark Editor; three times 9999 is missing
    ``.csv .tsv .txt``        a head line with x, y, z and perhaps a name, or without it three
                              columns, or four with the name first or last; separated by commas,
                              semicolons, tabs or blanks; decimal commas where commas separate
                              nothing
    ========================  =====================================================================

    In all of them three coordinates that are blank, NaN, NA, -999 or -9999 are a missing landmark,
    which keeps its name. Those without a name are called by their number in the file, from 1.

    Parameters
    ----------
    path : str or Path
        File to read. ``Landmarks.name`` is its stem without ``_Landmarks``, ``_LM`` and the like,
        or the ``ID`` of a tps file.
    system : {"LPS", "RAS"}, optional
        System of coordinates to return them in: x and y are negated where the file names the other
        one. As written by default.
    specimen : str or int, optional
        Which specimen of a tps file that holds several: its ``ID``, or else its ``IMAGE`` without
        suffix; or its number, from 0.

    Returns
    -------
    Landmarks
        Those of the file, in its order.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    CorrespondenceError
        If the file cannot be read as landmarks, with the line and the remedy; if a name stands
        twice; or if ``system`` is given and the file names none.

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
            f"{path} does not say whether it is in LPS or RAS, so that it cannot be turned to "
            f"{system}. Leave system out to have the coordinates as written."
        )
    marks = read.landmarks
    return moved(marks, marks.points * [-1, -1, 1], marks.name)


def open_landmarks(path: str | Path, specimen: str | int | None = None) -> ReadLandmarks:
    """Return the landmarks of a file as written, their system, and what was done to them."""
    if not isinstance(path, (str, Path)):
        raise TypeError(f"Landmarks are read from a path; got {path!r}.")
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
        raise ValueError(f"specimen={specimen!r} chooses from tps files; {path} is none.")
    return _READERS[suffix](path)


def write_landmarks(landmarks: Landmarks, path: str | Path, *, overwrite: bool = False) -> None:
    """Write landmarks; the suffix of ``path`` chooses the format.

    All formats keep every digit, and missing landmarks in their own way. Expected errors and radii
    go into columns of ``.csv``, and into the descriptions of 3D Slicer's points; the others cannot
    hold them. ``.tps`` holds no names: its landmarks are numbered when they are read again. Files
    of 3D Slicer say that their coordinates are LPS, as which it takes those of meshes.

    Parameters
    ----------
    landmarks : Landmarks
        What to write.
    path : str or Path
        File to write: .fcsv, .mrk.json, .pp, .tps, .pts or .csv.
    overwrite : bool, default=False
        Whether a file that is there may be replaced.

    Raises
    ------
    FileExistsError
        If there is such a file, and ``overwrite`` is False.
    FileNotFoundError
        If there is no such folder.
    ValueError
        If the suffix is another, or a name would not be read back: with blanks around it, with a
        line break, or empty.
    TypeError
        If they are no `Landmarks`.

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
        raise TypeError(f"skfmap.Landmarks are written; got {type(landmarks).__name__}.")
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
            f"The name {name!r} cannot be written to {path} and read again: names have no blanks "
            "around them, are of one line, and are not empty. Rename it."
        )
