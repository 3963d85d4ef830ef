"""``register``: lay the mesh of the reference onto new shapes."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from skfmap.commands.new_shapes import Result, Work, add_common, run_on_new_shapes
from skfmap.io import WRITTEN_SUFFIXES, write_mesh
from skfmap.registration import Registration
from skfmap.shapes import Registered

__all__ = ["DESCRIPTION", "HELP", "add_arguments", "run"]

HELP = "lay the mesh of the reference onto new shapes"
DESCRIPTION = (
    "Lay the mesh of the reference onto new shapes. For each shape NAME, the file NAME.ply "
    "contains the faces of the reference with its vertices moved onto the shape, in the units and "
    "coordinates of the shape. The model must have been trained with --refine register."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_common(parser, "registered", "folder for the results")
    parser.add_argument(
        "--format",
        choices=[suffix.removeprefix(".") for suffix in WRITTEN_SUFFIXES if suffix != ".stl"],
        default="ply",
        help="format of the meshes (default: ply; off, obj, vtk and vtp keep all digits)",
    )


def run(options: argparse.Namespace) -> int:
    """Register new shapes; return the exit status."""
    suffix = f".{options.format}"

    def work(learner: Any) -> Work:
        if not isinstance(getattr(learner, "refine_", None), Registration):
            raise ValueError(
                f"{options.model} was trained without registration; train it again with "
                "--refine register."
            )
        return Work(
            suffix,
            ("fits", "off", "uncovered", "stretched", "folded", "distance"),
            lambda learner, shapes: learner.register(shapes),
            _write,
            "off, uncovered and stretched are shares of area; folded counts faces; distance is the "
            "median from the surface, in the units of the mesh.",
        )

    return run_on_new_shapes(options, work, suffix)


def _write(laid: Registered, path: Path) -> Result:
    write_mesh(laid.mesh, path)
    distance = float(np.median(laid.distance))
    cells = (laid.fits, laid.off, laid.uncovered, laid.stretched, laid.n_flipped, distance)
    return Result(cells, (float(not laid.fits), laid.off + laid.uncovered + laid.stretched))
