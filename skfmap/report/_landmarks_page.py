"""Report on predicted landmarks: errors in tables, and pictures of the worst specimens."""

import datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skfmap._tools.types import BoolArray, FloatArray
from skfmap._tools.validation import check_folder, check_number, label
from skfmap._version import __version__
from skfmap.functional.similarity import best_similarity
from skfmap.geometry.normals import vertex_normals
from skfmap.plotting import Camera, plot_function
from skfmap.report._html import details, page, paragraph, picture, section, table
from skfmap.report._landmark_errors import LandmarkEvaluation, in_order
from skfmap.shapes import Mesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["landmark_table", "write_landmarks_page"]

_LANDMARK_COLUMNS = (
    "landmark",
    "n",
    "mean",
    "median",
    "largest",
    "on",
    "expected",
    "within radius",
)
_SPECIMEN_COLUMNS = ("specimen", "n", "mean", "largest", "at", "expected")
# Colours of true and predicted landmarks, safe for colour vision deficiency, and grey of the bone.
_TRUE, _PREDICTED, _BONE = "#0072b2", "#d55e00", 0.82
# Number of landmarks, the worst of a specimen, that are named in its picture.
_NAMED = 5
# Opacity of landmarks that are hidden behind the surface.
_HIDDEN = 0.2


def write_landmarks_page(
    evaluation: LandmarkEvaluation,
    path: str | Path,
    *,
    n_worst: int = 3,
    title: str = "Landmarks of specimens left out",
) -> Path:
    """Write an HTML report on the errors of predicted landmarks.

    Parameters
    ----------
    evaluation : LandmarkEvaluation
        Result of `evaluate_landmarks`.
    path : str or Path
        The ``.html`` file to write. It is self-contained.
    n_worst : int, default=3
        Number of specimens to show in pictures, the worst ones.
    title : str
        Title of the page.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileNotFoundError
        If the folder of ``path`` does not exist.
    """
    check_number(n_worst, "n_worst", low=0, integer=True)
    order = _worst_first(evaluation)
    content = [
        section(
            "Errors",
            paragraph(_sentence(evaluation)),
            table(_LANDMARK_COLUMNS, _shown(landmark_table(evaluation)[1])),
            details(
                "All specimens, worst first",
                table(_SPECIMEN_COLUMNS, _shown(_rows_of_specimens(evaluation))),
            ),
        ),
        section(
            "Worst specimens",
            paragraph(
                "Each specimen is seen from both sides. Rings are landmarks placed by hand, dots "
                "are predicted; those behind the surface are faint. The "
                f"{_NAMED} landmarks with the largest errors are named."
            ),
            *(_specimen(evaluation, i, order[0]) for i in order[:n_worst]),
        ),
    ]
    today = datetime.datetime.now(tz=datetime.UTC).date()
    subtitle = (
        f"{len(evaluation.true)} specimens, each left out of the training. skfmap {__version__}, "
        f"{today}."
    )
    check_folder(path).write_text(page(title, subtitle, content), encoding="utf-8")
    return Path(path)


def landmark_table(
    evaluation: LandmarkEvaluation,
) -> tuple[tuple[str, ...], list[tuple[object, ...]]]:
    """Return the errors of each landmark as a table.

    Parameters
    ----------
    evaluation : LandmarkEvaluation
        Result of `evaluate_landmarks`.

    Returns
    -------
    header : tuple of str
        Names of the columns.
    rows : list of tuple
        One row per landmark: its name, the number of specimens on which it is known, the mean,
        median and largest error, the specimen with the largest error, the mean expected error, and
        the fraction of specimens on which it lies within the predicted radius. Lengths are in the
        units of the meshes; None where nothing is known.
    """
    rows: list[tuple[object, ...]] = []
    n_blank = len(_LANDMARK_COLUMNS) - 2
    for j, name in enumerate(evaluation.names):
        errors, radius = evaluation.errors[:, j], evaluation.radius[:, j]
        known = np.isfinite(errors)
        if not known.any():
            rows.append((name, 0, *[None] * n_blank))
            continue
        worst = int(np.nanargmax(errors))
        promised = known & np.isfinite(radius)
        rows.append(
            (
                name,
                int(known.sum()),
                float(errors[known].mean()),
                float(np.median(errors[known])),
                float(errors[worst]),
                evaluation.true[worst].name,
                _mean(evaluation.expected[known, j]),
                _mean(errors[promised] <= radius[promised]),
            )
        )
    return _LANDMARK_COLUMNS, rows


def _rows_of_specimens(evaluation: LandmarkEvaluation) -> list[tuple[object, ...]]:
    """Return a row for each specimen, worst first, with lengths in mesh units."""
    rows: list[tuple[object, ...]] = []
    for i in _worst_first(evaluation):
        errors = evaluation.errors[i]
        known = np.isfinite(errors)
        name = evaluation.true[i].name or f"specimen {i}"
        if not known.any():
            rows.append((name, 0, *[None] * (len(_SPECIMEN_COLUMNS) - 2)))
            continue
        worst = int(np.nanargmax(errors))
        expected = _mean(evaluation.expected[i, known])
        at = evaluation.names[worst]
        rows.append(
            (name, int(known.sum()), _mean(errors[known]), float(errors[worst]), at, expected)
        )
    return rows


