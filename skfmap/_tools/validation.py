"""Checks at the package's boundary: arrays in, clean arrays or a clear error out."""

import errno
import numbers
import os
from collections.abc import Collection, Iterator, Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.exceptions import CorrespondenceError, MeshError

__all__ = [
    "LARGEST_AREA",
    "LARGEST_COORDINATE",
    "SMALLEST_AREA",
    "as_array",
    "as_reals",
    "check_choice",
    "check_faces",
    "check_folder",
    "check_index_range",
    "check_length",
    "check_number",
    "check_pairs",
    "check_sample_weight",
    "check_samples",
    "check_vertices",
    "is_finite",
    "label",
    "read_only",
]

# Floats end near 1e-308 and 1e308: areas beyond these lose digits or overflow where they are
# squared, and coordinates beyond the last make such areas.
SMALLEST_AREA, LARGEST_AREA = 1e-150, 1e150
LARGEST_COORDINATE = 1e75
_SHOWN = 40  # letters of a long name that a message quotes


def label(name: str | None, fallback: str = "mesh") -> str:
    """Return how an error message refers to a shape."""
    return fallback if name is None else f"{fallback} {name!r}"


def read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return a view of ``array`` that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view


def as_array(values: object, who: str, error: type[Exception] = ValueError) -> npt.NDArray[Any]:
    """Return ``values`` as an array; raise for rows of unequal length and for masked arrays."""
    if np.ma.isMaskedArray(values):
        raise error(
            f"{who} must not be masked; leave out what is unknown, or fill it: {who}.filled(...)."
        )
    try:
        return np.asarray(values)
    except (TypeError, ValueError) as failure:
        raise error(f"{who} must be an array: {failure}.") from None


def as_reals(values: object, who: str, error: type[Exception] = ValueError) -> FloatArray:
    """Return a copy of ``values`` as floats; raise unless they are real numbers."""
    given = as_array(values, who, error)
    try:
        if given.dtype.kind not in "iufO":
            raise TypeError(f"got dtype {given.dtype}")
        if given.dtype.kind == "O":
            strange = [
                value
                for value in given.flat
                if isinstance(value, bool) or not isinstance(value, numbers.Real)
            ]
            if strange:
                raise TypeError(f"got {strange[0]!r}")
        return np.array(given, dtype=np.float64, order="C")
    except (TypeError, ValueError) as failure:
        raise error(f"{who} must hold real numbers: {failure}.") from None


def check_vertices(vertices: object, who: str) -> FloatArray:
    """Return a copy of ``vertices``, finite floats of shape (n, 3); raise if there are none."""
    out = as_reals(vertices, f"The vertices of {who}", MeshError)
    if out.ndim != 2 or out.shape[1] != 3:
        raise MeshError(f"The vertices of {who} must have shape (n_vertices, 3); got {out.shape}.")
    if len(out) == 0:
        raise MeshError(f"{who} has no vertices; leave it out of the collection.")
    bad = np.flatnonzero(~is_finite(out))
    if len(bad):
        raise MeshError(
            f"{who} has {len(bad)} vertices with NaN or infinite coordinates (beyond "
            f"{LARGEST_COORDINATE:.0e} areas overflow), the first is vertex {bad[0]}; mend or "
            "remove them (and renumber faces and correspondences) before loading."
        )
    return out


def is_finite(vertices: FloatArray) -> BoolArray:
    """Return which vertices have finite coordinates, none of them so large that areas overflow."""
    return np.asarray((np.abs(vertices) <= LARGEST_COORDINATE).all(axis=1))


