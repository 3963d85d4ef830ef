"""How good a match is: geodesic errors, equation (5), singular values, coverage, continuity.

All lengths are in units of sqrt(area) of the reference. Errors come in three kinds: ``"direct"``
forgives nothing; ``"consistent"`` takes the better of the direct and the symmetric answer once for
the whole map; ``"per_vertex"`` takes the better at each pair (the paper's "symmetric
correspondences are considered correct").
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

# Distances that are computed in less time (2 s by the heat method) than other processes take to
# start.
_FEW = 5_000_000


class GeodesicDistances:
    """Distances on one mesh, each row computed once, when it is first asked for.

    Parameters
    ----------
    mesh : Mesh
        Usually the reference.
    method : {"heat", "exact", "dijkstra"}, default="heat"
        ``"heat"`` (potpourri3d, kept between straight lines and edge paths) takes 15 s of one core
        for all rows of a mesh of 5,000 vertices and differs from exact distances by 1.4 % on
        average (1 to 2.5 % below 0.1); ``"exact"`` (libigl) takes half an hour; ``"dijkstra"``
        along edges reads 6 to 14 % high.
    memory : str or joblib.Memory, optional
        Where rows are cached, by mesh content.
    n_jobs : int, optional
        Blocks of rows computed at a time; see joblib.

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
        """Return the distance of each point from the source beside it, in units of sqrt(area).

        Parameters
        ----------
        points, sources : array-like of int, shape (n,)
            Vertices. Rows are computed for the distinct sources.

        Returns
        -------
        distances : ndarray of shape (n,)
            Distances over sqrt(area).

        Raises
        ------
        ValueError
            If a number is no vertex, or there are not as many points as sources.
        MeshError
            If no distances are defined on the mesh: several components, vertices without faces, no
            area.
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
        """Return the distance of each place from the source beside it, in units of sqrt(area).

        Distances between the corners of two faces are interpolated, or those of places whose faces
        touch are straight lines: a place is at distance 0 from itself. None is shorter than a
        straight line.

        Parameters
        ----------
        points, sources : SurfacePlaces
            Places, the same number of each. Rows are computed for the corners of the sources.

        Returns
        -------
        distances : ndarray of shape (n,)
            Distances over sqrt(area).
        """
        straight = np.linalg.norm(self._at(points) - self._at(sources), axis=1)
        along = self._mean_between(points, sources)
        # That of a place from itself, as corners tell it.
        own = self._mean_between(sources, sources)
        touch = (points.corners[:, :, None] == sources.corners[:, None, :]) & (
            (points.weights[:, :, None] > 0) & (sources.weights[:, None, :] > 0)
        )
        far = np.where(touch.any(axis=(1, 2)), along - own, along)
        return np.asarray(np.maximum(straight, far))

    def _mean_between(self, points: SurfacePlaces, sources: SurfacePlaces) -> FloatArray:
        """Return mean distances between the corners of places."""
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
        """Return distances from distinct sources to all vertices, as float32.

        The array has shape (n_sources, n_vertices).
        """
        sources = self._vertices(sources, "sources")
        with _LOCK:
            missing = sources[self._row_of[sources] < 0]
        # Not under the lock: on a cluster, a thread that waits for its blocks takes on other tasks,
        # which may ask too.
        computed = self._compute(missing) if len(missing) else self._rows[:0]
        with _LOCK:
            if (self._row_of[missing] < 0).any():
                self._row_of[missing] = len(self._rows) + np.arange(len(missing))
                self._rows = np.concatenate([self._rows, computed])
            return self._rows[self._row_of[sources]]

    @property
    def n_vertices(self) -> int:
        """Number of vertices that there are distances between."""
        return self.mesh.n_vertices

    def _vertices(self, numbers: object, who: str) -> IntArray:
        """Return vertex numbers: what lies beneath reads whatever memory a wrong one leads to."""
        array = as_array(numbers, who)
        if array.size == 0:
            return np.empty(0, dtype=np.int64)
        if array.ndim != 1 or not np.issubdtype(array.dtype, np.integer):
            raise ValueError(
                f"{who} must be a 1-D array of vertex numbers; got {array.dtype} of shape "
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

    Each vertex is at the place that the prolongation says: distances between the corners of two
    faces are interpolated, and those of places whose faces touch are straight lines.

    Parameters
    ----------
    shape : SpectralShape
        The shape.
    within : GeodesicDistances
        On its working mesh.
    """

    def __init__(self, shape: SpectralShape, within: GeodesicDistances) -> None:
        self.shape, self.within = shape, within
        self.mesh = shape.mesh

    @property
    def n_vertices(self) -> int:
        """Number of vertices of the given mesh."""
        return self.shape.n_given

    def between(self, points: object, sources: object) -> FloatArray:
        """Return the distance of each given vertex from the one beside it; NaN without a place."""
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
        """Compute what the distances of all vertices from the sources are made of, in advance."""
        corners = np.unique(self.shape.places_of(self._vertices(sources, "sources"))[0])
        return self.within.rows(corners)


