"""Checks of what the learner is given: shapes and correspondences."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from skfmap._tools.validation import check_index_range, check_pairs, check_samples, label
from skfmap._tools.warn import warn
from skfmap.exceptions import CorrespondenceError, CoverageWarning
from skfmap.shapes import Correspondence, Landmarks, ProbedShape, SkippedShape
from skfmap.shapes.usable import Usable, describe, pick_usable, warn_of_skipped

__all__ = ["check_correspondences", "check_new_shapes", "check_scored", "check_shapes"]

# Share of the pairs of a shape that may be at vertices without a place without a word.
_MANY_LOST = 0.02


def check_shapes(X: object, n_functions: int) -> Sequence[Any]:
    """Return the shapes, skipped ones among them.

    What cannot be learned from together is an error.
    """
    if isinstance(X, ProbedShape):
        raise TypeError("X is one probed shape, not a sequence of them; wrap it in a list: [X].")
    shapes = check_samples(X, "probed shapes")
    first: Any = None
    for i, shape in enumerate(shapes):
        if isinstance(shape, SkippedShape):
            continue
        who, first = describe(i, shape), first or shape
        if not isinstance(shape, ProbedShape):
            raise TypeError(
                f"X[{i}] is a {type(shape).__name__}, not a ProbedShape; put SpectralBasis and "
                "DescriptorTransformer before the learner."
            )
        if shape.spectral.n_components < n_functions:
            raise ValueError(
                f"{who} has {shape.spectral.n_components} eigenfunctions, fewer than "
                f"n_functions={n_functions}; raise n_components of SpectralBasis, or lower "
                "n_functions."
            )
        _check_same_probes(shape, first, who, "the shapes before")
        if not np.isfinite(shape.probes).all():
            raise ValueError(
                f"{who} has probe functions with NaN or infinite coefficients; check its mesh."
            )
    return shapes


def check_new_shapes(X: object, reference: ProbedShape, n_functions: int) -> Usable:
    """Return the new shapes that can be used, and those that are skipped."""
    usable = pick_usable(check_shapes(X, n_functions))
    for i, shape in zip(usable.indices, usable.shapes, strict=True):
        _check_same_probes(shape, reference, describe(i, shape), "the training shapes")
    return usable


def check_scored(
    X: Any, y: object, reference: ProbedShape, n_functions: int, *, skip: bool
) -> tuple[Usable, list[Any]]:
    """Return new shapes and their correspondences.

    With ``skip``, a shape whose own does not fit is skipped too.
    """
    check_new_shapes(X, reference, n_functions)
    answers = check_correspondences(y, X, skip=skip)
    shapes = [
        a if isinstance(a, SkippedShape) else shape for shape, a in zip(X, answers, strict=True)
    ]
    warn_of_skipped([one for one, shape in zip(shapes, X, strict=True) if one is not shape])
    usable = pick_usable(shapes)
    return usable, [answers[i] for i in usable.indices]


def check_correspondences(
    y: object, shapes: Sequence[ProbedShape | SkippedShape], *, skip: bool = False
) -> list[Any]:
    """Return correspondences without the vertices that have no place on their working meshes.

    Those with names are numbered alike, by names. For a shape that is skipped, the `SkippedShape`
    itself.

    With ``skip``, one that does not fit becomes a `SkippedShape` too.
    """
    if y is None:
        raise ValueError(
            "y is None; the learner needs where each shape lies on the template: one "
            "Correspondence each."
        )
    given = list(y) if isinstance(y, np.ndarray) and y.ndim == 3 else y
    items = check_samples(given, "correspondences", "y")
    if len(items) != len(shapes):
        raise ValueError(
            f"X has {len(shapes)} shapes, but y has {len(items)} correspondences; give one for "
            "each."
        )
    checked = [
        _checked(item, i, shape, skip)
        for i, (item, shape) in enumerate(zip(items, shapes, strict=True))
    ]
    _warn_of_lost_pairs(items, checked, shapes)
    return _numbered_alike(checked, shapes)


def _numbered_alike(checked: list[Any], shapes: Sequence[Any]) -> list[Any]:
    """Return correspondences whose template points have one numbering, by their names if any."""
    given = [i for i, one in enumerate(checked) if isinstance(one, Correspondence)]
    named = [i for i in given if checked[i].names is not None]
    if not named:
        return checked
    if unnamed := [describe(i, shapes[i]) for i in given if i not in named]:
        raise CorrespondenceError(
            f"The template points of {describe(named[0], shapes[named[0]])} have names, but those "
            f"of {', '.join(unnamed)} do not, so that they cannot be joined by them. Give names to "
            "all correspondences, or to none."
        )
    names = tuple(dict.fromkeys(name for i in named for name in checked[i].names))
    return [one.number_by(names) if i in named else one for i, one in enumerate(checked)]


def _warn_of_lost_pairs(
    items: Sequence[Any], checked: Sequence[Any], shapes: Sequence[Any]
) -> None:
    """Name the shapes many of whose pairs are at vertices without a place."""
    told = []
    for i, (item, kept, shape) in enumerate(zip(items, checked, shapes, strict=True)):
        if isinstance(kept, SkippedShape) or shape.spectral.prolongation is None:
            continue
        n = len(item.pairs if isinstance(item, Correspondence) else item)
        if n - len(kept.pairs) > _MANY_LOST * n:
            told.append(f"{n - len(kept.pairs)} of the {n} pairs of {describe(i, shape)}")
    if told:
        warn(
            f"{', '.join(told)} are at vertices that were left out when the mesh was mended or "
            "wrapped, and are neither learned from nor scored.",
            CoverageWarning,
        )


def _check_same_probes(shape: ProbedShape, other: ProbedShape, who: str, whom: str) -> None:
    """Raise unless both shapes have the same probe functions, made with the same parameters."""
    if shape.probe_names != other.probe_names:
        raise ValueError(
            f"{who} has other probe functions than {whom} ({shape.probes.shape[1]} against "
            f"{other.probes.shape[1]}); use one DescriptorTransformer for all shapes."
        )
    differing = [
        f"{a} against {b}" for a, b in zip(shape.recipe, other.recipe, strict=False) if a != b
    ]
    if differing:
        raise ValueError(
            f"The probe functions of {who} were made with other parameters than those of {whom}: "
            f"{differing[0]}. Use the same SpectralBasis and DescriptorTransformer."
        )


def _checked(
    item: object, i: int, shape: ProbedShape | SkippedShape, skip: bool
) -> Correspondence | SkippedShape:
    if isinstance(shape, SkippedShape):
        return shape
    try:
        return _placed(_check_correspondence(item, i, shape), shape)
    except CorrespondenceError as error:
        if not skip:
            raise
        return SkippedShape(shape.name, str(error), shape.spectral.n_given)


def _check_correspondence(item: object, i: int, shape: ProbedShape) -> Correspondence:
    who = f"y[{i}]" if shape.name is None else f"y[{i}] (of {shape.name!r})"
    if isinstance(item, Landmarks):
        raise TypeError(
            f"{who} is Landmarks, which are put onto their mesh first: "
            "Correspondence.from_points(landmarks, mesh)."
        )
    truth = item if isinstance(item, Correspondence) else Correspondence(check_pairs(item, who))
    n_vertices = shape.spectral.n_given
    if truth.n_vertices not in (None, n_vertices):
        raise CorrespondenceError(
            f"{who} was made for {truth.n_vertices} vertices, but the shape has {n_vertices}. If "
            "it holds the vertex of each template point, use Correspondence.from_template."
        )
    check_index_range(truth.pairs[:, 0], n_vertices, f"The pairs of {who}")
    check_index_range(truth.corners, n_vertices, f"The places of {who}")
    if truth.symmetric_pairs is not None:
        check_index_range(truth.symmetric_pairs[:, 0], n_vertices, f"The symmetric pairs of {who}")
    if len(truth.pairs) == 0:
        raise CorrespondenceError(f"{who} holds no pairs; leave the shape out.")
    if truth.weights is not None and not truth.weights.any():
        raise CorrespondenceError(f"All weights of {who} are zero; leave the shape out.")
    return truth


def _placed(truth: Correspondence, shape: ProbedShape) -> Correspondence:
    """Return the pairs of vertices that have a place on the working mesh."""
    prolongation = shape.spectral.prolongation
    if prolongation is None or prolongation.placed.all():
        return truth
    kept = truth.renumber(np.where(prolongation.placed, np.arange(len(prolongation.face)), -1))
    if len(kept.pairs) == 0:
        raise CorrespondenceError(
            f"All pairs of {label(shape.name, 'shape')} are at vertices that were left out when "
            "its mesh was mended; leave the shape out, or mend it yourself."
        )
    return kept
