"""Landmark files of 3D Slicer: ``.fcsv`` and ``.mrk.json``."""

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.exceptions import CorrespondenceError
from skfmap.io.texts import PointRow, ReadLandmarks, as_read, cells_of, position, read_text, text_of
from skfmap.shapes import Landmarks

__all__ = ["fcsv_of", "mrk_json_of", "read_fcsv", "read_mrk_json"]

# Versions before 4.11 write numbers.
_SYSTEMS = {"0": "RAS", "RAS": "RAS", "1": "LPS", "LPS": "LPS"}

# Versions from 5.0 on write two more cells than they name: the status of the position, in which 2
# means "defined", and whether the point was created automatically.
_COLUMNS = (
    *("id", "x", "y", "z", "ow", "ox", "oy", "oz", "vis", "sel", "lock"),
    *("label", "desc", "associatednodeid"),
)
_DEFINED, _UNDEFINED = "2", "0"
_STATUSES, _FLAGS = ("0", "1", "2", "3"), ("0", "1")

_PLACED, _NOT_PLACED = ("defined",), ("undefined", "preview", "missing")

_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/"
    "Schema/markups-schema-v1.0.3.json#"
)


def read_fcsv(path: Path) -> ReadLandmarks:
    """Read a ``.fcsv`` file of any version, in the coordinate system that it states."""
    columns, system = list(_COLUMNS), None
    rows = []
    for number, line in enumerate(read_text(path), start=1):
        where = f"line {number}"
        if line.lstrip().startswith("#"):
            key, _, value = (part.strip() for part in line.lstrip(" #").partition("="))
            if key.lower() == "columns":
                columns = _named_columns(path, where, value)
            elif key.lower() == "coordinatesystem":
                system = _system(path, where, value)
        elif line.strip():
            rows.append(_fiducial(path, where, columns, cells_of(line, ",")))
    return as_read(path, rows, system)


def _named_columns(path: Path, where: str, value: str) -> list[str]:
    columns = [column.strip().lower() for column in value.split(",")]
    if lacking := [column for column in "xyz" if column not in columns]:
        raise CorrespondenceError(
            f"{path}, {where}: there is no column {lacking[0]!r} among {', '.join(columns)}. "
            "Export the landmarks from Slicer again."
        )
    return columns


def _system(path: Path, where: str, value: object) -> str:
    system = _SYSTEMS.get(str(value).strip().upper())
    if system is None:
        raise CorrespondenceError(
            f"{path}, {where}: the coordinate system {value!r} is neither LPS (1) nor RAS (0). "
            "Save the landmarks in Slicer again."
        )
    return system


def _fiducial(path: Path, where: str, columns: list[str], cells: list[str]) -> PointRow:
    needed = 1 + max(columns.index(one) for one in "xyz")
    if len(cells) < needed:
        raise CorrespondenceError(
            f"{path}, {where}: the line has {len(cells)} cells, but needs at least {needed} for "
            f"its coordinates ({', '.join(columns)}). It may be truncated; export the landmarks "
            "from Slicer again."
        )
    named = dict(zip(columns, cells, strict=False))
    status, by_itself = cells[len(columns) :][-2:] if len(cells) > len(columns) + 1 else ("", "")
    # An unquoted comma in a label also adds cells, which are not a status and a flag.
    says = status in _STATUSES and by_itself in _FLAGS
    if says and status != _DEFINED:
        at = np.full(3, np.nan)
    else:
        at = position(path, where, [named[one] for one in "xyz"])
    return PointRow(where, named.get("label", ""), at)


def fcsv_of(landmarks: Landmarks) -> str:
    """Return the text of a ``.fcsv`` file in LPS, the system in which Slicer reads meshes."""
    file = io.StringIO()
    file.write("# Markups fiducial file version = 5.0\n# CoordinateSystem = LPS\n")
    file.write(f"# columns = {','.join(_COLUMNS[:-1])},associatedNodeID\n")
    table = csv.writer(file, lineterminator="\n")
    said = _descriptions(landmarks)
    for i, (name, at) in enumerate(zip(landmarks.names, landmarks.points, strict=True)):
        placed = landmarks.placed[i]
        cells = [text_of(value) if placed else "0" for value in at]
        flags = ("0", "0", "0", "1", "1", "1", "0")  # orientation, visible, selected, locked
        status = _DEFINED if placed else _UNDEFINED
        table.writerow([str(i + 1), *cells, *flags, name, said[i], "", status, "0"])
    return file.getvalue()


