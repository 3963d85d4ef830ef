"""The base class of families of probe functions."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Self

import numpy as np
from sklearn.base import BaseEstimator

from skfmap._tools.stateless import StatelessShapeTransformer
from skfmap._tools.types import FloatArray
from skfmap._tools.validation import check_number, check_samples, label
from skfmap.shapes import SkippedShape, SpectralShape
from skfmap.shapes.usable import pick_usable

__all__ = ["ProbeFamily", "check_range", "check_spectral", "finite_coefficients"]


class ProbeFamily(StatelessShapeTransformer, BaseEstimator, ABC):
    """Base class of families of probe functions; derive from it to add your own.

    A family is stateless: its scales are constants at unit area, so that a probe has the same
    meaning on every shape. Subclasses store parameters in ``__init__`` and implement
    `check_parameters`, `labels` and `coefficients`.
    """

    @abstractmethod
    def check_parameters(self) -> None:
        """Raise ValueError or TypeError if a parameter is invalid."""

    @abstractmethod
    def labels(self) -> list[str]:
        """Return a unique label for each function of the family."""

    @abstractmethod
    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the raw coefficients of the functions, shape (n_components, n_functions)."""

    def fit(self, X: Sequence[SpectralShape], y: object = None) -> Self:  # noqa: ARG002
        """Check the parameters, without learning anything."""
        self.check_parameters()
        return self

    def transform(self, X: Sequence[SpectralShape]) -> list[FloatArray]:
        """Return the coefficients of the functions on each shape, without skipped shapes.

        Each array has shape (n_components, n_functions).
        """
        self.check_parameters()
        return [finite_coefficients(self, shape) for shape in pick_usable(check_spectral(X)).shapes]


def check_range(
    n: object,
    low: object,
    high: object,
    low_name: str,
    high_name: str,
    *,
    count: str = "n_functions",
    least: int = 1,
) -> None:
    """Raise unless a count and the ends of a range are valid."""
    check_number(n, count, low=least, integer=True)
    check_number(low, low_name, low=0, strict=True)
    check_number(high, high_name, low=0, strict=True)
    if float(high) < float(low):  # type: ignore[arg-type]
        raise ValueError(f"{high_name} must be at least {low_name}; got {high} and {low}.")


def finite_coefficients(family: ProbeFamily, shape: SpectralShape) -> FloatArray:
    """Return the coefficients of a family; raise if they are not finite."""
    coefficients = np.asarray(family.coefficients(shape))
    if not np.isfinite(coefficients).all():
        raise ValueError(
            f"{family!r} returns probe functions with NaN or infinite coefficients on "
            f"{label(shape.name, 'shape')}; check its parameters, and the mesh with check_mesh."
        )
    return coefficients


def check_spectral(X: object) -> Sequence[SpectralShape]:
    """Return the shapes of ``X``; raise unless they are a sequence of spectral shapes."""
    if isinstance(X, SpectralShape):
        raise TypeError("X is one spectral shape, not a sequence of them; wrap it in a list: [X].")
    shapes = check_samples(X, "spectral shapes")
    for i, shape in enumerate(shapes):
        if not isinstance(shape, (SpectralShape, SkippedShape)):
            raise TypeError(
                f"X[{i}] is a {type(shape).__name__}, not a SpectralShape; put SpectralBasis "
                "before this step."
            )
    return shapes
