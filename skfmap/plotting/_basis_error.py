"""Error of each function of Y under the learned map (equation 5; figure 5, left)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator

from skfmap._tools.unwrap import learner_and_shapes
from skfmap.metrics import basis_error
from skfmap.plotting._axes import axes_or_new, finish, of_known_shapes
from skfmap.shapes import Correspondence

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["BasisErrorDisplay"]


class BasisErrorDisplay:
    """Plot of the error (5) of the functions of Y, the most stable function first.

    If the order of stability learned in training also holds for the shapes drawn, the curve rises.

    Parameters
    ----------
    errors : array-like of shape (n_shapes, k)
        Norm of (X_i(D) - C_i) y_j for each shape and function, the most stable function first.
    name : str, optional
        Name of the curve in the legend.

    Attributes
    ----------
    ax_ : matplotlib Axes
        Axes with the curve.
    figure_ : matplotlib Figure
        Figure that contains the axes.
    line_ : matplotlib Line2D
        The curve: the mean over the shapes.

    See Also
    --------
    skfmap.metrics.basis_error : Compute the errors without drawing them.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.plotting import BasisErrorDisplay
    >>> Y = np.eye(3)
    >>> display = BasisErrorDisplay.from_predictions(np.eye(3), np.diag([1.0, 0.75, 0.5]), Y)
    >>> display.errors.tolist()
    [[0.0, 0.25, 0.5]]
    """

    def __init__(self, errors: ArrayLike, *, name: str | None = None) -> None:
        self.errors = errors
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
        """Draw the errors of a fitted model on shapes with known correspondences.

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
        BasisErrorDisplay
            The display.
        """
        learner, shapes = learner_and_shapes(model, X)
        maps, known = learner.functional_maps(shapes), learner.ground_truth_maps(shapes, y)
        return cls.from_predictions(maps, known, learner.stable_basis_, name=name, ax=ax, **kwargs)

    @classmethod
    def from_predictions(
        cls,
        maps: ArrayLike,
        known_maps: ArrayLike,
        stable_basis: ArrayLike,
        *,
        name: str | None = None,
        ax: "Axes | None" = None,
        **kwargs: Any,
    ) -> Self:
        """Draw the errors of functional maps, given the known maps.

        Parameters
        ----------
        maps, known_maps : array-like of shape (k, k) or (n_shapes, k, k)
            X_i(D) and C_i, from functions on the reference to functions on each shape.
        stable_basis : array-like of shape (k, k)
            Y, the most stable function first.
        name, ax, **kwargs : optional
            As in `from_estimator`.

        Returns
        -------
        BasisErrorDisplay
            The display.
        """
        maps, known_maps, Y = (
            np.asarray(array, dtype=np.float64) for array in (maps, known_maps, stable_basis)
        )
        differences = of_known_shapes((maps - known_maps).reshape(-1, *maps.shape[-2:]))
        errors = [
            basis_error(difference, np.zeros_like(difference), Y) for difference in differences
        ]
        return cls(np.stack(errors), name=name).plot(ax, **kwargs)

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
        BasisErrorDisplay
            The display itself.
        """
        errors = np.atleast_2d(self.errors)
        ax = axes_or_new(ax)
        order = np.arange(1, errors.shape[1] + 1)
        (self.line_,) = ax.plot(order, errors.mean(axis=0), label=name or self.name, **kwargs)
        finish(
            ax,
            xlabel="function of the stable basis, most stable first",
            ylabel="error of its image, equation (5)",
            xlim=(1, errors.shape[1]),
            ylim=(0, None),
        )
        self.ax_, self.figure_ = ax, ax.figure
        return self
