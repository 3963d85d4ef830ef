"""Landmarks that were placed by hand, in files of 3D Slicer."""

import json
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import is_finite
from skfmap.exceptions import CorrespondenceError
from skfmap.shapes import Mesh

__all__ = ["nearest_vertices", "read_mrk_json"]

# Share of the mesh's extent that the middle one of its landmarks may be away from it; those of
# mouse skulls are at 0.002.
_AWAY = 0.05
# From this share on, landmarks do not lie on the mesh if turned ones are so many times nearer.
_BESIDE, _NEARER = 0.01, 5.0


def read_mrk_json(path: Path) -> dict[str, FloatArray]:
    """Return the position of each landmark of a ``.mrk.json`` file by its label.

    In the coordinates of the file; landmarks that were not placed are left out.
    """
    try:
        (markup,) = json.loads(path.read_text(encoding="utf-8"))["markups"]
        points = [
            (str(point.get("label") or i), point["position"])
            for i, point in enumerate(markup["controlPoints"], start=1)
            if point.get("positionStatus", "defined") == "defined"
        ]
        positions = np.array([position for _, position in points], dtype=np.float64).reshape(-1, 3)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise CorrespondenceError(
            f"{path} cannot be read as one list of points of 3D Slicer: {type(error).__name__}: "
            f"{error}."
        ) from error
    labels = [name for name, _ in points]
    if twice := sorted({name for name in labels if labels.count(name) > 1}):
        raise CorrespondenceError(f"{path} has several points of one name: {', '.join(twice)}.")
    known = is_finite(positions)
    return {name: at for name, at, yes in zip(labels, positions, known, strict=True) if yes}


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
