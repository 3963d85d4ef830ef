"""From a functional map to points, and how such matches are refined: parts that can be exchanged.

A refinement is an object with one method, `Refinement.refine`. The learner's ``refine`` takes one
of these, the word for it, or one of your own.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import NamedTuple, Protocol
from weakref import WeakKeyDictionary

import numpy as np

from skfmap._tools.parallel import threads_within
from skfmap._tools.part import Part
from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import check_number
from skfmap.functional.embedding import spectral_embeddings
from skfmap.functional.neighbours import nearest_both
from skfmap.functional.refinement import beyond, map_from_point_maps, nearest_orthogonal
from skfmap.functional.residuals import trusted_functions
from skfmap.functional.samples import areas_of_samples, farthest_points
from skfmap.shapes import ProbedShape, SpectralShape

__all__ = [
    "ICP",
    "REFINEMENTS",
    "BijectiveZoomOut",
    "Learned",
    "PointMatch",
    "Refinement",
    "ZoomOut",
    "match_points",
    "rematch_points",
]


# Samples for each function, at least: 20 with 30 functions ruin a match, 100 hardly harm it.
_PER_FUNCTION = 4


class PointMatch(NamedTuple):
    """Points matched in an embedding.

    Attributes
    ----------
    learned_map : ndarray of shape (k, k)
        X_i(D): pulls functions on S_0 back to S_i.
    refined_map : ndarray of shape (n, n) or None
        The functional map that the last step of a refinement used; None before.
    points_i, points_0 : ndarray of shape (n_vertices_i, d), ndarray of shape (n_vertices_0, d)
        The vertices of S_i and S_0 in the embedding.
    p2p, inverse : ndarray of int, shape (n_vertices_i,), ndarray of int, shape (n_vertices_0,)
        The nearest vertex of S_0 for each of S_i, and the other way round.
    """

    learned_map: FloatArray
    refined_map: FloatArray | None
    points_i: FloatArray
    points_0: FloatArray
    p2p: IntArray
    inverse: IntArray


class Learned(Protocol):
    """What a refinement knows of what was learned: a learner's ``matcher_``.

    ``reference`` is S_0; ``stable_basis`` Y, shape (k, k); the covariances say how far maps put the
    points of training shapes from where they belong: learned ones in k functions, known ones in all
    that `SpectralBasis` holds.
    """

    @property
    def reference(self) -> ProbedShape: ...  # noqa: D102
    @property
    def stable_basis(self) -> FloatArray: ...  # noqa: D102
    @property
    def residual_covariance(self) -> FloatArray: ...  # noqa: D102
    @property
    def truncation_covariance(self) -> FloatArray: ...  # noqa: D102


def match_points(
    spectral: SpectralShape, spectral_0: SpectralShape, C: FloatArray, functions: FloatArray
) -> PointMatch:
    """Match points by nearest neighbours in functions that a learned map carries over.

    Parameters
    ----------
    spectral, spectral_0 : SpectralShape
        S_i and S_0.
    C : ndarray of shape (k, k)
        X_i(D), from functions on S_0 to functions on S_i.
    functions : ndarray of shape (k, n_functions)
        Coefficients of functions on S_0.

    Returns
    -------
    PointMatch
        Both point maps.
    """
    return PointMatch(C, None, *_nearest_both(spectral, spectral_0, C, functions))


def rematch_points(
    match: PointMatch,
    spectral: SpectralShape,
    spectral_0: SpectralShape,
    C: FloatArray,
    functions: FloatArray,
) -> PointMatch:
    """Match the points again, under a map that a refinement found.

    Parameters
    ----------
    match : PointMatch
        The match before.
    spectral, spectral_0 : SpectralShape
        S_i and S_0.
    C : ndarray of shape (n, n)
        The refined map, of any size that both bases hold.
    functions : ndarray of shape (n, n_functions)
        Coefficients of functions on S_0.

    Returns
    -------
    PointMatch
        Both point maps, with the learned map of the match before.
    """
    return PointMatch(match.learned_map, C, *_nearest_both(spectral, spectral_0, C, functions))


def _nearest_both(
    spectral: SpectralShape, spectral_0: SpectralShape, C: FloatArray, functions: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    n, held = len(C), min(spectral.n_components, spectral_0.n_components)
    if C.shape != (n, n) or len(functions) != n or n > held:
        raise ValueError(
            f"C must be square and functions have as many rows, at most the {held} functions that "
            f"SpectralBasis holds; got shapes {C.shape} and {functions.shape}."
        )
    points_i, points_0 = spectral_embeddings(
        spectral.evecs[:, :n], spectral_0.evecs[:, :n], C, functions
    )
    if not (np.isfinite(points_i).all() and np.isfinite(points_0).all()):
        raise ValueError("C and functions must be finite; they hold NaN, or values that overflow.")
    both = nearest_both(points_i, points_0, n_threads=threads_within())
    return points_i, points_0, *both


class Refinement(Part, ABC):
    """A way to refine matches; derive from it to write your own.

    Store parameters in ``__init__``, and implement `refine`. If the refinement has something to
    learn from the training shapes, override `fit`: it is called once for all of them, and once more
    for each fold of the calibration.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.refinement import Refinement, rematch_points
    >>> class AllAlike(Refinement):
    ...     "Match in all k functions alike."
    ...     def refine(self, learned, spectral, match):
    ...         C, spectral_0 = match.learned_map, learned.reference.spectral
    ...         return rematch_points(match, spectral, spectral_0, C, np.eye(len(C)))
    >>> import skfmap
    >>> skfmap.WeightedFunctionalMapLearner(refine=AllAlike())
    WeightedFunctionalMapLearner(refine=AllAlike())
    """

    @abstractmethod
    def refine(self, learned: Learned, spectral: SpectralShape, match: PointMatch) -> PointMatch:
        """Return the match with its points matched anew.

        Parameters
        ----------
        learned : Learned
            What was learned; the reference S_0 is ``learned.reference``.
        spectral : SpectralShape
            The shape S_i.
        match : PointMatch
            Its match in the learned functions.

        Returns
        -------
        PointMatch
            The refined match.
        """


class ICP(Refinement):
    """Match by orthogonal maps of k functions (Ovsjanikov et al. 2012).

    Each map is fitted to the points of the step before.

    Parameters
    ----------
    n_steps : int, default=10
        Maximum number of steps; it stops earlier if points no longer change.
    """

    def __init__(self, n_steps: int = 10) -> None:
        self.n_steps = n_steps

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        check_number(self.n_steps, "n_steps", low=1, integer=True)

    def refine(self, learned: Learned, spectral: SpectralShape, match: PointMatch) -> PointMatch:
        """Return the match after the last step."""
        k, spectral_0 = len(match.learned_map), learned.reference.spectral
        for _ in range(self.n_steps):
            C = np.eye(k)  # constants map to constants
            C[1:, 1:] = nearest_orthogonal(_fit(spectral, spectral_0, k, match.p2p, None)[1:, 1:])
            previous, match = match, rematch_points(match, spectral, spectral_0, C, np.eye(k))
            if np.array_equal(previous.p2p, match.p2p):
                break
        return match


class ZoomOut(Refinement):
    """Fit maps of growing size, each to the point map before (Melzi et al. 2019).

    Parameters
    ----------
    step : int, default=10
        Functions that each map has more than the one before, up to all that `SpectralBasis` holds.
    """

    def __init__(self, step: int = 10) -> None:
        self.step = step

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        check_number(self.step, "step", low=1, integer=True)

    def refine(self, learned: Learned, spectral: SpectralShape, match: PointMatch) -> PointMatch:
        """Return the match in all functions held."""
        spectral_0 = learned.reference.spectral
        for n in _sizes(learned, spectral, self.step):
            C = _fit(spectral, spectral_0, n, match.p2p, None)
            match = rematch_points(match, spectral, spectral_0, C, np.eye(n))
        return match


class BijectiveZoomOut(Refinement):
    """Fit maps of growing size to the point maps in both directions.

    Points are matched in functions with learned weights. Maps grow on well-spread samples of both
    shapes; the last steps match all vertices.

    Without the learned weights, the steps would favour maps that are as isometric as possible, and
    drift away even from the true map.

    Parameters
    ----------
    step : int, default=10
        Functions that each map has more than the one before, up to all that `SpectralBasis` holds.
    final_steps : int, default=2
        Steps in which all vertices are matched, in all functions.
    n_samples : int or None, default=2000
        Number of vertices of each shape that are matched while maps grow, at least four for each
        function; shapes with fewer vertices are matched as a whole. None always matches all.

    Notes
    -----
    Each step overshoots the fitted map by 0.7 of the way to it. Fitting the map and matching the
    points decrease one sum of squared distances in turn, and a quadratic function is no larger at
    twice the way to its minimum: up to there the sum decreases from step to step. Steps without
    overshooting are short, since the vertices matched before hold the map back.

    On TOSCA's cats, each left out in turn, eleven plain steps on all vertices have an error of
    0.0176, and these steps 0.0177, in a tenth of the time. With 1,500 samples the error is 0.0181,
    with 1,000 0.0186, on all vertices in every step 0.0174; with one final step 0.0182, with four
    0.0174.

    Examples
    --------
    >>> import skfmap
    >>> from skfmap.refinement import BijectiveZoomOut
    >>> learner = skfmap.WeightedFunctionalMapLearner(refine=BijectiveZoomOut())
    >>> learner.set_params(refine__step=20).refine
    BijectiveZoomOut(step=20)
    """

    # Of models that were saved before there were samples.
    n_samples: int | None = None

    def __init__(self, step: int = 10, final_steps: int = 2, n_samples: int | None = 2000) -> None:
        self.step = step
        self.final_steps = final_steps
        self.n_samples = n_samples

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        check_number(self.step, "step", low=1, integer=True)
        check_number(self.final_steps, "final_steps", low=1, integer=True)
        if self.n_samples is not None:
            check_number(self.n_samples, "n_samples", low=1, integer=True)

    def refine(self, learned: Learned, spectral: SpectralShape, match: PointMatch) -> PointMatch:
        """Return the match in all functions held."""
        spectral_0, sizes = learned.reference.spectral, [*_sizes(learned, spectral, self.step)]
        n_samples = self.n_samples and max(self.n_samples, _PER_FUNCTION * sizes[-1])
        few, few_0 = _sampled(spectral, n_samples), _sampled_once(spectral_0, n_samples)
        points: tuple[_Points, _Points] = (spectral, spectral_0)
        C, p2p, inverse = None, match.p2p, match.inverse
        for n in sizes:
            C = beyond(C, _fit(*points, n, p2p, inverse))
            functions = trusted_functions(learned.truncation_covariance[:n, :n])
            embedded = spectral_embeddings(few.evecs[:, :n], few_0.evecs[:, :n], C, functions)
            p2p, inverse = nearest_both(*embedded, n_threads=threads_within())
            points = few, few_0
        C = None
        for _ in range(self.final_steps):
            C = beyond(C, _fit(*points, n, p2p, inverse))
            match = rematch_points(match, spectral, spectral_0, C, functions)
            points, p2p, inverse = (spectral, spectral_0), match.p2p, match.inverse
        return match


REFINEMENTS: dict[str, type[Refinement]] = {
    "icp": ICP,
    "zoomout": ZoomOut,
    "bijective-zoomout": BijectiveZoomOut,
}
"""What the learner's words stand for."""


