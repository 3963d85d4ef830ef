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

# In this format only, three times 9999 marks a missing point.
_MISSING = (9999.0, -999.0, -9999.0)


def read_pts(path: Path) -> ReadLandmarks:
    """Read a ``.pts`` file: a version, a number of points, and a name and position per line."""
    lines = [
        (f"line {number}", line.strip())
        for number, line in enumerate(read_text(path), start=1)
        if line.strip()
    ]
    where, head = lines[0]
    if not head.lower().startswith("version"):
        raise CorrespondenceError(
            f"{path}, {where}: a file of Landmark Editor begins with 'Version', but this one "
            f"begins with {head[:40]!r}. If it is a table of coordinates, rename it to .txt."
        )
    where, said = lines[1] if len(lines) > 1 else (where, "")
    if (count := as_count(said)) is None:
        raise CorrespondenceError(
            f"{path}, {where}: the number of points must follow the version; got {said[:40]!r}."
        )
    rows = [_row(path, where, line) for where, line in lines[2:]]
    if len(rows) != count:
        raise CorrespondenceError(
            f"{path}, {where}: {count} points are declared, but {len(rows)} follow. The file may "
            "be truncated; export it again."
        )
    return as_read(path, rows)


def _row(path: Path, where: str, line: str) -> PointRow:
    cells = line.rsplit(maxsplit=3)
    if len(cells) < 3:
        raise CorrespondenceError(
            f"{path}, {where}: {line[:40]!r} is not a name with three coordinates. For a missing "
            "landmark, write 9999 three times."
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
