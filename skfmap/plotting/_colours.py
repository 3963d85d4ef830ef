"""Colour scales that are perceptually uniform and safe for colour vision deficiency."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import as_reals

__all__ = ["CONFIDENCE", "ERRORS", "UNKNOWN", "Scale", "scale_of"]

UNKNOWN = (0.72, 0.72, 0.72)
"""Grey, for vertices that have no value."""

# Light colours are easier to see on a lit surface: small errors and high confidence are light.
SEQUENTIAL, DIVERGING, ERRORS, CONFIDENCE = "viridis", "coolwarm", "magma_r", "magma"


@dataclass(frozen=True)
class Scale:
    """Mapping from values to colours.

    Attributes
    ----------
    cmap : str
        Name of a matplotlib colour map.
    low, high : float
        Values at the ends of the colour map.
    label : str
        Description of the values.
    """

    cmap: str
    low: float
    high: float
    label: str = ""

    def colours(self, values: ArrayLike) -> FloatArray:
        """Return the colours of values, of shape (n, 3); masked and undefined values are grey."""
        import matplotlib as mpl  # noqa: PLC0415

        filled = undefined_as_nan(values)
        share = (filled - self.low) / max(self.high - self.low, np.finfo(float).tiny)
        colours = mpl.colormaps[self.cmap](np.clip(np.nan_to_num(share), 0, 1))[:, :3]
        colours[np.isnan(filled)] = UNKNOWN
        return np.asarray(colours)


def undefined_as_nan(values: ArrayLike) -> FloatArray:
    """Return values as floats, with NaN where they are masked or infinite."""
    filled = np.ma.filled(np.ma.asarray(values).astype(np.float64), np.nan)
    return np.where(np.isfinite(filled), filled, np.nan)


def scale_of(
    values: Sequence[ArrayLike],
    cmap: str | None = None,
    limits: Sequence[float] | None = None,
    label: str = "",
) -> Scale:
    """Return a common scale for several functions.

    The default colour map diverges about zero if values of both signs occur; otherwise it is
    sequential.
    """
    known = np.concatenate([undefined_as_nan(one) for one in values])
    known = known[~np.isnan(known)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    if low < 0 < high:
        low, high = -max(-low, high), max(-low, high)
    if limits is not None:
        low, high = _checked_limits(limits)
    if cmap is not None:
        _check_cmap(cmap)
    return Scale(cmap or (DIVERGING if low < 0 < high else SEQUENTIAL), low, high, label)


def _checked_limits(limits: object) -> tuple[float, float]:
    ends = as_reals(limits, "limits")
    if ends.shape != (2,) or not np.isfinite(ends).all() or not ends[0] < ends[1]:
        raise ValueError(f"limits must be two finite numbers in increasing order; got {limits!r}.")
    return float(ends[0]), float(ends[1])


def _check_cmap(cmap: str) -> None:
    from matplotlib import colormaps  # noqa: PLC0415

    if cmap not in colormaps:
        raise ValueError(f"cmap must be the name of a matplotlib colour map; got {cmap!r}.")
