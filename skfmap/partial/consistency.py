"""Regions that are as far apart on the reference as points are on a scan."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import FloatArray

__all__ = ["Hypothesis", "hypotheses"]

# Distances, in sqrt(area), are compared by bins of this width, up to the largest.
_BIN, _FARTHEST = 0.05, 1.0
# By how much distances of a body differ from those of the reference: a constant, for regions are
# not points, and a share. Ways around what is missing are longer, never shorter.
_CONSTANT, _SHARE, _AROUND = 0.04, 0.07, 1.6
# By how much straight lines between pieces differ from those of training shapes beyond what these
# differ by, in sqrt(area): there are few of them.
_UNSEEN = 0.12
# Largest cost of a pair of regions, in squared deviations: one of the two may be wrong.
_MOST = 6.0
# How much all pairs of a point count together beside what its surroundings tell, from the first
# round to the last.
_FIRST, _LAST, _ROUNDS = 2.0, 25.0, 20

# Regions this near to those of another hypothesis, in sqrt(area), are avoided at first, by so much
# of a logarithm.
_AWAY, _AVOIDED = 0.25, 6.0


class Hypothesis(NamedTuple):
    """Where points of a scan believe to be on the reference, consistently.

    Attributes
    ----------
    beliefs : ndarray of shape (n_points, n_regions)
        Probabilities of regions.
    score : float
        How well surroundings and distances agree with them; of two, the higher is better.
    """

    beliefs: npt.NDArray[np.float32]
    score: float


def hypotheses(
    logarithms: npt.NDArray[np.float32],
    distances: FloatArray,
    straight: FloatArray,
    distances_0: FloatArray,
    straight_0: tuple[FloatArray, FloatArray],
    n_hypotheses: int,
) -> list[Hypothesis]:
    """Return where points of a scan may be on the reference, consistent with one another.

    Mean-field rounds on a random field: a point believes in a region by how its surroundings look,
    and by how far the other points are from it on the scan, and their regions from the region on
    the reference. As bodies are nearly their own images, each hypothesis begins away from those
    before it.

    Parameters
    ----------
    logarithms : ndarray of shape (n_points, n_regions)
        Of the probabilities that surroundings give.
    distances : ndarray of shape (n_points, n_samples)
        Distances along the scan from the first ``n_samples`` points, in sqrt(area) of the
        reference; infinite between pieces.
    straight : ndarray of shape (n_points, n_samples)
        Distances on the straight line, which are what is known between pieces.
    distances_0 : ndarray of shape (n_regions, n_regions)
        Distances of regions along the reference.
    straight_0 : tuple of ndarray of shape (n_regions, n_regions)
        Mean and deviation of their distances on the straight line, on training shapes.
    n_hypotheses : int
        How many.

    Returns
    -------
    list of Hypothesis
        The best first.
    """
    n = distances.shape[1]
    costs, near, own = _costs(distances_0, straight_0), _bins(distances, straight), logarithms[:n]
    among, found = [pairs[:n] for pairs in near], []
    avoided = np.zeros_like(own)
    for _ in range(n_hypotheses):
        beliefs = _settled(own, among, costs, avoided)
        told = _told(near, beliefs, costs)
        everywhere = _softmax(logarithms - np.float32(_LAST) * told)
        kept = (beliefs * (own - np.float32(_LAST / 2) * told[:n])).sum(axis=1)
        found.append(Hypothesis(everywhere, float(kept.mean())))
        close = distances_0[beliefs.argmax(axis=1)] < _AWAY
        avoided = (avoided + _AVOIDED * close).astype(np.float32)
    return sorted(found, key=lambda one: -one.score)


def _settled(
    logarithms: npt.NDArray[np.float32],
    among: list[npt.NDArray[np.float32]],
    costs: list[npt.NDArray[np.float32]],
    avoided: npt.NDArray[np.float32],
) -> npt.NDArray[np.float32]:
    """Return beliefs that do not change any more; what is avoided is so in the first rounds."""
    beliefs = _softmax(logarithms - avoided)
    for number, weight in enumerate(np.geomspace(_FIRST, _LAST, _ROUNDS)):
        left = np.float32(max(0.0, 1 - 2 * number / _ROUNDS))
        told = np.float32(weight) * _told(among, beliefs, costs)
        now = _softmax(logarithms - left * avoided - told)
        beliefs = np.asarray((beliefs + now) / 2, dtype=np.float32)
    return beliefs


def _costs(
    distances_0: FloatArray, straight_0: tuple[FloatArray, FloatArray]
) -> list[npt.NDArray[np.float32]]:
    """Return, for each bin of distances on a scan, what pairs of regions cost.

    First of distances along it, then of straight lines between its pieces, than which no way is
    shorter, and which are about as long as on training shapes.
    """
    along, across = [], []
    for number in range(round(_FARTHEST / _BIN)):
        apart = (number + 0.5) * _BIN
        off, width = distances_0 - apart, _CONSTANT + _SHARE * apart
        shorter = np.where(off < 0, _AROUND, 1.0)
        along.append(np.minimum(np.square(off / width / shorter), _MOST).astype(np.float32))
        over = np.square(np.minimum(off, 0.0) / width)
        unlike = np.square((straight_0[0] - apart) / (_UNSEEN + straight_0[1]))
        across.append(np.minimum(np.maximum(over, unlike), _MOST).astype(np.float32))
    return along + across


def _bins(distances: FloatArray, straight: FloatArray) -> list[npt.NDArray[np.float32]]:
    """Return which pairs of points each bin holds, as shares of all pairs of a point."""
    n_bins, numbers = round(_FARTHEST / _BIN), np.full(distances.shape, -1)
    usable = (distances < _FARTHEST) & (distances > 0)
    numbers[usable] = (distances[usable] / _BIN).astype(np.int64)
    apart = ~np.isfinite(distances) & (straight < _FARTHEST)
    numbers[apart] = n_bins + (straight[apart] / _BIN).astype(np.int64)
    counts = np.maximum((numbers >= 0).sum(axis=1, keepdims=True), 1)
    return [((numbers == b) / counts).astype(np.float32) for b in range(2 * n_bins)]


def _told(
    near: list[npt.NDArray[np.float32]],
    beliefs: npt.NDArray[np.float32],
    costs: list[npt.NDArray[np.float32]],
) -> npt.NDArray[np.float32]:
    """Return the mean cost of each region at each point, by what the others believe."""
    total = np.zeros((len(near[0]), beliefs.shape[1]), dtype=np.float32)
    for pairs, cost in zip(near, costs, strict=True):
        if not pairs.any():
            continue
        total += (pairs @ beliefs) @ cost
    return total


def _softmax(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    raised = np.exp(values - values.max(axis=1, keepdims=True))
    return np.asarray(raised / raised.sum(axis=1, keepdims=True), dtype=np.float32)
