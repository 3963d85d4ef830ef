"""Files of one number per line, where the line says which point the number is of."""

import re
from pathlib import Path

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.exceptions import CorrespondenceError
from skfmap.io.texts import as_number, is_missing, read_text

__all__ = ["read_column"]

# A line of its own that says that a point is missing.
_MISSING = re.compile(
    r"#?\s*(missing|unknown|absent|lost|none|null|not (placed|present|visible)|n/?a|#n/a|nan|\?+|"
    r"-+|x)?\s*",
    re.IGNORECASE,
)
_SHOWN = 40  # letters of a line that a message quotes


def read_column(path: Path) -> FloatArray:
    """Return the number on each line, NaN where the line says that there is none.

    That is an empty line, ``NA``, ``nan``, or ``# missing``; so that all others keep their place.
    Empty lines at the end count too, but for the end of the last line itself. Comments may stand at
    the top, and behind a number.
    """
    lines = read_text(path)
    if lines[-1] == "":
        lines = lines[:-1]
    values: list[float] = []
    for i, line in enumerate(lines, start=1):
        number = _number(line)
        if number is not None:
            values.append(number)
        elif not (line.lstrip().startswith("#") and not values):
            raise CorrespondenceError(f"{path}, line {i}: {_fault(line)}")
        elif i < len(lines) and not lines[i].strip():
            raise CorrespondenceError(
                f"{path}, line {i + 1} is empty, right behind a comment: is it the line of a "
                "missing point, or part of the head? Write NA for the first, or remove it."
            )
    if not np.isfinite(values).any():
        raise CorrespondenceError(f"{path} holds no number: every point of it is missing.")
    return np.array(values)


def _number(line: str) -> float | None:
    """Return the number on a line, NaN where it says that there is none; else None."""
    if _MISSING.fullmatch(line.strip()):
        return np.nan
    cell = line.split("#", maxsplit=1)[0].strip().rstrip(",;").rstrip()
    if is_missing(cell):
        return None if not cell else np.nan
    return as_number(cell)


def _fault(line: str) -> str:
    said = repr(line.strip()[:_SHOWN])
    if line.lstrip().startswith("#"):
        return (
            f"the comment {said} stands between numbers, and whether it counts as a point cannot "
            "be told. Write NA, or an empty line, for a missing point; put comments behind numbers."
        )
    return (
        f"{said} is not one whole number, without a head line. Write NA where a point is missing."
    )
