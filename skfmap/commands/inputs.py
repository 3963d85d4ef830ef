"""Inputs of the verbs: models, and meshes given as files or folders."""

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import joblib

from skfmap._tools.unwrap import last_step
from skfmap._tools.warn import warn
from skfmap.exceptions import SkippedShapeWarning
from skfmap.io import READ_SUFFIXES, unread_formats
from skfmap.partial.matcher import PartialMatcher
from skfmap.persistence import load_model, save_model
from skfmap.shapes import SkippedShape

__all__ = [
    "PICKLED",
    "add_by_number",
    "add_new_shapes",
    "check_model_path",
    "check_two_usable",
    "mesh_files",
    "read_model",
    "write_model",
]

PICKLED = (".joblib", ".pkl", ".pickle")
"""Suffixes of model files in joblib's format; all others are in the format of skops."""


def add_new_shapes(parser: argparse.ArgumentParser) -> None:
    """Add the arguments for a model and new meshes."""
    parser.add_argument(
        "model",
        type=Path,
        help="model written by train; a .joblib or .pkl file can run any code, so open only those "
        "from people you trust",
    )
    parser.add_argument(
        "meshes", nargs="+", type=Path, metavar="NEW", help="meshes, or folders of meshes"
    )


def add_by_number(parser: argparse.ArgumentParser) -> None:
    """Add the option for meshes whose vertices correspond by number."""
    parser.add_argument(
        "--by-number",
        action="store_true",
        help="vertices correspond by number; ignore all files beside the meshes",
    )


def mesh_files(given: Sequence[Path]) -> list[Path]:
    """Return the given mesh files, and the mesh files in the given folders.

    Raises
    ------
    FileNotFoundError
        If a file does not exist, or a folder contains no mesh.
    ValueError
        If a file is not in a supported format.
    """
    return [path for one in given for path in (_in_folder(one) if one.is_dir() else [_file(one)])]


def read_model(path: Path) -> Any:
    """Return the model in a file; it must contain the steps that read meshes."""
    if not path.is_file():
        raise FileNotFoundError(f"There is no model file {path}; train makes one.")
    if path.suffix.lower() in READ_SUFFIXES:
        raise ValueError(f"{path} is a mesh, and the model comes first, as MODEL {path}.")
    model = _unpickled(path) if path.suffix.lower() in PICKLED else load_model(path)
    if isinstance(model, PartialMatcher):
        raise ValueError(
            f"{path} holds a PartialMatcher, which the commands do not take; call skfmap.match in "
            "Python, or save its estimator_ to match whole shapes here."
        )
    try:
        learner = last_step(model)
    except TypeError as error:
        raise ValueError(f"{path} holds no model of skfmap, but a {type(model).__name__}.") from (
            error
        )
    if learner is model:
        raise ValueError(
            f"{path} holds a learner without the steps that read meshes; save the pipeline that it "
            "is in."
        )
    return model


def check_model_path(path: Path) -> None:
    """Raise an error if a model cannot be written to a path."""
    if path.suffix.lower() not in PICKLED:
        try:
            import skops.io  # noqa: F401, PLC0415
        except ImportError as error:
            raise ImportError(
                f"{path} needs skops: pip install 'skfmap[skops]', or write "
                f"{path.with_suffix('.joblib')}."
            ) from error


def check_two_usable(meshes: Sequence[Any]) -> None:
    """Raise an error if only the reference can be used, so that nothing can be learned.

    Raises
    ------
    ValueError
        If there are more meshes than the reference, and none of them can be used.
    """
    others = meshes[1:]
    if others and all(isinstance(one, SkippedShape) for one in others):
        raise ValueError(
            f"only the reference, {meshes[0].name}, can be used. {others[0].name}: "
            f"{others[0].reason}"
        )


def write_model(model: Any, path: Path) -> None:
    """Write a model in the format of the suffix."""
    if path.suffix.lower() in PICKLED:
        joblib.dump(model, path)
    else:
        save_model(model, path)


def _unpickled(path: Path) -> Any:
    try:
        return joblib.load(path)
    except Exception as error:
        raise ValueError(
            f"{path} cannot be read as a model ({type(error).__name__}: {error}). Was it cut "
            "short, or written by another program?"
        ) from error


def _file(path: Path) -> Path:
    if not path.exists():
        raise FileNotFoundError(f"There is no mesh {path}.")
    if path.suffix.lower() in (".skops", *PICKLED):
        raise ValueError(
            f"{path} is a model, not a mesh. Use it as match {path} NEW.ply; report {path} FOLDER "
            "says whether it can be trusted."
        )
    if path.suffix.lower() not in READ_SUFFIXES:
        raise ValueError(
            f"{path} is not a mesh that can be read; those end in {', '.join(READ_SUFFIXES)}."
        )
    return path


def _in_folder(folder: Path) -> list[Path]:
    """Return the meshes of a folder in natural order, without hidden files."""
    files = list(folder.iterdir())
    found = [path for path in files if path.suffix.lower() in READ_SUFFIXES and path.name[0] != "."]
    other = unread_formats(folder, files, found)
    if not found:
        raise FileNotFoundError(
            f"{folder} holds no mesh with suffix {', '.join(READ_SUFFIXES)}. {other}".rstrip()
        )
    if other:
        warn(other, SkippedShapeWarning)
    return sorted(found, key=_natural)


def _natural(path: Path) -> list[tuple[int, int | str]]:
    parts = re.split(r"(\d+)", path.name)
    return [(0, int(part)) if part.isdecimal() else (1, part) for part in parts]
