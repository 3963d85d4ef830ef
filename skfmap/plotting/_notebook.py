"""HTML that notebooks show for shapes, matches and collections: a small picture and a table."""

import base64
import html
import io
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import singledispatch
from typing import Any, NamedTuple

import numpy as np

from skfmap.datasets import Collection
from skfmap.exceptions import MeshError
from skfmap.plotting._camera import Camera
from skfmap.plotting._pictures import draw_scene
from skfmap.plotting._scene import Scene, scene_of_functions, scene_of_matches
from skfmap.shapes import Landmarks, Match, Mesh, Registered

__all__ = ["html_of"]

_DPI = 70  # resolution of the picture beside the table
_IVORY = (0.80, 0.77, 0.70)  # one colour for all shapes, so as not to suggest a correspondence
_MOST = 6  # largest number of meshes drawn, and of landmarks listed
# Largest number of faces drawn automatically; matplotlib takes about a second for so many.
_MOST_FACES = 200_000


class _Shown(NamedTuple):
    """Contents of the output: a title, rows of the table, and a function that makes the scene."""

    title: str
    rows: dict[str, str]
    scene: Callable[[], Scene | None]


def html_of(item: Any) -> str:
    """Return HTML with a small picture and a table for a shape, a match or a collection.

    There is no picture if matplotlib is not installed or a mesh cannot be opened.
    """
    shown = _shown(item)
    rows, picture = dict(shown.rows), ""
    try:
        picture = _picture(shown)
    except ImportError:
        rows["picture"] = "needs matplotlib"
    except (MeshError, OSError, ValueError) as error:
        rows["picture"] = f"none: {error}"
    lines = "".join(
        f'<tr><th style="text-align:left">{html.escape(name)}</th>'
        f'<td style="text-align:left">{html.escape(value)}</td></tr>'
        for name, value in rows.items()
    )
    return (
        '<div style="display:flex;flex-wrap:wrap;align-items:center;gap:1em">'
        f"{picture}<div><strong>{html.escape(shown.title)}</strong>"
        f"<table>{lines}</table></div></div>"
    )


def _picture(shown: _Shown) -> str:
    """Return the picture as an HTML element; an empty string if there is nothing to draw."""
    scene = shown.scene()
    if scene is None:
        return ""
    n_faces = sum(panel.mesh.n_faces for panel in scene.panels)
    if n_faces > _MOST_FACES:
        raise ValueError(
            f"{n_faces} faces are too many to draw automatically; use skfmap.plotting."
        )
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = draw_scene(scene, Figure)  # pyplot would show the figure a second time
    figure.set_dpi(_DPI)
    file = io.BytesIO()
    FigureCanvasAgg(figure).print_png(file, metadata={"Software": None})
    text = base64.b64encode(file.getvalue()).decode()
    return f'<img alt="{html.escape(shown.title)}" src="data:image/png;base64,{text}">'


@singledispatch
def _shown(item: Any) -> _Shown:
    raise TypeError(f"No picture is defined for a {type(item).__name__}.")


@_shown.register
def _(mesh: Mesh) -> _Shown:
    extent = np.ptp(mesh.vertices, axis=0)
    rows = {
        "vertices": str(mesh.n_vertices),
        "faces": str(mesh.n_faces),
        "area": f"{mesh.area:.4g}",
        "extent": " × ".join(f"{length:.3g}" for length in extent),  # noqa: RUF001
    }
    return _Shown(f"Mesh {mesh.name or ''}", rows, lambda: _scene([mesh]))


@_shown.register
def _(match: Match) -> _Shown:
    n, known = len(match.p2p), match.p2p >= 0
    rows = {"vertices": f"{n}, of which {int(known.sum())} have a match"}
    errors = match.expected_error
    if errors is not None and not np.isnan(errors).all():
        tenth = np.nanpercentile(errors, 90)
        rows["expected error"] = (
            f"mean {np.nanmean(errors):.3f}, 90th percentile {tenth:.3f}, in sqrt(area)"
        )
    if np.isfinite(match.misfit):
        rows["misfit"] = f"{match.misfit:.2f} (above 1 is worse than any training shape)"
    if match.familiar is not None:
        rows["like the training shapes"] = "yes" if match.familiar else "no"
    title = f"Match {match.name or 'shape'} → {match.reference_name or 'reference'}"
    return _Shown(title, rows, lambda: _scene_of_match(match))


@_shown.register
def _(laid: Registered) -> _Shown:
    rows = {
        "fits": "yes" if laid.fits else "no",
        "area off the shape": f"{laid.off:.1%}",
        "area of the shape not covered": f"{laid.uncovered:.1%}",
        "area stretched": f"{laid.stretched:.1%}",
        "faces folded over": str(laid.n_flipped),
        "median distance": f"{np.median(laid.distance):.3g}",
    }
    title = f"{laid.reference_name or 'reference'} laid onto {laid.name or 'shape'}"
    return _Shown(title, rows, lambda: _scene([laid.mesh]))


@_shown.register
def _(marks: Landmarks) -> _Shown:
    rows = {"landmarks": f"{len(marks.names)}, of which {int(marks.placed.sum())} are placed"}
    if marks.expected_error is not None and np.isfinite(marks.expected_error).any():
        rows["expected error"] = f"mean {np.nanmean(marks.expected_error):.3g}"
    for name, point in list(zip(marks.names, marks.points, strict=True))[:_MOST]:
        rows[name] = ", ".join(f"{x:.4g}" for x in point)
    if len(marks.names) > _MOST:
        rows["..."] = f"and {len(marks.names) - _MOST} more"
    return _Shown(f"Landmarks {marks.name or ''}", rows, lambda: None)


@_shown.register
def _(collection: Collection) -> _Shown:
    meshes = [mesh for mesh in collection.meshes if isinstance(mesh, Mesh)]
    sizes = [mesh.n_vertices for mesh in meshes]
    rows = {"meshes": str(len(collection.meshes))}
    if sizes:
        rows["vertices"] = f"{min(sizes)} to {max(sizes)}"
    if len(meshes) < len(collection.meshes):
        rows["skipped"] = str(len(collection.meshes) - len(meshes))
    rows["about"] = " ".join(str(collection.get("DESCR", "")).split("\n\n")[0].split())
    camera = Camera(up=collection.get("up", "z"))
    title = f"Collection {', '.join(map(str, collection.names[:_MOST]))}"
    title += ", ..." if len(collection.names) > _MOST else ""
    return _Shown(title, rows, lambda: _scene(meshes[:_MOST], camera))


def _scene(meshes: Sequence[Mesh], camera: Camera | None = None) -> Scene | None:
    """Return a scene of meshes side by side, in one colour."""
    if not meshes:
        return None
    usual = dict.fromkeys(("captions", "labels", "cmap", "limits"))
    heights = [mesh.vertices[:, 2] for mesh in meshes]
    scene = scene_of_functions(meshes, heights, **usual, camera=camera)
    panels = [
        replace(panel, values=(np.tile(_IVORY, (panel.mesh.n_vertices, 1)),))
        for panel in scene.panels
    ]
    return replace(scene, panels=tuple(panels), scales=(None,))


def _scene_of_match(match: Match) -> Scene:
    return scene_of_matches(
        [match],
        None,
        None,
        show=("match",),
        errors=None,
        captions=None,
        camera=None,
        align=True,
    )