def read_mrk_json(path: Path) -> ReadLandmarks:
    """Read the list of points of a ``.mrk.json`` file, in the coordinate system that it states."""
    text = "\n".join(read_text(path))
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise CorrespondenceError(
            f"{path} is not valid JSON: {error}. It may be truncated; save the landmarks in Slicer "
            "again."
        ) from None
    markup = _point_list(path, content)
    said = markup.get("coordinateSystem")
    system = None if said is None else _system(path, "coordinateSystem", said)
    points = markup.get("controlPoints", [])
    if not isinstance(points, list):
        raise _odd(path, "controlPoints", "is not a list")
    rows = [_control_point(path, f"point {i}", one) for i, one in enumerate(points, start=1)]
    return as_read(path, rows, system)


def _point_list(path: Path, content: object) -> dict[str, Any]:
    markups = content.get("markups") if isinstance(content, dict) else None
    if not isinstance(markups, list) or not all(isinstance(one, dict) for one in markups):
        raise _odd(path, "markups", "is not a list of markups")
    kinds = [str(one.get("type", "Fiducial")) for one in markups]
    lists = [one for one, kind in zip(markups, kinds, strict=True) if kind == "Fiducial"]
    if len(lists) != 1:
        counts = [len(one.get("controlPoints", ())) for one in markups]
        there = ", ".join(f"{k} ({n} points)" for k, n in zip(kinds, counts, strict=True))
        raise CorrespondenceError(
            f"{path} must contain exactly one list of points (type 'Fiducial'), but contains "
            f"{there or 'no markup'}. Save the list of landmarks in its own file."
        )
    return lists[0]


def _odd(path: Path, where: str, what: str) -> CorrespondenceError:
    return CorrespondenceError(
        f"{path}, {where}: it {what}, so this is not a markups file of Slicer. Save the landmarks "
        "in Slicer again."
    )


def _control_point(path: Path, where: str, point: object) -> PointRow:
    if not isinstance(point, dict):
        raise _odd(path, where, "is not a point with a position")
    name = str(point.get("label") or "")
    status = str(point.get("positionStatus", "defined")).lower()
    if status in _NOT_PLACED:
        return PointRow(where, name, np.full(3, np.nan))
    if status not in _PLACED:
        options = ", ".join((*_PLACED, *_NOT_PLACED))
        raise CorrespondenceError(
            f"{path}, {where}: the position has the status {status!r}, which is not one of "
            f"{options}. Save the landmarks in Slicer again."
        )
    at = point.get("position")
    if not isinstance(at, list) or len(at) != 3:
        raise _odd(path, where, f"has the position {at!r}, not three numbers")
    cells = ["nan" if one is None else str(one) for one in at]
    return PointRow(where, name, position(path, where, cells))


def mrk_json_of(landmarks: Landmarks) -> str:
    """Return the text of a ``.mrk.json`` file in LPS, the system in which Slicer reads meshes."""
    said = _descriptions(landmarks)
    points = [
        {
            "id": str(i + 1),
            "label": name,
            "description": said[i],
            "position": [float(x) for x in at] if landmarks.placed[i] else [0.0, 0.0, 0.0],
            "selected": True,
            "locked": False,
            "visibility": True,
            "positionStatus": "defined" if landmarks.placed[i] else "undefined",
        }
        for i, (name, at) in enumerate(zip(landmarks.names, landmarks.points, strict=True))
    ]
    markup = {
        "type": "Fiducial",
        "coordinateSystem": "LPS",
        "labelFormat": "%N-%d",
        "controlPoints": points,
    }
    return json.dumps({"@schema": _SCHEMA, "markups": [markup]}, indent=2) + "\n"


def _descriptions(landmarks: Landmarks) -> list[str]:
    """Return the description of each landmark: its expected error, and its radius."""
    errors: list[FloatArray | None] = [landmarks.expected_error, landmarks.radius]
    share = "" if landmarks.coverage is None else f" ({landmarks.coverage:.0%})"
    words = ("expected error {:.4g}", "within {:.4g}" + share)
    return [
        "; ".join(
            word.format(values[i])
            for word, values in zip(words, errors, strict=True)
            if values is not None and np.isfinite(values[i])
        )
        for i in range(len(landmarks.names))
    ]
