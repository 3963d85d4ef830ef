"""Landmark files of MeshLab: ``_picked_points.pp``."""

from pathlib import Path
from typing import Any, NoReturn
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np

from skfmap.exceptions import CorrespondenceError
from skfmap.io.texts import PointRow, ReadLandmarks, as_read, position, read_text, text_of
from skfmap.shapes import Landmarks

__all__ = ["pp_of", "read_pp"]

_INACTIVE = ("0", "false")


def read_pp(path: Path) -> ReadLandmarks:
    """Read points that were picked in MeshLab; inactive points are missing."""
    rows: list[PointRow] = []
    outermost: list[str] = []
    # The text is already decoded, so its encoding declaration no longer applies.
    parser = expat.ParserCreate("utf-8")

    def start(tag: str, attributes: dict[str, str]) -> None:
        outermost.append(tag)
        if tag == "point":
            rows.append(_point(path, f"line {parser.CurrentLineNumber}", attributes))

    def refuse(*_: Any) -> NoReturn:
        # MeshLab declares no entities, and a few lines of them can fill the memory.
        raise CorrespondenceError(
            f"{path}, line {parser.CurrentLineNumber}: it declares XML entities, which files of "
            "MeshLab never do. Save the points again in MeshLab."
        )

    parser.StartElementHandler = start
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse("\n".join(read_text(path)).encode("utf-8"), True)
    except expat.ExpatError as error:
        raise CorrespondenceError(
            f"{path}, line {error.lineno}: {expat.ErrorString(error.code)}, so it is not valid "
            "XML. The file may be truncated; save the points again in MeshLab."
        ) from None
    if outermost[:1] != ["PickedPoints"]:
        raise CorrespondenceError(
            f"{path} begins with <{outermost[0]}>, but files of picked points begin with "
            "<PickedPoints>. Save the points with 'PickPoints' in MeshLab."
        )
    return as_read(path, rows)


def _point(path: Path, where: str, attributes: dict[str, str]) -> PointRow:
    name = attributes.get("name", "")
    if attributes.get("active", "1").strip().lower() in _INACTIVE:
        return PointRow(where, name, np.full(3, np.nan))
    return PointRow(where, name, position(path, where, [attributes.get(one, "") for one in "xyz"]))


def pp_of(landmarks: Landmarks) -> str:
    """Return the text of a ``.pp`` file."""
    lines = ["<!DOCTYPE PickedPoints>", "<PickedPoints>"]
    for name, at, placed in zip(landmarks.names, landmarks.points, landmarks.placed, strict=True):
        x, y, z = (text_of(value) if placed else "0" for value in at)
        lines.append(
            f' <point x="{x}" y="{y}" z="{z}" active="{int(placed)}" name={quoteattr(name)}/>'
        )
    return "\n".join([*lines, "</PickedPoints>", ""])
