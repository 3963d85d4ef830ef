"""``report``: write a page on whether a model can be trusted."""

import argparse
from pathlib import Path

from skfmap.commands.inputs import add_by_number, read_model
from skfmap.commands.outputs import add_output, add_quiet, check_free
from skfmap.datasets import load_collection

__all__ = ["DESCRIPTION", "HELP", "add_arguments", "run"]

HELP = "write a page on whether a model can be trusted"
DESCRIPTION = (
    "Cross-validate a model on the folder that it was trained on, and write a page with the errors "
    "of matches, how well they were expected, and the worst matches."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument("model", type=Path, help="model written by train")
    parser.add_argument("folder", type=Path, help="folder that it was trained on")
    add_output(parser, "report.html", "the page")
    parser.add_argument("--pattern", default="*", help="the same as for train")
    parser.add_argument("--reference", help="the same as for train")
    add_by_number(parser)
    parser.add_argument(
        "--folds", type=int, default=5, help="number of folds of the cross-validation (default: 5)"
    )
    add_quiet(parser)


def run(options: argparse.Namespace) -> int:
    """Write the page; return the exit status."""
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
