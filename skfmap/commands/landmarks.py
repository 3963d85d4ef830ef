"""``landmarks``: the named points of the training specimens on new specimens."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import skfmap
from skfmap.commands.new_shapes import Result, Work, add_common, run_on_new_shapes
from skfmap.io import write_landmarks
from skfmap.landmarks import write_table
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

    predict: Any = skfmap.predict_landmarks
    work = Work(
        f".{options.format}",
        ("landmarks", "expected error", "largest", "at", "radius"),
        predict,
        write,
        "Errors are in the units of the meshes, as means over landmarks; the largest is that of "
        "the landmark named.",
        lambda: write_table(placed, together, overwrite=True),
    )
    return run_on_new_shapes(options, lambda _: work, work.suffix, also=[together])


def _result(found: Landmarks) -> Result:
    mean, largest, at = _errors(found.expected_error, found.names)
    radius = None if found.radius is None else float(np.nanmean(found.radius))
    n_placed = f"{int(found.placed.sum())} of {len(found.names)}"
    return Result((n_placed, mean, largest, at, radius), (mean or 0.0, largest or 0.0))


def _errors(expected: Any, names: tuple[str, ...]) -> tuple[float | None, float | None, str | None]:
    """Return mean and largest error to expect, and of which landmark the largest is."""
    if expected is None or np.isnan(expected).all():
        return None, None, None
    worst = int(np.nanargmax(expected))
    return float(np.nanmean(expected)), float(expected[worst]), names[worst]
