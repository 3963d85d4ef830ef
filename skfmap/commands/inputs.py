"""What the verbs read: models, and meshes by name or by folder."""

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
"""Suffixes of model files that joblib reads and writes; all others are those of skops."""


def add_new_shapes(parser: argparse.ArgumentParser) -> None:
    """Add a model and the meshes that it is asked about."""
    parser.add_argument(
        "model",
        type=Path,
        help="what train wrote; a .joblib or .pkl file runs whatever code is in it, so open those "
        "of people you trust only",
    )
    parser.add_argument(
        "meshes", nargs="+", type=Path, metavar="NEW", help="meshes, or folders of meshes"
    )


def add_by_number(parser: argparse.ArgumentParser) -> None:
    """Add the option for meshes whose vertices correspond by their number."""
    parser.add_argument(
        "--by-number",
        action="store_true",
        help="vertices correspond by their number, whatever lies beside the meshes",
    )


def mesh_files(given: Sequence[Path]) -> list[Path]:
    """Return the meshes that are named, and those in the folders that are named.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, a folder holds no mesh, or a file is of another format.
    """
    return [path for one in given for path in (_in_folder(one) if one.is_dir() else [_file(one)])]


def read_model(path: Path) -> Any:
    """Return the model that a file holds, which reads meshes itself."""
    if not path.is_file():
        raise FileNotFoundError(f"There is no model file {path}; train makes one.")
    if path.suffix.lower() in READ_SUFFIXES:
        raise ValueError(f"{path} is a mesh, and the model comes first, as MODEL {path}.")
    model = _unpickled(path) if path.suffix.lower() in PICKLED else load_model(path)
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
    """Raise if a model could not be written there."""
    if path.suffix.lower() not in PICKLED:
        try:
            import skops.io  # noqa: F401, PLC0415
        except ImportError as error:
            raise ImportError(
                f"{path} needs skops: pip install 'skfmap[skops]', or write "
                f"{path.with_suffix('.joblib')}."
            ) from error


def check_two_usable(meshes: Sequence[Any]) -> None:
    """Raise where all meshes of a folder but the reference are left out: nothing can be learned.

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
    """Write a model in the format that the suffix chooses."""
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
    """Return the meshes of a folder in natural order, without what systems leave beside them."""
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
