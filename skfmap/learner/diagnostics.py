"""What a fit, or a new shape, shows that a person should know.

`report` is the one place that warns of it.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import label
from skfmap._tools.warn import warn
from skfmap.exceptions import (
    CoverageWarning,
    DisagreementWarning,
    OrientationWarning,
    SkippedShapeWarning,
    StabilityWarning,
    UnfamiliarShapeWarning,
)
from skfmap.functional.learning import LearnedMaps
from skfmap.functional.optimize import LOG_WEIGHT_BOUND
from skfmap.ground_truth import coverage_messages
from skfmap.learner.matcher import Solution
from skfmap.learner.mirrored import is_against
from skfmap.learner.training_set import TrainingSet
from skfmap.registration import Quality
from skfmap.shapes import Registered
from skfmap.shapes.crowded import crowded_points
from skfmap.shapes.usable import Usable, describe

__all__ = [
    "Finding",
    "diagnose",
    "diagnose_new_shapes",
    "diagnose_reflected",
    "diagnose_registered",
    "is_mirrored",
    "report",
]

# Where even the most stable function is missed by so much of its norm, half of its square is lost:
# nothing was learned.
_UNSTABLE = 0.7
# Mean errors, in sqrt(area), of training shapes left out. Those of TOSCA cats, horses and people
# are at most 0.06, and within twice the median of the others; a horse whose numbers are off by one
# is at 0.08, animals taken for their mirror images at 0.2 and more, with shuffled numbers at 0.35
# and more.
_WRONG, _WRONG_TO_ALL, _TIMES_THE_OTHERS = 0.06, 0.2, 3
# What is left of equation (2) for the mirror image, as a share of that for the shape; sound shapes
# are above 1.
_MUCH_BETTER = 0.7


class Finding(NamedTuple):
    """What there is to say, and the kind of warning that says it."""

    category: type[Warning]
    message: str


def report(findings: Iterable[Finding]) -> None:
    """Warn of each finding, at the caller's line."""
    for finding in findings:
        warn(finding.message, finding.category)


def diagnose(
    training: TrainingSet, learned: LearnedMaps, training_errors: FloatArray | None
) -> list[Finding]:
    """Return what a fit shows that a person should know.

    Parameters
    ----------
    training : TrainingSet
        What was learned from.
    learned : LearnedMaps
        What was learned.
    training_errors : ndarray of shape (n_given,) or None
        Mean errors of shapes left out, by their index in X.
    """
    return [
        *([Finding(SkippedShapeWarning, training.skipped)] if training.skipped else []),
        *_coverage(training),
        *_convergence(learned, training.options.tol),
        *_mirrored(training),
        *([] if training_errors is None else _disagreement(training, training_errors)),
        *_instability(training, learned),
        *_search_without_effect(training, learned),
        *_weights_at_bounds(learned),
    ]


def diagnose_new_shapes(
    usable: Usable,
    mirrored: Sequence[bool],
    familiar: Sequence[bool | None],
    misfits: Sequence[Quality | None] | None = None,
) -> list[Finding]:
    """Return what solutions and matches of new shapes show.

    A mirrored shape is not called unfamiliar as well, and one that the reference was laid onto in
    vain, whose quality is in ``misfits``, is named once, with that.
    """
    misfits = [None] * len(familiar) if misfits is None else misfits
    called = [describe(i, shape) for i, shape in zip(usable.indices, usable.shapes, strict=True)]
    images = [who for who, yes in zip(called, mirrored, strict=True) if yes]
    strange = [
        who
        for who, image, known, misfit in zip(called, mirrored, familiar, misfits, strict=True)
        if known is False and misfit is None and not image
    ]
    ill_laid = [
        f"{who} ({_told(*misfit[:3])})"
        for who, image, misfit in zip(called, mirrored, misfits, strict=True)
        if misfit is not None and not image
    ]
    findings = []
    if images:
        findings.append(
            Finding(
                OrientationWarning,
                "As mirror images, these shapes fit the reference much better: "
                f"{', '.join(images)}. Left may be taken for right there; check that the mesh is "
                "not mirrored or inside out (a scan with one axis negated, or faces wound inwards "
                "on an open surface). Specimens of both sides: on_mirrored='reflect' matches them "
                "all alike.",
            )
        )
    if strange:
        findings.append(
            Finding(
                UnfamiliarShapeWarning,
                "What was learned fits these shapes much worse than any training shape left out: "
                f"{', '.join(strange)}. Their matches may be wrong, and worse than their expected "
                "errors say. Is it another kind of body, a part of one, or a mesh of another "
                "resolution? Add shapes like it to the training shapes, or bring all to one "
                "resolution.",
            )
        )
    return findings + _ill_laid(ill_laid, "Do not trust their matches.")


