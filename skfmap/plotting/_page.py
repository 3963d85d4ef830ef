"""Interactive HTML pages in which shapes can be turned.

Any browser opens them without a server or a network. They are made with plotly, which the extra
``pages`` installs.
"""

import html
import json
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from skfmap._tools.types import FloatArray, IntArray
from skfmap._tools.validation import check_folder
from skfmap.metrics import PairErrors
from skfmap.plotting._camera import Camera
from skfmap.plotting._colours import UNKNOWN, Scale, undefined_as_nan
from skfmap.plotting._scene import Panel, Scene, scene_of_functions, scene_of_matches
from skfmap.shapes import Match

__all__ = [
    "Page",
    "functions_page",
    "matches_page",
    "write_functions_page",
    "write_matches_page",
]

# Browsers allow about sixteen WebGL contexts, and each shape takes one.
_MOST_PANELS = 12
# Size of a panel in pixels, chosen so that four fit on a screen 1,400 pixels wide, and margins for
# buttons and scales.
_SIZE, _COLUMNS = 320, 4
_ABOVE, _BELOW, _RIGHT = 90, 20, 110
# Light and camera were chosen by eye; the two zeros make plotly use normals of small triangles too.
_LIGHTING = {
    "ambient": 0.45,
    "diffuse": 0.6,
    "specular": 0.1,
    "facenormalsepsilon": 0,
    "vertexnormalsepsilon": 0,
}
_LIGHT = {"x": 30_000, "y": -60_000, "z": 90_000}
_ZOOM, _DISTANCE = 2.7, 4.0
# Number of colours that approximate a colour scale.
_N_STOPS = 33

# Turning one shape turns all: the camera of the moved scene is copied to the others.
_LINK_CAMERAS = """
const page = document.getElementById('{plot_id}');
const scenes = %s;
let busy = false;
page.on('plotly_relayouting', follow);
page.on('plotly_relayout', follow);
function follow(change) {
  const moved = scenes.find(scene => change[scene + '.camera']);
  if (busy || !moved) return;
  busy = true;
  const update = {};
  for (const scene of scenes) {
    if (scene !== moved) update[scene + '.camera'] = change[moved + '.camera'];
  }
  Plotly.relayout(page, update).then(() => { busy = false; }, () => { busy = false; });
}
"""


class Page:
    """An interactive page in which shapes can be turned.

    Notebooks display it, and `save` writes it to a file.

    Attributes
    ----------
    html : str
        The complete page, about 5 MB.
    width, height : int
        Size of the page in pixels.
    """

    def __init__(self, html: str, width: int, height: int) -> None:
        self.html, self.width, self.height = html, width, height

    def __repr__(self) -> str:
        """Return one line with the size."""
        return f"Page({self.width} x {self.height} pixels, {len(self.html) / 1e6:.1f} MB)"

    def _repr_html_(self) -> str:
        # A frame keeps its scripts and styles apart from those of the notebook.
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" width="{self.width}" '
            f'height="{self.height}" style="border:none"></iframe>'
        )

    def save(self, path: str | Path) -> Path:
        """Write the page to an ``.html`` file, which opens without a network.

        Parameters
        ----------
        path : str or Path
            File to write.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        ValueError
            If the suffix is not ``.html`` or ``.htm``.
        FileNotFoundError
            If the folder does not exist.
        """
        _check_suffix(path)
        check_folder(path).write_text(self.html, encoding="utf-8")
        return Path(path)


def functions_page(
    meshes: Sequence[Any],
    functions: Sequence[ArrayLike],
    *,
    captions: Sequence[str] | None = None,
    labels: Sequence[str] | None = None,
    cmap: str | None = None,
    limits: Sequence[float] | None = None,
    camera: Camera | None = None,
) -> Page:
    """Return an interactive page of functions on shapes, with buttons to select the function.

    Parameters
    ----------
    meshes, functions, captions, labels, cmap, limits, camera : optional
        As in `plot_functions`, for at most twelve shapes.

    Returns
    -------
    Page
        The page, which notebooks display.

    Raises
    ------
    ImportError, ValueError
        As in `write_functions_page`.
    """
    scene = scene_of_functions(
        meshes, functions, captions=captions, labels=labels, cmap=cmap, limits=limits, camera=camera
    )
    return _page(scene, [None] * len(scene.panels), "Functions")


