"""What the figures of a model mean, in sentences: good, doubtful, or bad."""

from typing import Any, NamedTuple

import numpy as np
from scipy.stats import spearmanr

from skfmap._typing import FloatArray
from skfmap.functional.optimize import LOG_WEIGHT_BOUND
from skfmap.metrics import PairErrors
from skfmap.report._evaluation import Evaluation

__all__ = ["Finding", "expected_and_true", "findings_of_evaluation", "findings_of_model"]

# Errors in units of sqrt(area): below the first, labels can be transferred; above the second, hardly a limb.
_GOOD, _BAD = 0.05, 0.10
# A shape stands out if its error is so many times the median.
_OUTLIER = 2.5
# Expected errors are believed if their mean is that near to the true mean, as a ratio.
_BELIEVED = 1.35


class Finding(NamedTuple):
    """A sentence, and whether it is "good", "doubtful" or "bad" news."""

    level: str
    text: str


def findings_of_model(learner: Any) -> list[Finding]:
    """Return what a fitted learner says of itself."""
    return [*_convergence(learner), *_weights_at_bounds(learner), *_calibration(learner)]


def findings_of_evaluation(learner: Any, evaluation: Evaluation) -> list[Finding]:
    """Return what the shapes left out say, the most important first."""
    means = np.array([errors.mean() for errors in evaluation.errors])
    names = [match.name or f"shape {i}" for i, match in enumerate(evaluation.matches)]
    return [
        _size_of_errors(means, names),
        *_sides(evaluation.errors, names),
        *_outliers(means, names),
        *_learning(means, evaluation.naive_errors, learner),
        _expectation(evaluation),
    ]


def expected_and_true(evaluation: Evaluation) -> tuple[FloatArray, FloatArray]:
    """Return expected and true errors at all pairs of the shapes left out."""
    pairs = list(zip(evaluation.matches, evaluation.errors, strict=True))
    expected = np.concatenate([match.expected_error[errors.vertices] for match, errors in pairs])
    return expected, np.concatenate([errors.direct for _, errors in pairs])


def _size_of_errors(means: FloatArray, names: list[str]) -> Finding:
    mean, worst = float(means.mean()), int(means.argmax())
    level = "good" if mean < _GOOD else "doubtful" if mean < _BAD else "bad"
    return Finding(
        level,
        f"On {len(means)} shapes left out of the training, points land {100 * mean:.1f} % of sqrt(area) from where "
        f"they belong, on average; on the worst, {names[worst]}, {100 * means[worst]:.1f} %.",
    )


def _sides(errors: list[PairErrors], names: list[str]) -> list[Finding]:
    if any(one.symmetric is None for one in errors):
        return []
    turned = [name for name, one in zip(names, errors, strict=True) if one.mean("consistent") < 0.7 * one.mean()]
    if not turned:
        return [Finding("good", "Left and right are told apart on every shape left out.")]
    return [
        Finding(
            "bad",
            f"Left is taken for right on {len(turned)} of {len(names)} shapes: {_some(turned)}. Use probes that tell "
            "sides apart (the default families), and check the winding of these meshes.",
        )
    ]


def _outliers(means: FloatArray, names: list[str]) -> list[Finding]:
    far = np.flatnonzero(means > _OUTLIER * np.median(means))
    if not len(far):
        return []
    return [
        Finding(
            "doubtful",
            f"{_some([names[i] for i in far])} stand{'s' if len(far) == 1 else ''} out with more than {_OUTLIER:g} "
            "times the median error: look at their pictures below, their meshes and their correspondences.",
        )
    ]


def _learning(means: FloatArray, naive: list[PairErrors], learner: Any) -> list[Finding]:
    if not naive or learner.weighting is None:
        return []
    before, after = float(np.mean([one.mean() for one in naive])), float(means.mean())
    text = f"Without learned weights the error would be {100 * before:.1f} %, with them it is {100 * after:.1f} %."
    return [Finding("good" if after < before else "doubtful", text)]


def _expectation(evaluation: Evaluation) -> Finding:
    expected, true = expected_and_true(evaluation)
    ratio = float(expected.mean() / max(true.mean(), 1e-300))
    ranks = float(spearmanr(expected, true).statistic)
    believed = 1 / _BELIEVED < ratio < _BELIEVED
    text = (
        f"Expected errors are {100 * expected.mean():.1f} % on average where the true ones are "
        f"{100 * true.mean():.1f} % (rank correlation over points {ranks:.2f})"
    )
    if believed:
        return Finding("good", text + ".")
    return Finding("doubtful", text + f": they are too {'low' if ratio < 1 else 'high'}.")


def _convergence(learner: Any) -> list[Finding]:
    if learner.weighting is None:
        return []
    if learner.converged_:
        return [Finding("good", f"The search for weights converged in {learner.n_iter_} iterations.")]
    text = f"The search for weights stopped after {learner.n_iter_} iterations, before it converged; raise max_iter."
    return [Finding("doubtful", text)]


def _weights_at_bounds(learner: Any) -> list[Finding]:
    logs = np.abs(np.log(learner.weights_))
    n_bound = int((logs > LOG_WEIGHT_BOUND - 1e-6).sum())
    if learner.weighting is None or n_bound <= len(logs) // 4:
        return []
    return [
        Finding(
            "doubtful",
            f"{n_bound} of {len(logs)} weights are at the bounds of the search: probes that hardly matter, or too few "
            "training shapes to tell.",
        )
    ]


def _calibration(learner: Any) -> list[Finding]:
    if all(model.cross_validated for model in learner.error_models_.values()):
        return []
    return [
        Finding(
            "doubtful",
            "Only one shape beside the reference was there to learn from: expected errors are those of the training, "
            "and too hopeful.",
        )
    ]


def _some(names: list[str], most: int = 5) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