def diagnose_reflected(called: Sequence[str]) -> list[Finding]:
    """Return which shapes were matched, or learned from, as their mirror images."""
    message = (
        f"These shapes are mirror images of what the others are, and were reflected: "
        f"{', '.join(called)}. Answers are on the meshes as they were given. If that is not "
        "meant, give on_mirrored='warn'."
    )
    return [Finding(OrientationWarning, message)] if called else []


def diagnose_registered(usable: Usable, laid: Sequence[Registered]) -> list[Finding]:
    """Return which shapes the reference does not fit, and how that shows."""
    told = [
        f"{describe(i, shape)} ({_told(one.off, one.uncovered, one.stretched)})"
        for i, shape, one in zip(usable.indices, usable.shapes, laid, strict=True)
        if not one.fits
    ]
    return _ill_laid(told, "Do not use the meshes that were laid onto them.")


def _ill_laid(told: Sequence[str], consequence: str) -> list[Finding]:
    message = (
        "The reference does not fit these shapes as it fits training shapes: "
        f"{', '.join(told)}. {consequence} Is it another kind of body, a part of one, or was it "
        "matched wrongly?"
    )
    return [Finding(UnfamiliarShapeWarning, message)] if told else []


def _told(off: float, uncovered: float, stretched: float) -> str:
    return (
        f"{off:.0%} of the reference off the shape, {uncovered:.0%} of the shape off the "
        f"reference, {stretched:.0%} stretched"
    )


def is_mirrored(solution: Solution) -> bool:
    """Tell whether a shape fits much better once its oriented probes are negated.

    It is False where there are none.
    """
    upright = solution.residual if solution.upright_residual is None else solution.upright_residual
    return bool(solution.mirrored_residual < _MUCH_BETTER * upright)


def _coverage(training: TrainingSet) -> list[Finding]:
    names = [training.describe(i) for i in range(len(training.shapes))]
    return [
        Finding(CoverageWarning, message)
        for message in [
            *coverage_messages(training.known, names, training.k),
            *training.told,
            *_crowded(training, names),
        ]
    ]


def _crowded(training: TrainingSet, names: list[str]) -> list[str]:
    """Name shapes where a number that stands for "none" was taken for a point."""
    called = [label(training.reference.name, "the reference"), *names]
    told = [
        f"{who} ({said})"
        for who, truth in zip(called, [training.truth_0, *training.truths], strict=True)
        if (said := crowded_points(*truth.pairs.T))
    ]
    message = (
        f"One number stands for many in the correspondences of {'; '.join(told)}. Does it mean "
        '"none"? Leave such pairs out, or write -1: they spoil what is learned.'
    )
    return [message] if told else []


def _convergence(learned: LearnedMaps, tol: float) -> list[Finding]:
    optimum = learned.optimum
    if optimum.converged or optimum.stopped:
        return []
    message = (
        f"The weights did not converge in {optimum.n_iter} iterations (gradient "
        f"{optimum.gradient_norm:.2g}, tol {tol:g}): {optimum.message}. Raise max_iter or tol."
    )
    return [Finding(ConvergenceWarning, message)]


def _mirrored(training: TrainingSet) -> list[Finding]:
    """Find shapes that were reflected, and others that are mirrored by their correspondences."""
    called = [training.describe(i) for i in range(len(training.shapes))]
    reflected = [who for who, shape in zip(called, training.shapes, strict=True) if shape.reflected]
    suspects = [
        who
        for who, shape, join, one in zip(
            called, training.shapes, training.joins, training.known, strict=True
        )
        if is_against(shape, training.reference, join, one)
    ]
    message = (
        f"The correspondences of {', '.join(suspects)} take left for right: oriented probes, or "
        f"places in space, run against those of the reference {training.reference.name!r}. The "
        "meshes are mirrored or inside out, or the correspondences are the symmetric ones; mirror "
        "the mesh back (negate one coordinate and reverse the faces), let the learner do it "
        "(on_mirrored='reflect'), or use DescriptorTransformer('paper')."
    )
    return [
        *diagnose_reflected(reflected),
        *([Finding(OrientationWarning, message)] if suspects else []),
    ]


