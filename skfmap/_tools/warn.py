"""Warnings that point at the line of the caller, whichever way a call came in."""

import sys
import warnings

__all__ = ["warn"]

# A warning is about a line that somebody wrote: none of this package, nor of what calls it.
_NOT_THE_CALLER = {
    "concurrent",
    "joblib",
    "multiprocessing",
    "pickle",
    "skfmap",
    "sklearn",
    "skops",
}


def warn(message: str, category: type[Warning]) -> None:
    """Warn at the first line up the stack that belongs neither to this package nor to a library.

    The route makes no difference: a learner's method, a Pipeline, a search, `skfmap.match`, the
    wrapper of scikit-learn's callbacks, a file that is loaded. In a thread of a pool there is no
    caller to point at.
    """
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and _top_module(frame.f_globals) in _NOT_THE_CALLER:
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)


def _top_module(names: dict[str, object]) -> str:
    return str(names.get("__name__", "")).partition(".")[0]
