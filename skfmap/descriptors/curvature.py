"""Curvatures at several scales, and mesh saliency, as probe functions."""

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import check_choice, check_number
from skfmap.descriptors.family import ProbeFamily, check_range
from skfmap.functional.projection import diffuse, project
from skfmap.geometry.curvature import (
    clip_by_area,
    gaussian_curvature,
    log_magnitude,
    mean_curvature,
)
from skfmap.geometry.saliency import mesh_saliency
from skfmap.shapes import SpectralShape

__all__ = ["DiffusedCurvature", "MeshSaliency"]

# With a percentile of 50 or more nothing would be left between the lower and the upper one.
_HIGHEST_PERCENTILE = 49


class DiffusedCurvature(ProbeFamily):
    """Gaussian or mean curvature, diffused to several times (section 5.1).

    Parameters
    ----------
    kind : {"gaussian", "mean"}, default="gaussian"
        Gaussian curvature is the angle defect per area; mean curvature is positive where the
        surface is convex.
    logarithm : bool, default=False
        Whether to diffuse the logarithm of the absolute value, which puts more weight on flat
        areas.
    n_functions : int, default=5
        Number of diffusion times, in geometric progression.
    t_min, t_max : float, default=1e-3, 0.1
        First and last time, at unit area. Diffusion is exact in the basis: coefficients decay as
        exp(-t lambda).
    percentile : float, default=2
        The initial function is clipped to its area-weighted percentiles ``percentile`` and ``100 -
        percentile``.
    floor : float, default=1
        With ``logarithm``, the magnitude of curvature at unit area below which the logarithm is
        constant. 1 is about the 1st percentile of the magnitude of Gaussian curvature, and the 5th
        percentile of mean curvature, on a TOSCA cat.
    """

    def __init__(
        self,
        kind: str = "gaussian",
        *,
        logarithm: bool = False,
        n_functions: int = 5,
        t_min: float = 1e-3,
        t_max: float = 0.1,
        percentile: float = 2.0,
        floor: float = 1.0,
    ) -> None:
        self.kind = kind
        self.logarithm = logarithm
        self.n_functions = n_functions
        self.t_min = t_min
        self.t_max = t_max
        self.percentile = percentile
        self.floor = floor

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        check_choice(self.kind, "kind", ("gaussian", "mean"))
        check_range(self.n_functions, self.t_min, self.t_max, "t_min", "t_max")
        check_number(self.percentile, "percentile", low=0, high=_HIGHEST_PERCENTILE)
        check_number(self.floor, "floor", low=0, strict=True)

    def labels(self) -> list[str]:
        """Return the diffusion times."""
        return [f"t={t:.3g}" for t in self._times()]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        curvature = (
            _gaussian_curvature(shape) if self.kind == "gaussian" else _mean_curvature(shape)
        )
        values = log_magnitude(curvature, self.floor) if self.logarithm else curvature
        initial = clip_by_area(values, shape.mass, self.percentile)
        return diffuse(project(initial, shape.evecs, shape.mass), shape.evals, self._times())

    def _times(self) -> FloatArray:
        return np.geomspace(self.t_min, self.t_max, self.n_functions)


class MeshSaliency(ProbeFamily):
    """Mesh saliency (Lee, Varshney, Jacobs 2005): differences of mean curvature between two scales.

    Parameters
    ----------
    n_functions : int, default=10
        Number of scales sigma, in geometric progression; each compares sigma with 2 sigma.
    sigma_min, sigma_max : float, default=0.025, 0.1
        Smallest and largest scale in units of sqrt(area), measured along the surface. (The authors
        use a fraction of the bounding box, which depends on the pose.) 0.025 is the length of 1.5
        mean edges of a mesh of 5,000 vertices.
    percentile : float, default=2
        The mean curvature is first clipped to its area-weighted percentiles ``percentile`` and
        ``100 - percentile``.
    """

    def __init__(
        self,
        n_functions: int = 10,
        *,
        sigma_min: float = 0.025,
        sigma_max: float = 0.1,
        percentile: float = 2.0,
    ) -> None:
        self.n_functions = n_functions
        self.sigma_min = sigma_min
        self.sigma_max = sigma_max
        self.percentile = percentile

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        check_range(self.n_functions, self.sigma_min, self.sigma_max, "sigma_min", "sigma_max")
        check_number(self.percentile, "percentile", low=0, high=_HIGHEST_PERCENTILE)

    def labels(self) -> list[str]:
        """Return the scales."""
        return [f"sigma={s:.3g}" for s in self._scales()]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        curvature = clip_by_area(_mean_curvature(shape), shape.mass, self.percentile)
        values = mesh_saliency(curvature, shape.stiffness, shape.mass, self._scales())
        return project(values, shape.evecs, shape.mass)

    def _scales(self) -> FloatArray:
        return np.geomspace(self.sigma_min, self.sigma_max, self.n_functions)


def _gaussian_curvature(shape: SpectralShape) -> FloatArray:
    return gaussian_curvature(shape.mesh.vertices, shape.mesh.faces, shape.mass)


def _mean_curvature(shape: SpectralShape) -> FloatArray:
    return mean_curvature(shape.vertices, shape.mesh.faces, shape.stiffness, shape.mass)