def matches_page(
    matches: Sequence[Match],
    meshes: Sequence[Any] | None = None,
    reference: Any = None,
    *,
    show: Sequence[str] | None = None,
    errors: Sequence[PairErrors] | None = None,
    captions: Sequence[str] | None = None,
    camera: Camera | None = None,
    align: bool = True,
) -> Page:
    """Return an interactive page of matched shapes, with buttons to select what is shown.

    Parameters
    ----------
    matches, meshes, reference, show, errors, captions, camera, align : optional
        As in `plot_matches`, for at most eleven shapes beside the reference.

    Returns
    -------
    Page
        The page, which notebooks display.

    Raises
    ------
    ImportError, ValueError
        As in `write_matches_page`.
    """
    scene = scene_of_matches(
        matches,
        meshes,
        reference,
        show=show,
        usual=("match", "expected error", "confidence"),
        errors=errors,
        captions=captions,
        camera=camera,
        align=align,
    )
    return _page(scene, [None, *(match.p2p for match in matches)], "Matches")


def write_functions_page(
    path: str | Path,
    meshes: Sequence[Any],
    functions: Sequence[ArrayLike],
    *,
    captions: Sequence[str] | None = None,
    labels: Sequence[str] | None = None,
    cmap: str | None = None,
    limits: Sequence[float] | None = None,
    camera: Camera | None = None,
) -> Path:
    """Write an interactive page of functions on shapes, with buttons to select the function.

    Parameters
    ----------
    path : str or Path
        The ``.html`` file to write. It is self-contained, about 5 MB, and opens without a network.
    meshes, functions, captions, labels, cmap, limits, camera : optional
        As in `plot_functions`, for at most twelve shapes.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ImportError
        If plotly is not installed.
    ValueError
        If the numbers of meshes, functions, captions or labels do not agree, or there are more than
        twelve shapes.

    Examples
    --------
    >>> import tempfile
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.plotting import write_functions_page
    >>> sphere = make_sphere(n_subdivisions=3)
    >>> path = tempfile.mkdtemp() + "/sphere.html"
    >>> height = sphere.vertices[:, 2]
    >>> write_functions_page(path, [sphere], [height], labels=["height"]).stat().st_size > 1e6
    True
    """
    _check_suffix(path)
    page = functions_page(
        meshes, functions, captions=captions, labels=labels, cmap=cmap, limits=limits, camera=camera
    )
    return page.save(path)


def write_matches_page(
    path: str | Path,
    matches: Sequence[Match],
    meshes: Sequence[Any] | None = None,
    reference: Any = None,
    *,
    show: Sequence[str] | None = None,
    errors: Sequence[PairErrors] | None = None,
    captions: Sequence[str] | None = None,
    camera: Camera | None = None,
    align: bool = True,
) -> Path:
    """Write an interactive page of matched shapes, with buttons to select what is shown.

    Pointing at a vertex shows its index and the index of its matched vertex on the reference.

    Parameters
    ----------
    path : str or Path
        The ``.html`` file to write. It is self-contained, about 5 MB, and opens without a network.
    matches, meshes, reference, show, errors, captions, camera, align : optional
        As in `plot_matches`, for at most eleven shapes beside the reference.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ImportError
        If plotly is not installed.
    ValueError
        If matches, meshes and reference do not belong together, or there are more than eleven
        matches.
    """
    _check_suffix(path)
    page = matches_page(
        matches,
        meshes,
        reference,
        show=show,
        errors=errors,
        captions=captions,
        camera=camera,
        align=align,
    )
    return page.save(path)