def _disagreement(training: TrainingSet, errors: FloatArray) -> list[Finding]:
    """Find training shapes whose correspondences contradict all others, or say that none agrees."""
    left_out = [i for i, index in enumerate(training.indices) if np.isfinite(errors[index])]
    own = errors[training.indices[left_out]]
    if len(own) < 2:
        return []
    typical = float(np.median(own))
    if typical > _WRONG_TO_ALL:
        message = (
            "Training shapes that are left out of the learning are matched with a mean error of "
            f"{typical:.2f} sqrt(area), nearly as bad as chance, and new ones will be. Check the "
            "correspondence of the reference first (vertex numbers from 0, those of this very "
            "mesh; Correspondence.from_vertices or from_template), then the others' "
            "(learner.training_errors_), whether the shapes are alike, and whether the functions "
            "are enough to tell points apart (n_functions, n_stable)."
        )
        return [Finding(DisagreementWarning, message)]
    wrong = [j for j in range(len(own)) if _contradicts(own[j], np.delete(own, j))]
    told = ", ".join(f"{training.describe(left_out[j])} ({own[j]:.2f})" for j in wrong)
    message = (
        "Left out of the learning, these training shapes are matched far from where their "
        f"correspondences say, by this many sqrt(area): {told}; {typical:.2f} is typical of all. "
        "Vertex numbers of another mesh or counted from 1, left taken for right, or another kind "
        "of body? Mend the correspondence, or leave the shape out: it spoils what is learned from "
        "the others."
    )
    return [Finding(DisagreementWarning, message)] if wrong else []


def _contradicts(error: float, others: FloatArray) -> bool:
    return bool(error > max(_WRONG, _TIMES_THE_OTHERS * float(np.median(others))))


def _instability(training: TrainingSet, learned: LearnedMaps) -> list[Finding]:
    """Say it if no function was learned that can be relied on."""
    known = np.stack([one.C for one in training.known])
    images = np.linalg.norm(known @ learned.stable_basis, axis=1).mean(axis=0)
    missed = learned.stability / np.sqrt(training.share.sum()) / np.maximum(images, 1e-300)
    best = float(missed[1:].min())  # the constant function always maps
    message = (
        f"No function maps stably: even the best is missed by {best:.2f} of its norm on the "
        "training shapes. Check that the correspondences belong to their shapes (vertex numbers "
        "from 0, Correspondence.from_vertices or from_template), and the winding of the meshes; "
        "or give other probes."
    )
    return [Finding(StabilityWarning, message)] if best > _UNSTABLE else []


def _search_without_effect(training: TrainingSet, learned: LearnedMaps) -> list[Finding]:
    """Find out whether a given epsilon is so large or small that the loss sees nothing."""
    loss = learned.optimum.loss_curve[-1] / (training.share.sum() * (training.k - 1))
    asked = training.options.weighting is not None and training.options.epsilon != "auto"
    message = (
        f"No weight was changed: at epsilon={learned.epsilon:.3g} the loss is as good as "
        "constant. Take epsilon='auto', or a number near the squared singular values of X(I) - C."
    )
    blind = asked and learned.optimum.n_iter == 0 and not 1e-3 < loss < 1 - 1e-3
    return [Finding(StabilityWarning, message)] if blind else []


def _weights_at_bounds(learned: LearnedMaps) -> list[Finding]:
    logs = np.log(learned.weights)
    sides = (
        (int((logs >= LOG_WEIGHT_BOUND).sum()), "upper", "lower alpha"),
        (
            int((logs <= -LOG_WEIGHT_BOUND).sum()),
            "lower",
            "raise alpha, or give more training shapes",
        ),
    )
    return [
        Finding(
            StabilityWarning,
            f"{n} of {len(logs)} weights are at the {side} bound of the search; {remedy}.",
        )
        for n, side, remedy in sides
        if n > len(logs) / 2
    ]
