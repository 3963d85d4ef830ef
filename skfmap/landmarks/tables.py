"""Landmarks of many specimens as one array, and as tables for shape analysis."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import as_reals, check_choice, check_folder, check_samples
from skfmap.exceptions import CorrespondenceError
from skfmap.shapes import Landmarks

__all__ = [
    "as_stack",
    "centroid_sizes",
    "check_landmarks",
    "landmark_names",
    "stack_landmarks",
    "write_table",
]

# The string that R and pandas read as a missing value.
_UNKNOWN = "NA"


def landmark_names(landmarks: Sequence[Landmarks]) -> tuple[str, ...]:
    """Return the names of all landmarks, in order of first occurrence.

    Parameters
    ----------
    landmarks : sequence of Landmarks
        Landmarks of each specimen.

    Returns
    -------
    tuple of str
        The names, in the order of the columns of `stack_landmarks`.

    Examples
    --------
    >>> from skfmap import Landmarks
    >>> from skfmap.landmarks import landmark_names
    >>> landmark_names([Landmarks([[0, 0, 0]], ["a"]), Landmarks([[1, 0, 0]], ["b"])])
    ('a', 'b')
    """
    return tuple(dict.fromkeys(name for one in check_landmarks(landmarks) for name in one.names))


def stack_landmarks(
    landmarks: Sequence[Landmarks], names: Sequence[str] | None = None
) -> FloatArray:
    """Return the landmarks of specimens as one array, joined by name.

    Nothing is moved, rotated or scaled: coordinates are those of each specimen's own mesh.

    Parameters
    ----------
    landmarks : sequence of Landmarks
        Landmarks of each specimen. Names of specimens are not compared: a specimen that was
        measured twice has two rows.
    names : sequence of str, optional
        Names of the landmarks to return, in this order; by default all, see `landmark_names`.

    Returns
    -------
    ndarray of shape (n_specimens, n_landmarks, 3)
        One row per specimen, in the units of the meshes; NaN where a specimen lacks a landmark.

    Raises
    ------
    CorrespondenceError
        If no specimen has a requested landmark.

    Examples
    --------
    >>> from skfmap import Landmarks
    >>> from skfmap.landmarks import stack_landmarks
    >>> one = Landmarks([[0, 0, 0], [1, 2, 3]], ["nose", "chin"])
    >>> other = Landmarks([[1, 2, 4]], ["chin"])
    >>> stack_landmarks([one, other])[:, 1].tolist()
    [[1.0, 2.0, 3.0], [1.0, 2.0, 4.0]]
    """
    every = landmark_names(landmarks)
    wanted = every if names is None else tuple(str(name) for name in names)
    if unknown := [name for name in wanted if name not in every]:
        raise CorrespondenceError(
            f"No specimen has a landmark {', '.join(map(repr, unknown))}; there are "
            f"{', '.join(every)}."
        )
    column = {name: i for i, name in enumerate(wanted)}
    stacked = np.full((len(landmarks), len(wanted), 3), np.nan)
    for row, one in zip(stacked, landmarks, strict=True):
        for name, point in zip(one.names, one.points, strict=True):
            if name in column:
                row[column[name]] = point
    return stacked


def centroid_sizes(array: npt.ArrayLike) -> FloatArray:
    """Return the centroid size of each specimen, as defined in shape analysis.

    Parameters
    ----------
    array : array-like of shape (n_specimens, n_landmarks, 3)
        Landmarks, from `stack_landmarks`.

    Returns
    -------
    ndarray of shape (n_specimens,)
        Square root of the sum of squared distances of the landmarks from their centroid, in the
        units of the meshes. NaN if a landmark is missing, because sizes of different numbers of
        landmarks are not comparable.

    Examples
    --------
    >>> from skfmap.landmarks import centroid_sizes
    >>> centroid_sizes([[[0.0, 0, 0], [2, 0, 0]]]).round(6).tolist()
    [1.414214]
    """
    points = as_stack(array)
    centred = points - points.mean(axis=1, keepdims=True)
    return np.asarray(np.sqrt(np.square(centred).sum(axis=(1, 2))))


def write_table(
    landmarks: Sequence[Landmarks],
    path: str | Path,
    *,
    layout: str = "wide",
    overwrite: bool = False,
) -> None:
    """Write the landmarks of specimens to a table, unscaled, in the units of the meshes.

    Parameters
    ----------
    landmarks : sequence of Landmarks
        Landmarks of each specimen.
    path : str or Path
        File to write. ``.csv`` can be read by pandas and by R; missing values are ``NA``. ``.npz``
        contains the arrays ``points`` of shape (n_specimens, n_landmarks, 3), ``centroid_size``,
        ``specimens`` and ``landmarks``.
    layout : {"wide", "long"}, default="wide"
        Layout of ``.csv`` files. ``"wide"`` has a row for each specimen, with the columns
        ``specimen``, ``centroid_size``, and ``NAME_x``, ``NAME_y``, ``NAME_z`` for each landmark.
        ``"long"`` has a row for each landmark of each specimen, with the columns ``specimen``,
        ``landmark``, ``x``, ``y``, ``z``, ``expected_error`` and ``radius``; the last two have
        values for predicted landmarks only.
    overwrite : bool, default=False
        Whether an existing file is replaced.

    Raises
    ------
    FileExistsError
        If the file exists and ``overwrite`` is False.
    ValueError
        If the file has another suffix.

    Notes
    -----
    In R, with the geomorph package, whose arrays Morpho accepts too::

        table <- read.csv("landmarks.csv")
        points <- arrayspecs(table[, -(1:2)], p = (ncol(table) - 2) / 3, k = 3)

    geomstats accepts ``numpy.load("landmarks.npz")["points"]`` directly.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import mkdtemp
    >>> from skfmap import Landmarks
    >>> from skfmap.landmarks import write_table
    >>> path = Path(mkdtemp()) / "landmarks.csv"
    >>> write_table([Landmarks([[0.5, 1, 2], [0.5, 1, 4]], ["a", "b"], name="one")], path)
    >>> print(path.read_text())
    specimen,centroid_size,a_x,a_y,a_z,b_x,b_y,b_z
    one,1.4142135623730951,0.5,1.0,2.0,0.5,1.0,4.0
    <BLANKLINE>
    """
    check_choice(layout, "layout", ("wide", "long"))
    file, kept = check_folder(path), check_landmarks(landmarks)
    if file.suffix.lower() not in (".csv", ".npz"):
        raise ValueError(f"{file} must end in .csv or .npz; got {file.suffix!r}.")
    if file.exists() and not overwrite:
        raise FileExistsError(f"{file} exists; set overwrite=True to replace it.")
    if file.suffix.lower() == ".npz":
        _write_arrays(kept, file)
        return
    rows = _wide(kept) if layout == "wide" else _long(kept)
    with file.open("w", newline="", encoding="utf-8") as out:
        csv.writer(out, lineterminator="\n").writerows(rows)


def check_landmarks(landmarks: Any, what: str = "landmarks") -> list[Landmarks]:
    """Return landmarks of specimens as a list; raise if an item is not a Landmarks object."""
    given = list(check_samples(landmarks, "Landmarks", what))
    for i, one in enumerate(given):
        if not isinstance(one, Landmarks):
            raise TypeError(f"{what}[{i}] must be a skfmap.Landmarks; got {type(one).__name__}.")
    return given


def as_stack(array: npt.ArrayLike) -> FloatArray:
    """Return an array of landmarks as floats; raise if it is invalid. Missing ones are NaN."""
    points = as_reals(array, "array")
    if points.ndim != 3 or points.shape[2] != 3 or 0 in points.shape:
        raise ValueError(
            "array must have shape (n_specimens, n_landmarks, 3), as returned by stack_landmarks; "
            f"got {points.shape}."
        )
    unknown = np.isnan(points)
    if np.isinf(points).any() or (unknown.any(axis=2) != unknown.all(axis=2)).any():
        raise ValueError(
            "array has landmarks that are infinite or partly NaN; for a missing landmark, all "
            "three coordinates must be NaN."
        )
    return points


def _called(landmarks: Sequence[Landmarks]) -> list[str]:
    """Return the names of specimens; those without a name get a number, from 1."""
    return [str(i) if one.name is None else one.name for i, one in enumerate(landmarks, start=1)]


def _write_arrays(landmarks: Sequence[Landmarks], file: Path) -> None:
    points = stack_landmarks(landmarks)
    with file.open("wb") as out:
        np.savez_compressed(
            out,
            points=points,
            centroid_size=centroid_sizes(points),
            specimens=np.array(_called(landmarks)),
            landmarks=np.array(landmark_names(landmarks)),
        )


def _wide(landmarks: Sequence[Landmarks]) -> list[list[str]]:
    points, names = stack_landmarks(landmarks), landmark_names(landmarks)
    head = ["specimen", "centroid_size", *(f"{name}_{axis}" for name in names for axis in "xyz")]
    sizes = centroid_sizes(points)
    return [
        head,
        *(
            [called, *_texts([size, *at.ravel()])]
            for called, size, at in zip(_called(landmarks), sizes, points, strict=True)
        ),
    ]


def _long(landmarks: Sequence[Landmarks]) -> list[list[str]]:
    rows = [["specimen", "landmark", "x", "y", "z", "expected_error", "radius"]]
    for called, one in zip(_called(landmarks), landmarks, strict=True):
        unknown = np.full(len(one.names), np.nan)
        error = unknown if one.expected_error is None else one.expected_error
        radius = unknown if one.radius is None else one.radius
        columns = np.column_stack([one.points, error, radius])
        rows += [[called, name, *_texts(row)] for name, row in zip(one.names, columns, strict=True)]
    return rows


def _texts(values: Any) -> list[str]:
    """Return numbers as text with all digits."""
    return [_UNKNOWN if np.isnan(value) else repr(float(value)) for value in values]
