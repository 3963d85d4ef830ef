"""The type of a collection of shapes."""

from typing import Any

from sklearn.utils import Bunch

from skfmap._tools.types import FloatArray
from skfmap.shapes import Correspondence, Landmarks, Mesh, outlets

__all__ = ["Collection"]


class Collection(Bunch):
    """Meshes with their correspondences, the reference first.

    A collection is a ``Bunch`` with typed fields: each field is an attribute and a key.

    Attributes
    ----------
    meshes : list of Mesh
        The shapes. With ``load_collection(on_invalid="skip")``, each skipped shape is a
        `skfmap.shapes.SkippedShape`.
    correspondences : list of Correspondence
        Where each shape lies on the template.
    names : list of str
        Names of the shapes.
    paths : list of str
        Files of the meshes; only from `load_collection`.
    landmarks : list of (Landmarks or None)
        Landmarks of each mesh, None for a mesh without a landmark file; only from
        `load_collection`.
    template_points : ndarray of shape (n_points, 3)
        Points of the template; only from `make_creatures`.
    up : str
        Axis that points up; only from `make_creatures`.
    DESCR : str
        Description of the collection.
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
        """Return one line with the number of meshes and the keys."""
        return f"Collection({len(self.meshes)} meshes, keys: {', '.join(self)})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the fields by name."""
        return _collection, (dict(self),)

    def _repr_html_(self) -> str:
        return outlets.html_of(self)


def _collection(parts: dict[str, Any]) -> Collection:
    return Collection(**parts)
