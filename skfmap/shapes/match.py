"""A shape matched to the reference."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from skfmap._tools.types import BoolArray, FloatArray, IntArray, SparseMatrix
from skfmap._tools.validation import as_array, check_number, label

__all__ = ["Match"]


@dataclass(frozen=True, eq=False, repr=False)
class Match:
    """A shape matched to the reference.

    The two maps point opposite ways: ``functional_map`` pulls functions back from S_0 to S_i,
    ``p2p`` sends points of S_i to S_0.

    Attributes
    ----------
    p2p : ndarray of int, shape (n_vertices_i,)
        Point-to-point map: vertex of the reference S_0 for each vertex of S_i.
    expected_error : ndarray of shape (n_vertices_i,) or None
        Geodesic error to expect at each vertex of S_i, in units of sqrt(area) of the reference, as
        calibrated on the training shapes; NaN where there is no match. None if the learner
        calibrates no errors (``confidence=None``).
    confidence : ndarray of shape (n_vertices_i,) or None
        Between 0 and 1: how often a training vertex that looked like this one landed within 0.1
        sqrt(area).
    functional_map : ndarray of shape (k, k)
        Full map X_i(D), from functions on S_0 to functions on S_i, on unit-area shapes.
    reduced_map : ndarray of shape (k, p)
        X_i(D) Y_p.
    name : str or None
        Name of S_i.
    reference_name : str or None
        Name of S_0.
    refined_map : ndarray of shape (n, n) or None
        The functional map that the last step of the refinement matched points in; it runs as
        ``functional_map`` does.
    n_supporting : ndarray of int, shape (n_vertices_i,)
        How many of the stable functions Y, the most stable first, agree that a vertex and its match
        are one point.
    matrix : sparse array of shape (n_vertices_i, n_vertices_0)
        The point map as a matrix whose rows sum to 1: with one entry each, or barycentric or soft
        if asked. It pulls functions on S_0 back to S_i.
    inverse : ndarray of int, shape (n_vertices_0,)
        Point map of the other direction: vertex of S_i for each vertex of S_0, found in the same
        embedding.
    reference_hash : str or None
        ``content_hash`` of the mesh of S_0.
    misfit : float
        Mean distance between matched points of the embedding, in units of the worst training shape
        that was left out. Beyond 1 ``expected_error`` is raised, and ``confidence`` lowered, by its
        square.
    familiar : bool or None
        Whether the shape is like the training shapes: False where `UnfamiliarShapeWarning` named
        it. None if nothing tells: the learner calibrates no errors, and lays no mesh onto shapes.
    covered : ndarray of bool, shape (n_vertices_0,), or None
        Which vertices of the reference the shape shows; all where it is whole. None unless a
        `skfmap.PartialMatcher` matched it.
    covered_probability : ndarray of shape (n_vertices_0,) or None
        How likely each of them is to be shown.
    """

    p2p: IntArray
    expected_error: FloatArray | None
    confidence: FloatArray | None
    functional_map: FloatArray
    reduced_map: FloatArray
    name: str | None = None
    reference_name: str | None = None
    refined_map: FloatArray | None = None
    n_supporting: IntArray | None = None
    matrix: SparseMatrix | Any = None
    inverse: IntArray | Any = None
    reference_hash: str | None = None
    misfit: float = float("nan")
    familiar: bool | None = None
    covered: BoolArray | None = None
    covered_probability: FloatArray | None = None

    def transfer(self, values: object, *, max_error: float | None = None) -> Any:
        """Carry a function, labels or texture coordinates from the reference to this shape.

        Numbers are interpolated as ``matrix`` says. Labels (integers, booleans, strings) are voted
        on with its weights.

        Parameters
        ----------
        values : array-like of shape (n_vertices_0,) or (n_vertices_0, n_columns)
            What the vertices of the reference hold; labels one-dimensional.
            Masked entries are unknown, and mask whatever they would reach.
        max_error : float, optional
            Vertices with a larger ``expected_error``, in units of sqrt(area), are masked, as are
            all without a match.

        Returns
        -------
        numpy.ma.MaskedArray of shape (n_vertices_i,) or (n_vertices_i, n_columns)
            Values at the vertices of S_i. ``.data`` has all of them, ``.mask`` marks those that are
            not trusted, and ``.filled(...)`` replaces them.

        Raises
        ------
        ValueError
            If ``values`` does not have one entry for each vertex of the reference, or the match no
            matrix.
        TypeError
            If ``values`` are Python objects of other kinds than text.

        Examples
        --------
        >>> import numpy as np
        >>> import scipy.sparse as sp
        >>> from skfmap import Match
        >>> C, error = np.eye(1), np.array([0.01, 0.2])
        >>> swapped = sp.csr_array([[0, 1.0], [1, 0]])
        >>> match = Match(np.array([1, 0]), error, 1 - error, C, C, matrix=swapped)
        >>> match.transfer(["head", "tail"], max_error=0.1)
        masked_array(data=['tail', --],
                     mask=[False,  True],
               fill_value='N/A',
                    dtype='<U4')
        """
        if self.matrix is None:
            raise ValueError("This Match holds no matrix; take it from a learner's match.")
        unknown = np.ma.getmaskarray(values) if isinstance(values, np.ma.MaskedArray) else None
        given = _as_values(values.data if isinstance(values, np.ma.MaskedArray) else values)
        n_0 = self.matrix.shape[1]
        if given.ndim not in (1, 2) or len(given) != n_0 or given.size == 0:
            raise ValueError(
                f"values must have one entry or row for each of the {n_0} vertices of the "
                f"reference; got shape {given.shape}."
            )
        if np.issubdtype(given.dtype, np.inexact):
            carried = self.matrix @ given
        elif given.ndim == 2:
            carried = np.stack([self._vote(column) for column in given.T], axis=1)
        else:
            carried = self._vote(given)
        doubtful = self.p2p < 0
        if self.expected_error is not None:
            doubtful = doubtful | np.isnan(self.expected_error)
        if max_error is not None:
            doubtful = doubtful | (
                self._errors_to_expect() > check_number(max_error, "max_error", low=0)
            )
        mask = np.broadcast_to(doubtful.reshape(-1, *[1] * (given.ndim - 1)), carried.shape)
        if unknown is not None:
            mask = mask | (self.matrix @ unknown.astype(np.float64) > 0)
        return np.ma.MaskedArray(carried, mask)

    def to(self, other: "Match") -> tuple[IntArray, FloatArray | None]:
        """Return the point map from this shape to another that was matched to the same reference.

        Parameters
        ----------
        other : Match
            Of the other shape.

        Returns
        -------
        p2p : ndarray of int, shape (n_vertices_i,)
            Vertex of the other shape for each vertex of this one; -1 where either has no match.
        expected_error : ndarray of shape (n_vertices_i,) or None
            Sum of the errors expected on both ways, in units of sqrt(area); NaN where there is no
            match, None if a match has none.

        Raises
        ------
        ValueError
            If the two were matched to different references.
        """
        if self.matrix is None or other.matrix is None or other.inverse is None:
            raise ValueError(
                "Both matches must come from a learner's match, with their matrices and inverses."
            )
        if self._reference() != other._reference():
            raise ValueError(
                f"Both shapes must be matched to one reference; got {self.reference_name!r} and "
                f"{other.reference_name!r}."
            )
        p2p = np.append(other.inverse, -1)[self.p2p]  # what is -1 finds the last
        if self.expected_error is None or other.expected_error is None:
            return p2p, None
        return p2p, self.expected_error + np.append(other.expected_error, np.nan)[p2p]

    def _errors_to_expect(self) -> FloatArray:
        if self.expected_error is None:
            raise ValueError(
                f"The match of {label(self.name, 'shape')} has no expected errors: the learner "
                "was fitted with confidence=None. Fit it with confidence='cross-fit', or leave "
                "max_error out."
            )
        return self.expected_error

    def _reference(self) -> tuple[str | None, str | None, int]:
        """Return what tells references apart."""
        return self.reference_name, self.reference_hash, self.matrix.shape[1]

    def _vote(self, labels: Any) -> Any:
        """Return the label of most weight at each vertex; the first in order among equals."""
        kinds, kind_of = np.unique(labels, return_inverse=True)
        members = sp.coo_array(
            (np.ones(len(labels)), (np.arange(len(labels)), kind_of)),
            shape=(len(labels), len(kinds)),
        )
        return kinds[np.asarray((self.matrix @ members.tocsr()).todense()).argmax(axis=1)]

    def __repr__(self) -> str:
        """Return a line with both names, the mean expected error, and how many have no match."""
        errors = self.expected_error
        known = self.p2p >= 0 if errors is None else ~np.isnan(errors)
        n_known = int(known.sum())
        says = f"{n_known} vertices" if n_known else "no match"
        if errors is not None and n_known:
            says = f"mean expected error {errors[known].mean():.3f} sqrt(area)"
        if 0 < n_known < len(self.p2p):
            says += f", {len(self.p2p) - n_known} of {len(self.p2p)} vertices without a match"
        if self.familiar is False:
            says += ", unlike the training shapes"
        return f"Match({self.name!r} -> {self.reference_name!r}, {says})"


def _as_values(values: object) -> Any:
    """Return what is to be carried as an array.

    Texts that pandas keeps as objects become texts of numpy.
    """
    given = as_array(values, "values")
    if given.dtype.kind not in "biufcSUO":
        raise TypeError(f"values must be numbers or labels; got dtype {given.dtype}.")
    if given.dtype.kind == "O":
        if not all(isinstance(value, str) for value in given.ravel()):
            raise TypeError("values are Python objects; give numbers, or labels that are all text.")
        return given.astype(str)
    return given
