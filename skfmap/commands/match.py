"""``match``: match the vertices of new shapes to the reference."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from skfmap.commands.new_shapes import Result, Work, add_common, run_on_new_shapes
from skfmap.io import read_uv
from skfmap.shapes import Match

__all__ = ["DESCRIPTION", "HELP", "add_arguments", "doubt_of", "mean_error", "run"]

HELP = "match the vertices of new shapes to the reference"
DESCRIPTION = (
    "Match new shapes to the reference of a model. For each shape NAME, the file NAME.csv has one "
    "line per vertex: the matched vertex of the reference (counted from 0, -1 for none), the "
    "expected error in units of the square root of the reference's area, and the confidence, "
    "between 0 and 1. Other formats hold the match for other programs: npz (numpy), ply (MeshLab, "
    "CloudCompare), glb (Blender), vtp and vtk (ParaView)."
)
_FORMATS = ("csv", "npz", "ply", "glb", "vtp", "vtk")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_common(parser, "matches", "folder for the results")
    parser.add_argument(
        "--format", choices=_FORMATS, default="csv", help="format of the results (default: csv)"
    )
    parser.add_argument(
        "--texture", type=Path, help="image for glb files instead of colours; requires --uv"
    )
    parser.add_argument(
        "--uv",
        type=Path,
        help="OBJ file of the reference with texture coordinates and the same vertices",
    )


def run(options: argparse.Namespace) -> int:
    """Match new shapes; return the exit status."""
    if (options.uv is None) != (options.texture is None):
        raise ValueError("--texture and --uv belong together: an image, and where it lies.")
    if options.uv is not None and options.format != "glb":
        raise ValueError("--texture and --uv are for --format glb.")
    uv, suffix = None if options.uv is None else read_uv(options.uv), f".{options.format}"

    def write(match: Match, path: Path) -> Result:
        # Whether the file may be overwritten was already checked.
        match.save(path, uv=uv, texture=options.texture, overwrite=True)
        n_unmatched = int((match.p2p < 0).sum())
        cells = (mean_error(match), match.misfit, match.familiar, n_unmatched)
        return Result(cells, doubt_of(match))

    def work(learner: Any) -> Work:
        n_0 = learner.reference_.spectral.n_given
        if uv is not None and len(uv) != n_0:
            raise ValueError(f"{options.uv} has {len(uv)} vertices, and the reference {n_0}.")
        return Work(
            suffix,
            ("expected error", "misfit", "familiar", "unmatched"),
            lambda learner, shapes: learner.match(shapes),
            write,
            "Errors are in units of sqrt(area) of the reference; a misfit above 1 is worse than "
            "any training shape's.",
        )

    return run_on_new_shapes(options, work, suffix)


def doubt_of(match: Match) -> tuple[float, float, float]:
    """Return the key that sorts matches by doubt; larger is worse, the first entry counts most."""
    strange = float(match.familiar is False)
    return strange, mean_error(match) or 0.0, float(np.nan_to_num(match.misfit))


def mean_error(match: Match) -> float | None:
    """Return the mean expected error; None if it is unknown."""
    if match.expected_error is None or np.isnan(match.expected_error).all():
        return None
    return float(np.nanmean(match.expected_error))
