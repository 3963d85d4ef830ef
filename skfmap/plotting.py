"""Pictures of functions on meshes and of matches, drawn by matplotlib without a screen."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skfmap._typing import FloatArray
from skfmap._validation import check_choice
from skfmap.io import as_mesh
from skfmap.shapes import Match, Mesh

__all__ = ["plot_function", "plot_matches", "plot_reliability"]

# Camera: rotation about the up axis and elevation above the ground, in degrees.
_AZIMUTH, _ELEVATION = 60.0, 20.0
_LIGHT = np.array([0.3, 0.8, 0.9]) / np.linalg.norm([0.3, 0.8, 0.9])


def plot_function(
    mesh: Mesh, values: FloatArray, *, ax: Any = None, cmap: str = "viridis", up: str = "z", limits: Any = None
) -> Any:
    """Draw a function, or colours, on a lit mesh.

    Parameters
    ----------
    mesh : Mesh
        What to draw.
    values : ndarray of shape (n_vertices,) or (n_vertices, 3)
        Function on the vertices, or their colours in [0, 1].
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.
    cmap : str, default="viridis"
        Colour map of a function.
    up : {"x", "y", "z"}, default="z"
        Which axis of the mesh points up.
    limits : (float, float), optional
        Values at the ends of the colour map; those of the function by default.

    Returns
    -------
    matplotlib Axes
        The axes drawn on.
    """
    import matplotlib as mpl  # noqa: PLC0415
    from matplotlib import pyplot as plt  # noqa: PLC0415
    from matplotlib.collections import PolyCollection  # noqa: PLC0415

    check_choice(up, "up", ("x", "y", "z"))
    if ax is None:
        ax = plt.figure(figsize=(4, 4)).add_subplot()
    colours = np.asarray(values, dtype=np.float64)
    if colours.ndim == 1:
        low, high = (colours.min(), colours.max()) if limits is None else limits
        colours = mpl.colormaps[cmap]((colours - low) / max(high - low, 1e-300))[:, :3]
    corners = _seen_from_camera(mesh, up)[mesh.faces]
    shade = _brightness(corners)
    faces = np.clip(colours[mesh.faces].mean(axis=1) * shade[:, None], 0, 1)
    order = np.argsort(corners[:, :, 2].mean(axis=1), kind="stable")
    colours = faces[order]
    ax.add_collection(PolyCollection(list(corners[order, :, :2]), facecolors=colours, edgecolors=colours, lw=0.2))
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.set_axis_off()
    return ax


def plot_matches(
    matches: Sequence[Match],
    meshes: Sequence[Any],
    reference: Any,
    *,
    path: str | Path | None = None,
    up: str = "z",
    captions: Sequence[str] | None = None,
) -> Any:
    """Draw matches as colours carried from the reference, and the expected error below.

    Parameters
    ----------
    matches : sequence of Match
        From `skfmap.match`.
    meshes : sequence of meshes
        The matched shapes: whatever a mesh may be, paths included.
    reference : mesh
        The reference; its colours are its coordinates.
    path : str or Path, optional
        Where to save the picture; the suffix chooses the format.
    up : {"x", "y", "z"}, default="z"
        Which axis of the meshes points up.
    captions : sequence of str, optional
        One per match, below its name.

    Returns
    -------
    matplotlib Figure
        The picture.
    """
    from matplotlib import pyplot as plt  # noqa: PLC0415
    from matplotlib.cm import ScalarMappable  # noqa: PLC0415
    from matplotlib.colors import Normalize  # noqa: PLC0415

    if len(matches) != len(meshes) or not matches:
        raise ValueError(f"Give one mesh per match, and at least one; got {len(meshes)} and {len(matches)}.")
    meshes, reference = [as_mesh(mesh) for mesh in meshes], as_mesh(reference)
    figure = plt.figure(figsize=(3.2 * (len(matches) + 1), 6.2), layout="constrained")
    axes = figure.subplots(2, len(matches) + 1, squeeze=False)
    colours = _colours_of_position(reference)
    plot_function(reference, colours, ax=axes[0, 0], up=up).set_title(f"reference: {reference.name}", fontsize=10)
    axes[1, 0].set_axis_off()
    worst = max(0.02, *(float(match.expected_error.max()) for match in matches))
    for column, (match, mesh) in enumerate(zip(matches, meshes, strict=True), start=1):
        title = f"{match.name}" + ("" if captions is None else f"\n{captions[column - 1]}")
        plot_function(mesh, colours[match.p2p], ax=axes[0, column], up=up).set_title(title, fontsize=10)
        plot_function(mesh, match.expected_error, ax=axes[1, column], up=up, cmap="cividis", limits=(0, worst))
    scale = ScalarMappable(Normalize(0, worst), cmap="cividis")
    figure.colorbar(scale, ax=axes[1, 0], location="right", shrink=0.7, label="expected error, sqrt(area)")
    if path is not None:
        figure.savefig(path, dpi=130)
    return figure


def _colours_of_position(mesh: Mesh) -> FloatArray:
    """Return a colour for each vertex that changes smoothly along the three axes."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return 0.15 + 0.8 * (mesh.vertices - low) / np.maximum(high - low, 1e-300)


