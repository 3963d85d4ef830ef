"""Shapes that are not like those that were learned from: what was learned does not fit them, whatever it answers."""

import warnings
from collections.abc import Collection, Sequence

import numpy as np

from skfmap._inputs import place
from skfmap._matching import Matcher, penalised_error
from skfmap._parallel import map_shapes
from skfmap._skipped import Sorted
from skfmap._typing import FloatArray
from skfmap.exceptions import UnfamiliarShapeWarning
from skfmap.shapes import Match, ProbedShape

__all__ = ["places_of_misfits", "warn_of_unfamiliar_shapes"]

# What is left of equation (2), in units of the worst of n training shapes left out, beyond which a shape is told. With
# four of them TOSCA cats, horses and women in other poses are below 1.5, other species at 2.8 and more; creatures of
# four times the resolution that are matched wrongly are at 2.2 and more of three. The fewer, the less is known of the
# worst.
_TOO_MUCH, _TOO_MUCH_OF_ONE = 1.5, 4.0
# The same for the distance between matched points of the embedding (`Match.misfit`), times 1 + 1 / n. Other poses on
# TOSCA are at 1.3 and less, creatures that are stretched twofold or lack a tenth, with errors of 0.06 and more, at 1.5
# and more.
_TOO_FAR = 1.25


def places_of_misfits(
    matcher: Matcher,
    misfits: FloatArray,
    shapes: Sequence[ProbedShape],
    n_jobs: int | None,
    matches: Sequence[Match] = (),
) -> list[int]:
    """Return which new shapes fit what was learned much worse than any training shape did when it was left out.

    By equation (2), and, where there are matches, by these.
    """
    misfits = misfits[np.isfinite(misfits)]
    if not len(misfits):  # under way, in a callback: nothing is calibrated yet
        return []
    arguments = ((matcher, shape) for shape in shapes)
    own = map_shapes(penalised_error, arguments, n_jobs=n_jobs, verbose=0, prefer="threads")
    n = len(misfits)
    too_much = float(misfits.max()) * (_TOO_MUCH_OF_ONE if n == 1 else _TOO_MUCH * (1 + 1 / (n - 1)))
    too_far = _TOO_FAR * (1 + 1 / n)
    by_equation = [i for i, misfit in enumerate(own) if misfit > too_much]
    return sorted({*by_equation, *(i for i, match in enumerate(matches) if match.misfit > too_far)})


def warn_of_unfamiliar_shapes(given: Sorted, suspicious: Collection[int], *, stacklevel: int) -> None:
    """Name those of the shapes."""
    suspects = [place(given.places[i], given.shapes[i]) for i in suspicious]
    if suspects:
        warnings.warn(
            f"What was learned fits these shapes much worse than any training shape left out: {', '.join(suspects)}. "
            "Their matches may be wrong, and worse than their expected errors say. Is it another kind of body, a part "
            "of one, or a mesh of another resolution? Add shapes like it to the training shapes, or bring all to one "
            "resolution.",
            UnfamiliarShapeWarning,
            stacklevel=stacklevel,
        )
