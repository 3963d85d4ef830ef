"""Correspondences that contradict each other: what is learned from the others puts a training shape elsewhere."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from skfmap._inputs import place
from skfmap._typing import FloatArray
from skfmap.exceptions import DisagreementWarning

__all__ = ["warn_of_disagreement"]

# Mean errors, in sqrt(area), of training shapes left out. Those of TOSCA cats, horses and people are at most 0.06, and
# within twice the median of the others; a horse whose numbers are off by one is at 0.08, animals taken for their mirror
# images at 0.2 and more, with shuffled numbers at 0.35 and more.
_WRONG, _WRONG_TO_ALL, _TIMES_THE_OTHERS = 0.06, 0.2, 3


def warn_of_disagreement(errors: FloatArray, shapes: Sequence[Any], stacklevel: int) -> None:
    """Name training shapes whose correspondences contradict all others, or say that none agrees.

    ``errors`` has one entry for each of the ``shapes`` that were given; NaN for those that were not left out.
    """
    left_out = np.flatnonzero(np.isfinite(errors)).tolist()
    if len(left_out) < 2:
        return
    if (typical := float(np.median(errors[left_out]))) > _WRONG_TO_ALL:
        warnings.warn(
            f"Training shapes that are left out of the learning are matched with a mean error of {typical:.2f} "
            "sqrt(area), nearly as bad as chance, and new ones will be. Check the correspondence of the reference "
            "first (vertex numbers from 0, those of this very mesh; Correspondence.from_vertices or from_template), "
            "then the others' (learner.training_errors_), whether the shapes are alike, and whether the functions are "
            "enough to tell points apart (n_functions, n_stable).",
            DisagreementWarning,
            stacklevel=stacklevel + 1,
        )
        return
    suspects = [i for i in left_out if _contradicts(errors[i], errors[np.setdiff1d(left_out, i)])]
    if suspects:
        told = ", ".join(f"{place(i, shapes[i])} ({errors[i]:.2f})" for i in suspects)
        warnings.warn(
            f"Left out of the learning, these training shapes are matched far from where their correspondences say, by "
            f"this many sqrt(area): {told}; {typical:.2f} is typical of all. Vertex numbers of another mesh or counted "
            "from 1, left taken for right, or another kind of body? Mend the correspondence, or leave the shape out: "
            "it spoils what is learned from the others.",
            DisagreementWarning,
            stacklevel=stacklevel + 1,
        )


def _contradicts(error: float, others: FloatArray) -> bool:
    return error > max(_WRONG, _TIMES_THE_OTHERS * float(np.median(others)))
