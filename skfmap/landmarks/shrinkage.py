"""Shrinkage of predicted landmarks towards the mean, which a mean error does not show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.exceptions import CorrespondenceError
from skfmap.landmarks.alignment import align_landmarks
from skfmap.landmarks.tables import (
    centroid_sizes,
    check_landmarks,
    landmark_names,
    stack_landmarks,
)
from skfmap.shapes import Landmarks

__all__ = ["Shrinkage", "shrinkage"]

# Minimum number of specimens to estimate a variance from.
_FEWEST = 3


@dataclass(frozen=True, repr=False)
class Shrinkage:
    """How much of the variation between specimens predicted landmarks retain.

    Attributes
    ----------
    variance_ratio : float
        Variance of the predicted landmarks divided by that of the true ones, summed over landmarks:
        1 if both vary equally, less if predictions shrink towards the mean, more if their errors
        add more variance than they lose. The observer's error is part of the true landmarks and
        lowers the ratio; see `observer_error`.
    per_landmark : ndarray of shape (n_landmarks,)
        The same for each landmark; NaN if fewer than three specimens have it, or it does not vary.
    size_slope : float
        Slope of the predicted centroid size on the true one, by least squares: 1 if large specimens
        are predicted to be as large as they are. Random errors of predictions do not change it.
        NaN if fewer than three specimens have all landmarks, or all have the same size.
    names : tuple of str
        Names of the landmarks.
    n_specimens : int
        Number of specimens that were compared.
    """

    variance_ratio: float
    per_landmark: FloatArray
    size_slope: float
    names: tuple[str, ...]
    n_specimens: int

    def __repr__(self) -> str:
        """Return both figures and the landmark that shrinks most, in one line."""
        told = self.per_landmark[~np.isnan(self.per_landmark)]
        least = ""
        if len(told):
            at = int(np.nanargmin(self.per_landmark))
            least = f", least {self.per_landmark[at]:.2f} at {self.names[at]!r}"
        slope = "unknown" if np.isnan(self.size_slope) else f"{self.size_slope:.2f}"
        return (
            f"Shrinkage(variance_ratio={self.variance_ratio:.2f}{least}, size_slope={slope}, "
            f"n_specimens={self.n_specimens})"
        )


def shrinkage(predicted: Sequence[Landmarks], true: Sequence[Landmarks]) -> Shrinkage:
    """Compare how much predicted and true landmarks vary from specimen to specimen.

    Each set is first rotated and translated onto its own mean, without scaling, as in shape
    analysis, so specimens may have any position. Then the variances about the means are compared.

    Parameters
    ----------
    predicted : sequence of Landmarks
        Predicted landmarks of each specimen, from `skfmap.predict_landmarks`; the specimens must
        not have been used for training.
    true : sequence of Landmarks
        True landmarks of the same specimens, in the same order. A landmark that is missing in one
        of the two is ignored in both.

    Returns
    -------
    Shrinkage
        Ratios of variances and the slope of sizes.

    Raises
    ------
    CorrespondenceError
        If the specimens are not the same, or no landmarks have the same name.
    ValueError
        If there are fewer than three specimens.

    Examples
    --------
    Predictions that are half as far from the mean as they should be keep a quarter of the variance:

    >>> import numpy as np
    >>> from skfmap import Landmarks
    >>> from skfmap.landmarks import shrinkage
    >>> base = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
    >>> true = [Landmarks(base * size) for size in (0.8, 1.0, 1.2)]
    >>> predicted = [Landmarks(base * size) for size in (0.9, 1.0, 1.1)]
    >>> found = shrinkage(predicted, true)
    >>> round(found.variance_ratio, 6), round(found.size_slope, 6)
    (0.25, 0.5)
    """
    ours, theirs = check_landmarks(predicted, "predicted"), check_landmarks(true, "true")
    _check_same_specimens(ours, theirs)
    shared = [name for name in landmark_names(theirs) if name in landmark_names(ours)]
    if not shared:
        raise CorrespondenceError(
            "Predicted and true landmarks have no name in common: "
            f"{', '.join(landmark_names(ours))} against {', '.join(landmark_names(theirs))}."
        )
    a, b = stack_landmarks(ours, shared), stack_landmarks(theirs, shared)
    known = ~np.isnan(a + b)
    a, b = np.where(known, a, np.nan), np.where(known, b, np.nan)
    of_predicted, of_true = (_variances(align_landmarks(one)) for one in (a, b))
    told = ~np.isnan(of_predicted + of_true)
    return Shrinkage(
        _ratio(of_predicted[told].sum(), of_true[told].sum()),
        np.array([_ratio(p, t) for p, t in zip(of_predicted, of_true, strict=True)]),
        _slope(centroid_sizes(b), centroid_sizes(a)),
        tuple(shared),
        len(a),
    )


def _check_same_specimens(predicted: list[Landmarks], true: list[Landmarks]) -> None:
    if len(predicted) != len(true):
        raise CorrespondenceError(
            f"There are {len(predicted)} predicted specimens but {len(true)} true ones; give the "
            "same specimens in the same order."
        )
    for i, (a, b) in enumerate(zip(predicted, true, strict=True)):
        if a.name is not None and b.name is not None and a.name != b.name:
            raise CorrespondenceError(
                f"predicted[{i}] is {a.name!r} but true[{i}] is {b.name!r}; give the same "
                "specimens in the same order."
            )
    if len(true) < _FEWEST:
        raise ValueError(
            f"It takes at least {_FEWEST} specimens to estimate variances; got {len(true)}. "
            "Predict more of them, each left out of the training in turn."
        )


def _variances(aligned: FloatArray) -> FloatArray:
    """Return the variance of each landmark about its mean; NaN if too few specimens have it."""
    counts = (~np.isnan(aligned[:, :, 0])).sum(axis=0)
    mean = np.nansum(aligned, axis=0) / np.maximum(counts, 1)[:, None]
    squares = np.nansum(np.square(aligned - mean), axis=(0, 2))
    return np.where(counts >= _FEWEST, squares / np.maximum(counts - 1, 1), np.nan)


def _ratio(over: float, under: float) -> float:
    return float(over / under) if under > 0 else float("nan")


def _slope(x: FloatArray, y: FloatArray) -> float:
    known = ~np.isnan(x + y)
    x, y = x[known], y[known]
    if len(x) < _FEWEST:
        return float("nan")
    return _ratio(float((x - x.mean()) @ (y - y.mean())), float(np.square(x - x.mean()).sum()))