def check_faces(faces: object, n_vertices: int, who: str) -> IntArray:
    """Return a copy of ``faces``, integers of shape (n, 3); raise unless all vertices exist."""
    try:
        given = as_array(faces, f"The faces of {who}", MeshError)
    except MeshError as error:
        raise MeshError(f"{error} All must be triangles: triangulate it first.") from None
    if given.ndim != 2 or given.shape[1] != 3:
        raise MeshError(
            f"The faces of {who} must be triangles, shape (n_faces, 3); got {given.shape}. "
            "Triangulate it first."
        )
    if len(given) == 0:
        raise MeshError(f"{who} has no faces; skfmap needs triangle meshes, not point clouds.")
    if not np.issubdtype(given.dtype, np.integer):
        raise MeshError(
            f"The faces of {who} must be integers; got dtype {given.dtype}. If they are whole "
            "numbers, convert them with .astype(int)."
        )
    out = np.array(given, dtype=np.int64, order="C")
    check_index_range(out, n_vertices, f"The faces of {who}", MeshError)
    return out


def check_index_range(
    index: IntArray, n_vertices: int, who: str, error: type[ValueError] = CorrespondenceError
) -> None:
    """Raise ``error`` unless all of ``index`` lies in ``0 .. n_vertices - 1``."""
    if index.size == 0:
        return
    low, high = int(index.min()), int(index.max())
    if low < 0 or high >= n_vertices:
        wrong = low if low < 0 else high
        raise error(
            f"{who} refer to vertex {wrong}, but there are {n_vertices} vertices (0 to "
            f"{n_vertices - 1}). Indices are 0-based in memory; only .vts files count from 1."
        )


def check_pairs(pairs: object, who: str) -> IntArray:
    """Return a copy of ``pairs``, rows ``[vertex, template point]``."""
    given = as_array(pairs, who, CorrespondenceError)
    if given.ndim == 1 and given.size:
        raise TypeError(
            f"{who} is one-dimensional, which can be read in two ways. Say which with "
            "Correspondence.from_vertices(points), the template point of each vertex, or "
            "Correspondence.from_template(vertices), the vertex of each template point (what .vts "
            "files hold)."
        )
    if given.size == 0:
        return np.empty((0, 2), dtype=np.int64)
    if given.ndim != 2 or given.shape[1] != 2:
        raise CorrespondenceError(
            f"{who} must have shape (n_pairs, 2), rows [vertex, template point]; got {given.shape}."
        )
    if not np.issubdtype(given.dtype, np.integer):
        raise TypeError(
            f"{who} must hold integers; got dtype {given.dtype}. Convert it with .astype(int) if "
            "it does."
        )
    out = np.array(given, dtype=np.int64, order="C")
    if out.size and out.min() < 0:
        raise CorrespondenceError(
            f"{who} holds the negative index {out.min()}; leave out pairs that are unknown."
        )
    return out


def check_number(
    value: object,
    name: str,
    *,
    low: float,
    high: float = np.inf,
    integer: bool = False,
    strict: bool = False,
) -> Any:
    """Return ``value`` if it is a number in ``[low, high]`` (``(low, high]`` when strict)."""
    kind = numbers.Integral if integer else numbers.Real
    what = "an integer" if integer else "a number"
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, kind):
        raise TypeError(f"{name} must be {what}; got {value!r}.")
    number = float(value)
    if not np.isfinite(number) or not (low <= number <= high) or (strict and number == low):
        bound = f"{'above' if strict else 'at least'} {low:g}" + (
            "" if high == np.inf else f" and at most {high:g}"
        )
        raise ValueError(f"{name} must be {what} {bound}; got {value!r}.")
    return value


def check_choice(value: object, name: str, choices: Collection[object]) -> Any:
    """Return ``value`` if it is one of ``choices``."""
    if not any(value is c or (isinstance(value, str) and value == c) for c in choices):
        options = ", ".join(sorted(map(repr, choices)))
        raise ValueError(f"{name} must be one of {options}; got {value!r}.")
    return value


