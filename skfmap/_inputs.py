"""Checks of what the learner is given: shapes, correspondences, shares."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from skfmap._skipped import renumber
from skfmap._validation import check_index_range, check_pairs, check_samples
from skfmap.exceptions import CorrespondenceError
from skfmap.shapes import Correspondence, ProbedShape, SkippedShape

__all__ = ["check_correspondences", "check_same_probes", "check_shapes", "place"]


def place(i: int, shape: object) -> str:
    """Return how a message refers to the shape at place ``i`` of X."""
    name = getattr(shape, "name", None)
    return f"X[{i}]" if name is None else f"X[{i}] ({name!r})"


def check_same_probes(shape: ProbedShape, other: ProbedShape, who: str, whom: str) -> None:
    """Raise unless both shapes have the same probe functions, made with the same parameters."""
    if shape.probe_names != other.probe_names:
        raise ValueError(
            f"{who} has other probe functions than {whom} ({shape.probes.shape[1]} against {other.probes.shape[1]}); "
            "use one DescriptorTransformer for all shapes."
        )
    differing = [f"{a} against {b}" for a, b in zip(shape.recipe, other.recipe, strict=False) if a != b]
    if differing:
        raise ValueError(
            f"The probe functions of {who} were made with other parameters than those of {whom}: {differing[0]}. "
            "Use the same SpectralBasis and DescriptorTransformer."
        )


def check_shapes(X: object, n_functions: int) -> Sequence[Any]:
    if isinstance(X, ProbedShape):
        raise TypeError("X must be a sequence of probed shapes, but it is one; wrap it in a list: [X].")
    shapes = check_samples(X, "probed shapes")
    first: Any = None
    for i, shape in enumerate(shapes):
        if isinstance(shape, SkippedShape):
            continue
        who, first = place(i, shape), first or shape
        if not isinstance(shape, ProbedShape):
            raise TypeError(
                f"X[{i}] is a {type(shape).__name__}, not a ProbedShape; put SpectralBasis and DescriptorTransformer "
                "before the learner."
            )
        if shape.spectral.n_components < n_functions:
            raise ValueError(
                f"{who} has {shape.spectral.n_components} eigenfunctions, fewer than n_functions={n_functions}; raise "
                "n_components of SpectralBasis, or lower n_functions."
            )
        check_same_probes(shape, first, who, "the shapes before")
        if not np.isfinite(shape.probes).all():
            raise ValueError(f"{who} has probe functions with NaN or infinite coefficients; check its mesh.")
    return shapes


def check_correspondences(y: object, shapes: Sequence[ProbedShape | SkippedShape], *, skip: bool = False) -> list[Any]:
    """Return correspondences in the numbers of their shapes' meshes; for a shape that is skipped, the same as there.

    With ``skip``, one that does not fit becomes a `SkippedShape` too.
    """
    if y is None:
        raise ValueError("y is None; the learner needs where each shape lies on the template: one Correspondence each.")
    given = list(y) if isinstance(y, np.ndarray) and y.ndim == 3 else y
    items = check_samples(given, "correspondences", "y")
    if len(items) != len(shapes):
        raise ValueError(f"X has {len(shapes)} shapes, but y has {len(items)} correspondences; give one for each.")
    return [_checked(item, i, shape, skip) for i, (item, shape) in enumerate(zip(items, shapes, strict=True))]


def _checked(item: object, i: int, shape: ProbedShape | SkippedShape, skip: bool) -> Correspondence | SkippedShape:
    if isinstance(shape, SkippedShape):
        return shape
    try:
        return renumber(_check_correspondence(item, i, shape), shape)
    except CorrespondenceError as error:
        if not skip:
            raise
        return SkippedShape(shape.name, str(error), _n_given(shape))


def _n_given(shape: ProbedShape) -> int:
    """Return how many vertices a shape came with."""
    vertex_map = shape.spectral.vertex_map
    return shape.spectral.mesh.n_vertices if vertex_map is None else len(vertex_map)


def _check_correspondence(item: object, i: int, shape: ProbedShape) -> Correspondence:
    who = f"y[{i}]" if shape.name is None else f"y[{i}] (of {shape.name!r})"
    truth = item if isinstance(item, Correspondence) else Correspondence(check_pairs(item, who))
    n_vertices = _n_given(shape)
    if truth.n_vertices not in (None, n_vertices):
        raise CorrespondenceError(
            f"{who} was made for {truth.n_vertices} vertices, but the shape has {n_vertices}. If it holds the vertex "
            "of each template point, use Correspondence.from_template."
        )
    check_index_range(truth.pairs[:, 0], n_vertices, f"The pairs of {who}")
    if truth.symmetric_pairs is not None:
        check_index_range(truth.symmetric_pairs[:, 0], n_vertices, f"The symmetric pairs of {who}")
    if len(truth.pairs) == 0:
        raise CorrespondenceError(f"{who} holds no pairs; leave the shape out.")
    if truth.weights is not None and not truth.weights.any():
        raise CorrespondenceError(f"All weights of {who} are zero; leave the shape out.")
    return truth
