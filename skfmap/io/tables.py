"""Tables of landmarks: ``.csv``, ``.tsv`` and ``.txt`` with x, y, z and optionally a name."""

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.exceptions import CorrespondenceError
from skfmap.io.texts import (
    PointRow,
    ReadLandmarks,
    as_number,
    as_read,
    cells_of,
    is_missing,
    position,
    read_text,
    text_of,
)
from skfmap.shapes import Landmarks

__all__ = ["csv_of", "is_table_of_points", "read_table"]

# None stands for any run of blanks. The comma comes late because numbers may contain it.
_SEPARATORS = ("\t", ";", ",", None)
_HEAD = 65536  # number of bytes read to recognise a table
# The first line that Excel writes to declare the separator.
_SEPARATED = re.compile(r'"?sep=.?"?\s*', re.IGNORECASE)
_WORD = re.compile(r'"((?:[^"]|"")*)"|(\S+)')

# Names of columns, in order of preference. Tables of 3D Slicer have r, a, s or l, p, s, and
# "defined".
_AXES = (("xyz", None), ("ras", "RAS"), ("lps", "LPS"))
_NAMES = ("name", "label", "landmark", "point", "lm", "id", "index", "number", "nr", "no", "")
_IN_NAMES = ("name", "label", "landmark")  # as in "Point name"
_PLACED = "defined"
_ERRORS = ("expected_error", "radius", "coverage")


class _Line(NamedTuple):
    where: str
    cells: list[str]


class _Columns(NamedTuple):
    """Positions of the columns; ``n`` is the number of columns."""

    at: list[int]
    name: int | None
    n: int
    system: str | None = None
    placed: int | None = None
    errors: dict[str, int] = {}  # noqa: RUF012


def read_table(path: Path) -> ReadLandmarks:
    """Read a table with a header that names x, y, z, or with three columns, or four with a name."""
    text = list(enumerate(read_text(path), start=1))
    for separator in _SEPARATORS:
        lines, columns = _split(path, text, separator)
        if columns is not None:
            break
    else:
        number, first = next((n, line) for n, line in text if line.strip())
        raise CorrespondenceError(
            f"{path}, line {number}: {first.strip()[:60]!r} is neither a header with x, y and z "
            "nor three coordinates, with or without a name before or after them. Add a header line "
            "(name,x,y,z), put names with blanks in quotes, or rename the file if it contains no "
            "landmarks."
        )
    rows = _rows(path, lines, columns)
    read = as_read(path, rows, columns.system)
    errors = _errors(path, lines, columns)
    if not errors:
        return read
    marks = read.landmarks
    known: dict[str, Any] = {"name": marks.name, **errors}
    return read._replace(landmarks=Landmarks(marks.points, marks.names, **known))


def is_table_of_points(path: Path) -> bool:
    """Return whether a ``.txt`` file may contain points: its first line has at least 3 cells."""
    try:
        begins = read_text(path, _HEAD)
    except CorrespondenceError:
        return False
    text = [line for line in begins if line.strip() and not _is_comment(line)]
    return bool(text) and any(len(_cells(text[0], separator)) >= 3 for separator in _SEPARATORS)


def _split(
    path: Path, text: list[tuple[int, str]], separator: str | None
) -> tuple[list[_Line], _Columns | None]:
    """Return lines of data and their columns; None if they are not separated like this."""
    lines: list[_Line] = []
    head = None
    for number, line in text:
        if not line.strip() or (number == 1 and _SEPARATED.fullmatch(line)):
            continue
        bare = line.lstrip("# ") if line.startswith("#") else line
        if not lines and head is None and (head := _head(_cells(bare, separator))):
            continue
        if not lines and _is_comment(line):
            continue
        lines.append(_Line(f"line {number}", _cells(line, separator)))
    if not lines:
        return lines, head
    n_usual = 0 if head is None else head.n
    if all(len(line.cells) > n_usual and line.cells[-1] == "" for line in lines):
        # Each line ends with a separator.
        lines = [line._replace(cells=line.cells[:-1]) for line in lines]
    if head is None:
        return lines, _without_head(path, lines)
    if head.name is None and all(len(line.cells) == head.n + 1 for line in lines):
        return lines, _with_row_names(head)
    return lines, _with_names_in_front(head, lines)


def _with_row_names(head: _Columns) -> _Columns:
    """Return the columns of a table with row names that have no header, as R writes it."""
    return head._replace(
        at=[i + 1 for i in head.at],
        name=0,
        n=head.n + 1,
        placed=None if head.placed is None else head.placed + 1,
        errors={what: i + 1 for what, i in head.errors.items()},
    )


def _with_names_in_front(head: _Columns, lines: list[_Line]) -> _Columns:
    """Return the columns, the first as names where its head is in another language.

    That is where no head names them, and the first column has another text in each line.
    """
    taken = {*head.at, head.placed, *head.errors.values()}
    if head.name is not None or 0 in taken:
        return head
    words = [line.cells[0] for line in lines if any(line.cells)]
    distinct = len(set(words)) == len(words) and all(words)
    if not distinct or any(_holds_number(word) for word in words):
        return head
    return head._replace(name=0)


def _is_comment(line: str) -> bool:
    """Return whether a line at the top is a comment; ``#1`` may be the name of a point."""
    return line.startswith("#") and not line[1:2].isalnum()


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        found = _WORD.finditer(line)
        return [m[2] if m[1] is None else m[1].replace('""', '"') for m in found]
    return cells_of(line, separator)


