"""``check``: report faults of meshes, and of a folder of meshes."""

import argparse
import warnings
from pathlib import Path

from skfmap.commands.inputs import add_by_number, check_two_usable, mesh_files
from skfmap.commands.outputs import add_quiet
from skfmap.datasets import load_collection
from skfmap.exceptions import RepairWarning, SkippedShapeWarning
from skfmap.health import check_mesh
from skfmap.shapes import SkippedShape

__all__ = ["DESCRIPTION", "HELP", "add_arguments", "run"]

HELP = "report faults of meshes, or of a folder to train on"
DESCRIPTION = (
    "Report the faults of meshes and what they mean. For a folder, also report whether it can be "
    "trained on: which correspondences were found, and which meshes would be left out."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument("meshes", nargs="+", type=Path, help="meshes, or folders of meshes")
    parser.add_argument("--pattern", default="*", help="pattern of names of meshes in a folder")
    add_by_number(parser)
    parser.add_argument(
        "--laplacian",
        choices=["cotangent", "robust"],
        default="cotangent",
        help="Laplacian that the meshes are to be used with (default: cotangent)",
    )
    add_quiet(parser, "report faults only")


def run(options: argparse.Namespace) -> int:
    """Check the meshes; return the exit status, which is 1 if something cannot be used."""
    sound = True
    for given in options.meshes:
        for path in mesh_files([given]):
            report = check_mesh(path)
            if report.faults or not options.quiet:
                print(report)
            sound &= report.usable(options.laplacian)
        if given.is_dir():
            sound &= _check_folder(given, options)
    return 0 if sound else 1


def _check_folder(folder: Path, options: argparse.Namespace) -> bool:
    """Report what training would find in a folder; return whether it would use all meshes."""
    try:
        with warnings.catch_warnings():
            for told in (RepairWarning, SkippedShapeWarning):  # reported below
                warnings.simplefilter("ignore", told)
            collection = load_collection(
                folder, options.pattern, on_invalid="skip", by_number=options.by_number
            )
        check_two_usable(collection.meshes)
    except (ValueError, OSError) as error:
        print(f"{folder} cannot be trained on: {error}")
        return False
    if not options.quiet:
        print(collection.DESCR)
    left_out = [one for one in collection.meshes if isinstance(one, SkippedShape)]
    for one in left_out:
        print(f"  {one.name} would be left out: {one.reason}")
    return not left_out
