"""Singular values of the error of functional maps (figure 3, right)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator

from skfmap._tools.types import FloatArray
from skfmap._tools.unwrap import learner_and_shapes
from skfmap.metrics import error_curve
from skfmap.plotting._axes import axes_or_new, finish, of_known_shapes
from skfmap.shapes import Correspondence

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SingularValuesDisplay"]


class SingularValuesDisplay:
    """Plot of the percentage of singular values of X(D) - C that are below a threshold.

    All singular values of a perfect functional map are 0.

    Parameters
    ----------
    singular_values : array-like of shape (n_shapes, k)
        Singular values of the difference between each functional map and the known map.
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
    BasisErrorDisplay : Show which functions are mapped well.
    skfmap.metrics.singular_value_profile : Compute the curve without drawing it.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.plotting import SingularValuesDisplay
    >>> display = SingularValuesDisplay.from_predictions(np.eye(4), np.diag([1.0, 1.0, 0.5, 0.0]))
    >>> display.singular_values.tolist()
    [[1.0, 0.5, 0.0, 0.0]]
    """

    def __init__(self, singular_values: ArrayLike, *, name: str | None = None) -> None:
        self.singular_values = singular_values
        self.name = name

    @classmethod
    def from_estimator(
        cls,
        model: BaseEstimator,
        X: Sequence[Any],
        y: Sequence[Correspondence | ArrayLike],
        *,
        name: str | None = None,
        ax: "Axes | None" = None,
        **kwargs: Any,
    ) -> Self:
        """Draw the singular values for a fitted model and shapes with known correspondences.

        Parameters
        ----------
        model : WeightedFunctionalMapLearner, Pipeline or fitted search
            Fitted model.
        X : sequence of shapes
            Shapes that the model was not trained on.
        y : sequence of correspondences
            Correspondence of each shape with the template.
        name : str, optional
            Name of the curve in the legend.
        ax : matplotlib Axes, optional
            Axes to draw on; those of a new figure by default.
        **kwargs : dict
            Properties of the line, passed to matplotlib.

        Returns
        -------
        SingularValuesDisplay
            The display.
        """
        learner, shapes = learner_and_shapes(model, X)
        maps, known = learner.functional_maps(shapes), learner.ground_truth_maps(shapes, y)
        return cls.from_predictions(maps, known, name=name, ax=ax, **kwargs)

    @classmethod
    def from_predictions(
        cls,
        maps: ArrayLike,
        known_maps: ArrayLike,
        *,
        name: str | None = None,
        ax: "Axes | None" = None,
        **kwargs: Any,
    ) -> Self:
        """Draw the singular values for functional maps and the known maps.

        Parameters
        ----------
        maps, known_maps : array-like of shape (k, k) or (n_shapes, k, k)
            X_i(D) and C_i, from functions on the reference to functions on each shape.
        name, ax, **kwargs : optional
            As in `from_estimator`.

        Returns
        -------
        SingularValuesDisplay
            The display.
        """
        difference = of_known_shapes(np.asarray(maps) - np.asarray(known_maps))
        values = np.linalg.svd(difference, compute_uv=False)
        return cls(np.atleast_2d(values), name=name).plot(ax, **kwargs)

    def plot(self, ax: "Axes | None" = None, *, name: str | None = None, **kwargs: Any) -> Self:
        """Draw the curve; several curves can share axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; those of a new figure by default.
        name : str, optional
            Name of the curve in the legend.
        **kwargs : dict
            Properties of the line, passed to matplotlib.

        Returns
        -------
        SingularValuesDisplay
            The display itself.

        Notes
        -----
        The curve ends at the 98th percentile of the singular values, or at 1 if that is larger.
        """
        values: FloatArray = np.sort(np.ravel(self.singular_values))
        # A few very large values would otherwise compress the rest of the curve.
        thresholds = np.linspace(0, max(1.0, float(np.quantile(values, 0.98))), 200)
        ax = axes_or_new(ax)
        (self.line_,) = ax.plot(
            thresholds, 100 * error_curve(values, thresholds), label=name or self.name, **kwargs
        )
        finish(
            ax,
            xlabel="singular value of X(D) - C",
            ylabel="singular values below, %",
            xlim=(0, None),
            ylim=(0, 101),
        )
        self.ax_, self.figure_ = ax, ax.figure
        return self
