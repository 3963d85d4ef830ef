"""How well the reference lies on a shape, judged by what training shapes showed."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.geometry.closest import ClosestPoints
from skfmap.geometry.normals import vertex_normals
from skfmap.registration.deformation import Deformation

__all__ = ["Limits", "Quality", "assess"]

# Distance, in mean edges of the reference, beyond which a point is off the other surface.
_OFF = 2.0
# Share of vertices of training shapes around which edges are stretched less than what counts as
# stretched, and the least that does: a tenth, for kinds that hardly vary.
_USUAL, _LEAST_STRAIN = 0.99, 0.1
# What is told of shapes that do not fit: so many times what is usual, and this share at least and
# at most. Other bodies, and halves of them, are beyond by far.
_TIMES, _AT_LEAST, _AT_MOST = 3.0, 0.05, 0.2
# The least energy that is usual, for kinds that hardly vary.
_LEAST_ENERGY = 0.01


class Quality(NamedTuple):
    """Of a reference laid onto a shape.

    Attributes
    ----------
    off : float
        Share of the reference's area that lies off the shape, by more than two mean edges, or on it
        but facing the other way, as what is folded into another part does.
    uncovered : float
        Share of the shape's area that lies off the reference, likewise.
    stretched : float
        Share of the reference's area that is stretched, or compressed, more than nearly all of what
        training showed.
    energy : float
        What its deformation takes beyond what training showed: the energy of `ElasticSurface`
        around the nearest of the shapes that were learned. It has no unit.
    """

    off: float
    uncovered: float
    stretched: float
    energy: float


class Limits(NamedTuple):
    """The strain that counts as stretched, and the qualities that are usual."""

    strain: float
    usual: Quality

    @classmethod
    def shown_by(cls, deformation: Deformation, laid: Sequence[FloatArray]) -> Self:
        """Return the limits of training shapes that the reference was laid onto by known pairs."""
        strains = [_at_vertices(deformation, deformation.mean.strains(one)) for one in laid]
        usual = float(np.quantile(np.concatenate(strains), _USUAL))
        return cls(max(usual, _LEAST_STRAIN), Quality(0.0, 0.0, 0.0, 0.0))

    def with_usual(self, seen: Sequence[Quality]) -> Self:
        """Return the limits with the medians of what left-out training shapes showed.

        One of them may have been matched wrongly.
        """
        return self._replace(usual=Quality(*np.median(seen, axis=0).tolist()))

    def allow(self, quality: Quality) -> bool:
        """Tell whether a reference that was laid onto a shape fits it."""
        return all(
            one <= min(max(_AT_LEAST, _TIMES * usual), _AT_MOST)
            for one, usual in zip(quality[:3], self.usual[:3], strict=True)
        )

    def misfit(self, quality: Quality) -> float:
        """Return how much worse than usual a reference lies: 1 where it lies as it usually does.

        The mean of what lies off, on either side, and of the energy, both by what is usual. Where
        one limb was taken for another, or front for back, the reference may lie close, but takes
        more energy.
        """
        off, usual = quality.off + quality.uncovered, self.usual.off + self.usual.uncovered
        energy = quality.energy / max(self.usual.energy, _LEAST_ENERGY)
        return (off / max(usual, _AT_LEAST) + energy) / 2

    def doubt(self, quality: Quality) -> float:
        """Return the misfit, or infinity if the reference does not fit, however stretched it is.

        Usual values can be high because most training shapes were matched wrongly.
        """
        fits = self.allow(quality._replace(stretched=0.0))
        return self.misfit(quality) if fits else float("inf")


def assess(
    deformation: Deformation,
    limits: Limits,
    laid: tuple[FloatArray, IntArray, FloatArray],
    shape: tuple[FloatArray, IntArray, FloatArray],
) -> Quality:
    """Return how well a reference lies on a shape.

    Parameters
    ----------
    deformation, limits : Deformation, Limits
        What was learned.
    laid, shape : tuple of ndarray
        Vertices, faces and areas of the vertices, of the laid reference and of the shape.
    """
    off = _OFF * float(np.linalg.norm(deformation.mean.vectors, axis=1).mean())
    mean_strain = _at_vertices(deformation, deformation.mean.strains(laid[0]))
    return Quality(
        _share(_lies_off(laid, shape, off), laid[2]),
        _share(_lies_off(shape, laid, off), shape[2]),
        _share(mean_strain > limits.strain, laid[2]),
        deformation.energy(laid[0]),
    )


def _lies_off(
    one: tuple[FloatArray, IntArray, FloatArray],
    other: tuple[FloatArray, IntArray, FloatArray],
    off: float,
) -> BoolArray:
    """Return which vertices of one mesh are far from another, or face the other way there."""
    near = ClosestPoints(*other[:2]).of(one[0])
    cosines = np.einsum("na,na->n", vertex_normals(*one[:2]), near.normals)
    return np.asarray((near.distances > off) | (cosines < 0))


def _share(which: BoolArray, areas: FloatArray) -> float:
    return float(np.average(which, weights=areas))


def _at_vertices(deformation: Deformation, values: FloatArray) -> FloatArray:
    """Return the mean over the edges at each vertex."""
    at = deformation.mean.ends
    counts = np.asarray(at.sum(axis=1), dtype=np.float64).ravel()
    return np.asarray(at @ values, dtype=np.float64) / np.maximum(counts, 1.0)
