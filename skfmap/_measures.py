"""Measures of match quality: geodesic errors, singular values, coverage, continuity.

All lengths are in units of sqrt(area) of the reference. There are three kinds of errors:
``"direct"`` accepts no symmetric answer; ``"consistent"`` takes the better of the direct and the
symmetric answer once for the whole map; ``"per_vertex"`` takes the better at each pair (the paper's
"symmetric correspondences are considered correct").
"""

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skfmap._tools.caching import MemoryLike, cached
from skfmap._tools.parallel import map_shapes
from skfmap._tools.types import (
    DistanceMethod,
    ErrorKind,
    FloatArray,
    IntArray,
)
from skfmap._tools.validation import (
    LARGEST_AREA,
    SMALLEST_AREA,
    as_array,
    as_reals,
    check_choice,
    check_index_range,
    label,
)
from skfmap.exceptions import CorrespondenceError, MeshError
from skfmap.geometry.faults import count_components, edges_of, unreferenced_vertices
from skfmap.geometry.geodesics import DISTANCES
from skfmap.shapes import Correspondence, Mesh, SpectralShape, SurfacePlaces

__all__ = [
    "ERROR_KINDS",
    "GeodesicDistances",
    "PairErrors",
    "PlaceDistances",
    "continuity",
    "coverage",
    "error_curve",
    "geodesic_error",
    "mean_over_shapes",
    "pair_errors",
    "reference_distances",
    "singular_value_profile",
]

ERROR_KINDS: tuple[ErrorKind, ...] = ("direct", "consistent", "per_vertex")

# Fewer distances than this are computed faster (2 s by the heat method) than worker processes
# start.
_FEW = 5_000_000


