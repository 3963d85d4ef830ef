"""Placeholder for a shape that cannot be used."""

from dataclasses import dataclass

__all__ = ["SetAside", "SkippedShape"]


@dataclass(frozen=True, eq=False)
class SkippedShape:
    """Placeholder in X for a shape that cannot be used, so that the others keep their indices.

    `SpectralBasis` with ``on_invalid="skip"`` returns it for a mesh that cannot be mended. It
    passes through the pipeline unchanged, is left out of fits, and its results are NaN and -1.

    Attributes
    ----------
    name : str or None
        Name of the shape.
    reason : str
        Why it cannot be used.
    n_vertices : int
        Number of vertices; 0 if it is not known.
    """

    name: str | None
    reason: str
    n_vertices: int = 0


class SetAside(SkippedShape):
    """Placeholder in X for a mesh that another part of a model handles.

    It keeps the indices of the others. No warning is given, and all transformers pass it on.
    """
