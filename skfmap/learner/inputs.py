"""Checks of the learner's input: shapes and correspondences."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from skfmap._tools.validation import check_index_range, check_pairs, check_samples, label
from skfmap._tools.warn import warn
from skfmap.exceptions import CorrespondenceError, CoverageWarning
from skfmap.shapes import Correspondence, Landmarks, ProbedShape, SkippedShape
from skfmap.shapes.usable import Usable, describe, pick_usable, warn_of_skipped

__all__ = ["check_correspondences", "check_new_shapes", "check_scored", "check_shapes"]

# The user is warned if more than this fraction of a shape's pairs is at vertices without a place.
_MANY_LOST = 0.02


def check_shapes(X: object, n_functions: int) -> Sequence[Any]:
    """Return the shapes, including skipped ones; raise if they cannot be used together."""
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
    """Return the usable new shapes, and those that are skipped."""
    usable = pick_usable(check_shapes(X, n_functions))
    for i, shape in zip(usable.indices, usable.shapes, strict=True):
        _check_same_probes(shape, reference, describe(i, shape), "the training shapes")
    return usable


def check_scored(
    X: Any, y: object, reference: ProbedShape, n_functions: int, *, skip: bool
) -> tuple[Usable, list[Any]]:
    """Return new shapes and their correspondences.

    With ``skip``, a shape whose correspondence does not fit is skipped too.
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

    Named template points are numbered by name, in the same way for all shapes. A skipped shape is
    returned in place of its correspondence; with ``skip``, a correspondence that does not fit
    becomes a `SkippedShape` too.
    """
    if y is None:
        raise ValueError(
            "y is None, but the learner needs to know where each shape lies on the template; give "
            "one Correspondence per shape."
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
    """Return correspondences with a common numbering of template points, by name if there are."""
    given = [i for i, one in enumerate(checked) if isinstance(one, Correspondence)]
    named = [i for i in given if checked[i].names is not None]
    if not named:
        return checked
    if unnamed := [describe(i, shapes[i]) for i in given if i not in named]:
        raise CorrespondenceError(
            f"The template points of {describe(named[0], shapes[named[0]])} have names, but those "
            f"of {', '.join(unnamed)} do not, so they cannot be joined by name. Give names to all "
            "correspondences, or to none."
        )
    names = tuple(dict.fromkeys(name for i in named for name in checked[i].names))
    return [one.number_by(names) if i in named else one for i, one in enumerate(checked)]


def _warn_of_lost_pairs(
    items: Sequence[Any], checked: Sequence[Any], shapes: Sequence[Any]
) -> None:
    """Warn of shapes with many pairs at vertices without a place."""
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
            "wrapped; these pairs are not used for learning or scores.",
            CoverageWarning,
        )


def _check_same_probes(shape: ProbedShape, other: ProbedShape, who: str, whom: str) -> None:
    """Raise unless both shapes have the same probe functions, computed with equal parameters."""
    if shape.probe_names != other.probe_names:
        raise ValueError(
            f"{who} has different probe functions from {whom} ({shape.probes.shape[1]} against "
            f"{other.probes.shape[1]}); use one DescriptorTransformer for all shapes."
        )
    differing = [
        f"{a} against {b}" for a, b in zip(shape.recipe, other.recipe, strict=False) if a != b
    ]
    if differing:
        raise ValueError(
            f"The probe functions of {who} were computed with different parameters from those of "
            f"{whom}: {differing[0]}. Use the same SpectralBasis and DescriptorTransformer."
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
            f"{who} is a Landmarks object; put the points onto their mesh first, with "
            "Correspondence.from_points(landmarks, mesh)."
        )
    truth = item if isinstance(item, Correspondence) else Correspondence(check_pairs(item, who))
    n_vertices = shape.spectral.n_given
    if truth.n_vertices not in (None, n_vertices):
        raise CorrespondenceError(
            f"{who} was made for {truth.n_vertices} vertices, but the shape has {n_vertices}. If "
            "it lists the vertex of each template point, use Correspondence.from_template."
        )
    check_index_range(truth.pairs[:, 0], n_vertices, f"The pairs of {who}")
    check_index_range(truth.corners, n_vertices, f"The places of {who}")
    if truth.symmetric_pairs is not None:
        check_index_range(truth.symmetric_pairs[:, 0], n_vertices, f"The symmetric pairs of {who}")
    if len(truth.pairs) == 0:
        raise CorrespondenceError(f"{who} has no pairs; leave the shape out.")
    if truth.weights is not None and not truth.weights.any():
        raise CorrespondenceError(f"All weights of {who} are zero; leave the shape out.")
    return truth


def _placed(truth: Correspondence, shape: ProbedShape) -> Correspondence:
    """Return a correspondence with the pairs whose vertices have a place on the working mesh."""
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
