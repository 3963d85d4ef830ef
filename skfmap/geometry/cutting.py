"""Parts of triangle meshes: superlevel sets of functions, visible faces and components."""

import numpy as np
import scipy.sparse as sp

from skfmap._tools.types import BoolArray, FloatArray, IntArray
from skfmap.geometry.closest import face_normals
from skfmap.geometry.faults import components

__all__ = ["clip", "keep_faces", "rim_length", "smooth_mask", "visible_faces", "without_crumbs"]

# Minimum distance of a cut from the ends of an edge, as a fraction of its length, to avoid slivers.
_FROM_ENDS = 0.05
# Maximum number of steps along an edge between points of a face in the depth buffer.
_MOST_STEPS = 12


def clip(vertices: FloatArray, faces: IntArray, values: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the part of a mesh where a function is not negative.

    The function is linear on each face. Faces are cut where it is 0, so that the rim of the part
    does not follow edges of the mesh.

    Parameters
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        A triangle mesh.
    values : ndarray of shape (n_vertices,)
        Values of the function.

    Returns
    -------
    vertices, faces : ndarray of shape (n, 3), ndarray of int, shape (m, 3)
        The part; its faces are wound like those of the mesh.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.cutting import clip
    >>> corners = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]])
    >>> part, faces = clip(corners, np.array([[0, 1, 2]]), 1 - corners[:, 0])
    >>> float(part[:, 0].max()), len(faces)
    (1.0, 2)
    """
    inside = values >= 0
    count = inside[faces].sum(axis=1)
    whole = faces[count == 3]
    # The corner that is alone on its side comes first; the order of winding is kept.
    one, two = (_turned(faces[count == n], inside, alone) for n, alone in ((1, True), (2, False)))
    edges = np.concatenate([one[:, [0, 1]], one[:, [0, 2]], two[:, [0, 1]], two[:, [0, 2]]])
    ends, back = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    cut = np.split(len(vertices) + back.ravel(), np.cumsum([len(one), len(one), len(two)]))
    faces_cut = np.concatenate(
        [
            whole,
            np.column_stack([one[:, 0], cut[0], cut[1]]),
            np.column_stack([two[:, 1], two[:, 2], cut[3]]),
            np.column_stack([two[:, 1], cut[3], cut[2]]),
        ]
    )
    all_vertices = np.concatenate([vertices, _crossings(vertices, values, ends)])
    return keep_faces(all_vertices, faces_cut, np.ones(len(faces_cut), dtype=bool))


def _turned(faces: IntArray, inside: BoolArray, alone: bool) -> IntArray:
    """Return faces rotated so that the corner whose side is ``alone`` comes first."""
    first = np.argmax(inside[faces] == alone, axis=1) if len(faces) else np.zeros(0, dtype=int)
    return np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)


def _crossings(vertices: FloatArray, values: FloatArray, ends: IntArray) -> FloatArray:
    """Return where the function is 0 on edges, but not too near their ends."""
    a, b = values[ends[:, 0]], values[ends[:, 1]]
    share = np.clip(a / np.where(a == b, 1.0, a - b), _FROM_ENDS, 1 - _FROM_ENDS)[:, None]
    return (1 - share) * vertices[ends[:, 0]] + share * vertices[ends[:, 1]]


def keep_faces(
    vertices: FloatArray, faces: IntArray, kept: BoolArray
) -> tuple[FloatArray, IntArray]:
    """Return some faces of a mesh, with only the vertices that they use.

    Parameters
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        A triangle mesh.
    kept : ndarray of bool, shape (n_faces,)
        Which faces to keep.
    """
    used, numbers = np.unique(faces[kept], return_inverse=True)
    return vertices[used], numbers.reshape(-1, 3)


def without_crumbs(
    vertices: FloatArray, faces: IntArray, least_area: float
) -> tuple[FloatArray, IntArray]:
    """Return a mesh without components smaller than an area; the largest is always kept.

    Parameters
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        A triangle mesh.
    least_area : float
        Minimum area, in squared units of the coordinates.
    """
    label = components(faces, len(vertices))[faces[:, 0]]
    areas = np.bincount(label, _areas(vertices, faces))
    kept = areas >= min(least_area, areas.max())
    return keep_faces(vertices, faces, kept[label])


def rim_length(vertices: FloatArray, faces: IntArray) -> float:
    """Return the total length of the edges that belong to only one face.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.geometry.cutting import rim_length
    >>> rim_length(np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]]))
    12.0
    """
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    ends, counts = np.unique(edges, axis=0, return_counts=True)
    rim = ends[counts == 1]
    return float(np.linalg.norm(vertices[rim[:, 0]] - vertices[rim[:, 1]], axis=1).sum())


def visible_faces(
    vertices: FloatArray,
    faces: IntArray,
    direction: FloatArray,
    *,
    n_pixels: int = 256,
    grazing: float = 0.2,
) -> BoolArray:
    """Return which faces a distant scanner sees, shape (n_faces,).

    These are the faces that are turned towards it and are not behind others in a depth buffer.

    Parameters
    ----------
    vertices, faces : ndarray of shape (n_vertices, 3), ndarray of int, shape (n_faces, 3)
        A triangle mesh, wound outwards.
    direction : ndarray of shape (3,)
        Direction from the mesh towards the scanner.
    n_pixels : int
        Number of pixels of the buffer along the largest extent.
    grazing : float
        Minimum cosine of the angle between the normal of a face and the direction.
    """
    towards = direction / np.linalg.norm(direction)
    across = np.linalg.svd(towards[None])[2][1:]
    flat, depth = vertices @ across.T, vertices @ towards
    extent = float(np.ptp(flat, axis=0).max())
    pixel = extent / n_pixels
    on_screen = (flat - flat.min(axis=0)) / pixel
    buffer = np.full((n_pixels + 2, n_pixels + 2), -np.inf)
    for share in _grid(on_screen, faces):
        at = np.floor(np.einsum("c,fcd->fd", share, on_screen[faces])).astype(np.int64)
        np.maximum.at(buffer, (at[:, 0], at[:, 1]), depth[faces] @ share)
    seen = np.zeros(len(faces), dtype=np.int64)
    corners = np.array([[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8], [1 / 3, 1 / 3, 1 / 3]])
    cosines = face_normals(vertices, faces) @ towards
    slack = pixel * (1 + np.sqrt(1 / np.square(np.maximum(cosines, grazing)) - 1) * 2)
    for share in corners:
        at = np.floor(np.einsum("c,fcd->fd", share, on_screen[faces])).astype(np.int64)
        seen += depth[faces] @ share >= buffer[at[:, 0], at[:, 1]] - slack
    return np.asarray((seen >= 3) & (cosines >= grazing))


def _grid(on_screen: FloatArray, faces: IntArray) -> FloatArray:
    """Return barycentric weights dense enough for all pixels of the largest faces, (n, 3)."""
    corners = on_screen[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    n = int(np.clip(np.ceil(longest), 1, _MOST_STEPS))
    second, third = np.triu_indices(n + 1)[0], n - np.triu_indices(n + 1)[1]
    return np.column_stack([n - second - third, second, third]) / n


def _areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    a, b, c = (vertices[faces[:, j]] for j in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def smooth_mask(faces: IntArray, n_vertices: int, kept: BoolArray, n_rounds: int = 3) -> FloatArray:
    """Return a function on vertices whose zero level set follows the rim of the kept faces.

    It is the fraction of kept faces, averaged over neighbours, minus 0.5.
    """
    ends = faces.ravel()
    touching = sp.coo_array(
        (np.ones(len(ends)), (ends, np.repeat(np.arange(len(faces)), 3))),
        shape=(n_vertices, len(faces)),
    ).tocsr()
    counts = np.maximum(np.asarray(touching.sum(axis=1)).ravel(), 1.0)
    share = kept.astype(np.float64)
    for _ in range(n_rounds):
        at = np.asarray(touching @ share) / counts
        share = at[faces].mean(axis=1)
    return np.asarray(touching @ share) / counts - 0.5
