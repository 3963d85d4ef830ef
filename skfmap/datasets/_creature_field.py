"""The implicit surface of a creature at rest: a smooth union of tapered capsules, mirrored in x."""

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.datasets._creature_body import PARTS, Body

__all__ = ["capsule_distance", "gradient", "mirror", "part_distances", "project", "signed_distance"]

# Step of differences, in centimetres. The curvature of the thinnest parts, of a radius of 2, turns
# it into an error of 2e-5 of the slope, which Newton steps correct.
_STEP = 1e-4


def mirror(points: FloatArray) -> FloatArray:
    """Return the points with x and -x exchanged; shape (..., 3)."""
    return points * np.array([-1.0, 1.0, 1.0])


def capsule_distance(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return how far points are outside a tapered capsule.

    Parameters
    ----------
    points : ndarray of shape (n, 3)
        Where to measure.
    start, end : ndarray of shape (4,)
        Ends of the capsule: x, y, z and radius.

    Returns
    -------
    ndarray of shape (n,)
        Distance to the nearest point of the axis minus the radius there: negative inside.
    """
    axis = end - start
    along = np.clip((points - start[:3]) @ axis[:3] / (axis[:3] @ axis[:3]), 0.0, 1.0)
    nearest = start[:3] + along[:, None] * axis[:3]
    return np.asarray(np.linalg.norm(points - nearest, axis=1) - (start[3] + along * axis[3]))


def part_distances(body: Body, points: FloatArray) -> FloatArray:
    """Return how far points are outside each part of the body.

    Parameters
    ----------
    body : Body
        The body at rest.
    points : ndarray of shape (n, 3)
        Where to measure.

    Returns
    -------
    ndarray of shape (n_parts, n)
        One row per part of ``PARTS``, unpaired or on the side x > 0. For the other side give
        mirrored points.
    """
    return np.array(
        [capsule_distance(points, *ends) for ends in zip(body.starts, body.ends, strict=True)]
    )


def signed_distance(body: Body, points: FloatArray) -> FloatArray:
    """Return, nearly, the distance to the creature's surface.

    Parameters
    ----------
    body : Body
        The body at rest.
    points : ndarray of shape (n, 3)
        Where to measure.

    Returns
    -------
    ndarray of shape (n,)
        Negative inside; the same at mirrored points.
    """
    total = np.full(len(points), np.inf)
    mirrored = mirror(points)
    for part, start, end in zip(PARTS, body.starts, body.ends, strict=True):
        distance = capsule_distance(points, start, end)
        if part.paired:
            distance = _smooth_minimum(distance, capsule_distance(mirrored, start, end), part.blend)
        total = _smooth_minimum(total, distance, part.blend)
    return total


def gradient(body: Body, points: FloatArray, values: FloatArray) -> FloatArray:
    """Return the gradient of the signed distance by differences.

    Parameters
    ----------
    body : Body
        The body at rest.
    points : ndarray of shape (n, 3)
        Where to differentiate.
    values : ndarray of shape (n,)
        Signed distance there.

    Returns
    -------
    ndarray of shape (n, 3)
        Pointing outwards, of length about 1.
    """
    shifted = [signed_distance(body, points + step) for step in _STEP * np.eye(3)]
    return (np.column_stack(shifted) - values[:, None]) / _STEP


def project(body: Body, points: FloatArray, n_steps: int = 2) -> FloatArray:
    """Move points to the creature's surface by Newton steps along the gradient.

    Parameters
    ----------
    body : Body
        The body at rest.
    points : ndarray of shape (n, 3)
        Points near the surface.
    n_steps : int
        How many steps.

    Returns
    -------
    ndarray of shape (n, 3)
        Points on the surface.
    """
    for _ in range(n_steps):
        values = signed_distance(body, points)
        slope = gradient(body, points, values)
        points = points - (values / (slope**2).sum(axis=1))[:, None] * slope
    return points


def _smooth_minimum(a: FloatArray, b: FloatArray, width: float) -> FloatArray:
    """Return the minimum of a and b, rounded off where they differ by less than ``width``."""
    overlap = np.maximum(width - np.abs(a - b), 0.0)
    return np.minimum(a, b) - overlap**2 / (4.0 * width)
