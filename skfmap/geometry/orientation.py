"""Orientation of faces, and the outside of a surface."""

import numpy as np
import scipy.sparse as sp

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.geometry.faults import HalfEdges, area_and_longest_edge, boundary_pieces, half_edges

__all__ = ["against_the_rest", "orient_faces", "signed_volume"]

# Below this fraction of area^(3/2) a signed volume does not determine the outside (a ball has
# 0.094, a TOSCA cat 0.04).
_FLAT = 1e-3


def signed_volume(vertices: FloatArray, faces: IntArray) -> float:
    """Return the volume that faces enclose, positive if their normals point outwards.

    Faces must be wound consistently. Holes are closed by a fan around the mean of their boundary,
    so that the result does not depend on the origin.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.orientation import signed_volume
    >>> corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> round(6 * signed_volume(corner, faces), 12)
    1.0
    """
    return _signed_volume(vertices, faces, closed=False)


def against_the_rest(edges: HalfEdges) -> tuple[BoolArray, BoolArray]:
    """Find faces that are wound against the rest of their patch.

    A patch is a set of faces that are connected across edges with two faces. Of its two windings,
    the one is chosen that flips fewer faces.

    Parameters
    ----------
    edges : HalfEdges
        The half-edges of the faces.

    Returns
    -------
    turned : ndarray of bool, shape (n_faces,)
        Which faces must be flipped.
    twisted : ndarray of bool, shape (n_faces,)
        Which faces belong to a patch without a consistent winding; none of them is flipped.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.faults import half_edges
    >>> from skfmap.geometry.orientation import against_the_rest
    >>> faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 5, 4]])
    >>> against_the_rest(half_edges(faces))[0].tolist()
    [False, False, False, True]
    """
    n = len(edges.start) // 3
    alike = np.not_equal(*edges.start[edges.pairs])
    if alike.all():
        return np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    one, other = edges.pairs // 3
    # Each face has two sides, f and f + n. Neighbours are connected on the same side if they are
    # wound consistently; if the two sides of a patch are connected, it has only one side.
    rows = np.concatenate([one, one + n])
    columns = np.concatenate([np.where(alike, other, other + n), np.where(alike, other + n, other)])
    _, sheet = sp.csgraph.connected_components(
        sp.coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * n, 2 * n)),
        directed=False,
    )
    front, back = sheet[:n], sheet[n:]
    twisted = front == back
    turned, patch = front > back, np.minimum(front, back)
    n_turned, size = np.bincount(patch, turned), np.bincount(patch)
    turned ^= (2 * n_turned > size)[patch]
    return turned & ~twisted, twisted


def orient_faces(
    vertices: FloatArray, faces: IntArray, edges: HalfEdges | None = None
) -> tuple[IntArray, bool, bool]:
    """Wind all faces consistently and outwards, as far as possible; indices do not change.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles of one connected component.
    edges : HalfEdges, optional
        Their half-edges, if known.

    Returns
    -------
    faces : ndarray of int, shape (n_faces, 3)
        The same triangles, in the same order, some with two corners swapped.
    consistent : bool
        Whether they are wound consistently; False for surfaces that cannot be (a Moebius band).
    outward : bool
        Whether they are known to point outwards; False if the surface encloses no volume.
    """
    edges = half_edges(faces) if edges is None else edges
    turned, twisted = against_the_rest(edges)
    if twisted.any() or (edges.count > 2).any():
        return faces, False, False
    oriented = faces
    if turned.any():
        oriented = np.where(turned[:, None], faces[:, [0, 2, 1]], faces)
    scale = area_and_longest_edge(vertices, oriented)[0].sum()
    if scale**1.5 == 0:  # no area, or an area that underflows
        return oriented, True, False
    closed = not (edges.count == 1).any()
    volume = _signed_volume(vertices, oriented, closed) / scale**1.5
    if abs(volume) < _FLAT:
        return oriented, True, False
    return (oriented if volume > 0 else oriented[:, [0, 2, 1]]), True, True


def _signed_volume(vertices: FloatArray, faces: IntArray, closed: bool) -> float:
    centred = vertices - vertices.mean(axis=0)
    volume = _cone_volume(*(centred[faces[:, j]] for j in range(3)))
    for piece in [] if closed else boundary_pieces(faces):
        centre = centred[np.unique(piece)].mean(axis=0)
        start, end = centred[piece[:, 0]], centred[piece[:, 1]]
        volume += _cone_volume(end, start, np.broadcast_to(centre, start.shape))
    return volume


def _cone_volume(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    return float((a * np.cross(b, c)).sum() / 6)
