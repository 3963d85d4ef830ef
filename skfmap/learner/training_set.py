"""What there is to learn from: the reference, the other training shapes, and their known maps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np

from skfmap._tools.caching import MemoryLike
from skfmap._tools.types import (
    BoolArray,
    FloatArray,
    IntArray,
    Weighting,
)
from skfmap._tools.validation import check_sample_weight
from skfmap.exceptions import CorrespondenceError, MeshError
from skfmap.functional.learning import LearnedMaps, learn_functional_maps
from skfmap.functional.regularization import Regularizer
from skfmap.functional.residuals import calibrated_covariance
from skfmap.functional.similarity import MIRROR
from skfmap.ground_truth import KnownMap, areas_of_pairs, join_with_reference, known_maps
from skfmap.io import open_given
from skfmap.known_maps import (
    BuiltMap,
    GivenPairs,
    KnownMaps,
    KnownMapsRecord,
    PairsAsGiven,
    is_on_most,
    record_of,
    told_of,
)
from skfmap.learner.inputs import check_correspondences, check_shapes
from skfmap.learner.medoid import medoid_index
from skfmap.learner.mirrored import is_mirror_image, mirror_image
from skfmap.learner.spelling import spelling_message
from skfmap.shapes import Correspondence, JoinedPairs, ProbedShape, SkippedShape
from skfmap.shapes.usable import Answer, ProbedItem, describe, skipped_message

__all__ = ["FitRecord", "LearningOptions", "Observed", "TrainingSet"]


class LearningOptions(NamedTuple):
    """Parameters of `learn_functional_maps`, as the learner has them."""

    weighting: Weighting = "function"
    categories: Sequence[str] | None = None
    epsilon: float | str = "auto"
    alpha: float = 0.01
    regularizer: str | Regularizer = "laplacian"
    normalize: str = "shape"
    max_iter: int = 1000
    tol: float = 1e-4

    def resolved(self, reference: ProbedShape) -> Self:
        """Return options that need no names: a callable ``weighting`` is asked for labels."""
        weighting = self.weighting
        if callable(weighting):
            labels = weighting(list(reference.probe_names), list(reference.probe_categories))
            if isinstance(labels, str) or not hasattr(labels, "__iter__"):
                raise TypeError(
                    f"weighting must return one label for each probe; it returned {labels!r}."
                )
            weighting = list(labels)
        return self._replace(weighting=weighting, categories=reference.probe_categories)


class FitRecord(NamedTuple):
    """What a fitted learner remembers of its training set and of the search.

    Neither of these outlives `fit`.
    """

    reference_index: int
    reference_correspondence: Correspondence
    n_shapes: int
    total_share: float
    stability: FloatArray
    epsilon: float
    loss_curve: list[float]
    n_iter: int
    converged: bool

    @property
    def loss(self) -> float:
        """Equation (3) at the end."""
        return self.loss_curve[-1]


class Observed(NamedTuple):
    """Pairs at which it shows what learned maps miss.

    Attributes
    ----------
    join, areas : JoinedPairs, ndarray of shape (n_pairs,)
        Those that the known map was made of, and the area that each stands for.
    residuals : ndarray of shape (n, n_components)
        What landmarks were missed by that were left out while it was built; no rows where it was
        not built.
    error : float
        How far these landmarks were put from their places, on average, in sqrt(area): about what
        built pairs are off. 0 for pairs that were given.
    """

    join: JoinedPairs
    areas: FloatArray
    residuals: FloatArray
    error: float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class TrainingSet:
    """The reference and the other training shapes, with what is known of them.

    Attributes
    ----------
    reference : ProbedShape
        S_0.
    reference_index : int
        Its index in X.
    truth_0 : Correspondence
        Where it lies on the template.
    shapes, truths : list of ProbedShape, list of Correspondence
        The other shapes that can be used, and where they lie on the template. Of mirrored ones
        their images, if that was asked.
    indices : ndarray of int
        Their indices in X.
    joins, known : list of JoinedPairs, list of KnownMap
        Pairs of each shape and of the reference that were given, and the map C_i that they make or
        that was built from them. Areas are of the pairs that were given.
    observed : list of Observed
        The pairs that each map was made of.
    wrong : list of ndarray of bool
        Of the pairs that were given, those that were left out as exchanged or out of place.
    share : ndarray of shape (n_shapes,)
        Share of each shape in equation (3).
    k : int
        Number of functions.
    options : LearningOptions
        How it is learned from.
    skipped : str
        Which shapes of X were left out and why; empty if none was.
    n_given : int
        Number of shapes in X.
    memory, n_jobs : object
        Cache, and shapes at a time.
    how : KnownMapsRecord or None
        How known maps came about.
    told : list of str
        What is to be said of that.
    """

    reference: ProbedShape
    reference_index: int
    truth_0: Correspondence
    shapes: list[ProbedShape]
    truths: list[Correspondence]
    indices: IntArray
    joins: list[JoinedPairs]
    known: list[KnownMap]
    observed: list[Observed]
    wrong: list[BoolArray]
    share: FloatArray
    k: int
    options: LearningOptions
    skipped: str
    n_given: int
    memory: MemoryLike
    n_jobs: int | None
    how: KnownMapsRecord | None = None
    told: list[str] = field(default_factory=list)

    @classmethod
    def from_samples(
        cls,
        X: Sequence[ProbedItem],
        y: Sequence[Answer],
        sample_weight: Sequence[float] | None = None,
        *,
        n_functions: int,
        reference: str = "first",
        on_invalid: str = "raise",
        on_mirrored: str = "warn",
        options: LearningOptions | None = None,
        build: KnownMaps | None = None,
        memory: MemoryLike = None,
        n_jobs: int | None = None,
    ) -> Self:
        """Sort out the samples, join them with the reference, and fit the known maps."""
        build = PairsAsGiven() if build is None else build
        given = check_shapes(X, n_functions)
        answers = check_correspondences(y, given, skip=on_invalid == "skip")
        share = check_sample_weight(sample_weight, len(given))
        index = _reference_index(reference, given, answers, n_jobs)
        shape_0, truth_0 = _with_given_mesh(given[index]), answers[index]
        if on_invalid == "skip":
            answers = [
                answer
                if i == index
                else _or_skipped(answer, shape, truth_0, shape_0, n_functions, build)
                for i, (answer, shape) in enumerate(zip(answers, given, strict=True))
            ]
        skipped = skipped_message(answers)
        rest = [
            i
            for i, answer in enumerate(answers)
            if i != index and not isinstance(answer, SkippedShape)
        ]
        if not rest:
            raise ValueError(
                "Give at least two shapes: the reference and one to learn from; got 1."
                + (f" {skipped}" if skipped else "")
            )
        if not share[rest].any():
            raise ValueError(
                "sample_weight is zero for every shape but the reference; there is nothing to "
                "learn from."
            )
        shapes, truths = [given[i] for i in rest], [answers[i] for i in rest]
        joins = [
            join_with_reference(t, s, truth_0, shape_0) for t, s in zip(truths, shapes, strict=True)
        ]
        pairs = GivenPairs(shapes, shape_0, joins, n_functions, memory, n_jobs)
        built = build.build(pairs)
        made = known_maps(
            shapes, shape_0, [one.pairs for one in built], n_functions, memory=memory, n_jobs=n_jobs
        )
        observed = [
            Observed(one.pairs, known.areas, one.residuals, one.error)
            for one, known in zip(built, made, strict=True)
        ]
        known = [_of_given(*parts) for parts in zip(made, built, shapes, joins, strict=True)]
        called = [describe(i, given[i]) for i in rest]
        order, named = [index, *rest], [truth_0, *truths]
        if on_mirrored == "reflect":  # known maps are those of the images too
            shapes = [
                mirror_image(shape) if is_mirror_image(shape, shape_0, join, one) else shape
                for shape, join, one in zip(shapes, joins, known, strict=True)
            ]
        return cls(
            reference=shape_0,
            reference_index=index,
            truth_0=truth_0,
            shapes=shapes,
            truths=truths,
            indices=np.array(rest),
            joins=joins,
            known=known,
            observed=observed,
            wrong=[one.wrong for one in built],
            share=share[rest],
            k=n_functions,
            options=(options or LearningOptions()).resolved(shape_0),
            skipped=skipped,
            n_given=len(given),
            memory=memory,
            n_jobs=n_jobs,
            how=record_of(built, joins, rest, len(given)),
            told=[
                *told_of(pairs, built, called, truth_0.names),
                *filter(None, [spelling_message(named, [describe(i, given[i]) for i in order])]),
            ],
        )

    def __repr__(self) -> str:
        """Return a line with the reference and the number of shapes."""
        return f"TrainingSet({self.reference.name!r}, n_shapes={len(self.shapes)}, k={self.k})"

    @property
    def used(self) -> IntArray:
        """The shapes that have a share in the learning, by their positions here."""
        return np.flatnonzero(self.share > 0)

    def record(self, learned: LearnedMaps) -> FitRecord:
        """Return what outlives `fit`, beside what is matched with."""
        return FitRecord(
            reference_index=self.reference_index,
            reference_correspondence=self.truth_0,
            n_shapes=len(self.used),
            total_share=float(self.share.sum()),
            stability=learned.stability,
            epsilon=learned.epsilon,
            loss_curve=learned.optimum.loss_curve,
            n_iter=learned.optimum.n_iter,
            converged=learned.optimum.converged,
        )

    def describe(self, i: int) -> str:
        """Return what messages call the i-th shape here: by its index in X and its name."""
        return describe(int(self.indices[i]), self.shapes[i])

    def points(self, i: int) -> FloatArray:
        """Return the points of the i-th shape that are paired, at unit area: (n_pairs, 3).

        Those that were measured, or where the pairs are on the surface; of the image of a shape
        that was reflected.
        """
        shape, truth, join = self.shapes[i].spectral, self.truths[i], self.joins[i]
        if truth.coordinates is None:
            return shape.vertices_at(join.vertices_i, join.places_i)
        order = np.argsort(truth.pairs[:, 1])
        rows = order[np.searchsorted(truth.pairs[order, 1], join.points)]
        measured = truth.coordinates[rows] / np.sqrt(shape.area)
        return measured * MIRROR if self.shapes[i].reflected else measured

    def wrong_on_reference(self) -> IntArray:
        """Return the points that were left out on most shapes: the reference has the slip."""
        points, at = np.unique(
            np.concatenate([join.points for join in self.joins]), return_inverse=True
        )
        n_wrong = np.bincount(at, np.concatenate(self.wrong))
        return np.asarray(points[is_on_most(n_wrong, np.bincount(at))])

    def only(self, rows: IntArray) -> Self:
        """Return the training set of some of the shapes, and the reference."""
        parts: dict[str, Any] = {
            name: [getattr(self, name)[i] for i in rows]
            for name in ("shapes", "truths", "joins", "known", "observed", "wrong")
        }
        return replace(self, **parts, indices=self.indices[rows], share=self.share[rows])

    def truncation(self) -> FloatArray:
        """Return how far known maps in all functions held put points from where they belong.

        Averaged over the shapes that have a share. Where maps were built, what landmarks were
        missed by that were left out then tells how much of it they hide.
        """
        rows = self.used
        size = min(len(self.known[i].truncation) for i in rows)
        parts = [self.known[i].truncation[:size, :size] for i in rows]
        covariance = np.average(parts, axis=0, weights=self.share[rows])
        missed = [self.observed[i].residuals for i in rows if len(self.observed[i].residuals)]
        if not missed:
            return np.asarray(covariance)
        return calibrated_covariance(covariance, np.vstack([part[:, :size] for part in missed]))

    def arrays(self) -> dict[str, Any]:
        """Return what equation (3) is about, as `learn_functional_maps` takes it."""
        k = self.k
        return {
            "probes_0": self.reference.probes[:k],
            "probes": np.stack([shape.probes[:k] for shape in self.shapes]),
            "evals_0": self.reference.spectral.evals[:k],
            "evals": np.stack([shape.spectral.evals[:k] for shape in self.shapes]),
            "maps": np.stack([one.C for one in self.known]),
            "sample_weight": self.share,
        }

    def learn(
        self,
        *,
        start: FloatArray | None = None,
        n_threads: int = 1,
        callback: Callable[..., bool | None] | None = None,
        **changes: Any,
    ) -> LearnedMaps:
        """Learn weights and stable basis (equations 3 and 4, section 4.1).

        Parameters
        ----------
        start, n_threads, callback : ndarray, int, callable
            As of `learn_functional_maps`.
        **changes : optional
            Options other than those of the training set.

        Returns
        -------
        LearnedMaps
            What was learned.
        """
        return learn_functional_maps(
            **self.arrays(),
            **self.options._replace(**changes)._asdict(),
            start=start,
            n_threads=n_threads,
            callback=callback,
        )


def _with_given_mesh(shape: ProbedShape) -> ProbedShape:
    """Return a shape with the mesh that it was given as, which answers need."""
    given = shape.spectral.given
    if given is None:
        return shape
    kept = replace(shape.spectral, given=given.found_at(open_given(given)))
    return replace(shape, spectral=kept)


def _reference_index(
    reference: str, shapes: Sequence[Any], truths: Sequence[Any], n_jobs: int | None
) -> int:
    """Return the index of the reference; one that cannot be used is an error."""
    index = _index_of(reference, shapes, truths, n_jobs)
    for what in (shapes[index], truths[index]):
        if isinstance(what, SkippedShape):
            raise MeshError(
                f"The reference, {describe(index, what)}, cannot be used: {what.reason} Mend it "
                "or choose another."
            )
    return index


def _index_of(
    reference: str, shapes: Sequence[Any], truths: Sequence[Any], n_jobs: int | None
) -> int:
    if reference == "first":
        return 0
    if reference == "medoid":
        sound = [i for i in range(len(shapes)) if not isinstance(truths[i], SkippedShape)]
        if not sound:
            raise MeshError(
                f"No shape can be used: {truths[0].reason} All others are left out too."
            )
        return sound[medoid_index([shapes[i] for i in sound], [truths[i] for i in sound], n_jobs)]
    names = [shape.name for shape in shapes]
    if names.count(reference) != 1:
        raise ValueError(
            f"reference={reference!r} must name exactly one of the training shapes; got {names}. "
            "In a search that resamples, keep it in every fold with PinnedReference."
        )
    return names.index(reference)


def _of_given(known: KnownMap, built: BuiltMap, shape: ProbedShape, join: JoinedPairs) -> KnownMap:
    """Return a known map with the areas of the pairs that were given."""
    if built.pairs is join:
        return known
    areas = np.where(built.wrong, 0.0, areas_of_pairs(shape, join))
    return known._replace(areas=areas, n_wrong=0)


def _or_skipped(
    truth: Any,
    shape: Any,
    truth_0: Correspondence,
    reference: ProbedShape,
    k: int,
    build: KnownMaps,
) -> Any:
    """Return the correspondence, or why there is nothing to be learned from it."""
    if isinstance(truth, SkippedShape):
        return truth
    try:
        build.check(shape, reference, join_with_reference(truth, shape, truth_0, reference), k)
    except CorrespondenceError as error:
        return SkippedShape(shape.name, str(error))
    return truth
