"""Heat and wave kernel signatures as probe functions."""

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import check_number
from skfmap.descriptors.family import ProbeFamily, check_range
from skfmap.functional.projection import project
from skfmap.functional.signatures import heat_kernel_signature, wave_kernel_signature
from skfmap.shapes import SpectralShape

__all__ = ["HeatKernelSignature", "WaveKernelSignature"]


class HeatKernelSignature(ProbeFamily):
    """Heat kernel signature (Sun, Ovsjanikov, Guibas 2009).

    Parameters
    ----------
    n_functions : int, default=5
        Number of times, in geometric progression.
    t_min, t_max : float, default=0.01, 1.0
        First and last time, at unit area. The paper does not specify them. A time of 0.01 resolves
        details of about 0.15 sqrt(area), and at 1 only the smoothest functions remain.
    """

    def __init__(self, n_functions: int = 5, *, t_min: float = 0.01, t_max: float = 1.0) -> None:
        self.n_functions = n_functions
        self.t_min = t_min
        self.t_max = t_max

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        check_range(self.n_functions, self.t_min, self.t_max, "t_min", "t_max")

    def labels(self) -> list[str]:
        """Return the times."""
        return [f"t={t:.3g}" for t in self._times()]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        return project(
            heat_kernel_signature(shape.evals, shape.evecs, self._times()), shape.evecs, shape.mass
        )

    def _times(self) -> FloatArray:
        return np.geomspace(self.t_min, self.t_max, self.n_functions)


class WaveKernelSignature(ProbeFamily):
    """Wave kernel signature (Aubry, Schlickewei, Cremers 2011) at one variance.

    Parameters
    ----------
    n_functions : int, default=5
        Number of energies, in geometric progression.
    sigma : float, default=0.3
        Standard deviation in log eigenvalue. It does not depend on the number of energies, unlike
        the authors' rule, which breaks down for fewer than 28 energies. The paper uses three
        variances without specifying them; `paper_families` uses 0.1, 0.3 and 0.6.
    lambda_min, lambda_max : float, default=5, 400
        Eigenvalues of the first and the last energy, at unit area. 5 is below the first eigenvalue
        of TOSCA's cats (7), and 400 is about their 35th.
    """

    def __init__(
        self,
        n_functions: int = 5,
        *,
        sigma: float = 0.3,
        lambda_min: float = 5.0,
        lambda_max: float = 400.0,
    ) -> None:
        self.n_functions = n_functions
        self.sigma = sigma
        self.lambda_min = lambda_min
        self.lambda_max = lambda_max

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        check_range(self.n_functions, self.lambda_min, self.lambda_max, "lambda_min", "lambda_max")
        # Log eigenvalues near 400 are about 0.03 apart: far below this, only the nearest counts.
        check_number(self.sigma, "sigma", low=1e-3)

    def labels(self) -> list[str]:
        """Return the energies, as eigenvalues."""
        return [f"lambda={e:.3g}" for e in self._energies()]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        values = wave_kernel_signature(
            shape.evals, shape.evecs, np.log(self._energies()), self.sigma
        )
        return project(values, shape.evecs, shape.mass)

    def _energies(self) -> FloatArray:
        return np.geomspace(self.lambda_min, self.lambda_max, self.n_functions)
