"""Nearest neighbours between the points of two embeddings, in both directions at once."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from skfmap._tools.types import Array, FloatArray, IntArray

__all__ = ["nearest", "nearest_both"]

# Squared distances that differ by less than this fraction of a squared length count as equal.
# Different kernels of the linear algebra differ by a hundredth of it on bodies of 5,000 vertices.
_ROUNDING = 1e-9
# Number of distances computed at a time, so that they stay in the cache (3 MB). Half and twice as
# many are equally fast.
_AT_A_TIME = 650_000
# Minimum number of blocks: the second direction searches one or two of them again for each target.
_LEAST_BLOCKS = 16
_SINGLE = float(np.finfo(np.float32).eps)


def nearest(points: FloatArray, targets: FloatArray) -> IntArray:
    """Return the nearest target of each point.

    Of several targets that are equally near up to rounding, the first is returned.

    Parameters
    ----------
    points, targets : ndarray of shape (n_points, d), ndarray of shape (n_targets, d)
        Finite coordinates.

    Returns
    -------
    ndarray of int, shape (n_points,)
        Rows of ``targets``.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional import nearest
    >>> nearest(np.array([[0.1], [0.5], [0.9]]), np.array([[0.0], [1.0]])).tolist()
    [0, 0, 1]
    """
    return _Search(points, targets).along_rows(both=False)[0]


def nearest_both(
    points: FloatArray, targets: FloatArray, *, n_threads: int = 1
) -> tuple[IntArray, IntArray]:
    """Return the nearest target of each point, and the nearest point of each target.

    One matrix product in single precision serves both directions. Candidates that it cannot tell
    apart are compared in double precision, by the rule of `nearest`.

    Parameters
    ----------
    points, targets : ndarray of shape (n_points, d), ndarray of shape (n_targets, d)
        Finite coordinates.
    n_threads : int
        Number of threads, each working on one block of points. The result does not depend on it.
        Limit BLAS to one thread (threadpoolctl) if there are several.

    Returns
    -------
    ndarray of int, shape (n_points,), ndarray of int, shape (n_targets,)
        Rows of ``targets``, and rows of ``points``.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.functional import nearest_both
    >>> there, back = nearest_both(np.array([[0.0], [0.6]]), np.array([[0.1], [0.5], [0.9]]))
    >>> there.tolist(), back.tolist()
    ([0, 1], [0, 1, 1])
    """
    search = _Search(points, targets, n_threads)
    there, least = search.along_rows(both=True)
    return there, search.along_columns(least)


class _Search:
    """Points and targets, centred and scaled so that one product gives half squared distances."""

    def __init__(self, points: FloatArray, targets: FloatArray, n_threads: int = 1) -> None:
        self.points, self.targets, self.n_threads = points, targets, n_threads
        centre = targets.mean(axis=0)
        a, b = points - centre, targets - centre
        squares_a, squares_b = (np.einsum("ij,ij->i", x, x) for x in (a, b))
        # Squared lengths are at most 1.
        self.unit = max(float(squares_a.max()), float(squares_b.max())) or 1.0
        self.squares_a, self.squares_b = squares_a / self.unit, squares_b / self.unit
        scale = 1 / np.sqrt(self.unit)
        self.a = _with_columns(-scale * a, np.ones(len(a)), self.squares_a / 2)
        self.b = _with_columns(scale * b, self.squares_b / 2, np.ones(len(b)))
        # Products with the transposed copy are a quarter faster.
        self.transposed = np.ascontiguousarray(self.b.T)
        size = max(1, min(_AT_A_TIME // len(targets), -(-len(points) // _LEAST_BLOCKS)))
        self.blocks = [slice(i, i + size) for i in range(0, len(points), size)]

    def along_rows(self, *, both: bool) -> tuple[IntArray, Array]:
        """Return the nearest target of each point, and the minimum for each target by block."""
        least = np.empty((len(self.blocks) if both else 0, len(self.targets)), dtype=np.float32)
        slack = _ROUNDING * np.einsum("ij,ij->i", self.points, self.points)

        def search(number: int) -> tuple[IntArray, IntArray]:
            block = self.blocks[number]
            halves = self.a[block] @ self.transposed
            if both:
                halves.min(axis=0, out=least[number])
            limit = self._limit(halves.min(axis=1), self.squares_a[block], slack[block])
            found = np.flatnonzero(halves <= limit[:, None])
            rows, columns = np.divmod(found, len(self.targets))
            return rows + block.start, columns

        rows, columns = self._each(search)
        return _first_nearest(self.points, self.targets, slack, rows, columns), least

    def along_columns(self, least: Array) -> IntArray:
        """Return the nearest point of each target, from the blocks that may contain it."""
        slack = _ROUNDING * np.einsum("ij,ij->i", self.targets, self.targets)
        limit = self._limit(least.min(axis=0), self.squares_b, slack)

        def search(number: int) -> tuple[IntArray, IntArray]:
            block, columns = self.blocks[number], np.flatnonzero(least[number] <= limit)
            halves = self.b[columns] @ self.a[block].T
            at, rows = np.nonzero(halves <= limit[columns, None])
            return columns[at], rows + block.start

        columns, rows = self._each(search)
        order = np.argsort(columns, kind="stable")  # keeps points in ascending order
        return _first_nearest(self.targets, self.points, slack, columns[order], rows[order])

    def _each(
        self, search: Callable[[int], tuple[IntArray, IntArray]]
    ) -> tuple[IntArray, IntArray]:
        """Return the concatenated pairs from all blocks."""
        numbers = range(len(self.blocks))
        if self.n_threads == 1:
            pairs = [search(number) for number in numbers]
        else:
            with ThreadPoolExecutor(self.n_threads) as threads:
                pairs = list(threads.map(search, numbers))
        first, second = (np.concatenate(part) for part in zip(*pairs, strict=True))
        return first, second

    def _limit(self, best: FloatArray, squares: FloatArray, slack: FloatArray) -> FloatArray:
        """Return the largest half squared distance that may be the minimum up to rounding.

        A candidate as near as the best has at most the length of the point plus its distance; the
        rounding error of a product of such lengths is at most d roundings of their square.
        """
        length = np.sqrt(squares) + np.sqrt(2 * np.maximum(best, 0.0))
        rounding = self.a.shape[1] * _SINGLE * np.square(length)
        return (best + 2 * rounding + slack / self.unit).astype(np.float32)


def _with_columns(points: FloatArray, *columns: FloatArray) -> FloatArray:
    return np.column_stack([points, *columns]).astype(np.float32)


def _first_nearest(
    points: FloatArray, targets: FloatArray, slack: FloatArray, rows: IntArray, columns: IntArray
) -> IntArray:
    """Return the first column of each row whose squared distance is minimal up to slack.

    Rows are ascending and none is missing; columns within a row are ascending.
    """
    starts = np.searchsorted(rows, np.arange(len(points) + 1))
    out, several = columns[starts[:-1]], np.flatnonzero(np.diff(starts) > 1)
    if len(several) == 0:
        return out
    counts = np.diff(starts)[several]
    begins = np.cumsum(counts) - counts
    which = np.repeat(starts[several] - begins, counts) + np.arange(counts.sum())
    differences = points[rows[which]] - targets[columns[which]]
    squared = np.einsum("ij,ij->i", differences, differences)
    limits = np.minimum.reduceat(squared, begins) + slack[several]
    near = np.flatnonzero(squared <= np.repeat(limits, counts))
    first = near[np.searchsorted(near, begins)]
    out[several] = columns[which[first]]
    return out
