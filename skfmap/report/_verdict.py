"""What the figures of a model mean, in sentences: good, doubtful, or bad."""

from collections.abc import Iterator
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from scipy.stats import spearmanr

from skfmap._tools.ties import ROUNDING, is_constant
from skfmap._tools.types import BoolArray, FloatArray
from skfmap.functional.optimize import LOG_WEIGHT_BOUND
from skfmap.learner import WeightedFunctionalMapLearner
from skfmap.metrics import PairErrors
from skfmap.report._evaluation import Evaluation

__all__ = [
    "Finding",
    "expected_and_true",
    "findings_of_evaluation",
    "findings_of_model",
    "trusted_part",
]

# Thresholds are stated beside the figures. They were chosen by `python
# tests/benchmarks/verdicts.py`: cats, people, animals and creatures, before and after refinement,
# some with few or wrong pairs.

# Errors in units of sqrt(area): below the first, labels can be transferred; above the second,
# hardly a limb. Sound collections of one kind of body are at 0.045 and less; mixed kinds, wrong
# pairs and bodies without features above 0.1.
_GOOD, _BAD = 0.05, 0.10
# An edge of a mesh of 5,000 vertices: errors below are as good as none.
_EDGE = 0.015
# A shape stands out if its error is so many times the median. Sound shapes are at 1.5 and less.
_OUTLIER = 2.5
# One side fits clearly better than the other if its error is below this share of the other's.
_CLEARLY = 0.7
# Learned weights help if they take away this share of the error at least.
_HELPS = 0.05
# Expected errors are believed if their mean is that near to the true mean, as a ratio. Sound ones
# are at 0.8 to 1.2.
_BELIEVED = 1.35
# Rank correlation of expected with true errors, from which expected errors tell good points from
# bad: the half of the points that is trusted more then has at most four fifths of the mean error,
# on every collection that was tried. Near the second it has nine tenths on creatures, and trusting
# it gains next to nothing.
_TELLS, _TELLS_LITTLE = 0.35, 0.15
# A logarithm of a weight that is so near to its bound is on it but for rounding, and a share of
# weights there that is worth a word: a guess that was never varied.
_AT_BOUND, _MANY = 1e-6, 0.25


Level: TypeAlias = Literal["good", "doubtful", "bad"]


class Finding(NamedTuple):
    """A sentence, and whether it is "good", "doubtful" or "bad" news."""

    level: Level
    text: str


def findings_of_model(learner: WeightedFunctionalMapLearner) -> list[Finding]:
    """Return what a fitted learner says of itself."""
    return [*_convergence(learner), *_weights_at_bounds(learner), *_calibration(learner)]


def findings_of_evaluation(
    learner: WeightedFunctionalMapLearner, evaluation: Evaluation
) -> list[Finding]:
    """Return what the shapes left out say, the most important first."""
    scored = [i for i, errors in enumerate(evaluation.errors) if np.isfinite(errors.mean())]
    if not scored:
        return [
            Finding(
                "doubtful",
                "No shape left out has known correspondences: nothing says how far to trust it.",
            )
        ]
    errors = [evaluation.errors[i] for i in scored]
    naive = [evaluation.naive_errors[i] for i in scored if evaluation.naive_errors]
    names = [evaluation.matches[i].name or f"shape {i}" for i in scored]
    means = np.array([one.mean() for one in errors])
    return [
        _size_of_errors(means, names),
        *_sides(errors, names),
        *_outliers(means, names),
        *_learning(means, naive, learner),
        *_expectation(evaluation),
    ]


def expected_and_true(evaluation: Evaluation) -> tuple[FloatArray, FloatArray]:
    """Return expected and true errors at all pairs of the shapes left out where both are known."""
    pairs = list(zip(evaluation.matches, evaluation.errors, strict=True))
    expected = np.concatenate(
        [
            np.full(len(errors.vertices), np.nan)
            if match.expected_error is None
            else match.expected_error[errors.vertices]
            for match, errors in pairs
        ]
    )
    true = np.concatenate([errors.direct for _, errors in pairs])
    known = np.isfinite(expected) & np.isfinite(true)
    return expected[known], true[known]


