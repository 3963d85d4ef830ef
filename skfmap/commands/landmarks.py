"""``landmarks``: predict the landmarks of the training specimens on new specimens."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import check_number
from skfmap.commands.new_shapes import Result, Work, add_common, run_on_new_shapes
from skfmap.io import write_landmarks
from skfmap.landmarks import write_table
from skfmap.learner import predict_landmarks
from skfmap.shapes import Landmarks

__all__ = ["DESCRIPTION", "FORMATS", "HELP", "add_arguments", "run"]

HELP = "predict landmarks on new specimens"
DESCRIPTION = (
    "Predict landmarks on new specimens, with a model that was trained on landmarks. For each "
    "specimen NAME, the file NAME.fcsv (or another format) contains the points in the units and "
    "coordinates of its mesh."
)
_UNLIKE = (
    "unlike the training specimens, so that its landmarks may be anywhere; look at them. A mirror "
    "image, where train had no --mirrored reflect, a part, or another kind?"
)
FORMATS = ("fcsv", "mrk.json", "pp", "tps", "pts", "csv")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_common(parser, "landmarks", "folder for the results")
    parser.add_argument(
        "--format",
        choices=FORMATS,
        default="fcsv",
        help="format of the files: 3D Slicer (fcsv, the default, and mrk.json), MeshLab (pp), tps, "
        "Landmark Editor (pts), or a table (csv)",
    )
    parser.add_argument(
        "--on-surface",
        action="store_true",
        help="project all points onto the surface, even those that observers place off it",
    )
    parser.add_argument(
        "--coverage",
        type=float,
        default=0.9,
        help="fraction of an observer's points that radii should contain (default: %(default)s, "
        "which needs nine training specimens besides the reference)",
    )


def run(options: argparse.Namespace) -> int:
    """Predict landmarks; return the exit status."""
    if check_number(options.coverage, "--coverage", low=0, strict=True) >= 1:
        raise ValueError(f"--coverage must be below 1, for instance 0.9; got {options.coverage}.")
    suffix = f".{options.format}"
    together, placed = options.output / "landmarks.csv", list[Landmarks]()

    def write(found: Landmarks, path: Path) -> Result:
        if not found.placed.any():
            raise ValueError("no landmark could be placed; look at the mesh, and match it.")
        write_landmarks(found, path, overwrite=True)  # already checked
        placed.append(found)
        return _result(found)

    def work(learner: Any) -> Work:
        if getattr(learner, "landmarks_", None) is None:
            raise ValueError(
                f"{options.model} was trained without landmarks; train it on a folder that has a "
                "file of landmarks beside each mesh."
            )
        return Work(
            suffix,
            ("landmarks", "expected error", "largest", "at", "radius"),
            lambda learner, shapes: predict_landmarks(
                learner, shapes, coverage=options.coverage, on_surface=options.on_surface
            ),
            write,
            "Errors are in the units of the meshes, as means over landmarks; the largest is that "
            "of the landmark named. They are blank where a shape is unlike the training specimens. "
            f"The radius is of the ball that holds {options.coverage:.0%} of an observer's points; "
            "it is blank where there are too few training specimens to tell.",
            lambda: write_table(placed, together, overwrite=True),
        )

    return run_on_new_shapes(options, work, suffix, also=[together])


def _result(found: Landmarks) -> Result:
    n_placed = f"{int(found.placed.sum())} of {len(found.names)}"
    mean, radius = (_mean(one) for one in (found.expected_error, found.radius))
    if found.expected_error is None or mean is None:
        told = "" if found.expected_error is None else _UNLIKE
        return Result((n_placed, None, None, None, radius), (np.inf,), told)
    worst = int(np.nanargmax(found.expected_error))
    largest = float(found.expected_error[worst])
    return Result((n_placed, mean, largest, found.names[worst], radius), (mean,))


def _mean(values: FloatArray | None) -> float | None:
    """Return the mean of the known values; None if there are none."""
    if values is None or np.isnan(values).all():
        return None
    return float(np.nanmean(values))
