"""Pictures of functions on meshes and of matches."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from skfmap._tools.types import Array
from skfmap._tools.validation import check_folder
from skfmap.io import as_mesh
from skfmap.metrics import PairErrors
from skfmap.plotting._camera import Camera, check_camera
from skfmap.plotting._colours import Scale, scale_of
from skfmap.plotting._scene import Scene, check_values, scene_of_functions, scene_of_matches
from skfmap.plotting._surface import draw_surface
from skfmap.shapes import Match

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_scene", "plot_function", "plot_functions", "plot_matches"]

# Chosen by eye: inches across a panel, dots per inch of files, and heights of panels in widths.
_WIDTH, _DPI = 2.6, 150
_FLATTEST, _TALLEST = 0.4, 1.6
# Half of the largest shape, and a little room around it.
_REACH = 0.52


def plot_function(
    mesh: Any,
    values: ArrayLike,
    *,
    ax: "Axes | None" = None,
    cmap: str | None = None,
    limits: Sequence[float] | None = None,
    camera: Camera | None = None,
) -> "Axes":
    """Draw a function, or colours, on a lit mesh.

    Parameters
    ----------
    mesh : mesh
        What to draw: whatever a mesh may be, a path included.
    values : array-like of shape (n_vertices,) or (n_vertices, 3)
        Function on the vertices, or their colours in [0, 1]. Masked and undefined values are grey,
        so that what `Match.transfer` returns can be drawn.
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.
    cmap : str, optional
        Colour map of matplotlib; by default a diverging one about zero where the function has both
        signs, and a sequential one elsewhere. Both are perceptually uniform and safe for the
        colour-blind.
    limits : (float, float), optional
        Values at the ends of the colour map; those of the function by default.
    camera : Camera, optional
        Where the picture is taken from.

    Returns
    -------
    matplotlib Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        If there is not one value, or one colour, for each vertex.

    See Also
    --------
    plot_functions : Several, side by side.

    Examples
    --------
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.plotting import plot_function
    >>> sphere = make_sphere(n_subdivisions=3)
    >>> axes = plot_function(sphere, sphere.vertices[:, 2])
    >>> axes.figure.savefig("height.png")  # doctest: +SKIP
    """
    from matplotlib import pyplot as plt  # noqa: PLC0415

    mesh, camera = as_mesh(mesh), check_camera(camera)
    given = check_values(values, mesh)
    if ax is None:
        ax = plt.figure(figsize=(4, 4)).add_subplot()
    colours = given if given.ndim == 2 else scale_of([given], cmap, limits).colours(given)
    draw_surface(ax, camera.project(mesh.vertices), mesh.faces, np.ma.filled(colours, 0.5))
    return ax


def plot_functions(
    meshes: Sequence[Any],
    functions: Sequence[ArrayLike],
    *,
    captions: Sequence[str] | None = None,
    labels: Sequence[str] | None = None,
    cmap: str | None = None,
    limits: Sequence[float] | None = None,
    camera: Camera | None = None,
    path: str | Path | None = None,
) -> "Figure":
    """Draw functions on several meshes side by side, seen by one camera, at one scale.

    Parameters
    ----------
    meshes : sequence of meshes
        One column each. The same mesh may stand several times.
    functions : sequence of arrays of shape (n_vertices_i,) or (n_vertices_i, n_functions)
        For each mesh, the function or functions on it; one row each, which shares a scale of
        colours.
    captions : sequence of str, optional
        Above each mesh; names by default.
    labels : sequence of str, optional
        What each function is, beside its scale.
    cmap, limits, camera : optional
        As in `plot_function`, for all rows.
    path : str or Path, optional
        Where to save the picture; the suffix chooses the format.

    Returns
    -------
    matplotlib Figure
        The picture.

    Raises
    ------
    ValueError
        If meshes, functions and texts do not fit each other.

    See Also
    --------
    write_functions_page : The same as a page to turn the shapes in.

    Examples
    --------
    >>> from skfmap import SpectralBasis
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.plotting import plot_functions
    >>> (sphere,) = SpectralBasis(10).transform([make_sphere(n_subdivisions=3)])
    >>> labels = ["first", "second", "third"]
    >>> figure = plot_functions([sphere.mesh], [sphere.evecs[:, 1:4]], labels=labels)
    """
    scene = scene_of_functions(
        meshes, functions, captions=captions, labels=labels, cmap=cmap, limits=limits, camera=camera
    )
    return _saved(draw_scene(scene), path)


def plot_matches(
    matches: Sequence[Match],
    meshes: Sequence[Any] | None = None,
    reference: Any = None,
    *,
    show: Sequence[str] | None = None,
    errors: Sequence[PairErrors] | None = None,
    captions: Sequence[str] | None = None,
    camera: Camera | None = None,
    align: bool = True,
    path: str | Path | None = None,
) -> "Figure":
    """Draw matches as colours carried from the reference, and below how far to trust them.

    Each vertex of a shape has the colour of the vertex of the reference that it is matched to.

    Parameters
    ----------
    matches : sequence of Match
        From `skfmap.match`.
    meshes : sequence of meshes, optional
        The matched shapes: whatever a mesh may be, paths included; those that the matches know by
        default.
    reference : mesh, optional
        The reference, whose colours tell where on it a vertex is; that of the matches by default.
    show : sequence of {"match", "expected error", "confidence", "true error"}, optional
        The rows; by default the match, and its expected error if it has one.
    errors : sequence of PairErrors, optional
        From `skfmap.WeightedFunctionalMapLearner.pair_errors`, if the correspondences are known: a
        row of true errors is added, grey where nothing is known.
    captions : sequence of str, optional
        One per match, below its name.
    camera : Camera, optional
        Where the picture is taken from; one camera for all.
    align : bool, default=True
        Whether shapes are turned about the vertical to face as the reference does, as far as the
        match tells.
    path : str or Path, optional
        Where to save the picture; the suffix chooses the format.

    Returns
    -------
    matplotlib Figure
        The picture.

    Raises
    ------
    ValueError
        If matches, meshes and reference do not fit each other.

    See Also
    --------
    write_matches_page : The same as a page to turn the shapes in.
    """
    scene = scene_of_matches(
        matches,
        meshes,
        reference,
        show=show,
        usual=("match", "expected error"),
        errors=errors,
        captions=captions,
        camera=camera,
        align=align,
    )
    return _saved(draw_scene(scene), path)


def draw_scene(scene: Scene, make: Callable[..., "Figure"] | None = None) -> "Figure":
    """Return a figure of a scene, all panels at one scale; ``make`` makes it, by default pyplot."""
    if make is None:
        from matplotlib import pyplot as plt  # noqa: PLC0415

        make = plt.figure
    n_rows, n_columns = len(scene.labels), len(scene.panels)
    seen = [scene.camera.project_upright(panel.points) for panel in scene.panels]
    centres = [(points.min(axis=0) + points.max(axis=0))[:2] / 2 for points in seen]
    reach = _REACH * np.max([np.ptp(points[:, :2], axis=0) for points in seen], axis=0)
    height = _WIDTH * float(np.clip(reach[1] / reach[0], _FLATTEST, _TALLEST))
    figure = make(figsize=(_WIDTH * n_columns + 0.9, height * n_rows + 0.4), layout="constrained")
    # Ticks would not be seen, but each would be laid out.
    axes = figure.subplots(
        n_rows, n_columns, squeeze=False, subplot_kw={"xticks": [], "yticks": []}
    )
    for row, label in enumerate(scene.labels):
        for panel, points, centre, ax in zip(scene.panels, seen, centres, axes[row], strict=True):
            colours = scene.colours(panel, row)
            if colours is not None:
                draw_surface(ax, points, panel.mesh.faces, np.ma.filled(colours, 0.5))
            low, high = centre - reach, centre + reach
            ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            ax.set_axis_off()
            if row == 0:
                ax.set_title(panel.caption, fontsize=9)
        _draw_scale(figure, axes[row], scene.scales[row], label)
    return figure


def _draw_scale(figure: "Figure", axes: Array, scale: Scale | None, label: str) -> None:
    from matplotlib.cm import ScalarMappable  # noqa: PLC0415
    from matplotlib.colors import Normalize  # noqa: PLC0415

    if scale is None:
        return
    drawn = figure.colorbar(
        ScalarMappable(Normalize(scale.low, scale.high), cmap=scale.cmap),
        ax=list(axes),
        shrink=0.75,
        pad=0.01,
    )
    drawn.set_label(scale.label or label, fontsize=9)
    drawn.ax.tick_params(labelsize=8)


def _saved(figure: "Figure", path: str | Path | None) -> "Figure":
    if path is not None:
        figure.savefig(check_folder(path), dpi=_DPI)
    return figure
