"""Detection of parts of a shape that touch and were scanned as one surface ("glued")."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap._tools.warn import warn
from skfmap.exceptions import UnfamiliarShapeWarning
from skfmap.geometry.faults import edges_of, sound_faces
from skfmap.io import MeshLike
from skfmap.partial.answers import Knowledge, Part, arrays_of
from skfmap.partial.body import Regions
from skfmap.partial.tears import (
    faces_with_edges,
    sizes_of_tears,
    stretched_edges,
    without_islands,
)
from skfmap.shapes import Match
from skfmap.shapes.usable import describe

__all__ = [
    "better_of",
    "share_torn",
    "tears",
    "tears_of_wholes",
    "torn_vertices",
    "warn_of_tears",
    "with_tears",
]

# An edge is torn if its ends are matched farther apart than this many times its length plus this
# distance, in sqrt(area). Of 22 whole cats, creatures and bodies, only one has torn edges, and it
# is matched wrongly.
_STRETCH, _APART = 2.0, 0.2
# Tears that can be mended by moving fewer vertices than this are noise. So are islands of wrong
# matches below this fraction of the area, and tears that cover less than the last value.
_LEAST, _ISLAND, _LEAST_AREA = 4.0, 0.005, 0.002


def torn_vertices(
    regions: Regions, vertices: FloatArray, faces: IntArray, answers: IntArray
) -> BoolArray:
    """Return which vertices of a scan lie on a tear of its map, shape (n_vertices,).

    Parameters
    ----------
    regions : Regions
        The reference.
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        The scan, in units of sqrt(area) of the reference, without unusable faces.
    answers : ndarray of int, shape (n_vertices,)
        Matched vertices of the reference; -1 where there is none.
    """
    torn = np.zeros(len(vertices), dtype=bool)
    edges = edges_of(faces)
    edges = edges[(answers[edges] >= 0).all(axis=1)]
    found = _torn(regions, vertices, edges, answers)
    if not len(found):
        return torn
    areas = _areas(vertices, faces)
    at_vertices = np.zeros(len(vertices))
    np.add.at(at_vertices, faces, areas[:, None] / 3)
    is_torn = np.isin(edges @ [len(vertices), 1], found @ [len(vertices), 1])
    filled = without_islands(
        vertices, at_vertices, edges, is_torn, answers, _ISLAND * float(areas.sum())
    )
    found = _torn(regions, vertices, edges, filled)
    found = found[sizes_of_tears(found, len(vertices)) >= _LEAST]
    through = faces_with_edges(faces, found, len(vertices))
    if areas[through].sum() >= _LEAST_AREA * areas.sum():
        torn[faces[through]] = True
    return torn


def share_torn(vertices: FloatArray, faces: IntArray, torn: BoolArray) -> float:
    """Return the fraction of the area in faces whose corners are all torn."""
    areas = _areas(vertices, faces)
    return float(areas[torn[faces].all(axis=1)].sum() / areas.sum())


def with_tears(
    known: Knowledge, vertices: FloatArray, faces: IntArray, unit: float, match: Match
) -> Match:
    """Return a match with its tears marked, and with lower trust in the vertices on them.

    A vertex on a tear may belong to either side, so its expected error is at least half the
    distance across the tear.

    Parameters
    ----------
    known : Knowledge
        The fitted models.
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        The scan as given.
    unit : float
        Square root of the area of the reference, in the units of the coordinates.
    match : Match
        The match of the scan.
    """
    faces, scaled = faces[sound_faces(vertices, faces)], vertices / unit
    working = known.learner.reference_.spectral.working_vertices(match.p2p)
    answers = np.where(match.p2p >= 0, working, -1)
    torn = torn_vertices(known.body.regions, scaled, faces, answers)
    match = replace(match, torn=torn)
    if not torn.any():
        return match
    match = replace(match, familiar=False)
    if match.expected_error is None or match.confidence is None:
        return match
    across = _ways_across(known.body.regions, faces, answers, torn)
    return replace(
        match,
        expected_error=np.maximum(match.expected_error, across / 2),  # keeps NaN where unmatched
        confidence=np.where(torn, np.minimum(match.confidence, 0.5), match.confidence),
    )


def tears(match: Match) -> bool:
    """Return whether a match has a tear."""
    return match.torn is not None and bool(match.torn.any())


def tears_of_wholes(
    known: Knowledge, items: Sequence[MeshLike], found: dict[int, Match]
) -> tuple[dict[int, Match], list[int]]:
    """Return matches of whole shapes with their tears marked, and the indices of those that tear.

    Parameters
    ----------
    known : Knowledge
        The fitted models.
    items : sequence of meshes
        All given meshes, in any units: whole shapes are compared at unit area.
    found : dict of int to Match
        Matches of the whole shapes, by index.
    """
    told = dict(found)
    for i, match in found.items():
        if (match.p2p >= 0).any():
            vertices, faces = arrays_of(items[i], i)
            area = _areas(vertices, faces[sound_faces(vertices, faces)]).sum()
            told[i] = with_tears(known, vertices, faces, float(np.sqrt(area)), match)
    return told, [i for i, match in told.items() if tears(match)]


def better_of(
    known: Knowledge, whole: dict[int, Match], laid: dict[int, Match], parts: dict[int, Part]
) -> dict[int, Match]:
    """Return the matches of shapes as parts that tear less than their matches as whole shapes.

    Parameters
    ----------
    known : Knowledge
        The fitted models.
    whole, laid : dict of int to Match
        Matches as whole shapes and as parts, by index.
    parts : dict of int to Part
        The shapes with the reference laid onto them.
    """
    return {
        i: match
        for i, match in laid.items()
        if known.trust.is_familiar(parts[i].laid)
        and _share(parts[i], match) < _share(parts[i], whole[i])
    }


def warn_of_tears(found: dict[int, Match]) -> None:
    """Warn of matches that tear, given by index."""
    told = ", ".join(
        f"{describe(i, found[i])} ({_told(found[i])})" for i in sorted(found) if tears(found[i])
    )
    if told:
        warn(
            f"Neighbouring vertices are matched far apart on {told}: parts that touch were scanned "
            "as one surface, or the match is wrong there. Match.torn marks these vertices. Cut the "
            "scan there, or scan it with limbs apart; do not rely on the match nearby.",
            UnfamiliarShapeWarning,
        )


def _told(match: Match) -> str:
    at = np.flatnonzero(_mask(match))
    return f"{len(at)} vertices, {len(at) / len(match.p2p):.1%} of all, the first of them {at[0]}"


def _share(part: Part, match: Match) -> float:
    return share_torn(part.vertices, part.sound, _mask(match))


def _mask(match: Match) -> BoolArray:
    return np.zeros(len(match.p2p), dtype=bool) if match.torn is None else match.torn


def _torn(regions: Regions, vertices: FloatArray, edges: IntArray, answers: IntArray) -> IntArray:
    """Return the edges whose ends are matched too far apart."""
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    ways = _ways(regions, answers[edges])
    return stretched_edges(edges, lengths, ways, stretch=_STRETCH, apart=_APART)


def _ways(regions: Regions, pairs: IntArray) -> FloatArray:
    """Return distances between pairs of vertices of the reference, computed once for each pair."""
    pairs, back = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    one, other = pairs[:, 0], pairs[:, 1]
    ways = np.minimum(regions.ways(one, other), regions.ways(other, one))
    return np.where(one == other, 0.0, ways)[np.ravel(back)]


def _ways_across(
    regions: Regions, faces: IntArray, answers: IntArray, torn: BoolArray
) -> FloatArray:
    """Return the largest distance across a torn edge at each vertex; 0 elsewhere."""
    edges = edges_of(faces)
    edges = edges[torn[edges].all(axis=1) & (answers[edges] >= 0).all(axis=1)]
    ways, across = _ways(regions, answers[edges]), np.zeros(len(answers))
    for end in edges.T:
        np.maximum.at(across, end, ways)
    return np.where(torn, across, 0.0)


def _areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    a, b, c = (vertices[faces[:, j]] for j in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)
