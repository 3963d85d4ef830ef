"""Landmarks that were placed by hand, in files beside the meshes."""

import re
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from skfmap._tools.types import FloatArray, IntArray
from skfmap.exceptions import CorrespondenceError
from skfmap.io.landmarks import LANDMARK_SUFFIXES, open_landmarks
from skfmap.io.tables import is_table_of_points
from skfmap.io.texts import MARKS, moved
from skfmap.shapes import Landmarks, Mesh

__all__ = ["landmark_files", "landmarks_on", "nearest_vertices", "only_one"]

# Share of the mesh's extent that the middle one of its landmarks may be away from it; those of
# mouse skulls are at 0.002.
_AWAY = 0.05
# From this share on, landmarks do not lie on the mesh if turned ones are so many times nearer.
_BESIDE, _NEARER = 0.01, 5.0


def landmark_files(paths: list[Path]) -> list[list[Path]]:
    """Return the files of landmarks beside each mesh, by their names.

    A file that fits the names of two meshes (``cat_points.csv`` those of ``cat`` and
    ``cat_points``) belongs to the longer one; letters of another case are as good where no name
    fits exactly.
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


def _may_hold_points(file: Path, owners: list[str]) -> bool:
    """Return False for NAME.txt of two columns: vertex and template point."""
    is_plain = file.suffix.lower() == ".txt" and file.stem.lower() in map(str.lower, owners)
    return not is_plain or is_table_of_points(file)


def _exact(files: list[Path], stem: str) -> list[Path]:
    exact = [file for file in files if file.name.startswith(stem)]
    return exact or files


def only_one(files: list[Path], mesh: Path) -> Path:
    """Return the file of a mesh's landmarks; raise where there are several."""
    if len(files) > 1:
        raise CorrespondenceError(
            f"{mesh} has {len(files)} files of landmarks beside it: "
            f"{', '.join(file.name for file in files)}. Keep the one that is meant."
        )
    return files[0]


def landmarks_on(path: Path, mesh: Mesh) -> tuple[Landmarks, IntArray, str, str]:
    """Return the landmarks of a file, in the system of the mesh, and the vertices nearest to them.

    Of those that were placed; and what was done that nobody asked for, and what the file asks for.
    """
    landmarks, system, note = open_landmarks(path)
    placed = landmarks.points[landmarks.placed]
    if not len(placed):
        raise CorrespondenceError(
            f"{path} holds no landmark that was placed. Place them, or leave {mesh.name!r} out."
        )
    vertices, turned = nearest_vertices(placed, mesh, path)
    points = landmarks.points * [-1, -1, 1] if turned else landmarks.points
    said = f"; the file says {system}" if system else ""
    done = f"landmarks of {path.name} were taken with {turned}{said}" if turned else ""
    return moved(landmarks, points, mesh.name), vertices, done, note


def nearest_vertices(points: FloatArray, mesh: Mesh, path: Path) -> tuple[IntArray, str]:
    """Return the vertex nearest to each landmark, and what had to be done to the coordinates.

    Slicer's two systems of coordinates, LPS and RAS, differ by the signs of x and y. Landmarks that
    lie on the mesh only with these turned are turned; those that do not lie on it at all are an
    error.
    """
    used = np.unique(mesh.faces)
    tree = KDTree(mesh.vertices[used])
    extent = float(np.ptp(mesh.vertices[used], axis=0).max())
    away, found = {}, {}
    for done, signs in (("", [1.0, 1, 1]), ("x and y negated (RAS and LPS?)", [-1.0, -1, 1])):
        distances, at = tree.query(points * signs)
        away[done], found[done] = float(np.median(distances)) / extent, used[at]
    as_they_are, turned = away
    is_turned = away[as_they_are] > max(_BESIDE, _NEARER * away[turned])
    best = turned if is_turned else as_they_are
    if away[best] > _AWAY:
        raise CorrespondenceError(
            f"The points of {path} do not lie on {mesh.name!r}: half of them are farther than "
            f"{away['']:.0%} of its extent away. Another unit of length, another system of "
            "coordinates, or another specimen's file?"
        )
    return found[best], best
