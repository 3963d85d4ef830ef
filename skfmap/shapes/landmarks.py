"""Named points of one shape."""

from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import BoolArray, FloatArray
from skfmap._tools.validation import as_reals, read_only
from skfmap.exceptions import CorrespondenceError
from skfmap.shapes import outlets

__all__ = ["Landmarks"]


@dataclass(frozen=True, eq=False, repr=False)
class Landmarks:
    """Named points of one shape, placed by hand or predicted.

    Parameters
    ----------
    points : array-like of shape (n_landmarks, 3)
        Coordinates in the units and the coordinate system of the shape's mesh; copied. A row of NaN
        marks a landmark that is missing on this shape.
    names : sequence of str, optional
        Unique names, one per landmark; ``"1"``, ``"2"``, ... by default. Landmarks with the same
        name on different shapes correspond.
    name : str, optional
        Name of the shape.
    expected_error : array-like of shape (n_landmarks,), optional
        Expected distance between each point and the point an observer would place, in the units of
        the mesh. None for landmarks that were not predicted.
    radius : array-like of shape (n_landmarks,), optional
        Radius of the ball around each point that contains the observer's point with probability
        ``coverage``, in the units of the mesh. None if it was not calibrated.
    coverage : float, optional
        Probability that ``radius`` stands for, for instance 0.9.

    Raises
    ------
    CorrespondenceError
        If the numbers of points, names and errors differ, a name occurs twice, a coordinate is
        infinite, or a point has only some of its coordinates.

    Examples
    --------
    >>> from skfmap import Landmarks
    >>> marks = Landmarks([[0.0, 0, 0], [1, 2, 3]], ["nose", "chin"], name="specimen")
    >>> marks
    Landmarks('specimen', n_landmarks=2)
    >>> marks.point("chin").tolist()
    [1.0, 2.0, 3.0]
    """

    points: FloatArray
    names: tuple[str, ...] = ()
    name: str | None = field(default=None, kw_only=True)
    expected_error: FloatArray | None = field(default=None, kw_only=True)
    radius: FloatArray | None = field(default=None, kw_only=True)
    coverage: float | None = field(default=None, kw_only=True)

    def __init__(
        self,
        points: npt.ArrayLike,
        names: Any = None,
        *,
        name: str | None = None,
        expected_error: npt.ArrayLike | None = None,
        radius: npt.ArrayLike | None = None,
        coverage: float | None = None,
    ) -> None:
        at = _points(points)
        errors = {"expected_error": expected_error, "radius": radius}
        for what, values in {
            "points": at,
            "names": _names(names, len(at)),
            "name": name,
            "coverage": coverage,
            **{which: _one_each(one, len(at), which) for which, one in errors.items()},
        }.items():
            object.__setattr__(self, what, values)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by way of the constructor, so that copies are checked and immutable too."""
        more = ("name", "expected_error", "radius", "coverage")
        return _landmarks, (self.points, self.names, {what: getattr(self, what) for what in more})

    def __deepcopy__(self, memo: object) -> Self:
        """Return the landmarks themselves: they cannot change."""
        return self

    def __repr__(self) -> str:
        """Return one line with the name of the shape and the counts."""
        missing = int((~self.placed).sum())
        says = f", {missing} missing" if missing else ""
        if self.expected_error is not None and self.placed.any():
            says += f", mean expected error {np.nanmean(self.expected_error):.3g}"
        return f"Landmarks({self.name!r}, n_landmarks={len(self.names)}{says})"

    def _repr_html_(self) -> str:
        return outlets.html_of(self)

    @property
    def placed(self) -> BoolArray:
        """Which landmarks are not missing; a boolean array of shape (n_landmarks,)."""
        return np.asarray(np.isfinite(self.points).all(axis=1))

    def point(self, name: str) -> FloatArray:
        """Return the coordinates of one landmark, an array of shape (3,).

        Raises
        ------
        KeyError
            If no landmark has that name.
        """
        if name not in self.names:
            raise KeyError(
                f"No landmark is called {name!r}. The names are {', '.join(self.names)}."
            )
        return self.points[self.names.index(name)]


def _points(points: npt.ArrayLike) -> FloatArray:
    array = as_reals(points, "points", CorrespondenceError)
    if array.ndim != 2 or array.shape[1] != 3:
        raise CorrespondenceError(
            f"points must have three coordinates in each row; got shape {array.shape}."
        )
    unknown = np.isnan(array)
    odd = np.isinf(array).any(axis=1) | (unknown.any(axis=1) & ~unknown.all(axis=1))
    if odd.any():
        raise CorrespondenceError(
            f"Row {int(np.flatnonzero(odd)[0])} of points holds an infinite coordinate, or only "
            "some of its coordinates. Give three finite numbers, or three NaN if the landmark is "
            "missing."
        )
    return read_only(array)


def _names(names: Any, n_points: int) -> tuple[str, ...]:
    if isinstance(names, str):
        raise CorrespondenceError(f"names must be a sequence of names; got the string {names!r}.")
    given = [str(i + 1) for i in range(n_points)] if names is None else [str(n) for n in names]
    if len(given) != n_points:
        raise CorrespondenceError(
            f"There are {n_points} points but {len(given)} names; give one name per point."
        )
    if twice := sorted({name for name in given if given.count(name) > 1}):
        raise CorrespondenceError(
            f"Several landmarks have the same name: {', '.join(twice)}. Names must be unique."
        )
    return tuple(given)


def _one_each(values: Any, n_points: int, what: str) -> FloatArray | None:
    if values is None:
        return None
    array = as_reals(values, what, CorrespondenceError)
    if array.shape != (n_points,):
        raise CorrespondenceError(
            f"{what} must have one entry for each of the {n_points} points; got shape "
            f"{array.shape}."
        )
    return read_only(array)


def _landmarks(points: FloatArray, names: tuple[str, ...], more: dict[str, Any]) -> Landmarks:
    return Landmarks(points, names, **more)
