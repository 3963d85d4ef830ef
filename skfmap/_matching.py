"""Points matched as nearest neighbours among functions."""

import numpy as np
from sklearn.metrics import pairwise_distances_argmin_min

from skfmap._typing import FloatArray, IntArray
from skfmap.functional.embedding import spectral_embeddings

__all__ = ["nearest_points"]


def nearest_points(
    evecs_i: FloatArray, evecs_0: FloatArray, C: FloatArray, functions: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return the nearest vertex of the reference for each point of the shape, and its distance, in the embedding."""
    k = len(C)
    points_i, points_0 = spectral_embeddings(evecs_i[:, :k], evecs_0[:, :k], C, functions)
    p2p, residuals = pairwise_distances_argmin_min(points_i, points_0)
    return np.asarray(p2p, dtype=np.int64), np.asarray(residuals)
