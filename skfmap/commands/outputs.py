"""Outputs of the verbs: files named after the input, and tables."""

import argparse
import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from skfmap._tools.validation import check_length

__all__ = [
    "SUMMARY_ENDS",
    "add_output",
    "add_quiet",
    "check_free",
    "is_summary",
    "show_table",
    "targets_of",
    "write_table",
]


SUMMARY_ENDS = ("shape", "note")
"""First and last columns of the summary that the verbs write for new shapes."""


def add_output(parser: argparse.ArgumentParser, default: str, what: str) -> None:
    """Add the options for the path of the results and for overwriting."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path(default),
        help=f"{what} (default: %(default)s)",
    )
    parser.add_argument("--force", action="store_true", help="overwrite existing files")


def add_quiet(parser: argparse.ArgumentParser, what: str = "do not report progress") -> None:
    """Add the option to print less."""
    parser.add_argument("-q", "--quiet", action="store_true", help=what)


def targets_of(paths: Sequence[Path], folder: Path, suffix: str) -> dict[Path, Path]:
    """Return the output file in ``folder`` for each input, named after it.

    Raises
    ------
    ValueError
        If two inputs have the same output file, or one would be overwritten by its result.
    """
    targets = {path: folder / f"{path.stem}{suffix}" for path in paths}
    sources: dict[str, Path] = {}
    for path in paths:
        if targets[path].exists() and targets[path].samefile(path):
            raise ValueError(f"{path} would be overwritten by its result; give another -o.")
        other = sources.setdefault(str(targets[path]).casefold(), path)  # some systems ignore case
        if other is not path:
            raise ValueError(
                f"{other} and {path} would both be written to {targets[path]}; give them one after "
                "the other, each with an -o of its own."
            )
    return targets


def check_free(paths: Iterable[Path], *, force: bool) -> None:
    """Create the folders of the results, and check that no file would be overwritten.

    Raises
    ------
    FileExistsError
        If a file exists and ``force`` is False.
    ValueError
        If a folder cannot be created, or two results have the same path.
    """
    paths = list(paths)
    for path in paths:
        if paths.count(path) > 1:
            raise ValueError(f"Two results would be written to {path}; rename one.")
        check_length(path)
        if path.is_dir():
            raise ValueError(f"{path} is a folder, and a file is to be written; give another name.")
    there = [path for path in paths if path.exists()]
    if there and not force:
        more = f" and {len(there) - 1} more are" if len(there) > 1 else " is"
        raise FileExistsError(
            f"{there[0]}{more} there already; give --force to overwrite, or write elsewhere."
        )
    for folder in {path.parent for path in paths}:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ValueError(f"-o {folder} cannot hold the results: {error.strerror}.") from error


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table as CSV in UTF-8; unknown values (None, NaN) are blank."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows([_cell(value, 8) for value in row] for row in rows)


def is_summary(path: Path) -> bool:
    """Return whether a file is the summary of an earlier run of any verb."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            head = next(csv.reader(file), [])
    except (OSError, ValueError):
        return False
    return len(head) > 2 and (head[0], head[-1]) == SUMMARY_ENDS


def show_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as text, with its first column flush left and the others flush right."""
    cells = [[str(name) for name in header], *([_cell(value, 3) for value in row] for row in rows)]
    widths = [max(len(row[j]) for row in cells) for j in range(len(header))]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if j else cell.ljust(width)
            for j, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    )


def _cell(value: object, n_digits: int) -> str:
    if value is None:
        return ""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        return "" if np.isnan(value) else f"{value:.{n_digits}g}"
    return str(value)
