"""Documented attributes of a fitted estimator, read from the objects that hold them."""

from operator import attrgetter
from typing import Any

__all__ = ["FittedAttribute"]


class FittedAttribute:
    """An attribute that is read from a part of the fitted state, and does not exist before `fit`.

    Parameters
    ----------
    path : str
        Where it is read from, for instance ``"matcher_.weights"``.
    """

    def __init__(self, path: str) -> None:
        self.path = path

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, estimator: Any, owner: type | None = None) -> Any:
        """Return the value; AttributeError before `fit`, or where the part is switched off."""
        if estimator is None:
            return self
        try:
            return attrgetter(self.path)(estimator)
        except AttributeError:
            raise AttributeError(
                f"{type(estimator).__name__} has no attribute {self.name!r}: it is not fitted, or {self.path!r} is "
                "switched off."
            ) from None
