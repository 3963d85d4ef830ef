"""Errors to expect of matches, from training shapes that were left out of the learning in turn."""

from typing import Any, NamedTuple

import numpy as np

from skfmap._confidence import ErrorModel, Observation, Watch, fit_error_model, observe, watch_reference
from skfmap._matching import UNREFINED, Matcher, embedding_distance, match_points, penalised_error
from skfmap._parallel import map_shapes
from skfmap._training import Training, learn_from_rows, learning_arrays, matcher_from
from skfmap._typing import FloatArray, IntArray
from skfmap.shapes import JoinedPairs, ProbedShape

__all__ = ["Calibration", "calibrate"]

_N_FOLDS = 3
# The weights of a fold need not be polished: errors hardly change after so many iterations.
_FOLD_OPTIONS = {"max_iter": 60, "tol": 1e-3}


class Calibration(NamedTuple):
    """What training shapes showed when they were left out of the learning (a single one, as it was learned).

    Attributes
    ----------
    error_models : dict of ErrorModel
        Keys: ``"unrefined"``, and the refinement of the settings.
    misfits, errors : ndarray of shape (n_training,)
        What is left of equation (2) on each shape but the reference, and the mean error of its match, as refined; NaN
        for shapes of no weight.
    """

    error_models: dict[str, ErrorModel]
    misfits: FloatArray
    errors: FloatArray


def calibrate(
    training: Training, whole: Matcher, options: dict[str, Any], *, memory: Any, n_jobs: int | None
) -> Calibration:
    """Relate what matches show of themselves to their errors, on shapes left out of the learning, and how these fit.

    Parameters
    ----------
    training : Training
        Training shapes.
    whole : Matcher
        Learned from all of them; used as it is if there is one only, which cannot be left out.
    options : dict
        Of `learn_functional_maps`.
    memory : None, str or joblib.Memory
        Where distances are cached.
    n_jobs : int or None
        Folds, then shapes, at a time.

    Returns
    -------
    Calibration
        What was observed.
    """
    used = np.flatnonzero(training.share > 0)
    watch = watch_reference(training.reference, [training.joins[i] for i in used], memory)
    n_folds = min(_N_FOLDS, len(used))
    left_out = [used[f::n_folds] for f in range(n_folds)]
    matchers = [whole] if n_folds == 1 else _matchers_without(training, left_out, whole, options, n_jobs)
    arguments = (
        (matcher, training.shapes[i], training.joins[i], training.known[i].areas, watch)
        for matcher, rows in zip(matchers, left_out, strict=True)
        for i in rows
    )
    watched = map_shapes(_observe_all, arguments, n_jobs=n_jobs, verbose=0, prefer="threads")
    observed = [one for one, _, _ in watched]
    worst_distance = max(distance for _, _, distance in watched)
    order = np.concatenate(left_out)
    share = training.share[order]
    error_models = {
        kind: fit_error_model(
            [one[kind]._replace(weights=own * one[kind].weights) for own, one in zip(share, observed, strict=True)],
            watch,
            worst_distance=worst_distance,
            cross_validated=n_folds > 1,
        )
        for kind in observed[0]
    }
    misfits, errors = np.full((2, len(training.shapes)), np.nan)
    misfits[order] = [misfit for _, misfit, _ in watched]
    kind = whole.settings.refine or UNREFINED
    errors[order] = [np.average(one[kind].errors, weights=one[kind].weights) for one in observed]
    return Calibration(error_models, misfits, errors)


def _matchers_without(
    training: Training, left_out: list[IntArray], whole: Matcher, options: dict[str, Any], n_jobs: int | None
) -> list[Matcher]:
    """Return, for each fold, what is learned from the other folds."""
    arrays = learning_arrays(training, len(whole.stable_basis))
    kept = [np.setdiff1d(np.concatenate(left_out), rows) for rows in left_out]
    shorter = options | {"max_iter": min(options["max_iter"], _FOLD_OPTIONS["max_iter"])}
    shorter |= {"tol": max(options["tol"], _FOLD_OPTIONS["tol"])}
    learned = map_shapes(
        learn_from_rows, ((arrays, rows, shorter) for rows in kept), n_jobs=n_jobs, verbose=0, prefer="threads"
    )
    return [
        matcher_from(training, rows, one.maps, one, whole.settings._replace(regularizer=one.regularizer))
        for rows, one in zip(kept, learned, strict=True)
    ]


def _observe_all(
    matcher: Matcher, shape: ProbedShape, join: JoinedPairs, areas: FloatArray, watch: Watch
) -> tuple[dict[str, Observation], float, float]:
    before, after = match_points(matcher, shape)
    kinds = {UNREFINED: before, matcher.settings.refine or UNREFINED: after}
    seen = {kind: observe(matcher, shape, join, areas, match, watch) for kind, match in kinds.items()}
    return seen, penalised_error(matcher, shape), embedding_distance(shape, before)
