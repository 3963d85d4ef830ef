"""Normalisation of probe functions: they are centred and scaled to a common norm (section 2.1)."""

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["centre", "scale_by", "scales_of"]

# A probe counts as constant if less than this fraction of its norm remains after centring. Constant
# functions leave 4e-14 in 120 eigenfunctions of TOSCA's cats; their most constant probe has 0.017.
_ROUNDING = 1e-12


def centre(probes: FloatArray) -> FloatArray:
    """Return the probes without their constant part (coefficient 0 of each column)."""
    out = probes.copy()
    out[0] = 0.0
    return out


def scales_of(probes: FloatArray) -> FloatArray:
    """Return the factor that scales each centred column to norm 1 / sqrt(n_probes).

    It is 0 for a column that is constant up to rounding. With this norm, the effect of a
    regularisation strength does not depend on the number of probes.
    """
    norms = np.linalg.norm(probes[1:], axis=0)
    nil = norms <= _ROUNDING * np.linalg.norm(probes, axis=0)
    return np.where(nil, 0.0, 1 / (np.where(nil, 1.0, norms) * np.sqrt(probes.shape[1])))


def scale_by(probes_0: FloatArray, probes_i: FloatArray, normalize: str) -> FloatArray:
    """Return ``probes_i`` centred and scaled.

    Parameters
    ----------
    probes_0, probes_i : ndarray of shape (k, n_probes)
        Raw coefficients on the reference and on the shape.
    normalize : {"shape", "reference"}
        Whether each shape's columns are scaled by their own norms (as in the paper) or by those of
        the reference, which preserves differences in amplitude.

    Returns
    -------
    normalised : ndarray of shape (k, n_probes)
        Centred and scaled coefficients; zero for a probe that is constant on either shape.
    """
    reference, own = scales_of(probes_0), scales_of(probes_i)
    factors = own if normalize == "shape" else reference
    return np.asarray(centre(probes_i) * np.where((reference > 0) & (own > 0), factors, 0.0))
