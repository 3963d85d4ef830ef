"""Files with one number per line, in which the line number identifies the point."""

import re
from pathlib import Path

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.exceptions import CorrespondenceError
from skfmap.io.texts import as_number, is_missing, read_text

__all__ = ["read_column"]

# A whole line that marks a missing point.
_MISSING = re.compile(
    r"#?\s*(missing|unknown|absent|lost|none|null|not (placed|present|visible)|n/?a|#n/a|nan|\?+|"
    r"-+|x)?\s*",
    re.IGNORECASE,
)
_SHOWN = 40  # largest number of characters of a line quoted in a message


def read_column(path: Path) -> FloatArray:
    """Return the number on each line, or NaN if the line marks a missing point.

    Missing points are marked by an empty line, ``NA``, ``nan`` or ``# missing``, so that all other
    points keep their line numbers. Empty lines at the end count as well, apart from the final line
    break. Comments are allowed at the top of the file and after a number.
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
                f"{path}, line {i + 1} is empty and follows a comment, so it is ambiguous. Write "
                "NA if it marks a missing point; otherwise remove it."
            )
    if not np.isfinite(values).any():
        raise CorrespondenceError(f"{path} holds no numbers: all its points are missing.")
    return np.array(values)


def _number(line: str) -> float | None:
    """Return the number on a line, NaN if it marks a missing point, or None if it is invalid."""
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
            f"the comment {said} is between numbers, so it is ambiguous whether it counts as a "
            "point. Write NA or leave the line empty for a missing point; put comments after "
            "numbers."
        )
    return (
        f"{said} is not a single whole number. Remove header lines, and write NA for a missing "
        "point."
    )
