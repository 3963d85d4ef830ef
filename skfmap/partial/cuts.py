"""Cuts that leave a part of a shape, as incomplete scans do, for training partial matching."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.sparse.csgraph import dijkstra
from sklearn.base import BaseEstimator

from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import check_number
from skfmap.geometry.cutting import clip, keep_faces, smooth_mask, visible_faces, without_crumbs
from skfmap.geometry.geodesics import edge_graph
from skfmap.shapes import Mesh

__all__ = ["CUTS", "Cut", "DiscCut", "LimbCut", "PlaneCut", "ViewCut", "make_cuts"]

# Components below this fraction of the area of the mesh are removed from its part.
_CRUMB = 0.005
# Maximum number of views of a part, and the number of candidates for tips of limbs.
_MOST_VIEWS, _N_TIPS = 6, 8


class Cut(BaseEstimator, ABC):
    """Base class of cuts that leave a part of a mesh; derive from it to define other cuts.

    Parameters
    ----------
    low, high : float, default=0.4, 0.9
        Minimum and maximum fraction of the area that is left.

    See Also
    --------
    PlaneCut, LimbCut, DiscCut, ViewCut : The available cuts.

    Examples
    --------
    >>> from skfmap.partial import Cut
    >>> class Left(Cut):
    ...     def part(self, vertices, faces, share, rng):
    ...         return vertices, faces[(vertices[faces, 0] > 0).all(axis=1)]
    """

    def __init__(self, low: float = 0.4, high: float = 0.9) -> None:
        self.low = low
        self.high = high

    def check_parameters(self) -> None:
        """Raise an error for invalid parameters."""
        check_number(self.low, "low", low=0, high=1, strict=True)
        check_number(self.high, "high", low=self.low, high=1)

    def cut(self, mesh: Mesh, rng: np.random.Generator) -> Mesh:
        """Return a part of a mesh.

        Parameters
        ----------
        mesh : Mesh
            The mesh to cut.
        rng : numpy.random.Generator
            Generator that the part is drawn from.

        Returns
        -------
        Mesh
            The part, which lies on the surface of the mesh.
        """
        share = float(rng.uniform(self.low, self.high))
        vertices, faces = self.part(mesh.vertices, mesh.faces, share, rng)
        vertices, faces = without_crumbs(
            *keep_faces(vertices, faces, np.ones(len(faces), dtype=bool)), _CRUMB * mesh.area
        )
        return Mesh(vertices, faces, mesh.name)

    @abstractmethod
    def part(
        self, vertices: FloatArray, faces: IntArray, share: float, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """Return the vertices and faces of the part.

        Parameters
        ----------
        vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
            The mesh.
        share : float
            Approximate fraction of the area to leave.
        rng : numpy.random.Generator
            Generator that the part is drawn from.
        """


class PlaneCut(Cut):
    """Cut by a plane, which leaves one side of it.

    Parameters
    ----------
    low, high : float, default=0.4, 0.9
        Minimum and maximum fraction of the area that is left.
    """

    def part(
        self, vertices: FloatArray, faces: IntArray, share: float, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """Return one side of a plane with a random normal; parameters as in `Cut.part`."""
        heights = vertices @ _direction(rng)
        level = _quantile(heights[faces].mean(axis=1), _areas(vertices, faces), share)
        return clip(vertices, faces, level - heights)


class DiscCut(Cut):
    """Cut that leaves a geodesic disc around a point.

    Parameters
    ----------
    low, high : float, default=0.4, 0.9
        Minimum and maximum fraction of the area that is left.
    """

    def part(
        self, vertices: FloatArray, faces: IntArray, share: float, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """Return the disc around a random vertex; parameters as in `Cut.part`."""
        start = int(rng.choice(np.unique(faces)))
        away = _along(vertices, faces, [start])[0]
        level = _quantile(away[faces].mean(axis=1), _areas(vertices, faces), share)
        return clip(vertices, faces, level - away)


class LimbCut(Cut):
    """Cut that removes one, two or three limbs.

    Parameters
    ----------
    low, high : float, default=0.4, 0.9
        Minimum and maximum fraction of the area that is left.
    """

    def part(
        self, vertices: FloatArray, faces: IntArray, share: float, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """Return the part far from random tips of limbs; parameters as in `Cut.part`."""
        tips = _tips(vertices, faces)
        n = int(rng.integers(1, 4))
        chosen = rng.permutation(len(tips))[:n]
        away = tips[chosen] * rng.uniform(0.7, 1.3, size=(len(chosen), 1))
        nearest = away.min(axis=0)
        level = _quantile(-nearest[faces].mean(axis=1), _areas(vertices, faces), share)
        return clip(vertices, faces, nearest + level)


class ViewCut(Cut):
    """Cut that leaves what a distant scanner sees from one or several directions.

    Parameters
    ----------
    low, high : float, default=0.4, 0.9
        Minimum and maximum fraction of the area that is left. Directions are added until this
        much is seen, as if the scanner were carried around the shape; there is at least one.
    """

    def part(
        self, vertices: FloatArray, faces: IntArray, share: float, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """Return what is seen from random directions; parameters as in `Cut.part`."""
        areas = _areas(vertices, faces)
        seen = np.zeros(len(faces), dtype=bool)
        towards = _direction(rng)
        for _ in range(_MOST_VIEWS):
            more = seen | visible_faces(vertices, faces, towards)
            if seen.any() and areas @ more > share * areas.sum() + (areas @ (more & ~seen)) / 2:
                break
            seen = more
            towards = _direction(rng, near=towards)
        level = smooth_mask(faces, len(vertices), seen)
        return clip(vertices, faces, level)


CUTS: Mapping[str, tuple[Cut, ...]] = {
    "planes": (PlaneCut(),),
    "limbs": (LimbCut(),),
    "discs": (DiscCut(),),
    "views": (ViewCut(),),
    "auto": (PlaneCut(), LimbCut(), ViewCut(), DiscCut()),
}


def make_cuts(cuts: object) -> list[Cut]:
    """Return the cuts that a parameter specifies: a name, a cut, or a sequence of both.

    Raises
    ------
    ValueError
        If the parameter is none of these.
    """
    if isinstance(cuts, str) and cuts in CUTS:
        return list(CUTS[cuts])
    if isinstance(cuts, Cut):
        cuts.check_parameters()
        return [cuts]
    if isinstance(cuts, Sequence) and not isinstance(cuts, str) and len(cuts):
        return [one for each in cuts for one in make_cuts(each)]
    told = ", ".join(map(repr, CUTS))
    hint = f" Did you mean {cuts.__name__}()?" if isinstance(cuts, type) else ""
    raise ValueError(
        f"cuts must be one of {told}, an object derived from skfmap.partial.Cut, or a list of "
        f"these; got {cuts!r}.{hint}"
    )


def _direction(rng: np.random.Generator, near: FloatArray | None = None) -> FloatArray:
    """Return a random direction; if another is given, the direction is biased towards it."""
    drawn = rng.normal(size=3)
    if near is not None:
        drawn = drawn / np.linalg.norm(drawn) + 0.3 * near
    return np.asarray(drawn / np.linalg.norm(drawn))


def _along(vertices: FloatArray, faces: IntArray, sources: Sequence[int]) -> FloatArray:
    """Return distances along edges; unreachable vertices are farther than all others."""
    away = np.asarray(dijkstra(edge_graph(vertices, faces), directed=False, indices=sources))
    finite = np.isfinite(away)
    return np.where(finite, away, 2 * away[finite].max())


def _tips(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return distances from points far from one another, shape (n_tips, n_vertices)."""
    used = np.unique(faces)
    far = used[int(_along(vertices, faces, [int(used[0])])[0][used].argmax())]
    rows = [_along(vertices, faces, [int(far)])[0]]
    while len(rows) < _N_TIPS:
        nearest = np.min(rows, axis=0)
        rows.append(_along(vertices, faces, [int(used[nearest[used].argmax()])])[0])
    return np.asarray(rows)


def _areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    a, b, c = (vertices[faces[:, j]] for j in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def _quantile(values: FloatArray, weights: FloatArray, share: float) -> float:
    """Return the value below which the given fraction of the weight lies."""
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order])
    return float(values[order][min(np.searchsorted(below, share * below[-1]), len(values) - 1)])
