"""Answers on the vertices that a mesh came with, where mending has renumbered them."""

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from skfmap._tools.types import IntArray
from skfmap.shapes.correspondence import Correspondence
from skfmap.shapes.match import Match
from skfmap.shapes.probed_shape import ProbedShape
from skfmap.shapes.spectral_shape import SpectralShape

__all__ = ["as_given", "as_renumbered", "expand", "given_numbers", "n_given_vertices", "renumber"]


def n_given_vertices(shape: SpectralShape) -> int:
    """Return how many vertices a shape came with."""
    return shape.mesh.n_vertices if shape.vertex_map is None else len(shape.vertex_map)


def renumber(truth: Correspondence, shape: SpectralShape) -> Correspondence:
    """Return a correspondence in the numbers of the mended mesh."""
    return truth if shape.vertex_map is None else truth.renumber(shape.vertex_map)


def as_renumbered(shape: ProbedShape) -> ProbedShape:
    """Return the shape as if its vertices had always had the numbers of the mended mesh."""
    return replace(shape, spectral=replace(shape.spectral, vertex_map=None))


def as_given(match: Match, vertex_map: IntArray | None) -> Match:
    """Return a match in the numbers that the mesh came with.

    -1 and NaN where a vertex was removed.
    """
    if vertex_map is None:
        return match
    kept, given = vertex_map >= 0, given_numbers(vertex_map)
    rows = sp.csr_array(
        (np.ones(kept.sum()), (np.flatnonzero(kept), vertex_map[kept])),
        shape=(len(kept), len(given)),
    )
    empty = {"p2p": -1, "expected_error": np.nan, "confidence": np.nan, "n_supporting": 0}
    return replace(
        match,
        **{
            name: expand(getattr(match, name), vertex_map, nothing)
            for name, nothing in empty.items()
        },
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
    """Return values at the vertices that the mesh came with, ``empty`` where they were removed.

    None stays None.
    """
    if vertex_map is None or values is None:
        return values
    out = np.full(len(vertex_map), empty, dtype=values.dtype)
    kept = vertex_map >= 0
    out[kept] = values[vertex_map[kept]]
    return out
