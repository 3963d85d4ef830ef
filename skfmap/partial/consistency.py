"""Regions that are as far apart on the reference as points are on a scan."""

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import FloatArray

__all__ = ["agreed"]

# Distances, in sqrt(area), are compared by bins of this width, up to the largest.
_BIN, _FARTHEST = 0.05, 1.0
# By how much distances of a body differ from those of the reference: a constant, for regions are
# not points, and a share. Ways around what is missing are longer, never shorter.
_CONSTANT, _SHARE, _AROUND = 0.04, 0.07, 1.6
# Largest cost of a pair of regions, in squared deviations: one of the two may be wrong.
_MOST = 6.0
# How much all pairs of a point count together beside what its surroundings tell, from the first
# round to the last.
_FIRST, _LAST, _ROUNDS = 2.0, 25.0, 20


def agreed(
    logarithms: npt.NDArray[np.float32],
    among: FloatArray,
    distances_0: FloatArray,
    more: npt.NDArray[np.float32] | None = None,
    to_samples: FloatArray | None = None,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return the probabilities of regions at points of a scan, made consistent with one another.

    Mean-field rounds on a random field: a point believes in a region by how its surroundings look,
    and by how far the other points are from it on the scan, and their regions from the region on
    the reference.

    Parameters
    ----------
    logarithms : ndarray of shape (n_samples, n_regions)
        Of the probabilities that surroundings give.
    among : ndarray of shape (n_samples, n_samples)
        Distances along the scan, in sqrt(area) of the reference; infinite between pieces.
    distances_0 : ndarray of shape (n_regions, n_regions)
        Distances of regions along the reference.
    more : ndarray of shape (n_points, n_regions), optional
        Logarithms for further points, to which samples say what they found.
    to_samples : ndarray of shape (n_points, n_samples), optional
        Distances of these points from the samples.

    Returns
    -------
    probabilities : ndarray of shape (n_samples, n_regions)
    further : ndarray of shape (n_points, n_regions)
    """
    costs = _costs(distances_0)
    near = _bins(among)
    beliefs = _softmax(logarithms)
    for weight in np.geomspace(_FIRST, _LAST, _ROUNDS):
        told = _told(near, beliefs, costs)
        beliefs = 0.5 * beliefs + 0.5 * _softmax(logarithms - np.float32(weight) * told)
    if more is None or to_samples is None:
        return beliefs, beliefs
    told = _told(_bins(to_samples), beliefs, costs)
    return beliefs, _softmax(more - np.float32(_LAST) * told)


def _costs(distances_0: FloatArray) -> list[npt.NDArray[np.float32]]:
    """Return, for each bin of distances on a scan, what pairs of regions cost."""
    found = []
    for number in range(round(_FARTHEST / _BIN)):
        apart = (number + 0.5) * _BIN
        off = distances_0 - apart
        width = (_CONSTANT + _SHARE * apart) * np.where(off < 0, _AROUND, 1.0)
        found.append(np.minimum(np.square(off / width), _MOST).astype(np.float32))
    return found


def _bins(distances: FloatArray) -> list[npt.NDArray[np.float32]]:
    """Return which pairs of points each bin holds, as shares of all pairs of a point."""
    numbers = np.full(distances.shape, -1)
    usable = (distances < _FARTHEST) & (distances > 0)
    numbers[usable] = (distances[usable] / _BIN).astype(np.int64)
    counts = np.maximum((numbers >= 0).sum(axis=1, keepdims=True), 1)
    return [((numbers == b) / counts).astype(np.float32) for b in range(round(_FARTHEST / _BIN))]


def _told(
    near: list[npt.NDArray[np.float32]],
    beliefs: npt.NDArray[np.float32],
    costs: list[npt.NDArray[np.float32]],
) -> npt.NDArray[np.float32]:
    """Return the mean cost of each region at each point, by what the others believe."""
    total = np.zeros((len(near[0]), beliefs.shape[1]), dtype=np.float32)
    for pairs, cost in zip(near, costs, strict=True):
        total += (pairs @ beliefs) @ cost
    return total


def _softmax(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    raised = np.exp(values - values.max(axis=1, keepdims=True))
    return np.asarray(raised / raised.sum(axis=1, keepdims=True), dtype=np.float32)
