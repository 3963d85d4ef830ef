"""Helpers for axes with curves."""

from typing import TYPE_CHECKING, Any

import numpy as np

from skfmap._tools.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["axes_or_new", "finish", "of_known_shapes"]

# The colours of Okabe and Ito, which remain distinct with colour vision deficiency.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")


def axes_or_new(ax: "Axes | None") -> "Axes":
    """Return ``ax``, or the axes of a new figure; set the colour cycle if nothing is drawn yet."""
    from matplotlib import pyplot as plt  # noqa: PLC0415

    drawn = plt.subplots(figsize=(6.4, 4.2), layout="constrained")[1] if ax is None else ax
    if not drawn.lines:
        drawn.set_prop_cycle(color=_COLOURS)
    return drawn


def of_known_shapes(differences: FloatArray) -> FloatArray:
    """Return differences of maps without those that are NaN, which belong to skipped shapes."""
    stacked = differences.reshape(-1, *differences.shape[-2:])
    known = ~np.isnan(stacked).any(axis=(1, 2))
    if not known.any():
        raise ValueError(
            "There is nothing to draw, because all shapes were skipped. The warnings of the "
            "pipeline say why."
        )
    return np.asarray(differences if differences.ndim == 2 else stacked[known])


def finish(ax: "Axes", **labels: Any) -> None:
    """Set labels and limits, draw a grid, and add a legend if any line has a name."""
    ax.set(**labels)
    ax.grid(alpha=0.25, linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    if ax.get_legend_handles_labels()[1]:
        ax.legend(frameon=False)
