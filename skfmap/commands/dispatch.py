"""Select the verb, run it, and report errors in one line."""

import argparse
import difflib
import io
import re
import sys
import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from skfmap._tools.parallel import single_threaded
from skfmap._version import __version__
from skfmap.commands import (
    check,
    convert,
    demo,
    landmarks,
    match,
    register,
    report,
    train,
    transfer,
)

__all__ = ["main", "parser_of", "split_verb"]


_WIDTH = 79
# Warnings name a shape by index and name; the index means nothing on the command line.
_INDEX = re.compile(r"X\[\d+\] \(('[^']*')\)")


class Verb(Protocol):
    """Interface of the modules of the verbs."""

    HELP: str
    DESCRIPTION: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the options of the verb."""

    def run(self, options: argparse.Namespace) -> int:
        """Run the verb; return the exit status."""


VERBS: dict[str, Verb] = {
    "train": train,
    "match": match,
    "landmarks": landmarks,
    "register": register,
    "transfer": transfer,
    "check": check,
    "report": report,
    "convert": convert,
    "demo": demo,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a verb of the command line, or the demonstration if no verb is given.

    Parameters
    ----------
    arguments : sequence of str, optional
        Arguments after ``python -m skfmap``; by default those of the current process.

    Returns
    -------
    int
        Exit status: 0 on success, 1 if a shape could not be used, 2 on an error, 130 if the work
        was interrupted.

    Examples
    --------
    >>> from skfmap.commands import main
    >>> main(["match", "nowhere.skops", "scan.ply"])
    2
    """
    verb, rest = split_verb(sys.argv[1:] if arguments is None else arguments)
    with _escaped_output(), _plain_warnings():
        if verb == "demo" and rest and _is_no_folder(rest[0]):
            print(f"skfmap: {_no_verb(rest[0])}", file=sys.stderr)
            return 2
        try:
            options = parser_of(verb).parse_args(rest)
        except SystemExit as stopped:  # --help, --version, or an option that argparse rejects
            return int(stopped.code or 0)
        try:
            # Cores work on different shapes; threads within small products would only compete.
            return single_threaded(VERBS[verb].run, options)
        except (ValueError, TypeError, OSError, ImportError) as error:
            print(f"skfmap: {' '.join(str(error).split())}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            print(
                "skfmap: interrupted; files that were written are kept, and so are results in "
                "the folder given by --cache or --memory.",
                file=sys.stderr,
            )
            return 130


def split_verb(arguments: Sequence[str]) -> tuple[str, list[str]]:
    """Return the verb and its arguments; without a verb it is the demonstration."""
    if arguments and arguments[0] in VERBS:
        return arguments[0], list(arguments[1:])
    return "demo", list(arguments)


def parser_of(verb: str) -> argparse.ArgumentParser:
    """Return the argument parser of a verb."""
    program = "skfmap" if Path(sys.argv[0]).stem == "skfmap" else "python -m skfmap"
    chosen = VERBS[verb]
    parser = argparse.ArgumentParser(
        prog=program if verb == "demo" else f"{program} {verb}",
        description=textwrap.fill(chosen.DESCRIPTION, _WIDTH),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=_verbs(program) if verb == "demo" else None,
    )
    chosen.add_arguments(parser)
    parser.add_argument("--version", action="version", version=f"skfmap {__version__}")
    parser.set_defaults(program=program)
    return parser


def _is_no_folder(word: str) -> bool:
    """Return whether a word is neither an option nor an existing file or folder."""
    return not word.startswith("-") and not Path(word).exists()


def _no_verb(word: str) -> str:
    nearest = difflib.get_close_matches(word.lower(), VERBS, n=1)
    meant = f" Did you mean {nearest[0]}?" if nearest else ""
    return f"There is no folder {word}, and no verb of that name.{meant} Verbs: {', '.join(VERBS)}."


def _verbs(program: str) -> str:
    lines = [f"  {verb:<11}{module.HELP}" for verb, module in VERBS.items()]
    return "\n".join(
        [
            "Verbs, each with its own --help (write ./match for a folder with the name of a verb):",
            *lines,
            f"Example: {program} train FOLDER -o model.skops",
        ]
    )


@contextmanager
def _escaped_output() -> Iterator[None]:
    """Escape characters that the encoding of the terminal lacks, such as names in other scripts."""
    streams = [one for one in (sys.stdout, sys.stderr) if isinstance(one, io.TextIOWrapper)]
    before = [one.errors for one in streams]
    for one in streams:
        one.reconfigure(errors="backslashreplace")
    try:
        yield
    finally:
        for one, errors in zip(streams, before, strict=True):
            one.reconfigure(errors=errors)


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Print warnings without their line of code."""
    usual, warnings.formatwarning = warnings.formatwarning, _format_warning
    try:
        yield
    finally:
        warnings.formatwarning = usual


def _format_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,  # noqa: ARG001
    lineno: int,  # noqa: ARG001
    line: str | None = None,  # noqa: ARG001
) -> str:
    text = _INDEX.sub(r"\1", str(message))
    return f"{category.__name__}: {text}\n"
