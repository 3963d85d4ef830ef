"""The reference and what was learned of its kind: what a part is recognised and laid on by."""

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

# Into how many regions the reference is divided.
_N_REGIONS = 160
# Points of a training part that are learned from.
_N_LEARNED = 800
# How far apart opposite normals are, in sqrt(area).
_NORMALS = 0.03
# How much the reference resists, in the end, beside what draws it, and in how many rounds, where
# hypotheses are compared and in the end.
_STIFFNESS, _FEW_ROUNDS, _ROUNDS = 0.3, 4, 9
# Distance below which the straight line stands for the way along the reference, in sqrt(area).
_NEAR = 0.1
# Farther than this, in sqrt(area), or turned away by more, a point does not lie on the other.
_OFF, _AGREES = 0.04, 0.3

# Where points of a part may belong: so many answers are looked for, and those are laid whose score
# is this near to that of the best, unless their answers are this near to those of another, in
# sqrt(area), on average.
_N_HYPOTHESES, _AS_GOOD, _ALIKE = 3, 4.0, 0.02
# Distance in space that counts as one deviation when points are asked again, in sqrt(area), and the
# most squared deviations.
_NEAR_IN_SPACE, _DISTANT = 0.1, 8.0
# How much a logarithm of the probability counts beside the share that lies off the reference.
_OF_LIKELIHOOD = 0.1
# How much a distance on the reference from where a point is believed counts beside one in space.
_BELIEVED = 0.2


class Regions(NamedTuple):
    """The reference, divided into regions.

    Attributes
    ----------
    vertices, faces, areas : ndarray
        Of the working mesh of the reference, at unit area.
    centres : ndarray of int, shape (n_regions,)
        Vertices.
    distances : ndarray of float32, shape (n_regions, n_vertices)
        Along edges from each of them.
    """

    vertices: FloatArray
    faces: IntArray
    areas: FloatArray
    centres: IntArray
    distances: npt.NDArray[np.float32]

    def ways(self, one: IntArray, other: IntArray) -> FloatArray:
        """Return about how far vertices are from others along the surface.

        Straight lines stand for short ways, and for others the way from the region of the first.
        """
        straight = np.linalg.norm(self.vertices[one] - self.vertices[other], axis=1)
        region = self.distances[:, one].argmin(axis=0)
        along = self.distances[region, other].astype(np.float64)
        return np.where((straight < _NEAR) & (along < 3 * _NEAR), straight, along)


def shared_regions(vertices: FloatArray, faces: IntArray, areas: FloatArray) -> Regions:
    """Divide a mesh of unit area into regions about well-spread vertices."""
    centres, distances = farthest_vertices(vertices, faces, np.arange(len(vertices)), _N_REGIONS)
    # Files of models hold each array once, and the reference has these.
    return Regions(
        vertices.copy(), faces.copy(), areas.copy(), centres, distances.astype(np.float32)
    )


class Lesson(NamedTuple):
    """A part of a training shape, and where its vertices lie on the reference.

    Attributes
    ----------
    scan : Scan
        The part.
    vertices_0 : ndarray of int, shape (n_vertices,)
        Vertex of the reference that each vertex lies at.
    covered : ndarray of bool, shape (n_vertices_0,)
        Which vertices of the reference lie on the part.
    """

    scan: Scan
    vertices_0: IntArray
    covered: BoolArray

    @classmethod
    def of(cls, scan: Scan, laid: FloatArray, faces: IntArray) -> Self:
        """Return the lesson of a part of a shape that the reference was laid onto."""
        at = nearest_places(scan.vertices, laid, faces)
        vertices_0 = at.corners[np.arange(len(at.corners)), at.weights.argmax(axis=1)]
        near = scan.surface.of(laid)
        facing = np.einsum("na,na->n", vertex_normals(laid, faces), near.normals) > _AGREES
        covered = (near.distances < _OFF) & facing & ~near.on_rim
        return cls(scan, vertices_0, covered)

    def rows(self) -> IntArray:
        """Return the vertices that are learned from."""
        return self.scan.points[:_N_LEARNED]


