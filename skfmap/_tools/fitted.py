"""Documented attributes of a fitted estimator, read from the objects that hold them."""

from operator import attrgetter
from typing import Any

__all__ = ["fitted_attribute"]


def fitted_attribute(path: str) -> Any:
    """Return an attribute that is read from a part of the fitted state; annotate it when set.

    Parameters
    ----------
    path : str
        Where it is read from, for instance ``"matcher_.weights"``.
    """
    return _FittedAttribute(path)


class _FittedAttribute:
    """An attribute read from a part of the fitted state, which does not exist before `fit`."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, estimator: object, owner: type | None = None) -> Any:
        """Return the value; AttributeError before `fit`, or where a part does not have it."""
        if estimator is None:
            return self
        try:
            return attrgetter(self.path)(estimator)
        except AttributeError:
            holder = self.path.partition(".")[0]
            held = vars(estimator).get(holder, estimator)
            why = "it is not fitted" if held is estimator else f"its {holder} {held!r} has none"
            raise AttributeError(
                f"{type(estimator).__name__} has no attribute {self.name!r}: {why}."
            ) from None

    def __set__(self, estimator: Any, value: object) -> None:
        """Refuse: a value set here would not be what is matched with."""
        raise AttributeError(f"{self.name} is read from {self.path}, and cannot be set.")
