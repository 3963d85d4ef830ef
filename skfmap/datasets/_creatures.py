"""A generated collection: a four-legged creature in many poses."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import check_choice, check_number, read_only
from skfmap.datasets._collection import Collection
from skfmap.datasets._creature_body import BODIES
from skfmap.datasets._creature_field import mirror
from skfmap.datasets._creature_mesh import mesh_body
from skfmap.datasets._creature_posing import bend, carry, draw_pose, draw_sizes
from skfmap.shapes import Correspondence, Mesh

__all__ = ["make_creatures"]

_TEMPLATE_BODY = "cat"
# Number of vertices from which template points are chosen: twice the largest allowed n_points.
_TEMPLATE_VERTICES = 6000
# Least distance of template points from the mirror plane in centimetres, so that no point is its
# own mirror image.
_TEMPLATE_MARGIN = 0.5

_DESCR = """\
A four-legged creature in many poses, generated from capsules; nothing is downloaded.

Each mesh is a closed manifold of genus 0, oriented outwards, with its own connectivity, in
centimetres. At rest, the creature has left-right symmetry. The first mesh is at rest; the others
are bent at random, nearly isometrically, and their parts differ slightly in size.
Bodies: {bodies}. Different bodies share the template but are far from isometric to each other.

meshes : the shapes
correspondences : vertex of each shape at each template point, direct and symmetric
names : body and number of each shape
template_points : {n_points} points on the {template} at rest; the second half mirrors the first
"""


def make_creatures(
    n_shapes: int = 11,
    n_vertices: int = 2000,
    *,
    body: str | Sequence[str] = "cat",
    n_points: int = 1500,
    pose_strength: float = 1.0,
    variation: float = 0.12,
    random_state: int = 0,
) -> Collection:
    """Make a collection of a four-legged creature in many poses.

    Parameters
    ----------
    n_shapes : int, default=11
        Number of shapes. The first is the creature at rest; the others have random poses.
    n_vertices : int, default=2000
        Exact number of vertices of each mesh, from 500 to 20,000. With fewer than 1,000, the tips
        of ears and tail are lost.
    body : {"cat", "horse"} or sequence of these, default="cat"
        Body plan of all shapes or of each. The horse has longer legs, a longer neck and a shorter
        tail.
    n_points : int, default=1500
        Number of template points; must be even. The template depends on nothing else, so all bodies
        share it.
    pose_strength : float, default=1.0
        Strength of the poses, from 0 (all shapes at rest) to 1 (angles of up to about 50 degrees at
        the joints).
    variation : float, default=0.12
        Largest relative difference in size of each part of the body from that on the first shape,
        from 0 to 0.2. It is the same on both sides. With 0, shapes differ only by bending, which is
        closer to isometric than in scanned animals.
    random_state : int, default=0
        Seed. Shape ``i`` depends on the seed and on ``i``, but not on the other shapes.

    Returns
    -------
    Collection
        Collection with ``meshes``, a list of `Mesh`; ``correspondences``, a list of
        `Correspondence` with symmetric answers; ``names``, a list of str; ``template_points``, an
        array of shape (n_points, 3) on the cat at rest, whose second half mirrors the first;
        ``up``, the axis that points up; and ``DESCR``.

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    ValueError
        If an argument is out of range.

    Notes
    -----
    The creature at rest is a smooth union of tapered capsules, defined by an implicit function that
    is symmetric in x. Its zero level set is triangulated by marching cubes on a randomly rotated
    and shifted grid, thinned to ``n_vertices`` vertices and smoothed along the surface. It is then
    bent at its joints by blended rotations and rotated about the vertical axis. A template point
    corresponds to the vertex nearest to it at rest, before bending.

    Examples
    --------
    >>> from skfmap.datasets import make_creatures
    >>> creatures = make_creatures(2, 500, body=["cat", "horse"], n_points=100)
    >>> creatures.meshes
    [Mesh('cat0', n_vertices=500, n_faces=996), Mesh('horse1', n_vertices=500, n_faces=996)]
    >>> creatures.correspondences[1]
    Correspondence(n_pairs=100, n_symmetric_pairs=100)
    """
    check_number(n_shapes, "n_shapes", low=1, integer=True)
    check_number(n_vertices, "n_vertices", low=500, high=20_000, integer=True)
    check_number(n_points, "n_points", low=2, high=_TEMPLATE_VERTICES // 2, integer=True)
    check_number(pose_strength, "pose_strength", low=0.0, high=1.0)
    check_number(variation, "variation", low=0.0, high=0.2)
    check_number(random_state, "random_state", low=0, integer=True)
    if n_points % 2:
        raise ValueError(
            "n_points must be even, because template points come in mirrored pairs; got "
            f"{n_points}."
        )
    bodies = _check_bodies(body, n_shapes)
    looks = _Looks(n_vertices, n_points, pose_strength, variation, random_state)
    shapes = [_make_shape(index, name, looks) for index, name in enumerate(bodies)]
    return Collection(
        meshes=[mesh for mesh, _ in shapes],
        correspondences=[correspondence for _, correspondence in shapes],
        names=[str(mesh.name) for mesh, _ in shapes],
        template_points=_template(n_points, _TEMPLATE_BODY),
        up="z",
        DESCR=_DESCR.format(
            bodies=", ".join(sorted(set(bodies))), n_points=n_points, template=_TEMPLATE_BODY
        ),
    )


class _Looks(NamedTuple):
    """Arguments of `make_creatures` that all shapes of a collection share."""

    n_vertices: int
    n_points: int
    pose_strength: float
    variation: float
    random_state: int


def _check_bodies(body: str | Sequence[str], n_shapes: int) -> list[str]:
    bodies = [body] * n_shapes if isinstance(body, str) else list(body)
    if len(bodies) != n_shapes:
        raise ValueError(
            f"body must name one body plan, or one for each of the {n_shapes} shapes; got "
            f"{len(bodies)}."
        )
    return [check_choice(name, "body", list(BODIES)) for name in bodies]


def _make_shape(index: int, name: str, looks: _Looks) -> tuple[Mesh, Correspondence]:
    """Return a mesh and its correspondence; the first shape is at rest."""
    body = BODIES[name]
    rng = np.random.default_rng([looks.random_state, index])
    pose = draw_pose(body, rng, looks.pose_strength)
    sizes = draw_sizes(rng, looks.variation)
    heading = Rotation.from_euler("z", rng.uniform(0.0, 360.0), degrees=True)
    at_rest, faces = mesh_body(body, looks.n_vertices, rng)
    vertices = heading.apply(bend(body, at_rest, pose, sizes)) if index else at_rest
    return Mesh(vertices, faces, name=f"{name}{index}"), _correspond(
        at_rest, _template(looks.n_points, name)
    )


def _correspond(at_rest: FloatArray, template: FloatArray) -> Correspondence:
    """Return the correspondence given by the vertices nearest to template points at rest."""
    nearest = cKDTree(at_rest).query(template)[1]
    return Correspondence.from_template(nearest, symmetric=np.roll(nearest, len(template) // 2))


@lru_cache
def _template(n_points: int, body: str) -> FloatArray:
    """Return the template on a body at rest: points with x > 0, then their mirror images."""
    half = _spread_points(n_points // 2)
    if body != _TEMPLATE_BODY:
        half = carry(BODIES[_TEMPLATE_BODY], BODIES[body], half)
    return read_only(np.concatenate([half, mirror(half)]))


@lru_cache
def _spread_points(n_points: int) -> FloatArray:
    """Return well-spread points with x > 0 on the template body, by farthest-point sampling.

    Each point is as far as possible from earlier points and their mirror images.
    """
    vertices, _ = mesh_body(BODIES[_TEMPLATE_BODY], _TEMPLATE_VERTICES, np.random.default_rng(0))
    candidates = vertices[vertices[:, 0] > _TEMPLATE_MARGIN]
    distances = np.full(len(candidates), np.inf)
    chosen = [0]
    for _ in range(n_points - 1):
        point = candidates[chosen[-1]]
        for image in (point, mirror(point)):
            distances = np.minimum(distances, np.linalg.norm(candidates - image, axis=1))
        chosen.append(int(distances.argmax()))
    return candidates[chosen]
