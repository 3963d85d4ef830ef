"""Findings on a model, in sentences rated good, doubtful or bad."""

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

# The texts state the thresholds. These were chosen with tests/benchmarks/verdicts.py on cats,
# people, animals and creatures, before and after refinement, some with few or wrong pairs.

# Errors in units of sqrt(area). Below the first, labels can be transferred; above the second, not
# even limbs. Sound collections of one kind of body have 0.045 or less; mixed kinds, wrong pairs and
# bodies without features have more than 0.1.
_GOOD, _BAD = 0.05, 0.10
# An edge length of a mesh of 5,000 vertices; smaller errors are negligible.
_EDGE = 0.015
# Ratio to the median error above which a shape is an outlier. Sound shapes have at most 1.5.
_OUTLIER = 2.5
# One side fits clearly better if its error is below this fraction of the other side's.
_CLEARLY = 0.7
# Learned weights help if they reduce the error by at least this fraction.
_HELPS = 0.05
# Largest factor between the means of expected and true errors. Sound models have 0.8 to 1.2.
_BELIEVED = 1.35
# Rank correlations of expected with true errors. From the first on, the more trusted half of the
# points has at most 4/5 of the mean error on every collection tried. Near the second it has 9/10 on
# creatures, so that trusting it gains very little.
_TELLS, _TELLS_LITTLE = 0.35, 0.15
# Distance of the logarithm of a weight from its bound that is due to rounding, and the fraction of
# weights at a bound that is worth reporting; the latter is a guess that was never varied.
_AT_BOUND, _MANY = 1e-6, 0.25


Level: TypeAlias = Literal["good", "doubtful", "bad"]


class Finding(NamedTuple):
    """A sentence, rated "good", "doubtful" or "bad"."""

    level: Level
    text: str


def findings_of_model(learner: WeightedFunctionalMapLearner) -> list[Finding]:
    """Return findings on a fitted learner that need no evaluation."""
    return [*_convergence(learner), *_weights_at_bounds(learner), *_calibration(learner)]