def trusted_part(expected: FloatArray) -> BoolArray:
    """Return the half of the points with the lower expected errors, and all that equal them.

    Errors that differ by rounding only are equal.
    """
    return np.asarray(expected <= np.median(expected) + ROUNDING * np.abs(expected).max())


def _size_of_errors(means: FloatArray, names: list[str]) -> Finding:
    mean, worst = float(means.mean()), int(means.argmax())
    level: Level = "good" if mean < _GOOD else "doubtful" if mean < _BAD else "bad"
    scale = f"below {100 * _GOOD:g} % is good, above {100 * _BAD:g} % bad"
    if len(means) == 1:
        return Finding(
            "doubtful" if level == "good" else level,
            f"On {names[0]}, the only shape left out of the training, points land "
            f"{100 * mean:.1f} % of sqrt(area) from where they belong, on average ({scale}). One "
            "shape says little of others.",
        )
    return Finding(
        level,
        f"On {len(means)} shapes left out of the training, points land {100 * mean:.1f} % of "
        f"sqrt(area) from where they belong, on average ({scale}); on the worst, {names[worst]}, "
        f"{100 * means[worst]:.1f} %.",
    )


def _sides(errors: list[PairErrors], names: list[str]) -> Iterator[Finding]:
    if any(one.symmetric is None for one in errors):
        return
    sides = [(name, *_errors_of_sides(one)) for name, one in zip(names, errors, strict=True)]
    turned = [name for name, own, other in sides if other < _CLEARLY * own]
    unclear = [name for name, own, other in sides if not own < _CLEARLY * other]
    if turned:
        yield Finding(
            "bad",
            f"Left is taken for right on {len(turned)} of {len(names)} shapes: "
            f"{_some(turned)}. Use probes that tell sides apart (the default families), and "
            "check the winding of these meshes.",
        )
    elif unclear:
        yield Finding(
            "doubtful",
            f"Whether left and right are told apart cannot be told on {len(unclear)} of "
            f"{len(names)} shapes: {_some(unclear)}. Their matches fit one side no better "
            f"than the other: less than {100 * _CLEARLY:g} % of the other side's error would "
            "be clear.",
        )
    else:
        yield Finding("good", "Left and right are told apart on every shape left out.")


def _errors_of_sides(errors: PairErrors) -> tuple[float, float]:
    """Return the mean error against the true and against the symmetric answer.

    Both are of the pairs where both answers are known, and NaN where there are none.
    """
    symmetric = np.asarray(errors.symmetric, dtype=np.float64)
    weights = np.where(np.isnan(symmetric), 0.0, errors.weights)
    if not weights.any():
        return float("nan"), float("nan")
    own, other = (
        float(np.average(e, weights=weights)) for e in (errors.direct, np.nan_to_num(symmetric))
    )
    return own, other


def _outliers(means: FloatArray, names: list[str]) -> Iterator[Finding]:
    far = np.flatnonzero(means > max(_OUTLIER * float(np.median(means)), _EDGE))
    if len(far):
        yield Finding(
            "doubtful",
            f"{_some([names[i] for i in far])} stand{'s' if len(far) == 1 else ''} out with more "
            f"than {_OUTLIER:g} times the median error: look at their pictures below, their "
            "meshes and their correspondences.",
        )


def _learning(
    means: FloatArray, naive: list[PairErrors], learner: WeightedFunctionalMapLearner
) -> Iterator[Finding]:
    if not naive or learner.weighting is None:
        return
    before, after = float(np.mean([one.mean() for one in naive])), float(means.mean())
    text = (
        f"Without learned weights the error would be {100 * before:.1f} %, with them it is "
        f"{100 * after:.1f} %"
    )
    if after <= (1 - _HELPS) * before and before > 0:
        yield Finding("good", text + ".")
    else:
        gained = "more" if after > (1 + _HELPS) * before else "no difference to speak of"
        yield Finding("doubtful", text + f": {gained} (weights help from {100 * _HELPS:g} % less).")


