"""Where a shape lies on the template that the shapes of a collection share."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import numpy.typing as npt
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
from skfmap.shapes.landmarks import Landmarks
from skfmap.shapes.points_on_surface import mesh_arrays, put_on_surface
from skfmap.shapes.surface_places import SurfacePlaces

__all__ = ["Correspondence", "JoinedPairs"]


@dataclass(frozen=True, eq=False)
class JoinedPairs:
    """Pairs of places on two shapes that correspond to the same template point.

    Attributes
    ----------
    vertices_i, vertices_0 : ndarray of int, shape (n_pairs,)
        Vertex of S_i, and the vertex of S_0 that it is mapped to. The point-to-point map runs from
        S_i to S_0.
    points : ndarray of int, shape (n_pairs,)
        The template point that joins them.
    weights : ndarray of shape (n_pairs,)
        Positive weights. The weight of each pair on S_i (1 for plain pairs) is divided among the
        vertices of S_0 paired with the same template point.
    places_i, places_0 : SurfacePlaces or None
        Places of the pairs on the faces of S_i and S_0. The vertices are then the corners with the
        largest weight. None if all pairs are at vertices.
    """

    vertices_i: IntArray
    vertices_0: IntArray
    points: IntArray
    weights: FloatArray
    places_i: SurfacePlaces | None = None
    places_0: SurfacePlaces | None = None

    def take(self, rows: IntArray) -> "JoinedPairs":
        """Return the pairs selected by row indices or a mask."""
        places_i, places_0 = (
            None if at is None else at.take(rows) for at in (self.places_i, self.places_0)
        )
        return JoinedPairs(
            self.vertices_i[rows],
            self.vertices_0[rows],
            self.points[rows],
            self.weights[rows],
            places_i,
            places_0,
        )


@dataclass(frozen=True, eq=False, repr=False)
class Correspondence:
    """Where one shape lies on the template.

    The template is the set of points that the shapes of a collection share.

    Parameters
    ----------
    pairs : array-like of int, shape (n_pairs, 2)
        Rows ``[vertex of the shape, template point]``, counted from 0. They may be sparse, partial
        or many-to-one.
    symmetric_pairs : array-like of int, shape (n_symmetric_pairs, 2), optional
        The same for the symmetric answer: the vertex that the left-right symmetry of the shape
        sends the vertex of each template point to. Only the symmetric metrics use it; nothing is
        learned from it.
    weights : array-like of shape (n_pairs,), optional
        Non-negative weights of soft or barycentric pairs. None means 1 for each pair.
    symmetric_weights : array-like of shape (n_symmetric_pairs,), optional
        The same for ``symmetric_pairs``.
    n_vertices : int, optional
        Number of vertices of the shape, if the constructor knows it. It is checked against the
        mesh.
    places : (corners, weights), optional
        Places of the pairs on the faces of the shape: the three vertices of a face, integers of
        shape (n_pairs, 3), and their weights, which sum to 1. The vertex in ``pairs`` must be a
        corner with the largest weight. None if all pairs are at vertices.
    names : sequence of str, optional
        Unique name of each template point. Correspondences with names are joined by name.
    coordinates : array-like of shape (n_pairs, 3), optional
        The points as measured, in the units of the mesh. Each template point may occur only once.
    distance : array-like of shape (n_pairs,), optional
        Distance of each measured point from its place, in the units of the mesh.

    Raises
    ------
    TypeError
        If ``pairs`` is one-dimensional (use ``from_vertices`` or ``from_template`` to say what it
        holds) or its dtype is not an integer type.
    CorrespondenceError
        If ``pairs`` has the wrong shape, an index is negative, or the weights, places, names,
        coordinates or distances do not match the pairs.

    See Also
    --------
    Correspondence.from_vertices : From the template point of each vertex.
    Correspondence.from_template : From the vertex of each template point (``.vts`` files).
    Correspondence.from_matrix : From a sparse or soft matrix.
    Correspondence.from_points : From landmarks that were measured between vertices.

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
    places: SurfacePlaces | None = field(default=None, kw_only=True)
    names: tuple[str, ...] | None = field(default=None, kw_only=True)
    coordinates: FloatArray | None = field(default=None, kw_only=True)
    distance: FloatArray | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "pairs", read_only(check_pairs(self.pairs, "pairs")))
        object.__setattr__(
            self, "weights", _check_weights(self.weights, len(self.pairs), "weights")
        )
        if self.n_vertices is not None:
            check_number(self.n_vertices, "n_vertices", low=0, integer=True)
        self._check_symmetric()
        n_pairs = len(self.pairs)
        for what, checked in {
            "places": _check_places(self.places, self.pairs),
            "names": _check_names(self.names, self.pairs, self.symmetric_pairs),
            "coordinates": _check_rows(self.coordinates, (n_pairs, 3), "coordinates"),
            "distance": _check_rows(self.distance, (n_pairs,), "distance"),
        }.items():
            object.__setattr__(self, what, checked)
        if self.coordinates is not None:
            _check_once(self.pairs[:, 1])

    def _check_symmetric(self) -> None:
        if self.symmetric_pairs is None:
            if self.symmetric_weights is not None:
                raise CorrespondenceError(
                    "symmetric_weights were given without symmetric_pairs. Give both, or neither."
                )
            return
        object.__setattr__(
            self, "symmetric_pairs", read_only(check_pairs(self.symmetric_pairs, "symmetric_pairs"))
        )
        n_symmetric = len(self.symmetric_pairs)
        checked = _check_weights(self.symmetric_weights, n_symmetric, "symmetric_weights")
        object.__setattr__(self, "symmetric_weights", checked)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by way of the constructor, so that copies are checked and immutable too."""
        parts = (
            self.pairs,
            self.symmetric_pairs,
            self.weights,
            self.symmetric_weights,
            self.n_vertices,
        )
        more = {what: getattr(self, what) for what in _MORE}
        known = {what: value for what, value in more.items() if value is not None}
        return _correspondence, (*parts, known) if known else parts

    def __deepcopy__(self, memo: object) -> Self:
        """Return the correspondence itself: it cannot change."""
        return self

    def __repr__(self) -> str:
        """Return one line with the counts."""
        symmetric = "none" if self.symmetric_pairs is None else len(self.symmetric_pairs)
        soft = "" if self.weights is None else ", soft"
        named = "" if self.names is None else ", named"
        counts = f"n_pairs={len(self.pairs)}, n_symmetric_pairs={symmetric}"
        return f"Correspondence({counts}{soft}{named})"

    @classmethod
    def from_vertices(cls, points: object, symmetric: object | None = None) -> Self:
        """Make a correspondence from the template point of each vertex.

        Parameters
        ----------
        points : array-like of int, shape (n_vertices,)
            Template point of each vertex of the shape; -1 where it is unknown.
        symmetric : array-like of int, shape (n_vertices,), optional
            Template point whose symmetric counterpart each vertex is; -1 where it is unknown.

        Returns
        -------
        Correspondence
            One pair for each vertex whose template point is known.
        """
        pairs, n_vertices = _enumerate(points, "points")
        if symmetric is None:
            return cls(pairs, n_vertices=n_vertices)
        symmetric_pairs, n_symmetric = _enumerate(symmetric, "symmetric")
        _check_alike(n_vertices, n_symmetric)
        return cls(pairs, symmetric_pairs, n_vertices=n_vertices)

    @classmethod
    def from_template(cls, vertices: object, symmetric: object | None = None) -> Self:
        """Make a correspondence from the vertex of each template point.

        This is what ``.vts`` files hold, except that they count from 1.

        Parameters
        ----------
        vertices : array-like of int, shape (n_points,)
            Vertex of the shape at each template point, counted from 0; -1 where it is unknown.
        symmetric : array-like of int, shape (n_points,), optional
            Vertex that the symmetry of the shape sends it to, as in ``.sym.vts`` files; -1 where it
            is unknown.

        Returns
        -------
        Correspondence
            One pair for each template point whose vertex is known.
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
        """Make a correspondence from a soft matrix.

        Each non-zero entry becomes a pair. For points between vertices, prefer `from_points` or
        ``places``, which need only one pair per point.

        Parameters
        ----------
        matrix : array-like or sparse, shape (n_vertices, n_points)
            Non-negative weight of each template point (column) at each vertex (row). Rows need not
            sum to 1.
        symmetric : array-like or sparse, shape (n_vertices, n_points), optional
            The same for the symmetric answer.

        Returns
        -------
        Correspondence
            One weighted pair for each non-zero entry.
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

    @classmethod
    def from_points(
        cls,
        points: npt.ArrayLike | Landmarks,
        mesh: Any,
        names: Sequence[str] | None = None,
        *,
        max_distance: float = 0.2,
    ) -> Self:
        """Make a correspondence from measured points, projected onto the nearest faces of the mesh.

        Parameters
        ----------
        points : array-like of shape (n_points, 3), or Landmarks
            Coordinates in the units and the coordinate system of the mesh. Point ``t`` is template
            point ``t``. A row of NaN marks a point that is missing on this shape.
        mesh : Mesh, trimesh.Trimesh or (vertices, faces)
            The shape as it is given to the pipeline. Faces that are not sound are ignored.
        names : sequence of str, optional
            Name of each point. Leave it out for `Landmarks`, which have names.
        max_distance : float, default=0.2
            Largest allowed distance of a point from the surface, as a fraction of the largest
            extent of the mesh.

        Returns
        -------
        Correspondence
            One pair for each point that is not missing, with ``places``, ``coordinates`` and
            ``distance``.

        Raises
        ------
        CorrespondenceError
            If a point lies farther than ``max_distance`` from the surface, or the points as a whole
            lie off it. The message says whether a different unit or coordinate system would explain
            that; the points are never converted automatically.
        TypeError
            If ``mesh`` has another type, for instance if it is a path.
        MeshError
            If ``mesh`` has no sound face.

        Examples
        --------
        >>> from skfmap import Correspondence
        >>> triangle = [[0.0, 0, 0], [10, 0, 0], [0, 10, 0]], [[0, 1, 2]]
        >>> marks = Correspondence.from_points([[2, 3, 0.1]], triangle, names=["tip"])
        >>> marks
        Correspondence(n_pairs=1, n_symmetric_pairs=none, named)
        >>> marks.places.weights.round(2).tolist(), marks.distance.round(2).tolist()
        ([[0.5, 0.2, 0.3]], [0.1])
        """
        check_number(max_distance, "max_distance", low=0)
        if isinstance(points, Landmarks) and names is not None:
            raise CorrespondenceError("Landmarks already have names; leave out the argument names.")
        marks = points if isinstance(points, Landmarks) else Landmarks(points, names)
        on = mesh_arrays(mesh, marks.name)
        placed = np.flatnonzero(marks.placed)
        at = marks.points[placed]
        called = [marks.names[t] for t in placed]
        places, distance = put_on_surface(at, called, on, float(max_distance))
        unnamed = names is None and not isinstance(points, Landmarks)
        return cls(
            np.column_stack([places.vertices, placed]),
            n_vertices=len(on.vertices),
            places=places,
            names=None if unnamed else marks.names,
            coordinates=at,
            distance=distance,
        )

    @property
    def corners(self) -> IntArray:
        """Vertices of the pairs, of shape (n_pairs, 3) with ``places``, otherwise (n_pairs, 1)."""
        return self.pairs[:, :1] if self.places is None else self.places.corners

    @property
    def landmarks(self) -> Landmarks | None:
        """The points as measured; None without ``coordinates``.

        Template points without names are named by number, counted from 1.
        """
        if self.coordinates is None:
            return None
        numbers = self.pairs[:, 1]
        if self.names is None:
            return Landmarks(self.coordinates, [str(t + 1) for t in numbers])
        return Landmarks(self.coordinates, [self.names[t] for t in numbers])

    @property
    def known_names(self) -> tuple[str, ...]:
        """Names of the template points that the shape has; empty if template points are unnamed."""
        has = set(self.pairs[:, 1].tolist())
        return tuple(name for t, name in enumerate(self.names or ()) if t in has)

    @property
    def has_symmetric(self) -> bool:
        """Whether a symmetric answer is known."""
        return self.symmetric_pairs is not None

    def join(self, other: "Correspondence", *, symmetric: bool = False) -> JoinedPairs:
        """Join this shape (S_i) with another (S_0) on the template points that both have.

        Parameters
        ----------
        other : Correspondence
            Correspondence of S_0. Template points that are missing on either side drop out. If both
            have names, points are joined by name, and ``points`` of the result are numbered as in
            this correspondence.
        symmetric : bool
            Whether to join with the symmetric pairs of S_0 instead.

        Returns
        -------
        JoinedPairs
            Pairs in the order of this shape's pairs; empty if the two share no template point.

        Raises
        ------
        CorrespondenceError
            If ``symmetric`` is True and ``other`` has no symmetric answer, if only one of the two
            has names, or if they have no name in common.
        """
        pairs_0, weights_0, places_0 = other.pairs, other.weights, other.places
        if symmetric:
            if other.symmetric_pairs is None:
                raise CorrespondenceError(
                    "The correspondence of the reference has no symmetric answer. Give it "
                    "symmetric_pairs, or use a direct score."
                )
            pairs_0, weights_0, places_0 = other.symmetric_pairs, other.symmetric_weights, None
        pairs_0 = _numbered_as(self.names, other.names, pairs_0)
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
            self.pairs[rows_i, 0],
            pairs_0[rows_0, 0],
            self.pairs[rows_i, 1],
            weights[kept],
            None if self.places is None else self.places.take(rows_i),
            None if places_0 is None else places_0.take(rows_0),
        )

    def number_by(self, names: Sequence[str]) -> "Correspondence":
        """Return the correspondence with template points renumbered by a list of names.

        Parameters
        ----------
        names : sequence of str
            Unique names; the position of a name is the new number of its template point. Points
            whose names are not in the list drop out.

        Returns
        -------
        Correspondence
            The same pairs, numbered by ``names``.

        Raises
        ------
        CorrespondenceError
            If the correspondence has no names, or none of them is in the list.

        Examples
        --------
        >>> from skfmap import Correspondence
        >>> found = Correspondence([[10, 0], [25, 1]], names=["nose", "chin"])
        >>> found.number_by(["chin", "ear", "nose"]).pairs.tolist()
        [[10, 2], [25, 0]]
        """
        wanted = tuple(names)
        if wanted == self.names:
            return self
        pairs = _numbered_as(wanted, self.names, self.pairs)
        symmetric = self.symmetric_pairs
        if symmetric is not None:
            symmetric = _numbered_as(wanted, self.names, symmetric)
        return self._with(pairs, symmetric, wanted)

    def renumber(self, vertex_map: object) -> "Correspondence":
        """Return the correspondence after the vertices of the shape have been renumbered.

        Parameters
        ----------
        vertex_map : array-like of int, shape (n_vertices,)
            New index of each vertex, or -1 if it was removed, as `skfmap.repair_mesh` returns it.

        Returns
        -------
        Correspondence
            Pairs and symmetric pairs of the vertices that remain. A place between vertices is kept
            if at least half of its weight is at remaining vertices; its weights are then rescaled
            to sum to 1.

        Raises
        ------
        CorrespondenceError
            If ``vertex_map`` belongs to a mesh with another number of vertices, or holds a value
            below -1.
        TypeError
            If ``vertex_map`` is not a one-dimensional array of integers.

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
                f"vertex_map holds {new.min()}; the only negative value allowed is -1, for a "
                "removed vertex."
            )
        if self.n_vertices is not None and self.n_vertices != len(new):
            raise CorrespondenceError(
                f"vertex_map belongs to a mesh of {len(new)} vertices, but this correspondence was "
                f"made for a mesh of {self.n_vertices}."
            )
        check_index_range(self.pairs[:, 0], len(new), "The pairs")
        check_index_range(self.corners, len(new), "The places")
        places = None if self.places is None else _renumbered(self.places, new)
        vertices = new[self.pairs[:, 0]] if places is None else places.vertices
        symmetric = self.symmetric_pairs
        if symmetric is not None:
            check_index_range(symmetric[:, 0], len(new), "The symmetric pairs")
            symmetric = np.column_stack([new[symmetric[:, 0]], symmetric[:, 1]])
        # The new number of vertices is unknown: a mended mesh may have extra ones at its end.
        moved = np.column_stack([vertices, self.pairs[:, 1]])
        return self._with(moved, symmetric, self.names, places=places, n_vertices=None)

    def restrict(self, points: object) -> "Correspondence":
        """Return the correspondence restricted to some template points.

        Parameters
        ----------
        points : array-like of int or str
            Numbers or names of the template points to keep, for instance half of the landmarks.

        Returns
        -------
        Correspondence
            Pairs and symmetric pairs of those points.

        Raises
        ------
        TypeError
            If ``points`` holds anything but integers or names.
        CorrespondenceError
            If names are given and a template point of that name does not exist.
        """
        kept = as_array(points, "points", TypeError)
        if kept.size and all(isinstance(one, str) for one in kept.flat):
            kept = _numbers_of(kept.ravel().tolist(), self.names)
        if not np.issubdtype(kept.dtype, np.integer):
            raise TypeError(
                "points must hold numbers or names of template points; got "
                f"{type(points).__name__}."
            )
        pairs, symmetric = self.pairs, self.symmetric_pairs
        pairs = np.where(np.isin(pairs[:, 1:], kept), pairs, -1)
        if symmetric is not None:
            symmetric = np.where(np.isin(symmetric[:, 1:], kept), symmetric, -1)
        return self._with(pairs, symmetric, self.names)

    def _with(
        self,
        pairs: IntArray,
        symmetric: IntArray | None,
        names: tuple[str, ...] | None,
        **changes: Any,
    ) -> "Correspondence":
        """Return a copy with its pairs replaced row by row, dropping rows that hold -1."""
        rows = (pairs >= 0).all(axis=1)
        places = changes.get("places", self.places)
        more: dict[str, Any] = {
            "weights": self.weights,
            "coordinates": self.coordinates,
            "distance": self.distance,
        }
        kept = {what: None if each is None else each[rows] for what, each in more.items()}
        if symmetric is not None:
            sym_rows, sym_weights = (symmetric >= 0).all(axis=1), self.symmetric_weights
            symmetric = symmetric[sym_rows]
            kept["symmetric_weights"] = None if sym_weights is None else sym_weights[sym_rows]
        return Correspondence(
            pairs[rows],
            symmetric,
            **kept,
            n_vertices=changes.get("n_vertices", self.n_vertices),
            places=None if places is None else places.take(rows),
            names=names,
        )


