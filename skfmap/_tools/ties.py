"""Choices among values that are equal but for rounding: the first of them wins, on every machine."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["ROUNDING", "first_of_largest", "first_of_least", "is_constant"]

ROUNDING = 1e-6
"""Share of the largest magnitude by which results of iterations, as eigenfunctions are, may differ by rounding."""

# The same for sums.
_ROUNDING_OF_SUMS = 1e-9


def first_of_largest(values: FloatArray, rounding: float = _ROUNDING_OF_SUMS) -> int:
    """Return the first place of the largest value, or of one that is equal to it but for rounding.

    On symmetric bodies many values are equal, and the last bits, which differ between machines, would choose.

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
    """Return the first place of the least value, or of one that is equal to it but for rounding."""
    return first_of_largest(-values, rounding)


def is_constant(values: FloatArray) -> bool:
    """Tell whether all values are equal but for rounding."""
    return bool(np.ptp(values) <= ROUNDING * np.abs(values).max())
