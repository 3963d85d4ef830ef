"""Ways to take a part of a shape, as a scan would: what partial matching is learned from."""

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

# Pieces below this share of the area of a mesh are left out of its part.
_CRUMB = 0.005
# Views that are tried before a part is as large as it should be, and tips of limbs.
_MOST_VIEWS, _N_TIPS = 6, 8


class Cut(BaseEstimator, ABC):
    """A way to take a part of a mesh; derive from it for ways of your own.

    Parameters
    ----------
    low, high : float, default=0.4, 0.9
        Between which shares of the area are left.

    See Also
    --------
    PlaneCut, LimbCut, DiscCut, ViewCut : Those that there are.

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
        """Raise for parameters that cannot be used."""
        check_number(self.low, "low", low=0, high=1, strict=True)
        check_number(self.high, "high", low=self.low, high=1)

    def cut(self, mesh: Mesh, rng: np.random.Generator) -> Mesh:
        """Return a part of a mesh.

        Parameters
        ----------
        mesh : Mesh
            Any.
        rng : numpy.random.Generator
            What chooses the part.

        Returns
        -------
        Mesh
            It lies on the surface of the mesh.
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
        """Return vertices and faces of the part.

        Parameters
        ----------
        vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
            The mesh.
        share : float
            About how much of the area is to be left.
        rng : numpy.random.Generator
            What chooses the part.
        """


class PlaneCut(Cut):
    """What lies on one side of a plane.

    Parameters
    ----------
    low, high : float, default=0.4, 0.9
        Between which shares of the area are left.
    """

    def part(
        self, vertices: FloatArray, faces: IntArray, share: float, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """Return the side of a plane of random direction; parameters as in `Cut.part`."""
        heights = vertices @ _direction(rng)
        level = _quantile(heights[faces].mean(axis=1), _areas(vertices, faces), share)
        return clip(vertices, faces, level - heights)


class DiscCut(Cut):
    """What lies within a distance along the surface from a point.

    Parameters
    ----------
    low, high : float, default=0.4, 0.9
        Between which shares of the area are left.
    """

    def part(
        self, vertices: FloatArray, faces: IntArray, share: float, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """Return the disc about a random vertex; parameters as in `Cut.part`."""
        start = int(rng.choice(np.unique(faces)))
        away = _along(vertices, faces, [start])[0]
        level = _quantile(away[faces].mean(axis=1), _areas(vertices, faces), share)
        return clip(vertices, faces, level - away)


class LimbCut(Cut):
    """What is left when one, two or three limbs are missing.

    Parameters
    ----------
    low, high : float, default=0.4, 0.9
        Between which shares of the area are left.
    """

    def part(
        self, vertices: FloatArray, faces: IntArray, share: float, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """Return what is far from random tips of limbs; parameters as in `Cut.part`."""
        tips = _tips(vertices, faces)
        n = int(rng.integers(1, 4))
        chosen = rng.permutation(len(tips))[:n]
        away = tips[chosen] * rng.uniform(0.7, 1.3, size=(len(chosen), 1))
        nearest = away.min(axis=0)
        level = _quantile(-nearest[faces].mean(axis=1), _areas(vertices, faces), share)
        return clip(vertices, faces, nearest + level)


class ViewCut(Cut):
    """What a distant scanner sees from one place, or from the next few as it is carried around.

    Parameters
    ----------
    low, high : float, default=0.4, 0.9
        Between which shares of the area are left. More places are scanned from until so much is
        seen, and one at least.
    """

    def part(
        self, vertices: FloatArray, faces: IntArray, share: float, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """Return what is seen from random places; parameters as in `Cut.part`."""
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
    """Return the cuts that a parameter stands for: a word, a cut, or a sequence of both.

    Raises
    ------
    ValueError
        If it is none of these.
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
    """Return a random direction, about a quarter turn from another if one is given."""
    drawn = rng.normal(size=3)
    if near is not None:
        drawn = drawn / np.linalg.norm(drawn) + 0.3 * near
    return np.asarray(drawn / np.linalg.norm(drawn))


def _along(vertices: FloatArray, faces: IntArray, sources: Sequence[int]) -> FloatArray:
    """Return distances along edges; what is out of reach is farther than anything else."""
    away = np.asarray(dijkstra(edge_graph(vertices, faces), directed=False, indices=sources))
    finite = np.isfinite(away)
    return np.where(finite, away, 2 * away[finite].max())


def _tips(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return distances from points that are far from one another, shape (n_tips, n_vertices)."""
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
    """Return the value below which a share of the weight lies."""
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order])
    return float(values[order][min(np.searchsorted(below, share * below[-1]), len(values) - 1)])
