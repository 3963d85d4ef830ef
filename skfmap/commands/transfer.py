"""``transfer``: values of the reference's vertices carried over to new shapes."""

import argparse
import csv
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skfmap._tools.types import Array
from skfmap.commands.match import doubt_of, mean_error
from skfmap.commands.new_shapes import Result, Work, add_common, run_on_new_shapes
from skfmap.commands.outputs import write_table
from skfmap.shapes import Match

__all__ = ["DESCRIPTION", "HELP", "add_arguments", "run"]

HELP = "carry values of the reference's vertices over to new shapes"
DESCRIPTION = (
    "Carry what the vertices of the reference hold over to new shapes: numbers with decimals are "
    "interpolated, whole numbers and words are labels and are voted on. Of each shape NAME, the "
    "file NAME.csv (or .npy) has a line for each vertex; blank, or NaN, where the match is not "
    "trusted."
)


class _Values(NamedTuple):
    """What the vertices of the reference hold, and what its columns are called."""

    data: Any
    names: tuple[str, ...]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_common(parser, "transferred", "folder for the results")
    parser.add_argument(
        "--values",
        type=Path,
        required=True,
        help="a line for each vertex of the reference: .npy, .csv (with a head line or without, "
        "blank where unknown), or .txt with columns between blanks",
    )
    parser.add_argument(
        "--max-error",
        type=float,
        help="leave out vertices with a larger expected error, in units of sqrt(area) of the "
        "reference (0.05, for instance)",
    )
    parser.add_argument(
        "--format", choices=["csv", "npy"], default="csv", help="of the results (default: csv)"
    )


def run(options: argparse.Namespace) -> int:
    """Transfer, and return the exit status."""
    if not options.values.is_file():
        raise FileNotFoundError(f"There is no file of values {options.values}.")
    suffix = f".{options.format}"

    def work(learner: Any) -> Work:
        values = _read_values(options.values, learner.reference_.spectral.n_given)

        def write(match: Match, path: Path) -> Result:
            carried = match.transfer(values.data, max_error=options.max_error)
            _write_values(carried, values.names, path)
            trusted = 1.0 - float(np.mean(np.ma.getmaskarray(carried)))
            return Result((trusted, mean_error(match), match.familiar), doubt_of(match))

        return Work(
            suffix,
            ("trusted", "expected error", "familiar"),
            lambda learner, shapes: learner.match(shapes, interpolate="barycentric"),
            write,
            "trusted is the share of values that are not blank; errors are in units of sqrt(area) "
            "of the reference.",
        )

    return run_on_new_shapes(options, work, suffix)


def _read_values(path: Path, n_vertices: int) -> _Values:
    if path.suffix.lower() == ".npy":
        try:
            data = np.load(path, allow_pickle=False)
        except (ValueError, EOFError) as error:
            raise ValueError(f"{path} cannot be read as an array: {error}") from error
        names = ["value"] if data.ndim == 1 else [f"value{j}" for j in range(data.shape[-1])]
    else:
        data, names = _parsed(path, n_vertices)
    if len(data) != n_vertices:
        raise ValueError(
            f"{path} holds values for {len(data)} vertices, but the reference has {n_vertices}."
        )
    return _Values(data, tuple(names))


def _parsed(path: Path, n_vertices: int) -> tuple[Any, list[str]]:
    """Return a table of text as an array, and the names in its head line."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        blanks = path.suffix.lower() != ".csv"
        rows = [line.split() for line in file] if blanks else list(csv.reader(file))
    while rows and not any(rows[-1]):
        rows.pop()
    widths = {len(row) for row in rows}
    if len(widths) != 1 or 0 in widths:
        raise ValueError(
            f"{path} must have as many columns in each line, and a line for each of the "
            f"{n_vertices} vertices of the reference."
        )
    n_columns = widths.pop()
    head = len(rows) == n_vertices + 1
    names = rows.pop(0) if head else [f"value{j}" for j in range(n_columns)]
    if n_columns == 1 and not head:
        names = ["value"]
    columns = np.array(rows, dtype=str)
    return _typed(columns[:, 0] if n_columns == 1 else columns, path), names


def _typed(text: Array, path: Path) -> Any:
    """Return whole numbers, numbers or words, as all entries that are known are; others masked."""
    unknown = np.char.strip(text) == ""
    filled = np.where(unknown, "0", text)
    for kind in (np.int64, np.float64):
        try:
            return _masked(filled.astype(kind), unknown)
        except ValueError:
            continue
    if text.ndim == 2:
        raise ValueError(f"{path} holds words in several columns; labels stand in one.")
    return _masked(text, unknown)


def _masked(values: Array, unknown: Array) -> Any:
    if values.dtype.kind == "f":
        unknown = unknown | np.isnan(values)
        values = np.where(unknown, 0.0, values)
    return np.ma.MaskedArray(values, unknown) if unknown.any() else values


def _write_values(carried: Any, names: tuple[str, ...], path: Path) -> None:
    numeric = carried.dtype.kind in "biuf"
    if path.suffix == ".npy":
        filled = carried.astype(np.float64).filled(np.nan) if numeric else carried.filled("")
        np.save(path, filled)
        return
    columns = carried if carried.ndim == 2 else carried[:, None]
    lines = ((i, *row) for i, row in enumerate(columns.tolist()))  # None where masked
    write_table(path, ("vertex", *names), lines)
