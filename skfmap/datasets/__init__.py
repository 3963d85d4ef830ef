"""Collections of shapes, generated or loaded from a folder."""

from skfmap.datasets._collection import Collection
from skfmap.datasets._creatures import make_creatures
from skfmap.datasets._folder import load_collection
from skfmap.datasets._saving import save_collection
from skfmap.datasets._sphere import make_sphere

__all__ = ["Collection", "load_collection", "make_creatures", "make_sphere", "save_collection"]
