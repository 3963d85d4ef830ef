"""What stands for a shape that cannot be used."""

from dataclasses import dataclass

__all__ = ["SetAside", "SkippedShape"]


@dataclass(frozen=True, eq=False)
class SkippedShape:
    """What stands in X for a shape that cannot be used, so that the others keep their index.

    `SpectralBasis` leaves it behind with ``on_invalid="skip"``, where nothing mends the mesh. It
    goes through the pipeline as it is, is left out of a fit, and is answered with NaN and -1.

    Attributes
    ----------
    name : str or None
        Name of the shape.
    reason : str
        Why it cannot be used.
    n_vertices : int
        Number of vertices; 0 if that is not known.
    """

    name: str | None
    reason: str
    n_vertices: int = 0


class SetAside(SkippedShape):
    """What stands in X for a mesh that another part of a model answers.

    The others keep their index so; nothing warns of it, and every transformer passes it on.
    """
