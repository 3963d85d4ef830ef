"""``transfer``: carry values at the vertices of the reference over to new shapes."""

import argparse
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skfmap._tools.types import Array
from skfmap.commands.match import doubt_of, mean_error
from skfmap.commands.new_shapes import Result, Work, add_common, run_on_new_shapes
from skfmap.commands.outputs import write_table
from skfmap.io.texts import cells_of, read_text
from skfmap.shapes import Match

__all__ = ["DESCRIPTION", "HELP", "add_arguments", "run"]

HELP = "carry values at the vertices of the reference over to new shapes"
DESCRIPTION = (
    "Carry values at the vertices of the reference over to new shapes. Numbers with decimals are "
    "interpolated; whole numbers and words are labels, which are decided by a vote. For each shape "
    "NAME, the file NAME.csv (or .npy) has one line per vertex, which is blank or NaN if the match "
    "is not trusted there."
)


# A decimal comma, and what stands behind one.
_COMMA = re.compile(r"^\s*([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)\s*$")
_FRACTION = re.compile(r"0\d+")


class _Column(NamedTuple):
    """A column of values at the vertices of the reference, with its name."""

    name: str
    values: Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_common(parser, "transferred", "folder for the results")
    parser.add_argument(
        "--values",
        type=Path,
        required=True,
        help="file with one line per vertex of the reference: .npy, .csv (with or without a "
        "header, unknown values blank), or .txt with columns separated by blanks",
    )
    parser.add_argument(
        "--max-error",
        type=float,
        help="leave out vertices with a larger expected error, in units of sqrt(area) of the "
        "reference, for instance 0.05",
    )
    parser.add_argument(
        "--format",
        choices=["csv", "npy"],
        default="csv",
        help="format of the results (default: csv)",
    )


def run(options: argparse.Namespace) -> int:
    """Transfer values to new shapes; return the exit status."""
    if not options.values.is_file():
        raise FileNotFoundError(f"There is no file of values {options.values}.")
    suffix = f".{options.format}"

    def work(learner: Any) -> Work:
        columns = _read_columns(options.values, learner.reference_.spectral.n_given)
        if options.format == "npy" and len({one.values.dtype.kind == "U" for one in columns}) > 1:
            raise ValueError(f"{options.values} has numbers and words; use --format csv.")

        def write(match: Match, path: Path) -> Result:
            carried = [
                _Column(name, match.transfer(values, max_error=options.max_error))
                for name, values in columns
            ]
            _write_columns(carried, path)
            blank = np.mean([np.ma.getmaskarray(values) for _, values in carried])
            return Result((1.0 - float(blank), mean_error(match), match.familiar), doubt_of(match))

        return Work(
            suffix,
            ("trusted", "expected error", "familiar"),
            lambda learner, shapes: learner.match(shapes, interpolate="barycentric"),
            write,
            "trusted is the share of values that are not blank; errors are in units of sqrt(area) "
            "of the reference.",
        )

    return run_on_new_shapes(options, work, suffix)


def _read_columns(path: Path, n_vertices: int) -> list[_Column]:
    names, columns = (
        _of_array(path) if path.suffix.lower() == ".npy" else _of_text(path, n_vertices)
    )
    if len(columns[0]) != n_vertices:
        raise ValueError(
            f"{path} holds values for {len(columns[0])} vertices, but the reference has "
            f"{n_vertices}."
        )
    return [_Column(*one) for one in zip(names, columns, strict=True)]


def _of_array(path: Path) -> tuple[list[str], list[Any]]:
    try:
        data = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise ValueError(f"{path} cannot be read as an array: {error}") from error
    if data.ndim not in (1, 2) or data.size == 0:
        raise ValueError(f"{path} must hold one row for each vertex; got shape {data.shape}.")
    columns = [data] if data.ndim == 1 else list(data.T)
    return _usual_names(len(columns)), columns


def _of_text(path: Path, n_vertices: int) -> tuple[list[str], list[Any]]:
    """Return the names and columns of a table; an extra line is taken to be its header."""
    lines = read_text(path)
    rows = _rows_of_csv(lines) if path.suffix.lower() == ".csv" else [one.split() for one in lines]
    while rows and not rows[-1]:
        rows.pop()
    widths = {len(row) for row in rows}
    if len(widths) != 1:
        raise ValueError(
            f"{path} must have a line for each of the {n_vertices} vertices of the reference, all "
            "with as many columns."
        )
    head = rows.pop(0) if len(rows) == n_vertices + 1 else _usual_names(widths.pop())
    columns = list(zip(*rows, strict=True))
    if len(columns) > 1 and any(_FRACTION.fullmatch(cell) for cell in columns[1]):
        raise ValueError(
            f"{path} has numbers that begin with 0 in its second column, as where a decimal comma "
            "parts them. Write decimal points, or semicolons between columns."
        )
    return head, [_typed(np.array(column, dtype=str)) for column in columns]


def _rows_of_csv(lines: list[str]) -> list[list[str]]:
    """Return the cells of a table; commas of numbers are made points where they part no cells.

    Spreadsheets write such tables in countries where commas stand before decimals.
    """
    full = [line for line in lines if line.strip()]
    between = next((one for one in ";\t" if all(one in line for line in full)), ",")
    if between == "," and "," not in full[0] and all(_is_one_cell(line) for line in full[1:]):
        between = ";"  # a single column under its head
    rows = [cells_of(line, between) for line in lines]
    if between == ",":
        return rows
    return [[_COMMA.sub(r"\1.\2", cell) for cell in row] for row in rows]


def _is_one_cell(line: str) -> bool:
    return "," not in line or _COMMA.fullmatch(line) is not None


def _usual_names(n_columns: int) -> list[str]:
    return ["value"] if n_columns == 1 else [f"value{j}" for j in range(n_columns)]


def _typed(text: Array) -> Any:
    """Return a column as integers, floats or strings, with unknown entries masked."""
    unknown = np.char.strip(text) == ""
    for kind in (np.int64, np.float64):
        try:
            values = np.where(unknown, "0", text).astype(kind)
        except ValueError:
            continue
        return np.ma.MaskedArray(np.nan_to_num(values), unknown | np.isnan(values))
    return np.ma.MaskedArray(text, unknown)


def _write_columns(columns: list[_Column], path: Path) -> None:
    if path.suffix == ".npy":
        filled = [_filled(values) for _, values in columns]
        np.save(path, filled[0] if len(filled) == 1 else np.stack(filled, axis=1))
        return
    lists = [values.tolist() for _, values in columns]  # None where masked
    header = ("vertex", *(name for name, _ in columns))
    write_table(path, header, zip(range(len(lists[0])), *lists, strict=True))


def _filled(values: Any) -> Any:
    """Return masked numbers as NaN, or masked strings as empty ones."""
    if values.dtype.kind in "biuf":
        return values.astype(np.float64).filled(np.nan)
    return values.filled("")
