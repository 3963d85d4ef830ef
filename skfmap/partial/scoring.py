"""Errors of matches on held-out shapes, and on parts cut from them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skfmap._measures import PairErrors, PlaceDistances, pair_errors, reference_distances
from skfmap._tools.types import DistanceMethod, ErrorKind, FloatArray, IntArray
from skfmap.geometry.closest import ClosestPoints, nearest_places
from skfmap.geometry.cutting import keep_faces
from skfmap.geometry.faults import sound_faces
from skfmap.geometry.normals import vertex_normals
from skfmap.partial.cuts import Cut
from skfmap.shapes import Correspondence, Match, Mesh, SurfacePlaces
from skfmap.shapes.usable import Answer

__all__ = ["PartScorer", "ScoredErrors", "as_correspondence", "parts_to_score"]

# A point of the whole shape lies on a part if it is nearer than this, in sqrt(area), and their
# normals differ by less than 60 degrees.
_OFF, _AGREES = 0.01, 0.5


@dataclass(frozen=True, eq=False)
class ScoredErrors:
    """Errors on one shape as they enter a score: half for the shape and half for its parts.

    Attributes
    ----------
    whole : PairErrors
        Errors of the given shape.
    parts : list of PairErrors
        Errors of the parts that were cut from it.
    """

    whole: PairErrors
    parts: list[PairErrors]

    def mean(self, kind: ErrorKind = "direct") -> float:
        """Return the mean error of ``kind``; NaN if nothing was matched."""
        means = [[self.whole.mean(kind)], [part.mean(kind) for part in self.parts]]
        known = [np.nanmean(one) for one in means if np.isfinite(one).any()]
        return float(np.mean(known)) if known else float("nan")


@dataclass(frozen=True, eq=False)
class PartScorer:
    """Computes the errors of matches of parts.

    Attributes
    ----------
    learner : WeightedFunctionalMapLearner
        Learner on whose reference errors are computed.
    method : {"heat", "exact", "dijkstra"}
        How distances are computed; see `skfmap.metrics.GeodesicDistances`.
    reference_y : Correspondence or int array, optional
        Correspondence of the reference with the template; by default the one given to ``fit``.
    """

    learner: Any
    method: DistanceMethod
    reference_y: Answer | None

    def errors(self, match: Match | None, truth: Correspondence) -> PairErrors:
        """Return the errors of a match at known pairs; none without a match or known pairs.

        An unmatched point has the error of a random match, so that a model gains nothing by
        leaving points unmatched.
        """
        learner, truth_0 = self.learner, self.learner.reference_correspondence_
        if self.reference_y is not None:
            truth_0 = as_correspondence(self.reference_y)
        if match is None or not len(truth.join(truth_0).points):
            nothing = np.empty(0)
            return PairErrors(np.empty(0, dtype=np.int64), nothing, None, nothing)
        spectral_0 = learner.reference_.spectral
        on_working = reference_distances(
            spectral_0.mesh, self.method, memory=learner.memory, n_jobs=learner.n_jobs
        )
        distances = on_working
        if spectral_0.prolongation is not None:
            distances = PlaceDistances(spectral_0, on_working)
        found = pair_errors(np.maximum(match.p2p, 0), truth, truth_0, distances)
        unanswered = match.p2p[found.vertices] < 0
        if not unanswered.any():
            return found
        rows = on_working.rows(np.unique(spectral_0.working_vertices(truth_0.corners.ravel())))
        at_random = float(np.average(rows.mean(axis=0), weights=spectral_0.mass))
        symmetric = found.symmetric
        return replace(
            found,
            direct=np.where(unanswered, at_random, found.direct),
            symmetric=None if symmetric is None else np.where(unanswered, at_random, symmetric),
        )


def as_correspondence(truth: Answer) -> Correspondence:
    """Return the correspondence of a shape with the template as an object."""
    return truth if isinstance(truth, Correspondence) else Correspondence(np.asarray(truth))


def parts_to_score(
    vertices: FloatArray,
    faces: IntArray,
    truth: Correspondence,
    cuts: Sequence[Cut],
    random_state: int,
) -> list[tuple[Mesh, Correspondence]]:
    """Return one part for each of the cuts, and its correspondence with the template.

    Parameters
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        A whole shape.
    truth : Correspondence
        Its correspondence with the template.
    cuts : sequence of Cut
        The cuts.
    random_state : int
        Seed, which is combined with the content of the shape: its parts are the same in all folds.
    """
    whole = Mesh(*keep_faces(vertices, faces, sound_faces(vertices, faces)))
    seed = int(whole.content_hash[:12], 16)
    parts = [
        cut.cut(whole, np.random.default_rng([random_state, seed, number]))
        for number, cut in enumerate(cuts)
    ]
    return [(part, _truth_on(part, vertices, faces, truth)) for part in parts]


def _truth_on(
    part: Mesh, vertices: FloatArray, faces: IntArray, truth: Correspondence
) -> Correspondence:
    """Return the correspondence of a part with the template, from that of the whole shape."""
    at, normals = _points_of(vertices, faces, truth)
    near = ClosestPoints(part.vertices, part.faces).of(at)
    agree = np.einsum("na,na->n", normals, near.normals) > _AGREES
    rows = np.flatnonzero(agree & (near.distances < _OFF * np.sqrt(part.area)) & ~near.on_rim)
    found = nearest_places(at[rows], part.vertices, part.faces)
    places = SurfacePlaces(found.corners, found.weights)
    return Correspondence(
        np.column_stack([places.vertices, truth.pairs[rows, 1]]),
        weights=None if truth.weights is None else truth.weights[rows],
        n_vertices=part.n_vertices,
        places=places,
        names=truth.names,
    )


def _points_of(
    vertices: FloatArray, faces: IntArray, truth: Correspondence
) -> tuple[FloatArray, FloatArray]:
    """Return coordinates and normals at the pairs of a whole shape."""
    normals = vertex_normals(np.nan_to_num(vertices), faces[sound_faces(vertices, faces)])
    columns = np.hstack([np.nan_to_num(vertices), normals])
    if truth.places is None:
        found = columns[truth.pairs[:, 0]]
    else:
        found = truth.places.means(columns[truth.places.corners.ravel()])
    return found[:, :3], found[:, 3:]
