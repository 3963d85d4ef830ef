"""``match``: where each vertex of a new shape lies on the reference."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from skfmap.commands.new_shapes import Result, Work, add_common, run_on_new_shapes
from skfmap.commands.outputs import write_table
from skfmap.shapes import Match

__all__ = ["DESCRIPTION", "HELP", "add_arguments", "doubt_of", "mean_error", "run"]

HELP = "find where each vertex of new shapes lies on the reference"
DESCRIPTION = (
    "Match new shapes to the reference of a model. Of each shape NAME, the file NAME.csv has a "
    "line for each vertex: the vertex of the reference that it lies on (counted from 0, -1 for "
    "none), the error to expect there in units of the square root of the reference's area, and "
    "the confidence between 0 and 1."
)
_HEADER = ("vertex", "reference_vertex", "expected_error", "confidence")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_common(parser, "matches", "folder for the results")


def run(options: argparse.Namespace) -> int:
    """Match, and return the exit status."""
    work = Work(
        ".csv",
        ("expected error", "misfit", "familiar", "unmatched"),
        lambda learner, shapes: learner.match(shapes),
        _write,
        "Errors are in units of sqrt(area) of the reference; a misfit above 1 is worse than any "
        "training shape's.",
    )
    return run_on_new_shapes(options, lambda _: work, work.suffix)


def doubt_of(match: Match) -> tuple[float, float, float]:
    """Return what doubtful matches are sorted by: larger is worse, and the first counts most."""
    strange = float(match.familiar is False)
    return strange, mean_error(match) or 0.0, float(np.nan_to_num(match.misfit))


def mean_error(match: Match) -> float | None:
    """Return the mean error to expect; None where it is unknown."""
    if match.expected_error is None or np.isnan(match.expected_error).all():
        return None
    return float(np.nanmean(match.expected_error))


def _write(match: Match, path: Path) -> Result:
    unknown = np.full(len(match.p2p), np.nan)
    errors = unknown if match.expected_error is None else match.expected_error
    confidence = unknown if match.confidence is None else match.confidence
    columns: list[Any] = [match.p2p.tolist(), errors.tolist(), confidence.tolist()]
    write_table(path, _HEADER, zip(range(len(match.p2p)), *columns, strict=True))
    n_unmatched = int((match.p2p < 0).sum())
    cells = (mean_error(match), match.misfit, match.familiar, n_unmatched)
    return Result(cells, doubt_of(match))