def findings_of_evaluation(
    learner: WeightedFunctionalMapLearner, evaluation: Evaluation
) -> list[Finding]:
    """Return findings on an evaluation, the most important first."""
    scored = [i for i, errors in enumerate(evaluation.errors) if np.isfinite(errors.mean())]
    if not scored:
        return [
            Finding(
                "doubtful",
                "No shape left out has known correspondences, so the accuracy of the model is not "
                "known.",
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
    """Return expected and true errors at all pairs for which both are known."""
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
    """Return a mask of the half of the points with the lowest expected errors.

    Points that equal the median, up to rounding, are included.
    """
    return np.asarray(expected <= np.median(expected) + ROUNDING * np.abs(expected).max())


def _size_of_errors(means: FloatArray, names: list[str]) -> Finding:
    mean, worst = float(means.mean()), int(means.argmax())
    level: Level = "good" if mean < _GOOD else "doubtful" if mean < _BAD else "bad"
    scale = f"below {100 * _GOOD:g} % is good, above {100 * _BAD:g} % bad"
    if len(means) == 1:
        return Finding(
            "doubtful" if level == "good" else level,
            f"On {names[0]}, the only shape left out of the training, the mean error is "
            f"{100 * mean:.1f} % of sqrt(area) ({scale}). One shape says little about others.",
        )
    return Finding(
        level,
        f"On {len(means)} shapes left out of the training, the mean error is {100 * mean:.1f} % of "
        f"sqrt(area) ({scale}); on the worst, {names[worst]}, it is {100 * means[worst]:.1f} %.",
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
            f"Left and right are exchanged on {len(turned)} of {len(names)} shapes: "
            f"{_some(turned)}. Use probes that distinguish the sides (the default families do), "
            "and check the orientation of the faces of these meshes.",
        )
    elif unclear:
        yield Finding(
            "doubtful",
            f"It is unclear whether left and right are distinguished on {len(unclear)} of "
            f"{len(names)} shapes: {_some(unclear)}. Their matches fit the correct side hardly "
            f"better than the other; an error below {100 * _CLEARLY:g} % of the other side's "
            "would be clear.",
        )
    else:
        yield Finding("good", "Left and right are distinguished on every shape left out.")


def _errors_of_sides(errors: PairErrors) -> tuple[float, float]:
    """Return the mean errors with respect to the true and the symmetric answers.

    Both are means over the pairs for which both answers are known; NaN if there are none.
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
            f"{_some([names[i] for i in far])} ha{'s' if len(far) == 1 else 've'} more than "
            f"{_OUTLIER:g} times the median error. Check the pictures below, the meshes and the "
            "correspondences.",
        )


def _learning(
    means: FloatArray, naive: list[PairErrors], learner: WeightedFunctionalMapLearner
) -> Iterator[Finding]:
    if not naive or learner.weighting is None:
        return
    before, after = float(np.mean([one.mean() for one in naive])), float(means.mean())
    text = (
        f"The mean error is {100 * after:.1f} % with learned weights and {100 * before:.1f} % "
        "without them"
    )
    if after <= (1 - _HELPS) * before and before > 0:
        yield Finding("good", text + ".")
    else:
        gained = "they make it worse" if after > (1 + _HELPS) * before else "they do not help"
        yield Finding("doubtful", text + f": {gained} (good is {100 * _HELPS:g} % less, or more).")


def _expectation(evaluation: Evaluation) -> Iterator[Finding]:
    expected, true = expected_and_true(evaluation)
    if len(expected):
        yield _expected_size(expected, true)
        yield _expected_order(expected, true)
    elif any(match.expected_error is not None for match in evaluation.matches):
        text = "No point has both an expected and a true error, so expected errors are not tested."
        yield Finding("doubtful", text)


def _expected_size(expected: FloatArray, true: FloatArray) -> Finding:
    ratio = float(expected.mean() / max(true.mean(), 1e-300))
    text = (
        f"The mean expected error is {100 * expected.mean():.1f} %, and the mean true error is "
        f"{100 * true.mean():.1f} %"
    )
    scale = f"(good within a factor of {_BELIEVED:g})"
    if 1 / _BELIEVED < ratio < _BELIEVED:
        return Finding("good", f"{text} {scale}.")
    return Finding(
        "doubtful", f"{text}: expected errors are too {'low' if ratio < 1 else 'high'} {scale}."
    )


def _expected_order(expected: FloatArray, true: FloatArray) -> Finding:
    """Return a finding on whether points with lower expected errors have lower true errors."""
    if is_constant(expected):
        return Finding(
            "doubtful",
            "Expected errors are the same everywhere, so they do not distinguish good points from "
            "bad.",
        )
    if is_constant(true):
        return Finding(
            "doubtful",
            "True errors are the same everywhere, so it is not known whether expected errors "
            "distinguish good points from bad.",
        )
    ranks = float(spearmanr(expected, true).statistic)
    trusted = 100 * float(true[trusted_part(expected)].mean())
    # With few points a high correlation may be chance: require twice the standard error of the
    # correlation of independent values.
    needed = max(_TELLS, 2 / np.sqrt(len(true) - 1))
    if needed > 1:
        return Finding(
            "doubtful",
            f"{len(true)} points are too few to show whether expected errors distinguish good "
            "points from bad.",
        )
    figures = (
        f"rank correlation with true errors {ranks:.2f}, good from {needed:.2f}; mean error of the "
        f"more trusted half of the points {trusted:.1f} %, of all points "
        f"{100 * true.mean():.1f} %"
    )
    if ranks >= needed:
        return Finding("good", f"Expected errors distinguish good points from bad ({figures}).")
    if ranks >= _TELLS_LITTLE:
        return Finding(
            "doubtful", f"Expected errors only partly distinguish good points from bad ({figures})."
        )
    return Finding("bad", f"Expected errors do not distinguish good points from bad ({figures}).")


def _convergence(learner: WeightedFunctionalMapLearner) -> Iterator[Finding]:
    if learner.weighting is None:
        return
    if learner.converged_:
        yield Finding("good", f"The search for weights converged in {learner.n_iter_} iterations.")
    else:
        yield Finding(
            "doubtful",
            f"The search for weights stopped after {learner.n_iter_} iterations without "
            "converging. Raise max_iter.",
        )


def _weights_at_bounds(learner: WeightedFunctionalMapLearner) -> Iterator[Finding]:
    logs = np.abs(np.log(learner.weights_))
    n_bound = int((logs > LOG_WEIGHT_BOUND - _AT_BOUND).sum())
    if learner.weighting is not None and n_bound > _MANY * len(logs):
        yield Finding(
            "doubtful",
            f"{n_bound} of {len(logs)} weights are at the bounds of the search: either these "
            "probes hardly matter, or there are too few training shapes to find their weights.",
        )


def _calibration(learner: WeightedFunctionalMapLearner) -> Iterator[Finding]:
    if learner.confidence_ is None:
        yield Finding(
            "doubtful",
            "Expected errors were switched off (confidence=None), so it is not known which points "
            "to trust. Fit with confidence='cross-fit'.",
        )
    elif any(not one.cross_validated for one in getattr(learner, "error_models_", {}).values()):
        yield Finding(
            "doubtful",
            "There is only one training shape besides the reference: expected errors are training "
            "errors, and too optimistic.",
        )


def _some(names: list[str], most: int = 5) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
