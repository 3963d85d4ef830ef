"""``convert``: write a mesh, or landmarks, in another format."""

import argparse
from pathlib import Path

from skfmap.commands.outputs import add_quiet, check_free
from skfmap.io import (
    LANDMARK_SUFFIXES,
    READ_SUFFIXES,
    WRITTEN_LANDMARK_SUFFIXES,
    WRITTEN_SUFFIXES,
    read_landmarks,
    read_mesh,
    write_landmarks,
    write_mesh,
)

__all__ = ["DESCRIPTION", "HELP", "add_arguments", "run"]

HELP = "write a mesh, or landmarks, in another format"
DESCRIPTION = (
    "Convert a mesh, or a file of landmarks, to another format, which the suffix of OUT selects. "
    "Vertices keep their order, except in STL files, which renumber them. Meshes are read from "
    f"{', '.join(READ_SUFFIXES)}, and written as {', '.join(WRITTEN_SUFFIXES)}; landmarks are read "
    f"from {', '.join(LANDMARK_SUFFIXES)}, and written as {', '.join(WRITTEN_LANDMARK_SUFFIXES)}."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    parser.add_argument("source", type=Path, metavar="IN", help="file to read")
    parser.add_argument("output", type=Path, metavar="OUT", help="file to write")
    parser.add_argument(
        "--system",
        choices=["LPS", "RAS"],
        help="coordinate system to convert landmarks to (default: as stored)",
    )
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")
    add_quiet(parser, "do not report what was written")


def run(options: argparse.Namespace) -> int:
    """Convert the file; return the exit status."""
    check_free([options.output], force=options.force)
    if options.source.name.lower().endswith(LANDMARK_SUFFIXES):
        marks = read_landmarks(options.source, system=options.system)
        write_landmarks(marks, options.output, overwrite=True)  # already checked
        _say(options, f"{len(marks.names)} landmarks: {options.output}")
        return 0
    if options.system is not None:
        raise ValueError("--system is for landmarks; a mesh names no system of coordinates.")
    if options.source.is_dir():
        raise ValueError(f"{options.source} is a folder; convert its files one by one.")
    mesh = read_mesh(options.source)
    write_mesh(mesh, options.output)
    _say(options, f"{mesh.n_vertices} vertices and {mesh.n_faces} faces: {options.output}")
    if ".stl" in {path.suffix.lower() for path in (options.source, options.output)}:
        print("STL holds no vertices, only corners of triangles: they are numbered anew.")
    return 0


def _say(options: argparse.Namespace, told: str) -> None:
    if not options.quiet:
        print(told)