def _check_suffix(path: str | Path) -> None:
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"The file of a page must end in .html; got {str(path)!r}.")


def _page(scene: Scene, targets: Sequence[IntArray | None], title: str) -> Page:
    """Return the page of a scene; ``targets`` holds the point-to-point map, if any, per panel."""
    if len(scene.panels) > _MOST_PANELS:
        raise ValueError(
            f"A page can show at most {_MOST_PANELS} shapes, because browsers limit the number of "
            f"WebGL contexts; got {len(scene.panels)}. Write several pages, or use pictures."
        )
    go = _plotly()
    layout = _layout(scene)
    figure = go.Figure(layout=layout)
    for column, (panel, target) in enumerate(zip(scene.panels, targets, strict=True)):
        figure.add_trace(_surface(go, scene, panel, target, column))
    for row, (scale, label) in enumerate(zip(scene.scales, scene.labels, strict=True)):
        figure.add_trace(_scale_bar(go, scale, label, visible=row == 0))
    names = json.dumps([_scene_name(column) for column in range(len(scene.panels))])
    text = figure.to_html(
        include_plotlyjs=True,
        post_script=_LINK_CAMERAS % names,
        config={"displaylogo": False, "responsive": False},
    )
    text = text.replace(
        "<head>", f'<head><meta charset="utf-8" /><title>skfmap: {title}</title>', 1
    )
    return Page(text, layout["width"], layout["height"])


def _plotly() -> ModuleType:
    try:
        import plotly.graph_objects as go  # noqa: PLC0415
    except ImportError as error:
        raise ImportError(
            "Interactive pages need plotly, which is not installed: pip install 'skfmap[pages]'. "
            "plot_functions and plot_matches draw pictures without it."
        ) from error
    return go


def _scene_name(column: int) -> str:
    return "scene" if column == 0 else f"scene{column + 1}"


def _surface(
    go: ModuleType, scene: Scene, panel: Panel, target: IntArray | None, column: int
) -> Any:
    points, faces = panel.points.astype(np.float32), panel.mesh.faces.astype(np.int32)
    return go.Mesh3d(
        **dict(zip("xyz", points.T, strict=True)),
        **dict(zip("ijk", faces.T, strict=True)),
        scene=_scene_name(column),
        name=html.escape(panel.caption),
        hoverinfo="text",
        hovertext=_hover(scene, panel, target),
        lighting=_LIGHTING,
        lightposition=_LIGHT,
        vertexcolor=_hexadecimal(_colours(scene, panel, 0)),
    )


def _colours(scene: Scene, panel: Panel, row: int) -> FloatArray:
    colours = scene.colours(panel, row)
    if colours is None:
        return np.tile(UNKNOWN, (panel.mesh.n_vertices, 1))
    return np.ma.filled(colours, 0.5)


def _hexadecimal(colours: FloatArray) -> list[str]:
    return [
        f"#{red:02x}{green:02x}{blue:02x}"
        for red, green, blue in (255 * np.clip(colours, 0, 1)).round().astype(int)
    ]


def _hover(scene: Scene, panel: Panel, target: IntArray | None) -> list[str]:
    """Return the text shown when the pointer is on each vertex."""
    columns = [[f"vertex {v}" for v in range(panel.mesh.n_vertices)]]
    if target is not None:
        columns.append([f"vertex {v} of the reference" if v >= 0 else "no match" for v in target])
    for values, scale, label in zip(panel.values, scene.scales, scene.labels, strict=True):
        if values is not None and scale is not None:
            columns.append(
                [f"{html.escape(label)} {value:.4g}" for value in undefined_as_nan(values)]
            )
    return ["<br>".join(texts) for texts in zip(*columns, strict=True)]


