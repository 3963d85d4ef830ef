"""Numbers that stand for "none", and were taken for a point."""

import numpy as np

from skfmap._tools.types import IntArray

__all__ = ["crowded_points"]

# Such a number is shared by far more points than any other is: by this share of all, by this many
# times the median, and by no fewer than so many. Meshes and templates whose numbers of points
# differ by a factor of ten stay below the second.
_LARGE, _TIMES, _FEWEST = 0.02, 10, 5


def crowded_points(vertices: IntArray, points: IntArray) -> str:
    """Say which template point, or which vertex, has a share of the pairs that no sound one has.

    It is a number that stands for "none", mostly 0, or the rim of a part whose nearest points were
    looked up on a whole. Empty if there is none.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.shapes.crowded import crowded_points
    >>> points = np.arange(200)
    >>> points[100:120] = 0
    >>> crowded_points(np.arange(200), points)
    'template point 0 stands for 21 of 200 vertices, others for 1 each'
    """
    for ends, what, other in (
        (points, "template point", "vertices"),
        (vertices, "vertex", "template points"),
    ):
        if len(ends) == 0:
            continue
        number, count = np.unique(ends, return_counts=True)
        most = int(count.argmax())
        usual = float(np.median(count))
        if count[most] > max(_LARGE * len(ends), _TIMES * usual, _FEWEST):
            return (
                f"{what} {number[most]} stands for {count[most]} of {len(ends)} {other}, others "
                f"for {usual:g} each"
            )
    return ""
