"""Detection of placeholder indices ("none") that were mistaken for real points."""

import numpy as np

from skfmap._tools.types import IntArray

__all__ = ["crowded_points"]

# A placeholder occurs far more often than any other index: in more than this share of all pairs,
# more than this many times the median, and more than this many times in all. The second bound
# tolerates a mesh and a template whose numbers of points differ by a factor of ten.
_LARGE, _TIMES, _FEWEST = 0.02, 10, 5


def crowded_points(vertices: IntArray, points: IntArray) -> str:
    """Describe the template point or vertex that occurs in implausibly many pairs.

    It is usually a placeholder for "none", mostly 0. It can also be a rim vertex of a partial shape
    that was paired with its nearest points on a whole one. The text is empty if there is none.

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
