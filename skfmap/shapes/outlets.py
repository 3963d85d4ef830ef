"""What shapes hand to the layers above: they are saved, drawn and shown from where they are held.

The only module of this layer that knows those above it. It is imported by nobody outside this
layer, and imports them when a person asks for a file or a picture, not before.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from skfmap.exceptions import MeshError

if TYPE_CHECKING:
    from skfmap.shapes.given_mesh import GivenMesh
    from skfmap.shapes.match import Match
    from skfmap.shapes.mesh import Mesh

__all__ = ["html_of", "open_mesh", "plot_match", "save_match", "to_pyvista", "to_trimesh"]


def open_mesh(given: "GivenMesh | None", what: str) -> "Mesh":
    """Return the mesh that a shape came as; of one that is broken, the faces that are sound."""
    from skfmap.io import as_far_as_sound, open_given  # noqa: PLC0415
    from skfmap.shapes.mesh import Mesh  # noqa: PLC0415

    if given is None:
        raise MeshError(
            f"This Match does not know {what}: the shape was skipped, or the match was not made by "
            "skfmap.match, or was saved before matches knew their meshes. Save it as .csv or .npz, "
            "which need no mesh; to draw it, give the meshes to skfmap.plotting.plot_matches."
        )
    found = open_given(given)
    if isinstance(found, Mesh):
        return found if found.name == given.name else Mesh(found.vertices, found.faces, given.name)
    return as_far_as_sound(*found, given.name or "mesh")[0]


def save_match(match: "Match", path: str | Path, **options: Any) -> list[Path]:
    """Write a match as other programs read it."""
    from skfmap.io.matches import save_match as save  # noqa: PLC0415

    return save(match, path, **options)


def plot_match(match: "Match", *, interactive: bool, **options: Any) -> Any:
    """Draw a match: a figure of matplotlib, or a page to turn the shapes in."""
    from skfmap.plotting import matches_page, plot_matches  # noqa: PLC0415

    return (matches_page if interactive else plot_matches)([match], **options)


def html_of(item: Any) -> str:
    """Return what a notebook shows of a shape, a match or a collection."""
    from skfmap.plotting._notebook import html_of as show  # noqa: PLC0415

    return show(item)


def to_trimesh(mesh: "Mesh") -> Any:
    """Return a mesh as trimesh holds it."""
    from skfmap.io.libraries import to_trimesh as convert  # noqa: PLC0415

    return convert(mesh)


def to_pyvista(mesh: "Mesh") -> Any:
    """Return a mesh as pyvista holds it."""
    from skfmap.io.libraries import to_pyvista as convert  # noqa: PLC0415

    return convert(mesh)
