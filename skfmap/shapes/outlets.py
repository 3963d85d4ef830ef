"""Methods of shapes that are implemented in the layers above: saving, drawing and display.

This is the only module of this layer that uses layers above it. It imports them inside functions,
when a file or a picture is requested, and is not used outside this layer.
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
    """Open a given mesh; return only the sound faces of one that is broken."""
    from skfmap.io import as_far_as_sound, open_given  # noqa: PLC0415
    from skfmap.shapes.mesh import Mesh  # noqa: PLC0415

    if given is None:
        raise MeshError(
            f"This Match does not know {what}: the shape was skipped, or the match was not made by "
            "skfmap.match, or it was saved before matches stored their meshes. Save it as .csv or "
            ".npz, which need no mesh. To draw it, pass the meshes to "
            "skfmap.plotting.plot_matches."
        )
    found = open_given(given)
    if isinstance(found, Mesh):
        return found if found.name == given.name else Mesh(found.vertices, found.faces, given.name)
    return as_far_as_sound(*found, given.name or "mesh")[0]


def save_match(match: "Match", path: str | Path, **options: Any) -> list[Path]:
    """Write a match in the formats of other programs."""
    from skfmap.io.matches import save_match as save  # noqa: PLC0415

    return save(match, path, **options)


def plot_match(match: "Match", *, interactive: bool, **options: Any) -> Any:
    """Draw a match as a matplotlib figure or as an interactive page."""
    from skfmap.plotting import matches_page, plot_matches  # noqa: PLC0415

    return (matches_page if interactive else plot_matches)([match], **options)


def html_of(item: Any) -> str:
    """Return the HTML that a notebook shows for a shape, a match or a collection."""
    from skfmap.plotting._notebook import html_of as show  # noqa: PLC0415

    return show(item)


def to_trimesh(mesh: "Mesh") -> Any:
    """Return a mesh as a `trimesh.Trimesh`."""
    from skfmap.io.libraries import to_trimesh as convert  # noqa: PLC0415

    return convert(mesh)


def to_pyvista(mesh: "Mesh") -> Any:
    """Return a mesh as a `pyvista.PolyData`."""
    from skfmap.io.libraries import to_pyvista as convert  # noqa: PLC0415

    return convert(mesh)
