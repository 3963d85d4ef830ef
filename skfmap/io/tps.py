"""Three-dimensional landmark files of Rohlf's tps programs."""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from skfmap.exceptions import CorrespondenceError
from skfmap.io.texts import (
    PointRow,
    ReadLandmarks,
    as_count,
    as_number,
    as_read,
    position,
    read_text,
    text_of,
)
from skfmap.shapes import Landmarks

__all__ = ["read_tps", "tps_of"]

_KEYWORD = re.compile(r"\s*([A-Za-z]\w*)\s*=(.*)")


@dataclass
class _Specimen:
    """The contents between one LM3= and the next."""

    where: str
    n_said: int
    rows: list[PointRow] = field(default_factory=list)
    words: dict[str, str] = field(default_factory=dict)
    has_curves: bool = False

    @property
    def name(self) -> str:
        image = self.words.get("IMAGE", "")
        return self.words.get("ID") or re.sub(r"\.[^.]*$", "", image)


def read_tps(path: Path, specimen: str | int | None = None) -> ReadLandmarks:
    """Read one specimen of a tps file, with its coordinates multiplied by its SCALE."""
    one = _chosen(path, _specimens(path), specimen)
    scale = _scale(path, one)
    with np.errstate(over="ignore"):
        rows = [row._replace(at=row.at * scale) for row in one.rows]
    if over := [row.where for row in rows if np.isinf(row.at).any()]:
        raise CorrespondenceError(
            f"{path}, {over[0]}: the coordinates overflow when multiplied by SCALE={scale:g}. "
            "Correct the scale."
        )
    done = [
        *([] if scale == 1 else [f"coordinates were multiplied by SCALE={scale:g}"]),
        *(["points on curves were left out"] if one.has_curves else []),
    ]
    return as_read(path, rows, None, ", ".join(done), one.name)


def _specimens(path: Path) -> list[_Specimen]:
    found: list[_Specimen] = []
    in_curve = False  # whether semilandmarks follow, which are not landmarks
    for number, line in enumerate(read_text(path), start=1):
        where = f"line {number}"
        if match := _KEYWORD.fullmatch(line):
            word, value = match[1].upper(), match[2].strip()
            in_curve = word.startswith(("CURVES", "POINTS", "OUTLINES"))
            if word in {"LM", "LM3"}:
                found.append(_begun(path, where, word, value))
            elif found:
                found[-1].words[word] = value
        elif line.strip() and in_curve and found:
            found[-1].has_curves = True
        elif line.strip():
            if not found:
                raise CorrespondenceError(
                    f"{path}, {where}: {line.strip()[:60]!r} is before the first LM3=. Begin each "
                    "specimen with LM3= and its number of landmarks."
                )
            found[-1].rows.append(_row(path, where, line))
    for one in found:
        if len(one.rows) != one.n_said:
            raise CorrespondenceError(
                f"{path}, {one.where}: LM3={one.n_said}, but {len(one.rows)} lines of coordinates "
                "follow. The file may be truncated; export it again."
            )
    return found


def _begun(path: Path, where: str, word: str, value: str) -> _Specimen:
    if (n_said := as_count(value)) is None:
        raise CorrespondenceError(
            f"{path}, {where}: {word}={value} is not a number of landmarks. Write the number after "
            f"{word}=."
        )
    if word == "LM" and n_said:
        raise CorrespondenceError(
            f"{path}, {where}: LM= begins two-dimensional landmarks, but skfmap needs "
            "three-dimensional ones (LM3=)."
        )
    return _Specimen(where, n_said)


def _row(path: Path, where: str, line: str) -> PointRow:
    cells = line.split()
    if len(cells) != 3:
        raise CorrespondenceError(
            f"{path}, {where}: the line has {len(cells)} cells, but needs three coordinates. For a "
            "missing landmark, write NA NA NA."
        )
    return PointRow(where, "", position(path, where, cells))


def _scale(path: Path, one: _Specimen) -> float:
    said = one.words.get("SCALE", "")
    scale = as_number(said) if said else 1.0
    if scale is None or not scale > 0:
        raise CorrespondenceError(
            f"{path}, specimen in {one.where}: SCALE={said} is not a positive number. Write the "
            "length of one unit, or leave the line out."
        )
    return scale


def _chosen(path: Path, found: list[_Specimen], specimen: str | int | None) -> _Specimen:
    if not found:
        raise CorrespondenceError(
            f"{path} has no line LM3=. Begin each specimen with LM3= and its number of landmarks."
        )
    names = [one.name for one in found]
    there = ", ".join(repr(name) if name else str(i) for i, name in enumerate(names))
    if specimen is None and len(found) > 1:
        raise CorrespondenceError(
            f"{path} contains {len(found)} specimens: {there}. Choose one with specimen=, a name "
            "or an index counted from 0, or give each specimen its own file."
        )
    if isinstance(specimen, str):
        if names.count(specimen) != 1:
            raise CorrespondenceError(
                f"{path} contains {names.count(specimen)} specimens called {specimen!r}, among "
                f"{there}. Choose one by index, counted from 0."
            )
        return found[names.index(specimen)]
    if not 0 <= (specimen or 0) < len(found):
        raise CorrespondenceError(
            f"{path} has no specimen {specimen}; there are {len(found)}, counted from 0: {there}."
        )
    return found[specimen or 0]


def tps_of(landmarks: Landmarks) -> str:
    """Return the text of a tps file, which cannot store names of landmarks."""
    lines = [
        " ".join(text_of(value) for value in at) if placed else "NA NA NA"
        for at, placed in zip(landmarks.points, landmarks.placed, strict=True)
    ]
    said = [] if landmarks.name is None else [f"ID={landmarks.name}"]
    return "\n".join([f"LM3={len(lines)}", *lines, *said, ""])