def _sizes(learned: Learned, spectral: SpectralShape, step: int) -> Iterator[int]:
    """Yield the sizes of the maps, from the learned one's to all that both bases hold."""
    k, most = (
        len(learned.stable_basis),
        min(spectral.n_components, len(learned.truncation_covariance)),
    )
    yield from range(k, most, step)
    yield most


class _Points(Protocol):
    """The points of a shape, or some that stand for all: functions at each, and areas."""

    @property
    def evecs(self) -> FloatArray: ...
    @property
    def mass(self) -> FloatArray: ...


class _Samples(NamedTuple):
    evecs: FloatArray
    mass: FloatArray


_SAMPLES: WeakKeyDictionary[SpectralShape, dict[int | None, _Points]] = WeakKeyDictionary()


def _sampled(spectral: SpectralShape, n_samples: int | None) -> _Points:
    """Return well-spread vertices with the areas that they stand for; a small shape as it is."""
    if n_samples is None or n_samples >= len(spectral.mass):
        return spectral
    rows = np.sort(farthest_points(spectral.vertices, n_samples))
    return _Samples(spectral.evecs[rows], areas_of_samples(spectral.vertices, spectral.mass, rows))


def _sampled_once(spectral_0: SpectralShape, n_samples: int | None) -> _Points:
    """Return the samples of a reference, which are the same for all shapes that are matched to it.

    They are kept as long as the reference is.
    """
    if n_samples is None or n_samples not in _SAMPLES.get(spectral_0, {}):
        samples = _sampled(spectral_0, n_samples)
        if samples is spectral_0:
            return spectral_0
        _SAMPLES.setdefault(spectral_0, {})[n_samples] = samples
    return _SAMPLES[spectral_0][n_samples]


def _fit(
    points: _Points, points_0: _Points, n: int, p2p: IntArray, inverse: IntArray | None
) -> FloatArray:
    return map_from_point_maps(
        points.evecs[:, :n], points_0.evecs[:, :n], points.mass, points_0.mass, p2p, inverse
    )
