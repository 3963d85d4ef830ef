"""``landmarks``: the named points of the training specimens on new specimens."""

import argparse
from pathlib import Path

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.commands.new_shapes import Result, Work, add_common, run_on_new_shapes
from skfmap.io import write_landmarks
from skfmap.landmarks import write_table
from skfmap.learner import predict_landmarks
from skfmap.shapes import Landmarks

__all__ = ["DESCRIPTION", "FORMATS", "HELP", "add_arguments", "run"]

HELP = "place the training specimens' landmarks on new specimens"
DESCRIPTION = (
    "Place landmarks on new specimens, with a model that was trained on landmarks. Of each "
    "specimen NAME, the file NAME.fcsv (or another format) holds the points in the units and "
    "coordinates of its mesh."
)
FORMATS = ("fcsv", "mrk.json", "pp", "tps", "pts", "csv")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_common(parser, "landmarks", "folder for the results")
    parser.add_argument(
        "--format",
        choices=FORMATS,
        default="fcsv",
        help="of the files: 3D Slicer (fcsv, the default, and mrk.json), MeshLab (pp), tps, "
        "Landmark Editor (pts), or a table (csv)",
    )


def run(options: argparse.Namespace) -> int:
    """Place landmarks, and return the exit status."""
    together, placed = options.output / "landmarks.csv", list[Landmarks]()

    def write(found: Landmarks, path: Path) -> Result:
        if not found.placed.any():
            raise ValueError("no landmark could be placed; look at the mesh, and match it.")
        write_landmarks(found, path, overwrite=True)  # whether it may be was asked before
        placed.append(found)
        return _result(found)

    work = Work(
        f".{options.format}",
        ("landmarks", "expected error", "largest", "at", "radius"),
        predict_landmarks,
        write,
        "Errors are in the units of the meshes, as means over landmarks; the largest is that of "
        "the landmark named. They are blank where a shape is unlike the training specimens. "
        "The radius is of the ball that holds 90 % of an observer's points; it takes nine training "
        "specimens beside the reference.",
        lambda: write_table(placed, together, overwrite=True),
    )
    return run_on_new_shapes(options, lambda _: work, work.suffix, also=[together])


def _result(found: Landmarks) -> Result:
    n_placed = f"{int(found.placed.sum())} of {len(found.names)}"
    mean, radius = (_mean(one) for one in (found.expected_error, found.radius))
    if found.expected_error is None or mean is None:
        return Result((n_placed, None, None, None, radius), (np.inf,))
    worst = int(np.nanargmax(found.expected_error))
    largest = float(found.expected_error[worst])
    return Result((n_placed, mean, largest, found.names[worst], radius), (mean,))


def _mean(values: FloatArray | None) -> float | None:
    """Return the mean of what is known; None where nothing is."""
    if values is None or np.isnan(values).all():
        return None
    return float(np.nanmean(values))
