"""Exchangeable parts of the learner, given as a word, an object, or None to switch one off."""

import pickle
from collections.abc import Mapping
from typing import Any, TypeVar, cast

import joblib
from sklearn.base import clone

from skfmap._tools.part import Part

__all__ = ["check_part_is_object", "fit_part", "make_part", "same_part"]

_Kind = TypeVar("_Kind", bound=Part)


def make_part(
    value: object, name: str, words: Mapping[str, type[_Kind]], kind: type
) -> _Kind | None:
    """Return the part that a parameter stands for, with its own parameters checked.

    Parameters
    ----------
    value : str, Part or None
        The value of the parameter; None is returned unchanged.
    name : str
        The name of the parameter.
    words : dict
        The class that each word stands for.
    kind : type
        The class that an object must be derived from.

    Raises
    ------
    ValueError
        If the value is neither a known word, nor None, nor an object of this class.
    """
    if value is None:
        return None
    if isinstance(value, str) and value in words:
        return words[value]()
    if not isinstance(value, kind):
        told = ", ".join(map(repr, sorted(words)))
        hint = f" Did you mean {value.__name__}()?" if isinstance(value, type) else ""
        raise ValueError(
            f"{name} must be one of {told}, None, or an object derived from {kind.__name__}; got "
            f"{value!r}.{hint}"
        )
    part = cast(_Kind, value)
    part.check_parameters()
    return part


def fit_part(part: _Kind | None, training: object, matcher: object) -> _Kind | None:
    """Return a fitted clone of a part; None is returned unchanged."""
    if part is None:
        return None
    fitted: _Kind = clone(part)
    fitted.fit(training, matcher)
    return fitted


def same_part(one: Part | None, other: Part | None) -> bool:
    """Return whether two parts have the same class and equal parameters."""
    if one is other or one is None or other is None:
        return one is other
    if type(one) is not type(other):
        return False
    try:
        return bool(joblib.hash(one.get_params()) == joblib.hash(other.get_params()))
    except (pickle.PicklingError, AttributeError, TypeError):
        return False  # parameters that cannot be compared


def check_part_is_object(
    params: Mapping[str, object],
    current: Mapping[str, object],
    words: Mapping[str, Mapping[str, type[Any]]],
) -> None:
    """Raise if ``name__parameter`` is set while ``name`` is a word, a class or None."""
    for key in params:
        name, _, inner = key.partition("__")
        value = params.get(name, current.get(name))
        if not inner or name not in words or isinstance(value, Part):
            continue
        meant = words[name].get(value) if isinstance(value, str) else value
        classes = [meant] if isinstance(meant, type) else [*words[name].values()]
        told = " or ".join(
            f"{name}={one.__name__}() (its parameters: {', '.join(one().get_params())})"
            for one in classes
        )
        raise ValueError(
            f"{key} cannot be set while {name} is {value!r}; give the object instead: {told}."
        )
