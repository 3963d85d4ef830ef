"""Warnings about scans that were matched as parts, or could not be matched."""

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


# With at most this many shapes besides the reference, there is a warning.
_FEW = 2


def warn_of_few(n_others: int) -> None:
    """Warn if hardly any shapes remain to learn from when one is left out."""
    if n_others <= _FEW:
        warn(
            f"PartialMatcher learned from {n_others} shapes besides the reference. When one is "
            "left out, only the other one shows how bodies deform, so expected errors and the "
            "limits of what is familiar are coarse. Give at least five shapes, or better ten.",
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
    _warn_of_reversed([called[i] for i, part in parts.items() if part.is_reversed])
    _warn_of_strange([called[i] for i, part in parts.items() if not trust.is_familiar(part.laid)])


def _warn_of_size(called: Sequence[str], kinds: Sequence[str]) -> None:
    """Warn of scans that were not matched because of their size.

    Parameters
    ----------
    called, kinds : sequence of str
        Name of each scan, and "whole", "part", an empty string, or why it was not matched.
    """
    told = "; ".join(
        f"{who}: {kind}"
        for who, kind in zip(called, kinds, strict=True)
        if kind not in ("whole", "part", "")
    )
    if told:
        warn(
            f"Not matched, since their sizes differ from those of the training shapes: {told}. "
            "Scans must be in the units of the training shapes, and show at least 15 % of a shape.",
            SkippedShapeWarning,
        )


def _warn_of_strange(called: Sequence[str]) -> None:
    """Warn of scans that the reference fits worse than it fits parts of training shapes."""
    if called:
        warn(
            f"The reference fits {', '.join(called)} worse than it fits parts of the training "
            "shapes. Another kind of body, or other units? Do not rely on these matches.",
            UnfamiliarShapeWarning,
        )


def _warn_of_reversed(called: Sequence[str]) -> None:
    """Warn of scans whose faces were reversed."""
    if called:
        warn(
            f"Faces are wound inwards on {', '.join(called)}, and were reversed for the match. If "
            "an axis was negated instead, negate it back; otherwise left and right are exchanged.",
            OrientationWarning,
        )
