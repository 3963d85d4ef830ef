"""The reference, divided into regions, and the models that lay it onto parts."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.functional.neighbours import nearest
from skfmap.geometry.closest import ClosestPoints, nearest_places
from skfmap.geometry.geodesics import farthest_vertices
from skfmap.geometry.normals import vertex_normals
from skfmap.partial.consistency import Hypothesis, hypotheses
from skfmap.partial.laying import believed_places, lay_on_part, start_from
from skfmap.partial.recognition import Recogniser
from skfmap.partial.scan import Scan
from skfmap.registration import Deformation

__all__ = ["Body", "LaidOnPart", "Lesson", "Regions", "shared_regions"]

# Number of regions of the reference.
_N_REGIONS = 160
# Number of points of each training part that are learned from.
_N_LEARNED = 800
# Weight of normals beside coordinates, in sqrt(area).
_NORMALS = 0.03
# Final stiffness of the reference relative to the attraction by the scan, and the number of rounds
# for comparing hypotheses and for the final result.
_STIFFNESS, _FEW_ROUNDS, _ROUNDS = 0.3, 4, 9
# Distance, in sqrt(area), below which straight lines approximate paths along the reference.
_NEAR = 0.1
# A point lies on another surface if it is nearer than this, in sqrt(area), and the cosine between
# the normals is above this.
_OFF, _AGREES = 0.04, 0.3

# Number of hypotheses. Those whose score is within this of the best one are laid, unless they are
# this similar to an earlier one (mean distance, in sqrt(area)).
_N_HYPOTHESES, _AS_GOOD, _ALIKE = 3, 4.0, 0.02
# Standard deviation of distances in space, in sqrt(area), when the probabilities are computed again
# from the laid reference, and the maximum number of squared deviations.
_NEAR_IN_SPACE, _DISTANT = 0.1, 8.0
# Weight of the mean log-probability relative to the fraction that lies off the reference.
_OF_LIKELIHOOD = 0.1
# Weight of the distance on the reference from the likely place of a point, relative to distances
# in space.
_BELIEVED = 0.2


class Regions(NamedTuple):
    """The reference, divided into regions.

    Attributes
    ----------
    vertices, faces, areas : ndarray
        Working mesh of the reference, at unit area, and areas of its vertices.
    centres : ndarray of int, shape (n_regions,)
        Central vertex of each region.
    distances : ndarray of float32, shape (n_regions, n_vertices)
        Distances from the centres along edges.
    """

    vertices: FloatArray
    faces: IntArray
    areas: FloatArray
    centres: IntArray
    distances: npt.NDArray[np.float32]

    def ways(self, one: IntArray, other: IntArray) -> FloatArray:
        """Return approximate distances along the surface between pairs of vertices.

        Short distances are straight lines; longer ones start at the centre of the first vertex's
        region.
        """
        straight = np.linalg.norm(self.vertices[one] - self.vertices[other], axis=1)
        region = self.distances[:, one].argmin(axis=0)
        along = self.distances[region, other].astype(np.float64)
        return np.where((straight < _NEAR) & (along < 3 * _NEAR), straight, along)


def shared_regions(vertices: FloatArray, faces: IntArray, areas: FloatArray) -> Regions:
    """Divide a mesh of unit area into regions around well-spread vertices."""
    centres, distances = farthest_vertices(vertices, faces, np.arange(len(vertices)), _N_REGIONS)
    # Copies, since model files store each array once and the reference has these too.
    return Regions(
        vertices.copy(), faces.copy(), areas.copy(), centres, distances.astype(np.float32)
    )


class Lesson(NamedTuple):
    """A part of a training shape, with its known correspondence to the reference.

    Attributes
    ----------
    scan : Scan
        The part.
    vertices_0 : ndarray of int, shape (n_vertices,)
        Vertex of the reference that each vertex corresponds to.
    covered : ndarray of bool, shape (n_vertices_0,)
        Which vertices of the reference lie on the part.
    """

    scan: Scan
    vertices_0: IntArray
    covered: BoolArray

    @classmethod
    def of(cls, scan: Scan, laid: FloatArray, faces: IntArray) -> Self:
        """Return the lesson from a part of a shape that the reference was laid onto."""
        at = nearest_places(scan.vertices, laid, faces)
        vertices_0 = at.corners[np.arange(len(at.corners)), at.weights.argmax(axis=1)]
        near = scan.surface.of(laid)
        facing = np.einsum("na,na->n", vertex_normals(laid, faces), near.normals) > _AGREES
        covered = (near.distances < _OFF) & facing & ~near.on_rim
        return cls(scan, vertices_0, covered)

    def rows(self) -> IntArray:
        """Return the vertices to learn from."""
        return self.scan.points[:_N_LEARNED]


class LaidOnPart(NamedTuple):
    """The reference laid onto a part.

    Attributes
    ----------
    vertices : ndarray of shape (n_vertices_0, 3)
        Vertices of the reference in the position of the scan, in units of sqrt(area) of the
        reference.
    p2p : ndarray of int, shape (n_points,)
        Vertex of the reference for each vertex of the scan.
    away, facing : ndarray of shape (n_points,)
        Distance of each vertex of the scan from the laid reference, and the cosine between their
        normals.
    disagreement, belief : ndarray of shape (n_points,)
        Distance, on the reference, of ``p2p`` from the likely place of each vertex, and the
        probability of that place.
    places : ndarray of shape (n_points, 3)
        Likely places on the reference, by the consistent probabilities.
    signs : ndarray of shape (n_vertices_0, n_signs)
        Features that predict which vertices of the reference are covered.
    off : float
        Fraction of the vertices of the scan that do not lie on the reference.
    likelihood : float
        Mean log-probability of the matched regions, given the local features.
    strain : float
        Mean absolute log-ratio of edge lengths beyond what training shapes explain.
    """

    vertices: FloatArray
    p2p: IntArray
    away: FloatArray
    facing: FloatArray
    disagreement: FloatArray
    belief: FloatArray
    places: FloatArray
    signs: FloatArray
    off: float
    likelihood: float
    strain: float


@dataclass(frozen=True, eq=False, repr=False)
class Body:
    """The reference, its deformation model, and the model that recognises its regions.

    Attributes
    ----------
    regions : Regions
        The reference.
    deformation : Deformation
        Deformation model of training shapes, in units of sqrt(area) of the reference.
    recogniser : Recogniser
        Model that predicts regions, learned from parts of training shapes.
    straight : tuple of ndarray of shape (n_regions, n_regions)
        Mean and standard deviation of straight-line distances between regions, over training
        shapes.
    """

    regions: Regions
    deformation: Deformation
    recogniser: Recogniser
    straight: tuple[FloatArray, FloatArray]

    @classmethod
    def learned(
        cls, regions: Regions, laid: Sequence[FloatArray], lessons: Sequence[Lesson]
    ) -> Self:
        """Learn from training shapes with the reference laid onto them, and from their parts."""
        deformation = Deformation.learned(regions.vertices, regions.faces, laid)
        region = regions.distances.argmin(axis=0)
        rows = [one.rows() for one in lessons]
        recogniser = Recogniser.learned(
            [one.scan.features[at] for one, at in zip(lessons, rows, strict=True)],
            [region[one.vertices_0[at]] for one, at in zip(lessons, rows, strict=True)],
            len(regions.centres),
        )
        centres = np.stack([one[regions.centres] for one in [regions.vertices, *laid]])
        lines = np.linalg.norm(centres[:, :, None] - centres[:, None], axis=3)
        straight = lines.mean(axis=0), lines.std(axis=0)
        return cls(regions, deformation, recogniser, straight)

    @cached_property
    def _apart(self) -> FloatArray:
        return self.regions.distances[:, self.regions.centres].astype(np.float64)

    def lay(self, scan: Scan) -> LaidOnPart:
        """Return the reference laid onto a scan.

        The reference is laid in a few rounds from each of the best hypotheses, and the result that
        fits best is kept. The probabilities are then computed again, with the distances to the laid
        reference taken into account, and the reference is laid once more.
        """
        logarithms = self.recogniser.logarithms(scan.features[scan.points])
        along = scan.distances, scan.straight, self._apart, self.straight
        found = hypotheses(logarithms, *along, _N_HYPOTHESES)
        laid = [
            self._laid_by(scan, one, logarithms, _FEW_ROUNDS)
            for one in self._different(found)
            if one.score >= found[0].score - _AS_GOOD
        ]
        best = min(laid, key=_misfit)
        (again,) = hypotheses(logarithms - self._distant(scan, best), *along, 1)
        return min(best, self._laid_by(scan, again, logarithms, _ROUNDS), key=_misfit)

    def _different(self, found: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Return the hypotheses without those that are similar to an earlier one."""
        kept: list[Hypothesis] = []
        for one in found:
            regions = one.beliefs.argmax(axis=1)
            if all(
                self._apart[regions, other.beliefs.argmax(axis=1)].mean() > _ALIKE for other in kept
            ):
                kept.append(one)
        return kept

    def _distant(self, scan: Scan, laid: LaidOnPart) -> npt.NDArray[np.float32]:
        """Return half the squared deviations of points from regions of the laid reference."""
        centres = laid.vertices[self.regions.centres]
        away = scan.vertices[scan.points][:, None] - centres[None]
        squared = np.einsum("nkd,nkd->nk", away, away) / _NEAR_IN_SPACE**2
        return (np.minimum(squared, _DISTANT) / 2).astype(np.float32)

    def _laid_by(
        self,
        scan: Scan,
        hypothesis: Hypothesis,
        logarithms: npt.NDArray[np.float32],
        n_rounds: int,
    ) -> LaidOnPart:
        regions = self.regions
        places, belief = believed_places(
            hypothesis.beliefs, regions.vertices[regions.centres], self._apart
        )
        start = start_from(
            self.deformation,
            regions.faces,
            scan.vertices[scan.points],
            places,
            belief,
            regions.vertices,
        )
        owner = nearest(scan.vertices, scan.vertices[scan.points])
        vertices = lay_on_part(
            self.deformation,
            regions.faces,
            regions.areas,
            regions.vertices,
            (scan.vertices, scan.faces),
            places[owner],
            start,
            stiffness=_STIFFNESS,
            n_rounds=n_rounds,
        )
        return self._judged(scan, vertices, logarithms, places[owner], belief[owner])

    def _judged(
        self,
        scan: Scan,
        vertices: FloatArray,
        logarithms: npt.NDArray[np.float32],
        places: FloatArray,
        belief: FloatArray,
    ) -> LaidOnPart:
        regions, normals = self.regions, vertex_normals(vertices, self.regions.faces)
        p2p = self.nearest(scan.vertices, scan.normals, places, vertices, normals)
        laid = ClosestPoints(vertices, regions.faces).of(scan.vertices)
        facing = np.einsum("na,na->n", scan.normals, laid.normals)
        off = (laid.distances > _OFF) | (facing < _AGREES)
        believed = nearest(places, regions.vertices)
        region = regions.distances.argmin(axis=0)
        answered = region[p2p[scan.points]]
        likelihood = logarithms[np.arange(len(answered)), answered].mean()
        return LaidOnPart(
            vertices,
            p2p,
            laid.distances,
            facing,
            regions.ways(believed, p2p),
            belief,
            places,
            self._signs(scan, vertices, normals, p2p),
            float(off.mean()),
            float(likelihood),
            float(self.deformation.adapted(vertices).strains(vertices).mean()),
        )

    def nearest(
        self,
        points: FloatArray,
        normals: FloatArray,
        places: FloatArray,
        vertices: FloatArray,
        normals_of_vertices: FloatArray,
    ) -> IntArray:
        """Return the nearest vertex of the laid reference to each point.

        Parameters
        ----------
        points, normals, places : ndarray of shape (n_points, 3)
            Points of a scan, their normals, and their likely places on the reference.
        vertices, normals_of_vertices : ndarray of shape (n_vertices_0, 3)
            Vertices and normals of the laid reference.
        """
        return nearest_with_normals(
            np.column_stack([points, _BELIEVED * places]),
            normals,
            np.column_stack([vertices, _BELIEVED * self.regions.vertices]),
            normals_of_vertices,
        )

    def _signs(
        self, scan: Scan, vertices: FloatArray, normals: FloatArray, p2p: IntArray
    ) -> FloatArray:
        """Return features that predict which vertices of the reference are covered."""
        near = scan.surface.of(vertices)
        facing = np.einsum("na,na->n", normals, near.normals)
        beside = nearest_with_normals(vertices, normals, scan.vertices, scan.normals)
        way_back = self.regions.ways(p2p[beside], np.arange(len(vertices)))
        # A vertex near a matched one is covered, whatever is near it in space.
        at, answers = self.regions.vertices, np.unique(p2p)
        to_answer = np.linalg.norm(at - at[answers[nearest(at, at[answers])]], axis=1)
        return np.column_stack(
            [
                np.minimum(near.distances / _OFF, 3.0),
                np.square(np.minimum(near.distances / _OFF, 3.0)),
                facing,
                near.on_rim,
                np.minimum(way_back / _OFF, 3.0),
                near.on_rim * np.minimum(near.distances / _OFF, 3.0),
                np.minimum(to_answer / _OFF, 3.0),
            ]
        )


def nearest_with_normals(
    points: FloatArray, normals: FloatArray, targets: FloatArray, normals_of_targets: FloatArray
) -> IntArray:
    """Return the nearest target of each point, by coordinates and weighted normals."""
    return nearest(
        np.column_stack([points, _NORMALS * normals]),
        np.column_stack([targets, _NORMALS * normals_of_targets]),
    )


def _misfit(laid: LaidOnPart) -> float:
    """Return how badly the reference fits, in space and by the local features of points."""
    return laid.off + laid.strain - _OF_LIKELIHOOD * laid.likelihood
