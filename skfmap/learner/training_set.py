"""The training set: the reference, the other training shapes, and their known maps."""

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
    """Parameters of `learn_functional_maps`, as set on the learner."""

    weighting: Weighting = "function"
    categories: Sequence[str] | None = None
    epsilon: float | str = "auto"
    alpha: float = 0.01
    regularizer: str | Regularizer = "laplacian"
    normalize: str = "shape"
    max_iter: int = 1000
    tol: float = 1e-4

    def resolved(self, reference: ProbedShape) -> Self:
        """Return the options with labels in place of a callable ``weighting``."""
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
    """Facts about the training set and the search that a fitted learner keeps.

    The training set itself is not kept after `fit`.
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
        """Final value of equation (3)."""
        return self.loss_curve[-1]


class Observed(NamedTuple):
    """Pairs at which the errors of learned maps are observed.

    Attributes
    ----------
    join, areas : JoinedPairs, ndarray of shape (n_pairs,)
        The pairs that the known map was fitted to, and the area that each represents.
    residuals : ndarray of shape (n, n_components)
        Residuals of landmarks that were left out while the map was built; no rows if it was not
        built.
    error : float
        Mean distance of these landmarks from their places, in sqrt(area), which is about the error
        of built pairs. 0 for pairs that were given.
    """

    join: JoinedPairs
    areas: FloatArray
    residuals: FloatArray
    error: float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class TrainingSet:
    """The reference and the other training shapes, with their correspondences and known maps.

    Attributes
    ----------
    reference : ProbedShape
        The reference S_0.
    reference_index : int
        Its index in X.
    truth_0 : Correspondence
        Where it lies on the template.
    shapes, truths : list of ProbedShape, list of Correspondence
        The other usable shapes, and where they lie on the template. Mirrored shapes are replaced by
        their mirror images if ``on_mirrored="reflect"``.
    indices : ndarray of int
        Their indices in X.
    joins, known : list of JoinedPairs, list of KnownMap
        The given pairs of each shape and the reference, and the map C_i that was fitted to them or
        built from them. Areas are those of the given pairs.
    observed : list of Observed
        The pairs that each map was fitted to.
    wrong : list of ndarray of bool
        Which of the given pairs were left out as swapped or out of place.
    share : ndarray of shape (n_shapes,)
        Share of each shape in equation (3).
    k : int
        Number of functions.
    options : LearningOptions
        Parameters of learning.
    skipped : str
        Message about shapes of X that were left out; empty if there are none.
    n_given : int
        Number of shapes in X.
    memory, n_jobs : object
        Cache, and number of shapes processed in parallel.
    how : KnownMapsRecord or None
        How the known maps were made.
    told : list of str
        Messages about the known maps.
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
        """Check the samples, join them with the reference, and fit the known maps."""
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
                "Give at least two usable shapes, the reference and one to learn from; got 1."
                + (f" {skipped}" if skipped else "")
            )
        if not share[rest].any():
            raise ValueError(
                "sample_weight is zero for every shape except the reference, so there is nothing "
                "to learn from; give one of them a positive weight."
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
        if on_mirrored == "reflect":  # mirror images have the same known maps
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
        """Return the reference, the number of shapes and of functions in one line."""
        return f"TrainingSet({self.reference.name!r}, n_shapes={len(self.shapes)}, k={self.k})"

    @property
    def used(self) -> IntArray:
        """Positions of the shapes with a positive share."""
        return np.flatnonzero(self.share > 0)

    def record(self, learned: LearnedMaps) -> FitRecord:
        """Return the facts that a fitted learner keeps, in addition to its matcher."""
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
        """Return the i-th shape's index in X and its name, for messages."""
        return describe(int(self.indices[i]), self.shapes[i])

    def points(self, i: int) -> FloatArray:
        """Return the paired points of the i-th shape at unit area, shape (n_pairs, 3).

        They are the measured points, or else the places of the pairs on the surface. For a
        reflected shape they are points of its mirror image.
        """
        shape, truth, join = self.shapes[i].spectral, self.truths[i], self.joins[i]
        if truth.coordinates is None:
            return shape.vertices_at(join.vertices_i, join.places_i)
        order = np.argsort(truth.pairs[:, 1])
        rows = order[np.searchsorted(truth.pairs[order, 1], join.points)]
        measured = truth.coordinates[rows] / np.sqrt(shape.area)
        return measured * MIRROR if self.shapes[i].reflected else measured

    def wrong_on_reference(self) -> IntArray:
        """Return the points left out on most shapes, which are wrong on the reference."""
        points, at = np.unique(
            np.concatenate([join.points for join in self.joins]), return_inverse=True
        )
        n_wrong = np.bincount(at, np.concatenate(self.wrong))
        return np.asarray(points[is_on_most(n_wrong, np.bincount(at))])

    def only(self, rows: IntArray) -> Self:
        """Return the training set with the reference and only some of the shapes."""
        parts: dict[str, Any] = {
            name: [getattr(self, name)[i] for i in rows]
            for name in ("shapes", "truths", "joins", "known", "observed", "wrong")
        }
        return replace(self, **parts, indices=self.indices[rows], share=self.share[rows])

    def truncation(self) -> FloatArray:
        """Return the residual covariance of known maps in all functions of the basis.

        It is averaged over the shapes with a positive share. If maps were built, the residuals of
        landmarks left out of the building calibrate it.
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
        """Return the arrays of equation (3), as arguments of `learn_functional_maps`."""
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
        """Learn the weights and the stable basis (equations 3 and 4, section 4.1).

        Parameters
        ----------
        start, n_threads, callback : ndarray, int, callable
            As in `learn_functional_maps`.
        **changes : optional
            Options that replace those of the training set.

        Returns
        -------
        LearnedMaps
            The learned maps.
        """
        return learn_functional_maps(
            **self.arrays(),
            **self.options._replace(**changes)._asdict(),
            start=start,
            n_threads=n_threads,
            callback=callback,
        )


def _with_given_mesh(shape: ProbedShape) -> ProbedShape:
    """Return a shape together with its given mesh, which answers need."""
    given = shape.spectral.given
    if given is None:
        return shape
    kept = replace(shape.spectral, given=given.found_at(open_given(given)))
    return replace(shape, spectral=kept)


def _reference_index(
    reference: str, shapes: Sequence[Any], truths: Sequence[Any], n_jobs: int | None
) -> int:
    """Return the index of the reference; raise if it cannot be used."""
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
            raise MeshError(f"No shape can be used. The first: {truths[0].reason}")
        return sound[medoid_index([shapes[i] for i in sound], [truths[i] for i in sound], n_jobs)]
    names = [shape.name for shape in shapes]
    if names.count(reference) != 1:
        raise ValueError(
            f"reference={reference!r} must name exactly one of the training shapes; got {names}. "
            "In a search or cross-validation, keep it in every fold with PinnedReference."
        )
    return names.index(reference)


def _of_given(known: KnownMap, built: BuiltMap, shape: ProbedShape, join: JoinedPairs) -> KnownMap:
    """Return a known map with the areas of the given pairs."""
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
    """Return the correspondence, or a skipped shape with the reason why it cannot be used."""
    if isinstance(truth, SkippedShape):
        return truth
    try:
        build.check(shape, reference, join_with_reference(truth, shape, truth_0, reference), k)
    except CorrespondenceError as error:
        return SkippedShape(shape.name, str(error))
    return truth
