"""Assignment of points to regions such that distances on the scan and the reference agree."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import FloatArray

__all__ = ["Hypothesis", "hypotheses"]

# Width of the bins in which distances are compared, and the largest distance, in sqrt(area).
_BIN, _FARTHEST = 0.05, 1.0
# Standard deviation of distances on a body from those on the reference: a constant, since regions
# are not points, and a fraction of the distance. Paths around missing parts are longer, never
# shorter, so larger distances on the scan are tolerated by this factor.
_CONSTANT, _SHARE, _AROUND = 0.04, 0.07, 1.6
# Added to the standard deviation of straight-line distances over training shapes, in sqrt(area),
# since there are few of them. Used between components.
_UNSEEN = 0.12
# Maximum cost of a pair of regions, in squared deviations: one of the two may be wrong.
_MOST = 6.0
# Weight of all pairs of a point together, relative to its local features, in the first and in the
# last round, and the number of rounds.
_FIRST, _LAST, _ROUNDS = 2.0, 25.0, 20

# Regions within this distance, in sqrt(area), of those of an earlier hypothesis are penalised in
# the first rounds, by this log-probability.
_AWAY, _AVOIDED = 0.25, 6.0


class Hypothesis(NamedTuple):
    """Consistent probabilities of where the points of a scan lie on the reference.

    Attributes
    ----------
    beliefs : ndarray of shape (n_points, n_regions)
        Probabilities of regions at each point.
    score : float
        How well they agree with the local features and the distances; higher is better.
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
    """Return consistent hypotheses of where the points of a scan lie on the reference.

    Mean-field iterations on a Markov random field. The unary terms come from the local features of
    each point; the pairwise terms compare the distance of two points on the scan with the distance
    of their regions on the reference. Since many bodies are nearly symmetric, each hypothesis
    starts away from the earlier ones.

    Parameters
    ----------
    logarithms : ndarray of shape (n_points, n_regions)
        Log-probabilities of regions given the local features.
    distances : ndarray of shape (n_points, n_samples)
        Distances along the scan from the first ``n_samples`` points, in sqrt(area) of the
        reference; infinite between components.
    straight : ndarray of shape (n_points, n_samples)
        Straight-line distances, which are used between components.
    distances_0 : ndarray of shape (n_regions, n_regions)
        Distances between regions along the reference.
    straight_0 : tuple of ndarray of shape (n_regions, n_regions)
        Mean and standard deviation of straight-line distances between regions, over training
        shapes.
    n_hypotheses : int
        Number of hypotheses.

    Returns
    -------
    list of Hypothesis
        Hypotheses in descending order of their scores.
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
    """Return the probabilities after all rounds; penalties apply in the first half of them."""
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
    """Return the costs of pairs of regions for each bin of distances on a scan.

    The first bins are for distances along the scan. The others are for straight lines between its
    components: no path is shorter than these, and their lengths are similar to those on training
    shapes.
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
    """Return the pairs of points in each bin, weighted so that each point has a total of 1."""
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
    """Return the mean cost of each region at each point, given the other points' probabilities."""
    total = np.zeros((len(near[0]), beliefs.shape[1]), dtype=np.float32)
    for pairs, cost in zip(near, costs, strict=True):
        if not pairs.any():
            continue
        total += (pairs @ beliefs) @ cost
    return total


def _softmax(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    raised = np.exp(values - values.max(axis=1, keepdims=True))
    return np.asarray(raised / raised.sum(axis=1, keepdims=True), dtype=np.float32)
