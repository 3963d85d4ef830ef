"""Recognition of regions of the reference from local features."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPClassifier

from skfmap._tools.types import FloatArray, IntArray
from skfmap.geometry.local_features import local_features

__all__ = ["Recogniser", "features_of"]

# Scales of the local features, and the largest distance to the rim that they record, in sqrt(area)
# of the reference.
_SCALES, _REACH = (0.03, 0.05, 0.08, 0.13, 0.2, 0.3), 0.3
# Hidden layers, batch size, weight decay and passes of the network. More passes over fewer parts
# make it overconfident where it is wrong: on 48 parts of bodies, the mean error of points is 0.096
# with 8 passes over 12 parts per shape, 0.100 with 20 passes, and 0.135 with 20 passes over 6
# parts. A network of twice the width, two networks, or two layers are no better.
_HIDDEN, _BATCH, _DECAY, _PASSES = (192,), 256, 1e-3, 8
# Standardised features are clipped at this many standard deviations.
_MOST_DEVIATIONS = 5.0
# Minimum probability of a region: no point is known for certain.
_LEAST = 1e-5


def features_of(vertices: FloatArray, faces: IntArray) -> npt.NDArray[np.float32]:
    """Return the local features of a mesh in units of sqrt(area) of the reference."""
    return local_features(vertices - vertices.mean(axis=0), faces, _SCALES, _REACH).astype(
        np.float32
    )


@dataclass(frozen=True, eq=False, repr=False)
class Recogniser:
    """Model that predicts the region of the reference for a point of a part, from its features.

    Attributes
    ----------
    centre, scale : ndarray of shape (n_features,)
        Mean and standard deviation of the features of training parts.
    layers : list of (ndarray, ndarray)
        Weights and biases of a network with rectified linear units.
    """

    centre: npt.NDArray[np.float32]
    scale: npt.NDArray[np.float32]
    layers: list[tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]]

    @classmethod
    def learned(
        cls, features: Sequence[npt.NDArray[np.float32]], labels: Sequence[IntArray], n_regions: int
    ) -> Self:
        """Learn from points of training parts.

        Parameters
        ----------
        features : sequence of ndarray of shape (n_points, n_features)
            Features of the points of each part.
        labels : sequence of ndarray of int, shape (n_points,)
            Region of the reference that each point belongs to.
        n_regions : int
            Number of regions.
        """
        X, y = np.concatenate(features), np.concatenate(labels)
        centre, scale = X.mean(axis=0), X.std(axis=0) + np.float32(1e-6)
        network = MLPClassifier(
            _HIDDEN,
            alpha=_DECAY,
            batch_size=min(_BATCH, max(len(y) // 16, 1)),
            max_iter=_PASSES,
            random_state=0,
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            network.fit(_standardised(X, centre, scale), y)
        layers = [
            (w.astype(np.float32), b.astype(np.float32))
            for w, b in zip(network.coefs_, network.intercepts_, strict=True)
        ]
        # The network has no outputs for regions without training points.
        weights, bias = layers[-1]
        at = network.classes_
        all_weights = np.zeros((len(weights), n_regions), dtype=np.float32)
        all_bias = np.full(n_regions, np.log(_LEAST), dtype=np.float32)
        all_weights[:, at], all_bias[at] = weights, bias
        return cls(centre, scale, [*layers[:-1], (all_weights, all_bias)])

    def logarithms(self, features: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Return the log-probabilities of regions, shape (n_points, n_regions)."""
        values = _standardised(features, self.centre, self.scale)
        for weights, bias in self.layers[:-1]:
            values = np.maximum(values @ weights + bias, 0)
        weights, bias = self.layers[-1]
        values = values @ weights + bias
        values -= values.max(axis=1, keepdims=True)
        values = np.exp(values)
        values /= values.sum(axis=1, keepdims=True)
        return np.log(values + np.float32(_LEAST))


def _standardised(
    X: npt.NDArray[np.float32], centre: npt.NDArray[np.float32], scale: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    return np.clip((X - centre) / scale, -_MOST_DEVIATIONS, _MOST_DEVIATIONS)
