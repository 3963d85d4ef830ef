"""Diagnostics of fits and of new shapes, which `report` issues as warnings."""

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

# If the error of even the most stable function exceeds this fraction of its norm, half of its
# square is lost, and nothing was learned.
_UNSTABLE = 0.7
# Thresholds of mean errors, in sqrt(area), on held-out training shapes. TOSCA's cats, horses and
# people have at most 0.06, and at most twice the median of the others. A horse whose vertex indices
# are off by one has 0.08, animals confused with their mirror images 0.2 or more, and animals with
# shuffled indices 0.35 or more.
_WRONG, _WRONG_TO_ALL, _TIMES_THE_OTHERS = 0.06, 0.2, 3
# A shape is mirrored if the residual of equation (2) for its mirror image is below this fraction of
# its own residual; the ratio is above 1 for correct shapes.
_MUCH_BETTER = 0.7


class Finding(NamedTuple):
    """A message, and the category of the warning that issues it."""

    category: type[Warning]
    message: str


def report(findings: Iterable[Finding]) -> None:
    """Issue each finding as a warning, at the caller's line."""
    for finding in findings:
        warn(finding.message, finding.category)


def diagnose(
    training: TrainingSet, learned: LearnedMaps, training_errors: FloatArray | None
) -> list[Finding]:
    """Return findings about a fit that the user should know.

    Parameters
    ----------
    training : TrainingSet
        The training set.
    learned : LearnedMaps
        The learned maps.
    training_errors : ndarray of shape (n_given,) or None
        Mean errors on held-out shapes, by their index in X.
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
    """Return findings about solutions and matches of new shapes.

    Each shape is named once: a mirrored shape is not called unfamiliar as well, and a shape that
    the reference does not fit is named with its quality from ``misfits``.
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
                "These shapes fit the reference much better as mirror images: "
                f"{', '.join(images)}. Left and right may be confused there; check that the mesh "
                "is not mirrored or inside out (a scan with one axis negated, or faces wound "
                "inwards on an open surface). If there are specimens of both sides, "
                "on_mirrored='reflect' matches both.",
            )
        )
    if strange:
        findings.append(
            Finding(
                UnfamiliarShapeWarning,
                "The model fits these shapes much worse than any held-out training shape: "
                f"{', '.join(strange)}. Their matches may be wrong, and worse than their expected "
                "errors suggest. Is it another kind of body, a part of one, or a mesh of another "
                "resolution? Add similar shapes to the training shapes, or use the same resolution "
                "for all.",
            )
        )
    return findings + _ill_laid(ill_laid, "Do not trust their matches.")


def diagnose_reflected(called: Sequence[str]) -> list[Finding]:
    """Return a finding that names the shapes that were reflected."""
    message = (
        "These shapes are mirror images of the kind that the others belong to, and were "
        f"reflected: {', '.join(called)}. Answers are on the meshes as they were given. If this is "
        "not intended, set on_mirrored='warn'."
    )
    return [Finding(OrientationWarning, message)] if called else []


def diagnose_registered(usable: Usable, laid: Sequence[Registered]) -> list[Finding]:
    """Return a finding that names the shapes that the reference does not fit."""
    told = [
        f"{describe(i, shape)} ({_told(one.off, one.uncovered, one.stretched)})"
        for i, shape, one in zip(usable.indices, usable.shapes, laid, strict=True)
        if not one.fits
    ]
    return _ill_laid(told, "Do not use their registered meshes.")