def _check_surface(mesh: Mesh) -> None:
    """Raise where distances would be infinite, or the libraries beneath would fail or answer 0."""
    whole = len(unreferenced_vertices(mesh.faces, mesh.n_vertices)) == 0
    if (
        not whole
        or count_components(mesh.faces, mesh.n_vertices) > 1
        or not SMALLEST_AREA < mesh.area < LARGEST_AREA
    ):
        raise MeshError(
            f"No distances are defined on {label(mesh.name)}: it has several components, vertices "
            "that no face uses, or no area. check_mesh says which, repair_mesh mends it."
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

    The two latest meshes are kept.
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
        Vertex of S_i.
    direct : ndarray of shape (n_pairs,)
        Distance of the match from the true vertex of S_0.
    symmetric : ndarray of shape (n_pairs,) or None
        Distance from the symmetric counterpart of the true vertex; NaN where unknown, None if
        nowhere known.
    weights : ndarray of shape (n_pairs,)
        Weight of the pair on S_i; 1 for plain pairs.
    """

    vertices: IntArray
    direct: FloatArray
    symmetric: FloatArray | None
    weights: FloatArray

    def of_kind(self, kind: ErrorKind) -> FloatArray:
        """Return the errors as ``kind`` counts them, shape (n_pairs,)."""
        check_choice(kind, "kind", ERROR_KINDS)
        if kind == "direct" or len(self.direct) == 0:
            return self.direct
        if self.symmetric is None:
            raise CorrespondenceError(
                f"{kind} errors need the symmetric answer; give the reference's Correspondence "
                "symmetric_pairs (.sym.vts files), or use kind='direct'."
            )
        known = ~np.isnan(self.symmetric)  # elsewhere the direct answer is the only one
        if kind == "per_vertex":
            return np.fmin(self.direct, self.symmetric)
        if not self.weights[known].any():
            return self.direct
        direct, symmetric = (
            np.average(e[known], weights=self.weights[known]) for e in (self.direct, self.symmetric)
        )
        return self.direct if direct <= symmetric else np.where(known, self.symmetric, self.direct)

    def mean(self, kind: ErrorKind = "direct") -> float:
        """Return the mean error of ``kind``.

        NaN for a shape that was left out, which has no pairs.
        """
        if not self.weights.any():
            return float("nan")
        return float(np.average(self.of_kind(kind), weights=self.weights))


_HOW = {
    Correspondence: "Correspondence.from_vertices and its siblings make one.",
    GeodesicDistances: "GeodesicDistances(mesh) makes them for the reference.",
}


def pair_errors(
    p2p: IntArray,
    correspondence_i: Correspondence,
    correspondence_0: Correspondence,
    distances: GeodesicDistances,
) -> PairErrors:
    """Return the errors of a point map at every pair that S_i and S_0 share.

    Parameters
    ----------
    p2p : ndarray of int, shape (n_vertices_i,)
        Vertex of S_0 for each vertex of S_i.
    correspondence_i, correspondence_0 : Correspondence
        Where the two shapes lie on the template.
    distances : GeodesicDistances
        On S_0.

    Returns
    -------
    PairErrors
        One entry per pair of S_i whose template point S_0 has. Where several vertices of S_0 stand
        on one point, their errors are averaged. Of a pair that is at a place between vertices, the
        error is one distance: the place is sent where the map sends the corners of its face, with
        the same weights, and measured by `GeodesicDistances.between_places`.

    Raises
    ------
    CorrespondenceError
        If no pair is left.
    TypeError
        If one of the arguments is something else.
    """
    for given, kind in (
        (correspondence_i, Correspondence),
        (correspondence_0, Correspondence),
        (distances, GeodesicDistances),
    ):
        if not isinstance(given, kind):
            raise TypeError(
                f"A {kind.__name__} is expected here; got {type(given).__name__}. {_HOW[kind]}"
            )
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
            "The shape and the reference share no template point; there is nothing to score."
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
    """Return a point map whose entries are all vertices of the reference."""
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
    """Return the distinct (vertex, template point) rows, their mean errors and weights."""
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
    """Return the mean geodesic error of a point map, in units of sqrt(area) of the reference.

    Parameters
    ----------
    p2p : ndarray of int, shape (n_vertices_i,)
        Vertex of S_0 for each vertex of S_i.
    correspondence_i, correspondence_0 : Correspondence
        Where the two shapes lie on the template.
    distances : GeodesicDistances
        On S_0.
    kind : {"direct", "consistent", "per_vertex"}, default="direct"
        What symmetric answers count for; see the module's docstring.

    Returns
    -------
    float
        Mean over the pairs.

    Raises
    ------
    CorrespondenceError
        If no pair is left, or if ``kind`` needs a symmetric answer and there is none.

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
    """Return the share of pairs whose error is at most each threshold.

    This is the cumulative curve of the paper's figure 5, right.

    Parameters
    ----------
    errors : array-like of shape (n_pairs,)
        Errors; none of them NaN.
    thresholds : array-like of shape (n_thresholds,)
        Where the curve is asked for.
    weights : array-like of shape (n_pairs,), optional
        Share of each pair; 1 each by default.

    Returns
    -------
    ndarray of shape (n_thresholds,)
        Between 0 and 1.

    Raises
    ------
    ValueError
        If there are no errors, one is NaN, or weights do not fit.

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
            f"errors must be one-dimensional, with one error at least and no NaN; got {errors}."
        )
    if share.shape != errors.shape or not (share >= 0).all() or not 0 < share.sum() < np.inf:
        raise ValueError(
            f"weights must be {len(errors)} non-negative numbers, not all zero; got {share}."
        )
    order = np.argsort(errors, kind="stable")
    cumulative = np.concatenate([[0.0], np.cumsum(share[order])]) / share.sum()
    return np.asarray(cumulative[np.searchsorted(errors[order], thresholds, side="right")])


def singular_value_profile(X: FloatArray, C: FloatArray, thresholds: FloatArray) -> FloatArray:
    """Return the share of the singular values of X - C at most each threshold (figure 3, right)."""
    return error_curve(np.asarray(np.linalg.svd(X - C, compute_uv=False)), thresholds)


def coverage(p2p: IntArray, mass_0: FloatArray) -> float:
    """Return the share of the area of S_0 whose vertices the point map hits."""
    mass_0 = as_reals(mass_0, "mass_0")
    return float(mass_0[np.unique(_check_p2p(p2p, len(mass_0), 0))].sum() / mass_0.sum())


def continuity(p2p: IntArray, mesh_i: Mesh, distances: GeodesicDistances) -> float:
    """Return the mean stretch of the edges of S_i.

    An edge is stretched by the distance of its images over its length, both over sqrt(area).
    """
    edges = edges_of(mesh_i.faces)
    ends = mesh_i.vertices[edges]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / np.sqrt(mesh_i.area)
    images = _check_p2p(p2p, distances.mesh.n_vertices, mesh_i.n_vertices)[edges]
    return float(np.mean(distances.between(images[:, 0], images[:, 1]) / lengths))


def mean_over_shapes(
    means: Sequence[float], weights: Sequence[float] | FloatArray | None = None
) -> float:
    """Return the weighted mean of the shapes' errors.

    Shapes that were left out (NaN) do not count.
    """
    errors = np.asarray(means, dtype=np.float64)
    share = np.ones(len(errors)) if weights is None else np.asarray(weights, dtype=np.float64)
    known = ~np.isnan(errors) & (share > 0)
    return float(np.average(errors[known], weights=share[known])) if known.any() else float("nan")
