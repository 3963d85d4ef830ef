"""The most average shape of a collection (section 3.1)."""

from collections.abc import Sequence

import numpy as np

from skfmap._tools.parallel import map_shapes
from skfmap._tools.ties import first_of_least
from skfmap._tools.types import FloatArray, IntArray
from skfmap.exceptions import CorrespondenceError
from skfmap.geometry.geodesics import farthest_vertices, heat_distances
from skfmap.shapes import Correspondence, ProbedShape

__all__ = ["medoid_index"]

# Number of template points between which distances are compared; they are well spread, about
# sqrt(area) / 7 apart.
_N_POINTS = 50


def medoid_index(
    shapes: Sequence[ProbedShape], truths: Sequence[Correspondence], n_jobs: int | None
) -> int:
    """Return the index of the shape that differs least from all others (section 3.1).

    The difference of two shapes is the mean relative difference of geodesic distances between
    common points.
    """
    common = truths[0].pairs[:, 1]
    for truth in truths[1:]:
        common = np.intersect1d(common, truth.pairs[:, 1])
    if len(common) < 2:
        raise CorrespondenceError(
            "reference='medoid' needs template points that all shapes have; set reference to the "
            "name of a shape instead."
        )
    vertices = [
        shape.spectral.working_vertices(_vertices_at(truth, common))
        for shape, truth in zip(shapes, truths, strict=True)
    ]
    first = shapes[0].spectral.mesh
    spread, _ = farthest_vertices(first.vertices, first.faces, np.unique(vertices[0]), _N_POINTS)
    columns = np.searchsorted(vertices[0], spread, sorter=np.argsort(vertices[0], kind="stable"))
    columns = np.argsort(vertices[0], kind="stable")[columns]
    arguments = ((shape, at[columns]) for shape, at in zip(shapes, vertices, strict=True))
    tables = np.stack(map_shapes(_landmark_distances, arguments, n_jobs=n_jobs, verbose=0))
    scale = np.maximum(tables.mean(axis=0), 1e-12)
    cost = np.array([(np.abs(tables - table) / scale).mean() for table in tables])
    return first_of_least(cost)  # if there are two shapes, their costs are always equal


def _vertices_at(truth: Correspondence, points: IntArray) -> IntArray:
    """Return one vertex for each of ``points``, all of which are in the correspondence."""
    order = np.argsort(truth.pairs[:, 1], kind="stable")
    return truth.pairs[order[np.searchsorted(truth.pairs[order, 1], points)], 0]


def _landmark_distances(shape: ProbedShape, landmarks: IntArray) -> FloatArray:
    return heat_distances(shape.spectral.vertices, shape.spectral.mesh.faces, landmarks)[
        :, landmarks
    ]