class GeodesicDistances:
    """Geodesic distances on one mesh; each row is computed once, on first use.

    Parameters
    ----------
    mesh : Mesh
        The mesh, usually that of the reference.
    method : {"heat", "exact", "dijkstra"}, default="heat"
        ``"heat"`` (potpourri3d, clipped between straight lines and paths along edges) takes 15 s on
        one core for all rows of a mesh of 5,000 vertices, and differs from exact distances by 1.4 %
        on average (1 to 2.5 % below 0.1). ``"exact"`` (libigl) takes half an hour. ``"dijkstra"``,
        along edges, is 6 to 14 % too long.
    memory : str or joblib.Memory, optional
        Where rows are cached, by mesh content.
    n_jobs : int, optional
        Number of blocks of rows computed in parallel; see joblib.

    Examples
    --------
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.metrics import GeodesicDistances
    >>> distances = GeodesicDistances(make_sphere(), method="exact")
    >>> distances.between([0], [3]).round(1).item()  # half a great circle, over sqrt(4 pi)
    0.9
    """

    def __init__(
        self,
        mesh: Mesh,
        method: DistanceMethod = "heat",
        *,
        memory: MemoryLike = None,
        n_jobs: int | None = None,
    ) -> None:
        self.mesh = mesh
        self.method = check_choice(method, "method", DISTANCES)
        self.memory = memory
        self.n_jobs = n_jobs
        self._row_of = np.full(mesh.n_vertices, -1)
        self._rows = np.empty((0, mesh.n_vertices), dtype=np.float32)

    def between(self, points: object, sources: object) -> FloatArray:
        """Return the distance between each point and its source, in units of sqrt(area).

        Parameters
        ----------
        points, sources : array-like of int, shape (n,)
            Vertices, paired by position. Rows are computed for the distinct sources.

        Returns
        -------
        distances : ndarray of shape (n,)
            Distances divided by sqrt(area).

        Raises
        ------
        ValueError
            If an index is not that of a vertex, or the numbers of points and sources differ.
        MeshError
            If distances are not defined on the mesh, because it has several components, vertices
            without faces, or no area.
        """
        points, sources = self._vertices(points, "points"), self._vertices(sources, "sources")
        if len(points) != len(sources):
            raise ValueError(
                f"Give one source for each point; got {len(points)} points and {len(sources)} "
                "sources."
            )
        rows = self.rows(np.unique(sources))
        return rows[np.searchsorted(np.unique(sources), sources), points].astype(np.float64)

    def between_places(self, points: SurfacePlaces, sources: SurfacePlaces) -> FloatArray:
        """Return the distance between each place and its source, in units of sqrt(area).

        Distances are interpolated from those between the corners of the two faces, corrected so
        that a place is at distance 0 from itself. No distance is shorter than the straight line.

        Parameters
        ----------
        points, sources : SurfacePlaces
            Places, paired by position. Rows are computed for the corners of the sources.

        Returns
        -------
        distances : ndarray of shape (n,)
            Distances divided by sqrt(area).
        """
        straight = np.linalg.norm(self._at(points) - self._at(sources), axis=1)
        along = self._mean_between(points, sources)
        # The interpolated distance of a place from itself, which should be 0.
        own = self._mean_between(sources, sources)
        touch = (points.corners[:, :, None] == sources.corners[:, None, :]) & (
            (points.weights[:, :, None] > 0) & (sources.weights[:, None, :] > 0)
        )
        far = np.where(touch.any(axis=(1, 2)), along - own, along)
        return np.asarray(np.maximum(straight, far))

    def _mean_between(self, points: SurfacePlaces, sources: SurfacePlaces) -> FloatArray:
        """Return distances between places, interpolated from their corners."""
        mean = np.zeros(len(points.corners))
        for i in range(3):
            for j in range(3):
                weight = points.weights[:, i] * sources.weights[:, j]
                some = np.flatnonzero(weight > 0)
                distances = self.between(points.corners[some, i], sources.corners[some, j])
                mean[some] += weight[some] * distances
        return mean

    def _at(self, places: SurfacePlaces) -> FloatArray:
        """Return coordinates at unit area, shape (n, 3)."""
        at = self.mesh.vertices[places.corners.ravel()] / np.sqrt(self.mesh.area)
        return places.means(at)

    def rows(self, sources: IntArray) -> Any:
        """Return the distances from distinct sources to all vertices.

        The result is a float32 array of shape (n_sources, n_vertices).
        """
        sources = self._vertices(sources, "sources")
        with _LOCK:
            missing = sources[self._row_of[sources] < 0]
        # Computed without the lock: on a cluster, a thread that waits for its blocks runs other
        # tasks meanwhile, and these may need distances too.
        computed = self._compute(missing) if len(missing) else self._rows[:0]
        with _LOCK:
            if (self._row_of[missing] < 0).any():
                self._row_of[missing] = len(self._rows) + np.arange(len(missing))
                self._rows = np.concatenate([self._rows, computed])
            return self._rows[self._row_of[sources]]

    @property
    def n_vertices(self) -> int:
        """Number of vertices between which distances are given."""
        return self.mesh.n_vertices

    def _vertices(self, numbers: object, who: str) -> IntArray:
        """Return checked vertex indices: compiled code would read outside the arrays otherwise."""
        array = as_array(numbers, who)
        if array.size == 0:
            return np.empty(0, dtype=np.int64)
        if array.ndim != 1 or not np.issubdtype(array.dtype, np.integer):
            raise ValueError(
                f"{who} must be a 1-D array of vertex indices; got {array.dtype} of shape "
                f"{array.shape}."
            )
        check_index_range(array, self.n_vertices, f"The {who}", ValueError)
        return array.astype(np.int64)

    def _compute(self, sources: IntArray) -> Any:
        _check_surface(self.mesh)
        compute = cached(_distance_block, self.memory)
        blocks = np.array_split(sources, max(1, len(sources) // 500))
        arguments = (
            (compute, self.mesh, self.mesh.content_hash, self.method, block) for block in blocks
        )
        few = self.method != "exact" and len(sources) * self.mesh.n_vertices < _FEW
        n_jobs = None if few else self.n_jobs
        return np.concatenate(map_shapes(_call, arguments, n_jobs=n_jobs, verbose=0))


class PlaceDistances(GeodesicDistances):
    """Distances between the vertices of a given mesh, measured on its working mesh.

    The prolongation gives the place of each vertex on the working mesh. Distances are interpolated
    from those between the corners of the two faces; between faces that touch they are straight
    lines.

    Parameters
    ----------
    shape : SpectralShape
        The shape.
    within : GeodesicDistances
        Distances on its working mesh.
    """

    def __init__(self, shape: SpectralShape, within: GeodesicDistances) -> None:
        self.shape, self.within = shape, within
        self.mesh = shape.mesh

    @property
    def n_vertices(self) -> int:
        """Number of vertices of the given mesh."""
        return self.shape.n_given

    def between(self, points: object, sources: object) -> FloatArray:
        """Return the distance between each point and its source; NaN for a vertex without a place.

        Points and sources are vertices of the given mesh.
        """
        points, sources = self._vertices(points, "points"), self._vertices(sources, "sources")
        if self.shape.prolongation is None:
            return self.within.between(points, sources)
        (faces_a, weights_a), (faces_b, weights_b) = (
            self.shape.places_of(one) for one in (points, sources)
        )
        at_a, at_b = (
            np.einsum("nc,ncd->nd", weights, self.shape.vertices[corners])
            for corners, weights in ((faces_a, weights_a), (faces_b, weights_b))
        )
        straight = np.linalg.norm(at_a - at_b, axis=1)
        touch = (faces_a[:, :, None] == faces_b[:, None, :]).any(axis=(1, 2))
        far = np.flatnonzero(~touch)
        along = np.zeros(len(far))
        for i in range(3):
            for j in range(3):
                weight = weights_a[far, i] * weights_b[far, j]
                along += weight * self.within.between(faces_a[far, i], faces_b[far, j])
        straight[far] = np.maximum(straight[far], along)
        return np.where(self.shape.placed(points) & self.shape.placed(sources), straight, np.nan)

    def _at(self, places: SurfacePlaces) -> FloatArray:
        """Return coordinates on the working mesh at unit area, shape (n, 3)."""
        return self.shape.vertices_at(places.vertices, places)

    def rows(self, sources: IntArray) -> Any:
        """Compute in advance the rows that distances from these sources need."""
        corners = np.unique(self.shape.places_of(self._vertices(sources, "sources"))[0])
        return self.within.rows(corners)


def _check_surface(mesh: Mesh) -> None:
    """Raise if distances would be infinite, or the libraries would fail or return 0."""
    whole = len(unreferenced_vertices(mesh.faces, mesh.n_vertices)) == 0
    if (
        not whole
        or count_components(mesh.faces, mesh.n_vertices) > 1
        or not SMALLEST_AREA < mesh.area < LARGEST_AREA
    ):
        raise MeshError(
            f"Distances are not defined on {label(mesh.name)}: it has several components, vertices "
            "that no face uses, or no area. check_mesh says which, and repair_mesh mends it."
        )


def _call(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)


def _distance_block(mesh: Mesh, content_hash: str, method: str, sources: IntArray) -> Any:  # noqa: ARG001
    return DISTANCES[method](mesh.vertices / np.sqrt(mesh.area), mesh.faces, sources).astype(
        np.float32
    )


# Rows are shared by all threads of the process.
_LOCK = threading.RLock()
_RECENT: OrderedDict[tuple[str, str], GeodesicDistances] = OrderedDict()


def reference_distances(
    mesh: Mesh,
    method: DistanceMethod = "heat",
    *,
    memory: MemoryLike = None,
    n_jobs: int | None = None,
) -> GeodesicDistances:
    """Return the distances on a mesh, shared by all scores on it in this process.

    Distances of the two meshes used last are kept.
    """
    key = (mesh.content_hash, method)
    with _LOCK:
        if key not in _RECENT:
            _RECENT[key] = GeodesicDistances(mesh, method)
            while len(_RECENT) > 2:
                _RECENT.popitem(last=False)
        _RECENT.move_to_end(key)
        _RECENT[key].memory, _RECENT[key].n_jobs = memory, n_jobs
        return _RECENT[key]


@dataclass(frozen=True, eq=False)
class PairErrors:
    """Errors of one match at each pair of a vertex of S_i and its template point.

    Attributes
    ----------
    vertices : ndarray of int, shape (n_pairs,)
        Vertex of S_i in each pair.
    direct : ndarray of shape (n_pairs,)
        Distance between the matched and the true vertex of S_0.
    symmetric : ndarray of shape (n_pairs,) or None
        Distance between the matched vertex and the symmetric counterpart of the true one; NaN where
        the counterpart is unknown, None if no counterpart is known.
    weights : ndarray of shape (n_pairs,)
        Weight of each pair on S_i; 1 for plain pairs.
    """

    vertices: IntArray
    direct: FloatArray
    symmetric: FloatArray | None
    weights: FloatArray

    def of_kind(self, kind: ErrorKind) -> FloatArray:
        """Return the errors of one kind, shape (n_pairs,)."""
        check_choice(kind, "kind", ERROR_KINDS)
        if kind == "direct" or len(self.direct) == 0:
            return self.direct
        if self.symmetric is None:
            raise CorrespondenceError(
                f"{kind} errors need the symmetric answer. Give symmetric_pairs (.sym.vts files) "
                "to the Correspondence of the reference, or use kind='direct'."
            )
        known = ~np.isnan(self.symmetric)  # elsewhere there is only the direct answer
        if kind == "per_vertex":
            return np.fmin(self.direct, self.symmetric)
        if not self.weights[known].any():
            return self.direct
        direct, symmetric = (
            np.average(e[known], weights=self.weights[known]) for e in (self.direct, self.symmetric)
        )
        return self.direct if direct <= symmetric else np.where(known, self.symmetric, self.direct)

    def mean(self, kind: ErrorKind = "direct") -> float:
        """Return the mean error of one kind; NaN for a shape without pairs, which was left out."""
        if not self.weights.any():
            return float("nan")
        return float(np.average(self.of_kind(kind), weights=self.weights))


_HOW = {
    Correspondence: "Create one with Correspondence.from_vertices or a similar method.",
    GeodesicDistances: "Create it with GeodesicDistances(mesh) for the reference's mesh.",
}


def pair_errors(
    p2p: IntArray,
    correspondence_i: Correspondence,
    correspondence_0: Correspondence,
    distances: GeodesicDistances,
) -> PairErrors:
    """Return the errors of a point-to-point map at every pair that S_i and S_0 share.

    Parameters
    ----------
    p2p : ndarray of int, shape (n_vertices_i,)
        Vertex of S_0 for each vertex of S_i.
    correspondence_i, correspondence_0 : Correspondence
        Where the two shapes lie on the template.
    distances : GeodesicDistances
        Distances on S_0.

    Returns
    -------
    PairErrors
        One entry for each pair of S_i whose template point is also on S_0. If several vertices of
        S_0 are at one template point, their errors are averaged. For a place between vertices, the
        corners of its face are mapped and combined with the same weights, and
        `GeodesicDistances.between_places` measures the distance.

    Raises
    ------
    CorrespondenceError
        If the shapes share no pair.
    TypeError
        If an argument has the wrong type.
    """
    for given, kind in (
        (correspondence_i, Correspondence),
        (correspondence_0, Correspondence),
        (distances, GeodesicDistances),
    ):
        if not isinstance(given, kind):
            raise TypeError(f"Expected a {kind.__name__}; got {type(given).__name__}. {_HOW[kind]}")
    symmetric_0 = correspondence_0.symmetric_pairs
    known = [correspondence_0.pairs[:, 0], correspondence_0.corners]
    for vertices in known if symmetric_0 is None else [*known, symmetric_0[:, 0]]:
        check_index_range(vertices, distances.n_vertices, "The pairs of the reference")
    p2p = _check_p2p(p2p, distances.n_vertices, int(correspondence_i.corners.max(initial=-1)) + 1)
    keys, direct, weights = _mean_by_pair(
        p2p, correspondence_i, correspondence_0, distances, symmetric=False
    )
    if len(keys) == 0:
        raise CorrespondenceError(
            "The shape and the reference share no template point, so there is nothing to score."
        )
    if not correspondence_0.has_symmetric:
        return PairErrors(keys[:, 0], direct, None, weights)
    sym_keys, symmetric, _ = _mean_by_pair(
        p2p, correspondence_i, correspondence_0, distances, symmetric=True
    )
    common = {tuple(key): j for j, key in enumerate(sym_keys.tolist())}
    rows = np.array([common.get(tuple(key), -1) for key in keys.tolist()])
    if (rows < 0).all():
        return PairErrors(keys[:, 0], direct, None, weights)
    return PairErrors(keys[:, 0], direct, np.where(rows < 0, np.nan, symmetric[rows]), weights)


def _check_p2p(p2p: object, n_vertices_0: int, n_needed: int) -> IntArray:
    """Return a point-to-point map, checked to hold vertices of the reference only."""
    array = np.asarray(p2p)
    if array.ndim != 1 or not np.issubdtype(array.dtype, np.integer):
        raise TypeError(
            f"p2p must be a 1-D array of integers; got {array.dtype} of shape {array.shape}."
        )
    if len(array) < n_needed:
        raise ValueError(
            f"p2p has length {len(array)}, but the correspondence refers to vertex {n_needed - 1}."
        )
    check_index_range(array, n_vertices_0, "The entries of p2p", ValueError)
    return array


def _mean_by_pair(
    p2p: IntArray,
    own: Correspondence,
    other: Correspondence,
    distances: GeodesicDistances,
    *,
    symmetric: bool,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the distinct (vertex, template point) rows, with their mean errors and weights."""
    joined, p2p = own.join(other, symmetric=symmetric), np.asarray(p2p)
    rows = np.column_stack([joined.vertices_i, joined.points])
    keys, inverse = np.unique(rows, axis=0, return_inverse=True)
    if joined.places_i is None and joined.places_0 is None:
        errors = distances.between(p2p[joined.vertices_i], joined.vertices_0)
    else:
        at = joined.places_i or SurfacePlaces.at_vertices(joined.vertices_i)
        to = joined.places_0 or SurfacePlaces.at_vertices(joined.vertices_0)
        errors = distances.between_places(SurfacePlaces(p2p[at.corners], at.weights), to)
    weights = np.bincount(inverse.ravel(), joined.weights, minlength=len(keys)).astype(np.float64)
    sums = np.bincount(inverse.ravel(), joined.weights * errors, minlength=len(keys))
    return keys, sums / np.maximum(weights, 1e-300), weights


def geodesic_error(
    p2p: IntArray,
    correspondence_i: Correspondence,
    correspondence_0: Correspondence,
    distances: GeodesicDistances,
    *,
    kind: ErrorKind = "direct",
) -> float:
    """Return the mean geodesic error of a point-to-point map, in units of sqrt(area) of S_0.

    Parameters
    ----------
    p2p : ndarray of int, shape (n_vertices_i,)
        Vertex of S_0 for each vertex of S_i.
    correspondence_i, correspondence_0 : Correspondence
        Where the two shapes lie on the template.
    distances : GeodesicDistances
        Distances on S_0.
    kind : {"direct", "consistent", "per_vertex"}, default="direct"
        How symmetric answers count: not at all, if they are better for the whole map, or at each
        pair where they are better.

    Returns
    -------
    float
        The mean over the pairs.

    Raises
    ------
    CorrespondenceError
        If the shapes share no pair, or ``kind`` needs a symmetric answer and there is none.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap import Correspondence
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.metrics import GeodesicDistances, geodesic_error
    >>> sphere = make_sphere(n_subdivisions=2)
    >>> truth = Correspondence.from_vertices(np.arange(66))
    >>> geodesic_error(np.arange(66), truth, truth, GeodesicDistances(sphere))
    0.0
    """
    return pair_errors(p2p, correspondence_i, correspondence_0, distances).mean(kind)


def error_curve(
    errors: FloatArray, thresholds: FloatArray, weights: FloatArray | None = None
) -> FloatArray:
    """Return the fraction of pairs whose error is at most each threshold.

    This is the cumulative curve of figure 5, right, in the paper.

    Parameters
    ----------
    errors : array-like of shape (n_pairs,)
        Errors, without NaN.
    thresholds : array-like of shape (n_thresholds,)
        Thresholds at which the curve is evaluated.
    weights : array-like of shape (n_pairs,), optional
        Weight of each pair; 1 by default.

    Returns
    -------
    ndarray of shape (n_thresholds,)
        Fractions between 0 and 1.

    Raises
    ------
    ValueError
        If there are no errors, one of them is NaN, or the weights are invalid.

    Examples
    --------
    >>> from skfmap.metrics import error_curve
    >>> error_curve([0.02, 0.3, 0.07], [0.05, 0.1]).round(2).tolist()
    [0.33, 0.67]
    """
    errors, thresholds = as_reals(errors, "errors"), as_reals(thresholds, "thresholds")
    share = np.ones(len(errors)) if weights is None else as_reals(weights, "weights")
    if errors.ndim != 1 or errors.size == 0 or np.isnan(errors).any():
        raise ValueError(
            f"errors must be one-dimensional, with at least one error and no NaN; got {errors}."
        )
    if share.shape != errors.shape or not (share >= 0).all() or not 0 < share.sum() < np.inf:
        raise ValueError(
            f"weights must be {len(errors)} non-negative numbers, not all zero; got {share}."
        )
    order = np.argsort(errors, kind="stable")
    cumulative = np.concatenate([[0.0], np.cumsum(share[order])]) / share.sum()
    return np.asarray(cumulative[np.searchsorted(errors[order], thresholds, side="right")])


def singular_value_profile(X: FloatArray, C: FloatArray, thresholds: FloatArray) -> FloatArray:
    """Return the fraction of singular values of X - C that are at most each threshold.

    This is the curve of figure 3, right, in the paper.
    """
    return error_curve(np.asarray(np.linalg.svd(X - C, compute_uv=False)), thresholds)


def coverage(p2p: IntArray, mass_0: FloatArray) -> float:
    """Return the fraction of the area of S_0 at vertices that the point-to-point map reaches."""
    mass_0 = as_reals(mass_0, "mass_0")
    return float(mass_0[np.unique(_check_p2p(p2p, len(mass_0), 0))].sum() / mass_0.sum())


def continuity(p2p: IntArray, mesh_i: Mesh, distances: GeodesicDistances) -> float:
    """Return the mean stretch of the edges of S_i under a point-to-point map.

    The stretch of an edge is the distance between the images of its ends divided by its length,
    both in units of sqrt(area).
    """
    edges = edges_of(mesh_i.faces)
    ends = mesh_i.vertices[edges]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / np.sqrt(mesh_i.area)
    images = _check_p2p(p2p, distances.mesh.n_vertices, mesh_i.n_vertices)[edges]
    return float(np.mean(distances.between(images[:, 0], images[:, 1]) / lengths))


def mean_over_shapes(
    means: Sequence[float], weights: Sequence[float] | FloatArray | None = None
) -> float:
    """Return the weighted mean of the shapes' errors, without shapes that were left out (NaN)."""
    errors = np.asarray(means, dtype=np.float64)
    share = np.ones(len(errors)) if weights is None else np.asarray(weights, dtype=np.float64)
    known = ~np.isnan(errors) & (share > 0)
    return float(np.average(errors[known], weights=share[known])) if known.any() else float("nan")