def _expectation(evaluation: Evaluation) -> Iterator[Finding]:
    expected, true = expected_and_true(evaluation)
    if len(expected):
        yield _expected_size(expected, true)
        yield _expected_order(expected, true)
    elif any(match.expected_error is not None for match in evaluation.matches):
        text = "No point has both an expected and a true error: nothing says which to trust."
        yield Finding("doubtful", text)


def _expected_size(expected: FloatArray, true: FloatArray) -> Finding:
    ratio = float(expected.mean() / max(true.mean(), 1e-300))
    text = (
        f"Expected errors are {100 * expected.mean():.1f} % on average where the true ones are "
        f"{100 * true.mean():.1f} %"
    )
    scale = f"(good within a factor of {_BELIEVED:g})"
    if 1 / _BELIEVED < ratio < _BELIEVED:
        return Finding("good", f"{text} {scale}.")
    return Finding("doubtful", f"{text}: they are too {'low' if ratio < 1 else 'high'} {scale}.")


def _expected_order(expected: FloatArray, true: FloatArray) -> Finding:
    """Return whether points of lower expected error are the better ones."""
    if is_constant(expected):
        return Finding(
            "doubtful",
            "Expected errors are the same everywhere: they tell nothing of where points are good.",
        )
    if is_constant(true):
        return Finding(
            "doubtful",
            "True errors are the same everywhere: nothing shows whether expected errors tell good "
            "from bad.",
        )
    ranks = float(spearmanr(expected, true).statistic)
    trusted = 100 * float(true[trusted_part(expected)].mean())
    # Of few points, a higher one may be chance: twice the standard error of points that have
    # nothing in common.
    needed = max(_TELLS, 2 / np.sqrt(len(true) - 1))
    if needed > 1:
        return Finding(
            "doubtful",
            f"{len(true)} points are too few to show whether expected errors tell good points from "
            "bad.",
        )
    figures = (
        f"rank correlation with true errors {ranks:.2f}, good from {needed:.2f}; the half of the "
        f"points that is trusted more is {trusted:.1f} % off, all are {100 * true.mean():.1f} % "
        "off"
    )
    if ranks >= needed:
        return Finding("good", f"Expected errors tell good points from bad ({figures}).")
    if ranks >= _TELLS_LITTLE:
        return Finding(
            "doubtful", f"Expected errors tell good points from bad only in part ({figures})."
        )
    return Finding("bad", f"Expected errors do not tell good points from bad here ({figures}).")


def _convergence(learner: WeightedFunctionalMapLearner) -> Iterator[Finding]:
    if learner.weighting is None:
        return
    if learner.converged_:
        yield Finding("good", f"The search for weights converged in {learner.n_iter_} iterations.")
    else:
        yield Finding(
            "doubtful",
            f"The search for weights stopped after {learner.n_iter_} iterations, before it "
            "converged; raise max_iter.",
        )


def _weights_at_bounds(learner: WeightedFunctionalMapLearner) -> Iterator[Finding]:
    logs = np.abs(np.log(learner.weights_))
    n_bound = int((logs > LOG_WEIGHT_BOUND - _AT_BOUND).sum())
    if learner.weighting is not None and n_bound > _MANY * len(logs):
        yield Finding(
            "doubtful",
            f"{n_bound} of {len(logs)} weights are at the bounds of the search: probes that "
            "hardly matter, or too few training shapes to tell.",
        )


def _calibration(learner: WeightedFunctionalMapLearner) -> Iterator[Finding]:
    if learner.confidence_ is None:
        yield Finding(
            "doubtful",
            "Expected errors were switched off (confidence=None), so nothing says which points to "
            "trust. Fit with confidence='cross-fit'.",
        )
    elif any(not one.cross_validated for one in getattr(learner, "error_models_", {}).values()):
        yield Finding(
            "doubtful",
            "Only one shape beside the reference was there to learn from: expected errors are "
            "those of the training, and too optimistic.",
        )


def _some(names: list[str], most: int = 5) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