def _worst_first(evaluation: LandmarkEvaluation) -> list[int]:
    """Return the indices of the specimens by decreasing mean error; those without one are last."""
    means = [_mean(errors[np.isfinite(errors)]) for errors in evaluation.errors]
    return sorted(range(len(means)), key=lambda i: -(means[i] or 0.0))


def _mean(values: FloatArray | BoolArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else None


def _sentence(evaluation: LandmarkEvaluation) -> str:
    errors = evaluation.errors[np.isfinite(evaluation.errors)]
    if not len(errors):
        return "No landmark is both predicted and known."
    return (
        f"On average over {len(errors)} landmarks of specimens that were left out of the training, "
        f"predicted landmarks are {errors.mean():.3g} from those placed by hand; the median is "
        f"{np.median(errors):.3g} and the largest {errors.max():.3g}. Lengths are in the units of "
        "the meshes. The column within radius is the fraction of landmarks that lie inside the "
        "ball predicted for them."
    )


def _shown(rows: list[tuple[object, ...]]) -> list[list[str]]:
    return [
        [
            "" if cell is None else f"{cell:.3g}" if isinstance(cell, float) else str(cell)
            for cell in row
        ]
        for row in rows
    ]


def _specimen(evaluation: LandmarkEvaluation, i: int, first: int) -> str:
    """Return a picture of a specimen, in the pose of the first one, with a table."""
    true, found = (
        in_order(of[i], evaluation.names) for of in (evaluation.true, evaluation.predicted)
    )
    errors, name = evaluation.errors[i], evaluation.true[i].name
    expected = evaluation.expected[i]
    order = np.argsort(-np.nan_to_num(errors, nan=-1.0), kind="stable")
    rows: list[tuple[object, ...]] = [
        (evaluation.names[j], _or_none(errors[j]), _or_none(expected[j])) for j in order
    ]
    mean = _mean(errors[np.isfinite(errors)])
    caption = f"{label(name, 'specimen')}: " + (
        "no error is known" if mean is None else f"mean error {mean:.3g}"
    )
    named = {int(j): evaluation.names[j] for j in order[:_NAMED]}
    turn = _turn_of(evaluation, i, first)
    figure = _picture(evaluation.meshes[i], true @ turn, found @ turn, turn, named)
    return (
        f"<h3>{escape(caption)}</h3>"
        + picture(figure, f"{caption}; landmarks placed by hand and predicted.")
        + details("All landmarks", table(("landmark", "error", "expected"), _shown(rows)))
    )


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _turn_of(evaluation: LandmarkEvaluation, i: int, first: int) -> FloatArray:
    """Return the rotation (for points as rows) that turns a specimen's broad side to the camera.

    All specimens are aligned with the first by their landmarks.
    """
    mesh = evaluation.meshes[first]
    centred = mesh.vertices - mesh.vertices.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2].T  # longest first
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    broadside = axes[:, [0, 2, 1]] * [1.0, -1.0, 1.0]  # the camera looks along y
    own, other = (in_order(evaluation.true[j], evaluation.names) for j in (i, first))
    both = np.isfinite(own).all(axis=1) & np.isfinite(other).all(axis=1)
    if both.sum() < 3:
        return broadside
    posed = best_similarity(own[both], other[both], np.ones(int(both.sum())))
    return np.asarray(posed.rotation @ broadside)


def _picture(
    mesh: Mesh, true: FloatArray, found: FloatArray, turn: FloatArray, named: dict[int, str]
) -> "Figure":
    """Return a figure of both sides; the landmarks are already rotated."""
    from matplotlib import pyplot as plt  # noqa: PLC0415

    turned = Mesh(mesh.vertices @ turn, mesh.faces, mesh.name)
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    for ax, azimuth in zip(axes, (0.0, 180.0), strict=True):
        camera = Camera(azimuth=azimuth, elevation=0.0)
        colours = np.full((mesh.n_vertices, 3), _BONE)
        plot_function(turned, colours, ax=ax, camera=camera)
        seen = camera.project(turned.vertices)
        facing = vertex_normals(seen, mesh.faces)[:, 2] > 0
        for j, (own, other) in enumerate(zip(true, found, strict=True)):
            at = own if np.isfinite(own).all() else other
            if np.isfinite(at).all():
                shown = facing[np.linalg.norm(turned.vertices - at, axis=1).argmin()]
                ends = camera.project(np.array([own, other]))[:, :2]
                _draw_landmark(ax, ends, named.get(j, ""), faint=not shown)
    return figure


def _draw_landmark(ax: "Axes", ends: FloatArray, name: str, *, faint: bool) -> None:
    """Draw a ring for the true landmark, a dot for the predicted one, and a line between them."""
    alpha = _HIDDEN if faint else 1.0
    dots: dict[str, Any] = {"marker": "o", "alpha": alpha, "zorder": 4}
    ax.plot(*ends.T, color="black", linewidth=1, alpha=alpha, zorder=3)
    ax.plot(*ends[0], color=_TRUE, fillstyle="none", markersize=8, **dots)
    ax.plot(*ends[1], color=_PREDICTED, markersize=4, **dots)
    if name and not faint and np.isfinite(ends).all():
        ax.annotate(name, ends[0], xytext=(6, 6), textcoords="offset points", fontsize=8)
