"""Warnings that point at the line of the caller, whichever way a call came in."""

import os
import sys
import warnings

import joblib
import sklearn

__all__ = ["warn"]

# A warning is about a line that somebody wrote: none of this package, nor of the libraries that call it.
_NOT_THE_CALLER = tuple(
    os.path.join(os.path.dirname(path), "") for path in (os.path.dirname(__file__), sklearn.__file__, joblib.__file__)
)


def warn(message: str, category: type[Warning]) -> None:
    """Warn at the first line up the stack that belongs neither to this package nor to scikit-learn nor joblib.

    The route makes no difference: a learner's method, a Pipeline, a search, `skfmap.match`, the wrapper of
    scikit-learn's callbacks.
    """
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_NOT_THE_CALLER):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)
