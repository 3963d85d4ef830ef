"""Parameters of the learner: their valid values, and the objects that words stand for."""

from dataclasses import replace
from typing import Any, Literal, Protocol

import numpy as np

from skfmap._tools.part import Part
from skfmap._tools.types import (
    Confidences,
    KnownMapsWord,
    Matching,
    Normalize,
    OnMirrored,
    RaiseOrSkip,
    RefineWord,
    RegularizerWord,
    Weighting,
)
from skfmap._tools.validation import check_choice, check_number
from skfmap.functional.regularization import LEARNED, REGULARIZERS, Regularizer
from skfmap.functional.weighting import WEIGHTINGS
from skfmap.known_maps import KNOWN_MAPS, KnownMaps
from skfmap.learner.confidence import Confidence, CrossFitConfidence
from skfmap.learner.matcher import MATCHINGS, Matcher
from skfmap.learner.parts import make_part, same_part
from skfmap.learner.training_set import LearningOptions
from skfmap.refinement import REFINEMENTS, Refinement
from skfmap.registration import Registration

__all__ = [
    "WORDS",
    "Parameters",
    "changed",
    "check_parameters",
    "confidence_of",
    "count_stable",
    "known_maps_of",
    "learning_options",
    "refinement_of",
]

_REFINEMENTS: dict[str, type[Refinement]] = {**REFINEMENTS, "register": Registration}
_CONFIDENCES: dict[str, type[Confidence]] = {"cross-fit": CrossFitConfidence}
WORDS: dict[str, dict[str, type[Any]]] = {
    "refine": _REFINEMENTS,
    "confidence": _CONFIDENCES,
    "known_maps": KNOWN_MAPS,
}
"""The classes that words stand for, for each parameter that takes a part."""


class Parameters(Protocol):
    """The parameters that the learner's constructor stores."""

    n_functions: int
    weighting: Weighting
    epsilon: float | Literal["auto"]
    alpha: float
    regularizer: RegularizerWord | Regularizer
    normalize: Normalize
    n_stable: float | None
    matching: Matching
    refine: RefineWord | Refinement | None
    confidence: Confidences | Confidence | None
    known_maps: KnownMapsWord | KnownMaps | None
    reference: str
    on_invalid: RaiseOrSkip
    on_mirrored: OnMirrored
    max_iter: int
    tol: float


def check_parameters(given: Parameters) -> None:
    """Raise ValueError or TypeError if a parameter is invalid."""
    check_number(given.n_functions, "n_functions", low=2, integer=True)
    if isinstance(given.weighting, str) or given.weighting is None:
        check_choice(given.weighting, "weighting", WEIGHTINGS)
    if isinstance(given.epsilon, str):
        check_choice(given.epsilon, "epsilon", ("auto",))
    else:
        check_number(given.epsilon, "epsilon", low=0, strict=True)
    check_number(given.alpha, "alpha", low=0, strict=True)
    if not callable(given.regularizer):
        check_choice(given.regularizer, "regularizer", (*REGULARIZERS, LEARNED))
    check_choice(given.normalize, "normalize", ("shape", "reference"))
    check_choice(given.matching, "matching", MATCHINGS)
    refinement_of(given.refine)
    confidence_of(given.confidence)
    known_maps_of(given.known_maps)
    check_choice(given.on_invalid, "on_invalid", ("raise", "skip"))
    check_choice(given.on_mirrored, "on_mirrored", ("warn", "reflect"))
    if not isinstance(given.reference, str):
        raise ValueError(
            "reference must be 'first', 'medoid' or the name of a training shape; got "
            f"{given.reference!r}."
        )
    check_number(given.max_iter, "max_iter", low=1, integer=True)
    check_number(given.tol, "tol", low=0)
    count_stable(given.n_stable, given.n_functions)


def learning_options(given: Parameters) -> LearningOptions:
    """Return the parameters of learning."""
    names = set(LearningOptions._fields) - {"categories"}
    return LearningOptions(**{name: getattr(given, name) for name in names})


def refinement_of(refine: str | Refinement | None, *, measured: bool = False) -> Refinement | None:
    """Return the refinement that ``refine`` stands for, unfitted.

    ``"auto"`` depends on whether the points of training shapes were ``measured``.
    """
    if isinstance(refine, str) and refine == "auto":
        refine = "register" if measured else "bijective-zoomout"
    return make_part(refine, "refine", _REFINEMENTS, Refinement)


def confidence_of(confidence: str | Confidence | None) -> Confidence | None:
    """Return the part that ``confidence`` stands for, unfitted."""
    return make_part(confidence, "confidence", _CONFIDENCES, Confidence)


def known_maps_of(known_maps: str | KnownMaps | None) -> KnownMaps | None:
    """Return the part that ``known_maps`` stands for; None means the pairs as given."""
    return make_part(known_maps, "known_maps", KNOWN_MAPS, KnownMaps)


def count_stable(n_stable: float | str | None, k: int) -> int:
    """Return p, the number of stable functions."""
    if n_stable is None:
        return max(1, k // 2)
    if isinstance(n_stable, (int, np.integer)):
        return int(check_number(n_stable, "n_stable", low=1, high=k, integer=True))
    return max(1, round(check_number(n_stable, "n_stable", low=0, high=1, strict=True) * k))


def changed(
    matcher: Matcher,
    *,
    matching: str = "fitted",
    n_stable: float | str | None = "fitted",
    refine: str | Refinement | None = "fitted",
) -> Matcher:
    """Return the matcher with other settings for one call; ``"fitted"`` keeps the fitted ones."""
    settings = matcher.settings
    if matching != "fitted":
        settings = settings._replace(matching=check_choice(matching, "matching", MATCHINGS))
    if not isinstance(n_stable, str) or n_stable != "fitted":
        settings = settings._replace(n_stable=count_stable(n_stable, len(matcher.stable_basis)))
    refinement = _override(refine, matcher.refinement)
    return replace(matcher, settings=settings, refinement=refinement)


def _override(refine: str | Refinement | None, fitted: Refinement | None) -> Refinement | None:
    """Return the refinement for one call: the fitted one, or one that needs no fitting."""
    if isinstance(refine, str) and refine == "fitted":
        return fitted
    asked = make_part(refine, "refine", _REFINEMENTS, Refinement)
    if same_part(asked, fitted):
        return fitted
    if asked is not None and type(asked).fit is not Part.fit:
        raise ValueError(
            f"{asked!r} learns from training shapes; give it to the learner, and fit the learner."
        )
    return asked
