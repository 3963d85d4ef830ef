"""Distances between named landmarks."""

from collections.abc import Sequence

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.landmarks.tables import check_landmarks, stack_landmarks
from skfmap.shapes import Landmarks

__all__ = ["distances"]


def distances(landmarks: Sequence[Landmarks], pairs: Sequence[tuple[str, str]]) -> FloatArray:
    """Return straight-line distances between pairs of landmarks, in the units of the meshes.

    Parameters
    ----------
    landmarks : sequence of Landmarks
        Landmarks of each specimen.
    pairs : sequence of (str, str)
        Names of the two landmarks of each pair.

    Returns
    -------
    ndarray of shape (n_specimens, n_pairs)
        Distances; NaN where a specimen lacks one of the two landmarks.

    Raises
    ------
    CorrespondenceError
        If no specimen has a landmark with one of the names.

    Examples
    --------
    >>> from skfmap import Landmarks
    >>> from skfmap.landmarks import distances
    >>> marks = Landmarks([[0, 0, 0], [3, 4, 0]], ["nose", "chin"])
    >>> distances([marks], [("nose", "chin")]).tolist()
    [[5.0]]
    """
    kept, ends = check_landmarks(landmarks), [tuple(pair) for pair in pairs]
    if any(len(pair) != 2 for pair in ends):
        raise ValueError("Each pair must consist of two names, as in [('nose', 'chin')].")
    start, end = (stack_landmarks(kept, [pair[j] for pair in ends]) for j in range(2))
    return np.asarray(np.linalg.norm(end - start, axis=2))
