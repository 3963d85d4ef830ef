"""Parts that can be exchanged: a parameter takes a word, an object, or None, which switches the part off."""

from collections.abc import Callable, Mapping
from typing import Any

from sklearn.base import clone

from skfmap._tools.validation import check_choice

__all__ = ["check_part_is_object", "fit_part", "make_part", "same_part"]


def make_part(value: Any, name: str, words: Mapping[str, Callable[[], Any]], method: str) -> Any:
    """Return the object that a parameter stands for, fresh and unfitted, or None.

    Parameters
    ----------
    value : str, object or None
        What was given.
    name : str
        Of the parameter.
    words : dict
        What makes the object that a word stands for.
    method : str
        The method that an object must have.
    """
    if value is None:
        return None
    if isinstance(value, (str, type)) or not hasattr(value, method):
        return words[check_choice(value, name, (None, *words))]()
    return clone(value)


def fit_part(part: Any, training: Any, matcher: Any) -> Any:
    """Return a fitted clone of a part; None stays None."""
    return None if part is None else clone(part).fit(training, matcher)


def same_part(one: Any, other: Any) -> bool:
    """Tell whether two parts do the same: of one class, with equal parameters."""
    if one is None or other is None:
        return one is other
    return type(one) is type(other) and repr(one.get_params()) == repr(other.get_params())


def check_part_is_object(
    params: Mapping[str, Any], current: Mapping[str, Any], words: Mapping[str, Mapping[str, Any]]
) -> None:
    """Raise where ``name__parameter`` is set while the part ``name`` is a word, or off."""
    for key in params:
        name, _, inner = key.partition("__")
        value = params.get(name, current.get(name))
        if inner and name in words and (value is None or isinstance(value, str)):
            example = words[name].get(value or "", next(iter(words[name].values())))
            raise ValueError(
                f"{key} cannot be set while {name} is {value!r}: give the object instead of the word, for instance "
                f"{name}={example.__name__}()."
            )