# Fields that pickles of 0.1.0 do not have.
_MORE = ("places", "names", "coordinates", "distance")
# Largest deviation from 1 of the sum of a place's weights.
_ROUNDING = 1e-6


def _renumbered(places: SurfacePlaces, new: IntArray) -> SurfacePlaces:
    """Return places on renumbered vertices; corners are -1 where most of a place was removed."""
    corners = new[places.corners]
    left = np.where(corners >= 0, places.weights, 0.0)
    whole = left.sum(axis=1, keepdims=True)
    moved = SurfacePlaces(corners, np.where(whole < 1 - _ROUNDING, left / _above_0(whole), left))
    # A removed corner has no weight, but its entry still has to be a valid vertex.
    corners = np.where(corners >= 0, corners, moved.vertices[:, None])
    return SurfacePlaces(np.where(whole >= 0.5, corners, -1), moved.weights)


def _above_0(values: FloatArray) -> FloatArray:
    return np.where(values > 0, values, 1.0)


def _numbered_as(
    names: tuple[str, ...] | None, names_0: tuple[str, ...] | None, pairs_0: IntArray
) -> IntArray:
    """Return pairs with the points in ``names_0`` numbered as in ``names``; -1 if not there."""
    if names == names_0:
        return pairs_0
    if names is None or names_0 is None:
        told = _told([*(names or ()), *(names_0 or ())])
        raise CorrespondenceError(
            f"One of two correspondences names its template points ({told}) and the other does "
            "not. Give names to both, or to neither."
        )
    if not set(names) & set(names_0):
        raise CorrespondenceError(
            f"Two correspondences have no template point name in common: {_told(names)} against "
            f"{_told(names_0)}. Check the spelling of the names."
        )
    number = {name: t for t, name in enumerate(names)}
    new = np.array([number.get(name, -1) for name in names_0], dtype=np.int64)
    return np.column_stack([pairs_0[:, 0], new[pairs_0[:, 1]]])