def _head(cells: list[str]) -> _Columns | None:
    """Return the columns that a header line names; None if it names no coordinates."""
    # "X (mm)" and "pos_x" also mean x.
    words = [re.sub(r"[\s_]*[(\[].*", "", cell).strip().lower() for cell in cells]
    words = [re.sub(r"^(pos|coord)[ _.]?(?=[xyz]$)", "", word) for word in words]
    for axes, system in _AXES:
        if all(words.count(axis) == 1 for axis in axes):
            exact = [words.index(word) for word in _NAMES if word in words]
            close = [i for i, word in enumerate(words) if any(one in word for one in _IN_NAMES)]
            name = next(iter(exact + close), None)
            placed = words.index(_PLACED) if _PLACED in words else None
            errors = {word: words.index(word) for word in _ERRORS if word in words}
            at = [words.index(axis) for axis in axes]
            return _Columns(at, name, len(words), system, placed, errors)
    return None


def _without_head(path: Path, lines: list[_Line]) -> _Columns | None:
    """Return the columns of a table without a header; None if the first line is not clear."""
    where, first = lines[0]
    numeric = [_holds_number(cell) for cell in first]
    if len(first) == 3 and all(numeric):
        return _Columns([0, 1, 2], None, 3)
    if len(first) != 4 or sum(numeric) < 3:
        return None
    if not numeric[0]:
        return _Columns([1, 2, 3], 0, 4)
    if not numeric[3]:
        return _Columns([0, 1, 2], 3, 4)
    if all(line.cells[:1] == [str(i)] for i, line in enumerate(lines, start=1)):
        return _Columns([1, 2, 3], 0, 4)
    raise CorrespondenceError(
        f"{path}, {where}: the line has four numbers, and it is not known which is the name. Add a "
        "header line such as name,x,y,z."
    )


def _holds_number(cell: str) -> bool:
    return as_number(cell) is not None or as_number(cell.replace(",", ".", 1)) is not None


def _rows(path: Path, lines: list[_Line], columns: _Columns) -> list[PointRow]:
    rows = []
    for (where, cells), coordinates in _points(path, lines, columns):
        name = "" if columns.name is None else cells[columns.name]
        if columns.name is not None and not any(cells):  # spreadsheets add blank rows at the end
            continue
        unplaced = columns.placed is not None and cells[columns.placed].lower() in {"0", "false"}
        at = np.full(3, np.nan) if unplaced else position(path, where, coordinates)
        rows.append(PointRow(where, name, at))
    return rows


def _points(path: Path, lines: list[_Line], columns: _Columns) -> Iterator[tuple[_Line, list[str]]]:
    """Yield each line with its three coordinates, with decimal commas replaced by points.

    A file with both commas and points in its coordinates raises an error, because one of them may
    be a thousands separator.
    """
    with_point = False
    with_comma = ""
    for line in lines:
        if len(line.cells) != columns.n:
            raise CorrespondenceError(
                f"{path}, {line.where}: the line has {len(line.cells)} cells, but the first line "
                f"has {columns.n}. Write missing coordinates as NA, put names with blanks or "
                "separators in quotes, and use decimal points."
            )
        coordinates = [line.cells[i] for i in columns.at]
        with_point |= any("." in cell and not is_missing(cell) for cell in coordinates)
        with_comma = next((line.where for cell in coordinates if "," in cell), with_comma)
        if with_point and with_comma:
            raise CorrespondenceError(
                f"{path}, {with_comma}: the line has decimal commas, but other numbers have "
                "decimal points. Write all numbers with points."
            )
        yield line, [cell.replace(",", ".", 1) for cell in coordinates]


def _errors(path: Path, lines: list[_Line], columns: _Columns) -> dict[str, FloatArray | float]:
    """Return the expected errors, the radii and their coverage, if the table has them."""
    values: dict[str, FloatArray | float] = {}
    for what, column in columns.errors.items():
        numbers = []
        for where, cells in lines:
            number = as_number(cells[column].replace(",", ".", 1))
            if number is None:
                raise CorrespondenceError(
                    f"{path}, {where}: {cells[column]!r} in column {what} is not a number. Leave "
                    "unknown values blank."
                )
            numbers.append(number)
        values[what] = np.array(numbers)
    if "coverage" in values:
        known = np.unique(np.asarray(values.pop("coverage")))
        known = known[np.isfinite(known)]
        if len(known) > 1:
            raise CorrespondenceError(
                f"{path} has different numbers in column coverage; all radii of a shape must have "
                "the same coverage."
            )
        if len(known):
            values["coverage"] = float(known[0])
    return values


def csv_of(landmarks: Landmarks) -> str:
    """Return the text of a ``.csv`` file; missing landmarks have blank coordinates."""
    file = io.StringIO()
    table = csv.writer(file, lineterminator="\n")
    more: dict[str, FloatArray | None] = {
        "expected_error": landmarks.expected_error,
        "radius": landmarks.radius,
        "coverage": None
        if landmarks.coverage is None
        else np.full(len(landmarks.names), landmarks.coverage),
    }
    given = {what: values for what, values in more.items() if values is not None}
    table.writerow(["name", "x", "y", "z", *given])
    for i, (name, at) in enumerate(zip(landmarks.names, landmarks.points, strict=True)):
        numbers = [*at, *(values[i] for values in given.values())]
        table.writerow([name, *("" if np.isnan(one) else text_of(one) for one in numbers)])
    return file.getvalue()
