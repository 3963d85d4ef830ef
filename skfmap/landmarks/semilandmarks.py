"""Carrying of points from the reference onto all specimens."""

from collections.abc import Sequence
from typing import cast

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import check_samples
from skfmap.exceptions import MeshError
from skfmap.shapes import Correspondence, Landmarks, Match, Mesh, Registered, SurfacePlaces

__all__ = ["carry_points"]


def carry_points(
    carriers: Sequence[Registered] | Sequence[Match],
    points: Landmarks,
    reference: Mesh,
    meshes: Sequence[Mesh] | None = None,
) -> list[Landmarks]:
    """Carry points of the reference, such as those of a patch or a curve, onto all specimens.

    Each point is a place on a triangle of the reference's mesh. It moves with the triangle, and
    then goes to the nearest point of the specimen's own surface, if that is given.

    Parameters
    ----------
    carriers : sequence of Registered, or of Match
        Results of `skfmap.register` or `skfmap.match`. Registered meshes give smoother results,
        because a match only refers to vertices.
    points : Landmarks
        Semilandmarks on the reference, in the units and coordinates of its mesh; missing ones stay
        missing.
    reference : Mesh
        The given mesh of the reference.
    meshes : sequence of Mesh, optional
        The specimens' own meshes; needed for matches.

    Returns
    -------
    list of Landmarks
        The points on each specimen, in the units and coordinates of its mesh, with the names of
        ``points``. On a shape that was left out, all points are missing.

    Raises
    ------
    CorrespondenceError
        If points do not lie on the reference, or are not carried onto a specimen's own mesh; the
        message suggests possible causes.
    MeshError
        If ``reference`` is not the mesh that was registered or matched to, or if it does not fit a
        shape.

    See Also
    --------
    slide : Remove the arbitrary position of points along the surface.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap import Landmarks
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.landmarks import carry_points
    >>> from skfmap.shapes import Registered
    >>> ball = make_sphere(n_subdivisions=1)
    >>> far = np.zeros(18)
    >>> large = Registered(10 * ball.vertices, ball.faces, far, 0, 0.0, 0.0, 0.0, fits=True)
    >>> middle = Landmarks([ball.vertices[ball.faces[0]].mean(axis=0)], ["middle"])
    >>> on_it, = carry_points([large], middle, ball)
    >>> bool(np.allclose(on_it.points, 10 * middle.points))
    True
    """
    every = check_samples(carriers, "Registered or Match", "carriers")
    own: list[Mesh | None] = [None] * len(every) if meshes is None else list(meshes)
    if len(own) != len(every):
        raise ValueError(f"There are {len(every)} shapes but {len(own)} meshes; give one for each.")
    rows, places = _places(points, reference)
    out = []
    for i, (one, mesh) in enumerate(zip(every, own, strict=True)):
        laid = _laid(one, mesh, reference, f"carriers[{i}]" if one.name is None else repr(one.name))
        there = _with_rows(points, rows, _at(places, laid), one.name)
        out.append(there if mesh is None else _on_surface(there, mesh))
    return out


def _places(points: Landmarks, mesh: Mesh) -> tuple[IntArray, SurfacePlaces]:
    """Return which landmarks are present, and their places on a mesh; raise if they are off it."""
    on_mesh = Correspondence.from_points(points, mesh)
    return on_mesh.pairs[:, 1], cast(SurfacePlaces, on_mesh.places)  # never None from points


def _at(places: SurfacePlaces, vertices: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("nc,nca->na", places.weights, vertices[places.corners]))


def _with_rows(points: Landmarks, rows: IntArray, at: FloatArray, name: str | None) -> Landmarks:
    """Return landmarks with the same names, with points in some rows and NaN in the others."""
    every = np.full((len(points.names), 3), np.nan)
    every[rows] = at
    return Landmarks(every, points.names, name=name)


def _on_surface(points: Landmarks, mesh: Mesh) -> Landmarks:
    rows, places = _places(points, mesh)
    return _with_rows(points, rows, _at(places, mesh.vertices), points.name)


def _laid(one: Registered | Match, mesh: Mesh | None, reference: Mesh, who: str) -> FloatArray:
    """Return positions of the reference's vertices on a shape; NaN where they have none."""
    if isinstance(one, Registered):
        if not one.fits and np.isfinite(one.vertices).all():
            raise MeshError(
                f"{who}: the reference does not fit. Leave it out: [one for one in registered if "
                "one.fits]."
            )
        laid, same = one.vertices, np.array_equal(one.faces, reference.faces)
    elif isinstance(one, Match):
        if mesh is None or one.inverse is None:
            raise ValueError(f"{who}: a match needs the shape's own mesh; give meshes.")
        laid = np.vstack([mesh.vertices, np.full(3, np.nan)])[one.inverse]  # -1 picks the last row
        same = True
    else:
        raise TypeError(
            f"{who} must come from skfmap.register or skfmap.match; got {type(one).__name__}."
        )
    if len(laid) != reference.n_vertices or not same:
        raise MeshError(
            f"The reference of {who} has {len(laid)} vertices and is not the given mesh, which has "
            f"{reference.n_vertices}; give the mesh of {one.reference_name!r}."
        )
    return np.asarray(laid)
