"""Comparison of expected errors with true errors."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator

from skfmap._tools.ties import is_constant
from skfmap._tools.types import FloatArray
from skfmap._tools.unwrap import learner_and_shapes
from skfmap._tools.validation import check_number
from skfmap.plotting._axes import axes_or_new, finish
from skfmap.refinement import Refinement
from skfmap.shapes import Correspondence

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["ReliabilityDisplay"]

# Upper limit of the axes if all errors are zero: any positive length far below that of an edge.
_NARROWEST = 1e-3


class ReliabilityDisplay:
    """Plot of true errors against expected errors; good expectations lie on the diagonal.

    Vertices are sorted by expected error and divided into bins of equal size. Each point is the
    mean of a bin; the shaded band contains the middle half of the true errors in each bin.

    Parameters
    ----------
    expected, errors : array-like of shape (n,)
        Expected and true errors at vertices of shapes that the model was not trained on. Vertices
        at which either is NaN are left out.
    name : str, optional
        Name of the curve in the legend.

    Attributes
    ----------
    ax_ : matplotlib Axes
        Axes with the curve.
    figure_ : matplotlib Figure
        Figure that contains the axes.
    line_ : matplotlib Line2D
        The curve.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.plotting import ReliabilityDisplay
    >>> expected = np.linspace(0, 0.1, 50)
    >>> display = ReliabilityDisplay.from_predictions(expected, 2 * expected, n_bins=5)
    >>> bool(np.allclose(display.line_.get_ydata(), 2 * display.line_.get_xdata()))
    True
    """

    def __init__(self, expected: ArrayLike, errors: ArrayLike, *, name: str | None = None) -> None:
        self.expected = expected
        self.errors = errors
        self.name = name

    @classmethod
    def from_estimator(
        cls,
        model: BaseEstimator,
        X: Sequence[Any],
        y: Sequence[Correspondence | ArrayLike],
        *,
        refine: Refinement | str | None = "fitted",
        name: str | None = None,
        ax: "Axes | None" = None,
        **kwargs: Any,
    ) -> Self:
        """Match shapes with known correspondences and draw true against expected errors.

        Parameters
        ----------
        model : WeightedFunctionalMapLearner, Pipeline or fitted search
            Fitted model.
        X : sequence of shapes
            Shapes that the model was not trained on.
        y : sequence of correspondences
            Correspondence of each shape with the template.
        refine : optional
            As in `skfmap.match`.
        name : str, optional
            Name of the curve in the legend.
        ax : matplotlib Axes, optional
            Axes to draw on; those of a new figure by default.
        **kwargs : dict
            Arguments of `plot`.

        Returns
        -------
        ReliabilityDisplay
            The display.

        Raises
        ------
        ValueError
            If the model was fitted with ``confidence=None``.
        """
        learner, shapes = learner_and_shapes(model, X)
        matches = learner.match(shapes, refine=refine)
        errors = learner.pair_errors(shapes, y, refine=refine)
        if any(match.expected_error is None for match in matches):
            raise ValueError(
                "The model has no expected errors: it was fitted with confidence=None. Fit it with "
                "confidence='cross-fit'."
            )
        expected = [
            match.expected_error[one.vertices] for match, one in zip(matches, errors, strict=True)
        ]
        true = np.concatenate([one.direct for one in errors])
        return cls.from_predictions(np.concatenate(expected), true, name=name, ax=ax, **kwargs)

    @classmethod
    def from_predictions(
        cls,
        expected: ArrayLike,
        errors: ArrayLike,
        *,
        name: str | None = None,
        ax: "Axes | None" = None,
        **kwargs: Any,
    ) -> Self:
        """Draw true against expected errors.

        Parameters
        ----------
        expected, errors : array-like of shape (n,)
            Expected and true errors at the same vertices.
        name, ax, **kwargs : optional
            As in `from_estimator`.

        Returns
        -------
        ReliabilityDisplay
            The display.

        Raises
        ------
        ValueError
            If the two have different lengths or fewer entries than bins.
        """
        return cls(expected, errors, name=name).plot(ax, **kwargs)

    def plot(
        self, ax: "Axes | None" = None, *, name: str | None = None, n_bins: int = 10, **kwargs: Any
    ) -> Self:
        """Draw the curve; several curves can share axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; those of a new figure by default.
        name : str, optional
            Name of the curve in the legend.
        n_bins : int, default=10
            Number of bins. If all expected errors are equal, there is only one bin.
        **kwargs : dict
            Properties of the line, passed to matplotlib.

        Returns
        -------
        ReliabilityDisplay
            The display itself.

        Raises
        ------
        ValueError
            If expected and true errors have different lengths or fewer known entries than bins.
        """
        check_number(n_bins, "n_bins", low=1, integer=True)
        x, y = (np.asarray(values, dtype=np.float64) for values in (self.expected, self.errors))
        if x.shape != y.shape or x.ndim != 1 or len(x) < n_bins:
            raise ValueError(
                "expected and errors must be one-dimensional, of the same length, with at least "
                f"{n_bins} entries; got shapes {x.shape} and {y.shape}."
            )
        known = np.isfinite(x) & np.isfinite(y)
        if known.sum() < n_bins:
            raise ValueError(
                f"expected and errors are both known at only {known.sum()} vertices, but {n_bins} "
                "bins need at least as many. Lower n_bins, or give more vertices."
            )
        x, y = x[known], y[known]
        ax = axes_or_new(ax)
        fresh = not ax.lines
        middle, mean, low, high = _binned(x, y, n_bins)
        style: dict[str, Any] = {"marker": "o", "markersize": 4} | kwargs
        (self.line_,) = ax.plot(middle, mean, label=name or self.name, **style)
        ax.fill_between(middle, low, high, alpha=0.18, color=self.line_.get_color(), linewidth=0)
        limit = max(
            1.05 * float(max(middle.max(), high.max())), _NARROWEST if fresh else ax.get_xlim()[1]
        )
        if fresh:
            ax.axline(
                (0, 0), slope=1, linestyle="--", color="0.5", linewidth=1, label="as expected"
            )
        finish(
            ax,
            xlabel="expected error / sqrt(area)",
            ylabel="true error / sqrt(area)",
            xlim=(0, limit),
            ylim=(0, limit),
        )
        self.ax_, self.figure_ = ax, ax.figure
        return self


def _binned(
    x: FloatArray, y: FloatArray, n_bins: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return mean expected and true errors per bin, and the quartiles of the true errors."""
    parts = np.array_split(np.argsort(x, kind="stable"), 1 if is_constant(x) else n_bins)
    middle, mean = (np.array([values[part].mean() for part in parts]) for values in (x, y))
    low, high = (np.array([np.quantile(y[part], q) for part in parts]) for q in (0.25, 0.75))
    return middle, mean, low, high
