"""How shapes of a kind deform: learned from training shapes that the reference was laid onto."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from skfmap._tools.types import FloatArray, IntArray
from skfmap.functional.similarity import best_similarity
from skfmap.geometry.elasticity import ElasticSurface

__all__ = ["Deformation"]

# Principal components that are kept at most: 20 take 4 MB at 5,000 vertices.
_MOST_MODES = 20
# Rounds in which rotations and coordinates take turns, and alignments and means.
_ROUNDS, _ROUNDS_OF_MEAN = 10, 4
# What holds the mean shape in its place, of which edges say nothing.
_IN_PLACE = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class Deformation:
    """As rigid as possible, around what training shapes show.

    Edges of the reference's mesh, seen from the reference at rest, say how a shape is stretched and
    sheared, whatever its pose. Their mean and principal components over training shapes are the
    linear model of Sumner et al. 2005 (*Mesh-based inverse kinematics*) and of shapes that stand
    alike as well.

    Attributes
    ----------
    mean : ElasticSurface
        The reference's mesh with the mean edges at rest.
    shape_at_rest : ndarray of shape (n_vertices, 3)
        Coordinates with these edges.
    modes : ndarray of float32, shape (n_modes, 3 * n_edges)
        Principal components of edges times the roots of their weights; orthonormal.
    deviations : ndarray of shape (n_modes,)
        Standard deviations along them.
    """

    mean: ElasticSurface
    shape_at_rest: FloatArray
    modes: npt.NDArray[np.float32]
    deviations: FloatArray

    @classmethod
    def of_reference(cls, vertices: FloatArray, faces: IntArray) -> Self:
        """Return the deformation of which nothing was learned: the reference alone is at rest."""
        rest = ElasticSurface.at_rest(vertices, faces)
        return cls(rest, vertices, np.zeros((0, rest.vectors.size), np.float32), np.zeros(0))

    @classmethod
    def learned(
        cls,
        vertices: FloatArray,
        faces: IntArray,
        laid: Sequence[FloatArray],
        *,
        areas: FloatArray | None = None,
    ) -> Self:
        """Learn from the reference and from the coordinates in which it lies on training shapes.

        Parameters
        ----------
        vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
            The reference.
        laid : sequence of ndarray of shape (n_vertices, 3)
            Coordinates of its vertices on training shapes.
        areas : ndarray of shape (n_vertices,), optional
            Of the vertices, where shapes are stiff: the mean is then that of their coordinates,
            aligned by similarities, which puts landmarks of mandibles within 0.232 mm rather than
            0.257. Where shapes bend, coordinates have no mean, and edges turned back have.

        Returns
        -------
        Deformation
            With as many principal components as there are training shapes, 20 at most.
        """
        start, shapes = ElasticSurface.at_rest(vertices, faces), [vertices, *laid]
        rest, at_rest = _mean_edges(start, shapes) if areas is None else _mean(start, shapes, areas)
        seen = np.stack([rest.seen_from_rest(shape) for shape in shapes])
        scaled = (seen - rest.vectors) * np.sqrt(rest.weights)[:, None]
        n_modes = min(len(laid), _MOST_MODES)
        _, sizes, modes = np.linalg.svd(scaled.reshape(len(shapes), -1), full_matrices=False)
        deviations = sizes[:n_modes] / np.sqrt(max(len(laid), 1))
        return cls(rest, at_rest, modes[:n_modes].astype(np.float32), deviations)

    def adapted(self, vertices: FloatArray) -> ElasticSurface:
        """Return the surface whose rest is as like given coordinates as training shapes allow.

        Along each component the coordinates are shrunk by how they vary there in comparison with
        what the components leave.
        """
        if not len(self.modes):
            return self.mean
        roots = np.sqrt(self.mean.weights)[:, None]
        seen = ((self.mean.seen_from_rest(vertices) - self.mean.vectors) * roots).ravel()
        along = self.modes @ seen
        left = float(np.mean(np.square(seen - self.modes.T @ along)))
        along *= np.square(self.deviations) / (np.square(self.deviations) + left + 1e-300)
        vectors = (self.modes.T @ along).reshape(-1, 3) / roots
        return self.mean.with_vectors(self.mean.vectors + vectors)

    def energy(self, vertices: FloatArray) -> float:
        """Return the energy of coordinates around the nearest rest that training shapes allow."""
        nearest = self.adapted(vertices)
        beyond = self.mean.seen_from_rest(vertices) - nearest.vectors
        return float(self.mean.weights @ np.square(beyond).sum(axis=1))


def _mean(
    start: ElasticSurface, shapes: Sequence[FloatArray], areas: FloatArray
) -> tuple[ElasticSurface, FloatArray]:
    """Return the mean of coordinates that are aligned to it (generalised Procrustes analysis)."""
    mean = shapes[0]
    for _ in range(_ROUNDS_OF_MEAN):
        aligned = [best_similarity(shape, mean, areas).apply(shape) for shape in shapes]
        centred = np.mean(aligned, axis=0)
        # Means are smaller than what they are means of, and would shrink from round to round.
        mean = best_similarity(centred, shapes[0], areas).apply(centred)
    return start.with_vectors(start.along_edges(mean)), mean


def _mean_edges(
    start: ElasticSurface, shapes: Sequence[FloatArray]
) -> tuple[ElasticSurface, FloatArray]:
    """Return the edges that shapes have in the mean, turned back, and coordinates for them."""
    rest = start
    for _ in range(2):  # the second time seen from the mean
        rest = rest.with_vectors(np.mean([rest.seen_from_rest(shape) for shape in shapes], axis=0))
    solver = splu((rest.stiffness + _IN_PLACE * sp.eye_array(rest.n_vertices)).tocsc())
    rotations = np.tile(np.eye(3), (rest.n_vertices, 1, 1))
    for _ in range(_ROUNDS):
        vertices = solver.solve(rest.turned(rotations))
        rotations = rest.rotations(vertices)
    return rest, np.asarray(vertices)