def check_samples(X: object, what: str, name: str = "X") -> Sequence[Any]:
    """Return the samples of ``X`` as a list; raise for one bare sample, a table or none at all."""
    if hasattr(X, "toarray"):
        raise TypeError(
            f"{name} must be a sequence of {what}; got a sparse matrix. skfmap works on shapes, "
            "not on tables."
        )
    X = _only_column(X, what, name)
    if isinstance(X, np.ndarray) and X.dtype.kind in "biufc":
        raise TypeError(
            f"{name} must be a sequence of {what}; got a numeric array of shape {X.shape}. "
            "skfmap works on shapes, not on tables; see the quickstart."
        )
    if isinstance(X, dict):
        has = f"{name}.meshes" if "meshes" in X else f"list({name}.values())"
        raise TypeError(
            f"{name} must be a sequence of {what}; got a {type(X).__name__}. Give what it holds: "
            f"{has}."
        )
    if isinstance(X, (str, bytes)) or not hasattr(X, "__iter__") or getattr(X, "ndim", 1) == 0:
        raise TypeError(
            f"{name} must be a sequence of {what}; got one {type(X).__name__}. Wrap it in a list: "
            f"[{name}]."
        )
    if isinstance(X, (Set, Iterator)):
        # A set has no order, and an iterator is empty the second time.
        raise TypeError(
            f"{name} must be a sequence of {what}; got a {type(X).__name__}. Make it a list: "
            f"list({name})."
        )
    samples = list(X)
    if not samples:
        raise ValueError(f"{name} is empty; give at least one of: {what}.")
    return samples


def _only_column(X: Any, what: str, name: str) -> Any:
    """Return the one column of a data frame, or of a table of texts; others as they are.

    Iterating over a data frame gives the names of its columns, and over a table its rows.
    """
    if hasattr(X, "columns") and len(getattr(X, "shape", ())) == 2:
        columns = list(X.columns)
        if len(columns) == 1:
            return list(X[columns[0]])
        if not columns:
            raise TypeError(
                f"{name} must be a sequence of {what}; got a data frame of 0 columns. Give its "
                f"index, if that holds them: list({name}.index)."
            )
        raise TypeError(
            f"{name} must be a sequence of {what}; got a data frame with {len(columns)} columns "
            f"({', '.join(map(repr, columns[:5]))}{', ...' if len(columns) > 5 else ''}). Give the "
            f"one that holds them, as {name}[{columns[0]!r}]."
        )
    if isinstance(X, np.ndarray) and X.ndim == 2 and X.size and isinstance(X.flat[0], (str, Path)):
        if X.shape[1] == 1:
            return X[:, 0]
        raise TypeError(
            f"{name} must be a sequence of {what}; got a table of {X.shape[1]} columns. Give the "
            f"one that holds them, as {name}[:, 0]."
        )
    return X


def check_sample_weight(sample_weight: object, n_shapes: int) -> FloatArray:
    """Return the share of each shape, 1 each if nothing is given."""
    if sample_weight is None:
        return np.ones(n_shapes)
    share = as_reals(sample_weight, "sample_weight")
    if (
        share.shape != (n_shapes,)
        or not np.isfinite(share).all()
        or (share < 0).any()
        or not share.any()
    ):
        raise ValueError(
            f"sample_weight must be {n_shapes} finite, non-negative numbers, not all zero; got "
            f"{share}."
        )
    return share


def check_length(path: Path) -> None:
    """Raise where a name is longer than the system takes."""
    path = path.absolute()
    try:
        there = next(folder for folder in path.parents if os.path.isdir(folder))
        (there / path.name).lstat()
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise ValueError(
                f"A name of {len(path.name)} letters, {path.name[:_SHOWN]!r} and so on, is longer "
                "than this system takes; give a shorter one."
            ) from error


def check_folder(path: str | Path) -> Path:
    """Return the path of a file to be written; raise unless its folder is there."""
    file = Path(path)
    check_length(file)
    if not file.parent.is_dir():
        raise FileNotFoundError(f"There is no folder {file.parent} to write {file.name} to.")
    return file
