"""Lit surfaces, drawn with matplotlib from back to front."""

from typing import TYPE_CHECKING

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.geometry.normals import vertex_normals

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_surface"]

# A key light from the upper left and a weak fill light from the right, with their strengths; all
# chosen by eye. Directions are right, up, towards the camera.
_KEY_LIGHT = np.array([-0.45, 0.65, 0.62])
_FILL_LIGHT = np.array([0.8, -0.1, 0.6])
_SHADOW, _KEY, _FILL, _GLOSS, _SHININESS = 0.42, 0.55, 0.16, 0.10, 30


def draw_surface(ax: "Axes", seen: FloatArray, faces: IntArray, colours: FloatArray) -> None:
    """Draw a mesh on matplotlib axes.

    Parameters
    ----------
    ax : matplotlib Axes
        Axes to draw on.
    seen : ndarray of shape (n_vertices, 3)
        Coordinates to the right, up, and towards the camera.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles.
    colours : ndarray of shape (n_vertices, 3)
        Colours of the vertices, in [0, 1].
    """
    from matplotlib.collections import TriMesh  # noqa: PLC0415
    from matplotlib.tri import Triangulation  # noqa: PLC0415

    order = np.argsort(seen[faces, 2].mean(axis=1), kind="stable")
    drawn = TriMesh(Triangulation(seen[:, 0], seen[:, 1], faces[order]))
    drawn.set_facecolor(lit(colours, vertex_normals(seen, faces)))
    drawn.set_rasterized(True)
    # By default matplotlib would compute the limits from a path for each triangle, which is slow.
    ax.add_collection(drawn, autolim=False)
    ax.update_datalim(seen[np.unique(faces), :2])
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.set_axis_off()


def lit(colours: FloatArray, normals: FloatArray) -> FloatArray:
    """Return colours under two lights; back faces are lit like front faces."""
    facing = normals * np.where(normals[:, 2:] < 0, -1, 1)
    key, fill = (
        np.clip(facing @ (light / np.linalg.norm(light)), 0, None)
        for light in (_KEY_LIGHT, _FILL_LIGHT)
    )
    shade = _SHADOW + _KEY * key + _FILL * fill
    return np.clip(colours * shade[:, None] + _GLOSS * key[:, None] ** _SHININESS, 0, 1)
