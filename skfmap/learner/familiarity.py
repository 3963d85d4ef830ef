"""Shapes that are not like those that were learned from.

What was learned does not fit them, and its answers mean little.
"""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["is_familiar"]

# What is left of equation (2), in units of the worst of n training shapes left out, beyond which a
# shape is told. With four of them TOSCA cats, horses and women in other poses are below 1.5, other
# species at 2.8 and more; creatures of four times the resolution that are matched wrongly are at
# 2.2 and more of three. The fewer, the less is known of the worst.
_TOO_MUCH, _TOO_MUCH_OF_ONE = 1.5, 4.0
# The same for the distance between matched points of the embedding (`Match.misfit`), times 1 + 1 /
# n. Other poses on TOSCA are at 1.3 and less, creatures that are stretched twofold or lack a tenth,
# with errors of 0.06 and more, at 1.5 and more.
_TOO_FAR = 1.25


def is_familiar(training_residuals: FloatArray, residual: float, misfit: float = np.nan) -> bool:
    """Tell whether a shape fits about as well as training shapes did when they were left out.

    Parameters
    ----------
    training_residuals : ndarray of shape (n_shapes,)
        What was left of equation (2) on each of them; NaN where it is not known.
    residual : float
        What is left of it on the shape.
    misfit : float
        `Match.misfit`; NaN where there is no match.
    """
    known = training_residuals[np.isfinite(training_residuals)]
    n = len(known)
    too_much = float(known.max()) * (_TOO_MUCH_OF_ONE if n == 1 else _TOO_MUCH * (1 + 1 / (n - 1)))
    return not (residual > too_much or misfit > _TOO_FAR * (1 + 1 / n))
