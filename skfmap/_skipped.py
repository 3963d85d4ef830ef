"""Shapes that cannot be used keep their places, and vertices that were removed theirs."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from skfmap._typing import IntArray
from skfmap._validation import label
from skfmap.exceptions import RepairWarning, SkippedShapeWarning
from skfmap.shapes import Correspondence, Match, SkippedShape

__all__ = [
    "Sorted",
    "as_given",
    "expand",
    "given_numbers",
    "no_match",
    "renumber",
    "sort_out",
    "spread",
    "warn_of_repairs",
    "warn_of_skipped",
]


class Sorted(NamedTuple):
    """The shapes of X that can be used, where they stood, and those that cannot."""

    shapes: list[Any]
    places: list[int]
    skipped: dict[int, SkippedShape]


def sort_out(X: Sequence[Any]) -> Sorted:
    """Return the shapes that can be used and their places, and the others by place."""
    skipped = {i: shape for i, shape in enumerate(X) if isinstance(shape, SkippedShape)}
    places = [i for i in range(len(X)) if i not in skipped]
    return Sorted([X[i] for i in places], places, skipped)


def spread(answers: Sequence[Any], given: Sorted, empty: Any) -> list[Any]:
    """Return the answers at the places of their shapes, and ``empty(shape)`` for those that were skipped."""
    known = dict(zip(given.places, answers, strict=True))
    known |= {place: empty(shape) for place, shape in given.skipped.items()}
    return [known[place] for place in range(len(known))]


def warn_of_skipped(shapes: Sequence[Any], told: Sequence[Any] = ()) -> None:
    """Name the shapes that are left out, and why; but for those that were in ``told``, of which somebody has warned."""
    before = {i for i, shape in enumerate(told) if isinstance(shape, SkippedShape)}
    skipped = [(i, one) for i, one in enumerate(shapes) if isinstance(one, SkippedShape) and i not in before]
    if skipped:
        told = "; ".join(f"X[{i}], {label(shape.name, 'shape')}: {shape.reason}" for i, shape in skipped)
        warnings.warn(f"{len(skipped)} of {len(shapes)} shapes are left out. {told}", SkippedShapeWarning, stacklevel=3)


def warn_of_repairs(made: Sequence[tuple[Any, str]]) -> None:
    """Name the shapes that were mended, and say what was done."""
    told = [f"{label(shape.name, 'shape')}: {done}" for shape, done in made if done]
    if told:
        warnings.warn(f"Meshes were mended. {'; '.join(told)}.", RepairWarning, stacklevel=3)


def no_match(shape: SkippedShape, reference: Any, k: int, p: int) -> Match:
    """Return the answer for a shape that cannot be used: -1 and NaN."""
    unknown = np.full(shape.n_vertices, np.nan)
    n_0 = reference.spectral.mesh.n_vertices
    return Match(
        np.full(shape.n_vertices, -1),
        unknown,
        unknown,
        np.full((k, k), np.nan),
        np.full((k, p), np.nan),
        shape.name,
        reference.name,
        n_supporting=np.zeros(shape.n_vertices, dtype=np.int64),
        matrix=sp.csr_array((shape.n_vertices, n_0)),
        inverse=np.full(n_0, -1),
        reference_hash=reference.spectral.mesh.content_hash,
    )


def renumber(truth: Correspondence, shape: Any) -> Correspondence:
    """Return a correspondence in the numbers of the mended mesh."""
    vertex_map = shape.spectral.vertex_map
    return truth if vertex_map is None else truth.renumber(vertex_map)


def as_given(match: Match, vertex_map: IntArray | None) -> Match:
    """Return a match in the numbers that the mesh came with; -1 and NaN where a vertex was removed."""
    if vertex_map is None:
        return match
    kept = vertex_map >= 0
    given = given_numbers(vertex_map)
    rows = sp.csr_array((np.ones(kept.sum()), (np.flatnonzero(kept), vertex_map[kept])), shape=(len(kept), len(given)))
    return replace(
        match,
        p2p=expand(match.p2p, vertex_map, -1),
        expected_error=expand(match.expected_error, vertex_map, np.nan),
        confidence=expand(match.confidence, vertex_map, np.nan),
        n_supporting=None if match.n_supporting is None else expand(match.n_supporting, vertex_map, 0),
        matrix=None if match.matrix is None else (rows @ match.matrix).tocsr(),
        inverse=None if match.inverse is None else given[match.inverse],
    )


def given_numbers(vertex_map: IntArray) -> IntArray:
    """Return the number that each vertex of a mended mesh came with; of merged ones, the last."""
    kept = np.flatnonzero(vertex_map >= 0)
    given = np.full(int(vertex_map.max()) + 1, -1)
    given[vertex_map[kept]] = kept
    return given


def expand(values: Any, vertex_map: IntArray | None, empty: float) -> Any:
    """Return values at the vertices that the mesh came with, ``empty`` where they were removed."""
    if vertex_map is None:
        return values
    out = np.full(len(vertex_map), empty, dtype=values.dtype)
    kept = vertex_map >= 0
    out[kept] = values[vertex_map[kept]]
    return out