def _seen_from_camera(mesh: Mesh, up: str) -> FloatArray:
    """Return coordinates right, up and towards the camera."""
    axis = "xyz".index(up)
    centred = mesh.vertices - mesh.vertices.mean(axis=0)
    right, height, depth = (centred[:, (axis + shift) % 3] for shift in (2, 0, 1))
    azimuth, elevation = np.radians([_AZIMUTH, _ELEVATION])
    across = np.cos(azimuth) * depth + np.sin(azimuth) * right
    towards = np.cos(azimuth) * right - np.sin(azimuth) * depth
    raised = np.cos(elevation) * height + np.sin(elevation) * towards * -1
    return np.column_stack([across, raised, np.cos(elevation) * towards + np.sin(elevation) * height])


def _brightness(corners: FloatArray) -> FloatArray:
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return np.asarray(0.35 + 0.65 * np.abs(normals @ _LIGHT))


def plot_reliability(expected: FloatArray, errors: FloatArray, *, n_bins: int = 10, ax: Any = None) -> Any:
    """Draw expected errors against true ones: on the diagonal where the expectation is right.

    Parameters
    ----------
    expected, errors : array-like of shape (n,)
        Expected and true errors of vertices of shapes that the model has not seen.
    n_bins : int, default=10
        Bins of equally many vertices, by expected error.
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib Axes
        What was drawn on. Each bin shows its mean true error and the middle half of them.

    Raises
    ------
    ValueError
        If the two have unequal lengths or fewer entries than bins.
    """
    x, y = np.asarray(expected, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    if x.shape != y.shape or x.ndim != 1 or len(x) < n_bins:
        raise ValueError(
            f"expected and errors must be 1-D, equally long, and {n_bins} at least; got {x.shape}, {y.shape}."
        )
    from matplotlib import pyplot as plt  # noqa: PLC0415

    drawn = plt.subplots(layout="constrained")[1] if ax is None else ax
    parts = np.array_split(np.argsort(x, kind="stable"), n_bins)
    middle, mean = (np.array([values[part].mean() for part in parts]) for values in (x, y))
    low, high = (np.array([np.quantile(y[part], q) for part in parts]) for q in (0.25, 0.75))
    drawn.fill_between(middle, low, high, alpha=0.25, color="#0072B2", linewidth=0, label="middle half")
    drawn.plot(middle, mean, "o-", color="#0072B2", label="mean")
    limit = 1.05 * max(middle.max(), high.max())
    drawn.plot([0, limit], [0, limit], "--", color="0.5", label="as expected")
    drawn.set(xlabel="expected error / sqrt(area)", ylabel="true error / sqrt(area)", xlim=(0, limit), ylim=(0, limit))
    drawn.legend()
    return drawn
