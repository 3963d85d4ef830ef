"""Choices among values that are equal up to rounding: the first wins, on every machine."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["ROUNDING", "first_of_largest", "first_of_least", "is_constant"]

ROUNDING = 1e-6
"""Share of the largest magnitude within which results of iterations are equal up to rounding.

Eigenfunctions have residuals of 1e-10, which a gap of 1e-4 to the next eigenvalue makes 1e-6.
"""

# The same for sums: ten million terms of which each may be wrong by 1.1e-16.
_ROUNDING_OF_SUMS = 1e-9


def first_of_largest(values: FloatArray, rounding: float = _ROUNDING_OF_SUMS) -> int:
    """Return the index of the largest value: of those that are equal up to rounding, the first.

    On symmetric bodies many values are equal, and the last bits, which differ between machines,
    would choose.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap._tools.ties import first_of_largest
    >>> first_of_largest(np.array([0.0, 1.0 - 1e-12, 1.0]))
    1
    """
    largest = values.max()
    if not np.isfinite(largest):
        return int(np.argmax(values))
    scale = np.abs(values[np.isfinite(values)]).max()
    return int(np.argmax(values >= largest - rounding * scale))


def first_of_least(values: FloatArray, rounding: float = _ROUNDING_OF_SUMS) -> int:
    """Return the index of the least value: of those that are equal up to rounding, the first."""
    return first_of_largest(-values, rounding)


def is_constant(values: FloatArray) -> bool:
    """Return whether all values are equal up to rounding."""
    return bool(np.ptp(values) <= ROUNDING * np.abs(values).max())
