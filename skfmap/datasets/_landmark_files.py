"""Landmark files next to the meshes of a collection."""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skfmap.exceptions import CorrespondenceError
from skfmap.geometry.closest import nearest_places
from skfmap.io.landmarks import LANDMARK_SUFFIXES, open_landmarks
from skfmap.io.tables import is_table_of_points
from skfmap.io.texts import MARKS, moved
from skfmap.shapes import Correspondence, Landmarks, Mesh

__all__ = ["OnMesh", "landmark_files", "landmarks_on", "only_one", "unread_landmarks"]

# Landmarks of other programs, and what may be landmarks where its name says so.
_OTHERS = ("dta", "landmarkascii", "lmk", "mps", "nts", "ods", "xls", "xlsx")
_WHERE_CALLED_SO = ("json", "mat", "rds", "xml")
_MOST = 8  # names that a message lists


def landmark_files(paths: list[Path]) -> list[list[Path]]:
    """Return the landmark files of each mesh, found by name.

    A file whose name matches two meshes belongs to the one with the longer name: ``cat_points.csv``
    belongs to ``cat_points`` rather than ``cat``. Letter case is ignored if no file matches
    exactly.
    """
    stems = [path.stem for path in paths]
    suffixes = "|".join(re.escape(suffix) for suffix in LANDMARK_SUFFIXES)
    fits = {
        stem: re.compile(f"{re.escape(stem)}(?:{MARKS})?(?:{suffixes})", re.IGNORECASE)
        for stem in stems
    }
    found: dict[str, list[Path]] = {stem: [] for stem in stems}
    for file in sorted(paths[0].parent.iterdir()):
        owners = [stem for stem in stems if fits[stem].fullmatch(file.name)]
        if owners and file.is_file() and _may_hold_points(file, owners):
            best = max(owners, key=lambda stem: (len(stem), file.name.startswith(stem)))
            found[best].append(file)
    return [_exact(found[stem], stem) for stem in stems]


def unread_landmarks(paths: list[Path]) -> str:
    """Name the files beside meshes that seem to hold landmarks, and are not read; empty if none."""
    if not paths:
        return ""
    stems = "|".join(re.escape(path.stem) for path in paths)
    called = rf"(?:{stems})(?:(?:{MARKS})?\.(?:{'|'.join(_OTHERS)})"
    called += rf"|(?:{MARKS})\.(?:{'|'.join(_WHERE_CALLED_SO)}))"
    fits = re.compile(called, re.IGNORECASE)
    folder = paths[0].parent
    found = sorted(file.name for file in folder.iterdir() if fits.fullmatch(file.name))
    if not found:
        return ""
    more = f" and {len(found) - _MOST} more" if len(found) > _MOST else ""
    return (
        f"{folder}: {', '.join(found[:_MOST])}{more} are not read. If they hold landmarks, save "
        f"them as one of {', '.join(LANDMARK_SUFFIXES)}; a spreadsheet as .csv, with columns name, "
        "x, y, z."
    )


def _may_hold_points(file: Path, owners: list[str]) -> bool:
    """Return False for a file NAME.txt with two columns, vertex and template point."""
    is_plain = file.suffix.lower() == ".txt" and file.stem.lower() in map(str.lower, owners)
    return not is_plain or is_table_of_points(file)


def _exact(files: list[Path], stem: str) -> list[Path]:
    exact = [file for file in files if file.name.startswith(stem)]
    return exact or files


def only_one(files: list[Path], mesh: Path) -> Path:
    """Return the landmark file of a mesh; raise an error if there are several."""
    if len(files) > 1:
        raise CorrespondenceError(
            f"{mesh} has {len(files)} landmark files beside it: "
            f"{', '.join(file.name for file in files)}. Keep only one of them."
        )
    return files[0]


class OnMesh(NamedTuple):
    """Landmarks of a file in the coordinates of their mesh, and their places on it.

    ``turned`` is a message if x and y were negated, and ``note`` describes conversions that the
    file asks for; both are empty otherwise.
    """

    landmarks: Landmarks
    truth: Correspondence
    turned: str
    note: str


def landmarks_on(path: Path, mesh: Mesh) -> OnMesh:
    """Project the landmarks of a file onto their mesh; raise an error if they do not lie on it.

    The coordinate systems LPS and RAS of 3D Slicer differ in the signs of x and y. If landmarks lie
    on the mesh only with these negated, they are negated.
    """
    read = open_landmarks(path)
    landmarks = moved(read.landmarks, read.landmarks.points, mesh.name)
    if not landmarks.placed.any():
        raise CorrespondenceError(
            f"{path} holds no landmark that was placed. Place landmarks, or leave out "
            f"{mesh.name!r}."
        )
    try:
        return OnMesh(landmarks, Correspondence.from_points(landmarks, mesh), "", read.done)
    except CorrespondenceError as error:
        turned = moved(landmarks, landmarks.points * [-1, -1, 1], mesh.name)
        truth = _if_nearer(turned, landmarks, mesh)
        if truth is None:
            raise CorrespondenceError(f"{path}: {error}") from None
    said = f"; the file says {read.system}" if read.system else ""
    told = f"x and y of the landmarks in {path.name} were negated (RAS against LPS?{said})"
    return OnMesh(turned, truth, told, read.done)


def _if_nearer(turned: Landmarks, written: Landmarks, mesh: Mesh) -> Correspondence | None:
    """Return the places of turned landmarks if they lie on the mesh and are nearer; else None."""
    try:
        truth = Correspondence.from_points(turned, mesh)
    except CorrespondenceError:
        return None
    placed = written.points[written.placed]
    away = nearest_places(placed, mesh.vertices, mesh.faces).distances
    nearer = truth.distance is not None and np.median(truth.distance) < np.median(away)
    return truth if nearer else None
