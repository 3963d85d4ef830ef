"""Bookkeeping of usable and skipped shapes in X, by index."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from skfmap._tools.validation import label
from skfmap._tools.warn import warn
from skfmap.exceptions import RepairWarning, SkippedShapeWarning
from skfmap.shapes.correspondence import Correspondence
from skfmap.shapes.probed_shape import ProbedShape
from skfmap.shapes.skipped_shape import SkippedShape

__all__ = [
    "Answer",
    "ProbedItem",
    "Usable",
    "describe",
    "pick_usable",
    "put_back",
    "skipped_message",
    "warn_of_repairs",
    "warn_of_skipped",
]


# Items of the learner's X and y.
ProbedItem: TypeAlias = ProbedShape | SkippedShape
Answer: TypeAlias = Correspondence | npt.NDArray[np.integer[Any]] | Sequence[Sequence[int]]


class Usable(NamedTuple):
    """The usable shapes of X, their indices in X, and the skipped shapes by index."""

    shapes: list[Any]
    indices: list[int]
    skipped: dict[int, SkippedShape]


def pick_usable(X: Sequence[Any]) -> Usable:
    """Split X into usable shapes with their indices, and skipped shapes by index."""
    skipped = {i: shape for i, shape in enumerate(X) if isinstance(shape, SkippedShape)}
    indices = [i for i in range(len(X)) if i not in skipped]
    return Usable([X[i] for i in indices], indices, skipped)


def put_back(
    answers: Sequence[Any], usable: Usable, empty: Callable[[SkippedShape], Any]
) -> list[Any]:
    """Return the answers in the order of X, with ``empty(shape)`` for each skipped shape."""
    known = dict(zip(usable.indices, answers, strict=True))
    known |= {i: empty(shape) for i, shape in usable.skipped.items()}
    return [known[i] for i in range(len(known))]


def describe(i: int, shape: object) -> str:
    """Return how messages refer to the shape at index ``i`` of X: by index, and name if any."""
    name = getattr(shape, "name", None)
    return f"X[{i}]" if name is None else f"X[{i}] ({name!r})"


def skipped_message(shapes: Sequence[Any], told: Sequence[Any] = ()) -> str:
    """Return a message that names skipped shapes and the reasons; empty if there are none.

    Shapes that are also skipped in ``told`` were reported before and are not repeated.
    """
    before = {i for i, shape in enumerate(told) if isinstance(shape, SkippedShape)}
    skipped = [
        (i, one)
        for i, one in enumerate(shapes)
        if isinstance(one, SkippedShape) and i not in before
    ]
    reasons = "; ".join(
        f"X[{i}], {label(shape.name, 'shape')}: {shape.reason}" for i, shape in skipped
    )
    return f"{len(skipped)} of {len(shapes)} shapes are left out. {reasons}" if skipped else ""


def warn_of_skipped(shapes: Sequence[Any], told: Sequence[Any] = ()) -> None:
    """Warn of skipped shapes, except those that were already skipped in ``told``."""
    if message := skipped_message(shapes, told):
        warn(message, SkippedShapeWarning)


def warn_of_repairs(made: Sequence[tuple[Any, str]]) -> None:
    """Warn of shapes that were mended or thinned, and say what was done."""
    told = [f"{label(shape.name, 'shape')}: {done}" for shape, done in made if done]
    if told:
        only_thinned = all(done.startswith("thinned") for _, done in made if done)
        head = "Meshes were thinned" if only_thinned else "Meshes were mended"
        warn(f"{head}{':' if only_thinned else '.'} {'; '.join(told)}.", RepairWarning)
