"""The paper's pipeline (figure 2, top) on arrays: from known maps to weights and a stable basis."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import check_choice, check_number, check_sample_weight
from skfmap.functional.norm import epsilon_by_rule
from skfmap.functional.normalization import scale_by
from skfmap.functional.objective import LearningProblem
from skfmap.functional.optimize import Optimum, optimize_weights
from skfmap.functional.regularization import (
    LEARNED,
    REGULARIZERS,
    Regularizer,
    learned_mask,
    penalty_of,
    penalty_quadratic,
)
from skfmap.functional.stable_basis import stable_basis
from skfmap.functional.weighting import check_weighting, coarse_groups, weight_groups

__all__ = ["LearnedMaps", "learn_functional_maps"]

# If the probes reproduce the maps exactly, all differences are rounding errors, and the automatic
# epsilon would be degenerate. TOSCA's cats have an epsilon of 0.28.
_LEAST_EPSILON = 1e-12


@dataclass(frozen=True, eq=False)
class LearnedMaps:
    """Weights, stable basis and maps that were learned from known functional maps.

    Attributes
    ----------
    weights : ndarray of shape (m,)
        Diagonal of D.
    stable_basis : ndarray of shape (k, k)
        Y, most stable function first.
    stability : ndarray of shape (k,)
        Singular values that belong to the columns of Y, ascending.
    epsilon : float
        Parameter of the norm (4).
    maps : ndarray of shape (N, k, k)
        Learned maps X_i(D) of the training shapes.
    optimum : Optimum
        How the weights were found.
    regularizer : str or callable
        Deformation model that the maps were fitted with.
    """

    weights: FloatArray
    stable_basis: FloatArray
    stability: FloatArray
    epsilon: float
    maps: FloatArray
    optimum: Optimum
    regularizer: str | Regularizer = "laplacian"


def learn_functional_maps(
    probes_0: FloatArray,
    probes: FloatArray,
    evals_0: FloatArray,
    evals: FloatArray,
    maps: FloatArray,
    *,
    weighting: str | Sequence[Hashable] | None = "function",
    categories: Sequence[str] | None = None,
    epsilon: float | str = "auto",
    alpha: float = 1e-2,
    regularizer: str | Regularizer = "laplacian",
    normalize: str = "shape",
    sample_weight: FloatArray | None = None,
    max_iter: int = 1000,
    tol: float = 1e-4,
    start: FloatArray | None = None,
    n_threads: int = 1,
    callback: Callable[[int, float, Callable[[], "LearnedMaps"]], bool | None] | None = None,
) -> LearnedMaps:
    """Learn weights D and a stable basis Y from known functional maps, without any points.

    Parameters
    ----------
    probes_0 : ndarray of shape (k, m)
        Raw coefficients of the probe functions on the reference S_0.
    probes : ndarray of shape (N, k, m)
        Raw coefficients on the training shapes S_i.
    evals_0, evals : ndarray of shape (k,), ndarray of shape (N, k)
        Laplacian eigenvalues at unit area.
    maps : ndarray of shape (N, k, k)
        Known functional maps C_i, from functions on S_0 to functions on S_i. The first column is
        assumed to be e_0: constants map to constants.
    weighting : {"function", "category", "unique"}, sequence of labels or None
        Which probes share a weight. With a sequence of one label per probe, probes with the same
        label share a weight. None keeps D = I.
    categories : sequence of str, optional
        Category of each probe; needed for ``weighting="category"``.
    epsilon : float or "auto"
        Parameter of the norm (4); "auto" is the paper's 80 percent rule.
    alpha : float
        Strength of the regulariser.
    regularizer : "laplacian", "resolvent", "learned" or callable
        Deformation model, ``(evals_i, evals_0) -> W`` of shape (k, k). "learned" estimates it from
        ``maps``.
    normalize : {"shape", "reference"}
        Whether probe columns are scaled by the norms on each shape, or on the reference.
    sample_weight : ndarray of shape (N,), optional
        Share of each training shape in equation (3) and in Y.
    max_iter, tol : int, float
        Maximum number of iterations and tolerance of the optimiser.
    start : ndarray of shape (m,), optional
        Initial weights, equal for probes that share a weight; 1 by default.
    n_threads : int
        Number of threads, each working on some of the shapes. The result does not depend on it.
        Limit BLAS to one thread (threadpoolctl) if there are several.
    callback : callable, optional
        Called after each iteration with its number, the loss, and a function that returns the
        current LearnedMaps. The search stops if it returns True.

    Returns
    -------
    LearnedMaps
        Weights, stable basis, and how they were found.

    Raises
    ------
    ValueError
        If the shapes of the arrays are inconsistent, or a choice is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional import learn_functional_maps
    >>> rng = np.random.default_rng(0)
    >>> probes_0, evals = rng.standard_normal((6, 16)), np.arange(6.0)
    >>> noisy = probes_0 + np.where(np.arange(16) < 8, 0.01, 3) * rng.standard_normal((5, 6, 16))
    >>> maps = np.tile(np.eye(6), (5, 1, 1))
    >>> learned = learn_functional_maps(
    ...     probes_0, noisy, evals, np.tile(evals, (5, 1)), maps, alpha=0.1
    ... )
    >>> bool(learned.weights[:8].min() > learned.weights[8:].max())
    True
    """
    _check_arrays(probes_0, probes, evals_0, evals, maps)
    share = check_sample_weight(sample_weight, len(maps))
    labels = ["probe"] * probes_0.shape[1] if categories is None else categories
    _check_choices(weighting, categories, labels, probes_0.shape[1])
    _check_numbers(epsilon, alpha, regularizer, normalize)
    if regularizer == LEARNED:
        regularizer = learned_mask(maps, share)
    problem = LearningProblem(
        probes_0=scale_by(probes_0, probes_0, normalize),
        probes=np.stack([scale_by(probes_0, g, normalize) for g in probes]),
        penalties=np.stack([penalty_of(e, evals_0, alpha, regularizer) for e in evals]),
        maps=maps,
        sample_weight=share,
        quadratic=penalty_quadratic(evals, evals_0, alpha, regularizer),
        n_threads=n_threads,
    )
    unweighted = problem.differences(np.ones(probes_0.shape[1]))
    used_epsilon = _as_number(epsilon, unweighted[share > 0])
    groups = weight_groups(weighting, labels)

    def tell_callback(iteration: int, loss: float, weights: FloatArray) -> bool | None:
        so_far = Optimum(weights, [loss], iteration, iteration, np.nan, False, False, "under way")
        return callback is not None and callback(
            iteration, loss, lambda: _conclude(problem, so_far, used_epsilon, regularizer)
        )

    optimum = optimize_weights(
        problem,
        groups,
        used_epsilon,
        coarse=coarse_groups(groups, labels),
        start=start,
        max_iter=max_iter,
        tol=tol,
        callback=tell_callback,
    )
    return _conclude(problem, optimum, used_epsilon, regularizer)


def _as_number(epsilon: float | str, differences: FloatArray) -> float:
    if isinstance(epsilon, str):
        return max(epsilon_by_rule(differences), _LEAST_EPSILON)
    return float(epsilon)


def _conclude(
    problem: LearningProblem, optimum: Optimum, epsilon: float, regularizer: str | Regularizer
) -> LearnedMaps:
    """Return what follows from the weights: the maps, and the stable basis of section 4.1."""
    learned = problem.solve(optimum.weights)
    differences = learned - problem.maps
    differences[:, :, 0] = 0.0  # constants map to constants
    Y, stability = stable_basis(differences, problem.sample_weight)
    return LearnedMaps(optimum.weights, Y, stability, epsilon, learned, optimum, regularizer)


def _check_arrays(
    probes_0: FloatArray,
    probes: FloatArray,
    evals_0: FloatArray,
    evals: FloatArray,
    maps: FloatArray,
) -> None:
    k, m = probes_0.shape
    n = len(maps)
    expected = {"probes": (n, k, m), "evals_0": (k,), "evals": (n, k), "maps": (n, k, k)}
    given = {"probes": probes, "evals_0": evals_0, "evals": evals, "maps": maps}
    for name, shape in expected.items():
        if np.shape(given[name]) != shape:
            raise ValueError(
                f"{name} must have shape {shape} to fit probes_0 {probes_0.shape} and {n} maps; "
                f"got {np.shape(given[name])}. If shapes have different k, truncate them to a "
                "common k first."
            )
        if not np.isfinite(given[name]).all():
            raise ValueError(f"{name} contains NaN or infinite values.")
    if n == 0:
        raise ValueError(
            "There are no maps to learn from; give at least one training shape besides the "
            "reference."
        )


def _check_choices(
    weighting: str | Sequence[Hashable] | None,
    categories: Sequence[str] | None,
    labels: Sequence[str],
    n_probes: int,
) -> None:
    check_weighting(weighting, n_probes)
    if isinstance(weighting, str) and weighting == "category" and categories is None:
        raise ValueError('weighting="category" needs the category of each probe in `categories`.')
    if len(labels) != n_probes:
        raise ValueError(f"categories must name all {n_probes} probes; got {len(labels)}.")


def _check_numbers(
    epsilon: float | str, alpha: float, regularizer: str | Regularizer, normalize: str
) -> None:
    if isinstance(epsilon, str):
        check_choice(epsilon, "epsilon", ("auto",))
    else:
        check_number(epsilon, "epsilon", low=0, strict=True)
    check_number(alpha, "alpha", low=0, strict=True)
    check_choice(normalize, "normalize", ("shape", "reference"))
    if not callable(regularizer):
        check_choice(regularizer, "regularizer", (*REGULARIZERS, LEARNED))
