"""The match of a part, on its given vertices, from the reference laid onto it."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from skfmap._tools.caching import hash_of_arrays
from skfmap._tools.types import FloatArray, IntArray, SparseMatrix
from skfmap.geometry.faults import sound_faces
from skfmap.geometry.normals import vertex_normals
from skfmap.io import MeshLike, as_arrays, n_vertices_of, named
from skfmap.learner.about_meshes import given_of
from skfmap.learner.given_answers import GivenReference
from skfmap.learner.new_shape import blank_match
from skfmap.partial.body import Body, LaidOnPart, nearest_with_normals
from skfmap.partial.scan import Scan
from skfmap.partial.trust import PartTrust
from skfmap.shapes import GivenMesh, Match, Mesh, SpectralShape

__all__ = [
    "Knowledge",
    "Part",
    "all_covered",
    "arrays_of",
    "matched_part",
    "nothing_said",
    "with_meshes",
]

# Distance from the laid reference, in sqrt(area), beyond which a point is left unmatched.
_NOTHING = 0.08


class Knowledge(NamedTuple):
    """The fitted models that matches of parts are computed with.

    Attributes
    ----------
    learner : WeightedFunctionalMapLearner
        Learner of whole shapes.
    target : GivenReference
        The reference as given.
    body, trust : Body, PartTrust
        What was learned from parts.
    """

    learner: Any
    target: GivenReference
    body: Body
    trust: PartTrust


@dataclass(frozen=True, eq=False, repr=False)
class Part:
    """A part as given, in units of sqrt(area) of the reference, with the reference laid onto it.

    Attributes
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        The given mesh, including faces that cannot be used.
    scan : Scan
        The working mesh.
    laid : LaidOnPart
        The reference laid onto the working mesh.
    unit : float
        Length that the coordinates were divided by.
    is_reversed : bool
        Whether the faces were wound inwards, and have been reversed.
    scale : float or None
        Estimated factor from the units of the part to those of the training shapes.
    """

    vertices: FloatArray
    faces: IntArray
    scan: Scan
    laid: LaidOnPart
    unit: float
    is_reversed: bool = False
    scale: float | None = None

    @cached_property
    def sound(self) -> IntArray:
        """Faces that can be used."""
        return self.faces[sound_faces(self.vertices, self.faces)]

    @cached_property
    def normals(self) -> FloatArray:
        """Normals of all vertices."""
        return vertex_normals(np.nan_to_num(self.vertices), self.sound)


def arrays_of(item: MeshLike, i: int) -> tuple[FloatArray, IntArray]:
    """Return the given vertices and faces of the mesh at an index of X."""
    given = as_arrays(item, i)
    return (given.vertices, given.faces) if isinstance(given, Mesh) else given


def matched_part(known: Knowledge, part: Part, name: str | None) -> Match:
    """Return the match of a part, with -1 and NaN at vertices that are left unmatched.

    Parameters
    ----------
    known : Knowledge
        The fitted models.
    part : Part
        The part.
    name : str or None
        Name of the part.
    """
    learner, scan, laid = known.learner, part.scan, part.laid
    spectral_0, n_i = learner.reference_.spectral, len(part.vertices)
    rows = np.unique(part.sound)
    at, normals = part.vertices[rows], part.normals[rows]
    own = nearest_with_normals(at, normals, scan.vertices, scan.normals)
    laid_normals = vertex_normals(laid.vertices, known.body.regions.faces)
    believed = laid.places[own]
    working = known.body.nearest(at, normals, believed, laid.vertices, laid_normals)
    errors, right = known.trust.assess(scan, laid)
    belongs = laid.away[own] <= _NOTHING
    rows, working, own = rows[belongs], working[belongs], own[belongs]
    corners, weights = _corners(known.target, working)
    p2p, expected, confidence = np.full(n_i, -1), np.full(n_i, np.nan), np.full(n_i, np.nan)
    p2p[rows] = corners[np.arange(len(rows)), weights.argmax(axis=1)]
    expected[rows], confidence[rows] = errors[own], right[own]
    probability = spectral_0.prolong(known.trust.coverage(laid), 0.0)
    covered = probability >= 0.5
    places = spectral_0.prolong(laid.vertices, 0.0), spectral_0.prolong(laid_normals, 0.0)
    inverse = np.full(spectral_0.n_given, -1)
    if covered.any() and len(rows):
        there = places[0][covered], places[1][covered]
        inverse[covered] = rows[
            nearest_with_normals(*there, part.vertices[rows], part.normals[rows])
        ]
    k, p = len(learner.stable_basis_), learner.n_stable_
    return Match(
        p2p,
        expected,
        confidence,
        np.full((k, k), np.nan),
        np.full((k, p), np.nan),
        name=name,
        reference_name=learner.reference_.name,
        n_supporting=np.zeros(n_i, dtype=np.int64),
        matrix=_matrix(rows, corners, weights, (n_i, spectral_0.n_given)),
        inverse=inverse,
        reference_hash=spectral_0.given_hash,
        misfit=laid.strain / known.trust.usual_strain,
        familiar=known.trust.is_familiar(laid),
        covered=covered,
        covered_probability=probability,
        scale=part.scale,
    )


def nothing_said(learner: Any, item: MeshLike, i: int) -> Match:
    """Return the match of a scan that cannot be matched, filled with -1 and NaN."""
    spectral_0 = learner.reference_.spectral
    n_i, n_0 = n_vertices_of(item), spectral_0.n_given
    return replace(
        blank_match(learner.matcher_, n_i, n_0, assessed=True),
        name=named(item, i),
        reference_name=learner.reference_.name,
        reference_hash=spectral_0.given_hash,
        covered=np.zeros(n_0, dtype=bool),
        covered_probability=np.full(n_0, np.nan),
    )


def all_covered(match: Match) -> Match:
    """Return the match of a whole shape as one that covers the whole reference.

    If the shape has no match, it covers nothing, with unknown probability.
    """
    n_0, known = len(match.inverse), bool((match.p2p >= 0).any())
    return replace(
        match,
        covered=np.full(n_0, known),
        covered_probability=np.full(n_0, 1.0 if known else np.nan),
    )


def with_meshes(match: Match, item: MeshLike, i: int, reference: SpectralShape) -> Match:
    """Return a match together with the given mesh of its scan and that of the reference."""
    vertices, faces = arrays_of(item, i)
    content = hash_of_arrays(vertices, faces)
    given = GivenMesh(match.name, len(vertices), len(faces), content, item)
    return replace(match, given=given, reference_given=given_of(reference))


def _corners(target: GivenReference, working: IntArray) -> tuple[IntArray, FloatArray]:
    """Return corners and weights on the given reference, at vertices of the working one."""
    if target.is_working:
        return working[:, None], np.ones((len(working), 1))
    mesh = target.shape.mesh
    normals = vertex_normals(mesh.vertices, mesh.faces)
    return target.places(mesh.vertices[working], normals[working])


def _matrix(
    rows: IntArray, corners: IntArray, weights: FloatArray, shape: tuple[int, int]
) -> SparseMatrix:
    """Return the point map as a matrix of weights at the corners of the matched faces."""
    at = np.repeat(rows, weights.shape[1]), corners.ravel()
    matrix = sp.coo_array((weights.ravel(), at), shape=shape).tocsr()
    matrix.eliminate_zeros()
    return matrix
