"""Reading of landmark text files: encodings, numbers, and marks for missing points."""

import codecs
import csv
import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.exceptions import CorrespondenceError
from skfmap.shapes import Landmarks

__all__ = [
    "MARKS",
    "PointRow",
    "ReadLandmarks",
    "as_count",
    "as_number",
    "as_read",
    "cells_of",
    "is_missing",
    "moved",
    "position",
    "read_text",
    "shape_name",
    "text_of",
]


class PointRow(NamedTuple):
    """A landmark read from a file; NaN if it is missing.

    ``where`` is the line or entry of the file, for error messages.
    """

    where: str
    name: str
    at: FloatArray


class ReadLandmarks(NamedTuple):
    """Landmarks read from a file.

    ``system`` is "LPS", "RAS" or None if it is not stated; ``done`` describes conversions.
    """

    landmarks: Landmarks
    system: str | None = None
    done: str = ""


# Endings of the stems of landmark files, after the name of the shape.
MARKS = r"[ ._-](?:landmarks?|lms?|lmks?|picked[ _-]points|points|markups?|fiducials?)"

# Byte order marks. That of UTF-32 begins like that of UTF-16, so it comes first.
_BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
# Marks of missing numbers in spreadsheets, R, and old and new C libraries.
_UNKNOWN = re.compile(
    r"|[+-]?nan(\(.*\))?|#?n[/.]?a[!.]?|null|none|[+-]?1\.#(ind|qnan).*", re.IGNORECASE
)

# Values that mark a missing point if all three coordinates have them.
_SENTINELS = (-999.0, -9999.0)


def read_text(path: Path, most: int = -1) -> list[str]:
    """Return the lines of a text file in UTF-8, UTF-16 or UTF-32 with its mark, or Latin-1.

    If ``most`` is not negative, only that many bytes are read.
    """
    with path.open("rb") as file:
        content = file.read(most)
    text = _decoded(path, content).replace("\r\n", "\n").replace("\r", "\n")
    if not text.strip():
        raise CorrespondenceError(f"{path} is empty. Export it again, or remove it.")
    if "\0" in text:
        raise CorrespondenceError(
            f"{path} is not text: it contains zero bytes. If it is UTF-16 without a byte order "
            "mark, save it as UTF-8."
        )
    return text.split("\n")


def _decoded(path: Path, content: bytes) -> str:
    for mark, encoding in _BYTE_ORDER_MARKS:
        if content.startswith(mark):
            try:
                return content.removeprefix(mark).decode(encoding)
            except UnicodeDecodeError as error:
                raise CorrespondenceError(
                    f"{path} begins as {encoding.upper()}, but byte {error.start} is not valid in "
                    "it. Save it as UTF-8."
                ) from None
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def cells_of(line: str, separator: str) -> list[str]:
    """Return the cells of a line without surrounding blanks; separators in quotes are kept."""
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # a line of megabytes is not a table
        return [line]
    return [cell.strip() for cell in cells]


def is_missing(cell: str) -> bool:
    """Return whether a cell marks a missing number: blank, NaN, NA and the like."""
    return _UNKNOWN.fullmatch(cell.strip()) is not None


def as_number(cell: str) -> float | None:
    """Return the number in a cell, NaN if it marks a missing one, or None if it is invalid."""
    cell = cell.strip()
    if is_missing(cell):
        return math.nan
    if not _NUMBER.fullmatch(cell) or math.isinf(value := float(cell)):
        return None
    return value


def as_count(cell: str) -> int | None:
    """Return the non-negative integer in a cell, or None if it is invalid."""
    return int(cell) if re.fullmatch(r"\d{1,9}", cell.strip(), re.ASCII) else None


def position(
    path: Path, where: str, cells: list[str], sentinels: tuple[float, ...] = _SENTINELS
) -> FloatArray:
    """Return three coordinates; all are NaN if they mark a missing landmark."""
    numbers = [as_number(cell) for cell in cells]
    for cell, number in zip(cells, numbers, strict=True):
        if number is None:
            raise CorrespondenceError(
                f"{path}, {where}: {cell.strip()!r} is not a number. Write it with a decimal "
                "point, or NA for all three coordinates of a missing landmark."
            )
    at = np.array(numbers, dtype=np.float64)
    if any((at == sentinel).all() for sentinel in sentinels):
        return np.full(3, np.nan)
    if 0 < np.isnan(at).sum() < 3:
        raise CorrespondenceError(
            f"{path}, {where}: the landmark has only some of its coordinates "
            f"({', '.join(map(repr, cells))}). Give three numbers, or NA three times if it is "
            "missing."
        )
    return at


def as_read(
    path: Path, rows: list[PointRow], system: str | None = None, done: str = "", name: str = ""
) -> ReadLandmarks:
    """Return the rows of a file as landmarks; raise an error if there are none or names repeat.

    Landmarks without a name are named by their number in the file, counted from 1.
    """
    if not rows:
        raise CorrespondenceError(
            f"{path} contains no landmarks. Export them again, or remove the file."
        )
    names = [row.name.strip() or str(i) for i, row in enumerate(rows, start=1)]
    first: dict[str, PointRow] = {}
    for row, label in zip(rows, names, strict=True):
        if label in first:
            raise CorrespondenceError(
                f"{path} has several points with the same name: {label!r} ({first[label].where} "
                f"and {row.where}). Give each landmark its own name, and each specimen its own "
                "file."
            )
        first[label] = row
    points = np.stack([row.at for row in rows])
    landmarks = Landmarks(points, names, name=name or shape_name(path))
    return ReadLandmarks(landmarks, system, done)


def moved(landmarks: Landmarks, points: FloatArray, name: str | None) -> Landmarks:
    """Return a copy of landmarks with other coordinates and another name of the shape."""
    return Landmarks(
        points,
        landmarks.names,
        name=name,
        expected_error=landmarks.expected_error,
        radius=landmarks.radius,
        coverage=landmarks.coverage,
    )


def shape_name(path: Path) -> str:
    """Return the name of the shape of a landmark file: ``cat`` for ``cat_Landmarks.fcsv``."""
    stem = re.sub(r"(\.mrk)?\.[^.]*$", "", path.name, count=1, flags=re.IGNORECASE)
    return re.sub(MARKS + "$", "", stem, count=1, flags=re.IGNORECASE) or stem


def text_of(value: float) -> str:
    """Return a number as text that is read back as the same float."""
    return repr(float(value))
