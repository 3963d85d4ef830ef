"""How much of the function space is mapped well (figure 3, right)."""

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
    """Share of the singular values of X(D) - C that are below a threshold.

    A perfect functional map has all of them at 0.

    Parameters
    ----------
    singular_values : array-like of shape (n_shapes, k)
        Of the difference between each functional map and the known one.
    name : str, optional
        What the curve is called in the legend.

    Attributes
    ----------
    ax_, figure_, line_ : matplotlib Axes, Figure, Line2D
        What was drawn.

    See Also
    --------
    BasisErrorDisplay : Which functions are mapped well.
    skfmap.metrics.singular_value_profile : The same numbers.

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
        """Draw how well a fitted model maps shapes of known correspondence.

        Parameters
        ----------
        model : WeightedFunctionalMapLearner, Pipeline or fitted search
            The model.
        X, y : sequence, sequence of correspondences
            Shapes that it was not trained on, and where they lie on the template.
        name : str, optional
            In the legend.
        ax : matplotlib Axes, optional
            Where to draw; a new figure by default.
        **kwargs : dict
            Of the line.

        Returns
        -------
        SingularValuesDisplay
            What was drawn.
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
        """Draw how far functional maps are from known ones.

        Parameters
        ----------
        maps, known_maps : array-like of shape (k, k) or (n_shapes, k, k)
            X_i(D) and C_i, from functions on the reference to functions on each shape.
        name, ax, **kwargs : optional
            As in `from_estimator`.

        Returns
        -------
        SingularValuesDisplay
            What was drawn.
        """
        difference = of_known_shapes(np.asarray(maps) - np.asarray(known_maps))
        values = np.linalg.svd(difference, compute_uv=False)
        return cls(np.atleast_2d(values), name=name).plot(ax, **kwargs)

    def plot(self, ax: "Axes | None" = None, *, name: str | None = None, **kwargs: Any) -> Self:
        """Draw the curve, up to 98 % of the values or 1; several may share axes.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; a new figure by default.
        name : str, optional
            In the legend.
        **kwargs : dict
            Of the line.

        Returns
        -------
        SingularValuesDisplay
            Itself.
        """
        values: FloatArray = np.sort(np.ravel(self.singular_values))
        # The few largest values would squeeze all others into a corner.
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