def _told(names: Sequence[str]) -> str:
    return ", ".join(names[:_MOST_TOLD]) + (", ..." if len(names) > _MOST_TOLD else "")


# Largest number of names listed in a message.
_MOST_TOLD = 60


def _numbers_of(chosen: list[str], names: tuple[str, ...] | None) -> IntArray:
    if names is None:
        raise CorrespondenceError(
            "The template points have no names. Select them by number, or give names to the "
            "Correspondence."
        )
    if strange := [name for name in chosen if name not in names]:
        raise CorrespondenceError(
            f"No template point is called {_told(strange)}. The names are {_told(names)}."
        )
    return np.array([names.index(name) for name in chosen], dtype=np.int64)


def _correspondence(
    pairs: IntArray,
    symmetric: IntArray | None,
    weights: FloatArray | None,
    symmetric_weights: FloatArray | None,
    n_vertices: int | None,
    more: dict[str, Any] | None = None,
) -> Correspondence:
    return Correspondence(
        pairs,
        symmetric,
        weights=weights,
        symmetric_weights=symmetric_weights,
        n_vertices=n_vertices,
        **(more or {}),
    )


def _check_places(places: Any, pairs: IntArray) -> SurfacePlaces | None:
    if places is None:
        return None
    if not isinstance(places, (tuple, list)) or len(places) != 2:
        raise CorrespondenceError("places must be a pair of arrays, (corners, weights).")
    shape = (len(pairs), 3)
    corners = as_array(places[0], "The corners of places", CorrespondenceError)
    if corners.shape != shape or not np.issubdtype(corners.dtype, np.integer):
        raise CorrespondenceError(
            f"The corners of places must be integers of shape {shape}, three for each pair; got "
            f"{corners.dtype} of shape {corners.shape}."
        )
    if corners.min(initial=0) < 0:
        raise CorrespondenceError(
            f"The corners of places hold the negative index {corners.min()}; vertices are counted "
            "from 0."
        )
    weights = as_reals(places[1], "The weights of places", CorrespondenceError)
    if weights.shape != shape or not (weights >= 0).all():
        raise CorrespondenceError(
            f"The weights of places must be non-negative, of shape {shape}; got {weights.shape}."
        )
    if not (np.abs(weights.sum(axis=1) - 1) <= _ROUNDING).all():
        raise CorrespondenceError("The weights of each place must sum to 1.")
    at_vertex = np.where(corners == pairs[:, :1], weights, -1.0).max(axis=1, initial=-1.0)
    if (at_vertex < weights.max(axis=1, initial=0.0)).any():
        wrong = int(np.flatnonzero(at_vertex < weights.max(axis=1))[0])
        raise CorrespondenceError(
            f"Pair {wrong} is at vertex {pairs[wrong, 0]}, but its place has its largest weight at "
            f"another corner: corners {corners[wrong].tolist()}, weights {weights[wrong].tolist()}."
        )
    return SurfacePlaces(read_only(np.array(corners, dtype=np.int64)), read_only(weights))


