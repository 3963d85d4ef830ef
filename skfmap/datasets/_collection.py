"""What a collection of shapes holds."""

from typing import Any

from sklearn.utils import Bunch

from skfmap._tools.types import FloatArray
from skfmap.shapes import Correspondence, Landmarks, Mesh, outlets

__all__ = ["Collection"]


class Collection(Bunch):
    """Meshes with their correspondences, the reference first: a ``Bunch`` whose parts have types.

    Each is an attribute and a key.

    Attributes
    ----------
    meshes : list of Mesh
        The shapes. With ``load_collection(on_invalid="skip")`` a `skfmap.shapes.SkippedShape`
        stands for each that was left out.
    correspondences : list of Correspondence
        Where each lies on the template.
    names : list of str
        Of the shapes.
    paths : list of str
        The files of the meshes; of `load_collection`.
    landmarks : list of (Landmarks or None)
        Of each mesh, None where it has no file of them; of `load_collection`.
    template_points : ndarray of shape (n_points, 3)
        Of the template; of `make_creatures`.
    up : str
        Which axis points up; of `make_creatures`.
    DESCR : str
        What they are.
    """

    meshes: list[Mesh]
    correspondences: list[Correspondence]
    names: list[str]
    paths: list[str]
    landmarks: list[Landmarks | None]
    template_points: FloatArray
    up: str
    DESCR: str

    def __init__(
        self,
        *,
        meshes: list[Any],
        correspondences: list[Correspondence],
        names: list[str],
        **more: Any,
    ) -> None:
        super().__init__(meshes=meshes, correspondences=correspondences, names=names, **more)

    def __repr__(self) -> str:
        """Return a line with the number of meshes and the keys."""
        return f"Collection({len(self.meshes)} meshes, keys: {', '.join(self)})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the parts by name."""
        return _collection, (dict(self),)

    def _repr_html_(self) -> str:
        return outlets.html_of(self)


def _collection(parts: dict[str, Any]) -> Collection:
    return Collection(**parts)
