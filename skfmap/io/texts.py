"""Texts as laboratories keep them: their encodings, their numbers, and what says "missing"."""

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
    """A landmark as a file holds it; NaN where it is missing.

    ``where`` tells an error message which line of the file it is, or which entry.
    """

    where: str
    name: str
    at: FloatArray


class ReadLandmarks(NamedTuple):
    """What a file holds: ``system`` is "LPS", "RAS" or None, ``done`` what was done to it."""

    landmarks: Landmarks
    system: str | None = None
    done: str = ""


# What names of landmark files have between the name of the shape and the suffix.
MARKS = r"[ ._-](?:landmarks?|lms?|lmks?|picked[ _-]points|points|markups?|fiducials?)"

# Longer byte order marks first: that of UTF-32 begins like that of UTF-16.
_BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
# Spreadsheets, R, and C libraries old and new.
_UNKNOWN = re.compile(
    r"|[+-]?nan(\(.*\))?|#?n[/.]?a[!.]?|null|none|[+-]?1\.#(ind|qnan).*", re.IGNORECASE
)

# What stands for a missing point if all three coordinates are it.
_SENTINELS = (-999.0, -9999.0)


def read_text(path: Path, most: int = -1) -> list[str]:
    """Return the lines of a text in UTF-8, in UTF-16 with its mark, or else in Latin-1.

    Those of its first ``most`` bytes, if it is not negative.
    """
    with path.open("rb") as file:
        content = file.read(most)
    text = _decoded(path, content).replace("\r\n", "\n").replace("\r", "\n")
    if not text.strip():
        raise CorrespondenceError(
            f"{path} is empty. Export what it should hold again, or remove it."
        )
    if "\0" in text:
        raise CorrespondenceError(
            f"{path} is not text (it holds bytes of value zero). If it is UTF-16 without a byte "
            "order mark, save it as UTF-8."
        )
    return text.split("\n")


def _decoded(path: Path, content: bytes) -> str:
    for mark, encoding in _BYTE_ORDER_MARKS:
        if content.startswith(mark):
            try:
                return content.removeprefix(mark).decode(encoding)
            except UnicodeDecodeError as error:
                raise CorrespondenceError(
                    f"{path} begins as {encoding.upper()}, but byte {error.start} is not of it. "
                    "Save it as UTF-8."
                ) from None
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def cells_of(line: str, separator: str) -> list[str]:
    """Return the cells of a line, without blanks around them; quotes hold separators."""
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # a line of megabytes: no table
        return [line]
    return [cell.strip() for cell in cells]


def is_missing(cell: str) -> bool:
    """Return whether a cell says that there is no number: blank, NaN, NA."""
    return _UNKNOWN.fullmatch(cell.strip()) is not None


def as_number(cell: str) -> float | None:
    """Return the number that a cell holds, NaN where it says that there is none; else None."""
    cell = cell.strip()
    if is_missing(cell):
        return math.nan
    if not _NUMBER.fullmatch(cell) or math.isinf(value := float(cell)):
        return None
    return value


def as_count(cell: str) -> int | None:
    """Return the whole number that a cell holds, else None."""
    return int(cell) if re.fullmatch(r"\d{1,9}", cell.strip(), re.ASCII) else None


def position(
    path: Path, where: str, cells: list[str], sentinels: tuple[float, ...] = _SENTINELS
) -> FloatArray:
    """Return three coordinates, all NaN where they say that the landmark is missing."""
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
            f"{path}, {where}: the landmark is known in part ({', '.join(map(repr, cells))}). Give "
            "three numbers, or NA three times if it is missing."
        )
    return at


def as_read(
    path: Path, rows: list[PointRow], system: str | None = None, done: str = "", name: str = ""
) -> ReadLandmarks:
    """Return the rows of a file as landmarks; raise where there are none, or names stand twice.

    Those without a name are called by their number in the file, from 1.
    """
    if not rows:
        raise CorrespondenceError(
            f"{path} holds no landmark. Export the landmarks again, or remove it."
        )
    names = [row.name.strip() or str(i) for i, row in enumerate(rows, start=1)]
    first: dict[str, PointRow] = {}
    for row, label in zip(rows, names, strict=True):
        if label in first:
            raise CorrespondenceError(
                f"{path} has several points of one name: {label!r} ({first[label].where} and "
                f"{row.where}). Give each landmark a name of its own, and each specimen a file."
            )
        first[label] = row
    points = np.stack([row.at for row in rows])
    landmarks = Landmarks(points, names, name=name or shape_name(path))
    return ReadLandmarks(landmarks, system, done)


def moved(landmarks: Landmarks, points: FloatArray, name: str | None) -> Landmarks:
    """Return landmarks at other coordinates, of a shape of that name."""
    return Landmarks(
        points,
        landmarks.names,
        name=name,
        expected_error=landmarks.expected_error,
        radius=landmarks.radius,
        coverage=landmarks.coverage,
    )


def shape_name(path: Path) -> str:
    """Return the name of the shape that a landmark file is of: ``cat_Landmarks.fcsv`` is cat's."""
    stem = re.sub(r"(\.mrk)?\.[^.]*$", "", path.name, count=1, flags=re.IGNORECASE)
    return re.sub(MARKS + "$", "", stem, count=1, flags=re.IGNORECASE) or stem


def text_of(value: float) -> str:
    """Return a number so that it is read as the same float."""
    return repr(float(value))
