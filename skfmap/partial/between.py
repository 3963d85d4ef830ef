"""Maps between two new shapes, through the reference, if at least one of them is a part."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.functional.neighbours import nearest
from skfmap.geometry.faults import sound_faces
from skfmap.geometry.normals import vertex_normals
from skfmap.learner.new_shape import blank_match
from skfmap.partial.answers import Knowledge, Part
from skfmap.partial.scan import area_and_rim
from skfmap.shapes import Match

__all__ = ["OnReference", "between_parts", "no_pair", "part_on_reference", "whole_on_reference"]

# Weight of normals beside coordinates, in sqrt(area), as for matches of parts to the reference.
_NORMALS = 0.03


class OnReference(NamedTuple):
    """A shape matched to the reference, and the reference laid onto the shape.

    Attributes
    ----------
    match : Match
        Match from the shape to the reference, with places in ``matrix``.
    points : ndarray of shape (n_vertices, 6)
        Coordinates of the vertices of the shape, in sqrt(area) of the reference, and their
        weighted normals.
    points_0 : ndarray of shape (n_vertices_0, 6)
        The same for the vertices of the reference laid onto the shape.
    """

    match: Match
    points: FloatArray
    points_0: FloatArray

    @property
    def known(self) -> BoolArray:
        """Which vertices of the shape have a match."""
        return self.match.p2p >= 0


def part_on_reference(known: Knowledge, part: Part, match: Match) -> OnReference:
    """Return what is needed to match pairs that include a part."""
    spectral_0, faces_0 = known.learner.reference_.spectral, known.body.regions.faces
    laid = part.laid.vertices
    points_0 = spectral_0.prolong(_with_normals(laid, vertex_normals(laid, faces_0)), 0.0)
    return OnReference(match, _with_normals(part.vertices, part.normals), points_0)


def whole_on_reference(vertices: FloatArray, faces: IntArray, match: Match) -> OnReference:
    """Return what is needed to match pairs of a part and a whole shape, scaled to unit area."""
    sound = faces[sound_faces(vertices, faces)]
    vertices = vertices / np.sqrt(area_and_rim(vertices, sound)[0])
    points = _with_normals(vertices, vertex_normals(np.nan_to_num(vertices), sound))
    missing = np.zeros((1, points.shape[1]))
    return OnReference(match, points, np.append(points, missing, axis=0)[match.inverse])


def between_parts(one: OnReference, other: OnReference) -> Match:
    """Return the match from one shape to another.

    The reference laid onto S_j carries each vertex of S_i to a position on S_j, and the reference
    laid onto S_i carries each vertex of S_j to a position on S_i. Nearest neighbours are found in
    both sets of coordinates at once, so that both directions agree.

    Parameters
    ----------
    one, other : OnReference
        S_i and S_j; at least one of them is a part.

    Returns
    -------
    Match
        Match from S_i to S_j: ``p2p`` is -1 at vertices of S_i that S_j does not show, and
        ``covered`` says which vertices of S_j are shown by S_i.
    """
    first, second = one.match, other.match
    seen_i, _ = _seen(one, other)
    seen_j, probability = _seen(other, one)
    rows_i = np.hstack([np.asarray(first.matrix @ other.points_0), one.points])
    rows_j = np.hstack([other.points, np.asarray(second.matrix @ one.points_0)])
    p2p = _nearest(rows_i, seen_i, rows_j, other.known)
    inverse = _nearest(rows_j, seen_j, rows_i, one.known)
    expected, confidence = _trust(first, second, p2p)
    if one is other:
        itself = np.where(seen_i, np.arange(len(p2p)), -1)
        p2p, inverse = itself, itself.copy()
        expected, confidence = (np.where(seen_i, value, np.nan) for value in (0.0, 1.0))
    rows = np.flatnonzero(p2p >= 0)
    shape = len(p2p), len(inverse)
    return replace(
        first,
        p2p=p2p,
        expected_error=expected,
        confidence=confidence,
        functional_map=np.full_like(first.functional_map, np.nan),
        reduced_map=np.full_like(first.reduced_map, np.nan),
        refined_map=None,
        scale=None,
        n_supporting=np.zeros(len(p2p), dtype=np.int64),
        matrix=sp.csr_array((np.ones(len(rows)), (rows, p2p[rows])), shape=shape),
        inverse=inverse,
        reference_name=second.name,
        reference_given=second.given,
        reference_hash=None if second.given is None else second.given.content_hash,
        misfit=max(first.misfit, second.misfit),
        familiar=_both(first.familiar, second.familiar),
        covered=seen_j,
        covered_probability=probability,
    )


def no_pair(learner: Any, one: Match, other: Match) -> Match:
    """Return the match of a pair that cannot be matched, filled with -1 and NaN."""
    n_j = len(other.p2p)
    return replace(
        blank_match(learner.matcher_, len(one.p2p), n_j, assessed=True),
        name=one.name,
        given=one.given,
        reference_name=other.name,
        reference_given=other.given,
        reference_hash=None if other.given is None else other.given.content_hash,
        covered=np.zeros(n_j, dtype=bool),
        covered_probability=np.full(n_j, np.nan),
    )


def _with_normals(vertices: FloatArray, normals: FloatArray) -> FloatArray:
    return np.hstack([np.nan_to_num(vertices), _NORMALS * normals])


def _seen(one: OnReference, other: OnReference) -> tuple[BoolArray, FloatArray]:
    """Return which vertices of one shape the other shows, and the probability of each."""
    covered: Any = other.match.covered_probability
    shown = np.asarray(one.match.matrix @ np.nan_to_num(covered))
    shown = np.where(one.known, shown, np.nan)
    return shown >= 0.5 if other.known.any() else np.zeros(len(shown), dtype=bool), shown


def _nearest(rows: FloatArray, asked: BoolArray, targets: FloatArray, known: BoolArray) -> IntArray:
    """Return the nearest known target of each selected row, and -1 for the others."""
    found, at = np.full(len(rows), -1), np.flatnonzero(known)
    if asked.any() and len(at):
        found[asked] = at[nearest(rows[asked], targets[at])]
    return found


def _trust(
    first: Match, second: Match, p2p: IntArray
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return expected errors and confidences of both matches combined; NaN without a match."""
    expected = confidence = None
    known = np.where(p2p >= 0, 1.0, np.nan)
    if first.expected_error is not None and second.expected_error is not None:
        expected = known * np.hypot(first.expected_error, second.expected_error[p2p])
    if first.confidence is not None and second.confidence is not None:
        confidence = known * first.confidence * second.confidence[p2p]
    return expected, confidence


def _both(first: bool | None, second: bool | None) -> bool | None:
    if first is None or second is None:
        return None
    return first and second