def _check_names(names: Any, pairs: IntArray, symmetric: IntArray | None) -> tuple[str, ...] | None:
    if names is None:
        return None
    is_one = isinstance(names, str) or not hasattr(names, "__iter__")
    if is_one or not all(isinstance(name, str) for name in names):
        raise CorrespondenceError(f"names must be a sequence of strings; got {names!r}.")
    out = tuple(str(name) for name in names)
    if twice := sorted({name for name in out if out.count(name) > 1}):
        raise CorrespondenceError(
            f"Several template points have the same name: {', '.join(twice)}. Names must be unique."
        )
    for each in (pairs, symmetric):
        if each is not None and each[:, 1].max(initial=-1) >= len(out):
            raise CorrespondenceError(
                f"There are {len(out)} names, but the pairs contain template point "
                f"{each[:, 1].max()}. Points are counted from 0."
            )
    return out


def _check_once(points: IntArray) -> None:
    numbers, counts = np.unique(points, return_counts=True)
    if (counts > 1).any():
        raise CorrespondenceError(
            f"Template point {numbers[counts > 1][0]} has {counts.max()} pairs with coordinates, "
            "but a point is measured only once on a shape. Give one pair for each point, or leave "
            "out the coordinates."
        )


def _check_rows(values: Any, shape: tuple[int, ...], who: str) -> FloatArray | None:
    if values is None:
        return None
    out = as_reals(values, who, CorrespondenceError)
    if out.shape != shape or not np.isfinite(out).all():
        raise CorrespondenceError(
            f"{who} must be finite, of shape {shape}, one row per pair; got shape {out.shape}."
        )
    return read_only(out)


def _enumerate(values: object, who: str) -> tuple[IntArray, int]:
    """Return rows [position, value] of a 1-D integer array, and the length of the array.

    Masked entries and entries equal to -1 are left out.
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
            "The symmetric answer must have the same size as the direct one; got "
            f"{other} and {one}."
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
    """Return the share of each pair in the total weight of its template point."""
    own = _ones_or(weights, len(pairs))
    if len(pairs) == 0:
        return own
    _, point = np.unique(pairs[:, 1], return_inverse=True)  # numbers may have gaps
    total = np.bincount(point, own)[point]
    return np.asarray(own / np.where(total > 0, total, 1.0))


def _ones_or(weights: FloatArray | None, n: int) -> FloatArray:
    return np.ones(n) if weights is None else weights
