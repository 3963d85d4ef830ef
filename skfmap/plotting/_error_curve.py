"""Cumulative curve of geodesic errors (figure 5, right)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator

from skfmap._tools.types import ErrorKind, FloatArray, MatchingOverride
from skfmap._tools.unwrap import learner_and_shapes
from skfmap._tools.validation import check_choice
from skfmap.metrics import ERROR_KINDS, PairErrors, error_curve
from skfmap.plotting._axes import axes_or_new, finish
from skfmap.refinement import Refinement
from skfmap.shapes import Correspondence

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["ErrorCurveDisplay"]

_SYMMETRIC = {
    "direct": "",
    "consistent": ", better of the direct and the symmetric answer per map",
    "per_vertex": ", symmetric answers correct",
}


class ErrorCurveDisplay:
    """Plot of the percentage of points whose geodesic error is below a threshold.

    Parameters
    ----------
    errors : ndarray of shape (n,)
        Geodesic errors, in units of sqrt(area) of the reference.
    weights : ndarray of shape (n,), optional
        Weight of each error; equal weights by default.
    kind : {"direct", "consistent", "per_vertex"}, default="direct"
        How symmetric answers were counted. The label of the axis says so.
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

    See Also
    --------
    skfmap.metrics.error_curve : Compute the curve without drawing it.
    ReliabilityDisplay : Compare expected errors with true ones.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.plotting import ErrorCurveDisplay
    >>> display = ErrorCurveDisplay.from_predictions(np.array([0.0, 0.02, 0.2, 0.05]))
    >>> display.plot(largest=0.1).line_.get_ydata()[-1].item()  # three of four are below 0.1
    75.0
    """

    def __init__(
        self,
        errors: ArrayLike,
        *,
        weights: FloatArray | None = None,
        kind: ErrorKind = "direct",
        name: str | None = None,
    ) -> None:
        self.errors = errors
        self.weights = weights
        self.kind = kind
        self.name = name

    @classmethod
    def from_estimator(
        cls,
        model: BaseEstimator,
        X: Sequence[Any],
        y: Sequence[Correspondence | ArrayLike],
        *,
        kind: ErrorKind = "direct",
        matching: MatchingOverride = "fitted",
        n_stable: float | str | None = "fitted",
        refine: Refinement | str | None = "fitted",
        reference_y: Correspondence | ArrayLike | None = None,
        name: str | None = None,
        ax: "Axes | None" = None,
        **kwargs: Any,
    ) -> Self:
        """Match shapes with known correspondences and draw the errors.

        Parameters
        ----------
        model : WeightedFunctionalMapLearner, Pipeline or fitted search
            Fitted model.
        X : sequence of shapes
            Shapes that the model was not trained on.
        y : sequence of correspondences
            Correspondence of each shape with the template.
        kind : {"direct", "consistent", "per_vertex"}, default="direct"
            How symmetric answers are counted; see `skfmap.metrics`.
        matching, n_stable, refine, reference_y : optional
            As in `skfmap.WeightedFunctionalMapLearner.pair_errors`. For full maps, use
            ``matching="cut", n_stable=1.0``.
        name : str, optional
            Name of the curve in the legend.
        ax : matplotlib Axes, optional
            Axes to draw on; those of a new figure by default.
        **kwargs : dict
            Arguments of `plot`.

        Returns
        -------
        ErrorCurveDisplay
            The display.
        """
        learner, shapes = learner_and_shapes(model, X)
        errors = learner.pair_errors(
            shapes, y, matching=matching, n_stable=n_stable, refine=refine, reference_y=reference_y
        )
        return cls.from_predictions(errors, kind=kind, name=name, ax=ax, **kwargs)

    @classmethod
    def from_predictions(
        cls,
        errors: PairErrors | Sequence[PairErrors | float] | FloatArray,
        *,
        kind: ErrorKind = "direct",
        name: str | None = None,
        ax: "Axes | None" = None,
        **kwargs: Any,
    ) -> Self:
        """Draw errors that have already been computed.

        Parameters
        ----------
        errors : sequence of PairErrors, or ndarray of shape (n,)
            Result of `skfmap.WeightedFunctionalMapLearner.pair_errors`, or plain errors.
        kind, name, ax, **kwargs : optional
            As in `from_estimator`.

        Returns
        -------
        ErrorCurveDisplay
            The display.
        """
        check_choice(kind, "kind", ERROR_KINDS)
        given = [errors] if isinstance(errors, PairErrors) else list(errors)
        pairs = [one for one in given if isinstance(one, PairErrors)]
        if len(pairs) < len(given):
            return cls(np.asarray(errors), kind=kind, name=name).plot(ax, **kwargs)
        if not any(len(one.vertices) for one in pairs):
            raise ValueError(
                "There is nothing to draw, because no errors were given or all shapes were skipped."
            )
        weights = np.concatenate([one.weights for one in pairs])
        values = np.concatenate([one.of_kind(kind) for one in pairs])
        return cls(values, weights=weights, kind=kind, name=name).plot(ax, **kwargs)

    def plot(
        self,
        ax: "Axes | None" = None,
        *,
        name: str | None = None,
        largest: float = 0.25,
        **kwargs: Any,
    ) -> Self:
        """Draw the curve; several curves can share axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; those of a new figure by default.
        name : str, optional
            Name of the curve in the legend.
        largest : float, default=0.25
            Largest error on the horizontal axis, in units of sqrt(area).
        **kwargs : dict
            Properties of the line, passed to matplotlib.

        Returns
        -------
        ErrorCurveDisplay
            The display itself.
        """
        thresholds = np.linspace(0, largest, 200)
        ax = axes_or_new(ax)
        share = 100 * error_curve(np.asarray(self.errors), thresholds, self.weights)
        (self.line_,) = ax.plot(thresholds, share, label=name or self.name, **kwargs)
        finish(
            ax,
            xlabel="geodesic error / sqrt(area)" + _SYMMETRIC[self.kind],
            ylabel="points below, %",
            xlim=(0, largest),
            ylim=(0, 101),
        )
        self.ax_, self.figure_ = ax, ax.figure
        return self
