"""Learning of the models of partial matching from training shapes and parts cut from them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from skfmap._tools.parallel import map_shapes
from skfmap._tools.types import FloatArray, IntArray
from skfmap.learner.training_set import TrainingSet
from skfmap.partial.body import Body, Lesson, shared_regions
from skfmap.partial.cuts import Cut
from skfmap.partial.scan import area_and_rim, scan_of
from skfmap.partial.trust import PartTrust, Seen
from skfmap.partial.winding import score_of
from skfmap.registration.part import Registration, lay_on_training
from skfmap.shapes import Mesh

__all__ = ["Learned", "learned_from", "whole_shapes"]

# Number of groups of training shapes that are left out in turn.
_N_FOLDS = 3


class Learned(NamedTuple):
    """What was learned from the training shapes.

    Attributes
    ----------
    body : Body
        The reference, its deformation model, and the model that recognises its regions.
    trust : PartTrust
        Calibration of errors and coverage, learned from parts of held-out training shapes.
    unit : float
        Square root of the area of the reference, in the units of the meshes.
    areas, rims : ndarray of shape (n_shapes,)
        Area and rim length of each training shape, in units of the reference.
    usual_score : float
        Median score of parts of held-out training shapes; see `score_of`.
    """

    body: Body
    trust: PartTrust
    unit: float
    areas: FloatArray
    rims: FloatArray
    usual_score: float


def learned_from(
    training: TrainingSet,
    learner: Any,
    cuts: list[Cut],
    *,
    n_cuts: int,
    n_calibrated: int,
    random_state: int,
    n_jobs: int | None,
    tell: Callable[[str], None],
) -> Learned:
    """Learn from whole shapes, the first of which is the reference, and from parts of them.

    Parameters
    ----------
    training : TrainingSet
        The training shapes.
    learner : WeightedFunctionalMapLearner
        Learner that was fitted to them.
    cuts, n_cuts, n_calibrated, random_state, n_jobs
        As in `skfmap.PartialMatcher`.
    tell : callable
        Called with a message at the start of each stage.
    """
    tell("laying the reference onto whole shapes")
    whole, laid = whole_shapes(training, learner)
    spectral_0 = training.reference.spectral
    unit, faces_0 = float(np.sqrt(spectral_0.area)), spectral_0.mesh.faces
    tell("cutting shapes and computing local features")
    lessons = map_shapes(
        _lessons_of,
        (
            (mesh, on, faces_0, unit, cuts, n_cuts, [random_state, i])
            for i, (mesh, on) in enumerate(zip(whole, laid, strict=True))
        ),
        n_jobs=n_jobs,
        verbose=0,
    )
    regions = shared_regions(spectral_0.vertices, faces_0, spectral_0.mass)
    tell("learning to recognise regions")
    folds = _folds(len(whole))
    bodies = map_shapes(
        _body_of,
        ((regions, [laid[i] for i in fold[1:]], [lessons[i] for i in fold]) for fold in folds),
        n_jobs=n_jobs,
        verbose=0,
    )
    tell("matching parts of held-out shapes")
    left_out = [
        (body, lesson)
        for body, fold in zip(bodies[1:], folds[1:], strict=True)
        for i in np.setdiff1d(folds[0], fold)
        for lesson in lessons[i][1 : 1 + n_calibrated]
    ]
    seen = map_shapes(_seen, left_out, n_jobs=n_jobs, verbose=0)
    sizes = np.array([area_and_rim(one.vertices / unit, one.faces) for one in whole])
    trust = PartTrust.learned(seen, regions)
    scores = map_shapes(_score, left_out, n_jobs=n_jobs, verbose=0)
    usual_score = float(np.median(scores))
    return Learned(bodies[0], trust, unit, sizes[:, 0], sizes[:, 1], usual_score)


def _folds(n_shapes: int) -> list[IntArray]:
    """Return the indices of the shapes in each fold: all of them, then all but one group.

    The reference is in every fold.
    """
    everything, others = np.arange(n_shapes), np.arange(1, n_shapes)
    folds = [np.setdiff1d(everything, others[k::_N_FOLDS]) for k in range(_N_FOLDS)]
    return [everything, *(fold for fold in folds if 1 < len(fold) < n_shapes)]


def whole_shapes(training: TrainingSet, learner: Any) -> tuple[list[Mesh], list[FloatArray]]:
    """Return working meshes, and the reference laid onto them in units of its sqrt(area)."""
    refinement = learner.refine_
    start = refinement.start_ if isinstance(refinement, Registration) else refinement
    laid = lay_on_training(training, learner.matcher_, start)
    spectral_0 = training.reference.spectral
    others = [training.shapes[i].spectral for i in training.used]
    scaled = [
        on * np.sqrt(one.area / spectral_0.area) for on, one in zip(laid, others, strict=True)
    ]
    meshes = [spectral_0.mesh, *(one.mesh for one in others)]
    return meshes, [spectral_0.vertices, *scaled]


def _lessons_of(
    mesh: Mesh,
    laid: FloatArray,
    faces_0: IntArray,
    unit: float,
    cuts: list[Cut],
    n_cuts: int,
    seed: list[int],
) -> list[Lesson]:
    """Return lessons from a whole shape and from parts of it, with their features."""
    parts = [mesh]
    for number in range(n_cuts):
        rng = np.random.default_rng([*seed, number])
        parts.append(cuts[(number + seed[-1]) % len(cuts)].cut(mesh, rng))
    lessons = [
        Lesson.of(scan_of(part.vertices, part.faces, unit, None), laid, faces_0) for part in parts
    ]
    for lesson in lessons:
        lesson.scan.features  # noqa: B018 (computes and caches them)
    return lessons


def _body_of(regions: Any, laid: list[FloatArray], lessons: list[list[Lesson]]) -> Body:
    return Body.learned(regions, laid, [one for each in lessons for one in each])


def _seen(body: Body, lesson: Lesson) -> Seen:
    return Seen(lesson, body.lay(lesson.scan))


def _score(body: Body, lesson: Lesson) -> float:
    return score_of(body, lesson.scan)