class LaidOnPart(NamedTuple):
    """The reference laid onto a part.

    Attributes
    ----------
    vertices : ndarray of shape (n_vertices_0, 3)
        In the place of the scan, in units of sqrt(area) of the reference.
    p2p : ndarray of int, shape (n_points,)
        Vertex of the reference for each vertex of the scan.
    away, facing : ndarray of shape (n_points,)
        How far each is from the laid reference, and the cosine between their normals.
    disagreement, belief : ndarray of shape (n_points,)
        How far the answer is from where surroundings, made consistent, put it, and how firmly.
    places : ndarray of shape (n_points, 3)
        Where on the reference they are believed to be, consistently.
    signs : ndarray of shape (n_vertices_0, n_signs)
        What tells whether vertices of the reference are covered.
    off : float
        Share of the scan that does not lie on the reference.
    likelihood : float
        Mean logarithm of the probability that surroundings give the regions of the answer.
    strain : float
        Mean logarithm by which edges are longer or shorter than training shapes explain.
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
    """The reference, how its kind deforms, and what its surroundings look like.

    Attributes
    ----------
    regions : Regions
        The reference.
    deformation : Deformation
        Learned from training shapes, in units of sqrt(area) of the reference.
    recogniser : Recogniser
        Learned from their parts.
    straight : tuple of ndarray of shape (n_regions, n_regions)
        Mean and deviation of straight lines between regions, on training shapes.
    """

    regions: Regions
    deformation: Deformation
    recogniser: Recogniser
    straight: tuple[FloatArray, FloatArray]

    @classmethod
    def learned(
        cls, regions: Regions, laid: Sequence[FloatArray], lessons: Sequence[Lesson]
    ) -> Self:
        """Learn from training shapes that the reference was laid onto, and from their parts."""
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

        By each of the hypotheses that are about as good, in a few rounds; what lies best is kept.
        From there points are asked again, with what is near them in space in mind, and the
        reference is laid anew.
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
        """Return the hypotheses without those that say about the same as one before them."""
        kept: list[Hypothesis] = []
        for one in found:
            regions = one.beliefs.argmax(axis=1)
            if all(
                self._apart[regions, other.beliefs.argmax(axis=1)].mean() > _ALIKE for other in kept
            ):
                kept.append(one)
        return kept

    def _distant(self, scan: Scan, laid: LaidOnPart) -> npt.NDArray[np.float32]:
        """Return how far regions of the laid reference are from points, squared in deviations."""
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
            Points of a scan, and where on the reference they are believed to be.
        vertices, normals_of_vertices : ndarray of shape (n_vertices_0, 3)
            Of the laid reference.
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
        """Return what tells whether vertices of the reference are covered."""
        near = scan.surface.of(vertices)
        facing = np.einsum("na,na->n", normals, near.normals)
        beside = nearest_with_normals(vertices, normals, scan.vertices, scan.normals)
        way_back = self.regions.ways(p2p[beside], np.arange(len(vertices)))
        return np.column_stack(
            [
                np.minimum(near.distances / _OFF, 3.0),
                np.square(np.minimum(near.distances / _OFF, 3.0)),
                facing,
                near.on_rim,
                np.minimum(way_back / _OFF, 3.0),
                near.on_rim * np.minimum(near.distances / _OFF, 3.0),
            ]
        )


def nearest_with_normals(
    points: FloatArray, normals: FloatArray, targets: FloatArray, normals_of_targets: FloatArray
) -> IntArray:
    """Return the nearest target of each point, farther away where normals differ."""
    return nearest(
        np.column_stack([points, _NORMALS * normals]),
        np.column_stack([targets, _NORMALS * normals_of_targets]),
    )


def _misfit(laid: LaidOnPart) -> float:
    """Return how badly the reference lies, by space and by the surroundings of points."""
    return laid.off + laid.strain - _OF_LIKELIHOOD * laid.likelihood
