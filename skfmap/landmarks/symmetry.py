"""Object symmetry: landmarks that mirror each other, and the symmetric part of a specimen."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import FloatArray, IntArray
from skfmap.exceptions import CorrespondenceError
from skfmap.landmarks.tables import as_stack

__all__ = ["Pairing", "asymmetric_component", "propose_pairing", "symmetric_component"]

# Left and right at the beginning or the end of a name, and patterns that can only mean a side.
_SIDES = (("left", "right"), ("l", "r"))
_SAYS_A_SIDE = re.compile(
    r"(?:^|[^a-z])(?:left|right|[lr])(?:[^a-z]|$)|^(?:left|right)|(?:left|right)$", re.IGNORECASE
)


class Pairing:
    """Pairs of landmarks that mirror each other, and landmarks on the midline.

    Parameters
    ----------
    names : sequence of str
        Names of the landmarks, in the order of the columns of `stack_landmarks`.
    pairs : sequence of (str, str)
        Names of left and right landmarks that mirror each other.
    midline : sequence of str, default=()
        Names of the landmarks on the midline, which are their own mirror images. Every landmark
        must be in a pair or on the midline.

    Attributes
    ----------
    partner : ndarray of int, shape (n_landmarks,)
        Column of the mirror image of each landmark.

    Raises
    ------
    CorrespondenceError
        If a landmark is missing or appears twice, or is not one of ``names``.

    Examples
    --------
    >>> from skfmap.landmarks import Pairing
    >>> Pairing(["nose", "ear_L", "ear_R"], [("ear_L", "ear_R")], ["nose"])
    Pairing(ear_L - ear_R; midline: nose)
    """

    def __init__(
        self,
        names: Sequence[str],
        pairs: Sequence[tuple[str, str]],
        midline: Sequence[str] = (),
    ) -> None:
        self.names = tuple(str(name) for name in names)
        self.pairs = tuple((str(left), str(right)) for left, right in pairs)
        self.midline = (midline,) if isinstance(midline, str) else tuple(map(str, midline))
        self._check()
        self.partner: IntArray = np.arange(len(self.names))
        for left, right in self.pairs:
            i, j = self.names.index(left), self.names.index(right)
            self.partner[i], self.partner[j] = j, i

    def __repr__(self) -> str:
        """Return all pairs and the midline in one line."""
        pairs = ", ".join(f"{left} - {right}" for left, right in self.pairs)
        return f"Pairing({pairs}; midline: {', '.join(self.midline) or 'none'})"

    def _check(self) -> None:
        told = [name for pair in self.pairs for name in pair] + list(self.midline)
        if twice := sorted({name for name in told if told.count(name) > 1}):
            raise CorrespondenceError(
                f"{', '.join(twice)} is in two pairs, or in a pair and on the midline. Name each "
                "landmark once."
            )
        if unknown := [name for name in told if name not in self.names]:
            raise CorrespondenceError(
                f"There is no landmark {', '.join(unknown)}; there are {', '.join(self.names)}."
            )
        if left_out := [name for name in self.names if name not in told]:
            raise CorrespondenceError(
                f"{', '.join(left_out)} is neither in a pair nor on the midline. Add it to one of "
                "these, or leave it out: stack_landmarks(landmarks, names)."
            )


def propose_pairing(names: Sequence[str]) -> Pairing:
    """Propose a pairing based on the names of landmarks; check it before you use it.

    Two landmarks are a pair if their names differ by left and right, or L and R, at the beginning
    or at the end: ``ear_L`` and ``ear_R``, ``left1`` and ``right1``. All others are assumed to lie
    on the midline.

    Parameters
    ----------
    names : sequence of str
        Names of the landmarks, in the order of the columns of `stack_landmarks`.

    Returns
    -------
    Pairing
        The proposed pairing; its ``repr`` shows all pairs and the midline.

    Raises
    ------
    CorrespondenceError
        If no name has a partner, or if a name that contains a side has no partner, or two.

    Examples
    --------
    >>> from skfmap.landmarks import propose_pairing
    >>> propose_pairing(["nose", "ear_L", "ear_R", "Left eye", "Right eye"])
    Pairing(ear_L - ear_R, Left eye - Right eye; midline: nose)
    """
    every = [str(name) for name in names]
    pairs = [(left, right) for left in every for right in _rights_of(left) if right in every]
    paired = [name for pair in pairs for name in pair]
    if ambiguous := sorted({name for name in paired if paired.count(name) > 1}):
        raise CorrespondenceError(
            f"{', '.join(ambiguous)}: more than one landmark could be the mirror image. Give the "
            "pairs explicitly: Pairing(names, pairs, midline)."
        )
    if not pairs:
        raise CorrespondenceError(
            f"No two names differ only by their side: {', '.join(every)}. Give the pairs "
            "explicitly: Pairing(names, pairs, midline)."
        )
    alone = [name for name in every if name not in paired]
    if one_sided := [name for name in alone if _SAYS_A_SIDE.search(name)]:
        raise CorrespondenceError(
            f"{', '.join(one_sided)}: the name contains a side, but there is no landmark on the "
            "other side. Leave it out, or give the pairs explicitly: Pairing(names, pairs, "
            "midline)."
        )
    return Pairing(every, pairs, alone)


def symmetric_component(array: npt.ArrayLike, pairing: Pairing) -> FloatArray:
    r"""Return the symmetric component of each specimen (object symmetry, Klingenberg et al. 2002).

    Each specimen is reflected, its paired landmarks are relabelled, the mirror image is fitted to
    the specimen by least squares, and the two are averaged.

    Parameters
    ----------
    array : array-like of shape (n_specimens, n_landmarks, 3)
        Landmarks, from `stack_landmarks`.
    pairing : Pairing
        Which mirror each other.

    Returns
    -------
    ndarray of shape (n_specimens, n_landmarks, 3)
        Landmarks in the position, units and size of each specimen, symmetric about a plane. NaN
        where a landmark or its partner is missing.

    See Also
    --------
    align_landmarks : Align specimens first to compare their components.

    Notes
    -----
    With the centroid at the origin, let the rows of :math:`X` be the landmarks, and let :math:`P`
    be the relabelling. Among all planes, the mirror image is closest to the specimen for the plane
    whose normal is the eigenvector of the smallest eigenvalue of :math:`X^T P X`. Because :math:`P`
    is its own inverse, the average is exactly symmetric about this plane; the asymmetric component
    is the remainder.

    References
    ----------
    .. [1] C. P. Klingenberg, M. Barluenga, A. Meyer. "Shape analysis of symmetric structures:
       quantifying variation among individuals and asymmetry". Evolution, 2002.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.landmarks import Pairing, symmetric_component
    >>> face = np.array([[[0.0, 0, 2], [-1, 0, 0], [1.2, 0, 0], [0, 3, 1]]])
    >>> names = ["nose", "ear_L", "ear_R", "chin"]
    >>> pairing = Pairing(names, [("ear_L", "ear_R")], ["nose", "chin"])
    >>> nose, *ears, chin = symmetric_component(face, pairing)[0]
    >>> np.linalg.norm(ears - nose, axis=1).round(3).tolist()
    [2.284, 2.284]
    """
    points = as_stack(array)
    if not isinstance(pairing, Pairing):
        raise TypeError(f"pairing must be a Pairing; got {type(pairing).__name__}.")
    if points.shape[1] != len(pairing.names):
        raise ValueError(
            f"array has {points.shape[1]} landmarks, but the pairing has {len(pairing.names)}: "
            f"{', '.join(pairing.names)}."
        )
    return np.array([_symmetrised(one, pairing.partner) for one in points])


def asymmetric_component(array: npt.ArrayLike, pairing: Pairing) -> FloatArray:
    """Return how far each landmark is from the symmetric component of its specimen.

    Parameters
    ----------
    array : array-like of shape (n_specimens, n_landmarks, 3)
        Landmarks, from `stack_landmarks`.
    pairing : Pairing
        Which mirror each other.

    Returns
    -------
    ndarray of shape (n_specimens, n_landmarks, 3)
        Displacements that, added to `symmetric_component`, give the specimen. Mirrored
        displacements of a pair are opposite. Their mean over aligned specimens is directional
        asymmetry; the remainder of each is fluctuating asymmetry and measurement error.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.landmarks import Pairing, asymmetric_component
    >>> face = np.array([[[0.0, 0, 2], [-1, 0, 0], [1, 0, 0], [0, 3, 1]]])
    >>> names = ["nose", "ear_L", "ear_R", "chin"]
    >>> pairing = Pairing(names, [("ear_L", "ear_R")], ["nose", "chin"])
    >>> bool(np.abs(asymmetric_component(face, pairing)).max() < 1e-12)
    True
    """
    return as_stack(array) - symmetric_component(array, pairing)


def _symmetrised(points: FloatArray, partner: IntArray) -> FloatArray:
    both = ~np.isnan(points[:, 0]) & ~np.isnan(points[partner, 0])
    if not both.any():
        return np.full_like(points, np.nan)
    centre = points[both].mean(axis=0)
    centred = points - centre
    exchanged = centred[partner]
    _, directions = np.linalg.eigh(centred[both].T @ exchanged[both])
    normal = directions[:, 0]
    image = exchanged - 2 * np.outer(exchanged @ normal, normal)
    return np.asarray(centre + (centred + image) / 2)


def _rights_of(name: str) -> list[str]:
    """Return possible names of the mirror image of a landmark whose name contains "left"."""
    found = []
    for left, right in _SIDES:
        if name.lower().startswith(left):
            found.append(_like(right, name[: len(left)]) + name[len(left) :])
        if name.lower().endswith(left):
            found.append(name[: -len(left)] + _like(right, name[-len(left) :]))
    return found


def _like(text: str, pattern: str) -> Any:
    """Return the text with the capitalisation of the pattern."""
    if pattern.isupper():
        return text.upper()
    return text.capitalize() if pattern[0].isupper() else text
