"""``report``: a page that says whether a model can be trusted."""

import argparse
from pathlib import Path

from skfmap.commands.inputs import add_by_number, read_model
from skfmap.commands.outputs import add_output, add_quiet, check_free
from skfmap.datasets import load_collection

__all__ = ["DESCRIPTION", "HELP", "add_arguments", "run"]

HELP = "write a page that says whether a model can be trusted"
DESCRIPTION = (
    "Leave the shapes of the folder that a model was trained on out in turn, and write a page that "
    "says how far matches are off, whether that was expected, and which are the worst."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument("model", type=Path, help="what train wrote")
    parser.add_argument("folder", type=Path, help="what it was trained on")
    add_output(parser, "report.html", "the page")
    parser.add_argument("--pattern", default="*", help="as it was for train")
    parser.add_argument("--reference", help="as it was for train")
    add_by_number(parser)
    parser.add_argument(
        "--folds", type=int, default=5, help="in how many groups shapes are left out (default: 5)"
    )
    add_quiet(parser)


def run(options: argparse.Namespace) -> int:
    """Write the page, and return the exit status."""
    from skfmap.report import write_report  # noqa: PLC0415

    check_free([options.output], force=options.force)
    model = read_model(options.model)
    collection = load_collection(
        options.folder,
        options.pattern,
        options.reference,
        on_invalid="skip",
        by_number=options.by_number,
    )
    write_report(
        model,
        options.output,
        collection.meshes,
        collection.correspondences,
        cv=options.folds,
        verbose=0 if options.quiet else 1,
    )
    print(f"Report, to open in a browser: {options.output}")
    return 0
