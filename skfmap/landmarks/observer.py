"""Repeatability of landmarks that an observer has placed twice."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.exceptions import CorrespondenceError
from skfmap.landmarks.tables import check_landmarks, landmark_names, stack_landmarks
from skfmap.shapes import Landmarks

__all__ = ["ObserverError", "observer_error"]


@dataclass(frozen=True, repr=False)
class ObserverError:
    """Distance between two placings of one landmark on one specimen, in units of the meshes.

    Attributes
    ----------
    per_landmark : ndarray of shape (n_landmarks,) or None
        Mean distance between the first and the second placing; NaN for a landmark that was placed
        twice on no specimen. None if nothing is known.
    mean : float or None
        Mean over all landmarks that were placed twice.
    of_one_placing : ndarray of shape (n_landmarks,) or None
        Root mean square distance of one placing from the observer's mean placing: the distance
        between two placings, divided by the square root of two (Dahlberg). A prediction that is
        compared with a single placing cannot have a smaller error.
    names : tuple of str
        Names of the landmarks.
    n_specimens : int
        Number of specimens that were digitised twice.
    """

    per_landmark: FloatArray | None = None
    mean: float | None = None
    of_one_placing: FloatArray | None = None
    names: tuple[str, ...] = ()
    n_specimens: int = 0

    def __repr__(self) -> str:
        """Return the main figures in one line, or say that they are unknown."""
        if self.per_landmark is None or self.mean is None:
            return "ObserverError(unknown: no specimen was digitised twice)"
        at = int(np.nanargmax(self.per_landmark))
        return (
            f"ObserverError(mean={self.mean:.3g}, most {self.per_landmark[at]:.3g} at "
            f"{self.names[at]!r}, n_specimens={self.n_specimens})"
        )


def observer_error(
    first: Sequence[Landmarks], second: Sequence[Landmarks] | None = None
) -> ObserverError:
    """Return how far apart two placings of the same landmarks are.

    Parameters
    ----------
    first, second : sequence of Landmarks
        Landmarks of specimens that were digitised twice, in the coordinates of the same meshes.
        Specimens and landmarks are joined by name; specimens in only one of the two are left out.
        Without ``second``, or if no specimen is in both, the error is unknown.

    Returns
    -------
    ObserverError
        The error of each landmark, and the mean error; its fields are None if it is unknown.

    Raises
    ------
    CorrespondenceError
        If a specimen has no name, or two have the same.

    Examples
    --------
    >>> from skfmap import Landmarks
    >>> from skfmap.landmarks import observer_error
    >>> first = [Landmarks([[0.0, 0, 0], [1, 0, 0]], ["nose", "chin"], name="one")]
    >>> again = [Landmarks([[0.0, 0, 0.1], [1, 0.3, 0]], ["nose", "chin"], name="one")]
    >>> observer_error(first, again)
    ObserverError(mean=0.2, most 0.3 at 'chin', n_specimens=1)
    >>> observer_error(first)
    ObserverError(unknown: no specimen was digitised twice)
    """
    ours = _by_name(check_landmarks(first, "first"), "first")
    again = {} if second is None else _by_name(check_landmarks(second, "second"), "second")
    twice = [name for name in ours if name in again]
    if not twice:
        return ObserverError()
    a, b = [ours[name] for name in twice], [again[name] for name in twice]
    names = [name for name in landmark_names(a) if name in landmark_names(b)]
    apart = np.linalg.norm(stack_landmarks(a, names) - stack_landmarks(b, names), axis=2)
    known = ~np.isnan(apart)
    if not known.any():
        return ObserverError()
    counts = np.where(known.any(axis=0), known.sum(axis=0), np.nan)
    return ObserverError(
        np.nansum(apart, axis=0) / counts,
        float(np.nanmean(apart)),
        np.sqrt(np.nansum(np.square(apart), axis=0) / counts / 2),
        tuple(names),
        len(twice),
    )


def _by_name(landmarks: list[Landmarks], what: str) -> dict[str, Landmarks]:
    names = [one.name for one in landmarks]
    if None in names:
        raise CorrespondenceError(
            f"{what}[{names.index(None)}] has no name, but specimens are joined by name; give "
            "Landmarks(..., name=...)."
        )
    if twice := sorted({str(name) for name in names if names.count(name) > 1}):
        raise CorrespondenceError(
            f"Several specimens of {what} have the same name: {', '.join(twice)}. Rename them."
        )
    return {str(one.name): one for one in landmarks}