def _ill_laid(told: Sequence[str], consequence: str) -> list[Finding]:
    message = (
        "The reference does not fit these shapes as well as the training shapes: "
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
    """Return whether a shape fits much better after its oriented probes are negated.

    This is False if there are no oriented probes.
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
    """Find shapes where a number that means "none" was taken for a point."""
    called = [label(training.reference.name, "the reference"), *names]
    told = [
        f"{who} ({said})"
        for who, truth in zip(called, [training.truth_0, *training.truths], strict=True)
        if (said := crowded_points(*truth.pairs.T))
    ]
    message = (
        f"One number occurs very often in the correspondences of {'; '.join(told)}. Does it mean "
        '"none"? Leave these pairs out, or write -1: they spoil the learned maps.'
    )
    return [message] if told else []


def _convergence(learned: LearnedMaps, tol: float) -> list[Finding]:
    optimum = learned.optimum
    if optimum.converged or optimum.stopped:
        return []
    message = (
        f"The weights did not converge in {optimum.n_iter} iterations (gradient "
        f"{optimum.gradient_norm:.2g}, tol {tol:g}): {optimum.message}. Increase max_iter or tol."
    )
    return [Finding(ConvergenceWarning, message)]


def _mirrored(training: TrainingSet) -> list[Finding]:
    """Find shapes that were reflected, and others that their correspondences show as mirrored."""
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
        f"The correspondences of {', '.join(suspects)} confuse left and right: oriented probes, or "
        f"positions in space, are opposite to those of the reference {training.reference.name!r}. "
        "Either the meshes are mirrored or inside out, or the correspondences are the symmetric "
        "ones. Mirror the mesh back (negate one coordinate and reverse the faces), let the learner "
        "do it (on_mirrored='reflect'), or use DescriptorTransformer('paper')."
    )
    return [
        *diagnose_reflected(reflected),
        *([Finding(OrientationWarning, message)] if suspects else []),
    ]


def _disagreement(training: TrainingSet, errors: FloatArray) -> list[Finding]:
    """Find training shapes whose correspondences contradict the others, or report that all do."""
    left_out = [i for i, index in enumerate(training.indices) if np.isfinite(errors[index])]
    own = errors[training.indices[left_out]]
    if len(own) < 2:
        return []
    typical = float(np.median(own))
    if typical > _WRONG_TO_ALL:
        message = (
            "Held-out training shapes are matched with a mean error of "
            f"{typical:.2f} sqrt(area), nearly as bad as chance, and so will new shapes be. Check "
            "the correspondence of the reference first (vertex indices start at 0 and must be "
            "those of this mesh; Correspondence.from_vertices or from_template), then those of the "
            "others (learner.training_errors_), whether the shapes are similar, and whether there "
            "are enough functions to tell points apart (n_functions, n_stable)."
        )
        return [Finding(DisagreementWarning, message)]
    wrong = [j for j in range(len(own)) if _contradicts(own[j], np.delete(own, j))]
    told = ", ".join(f"{training.describe(left_out[j])} ({own[j]:.2f})" for j in wrong)
    message = (
        "When held out, these training shapes are matched this many sqrt(area) from where their "
        f"correspondences say: {told}; the typical value is {typical:.2f}. Are vertex indices "
        "those of another mesh or counted from 1, are left and right confused, or is it another "
        "kind of body? Correct the correspondence, or leave the shape out: it spoils what is "
        "learned from the others."
    )
    return [Finding(DisagreementWarning, message)] if wrong else []


def _contradicts(error: float, others: FloatArray) -> bool:
    return bool(error > max(_WRONG, _TIMES_THE_OTHERS * float(np.median(others))))


def _instability(training: TrainingSet, learned: LearnedMaps) -> list[Finding]:
    """Find out whether no reliable function was learned."""
    known = np.stack([one.C for one in training.known])
    images = np.linalg.norm(known @ learned.stable_basis, axis=1).mean(axis=0)
    missed = learned.stability / np.sqrt(training.share.sum()) / np.maximum(images, 1e-300)
    best = float(missed[1:].min())  # the constant function is always mapped exactly
    message = (
        f"No function is mapped stably: on the training shapes, the error of even the best is "
        f"{best:.2f} of its norm. Check that the correspondences belong to their shapes (vertex "
        "indices start at 0; Correspondence.from_vertices or from_template) and the winding of the "
        "meshes, or use other probes."
    )
    return [Finding(StabilityWarning, message)] if best > _UNSTABLE else []


def _search_without_effect(training: TrainingSet, learned: LearnedMaps) -> list[Finding]:
    """Find out whether a given epsilon is so large or small that the loss is constant."""
    loss = learned.optimum.loss_curve[-1] / (training.share.sum() * (training.k - 1))
    asked = training.options.weighting is not None and training.options.epsilon != "auto"
    message = (
        f"No weight was changed: at epsilon={learned.epsilon:.3g} the loss is practically "
        "constant. Use epsilon='auto', or a number near the squared singular values of X(I) - C."
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
