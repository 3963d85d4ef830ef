"""Shapes that are not like those that were learned from: what was learned does not fit them, whatever it answers."""

import warnings
from collections.abc import Collection, Sequence

import numpy as np

from skfmap._matching import Matcher, penalised_error
from skfmap._parallel import map_shapes
from skfmap._typing import FloatArray
from skfmap.exceptions import UnfamiliarShapeWarning
from skfmap.shapes import ProbedShape

__all__ = ["warn_of_unfamiliar_shapes"]

# What is left of equation (2), in units of the worst of n training shapes left out, beyond which a shape is told. With
# four of them TOSCA cats, horses and women in other poses are below 1.5, other species at 2.8 and more; creatures of
# four times the resolution that are matched wrongly are at 2.2 and more of three. The fewer, the less is known of the
# worst.
_TOO_MUCH, _TOO_MUCH_OF_ONE = 1.5, 4.0


def warn_of_unfamiliar_shapes(
    matcher: Matcher,
    misfits: FloatArray,
    shapes: Sequence[ProbedShape],
    n_jobs: int | None,
    *,
    told: Collection[int] = (),
    stacklevel: int,
) -> None:
    """Warn of new shapes that fit what was learned much worse than any training shape did when it was left out.

    ``told`` are the places of those that another warning has explained.
    """
    misfits = misfits[np.isfinite(misfits)]
    if not len(misfits):  # under way, in a callback: nothing is calibrated yet
        return
    arguments = ((matcher, shape) for shape in shapes)
    own = map_shapes(penalised_error, arguments, n_jobs=n_jobs, verbose=0, prefer="threads")
    worst = float(misfits.max())
    n = len(misfits)
    too_much = worst * (_TOO_MUCH_OF_ONE if n == 1 else _TOO_MUCH * (1 + 1 / (n - 1)))
    suspects = [
        f"{f'X[{i}]' if shape.name is None else repr(shape.name)} ({misfit / worst:.1f} times)"
        for i, (shape, misfit) in enumerate(zip(shapes, own, strict=True))
        if misfit > too_much and i not in told
    ]
    if suspects:
        warnings.warn(
            f"What was learned fits these shapes worse than any training shape left out: {', '.join(suspects)}. Their "
            "matches may be wrong, and are worse than their expected errors say. Is it another kind of body, a part of "
            "one, or a mesh of another resolution? Add shapes like it to the training shapes, or bring all to one "
            "resolution.",
            UnfamiliarShapeWarning,
            stacklevel=stacklevel,
        )
