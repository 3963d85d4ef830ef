"""How many points are matched how well (figure 5, right)."""

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
    "consistent": ", the symmetric answer correct if it is so everywhere",
    "per_vertex": ", symmetric answers correct",
}


class ErrorCurveDisplay:
    """Share of the points whose geodesic error is below a threshold.

    Parameters
    ----------
    errors : ndarray of shape (n,)
        Geodesic errors, in units of sqrt(area) of the reference.
    weights : ndarray of shape (n,), optional
        Weight of each; all alike by default.
    kind : {"direct", "consistent", "per_vertex"}, default="direct"
        What symmetric answers counted for; it is said on the axis.
    name : str, optional
        What the curve is called in the legend.

    Attributes
    ----------
    ax_, figure_, line_ : matplotlib Axes, Figure, Line2D
        What was drawn.

    See Also
    --------
    skfmap.metrics.error_curve : The same numbers.
    ReliabilityDisplay : Whether the errors were expected.

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
        """Match shapes of known correspondence with a fitted model and draw the errors.

        Parameters
        ----------
        model : WeightedFunctionalMapLearner, Pipeline or fitted search
            The model.
        X, y : sequence, sequence of correspondences
            Shapes that it was not trained on, and where they lie on the template.
        kind : {"direct", "consistent", "per_vertex"}, default="direct"
            What symmetric answers count for; see `skfmap.metrics`.
        matching, n_stable, refine, reference_y : optional
            As in `skfmap.WeightedFunctionalMapLearner.pair_errors`: ``matching="cut",
            n_stable=1.0`` are full maps.
        name : str, optional
            In the legend.
        ax : matplotlib Axes, optional
            Where to draw; a new figure by default.
        **kwargs : dict
            Of `plot`.

        Returns
        -------
        ErrorCurveDisplay
            What was drawn.
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
        """Draw errors that were computed before.

        Parameters
        ----------
        errors : sequence of PairErrors, or ndarray of shape (n,)
            Of `skfmap.WeightedFunctionalMapLearner.pair_errors`, or plain errors.
        kind, name, ax, **kwargs : optional
            As in `from_estimator`.

        Returns
        -------
        ErrorCurveDisplay
            What was drawn.
        """
        check_choice(kind, "kind", ERROR_KINDS)
        given = [errors] if isinstance(errors, PairErrors) else list(errors)
        pairs = [one for one in given if isinstance(one, PairErrors)]
        if len(pairs) < len(given):
            return cls(np.asarray(errors), kind=kind, name=name).plot(ax, **kwargs)
        if not any(len(one.vertices) for one in pairs):
            raise ValueError("There is nothing to draw: no errors, or no shape could be used.")
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
        """Draw the curve; several may share axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; a new figure by default.
        name : str, optional
            In the legend.
        largest : float, default=0.25
            Error at the right end, in units of sqrt(area).
        **kwargs : dict
            Of the line.

        Returns
        -------
        ErrorCurveDisplay
            Itself.
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
