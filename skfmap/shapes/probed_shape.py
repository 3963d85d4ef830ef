"""A spectral shape with the coefficients of its probe functions."""

from dataclasses import dataclass

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.shapes.spectral_shape import SpectralShape

__all__ = ["ProbedShape"]


@dataclass(frozen=True, eq=False, repr=False)
class ProbedShape:
    """A spectral shape with the coefficients of its probe functions.

    Attributes
    ----------
    spectral : SpectralShape
        The shape and its basis.
    probes : ndarray of shape (n_components, n_probes)
        Raw coefficients of the probe functions in ``spectral.evecs``, neither centred nor
        normalised.
    probe_names : tuple of str
        Name of each probe function; the same for all shapes from one transformer.
    probe_categories : tuple of str
        Family of each probe function.
    recipe : tuple of str
        Parameters of the basis and of the families that the coefficients depend on. Shapes can
        only be matched if their known parameters agree.
    reflected : bool
        Whether this is the mirror image of the given shape. The order of the vertices is unchanged;
        the first coordinate has the opposite sign.
    """

    spectral: SpectralShape
    probes: FloatArray
    probe_names: tuple[str, ...]
    probe_categories: tuple[str, ...]
    recipe: tuple[str, ...] = ()
    reflected: bool = False

    def __repr__(self) -> str:
        """Return one line with the name and the counts."""
        n_components, n_probes = self.probes.shape
        return f"ProbedShape({self.name!r}, n_components={n_components}, n_probes={n_probes})"

    @property
    def name(self) -> str | None:
        """Name of the mesh."""
        return self.spectral.name

    def functions(self) -> FloatArray:
        """Return the probe functions at the vertices, projected onto the basis.

        Returns
        -------
        ndarray of shape (n_vertices, n_probes)
            Values at the vertices of the working mesh.
        """
        return np.asarray(self.spectral.evecs @ self.probes)
