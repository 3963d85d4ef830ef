"""Detection of shapes that are unlike the training shapes, whose matches mean little."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["is_familiar"]

# Threshold for the residual of equation (2), in units of the largest on n held-out training shapes;
# it is higher for few shapes, because their largest is uncertain. With four shapes, TOSCA's cats,
# horses and women in other poses are below 1.5, and other species at 2.8 or more; with three,
# creatures of four times the resolution that are matched wrongly are at 2.2 or more.
_TOO_MUCH, _TOO_MUCH_OF_ONE = 1.5, 4.0
# Threshold for the distance between matched points of the embedding (`Match.misfit`), to be
# multiplied by 1 + 1 / n. Other poses in TOSCA are at 1.3 or less; creatures that are stretched
# twofold or lack a tenth, with errors of 0.06 or more, are at 1.5 or more.
_TOO_FAR = 1.25


def is_familiar(training_residuals: FloatArray, residual: float, misfit: float = np.nan) -> bool:
    """Return whether a shape fits about as well as the held-out training shapes.

    Parameters
    ----------
    training_residuals : ndarray of shape (n_shapes,)
        Residual of equation (2) on each of them; NaN where it is unknown.
    residual : float
        Residual of equation (2) on the shape.
    misfit : float
        `Match.misfit`; NaN if there is no match.
    """
    known = training_residuals[np.isfinite(training_residuals)]
    n = len(known)
    too_much = float(known.max()) * (_TOO_MUCH_OF_ONE if n == 1 else _TOO_MUCH * (1 + 1 / (n - 1)))
    return not (residual > too_much or misfit > _TOO_FAR * (1 + 1 / n))
