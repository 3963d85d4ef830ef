"""Colours that show the position of vertices on a surface."""

import numpy as np

from skfmap._tools.ties import ROUNDING, first_of_largest
from skfmap._tools.types import FloatArray

__all__ = ["colours_of_position"]


def colours_of_position(vertices: FloatArray) -> FloatArray:
    """Return a colour for each vertex that shows its position on the mesh.

    Along the longest axis colours go from blue to yellow, which nearly everyone can distinguish;
    along the shortest axis from dark green to light red, and along the third they become lighter.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates, in any unit.

    Returns
    -------
    ndarray of shape (n_vertices, 3)
        Colours in sRGB, between 0 and 1.
    """
    centred = vertices - vertices.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    largest = np.array([axis[first_of_largest(np.abs(axis), ROUNDING)] for axis in axes.T])
    axes = axes * np.where(largest < 0, -1, 1)
    along = centred @ axes
    short, middle, long = (
        2 * (along - along.min(axis=0)) / np.maximum(np.ptp(along, axis=0), 1e-300) - 1
    ).T
    # Chosen by eye: strong colours, few of which are outside sRGB (3 % on a ball, clipped).
    return _srgb_of_oklab(0.68 + 0.07 * middle + 0.09 * short, 0.13 * short, 0.13 * long)


def _srgb_of_oklab(lightness: FloatArray, red: FloatArray, yellow: FloatArray) -> FloatArray:
    """Return sRGB (IEC 61966-2-1) of Oklab (B. Ottosson, "A perceptual color space", 2020)."""
    roots = np.column_stack(
        [
            lightness + 0.3963377774 * red + 0.2158037573 * yellow,
            lightness - 0.1055613458 * red - 0.0638541728 * yellow,
            lightness - 0.0894841775 * red - 1.2914855480 * yellow,
        ]
    )
    to_linear = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    linear = np.clip(roots**3 @ to_linear.T, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
