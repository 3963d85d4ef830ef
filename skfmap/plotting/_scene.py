"""Contents of a picture of shapes: panels side by side, each coloured in several ways."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from skfmap._tools.types import Array, BoolArray, FloatArray
from skfmap._tools.validation import check_choice, label
from skfmap.geometry.position_colours import colours_of_position
from skfmap.io import as_mesh, as_meshes
from skfmap.metrics import PairErrors
from skfmap.plotting._camera import Camera, check_camera, turn_upright
from skfmap.plotting._colours import (
    CONFIDENCE,
    ERRORS,
    UNKNOWN,
    Scale,
    scale_of,
)
from skfmap.shapes import Match, Mesh

__all__ = ["Panel", "Scene", "check_values", "scene_of_functions", "scene_of_matches"]

SHOWN = ("match", "expected error", "confidence", "true error")

# Smallest upper end of the colour scale of errors, in sqrt(area): an edge or two of a mesh of a few
# thousand vertices. It keeps tiny errors from looking large.
_SHORTEST_SCALE = 0.02


@dataclass(frozen=True, eq=False)
class Panel:
    """One shape of a scene.

    Attributes
    ----------
    mesh : Mesh
        Mesh to draw.
    points : ndarray of shape (n_vertices, 3)
        Vertices with z up, centred, in units of sqrt(area).
    caption : str
        Text above the shape.
    values : tuple
        For each row of the scene: values of shape (n_vertices,), colours of shape (n_vertices, 3),
        or None to draw nothing.
    """

    mesh: Mesh
    points: FloatArray
    caption: str
    values: tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Scene:
    """Shapes in columns and their colourings in rows, with a common camera.

    Attributes
    ----------
    panels : tuple of Panel
        The columns.
    scales : tuple of (Scale or None)
        Colour scale of each row; None if the panels hold colours.
    labels : tuple of str
        Description of each row.
    camera : Camera
        Direction of view.
    """

    panels: tuple[Panel, ...]
    scales: tuple[Scale | None, ...]
    labels: tuple[str, ...]
    camera: Camera

    def colours(self, panel: Panel, row: int) -> FloatArray | None:
        """Return the colours of a panel in a row, or None if it is empty there."""
        values, scale = panel.values[row], self.scales[row]
        return values if values is None or scale is None else scale.colours(values)


def check_values(values: object, mesh: Mesh, who: str = "values") -> Any:
    """Return values or colours at the vertices of a mesh; raise an error for anything else."""
    given: Any = np.ma.asarray(values)
    if (
        given.shape not in ((mesh.n_vertices,), (mesh.n_vertices, 3))
        or given.dtype.kind not in "biuf"
    ):
        raise ValueError(
            f"{who} must hold one number, or three for a colour, for each of the {mesh.n_vertices} "
            f"vertices of {label(mesh.name)}; got {given.dtype} of shape {given.shape}."
        )
    return given


def scene_of_functions(
    meshes: Sequence[Any],
    functions: Sequence[ArrayLike],
    *,
    captions: Sequence[str] | None,
    labels: Sequence[str] | None,
    cmap: str | None,
    limits: Sequence[float] | None,
    camera: Camera | None,
) -> Scene:
    """Return a scene with a column for each mesh and a row for each function.

    Each row has its own scale unless limits are given.
    """
    shapes, camera = as_meshes(meshes), check_camera(camera)
    if len(functions) != len(shapes):
        raise ValueError(
            f"Give the functions of each mesh; got {len(shapes)} meshes and functions for "
            f"{len(functions)}."
        )
    columns = [_columns(values, mesh) for values, mesh in zip(functions, shapes, strict=True)]
    n_rows = len(columns[0])
    if any(len(column) != n_rows for column in columns):
        raise ValueError(
            "All meshes must have the same number of functions; got "
            f"{[len(column) for column in columns]}."
        )
    _check_length(captions, len(shapes), "captions", "mesh")
    _check_length(labels, n_rows, "labels", "function")
    captions = [mesh.name or "" for mesh in shapes] if captions is None else captions
    labels = [""] * n_rows if labels is None else labels
    panels = tuple(
        Panel(mesh, _upright(mesh, camera.up), caption, column)
        for mesh, caption, column in zip(shapes, captions, columns, strict=True)
    )
    scales = tuple(
        scale_of([column[row] for column in columns], cmap, limits, label)
        for row, label in enumerate(labels)
    )
    return Scene(panels, scales, tuple(labels), camera)


def _columns(values: ArrayLike, mesh: Mesh) -> tuple[Any, ...]:
    """Return the functions of one mesh, given as one function or as the columns of a matrix."""
    given: Array = np.ma.asarray(values)
    columns = list(given.T) if given.ndim == 2 else [given]
    if not columns:
        raise ValueError(
            f"There is no function to draw on {label(mesh.name)}; got an array of shape "
            f"{given.shape}."
        )
    return tuple(check_values(column, mesh, "functions") for column in columns)


def scene_of_matches(
    matches: Sequence[Match],
    meshes: Sequence[Any] | None,
    reference: Any,
    *,
    show: Sequence[str] | None,
    usual: tuple[str, ...] = ("match",),
    errors: Sequence[PairErrors] | None,
    captions: Sequence[str] | None,
    camera: Camera | None,
    align: bool,
) -> Scene:
    """Return a scene with a column for the reference and each shape, and a row per item shown."""
    if isinstance(matches, Match):
        raise TypeError("matches must be a list; wrap a single match in one: [match].")
    if meshes is None:
        meshes = [match.mesh for match in matches]
    if reference is None and matches:
        reference = _reference_of(matches)
    if len(matches) != len(meshes) or not matches:
        raise ValueError(
            f"Give at least one match, and one mesh per match; got {len(meshes)} meshes and "
            f"{len(matches)} matches."
        )
    _check_length(captions, len(matches), "captions", "match")
    if show is None:  # the usual rows, if the matches have them
        assessed = all(match.expected_error is not None for match in matches)
        show = usual if assessed else ("match",)
    show = _check_shown(show, errors, len(matches))
    shapes, origin, camera = as_meshes(meshes), as_mesh(reference), check_camera(camera)
    for match, mesh in zip(matches, shapes, strict=True):
        _check_match(match, mesh, origin)
    colours = colours_of_position(origin.vertices)
    points_0 = _upright(origin, camera.up)
    title = "reference" if origin.name is None else f"reference: {origin.name}"
    own = tuple(colours if what == "match" else None for what in show)
    panels = [Panel(origin, points_0, title, own)]
    for i, (match, mesh) in enumerate(zip(matches, shapes, strict=True)):
        points, known = _upright(mesh, camera.up), match.p2p >= 0
        if align:
            points = _turned_like(points, known, points_0[match.p2p[known]])
        values = {
            "match": np.where(known[:, None], colours[match.p2p], UNKNOWN),
            "expected error": match.expected_error,
            "confidence": match.confidence,
        }
        if errors is not None:
            values["true error"] = _at_vertices(errors[i], mesh.n_vertices)
        caption = (match.name or mesh.name or "") + ("" if captions is None else f"\n{captions[i]}")
        if missing := [what for what in show if values[what] is None]:
            raise ValueError(
                f"The match of {match.name or mesh.name or f'shape {i}'} has no {missing[0]}: the "
                "learner was fitted with confidence=None. Fit it with confidence='cross-fit', or "
                f"leave {missing[0]!r} out of show."
            )
        panels.append(Panel(mesh, points, caption, tuple(values[what] for what in show)))
    # Expected and true errors share a scale, which ends at the largest error shown.
    in_errors = [row for row, what in enumerate(show) if what in ("expected error", "true error")]
    shown = [panel.values[row] for panel in panels[1:] for row in in_errors]
    largest = [float(np.nanmax(one)) for one in shown if not np.isnan(one).all()]
    worst = max([_SHORTEST_SCALE, *largest])
    scales = {
        "match": None,
        "expected error": Scale(ERRORS, 0.0, worst, "expected error / sqrt(area)"),
        "true error": Scale(ERRORS, 0.0, worst, "true error / sqrt(area)"),
        "confidence": Scale(CONFIDENCE, 0.0, 1.0, "confidence (within 0.1)"),
    }
    return Scene(tuple(panels), tuple(scales[what] for what in show), tuple(show), camera)


def _reference_of(matches: Sequence[Match]) -> Mesh:
    """Return the common reference of all matches."""
    if len({match.reference_hash for match in matches}) > 1:
        raise ValueError(
            "The matches have different references. Draw the matches of one model at a time, or "
            "give their meshes and the reference."
        )
    return matches[0].reference_mesh


def _check_shown(
    show: Sequence[str], errors: Sequence[PairErrors] | None, n_matches: int
) -> tuple[str, ...]:
    """Return the rows to show, with true errors added at the end if they are given."""
    if isinstance(show, str) or not len(show):
        raise ValueError(f"show must be a list of at least one of {SHOWN}; got {show!r}.")
    for what in show:
        check_choice(what, "show", SHOWN)
    if errors is None and "true error" in show:
        raise ValueError(
            "To show true errors, give errors: the result of the learner's pair_errors."
        )
    if errors is not None and len(errors) != n_matches:
        raise ValueError(
            f"Give the errors of each match; got errors of {len(errors)} and {n_matches} matches."
        )
    return tuple(show) if errors is None or "true error" in show else (*show, "true error")


def _at_vertices(errors: PairErrors, n_vertices: int) -> FloatArray:
    """Return the mean error at each vertex; NaN where no error is known."""
    n_known = np.bincount(errors.vertices, minlength=n_vertices)
    sums = np.bincount(errors.vertices, errors.direct, minlength=n_vertices)
    return np.where(n_known > 0, sums / np.maximum(n_known, 1), np.nan)


def _check_match(match: Match, mesh: Mesh, reference: Mesh) -> None:
    if len(match.p2p) != mesh.n_vertices or match.p2p.max(initial=0) >= reference.n_vertices:
        raise ValueError(
            f"The match of {label(match.name, 'shape')} has {len(match.p2p)} vertices and refers "
            f"to vertex {match.p2p.max(initial=0)} of the reference; {label(mesh.name)} has "
            f"{mesh.n_vertices} vertices and the reference, {label(reference.name)}, "
            f"{reference.n_vertices}. Give the meshes in the order of the matches, and the "
            "reference that the model was trained with."
        )


def _check_length(given: Sequence[str] | None, expected: int, name: str, what: str) -> None:
    if given is not None and (isinstance(given, str) or len(given) != expected):
        raise ValueError(
            f"{name} must be a list of {expected} strings, one per {what}; got {given!r}."
        )


def _upright(mesh: Mesh, up: str) -> FloatArray:
    """Return vertices with z up, scaled to unit area, with the bounding box centred at 0."""
    if not mesh.area > 0:
        raise ValueError(f"{label(mesh.name)} has no area; there is nothing to draw.")
    points = turn_upright(mesh.vertices, up) / np.sqrt(mesh.area)
    return np.asarray(points - (points.min(axis=0) + points.max(axis=0)) / 2)


def _turned_like(points: FloatArray, known: BoolArray, targets: FloatArray) -> FloatArray:
    """Return points turned about the vertical so that known ones best fit their targets."""
    if len(targets) == 0:
        return points
    flat, goal = (p[:, :2] - p[:, :2].mean(axis=0) for p in (points[known], targets))
    angle = np.arctan2(
        (flat[:, 0] * goal[:, 1] - flat[:, 1] * goal[:, 0]).sum(), (flat * goal).sum()
    )
    cosine, sine = np.cos(angle), np.sin(angle)
    turned = points @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
    return np.asarray(turned - (turned.min(axis=0) + turned.max(axis=0)) / 2)
