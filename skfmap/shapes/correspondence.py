"""Where a shape lies on the template that the shapes of a collection share."""

from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import scipy.sparse as sp

from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import (
    as_array,
    as_reals,
    check_index_range,
    check_number,
    check_pairs,
    read_only,
)
from skfmap.exceptions import CorrespondenceError

__all__ = ["Correspondence", "JoinedPairs"]


@dataclass(frozen=True, eq=False)
class JoinedPairs:
    """Pairs of vertices of two shapes that stand on the same template point.

    Attributes
    ----------
    vertices_i, vertices_0 : ndarray of int, shape (n_pairs,)
        Vertex of S_i and the vertex of S_0 that it is mapped to: the point map runs from S_i to
        S_0.
    points : ndarray of int, shape (n_pairs,)
        The template point that joins them.
    weights : ndarray of shape (n_pairs,)
        Positive. The weight of the pair on S_i (1 for plain pairs), shared among the vertices of
        S_0 that stand on the template point.
    """

    vertices_i: IntArray
    vertices_0: IntArray
    points: IntArray
    weights: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Correspondence:
    """Where one shape lies on the template.

    The template is the set of points that the shapes of a collection share.

    Parameters
    ----------
    pairs : array-like of int, shape (n_pairs, 2)
        Rows ``[vertex of the shape, template point]``, 0-based. Sparse, partial and many-to-one are
        ordinary.
    symmetric_pairs : array-like of int, shape (n_symmetric_pairs, 2), optional
        The same for the symmetric answer: the vertex that the shape's left-right symmetry takes
        each point's vertex to. Used by the symmetric metrics only, never for learning.
    weights : array-like of shape (n_pairs,), optional
        Non-negative weights of soft or barycentric pairs; None means 1 each.
    symmetric_weights : array-like of shape (n_symmetric_pairs,), optional
        The same for ``symmetric_pairs``.
    n_vertices : int, optional
        How many vertices the shape has, where the constructor could tell; checked against the mesh.

    Raises
    ------
    TypeError
        If ``pairs`` is one-dimensional (say which reading you mean with a constructor) or not of an
        integer dtype.
    CorrespondenceError
        If the shape of ``pairs`` is wrong, an index is negative, or weights do not fit.

    See Also
    --------
    Correspondence.from_vertices : From the template point of each vertex.
    Correspondence.from_template : From the vertex of each template point (``.vts`` files).
    Correspondence.from_matrix : From a sparse, soft or barycentric matrix.

    Examples
    --------
    >>> from skfmap import Correspondence
    >>> a = Correspondence.from_vertices([2, 0, -1, 1])  # vertex 2 is unknown
    >>> b = Correspondence.from_template([5, 4, 3])
    >>> joined = a.join(b)
    >>> joined.vertices_i.tolist(), joined.vertices_0.tolist()
    ([0, 1, 3], [3, 5, 4])
    """

    pairs: IntArray
    symmetric_pairs: IntArray | None = None
    weights: FloatArray | None = field(default=None, kw_only=True)
    symmetric_weights: FloatArray | None = field(default=None, kw_only=True)
    n_vertices: int | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "pairs", read_only(check_pairs(self.pairs, "pairs")))
        object.__setattr__(
            self, "weights", _check_weights(self.weights, len(self.pairs), "weights")
        )
        if self.n_vertices is not None:
            check_number(self.n_vertices, "n_vertices", low=0, integer=True)
        if self.symmetric_pairs is None:
            if self.symmetric_weights is not None:
                raise CorrespondenceError("symmetric_weights are given without symmetric_pairs.")
            return
        object.__setattr__(
            self, "symmetric_pairs", read_only(check_pairs(self.symmetric_pairs, "symmetric_pairs"))
        )
        n_symmetric = len(self.symmetric_pairs)
        checked = _check_weights(self.symmetric_weights, n_symmetric, "symmetric_weights")
        object.__setattr__(self, "symmetric_weights", checked)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle so that copies are checked and immutable too."""
        parts = (
            self.pairs,
            self.symmetric_pairs,
            self.weights,
            self.symmetric_weights,
            self.n_vertices,
        )
        return _correspondence, parts

    def __deepcopy__(self, memo: object) -> Self:
        """Return the correspondence itself: it cannot change."""
        return self

    def __repr__(self) -> str:
        """Return a line with counts."""
        symmetric = "none" if self.symmetric_pairs is None else len(self.symmetric_pairs)
        soft = "" if self.weights is None else ", soft"
        return f"Correspondence(n_pairs={len(self.pairs)}, n_symmetric_pairs={symmetric}{soft})"

    @classmethod
    def from_vertices(cls, points: object, symmetric: object | None = None) -> Self:
        """Make a correspondence from the template point of each vertex; -1 where it is unknown.

        Parameters
        ----------
        points : array-like of int, shape (n_vertices,)
            Template point of each vertex of the shape, or -1.
        symmetric : array-like of int, shape (n_vertices,), optional
            Template point whose symmetric counterpart each vertex is, or -1.

        Returns
        -------
        Correspondence
            One pair per known vertex.
        """
        pairs, n_vertices = _enumerate(points, "points")
        if symmetric is None:
            return cls(pairs, n_vertices=n_vertices)
        symmetric_pairs, n_symmetric = _enumerate(symmetric, "symmetric")
        _check_alike(n_vertices, n_symmetric)
        return cls(pairs, symmetric_pairs, n_vertices=n_vertices)

    @classmethod
    def from_template(cls, vertices: object, symmetric: object | None = None) -> Self:
        """Make a correspondence from the vertex of each template point; -1 where it is unknown.

        This is what ``.vts`` files hold, once 1 is subtracted.

        Parameters
        ----------
        vertices : array-like of int, shape (n_points,)
            Vertex of the shape that each template point stands on, or -1.
        symmetric : array-like of int, shape (n_points,), optional
            Vertex that the shape's symmetry takes it to, or -1 (what ``.sym.vts`` files hold).

        Returns
        -------
        Correspondence
            One pair per known template point.
        """
        swap = [1, 0]
        pairs, n_points = _enumerate(vertices, "vertices")
        if symmetric is None:
            return cls(pairs[:, swap])
        symmetric_pairs, n_symmetric = _enumerate(symmetric, "symmetric")
        _check_alike(n_points, n_symmetric)
        return cls(pairs[:, swap], symmetric_pairs[:, swap])

    @classmethod
    def from_matrix(cls, matrix: object, symmetric: object | None = None) -> Self:
        """Make a correspondence from a soft or barycentric matrix.

        Parameters
        ----------
        matrix : array-like or sparse, shape (n_vertices, n_points)
            Row ``v`` holds how much vertex ``v`` stands on each template point. Non-negative; rows
            need not sum to 1.
        symmetric : array-like or sparse, shape (n_vertices, n_points), optional
            The same for the symmetric answer.

        Returns
        -------
        Correspondence
            One weighted pair per non-zero entry.
        """
        pairs, weights, shape = _matrix_pairs(matrix, "matrix")
        n_vertices = shape[0]
        if symmetric is None:
            return cls(pairs, weights=weights, n_vertices=n_vertices)
        symmetric_pairs, symmetric_weights, symmetric_shape = _matrix_pairs(symmetric, "symmetric")
        _check_alike(shape, symmetric_shape)
        return cls(
            pairs,
            symmetric_pairs,
            weights=weights,
            symmetric_weights=symmetric_weights,
            n_vertices=n_vertices,
        )

    @property
    def has_symmetric(self) -> bool:
        """Whether a symmetric answer is known."""
        return self.symmetric_pairs is not None

    def join(self, other: "Correspondence", *, symmetric: bool = False) -> JoinedPairs:
        """Join this shape (S_i) with another (S_0) on the template points that both have.

        Parameters
        ----------
        other : Correspondence
            Of S_0. Template points that are missing on either side drop out.
        symmetric : bool
            Whether to lead to the symmetric counterparts on S_0.

        Returns
        -------
        JoinedPairs
            In the order of this shape's pairs; empty if the two share no template point.

        Raises
        ------
        CorrespondenceError
            If ``symmetric`` and ``other`` has no symmetric answer.
        """
        pairs_0, weights_0 = other.pairs, other.weights
        if symmetric:
            if other.symmetric_pairs is None:
                raise CorrespondenceError(
                    "The reference has no symmetric answer; give its Correspondence "
                    "symmetric_pairs, or score directly."
                )
            pairs_0, weights_0 = other.symmetric_pairs, other.symmetric_weights
        order = np.argsort(pairs_0[:, 1], kind="stable")
        points_0 = pairs_0[order, 1]
        first = np.searchsorted(points_0, self.pairs[:, 1], side="left")
        counts = np.searchsorted(points_0, self.pairs[:, 1], side="right") - first
        rows_i = np.repeat(np.arange(len(self.pairs)), counts)
        within = np.arange(len(rows_i)) - np.repeat(np.cumsum(counts) - counts, counts)
        rows_0 = order[np.repeat(first, counts) + within]
        weights = (
            _ones_or(self.weights, len(self.pairs))[rows_i]
            * _share_of_point(pairs_0, weights_0)[rows_0]
        )
        kept = weights > 0
        rows_i, rows_0 = rows_i[kept], rows_0[kept]
        return JoinedPairs(
            self.pairs[rows_i, 0], pairs_0[rows_0, 0], self.pairs[rows_i, 1], weights[kept]
        )

    def renumber(self, vertex_map: object) -> "Correspondence":
        """Return the correspondence of a shape whose vertices have other numbers now.

        Parameters
        ----------
        vertex_map : array-like of int, shape (n_vertices,)
            New number of each vertex, -1 where it is gone; from `skfmap.repair_mesh`.

        Returns
        -------
        Correspondence
            Pairs and symmetric pairs of the vertices that are left.

        Raises
        ------
        CorrespondenceError
            If ``vertex_map`` is of a mesh with another number of vertices, or holds numbers below
            -1.
        TypeError
            If ``vertex_map`` holds anything but integers.

        Examples
        --------
        >>> from skfmap import Correspondence
        >>> Correspondence.from_vertices([2, 0, 1]).renumber([-1, 0, 1]).pairs.tolist()
        [[0, 0], [1, 1]]
        """
        new = as_array(vertex_map, "vertex_map", TypeError)
        if new.ndim != 1 or not np.issubdtype(new.dtype, np.integer):
            raise TypeError(
                f"vertex_map must be a 1-D array of integers; got {new.dtype} of shape {new.shape}."
            )
        if new.min(initial=-1) < -1:
            raise CorrespondenceError(
                f"vertex_map holds {new.min()}; the only negative value allowed is -1, for gone."
            )
        if self.n_vertices is not None and self.n_vertices != len(new):
            raise CorrespondenceError(
                f"vertex_map is of a mesh of {len(new)} vertices, but this correspondence was "
                f"made for {self.n_vertices}."
            )
        check_index_range(self.pairs[:, 0], len(new), "The pairs")
        pairs, weights = _renumbered(self.pairs, self.weights, new)
        symmetric, symmetric_weights = None, None
        if self.symmetric_pairs is not None:
            check_index_range(self.symmetric_pairs[:, 0], len(new), "The symmetric pairs")
            symmetric, symmetric_weights = _renumbered(
                self.symmetric_pairs, self.symmetric_weights, new
            )
        # How many vertices there are now is not told: a mended mesh may have new ones at its end.
        return _correspondence(pairs, symmetric, weights, symmetric_weights, None)

    def restrict(self, points: object) -> "Correspondence":
        """Return the correspondence on the given template points only.

        Parameters
        ----------
        points : array-like of int
            Template points to keep, for instance one half of the landmarks.

        Returns
        -------
        Correspondence
            Pairs and symmetric pairs on those points.

        Raises
        ------
        TypeError
            If ``points`` holds anything but integers.
        """
        kept = as_array(points, "points", TypeError)
        if not np.issubdtype(kept.dtype, np.integer):
            raise TypeError(
                "points must be template points, an array of integers; got "
                f"{type(points).__name__}."
            )
        rows = np.isin(self.pairs[:, 1], kept)
        weights = None if self.weights is None else self.weights[rows]
        if self.symmetric_pairs is None:
            return Correspondence(self.pairs[rows], weights=weights, n_vertices=self.n_vertices)
        sym_rows = np.isin(self.symmetric_pairs[:, 1], kept)
        sym_weights = None if self.symmetric_weights is None else self.symmetric_weights[sym_rows]
        return Correspondence(
            self.pairs[rows],
            self.symmetric_pairs[sym_rows],
            weights=weights,
            symmetric_weights=sym_weights,
            n_vertices=self.n_vertices,
        )


def _renumbered(
    pairs: IntArray, weights: FloatArray | None, new: IntArray
) -> tuple[IntArray, FloatArray | None]:
    kept = new[pairs[:, 0]] >= 0
    moved = np.column_stack([new[pairs[kept, 0]], pairs[kept, 1]])
    return moved, None if weights is None else weights[kept]


def _correspondence(
    pairs: IntArray,
    symmetric: IntArray | None,
    weights: FloatArray | None,
    symmetric_weights: FloatArray | None,
    n_vertices: int | None,
) -> Correspondence:
    return Correspondence(
        pairs,
        symmetric,
        weights=weights,
        symmetric_weights=symmetric_weights,
        n_vertices=n_vertices,
    )


def _enumerate(values: object, who: str) -> tuple[IntArray, int]:
    """Return rows [position, value] of a 1-D integer array, without -1 and what is masked.

    The length of the array comes with them.
    """
    array = as_array(
        values.filled(-1) if isinstance(values, np.ma.MaskedArray) else values,
        who,
        CorrespondenceError,
    )
    if array.ndim != 1:
        raise CorrespondenceError(f"{who} must be one-dimensional; got shape {array.shape}.")
    if not np.issubdtype(array.dtype, np.integer):
        raise TypeError(f"{who} must hold integers; got dtype {array.dtype}.")
    if array.size and array.min() < -1:
        raise CorrespondenceError(
            f"{who} holds {array.min()}; the only negative value allowed is -1, for unknown."
        )
    known = np.flatnonzero(array >= 0)
    return np.column_stack([known, array[known]]).astype(np.int64), len(array)


def _check_alike(one: object, other: object) -> None:
    if one != other:
        raise CorrespondenceError(
            f"The symmetric answer must be as long as the other; got {one} and {other}."
        )


def _matrix_pairs(matrix: object, who: str) -> tuple[IntArray, FloatArray, tuple[int, int]]:
    given: Any = matrix if sp.issparse(matrix) else as_reals(matrix, who, CorrespondenceError)
    if given.ndim != 2:
        raise CorrespondenceError(
            f"{who} must have shape (n_vertices, n_points); got {given.shape}."
        )
    coo = sp.coo_array(given)
    coo.sum_duplicates()
    coo.eliminate_zeros()
    pairs = np.column_stack(coo.coords).astype(np.int64)
    return (
        pairs,
        as_reals(coo.data, who, CorrespondenceError),
        (int(coo.shape[0]), int(coo.shape[1])),
    )


def _check_weights(weights: object | None, n_pairs: int, who: str) -> FloatArray | None:
    if weights is None:
        return None
    out = as_reals(weights, who, CorrespondenceError)
    if out.shape != (n_pairs,):
        raise CorrespondenceError(
            f"{who} must have shape ({n_pairs},), one per pair; got {out.shape}."
        )
    if not np.isfinite(out).all() or (out < 0).any():
        raise CorrespondenceError(f"{who} must be finite and non-negative.")
    return read_only(out)


def _share_of_point(pairs: IntArray, weights: FloatArray | None) -> FloatArray:
    """Return each pair's share of all weight on its template point.

    Shares on one point sum to 1.
    """
    own = _ones_or(weights, len(pairs))
    if len(pairs) == 0:
        return own
    _, point = np.unique(pairs[:, 1], return_inverse=True)  # template points may have any numbers
    total = np.bincount(point, own)[point]
    return np.asarray(own / np.where(total > 0, total, 1.0))


def _ones_or(weights: FloatArray | None, n: int) -> FloatArray:
    return np.ones(n) if weights is None else weights
