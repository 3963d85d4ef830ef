"""Probe functions that distinguish left from right."""

from itertools import combinations

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import check_number, label
from skfmap.descriptors.family import ProbeFamily, check_range
from skfmap.exceptions import MeshError
from skfmap.functional.signatures import wave_kernel_signature
from skfmap.geometry.oriented import integrated_oriented_products
from skfmap.shapes import SpectralShape

__all__ = ["OrientedProducts"]


class OrientedProducts(ProbeFamily):
    """Products <grad f x grad g, n> of pairs of signatures, which change sign under a reflection.

    The probes of the paper are invariant under the left-right symmetry of a shape, and therefore
    cannot tell left from right. Oriented products can, provided that faces are wound outwards. As
    an operator, such a product is the orientation term of Ren et al. 2018.

    Parameters
    ----------
    n_sources : int, default=11
        Number of signatures; every two of them form a product, so 11 give 55 functions.
    sigma : float, default=0.3
        Standard deviation of the wave kernel signatures, in log eigenvalue.
    lambda_min, lambda_max : float, default=5, 400
        Eigenvalues of the first and the last energy, at unit area. 5 is below the first eigenvalue
        of TOSCA's cats (7), and 400 is about their 35th.
    """

    def __init__(
        self,
        n_sources: int = 11,
        *,
        sigma: float = 0.3,
        lambda_min: float = 5.0,
        lambda_max: float = 400.0,
    ) -> None:
        self.n_sources = n_sources
        self.sigma = sigma
        self.lambda_min = lambda_min
        self.lambda_max = lambda_max

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        check_range(
            self.n_sources,
            self.lambda_min,
            self.lambda_max,
            "lambda_min",
            "lambda_max",
            count="n_sources",
            least=2,
        )
        check_number(self.sigma, "sigma", low=0, strict=True)

    def labels(self) -> list[str]:
        """Return the pairs of energies, as eigenvalues."""
        return [f"lambda={a:.3g}x{b:.3g}" for a, b in combinations(self._energies(), 2)]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        if not shape.oriented:
            raise MeshError(
                f"The faces of {label(shape.name)} cannot be wound consistently, so it has no "
                "left and right; mend its non-manifold edges, or use "
                "DescriptorTransformer('paper')."
            )
        sources = wave_kernel_signature(
            shape.evals, shape.evecs, np.log(self._energies()), self.sigma
        )
        first, second = np.array(list(combinations(range(self.n_sources), 2))).T
        integrals = integrated_oriented_products(
            sources[:, first], sources[:, second], shape.mesh.faces
        )
        coefficients = shape.evecs.T @ integrals
        # On a surface of revolution all gradients are parallel, and with two mirror planes no low
        # function distinguishes left from right: the products are rounding errors, which must not
        # be normalised. On symmetric ellipsoids these are below 1e-12, and all others above 1e-7;
        # on TOSCA's cats the largest coefficient of each function is 0.009 or more.
        steepness = np.sqrt((sources * np.asarray(shape.stiffness @ sources)).sum(axis=0))
        noise = np.abs(coefficients) <= 1e-8 * steepness[first] * steepness[second]
        return np.asarray(np.where(noise, 0.0, coefficients))

    def _energies(self) -> FloatArray:
        return np.geomspace(self.lambda_min, self.lambda_max, self.n_sources)