def _layout(scene: Scene) -> dict[str, Any]:
    """Return the layout: panels with captions, a common camera, and a button for each row."""
    n_columns = min(_COLUMNS, len(scene.panels))
    n_rows = -(-len(scene.panels) // n_columns)
    layout: dict[str, Any] = {
        "width": _SIZE * n_columns + _RIGHT,
        "height": _SIZE * n_rows + _ABOVE + _BELOW,
        "margin": {"l": 0, "r": _RIGHT, "t": _ABOVE, "b": _BELOW},
        "font": {"family": "sans-serif", "size": 13},
        "showlegend": False,
        "xaxis": {"visible": False},
        "yaxis": {"visible": False},
        "plot_bgcolor": "white",
        "updatemenus": [_buttons(scene)],
    }
    shared = _view(scene)
    captions = []
    for i, panel in enumerate(scene.panels):
        x, y = (i % n_columns) / n_columns, 1 - (i // n_columns + 1) / n_rows
        layout[_scene_name(i)] = {
            "domain": {"x": [x, x + 1 / n_columns], "y": [y, y + 1 / n_rows]},
            **shared,
        }
        captions.append(_caption(panel, x + 0.5 / n_columns, y + 1 / n_rows))
    return layout | {"annotations": captions}


def _view(scene: Scene) -> dict[str, Any]:
    """Return the camera and the axes, which all panels share."""
    reach = max(float(np.abs(panel.points).max()) for panel in scene.panels)
    axis = {"visible": False, "range": [-reach, reach]}
    return {
        **dict.fromkeys(("xaxis", "yaxis", "zaxis"), axis),
        "aspectmode": "manual",
        "aspectratio": dict.fromkeys("xyz", _ZOOM),
        "camera": {
            "eye": dict(zip("xyz", (_DISTANCE * scene.camera.position()).tolist(), strict=True)),
            "up": {"x": 0, "y": 0, "z": 1},
            # Plotly does not apply lighting in orthographic projection.
            "projection": {"type": "perspective"},
        },
    }


def _caption(panel: Panel, x: float, y: float) -> dict[str, Any]:
    text = html.escape(panel.caption).replace("\n", "<br>")
    paper = {"xref": "paper", "yref": "paper"}
    return {"text": text, "x": x, "y": y, **paper, "showarrow": False, "yanchor": "top"}


def _scale_bar(go: ModuleType, scale: Scale | None, label: str, *, visible: bool) -> Any:
    """Return an empty trace that shows a colour scale."""
    if scale is None:
        return go.Scatter(x=[None], y=[None], visible=visible, hoverinfo="skip")
    stops = np.linspace(0, 1, _N_STOPS)
    colours = _hexadecimal(scale.colours(scale.low + stops * (scale.high - scale.low)))
    marker = {
        "color": [scale.low],
        "cmin": scale.low,
        "cmax": scale.high,
        "colorscale": list(zip(stops.tolist(), colours, strict=True)),
        "showscale": True,
        "colorbar": {
            "title": {"text": html.escape(scale.label or label), "side": "right"},
            "len": 0.8,
            "thickness": 14,
        },
    }
    return go.Scatter(
        x=[None], y=[None], mode="markers", marker=marker, visible=visible, hoverinfo="skip"
    )


def _buttons(scene: Scene) -> dict[str, Any]:
    """Return one button per row, which colours all shapes and shows the scale of the row."""
    n_panels, n_rows = len(scene.panels), len(scene.labels)
    buttons = []
    for row, label in enumerate(scene.labels):
        colours = [_hexadecimal(_colours(scene, panel, row)) for panel in scene.panels]
        shown = [True] * n_panels + [other == row for other in range(n_rows)]
        change = {"vertexcolor": colours + [None] * n_rows, "visible": shown}
        text = html.escape(label or f"function {row + 1}")
        buttons.append({"label": text, "method": "restyle", "args": [change]})
    position = {"x": 0.01, "xanchor": "left", "y": 1, "yanchor": "bottom", "pad": {"b": 25}}
    return {"type": "buttons", "direction": "right", "buttons": buttons, **position}
