"""The learned weights (figure 3, left)."""

from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator

from skfmap._tools.types import FloatArray
from skfmap._tools.unwrap import fitted_learner
from skfmap.learner import WeightedFunctionalMapLearner
from skfmap.plotting._axes import axes_or_new, finish

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["WeightsDisplay"]


class WeightsDisplay:
    """Plot of the weights of the probe functions, grouped by category.

    Parameters
    ----------
    weights : ndarray of shape (m,)
        Diagonal of D.
    probe_categories : sequence of str
        Category of each probe function.
    name : str, optional
        Name of the weights in the legend.

    Attributes
    ----------
    ax_ : matplotlib Axes
        Axes with the weights.
    figure_ : matplotlib Figure
        Figure that contains the axes.
    line_ : matplotlib Line2D
        The line through the weights.

    See Also
    --------
    SingularValuesDisplay : Show the effect of the weights on the map of an unseen shape.

    Examples
    --------
    >>> from skfmap.plotting import WeightsDisplay
    >>> display = WeightsDisplay([0.5, 2.0, 8.0], ["hks", "hks", "wks"]).plot()
    >>> display.ax_.get_ylabel()
    'weight'
    """

    def __init__(
        self, weights: ArrayLike, probe_categories: Sequence[str], *, name: str | None = None
    ) -> None:
        self.weights = weights
        self.probe_categories = probe_categories
        self.name = name

    @classmethod
    def from_estimator(
        cls,
        model: BaseEstimator,
        *,
        name: str | None = None,
        ax: "Axes | None" = None,
        **kwargs: Any,
    ) -> Self:
        """Draw the weights of a fitted model.

        Parameters
        ----------
        model : WeightedFunctionalMapLearner, Pipeline or fitted search
            Fitted model.
        name : str, optional
            Name of the weights in the legend; the parameter ``weighting`` by default.
        ax : matplotlib Axes, optional
            Axes to draw on; those of a new figure by default.
        **kwargs : dict
            Properties of the line, passed to matplotlib.

        Returns
        -------
        WeightsDisplay
            The display.
        """
        learner = fitted_learner(model)
        name = _name_of(learner) if name is None else name
        return cls(learner.weights_, list(learner.probe_categories_), name=name).plot(ax, **kwargs)

    def plot(self, ax: "Axes | None" = None, *, name: str | None = None, **kwargs: Any) -> Self:
        """Draw the weights; several displays can share axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; those of a new figure by default.
        name : str, optional
            Name of the weights in the legend.
        **kwargs : dict
            Properties of the line, passed to matplotlib.

        Returns
        -------
        WeightsDisplay
            The display itself.

        Raises
        ------
        ValueError
            If there is not one weight for each probe function.
        """
        weights: FloatArray = np.asarray(self.weights, dtype=np.float64)
        if weights.shape != (len(self.probe_categories),):
            raise ValueError(
                "weights must hold one number for each of the "
                f"{len(self.probe_categories)} probe functions; got shape {weights.shape}."
            )
        ax = axes_or_new(ax)
        fresh = not ax.lines
        style: dict[str, Any] = {"marker": "o", "markersize": 3.5, "linewidth": 0.9} | kwargs
        (self.line_,) = ax.plot(np.arange(len(weights)), weights, label=name or self.name, **style)
        if fresh:
            self._mark_categories(ax)
        ax.set_yscale("log")
        finish(
            ax,
            ylabel="weight",
            xlabel="probe function, by category",
            xlim=(-0.5, len(weights) - 0.5),
        )
        ax.grid(visible=False, axis="x")
        self.ax_, self.figure_ = ax, ax.figure
        return self

    def _mark_categories(self, ax: "Axes") -> None:
        """Shade every other category, and write the name of each below the axis."""
        start, middles, names = 0, [], []
        for i, (category, members) in enumerate(groupby(self.probe_categories)):
            end = start + len(list(members))
            if i % 2 == 0:
                ax.axvspan(start - 0.5, end - 0.5, color="0.95", zorder=-1)
            middles.append((start + end - 1) / 2)
            names.append(str(category))
            start = end
        ax.set_xticks(middles, names, rotation=40, ha="right", fontsize=8)
        ax.tick_params(axis="x", length=0)


def _name_of(learner: WeightedFunctionalMapLearner) -> str:
    if learner.weighting is None:
        return "none (D = I)"
    return str(learner.weighting) if isinstance(learner.weighting, str) else "own groups"
