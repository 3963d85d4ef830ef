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

# Chosen by eye: width of a panel in inches, dots per inch of files, and the range of the ratio of
# height to width of a panel.
_WIDTH, _DPI = 2.6, 150
_FLATTEST, _TALLEST = 0.4, 1.6
# Half the extent of a panel, as a multiple of the extent of the largest shape, with some margin.
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
    mesh : Mesh, trimesh.Trimesh, (vertices, faces) or path
        Mesh to draw.
    values : array-like of shape (n_vertices,) or (n_vertices, 3)
        Values of the function at the vertices, or their colours in [0, 1]. Masked and undefined
        values, such as those returned by `Match.transfer`, are grey.
    ax : matplotlib Axes, optional
        Axes to draw on; those of a new figure by default.
    cmap : str, optional
        Name of a matplotlib colour map. The default diverges about zero if the function has both
        signs; otherwise it is sequential. Both defaults are perceptually uniform and safe for
        colour vision deficiency.
    limits : (float, float), optional
        Values at the ends of the colour map; by default the range of the function, which is
        symmetric about zero if the function has both signs.
    camera : Camera, optional
        Direction of view.

    Returns
    -------
    matplotlib Axes
        The axes with the picture.

    Raises
    ------
    ValueError
        If ``values`` does not have one value or one colour for each vertex.

    See Also
    --------
    plot_functions : Draw several functions side by side.

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
    """Draw functions on several meshes side by side, at the same scale and with the same camera.

    Parameters
    ----------
    meshes : sequence of meshes
        Meshes to draw, one column each. A mesh may occur several times.
    functions : sequence of arrays of shape (n_vertices_i,) or (n_vertices_i, n_functions)
        For each mesh, one or more functions on it. Each function is a row of the picture, with a
        common colour scale.
    captions : sequence of str, optional
        Text above each mesh; the names of the meshes by default.
    labels : sequence of str, optional
        Description of each function, shown beside its colour scale.
    cmap, limits, camera : optional
        As in `plot_function`, for all rows.
    path : str or Path, optional
        File to save the picture to; the suffix selects the format.

    Returns
    -------
    matplotlib Figure
        The picture.

    Raises
    ------
    ValueError
        If the numbers of meshes, functions, captions or labels do not agree.

    See Also
    --------
    write_functions_page : Write the same as an interactive page.

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
    """Draw matches as colours carried over from the reference, with their expected errors.

    Each vertex of a shape has the colour of its matched vertex on the reference.

    Parameters
    ----------
    matches : sequence of Match
        Matches returned by `skfmap.match`.
    meshes : sequence of meshes, optional
        Meshes or paths of the matched shapes; by default the given meshes stored in the matches.
    reference : mesh, optional
        Mesh or path of the reference, which is coloured by position; by default the one stored in
        the matches.
    show : sequence of {"match", "expected error", "confidence", "true error"}, optional
        Rows of the picture; by default the match and, if known, its expected error.
    errors : sequence of PairErrors, optional
        True errors, from `skfmap.WeightedFunctionalMapLearner.pair_errors`. They are drawn in a row
        of their own, grey at vertices whose error is not known.
    captions : sequence of str, optional
        Text below the name of each match.
    camera : Camera, optional
        Direction of view, the same for all shapes.
    align : bool, default=True
        Whether to turn shapes about the vertical axis so that they face as the reference does,
        judged by the match.
    path : str or Path, optional
        File to save the picture to; the suffix selects the format.

    Returns
    -------
    matplotlib Figure
        The picture.

    Raises
    ------
    ValueError
        If matches, meshes and reference do not belong together.

    See Also
    --------
    write_matches_page : Write the same as an interactive page.
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
    """Return a figure of a scene with all panels at the same scale.

    ``make`` creates the figure; by default it is ``pyplot.figure``.
    """
    if make is None:
        from matplotlib import pyplot as plt  # noqa: PLC0415

        make = plt.figure
    n_rows, n_columns = len(scene.labels), len(scene.panels)
    seen = [scene.camera.project_upright(panel.points) for panel in scene.panels]
    centres = [(points.min(axis=0) + points.max(axis=0))[:2] / 2 for points in seen]
    reach = _REACH * np.max([np.ptp(points[:, :2], axis=0) for points in seen], axis=0)
    height = _WIDTH * float(np.clip(reach[1] / reach[0], _FLATTEST, _TALLEST))
    figure = make(figsize=(_WIDTH * n_columns + 0.9, height * n_rows + 0.4), layout="constrained")
    # Ticks are invisible here, but would slow down the layout.
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
