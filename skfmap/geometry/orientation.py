"""Which side of a surface is its outside."""

import igl
import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.geometry.faults import boundary_pieces, is_wound_consistently

__all__ = ["orient_faces", "signed_volume"]

# Below this share of area^(3/2) a signed volume says nothing about sides (a ball has 0.094, a TOSCA
# cat 0.04).
_FLAT = 1e-3


def signed_volume(vertices: FloatArray, faces: IntArray) -> float:
    """Return the volume that faces enclose, positive if their normals point outwards.

    Faces are wound consistently. Holes are closed by a fan around the mean of their boundary, so
    that the answer does not depend on the origin.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.orientation import signed_volume
    >>> corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> round(6 * signed_volume(corner, faces), 12)
    1.0
    """
    centred = vertices - vertices.mean(axis=0)
    volume = _cone_volume(centred[faces])
    for piece in boundary_pieces(faces):
        centre = centred[np.unique(piece)].mean(axis=0)
        start, end = centred[piece[:, 0]], centred[piece[:, 1]]
        volume += _cone_volume(np.stack([end, start, np.broadcast_to(centre, start.shape)], axis=1))
    return volume


def orient_faces(vertices: FloatArray, faces: IntArray) -> tuple[IntArray, bool, bool]:
    """Wind all faces consistently and outwards, as far as that can be told; the numbering stays.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles of one connected component.

    Returns
    -------
    faces : ndarray of int, shape (n_faces, 3)
        The same triangles, in the same order, some with two corners swapped.
    consistent : bool
        Whether they are wound consistently; False for surfaces that cannot be (a Moebius band).
    outward : bool
        Whether they are known to point outwards; False where the surface encloses no volume.
    """
    oriented = faces if is_wound_consistently(faces) else np.asarray(igl.bfs_orient(faces)[0])
    if not is_wound_consistently(oriented):
        return faces, False, False
    scale = igl.doublearea(vertices, oriented).sum() / 2
    if scale**1.5 == 0:  # no area, or too little to be told from none
        return oriented, True, False
    volume = signed_volume(vertices, oriented) / scale**1.5
    if abs(volume) < _FLAT:
        return oriented, True, False
    return (oriented if volume > 0 else oriented[:, [0, 2, 1]]), True, True


def _cone_volume(corners: FloatArray) -> float:
    return float(np.linalg.det(corners).sum() / 6)
