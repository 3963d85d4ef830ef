"""A sphere, for examples and for tests with closed forms."""

from skfmap._tools.validation import check_number
from skfmap.geometry.sphere import subdivided_octahedron
from skfmap.shapes import Mesh

__all__ = ["make_sphere"]


def make_sphere(n_subdivisions: int = 4) -> Mesh:
    """Make a unit sphere by subdividing an octahedron.

    Parameters
    ----------
    n_subdivisions : int, default=4
        Number of subdivisions n, from 0 to 9. The sphere has 4^(n + 1) + 2 vertices: 18, 66, 258,
        1,026 and 4,098 for n = 1 to 5.

    Returns
    -------
    Mesh
        Closed mesh, oriented outwards.

    Examples
    --------
    >>> from skfmap.datasets import make_sphere
    >>> make_sphere(n_subdivisions=2)
    Mesh('sphere', n_vertices=66, n_faces=128)
    """
    check_number(n_subdivisions, "n_subdivisions", low=0, high=9, integer=True)
    return Mesh(*subdivided_octahedron(int(n_subdivisions)), name="sphere")
