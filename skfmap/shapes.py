"""Frozen data that flows through the pipeline: meshes, shapes in a basis, correspondences, matches."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy.sparse as sp

from skfmap._caching import hash_of_arrays
from skfmap._typing import FloatArray, IntArray, SparseMatrix
from skfmap._validation import (
    as_array,
    as_reals,
    check_faces,
    check_index_range,
    check_number,
    check_pairs,
    check_vertices,
    label,
    read_only,
)
from skfmap.exceptions import CorrespondenceError

__all__ = ["Correspondence", "JoinedPairs", "Match", "Mesh", "ProbedShape", "SkippedShape", "SpectralShape"]


@dataclass(frozen=True, eq=False, repr=False)
class Mesh:
    """A triangle mesh: checked, immutable, and identified by its content.

    Parameters
    ----------
    vertices : array-like of shape (n_vertices, 3)
        Coordinates, in any unit. Copied.
    faces : array-like of int, shape (n_faces, 3)
        Vertex numbers of each triangle, 0-based. Copied.
    name : str, optional
        What messages and reports call the shape.

    Raises
    ------
    MeshError
        If a coordinate is not finite, an index is out of range, a face is no triangle, or there is nothing at all.

    Notes
    -----
    A mesh has no length, no shape and no array interface on purpose: scikit-learn slices whatever looks like an array.

    Examples
    --------
    >>> from skfmap import Mesh
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], name="one")
    >>> mesh
    Mesh('one', n_vertices=3, n_faces=1)
    >>> mesh.area
    0.5
    """

    vertices: FloatArray
    faces: IntArray
    name: str | None = None

    def __post_init__(self) -> None:
        who = label(self.name)
        vertices = check_vertices(self.vertices, who)
        faces = check_faces(self.faces, len(vertices), who)
        object.__setattr__(self, "vertices", read_only(vertices))
        object.__setattr__(self, "faces", read_only(faces))

    def __repr__(self) -> str:
        """Return a line with name and counts."""
        name = "" if self.name is None else f"{self.name!r}, "
        return f"Mesh({name}n_vertices={self.n_vertices}, n_faces={self.n_faces})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle what was given and nothing cached; copies are checked and immutable too."""
        return Mesh, (self.vertices, self.faces, self.name)

    def __deepcopy__(self, memo: object) -> Self:
        """Return the mesh itself: it cannot change."""
        return self

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return len(self.vertices)

    @property
    def n_faces(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @cached_property
    def area(self) -> float:
        """Total area, in squared units of the coordinates."""
        a, b, c = (self.vertices[self.faces[:, j]] for j in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    @cached_property
    def content_hash(self) -> str:
        """Hash of vertices and faces, not of the name: what caches are keyed by."""
        return hash_of_arrays(self.vertices, self.faces)


@dataclass(frozen=True, eq=False)
class SkippedShape:
    """The place of a shape that cannot be used, so that those behind it keep theirs.

    `SpectralBasis` leaves it behind with ``on_invalid="skip"``, and with ``"repair"`` where that fails. It goes through
    the pipeline as it is, is left out of a fit, and is answered with NaN and -1.

    Attributes
    ----------
    name : str or None
        Name of the shape.
    reason : str
        Why it cannot be used.
    n_vertices : int
        Number of vertices; 0 if that is not known.
    """

    name: str | None
    reason: str
    n_vertices: int = 0


@dataclass(frozen=True, eq=False, repr=False)
class SpectralShape:
    """A shape of unit area with its first Laplacian eigenfunctions.

    Attributes
    ----------
    mesh : Mesh
        The mesh in its own units, numbered as given. Its faces are wound consistently and outwards where that can be
        told (``oriented`` says so); otherwise they are as given.
    evals : ndarray of shape (n_components,)
        Eigenvalues of the Laplacian of the shape scaled to unit area, ascending; ``evals[0]`` is 0.
    evecs : ndarray of shape (n_vertices, n_components)
        Eigenfunctions, orthonormal with respect to ``mass``. The first is the constant 1.
    mass : ndarray of shape (n_vertices,)
        Lumped mass matrix (its diagonal) at unit area; sums to 1.
    stiffness : sparse array of shape (n_vertices, n_vertices)
        Stiffness matrix, positive semi-definite; it does not depend on the scale.
    area : float
        Area of ``mesh`` in its own units.
    oriented : bool
        Whether all faces are wound consistently.
    outward : bool
        Whether they are known to point outwards.
    laplacian : str
        Which Laplacian the eigenfunctions are of.
    vertex_map : ndarray of int, shape (n_vertices_given,), or None
        If the mesh was mended: number in ``mesh`` of each vertex that was given, -1 where it was removed. None if
        vertices have their own numbers.
    """

    mesh: Mesh
    evals: FloatArray
    evecs: FloatArray
    mass: FloatArray
    stiffness: SparseMatrix
    area: float
    oriented: bool = True
    outward: bool = True
    laplacian: str = "cotangent"
    vertex_map: IntArray | None = None

    def __repr__(self) -> str:
        """Return a line with name and counts."""
        return f"SpectralShape({self.mesh.name!r}, n_vertices={self.mesh.n_vertices}, n_components={len(self.evals)})"

    @property
    def name(self) -> str | None:
        """Name of the mesh."""
        return self.mesh.name

    @property
    def n_components(self) -> int:
        """Number of eigenfunctions held."""
        return len(self.evals)

    @property
    def vertices(self) -> FloatArray:
        """Coordinates scaled to unit area, shape (n_vertices, 3)."""
        return np.asarray(self.mesh.vertices / np.sqrt(self.area))

    @property
    def evals_in_mesh_units(self) -> FloatArray:
        """Eigenvalues of the mesh as given, in 1 / squared units of its coordinates."""
        return np.asarray(self.evals / self.area)

    def truncate(self, n_components: int) -> "SpectralShape":
        """Return the same shape with its first ``n_components`` eigenfunctions only."""
        return replace(self, evals=self.evals[:n_components], evecs=self.evecs[:, :n_components])


@dataclass(frozen=True, eq=False, repr=False)
class ProbedShape:
    """A spectral shape with the coefficients of its probe functions.

    Attributes
    ----------
    spectral : SpectralShape
        The shape and its basis.
    probes : ndarray of shape (n_components, n_probes)
        Raw coefficients of the probe functions in ``spectral.evecs``: neither centred nor normalised.
    probe_names : tuple of str
        Name of each probe function, equal on all shapes that one transformer made.
    probe_categories : tuple of str
        Family of each probe function.
    recipe : tuple of str
        Parameters of the basis and of the families that the coefficients depend on. Shapes are matched only if they
        agree, as far as they are known.
    """

    spectral: SpectralShape
    probes: FloatArray
    probe_names: tuple[str, ...]
    probe_categories: tuple[str, ...]
    recipe: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return a line with name and counts."""
        return f"ProbedShape({self.name!r}, n_components={self.probes.shape[0]}, n_probes={self.probes.shape[1]})"

    @property
    def name(self) -> str | None:
        """Name of the mesh."""
        return self.spectral.name

    def functions(self) -> FloatArray:
        """Return the probe functions on the vertices, smoothed by the basis; shape (n_vertices, n_probes)."""
        return np.asarray(self.spectral.evecs @ self.probes)


@dataclass(frozen=True, eq=False)
class JoinedPairs:
    """Pairs of vertices of two shapes that stand on the same template point.

    Attributes
    ----------
    vertices_i, vertices_0 : ndarray of int, shape (n_pairs,)
        Vertex of S_i and the vertex of S_0 that it is mapped to: the point map runs from S_i to S_0.
    points : ndarray of int, shape (n_pairs,)
        The template point that joins them.
    weights : ndarray of shape (n_pairs,)
        Positive. The weight of the pair on S_i (1 for plain pairs), shared among the vertices of S_0 that stand on the
        template point.
    """

    vertices_i: IntArray
    vertices_0: IntArray
    points: IntArray
    weights: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Correspondence:
    """Where one shape lies on the template, the set of points that the shapes of a collection share.

    Parameters
    ----------
    pairs : array-like of int, shape (n_pairs, 2)
        Rows ``[vertex of the shape, template point]``, 0-based. Sparse, partial and many-to-one are ordinary.
    symmetric_pairs : array-like of int, shape (n_symmetric_pairs, 2), optional
        The same for the symmetric answer: the vertex that the shape's left-right symmetry takes each point's vertex to.
        Used by the symmetric metrics only, never for learning.
    weights : array-like of shape (n_pairs,), optional
        Non-negative weights of soft or barycentric pairs; None means 1 each.
    symmetric_weights : array-like of shape (n_symmetric_pairs,), optional
        The same for ``symmetric_pairs``.
    n_vertices : int, optional
        How many vertices the shape has, where the constructor could tell; checked against the mesh.

    Raises
    ------
    TypeError
        If ``pairs`` is one-dimensional (say which reading you mean with a constructor) or not of an integer dtype.
    CorrespondenceError
        If the shape of ``pairs`` is wrong, an index is negative, or weights do not fit.

    See Also
    --------
    Correspondence.from_vertices : From the template point of each vertex.
    Correspondence.from_template : From the vertex of each template point, which is what ``.vts`` files hold.
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
        object.__setattr__(self, "weights", _check_weights(self.weights, len(self.pairs), "weights"))
        if self.n_vertices is not None:
            check_number(self.n_vertices, "n_vertices", low=0, integer=True)
        if self.symmetric_pairs is None:
            if self.symmetric_weights is not None:
                raise CorrespondenceError("symmetric_weights are given without symmetric_pairs.")
            return
        object.__setattr__(self, "symmetric_pairs", read_only(check_pairs(self.symmetric_pairs, "symmetric_pairs")))
        n_symmetric = len(self.symmetric_pairs)
        checked = _check_weights(self.symmetric_weights, n_symmetric, "symmetric_weights")
        object.__setattr__(self, "symmetric_weights", checked)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle so that copies are checked and immutable too."""
        parts = (self.pairs, self.symmetric_pairs, self.weights, self.symmetric_weights, self.n_vertices)
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
            Row ``v`` holds how much vertex ``v`` stands on each template point. Non-negative; rows need not sum to 1.
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
        return cls(pairs, symmetric_pairs, weights=weights, symmetric_weights=symmetric_weights, n_vertices=n_vertices)

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
                    "The reference has no symmetric answer; give its Correspondence symmetric_pairs, or score directly."
                )
            pairs_0, weights_0 = other.symmetric_pairs, other.symmetric_weights
        order = np.argsort(pairs_0[:, 1], kind="stable")
        points_0 = pairs_0[order, 1]
        first = np.searchsorted(points_0, self.pairs[:, 1], side="left")
        counts = np.searchsorted(points_0, self.pairs[:, 1], side="right") - first
        rows_i = np.repeat(np.arange(len(self.pairs)), counts)
        within = np.arange(len(rows_i)) - np.repeat(np.cumsum(counts) - counts, counts)
        rows_0 = order[np.repeat(first, counts) + within]
        weights = _ones_or(self.weights, len(self.pairs))[rows_i] * _share_of_point(pairs_0, weights_0)[rows_0]
        kept = weights > 0
        rows_i, rows_0 = rows_i[kept], rows_0[kept]
        return JoinedPairs(self.pairs[rows_i, 0], pairs_0[rows_0, 0], self.pairs[rows_i, 1], weights[kept])

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
            If ``vertex_map`` is of a mesh with another number of vertices, or holds numbers below -1.
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
            raise TypeError(f"vertex_map must be a 1-D array of integers; got {new.dtype} of shape {new.shape}.")
        if new.min(initial=-1) < -1:
            raise CorrespondenceError(f"vertex_map holds {new.min()}; the only negative value allowed is -1, for gone.")
        if self.n_vertices is not None and self.n_vertices != len(new):
            raise CorrespondenceError(
                f"vertex_map is of a mesh of {len(new)} vertices, but this correspondence was made for "
                f"{self.n_vertices}."
            )
        check_index_range(self.pairs[:, 0], len(new), "The pairs")
        pairs, weights = _renumbered(self.pairs, self.weights, new)
        symmetric, symmetric_weights = None, None
        if self.symmetric_pairs is not None:
            check_index_range(self.symmetric_pairs[:, 0], len(new), "The symmetric pairs")
            symmetric, symmetric_weights = _renumbered(self.symmetric_pairs, self.symmetric_weights, new)
        n_vertices = int(new.max(initial=-1)) + 1
        return _correspondence(pairs, symmetric, weights, symmetric_weights, n_vertices)

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
            raise TypeError(f"points must be template points, an array of integers; got {type(points).__name__}.")
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


@dataclass(frozen=True, eq=False, repr=False)
class Match:
    """A shape matched to the reference.

    The two maps point opposite ways: ``functional_map`` pulls functions back from S_0 to S_i, ``p2p`` sends points of
    S_i to S_0.

    Attributes
    ----------
    p2p : ndarray of int, shape (n_vertices_i,)
        Point-to-point map: vertex of the reference S_0 for each vertex of S_i.
    expected_error : ndarray of shape (n_vertices_i,)
        Geodesic error to expect at each vertex of S_i, in units of sqrt(area) of the reference, as calibrated on the
        training shapes.
    confidence : ndarray of shape (n_vertices_i,)
        Between 0 and 1: how often a training vertex that looked like this one landed within 0.1 sqrt(area).
    functional_map : ndarray of shape (k, k)
        Full map X_i(D), from functions on S_0 to functions on S_i, on unit-area shapes.
    reduced_map : ndarray of shape (k, p)
        X_i(D) Y_p.
    name : str or None
        Name of S_i.
    reference_name : str or None
        Name of S_0.
    refined_map : ndarray of shape (n, n) or None
        The functional map that the last step of the refinement matched points in; it runs as ``functional_map`` does.
    n_supporting : ndarray of int, shape (n_vertices_i,)
        How many of the stable functions Y, the most stable first, agree that a vertex and its match are one point.
    matrix : sparse array of shape (n_vertices_i, n_vertices_0)
        The point map as a matrix whose rows sum to 1: with one entry each, or barycentric or soft if asked. It pulls
        functions on S_0 back to S_i.
    inverse : ndarray of int, shape (n_vertices_0,)
        Point map of the other direction: vertex of S_i for each vertex of S_0, found in the same embedding.
    reference_hash : str or None
        ``content_hash`` of the mesh of S_0.
    misfit : float
        Mean distance between matched points of the embedding, in units of the worst training shape that was left out.
        Beyond 1 ``expected_error`` is raised, and ``confidence`` lowered, by its square.
    familiar : bool
        Whether the shape is like the training shapes: False where `UnfamiliarShapeWarning` named it.
    """

    p2p: IntArray
    expected_error: FloatArray
    confidence: FloatArray
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
    familiar: bool = True

    def transfer(self, values: object, *, max_error: float | None = None) -> Any:
        """Carry a function, labels, a segmentation or texture coordinates from the reference to this shape.

        Numbers are interpolated as ``matrix`` says. Labels (integers, booleans, strings) are voted on with its weights.

        Parameters
        ----------
        values : array-like of shape (n_vertices_0,) or (n_vertices_0, n_columns)
            What the vertices of the reference hold; labels one-dimensional.
            Masked entries are unknown, and mask whatever they would reach.
        max_error : float, optional
            Vertices with a larger ``expected_error``, in units of sqrt(area), are masked, as are all without a match.

        Returns
        -------
        numpy.ma.MaskedArray of shape (n_vertices_i,) or (n_vertices_i, n_columns)
            Values at the vertices of S_i. ``.data`` has all of them, ``.mask`` marks those that are not trusted, and
            ``.filled(...)`` replaces them.

        Raises
        ------
        ValueError
            If ``values`` does not have one entry for each vertex of the reference, or the match no matrix.
        TypeError
            If ``values`` are Python objects of other kinds than text.

        Examples
        --------
        >>> import numpy as np
        >>> import scipy.sparse as sp
        >>> from skfmap import Match
        >>> C, error = np.eye(1), np.array([0.01, 0.2])
        >>> match = Match(np.array([1, 0]), error, 1 - error, C, C, matrix=sp.csr_array([[0, 1.0], [1, 0]]))
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
                f"values must have one entry or row for each of the {n_0} vertices of the reference; got shape "
                f"{given.shape}."
            )
        if np.issubdtype(given.dtype, np.inexact):
            carried = self.matrix @ given
        elif given.ndim == 2:
            carried = np.stack([self._vote(column) for column in given.T], axis=1)
        else:
            carried = self._vote(given)
        doubtful = np.isnan(self.expected_error) | (self.p2p < 0)
        if max_error is not None:
            doubtful |= self.expected_error > check_number(max_error, "max_error", low=0)
        mask = np.broadcast_to(doubtful.reshape(-1, *[1] * (given.ndim - 1)), carried.shape)
        if unknown is not None:
            mask = mask | (self.matrix @ unknown.astype(np.float64) > 0)
        return np.ma.MaskedArray(carried, mask)

    def to(self, other: "Match") -> tuple[IntArray, FloatArray]:
        """Return the point map from this shape to another that was matched to the same reference.

        Parameters
        ----------
        other : Match
            Of the other shape.

        Returns
        -------
        p2p : ndarray of int, shape (n_vertices_i,)
            Vertex of the other shape for each vertex of this one; -1 where either has no match.
        expected_error : ndarray of shape (n_vertices_i,)
            Sum of the errors expected on both ways, in units of sqrt(area); NaN where there is no match.

        Raises
        ------
        ValueError
            If the two were matched to different references.
        """
        if self.matrix is None or other.matrix is None or other.inverse is None:
            raise ValueError("Both matches must come from a learner's match, with their matrices and inverses.")
        if self._reference() != other._reference():
            raise ValueError(
                f"Both shapes must be matched to one reference; got {self.reference_name!r} and "
                f"{other.reference_name!r}."
            )
        p2p = np.append(other.inverse, -1)[self.p2p]  # what is -1 finds the last
        return p2p, self.expected_error + np.append(other.expected_error, np.nan)[p2p]

    def _reference(self) -> tuple[str | None, str | None, int]:
        """Return what tells references apart."""
        return self.reference_name, self.reference_hash, self.matrix.shape[1]

    def _vote(self, labels: Any) -> Any:
        """Return the label of most weight at each vertex; the first in order among equals."""
        kinds, place = np.unique(labels, return_inverse=True)
        members = sp.coo_array((np.ones(len(labels)), (np.arange(len(labels)), place)), shape=(len(labels), len(kinds)))
        return kinds[np.asarray((self.matrix @ members.tocsr()).todense()).argmax(axis=1)]

    def __repr__(self) -> str:
        """Return a line with both names, the mean expected error, and how many vertices have no match."""
        known = self.expected_error[~np.isnan(self.expected_error)]
        says = f"mean expected error {known.mean():.3f} sqrt(area)" if len(known) else "no match"
        if 0 < len(known) < len(self.p2p):
            says += f", {len(self.p2p) - len(known)} of {len(self.p2p)} vertices without a match"
        if not self.familiar:
            says += ", unlike the training shapes"
        return f"Match({self.name!r} -> {self.reference_name!r}, {says})"


def _renumbered(pairs: IntArray, weights: FloatArray | None, new: IntArray) -> tuple[IntArray, FloatArray | None]:
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
    return Correspondence(pairs, symmetric, weights=weights, symmetric_weights=symmetric_weights, n_vertices=n_vertices)


def _enumerate(values: object, who: str) -> tuple[IntArray, int]:
    """Return rows [position, value] of a 1-D integer array, without -1 and what is masked; and its length."""
    array = as_array(values.filled(-1) if isinstance(values, np.ma.MaskedArray) else values, who, CorrespondenceError)
    if array.ndim != 1:
        raise CorrespondenceError(f"{who} must be one-dimensional; got shape {array.shape}.")
    if not np.issubdtype(array.dtype, np.integer):
        raise TypeError(f"{who} must hold integers; got dtype {array.dtype}.")
    if array.size and array.min() < -1:
        raise CorrespondenceError(f"{who} holds {array.min()}; the only negative value allowed is -1, for unknown.")
    known = np.flatnonzero(array >= 0)
    return np.column_stack([known, array[known]]).astype(np.int64), len(array)


def _check_alike(one: object, other: object) -> None:
    if one != other:
        raise CorrespondenceError(f"The symmetric answer must be as long as the other; got {one} and {other}.")


def _matrix_pairs(matrix: object, who: str) -> tuple[IntArray, FloatArray, tuple[int, int]]:
    given: Any = matrix if sp.issparse(matrix) else as_reals(matrix, who, CorrespondenceError)
    if given.ndim != 2:
        raise CorrespondenceError(f"{who} must have shape (n_vertices, n_points); got {given.shape}.")
    coo = sp.coo_array(given)
    coo.sum_duplicates()
    coo.eliminate_zeros()
    pairs = np.column_stack(coo.coords).astype(np.int64)
    return pairs, as_reals(coo.data, who, CorrespondenceError), (int(coo.shape[0]), int(coo.shape[1]))


def _as_values(values: object) -> Any:
    """Return what is to be carried as an array; texts that pandas keeps as objects become texts of numpy."""
    given = as_array(values, "values")
    if given.dtype.kind not in "biufcSUO":
        raise TypeError(f"values must be numbers or labels; got dtype {given.dtype}.")
    if given.dtype.kind == "O":
        if not all(isinstance(value, str) for value in given.ravel()):
            raise TypeError("values are Python objects; give numbers, or labels that are all text.")
        return given.astype(str)
    return given


def _check_weights(weights: object | None, n_pairs: int, who: str) -> FloatArray | None:
    if weights is None:
        return None
    out = as_reals(weights, who, CorrespondenceError)
    if out.shape != (n_pairs,):
        raise CorrespondenceError(f"{who} must have shape ({n_pairs},), one per pair; got {out.shape}.")
    if not np.isfinite(out).all() or (out < 0).any():
        raise CorrespondenceError(f"{who} must be finite and non-negative.")
    return read_only(out)


def _share_of_point(pairs: IntArray, weights: FloatArray | None) -> FloatArray:
    """Return each pair's share of all weight on its template point, so that shares on one point sum to 1."""
    own = _ones_or(weights, len(pairs))
    if len(pairs) == 0:
        return own
    _, place = np.unique(pairs[:, 1], return_inverse=True)  # template points may have any numbers
    total = np.bincount(place, own)[place]
    return np.asarray(own / np.where(total > 0, total, 1.0))


def _ones_or(weights: FloatArray | None, n: int) -> FloatArray:
    return np.ones(n) if weights is None else weights
