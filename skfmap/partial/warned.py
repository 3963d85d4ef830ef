"""What a person should know of scans that were, or were not, matched as parts."""

from collections.abc import Sequence

from skfmap._tools.warn import warn
from skfmap.exceptions import (
    OrientationWarning,
    SkippedShapeWarning,
    StabilityWarning,
    UnfamiliarShapeWarning,
)
from skfmap.io import MeshLike, named
from skfmap.partial.answers import Part
from skfmap.partial.trust import PartTrust

__all__ = ["warn_of_few", "warn_of_parts"]


# Shapes beside the reference that are few.
_FEW = 2


def warn_of_few(n_others: int) -> None:
    """Say that hardly anything was left to learn from when a shape was left out."""
    if n_others <= _FEW:
        warn(
            f"PartialMatcher learned from {n_others} shapes beside the reference: when one is left "
            "out, the other shows alone how bodies deform, so that errors to expect, and what "
            "counts as unfamiliar, are coarse. Give five shapes and more, best ten.",
            StabilityWarning,
        )


def warn_of_parts(
    items: Sequence[MeshLike], kinds: Sequence[str], parts: dict[int, Part], trust: PartTrust
) -> None:
    """Warn of scans that were not matched, or whose matches should not be relied on.

    Parameters
    ----------
    items : sequence of meshes
        All scans that were given.
    kinds : sequence of str
        "whole", "part", an empty string, or why a scan was not matched.
    parts : dict of int to Part
        The scans that were matched as parts, by index.
    trust : PartTrust
        What decides whether a part is familiar.
    """
    names = [named(item, i) for i, item in enumerate(items)]
    called = [f"X[{i}]" if name is None else f"X[{i}] ({name!r})" for i, name in enumerate(names)]
    _warn_of_size(called, kinds)
    _warn_of_sides([called[i] for i in parts], [part.side for part in parts.values()])
    _warn_of_strange(
        [
            called[i]
            for i, part in parts.items()
            if part.is_itself and not trust.is_familiar(part.laid)
        ]
    )


def _warn_of_size(called: Sequence[str], kinds: Sequence[str]) -> None:
    """Name the scans of which nothing can be said, and why.

    Parameters
    ----------
    called, kinds : sequence of str
        What each scan is called, and "whole", "part", nothing, or why it was not matched.
    """
    told = "; ".join(
        f"{who}: {kind}"
        for who, kind in zip(called, kinds, strict=True)
        if kind not in ("whole", "part", "")
    )
    if told:
        warn(
            f"Unlike the training shapes in size, and not matched: {told}. Scans have to be in "
            "the units of the training shapes, and show 15 % of a shape at least.",
            SkippedShapeWarning,
        )


def _warn_of_strange(called: Sequence[str]) -> None:
    """Name the scans that the reference does not lie on as on parts of training shapes."""
    if called:
        warn(
            f"The reference does not lie on {', '.join(called)} as on parts of the training "
            "shapes. Another kind of body, or other units? Do not rely on these matches.",
            UnfamiliarShapeWarning,
        )


_SIDES = {
    "inside out": (
        "Faces are wound inwards on {}, and were turned for the match. If an axis was negated "
        "instead, negate it back: left and right are exchanged otherwise."
    ),
    "mirrored": (
        "As mirror images, these scans fit the training shapes better: {}. Negate one axis and "
        "turn the faces, faces[:, ::-1], if they were mirrored; do not rely on these matches."
    ),
    "negated": (
        "An axis seems to be negated in {}, with the faces left as they were: negate it back. Do "
        "not rely on these matches."
    ),
}


def _warn_of_sides(called: Sequence[str], sides: Sequence[str]) -> None:
    """Name the scans that are inside out or mirrored.

    Parameters
    ----------
    called, sides : sequence of str
        What each part is called, and its side.
    """
    for side, message in _SIDES.items():
        those = [who for who, own in zip(called, sides, strict=True) if own == side]
        if those:
            warn(message.format(", ".join(those)), OrientationWarning)
