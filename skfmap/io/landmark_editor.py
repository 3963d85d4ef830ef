"""Landmark files of IDAV Landmark Editor: ``.pts``."""

from pathlib import Path

from skfmap.exceptions import CorrespondenceError
from skfmap.io.texts import (
    PointRow,
    ReadLandmarks,
    as_count,
    as_read,
    position,
    read_text,
    text_of,
)
from skfmap.shapes import Landmarks

__all__ = ["pts_of", "read_pts"]

# Three times 9999 is a missing point in this format, and in no other.
_MISSING = (9999.0, -999.0, -9999.0)


def read_pts(path: Path) -> ReadLandmarks:
    """Read a ``.pts`` file: a version, a number of points, then a name and a position per line."""
    lines = [
        (f"line {number}", line.strip())
        for number, line in enumerate(read_text(path), start=1)
        if line.strip()
    ]
    where, head = lines[0]
    if not head.lower().startswith("version"):
        raise CorrespondenceError(
            f"{path}, {where}: it begins with {head[:40]!r}, not with 'Version' as files of "
            "Landmark Editor do. If it is a table of coordinates, name it .txt."
        )
    where, said = lines[1] if len(lines) > 1 else (where, "")
    if (count := as_count(said)) is None:
        raise CorrespondenceError(
            f"{path}, {where}: the number of points must follow the version; got {said[:40]!r}."
        )
    rows = [_row(path, where, line) for where, line in lines[2:]]
    if len(rows) != count:
        raise CorrespondenceError(
            f"{path}, {where}: {count} points are said to follow, but there are {len(rows)}. Is "
            "the file cut short?"
        )
    return as_read(path, rows)


def _row(path: Path, where: str, line: str) -> PointRow:
    cells = line.rsplit(maxsplit=3)
    if len(cells) < 3:
        raise CorrespondenceError(
            f"{path}, {where}: {line[:40]!r} is not a name with three coordinates. Write 9999 "
            "three times for a missing landmark."
        )
    name = cells[0] if len(cells) == 4 else ""
    return PointRow(where, name, position(path, where, cells[-3:], _MISSING))


def pts_of(landmarks: Landmarks) -> str:
    """Return the text of a ``.pts`` file."""
    lines = [
        f"{name} {' '.join(text_of(value) for value in at) if placed else '9999 9999 9999'}"
        for name, at, placed in zip(
            landmarks.names, landmarks.points, landmarks.placed, strict=True
        )
    ]
    return "\n".join(["Version 1.0", str(len(lines)), *lines, ""])
