"""Quality of the registration of a shape, relative to that of training shapes."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.geometry.closest import ClosestPoints
from skfmap.geometry.normals import vertex_normals
from skfmap.registration.deformation import Deformation

__all__ = ["Limits", "Quality", "assess"]

# Distance, in mean edge lengths of the reference, beyond which a point is off the other surface.
_OFF = 2.0
# Quantile of the strain at vertices of training shapes above which vertices count as stretched, and
# its minimum: a tenth, for kinds of shapes that hardly vary.
_USUAL, _LEAST_STRAIN = 0.99, 0.1
# A shape does not fit if a fraction exceeds this multiple of the usual one, with these minimum and
# maximum limits. Other kinds of bodies, and halves of bodies, exceed them by far.
_TIMES, _AT_LEAST, _AT_MOST = 3.0, 0.05, 0.2
# Minimum of the usual energy, for kinds of shapes that hardly vary.
_LEAST_ENERGY = 0.01


class Quality(NamedTuple):
    """Quality of a reference laid onto a shape.

    Attributes
    ----------
    off : float
        Fraction of the reference's area that lies off the shape by more than two mean edge lengths,
        or on it but facing the other way, as a part that is folded into another one does.
    uncovered : float
        Fraction of the shape's area that lies off the reference in the same sense.
    stretched : float
        Fraction of the reference's area that is stretched or compressed more than nearly all of the
        area of training shapes.
    energy : float
        Deformation energy beyond what training shapes explain: the energy of `ElasticSurface`
        relative to the nearest shape of the deformation model. It is dimensionless.
    """

    off: float
    uncovered: float
    stretched: float
    energy: float


class Limits(NamedTuple):
    """The strain above which the mesh counts as stretched, and the usual quality."""

    strain: float
    usual: Quality

    @classmethod
    def shown_by(cls, deformation: Deformation, laid: Sequence[FloatArray]) -> Self:
        """Return the limits from the reference laid onto training shapes by known pairs."""
        strains = [_at_vertices(deformation, deformation.mean.strains(one)) for one in laid]
        usual = float(np.quantile(np.concatenate(strains), _USUAL))
        return cls(max(usual, _LEAST_STRAIN), Quality(0.0, 0.0, 0.0, 0.0))

    def with_usual(self, seen: Sequence[Quality]) -> Self:
        """Return the limits with the median quality of held-out training shapes.

        The median is used since one of them may have been matched wrongly.
        """
        return self._replace(usual=Quality(*np.median(seen, axis=0).tolist()))

    def allow(self, quality: Quality) -> bool:
        """Return whether a reference that was laid onto a shape fits it."""
        return all(
            one <= min(max(_AT_LEAST, _TIMES * usual), _AT_MOST)
            for one, usual in zip(quality[:3], self.usual[:3], strict=True)
        )

    def misfit(self, quality: Quality) -> float:
        """Return how much worse than usual a reference fits; 1 means as usual.

        This is the mean of the area that lies off, on either side, and of the energy, each divided
        by its usual value. If limbs are confused, or front and back, the reference may lie close to
        the shape but needs more energy.
        """
        off, usual = quality.off + quality.uncovered, self.usual.off + self.usual.uncovered
        energy = quality.energy / max(self.usual.energy, _LEAST_ENERGY)
        return (off / max(usual, _AT_LEAST) + energy) / 2

    def doubt(self, quality: Quality) -> float:
        """Return the misfit, or infinity if the reference does not fit, apart from its stretch.

        The misfit alone is not enough: usual values are high if most training shapes were matched
        wrongly.
        """
        fits = self.allow(quality._replace(stretched=0.0))
        return self.misfit(quality) if fits else float("inf")


def assess(
    deformation: Deformation,
    limits: Limits,
    laid: tuple[FloatArray, IntArray, FloatArray],
    shape: tuple[FloatArray, IntArray, FloatArray],
) -> Quality:
    """Return the quality of a reference laid onto a shape.

    Parameters
    ----------
    deformation, limits : Deformation, Limits
        The fitted models.
    laid, shape : tuple of ndarray
        Vertices, faces and vertex areas of the laid reference and of the shape.
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
    """Return which vertices of one mesh are far from another one, or face the other way."""
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
