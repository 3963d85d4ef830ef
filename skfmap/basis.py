"""From meshes to shapes with a basis of Laplacian eigenfunctions."""

import warnings
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from sklearn.base import BaseEstimator

from skfmap._caching import cached
from skfmap._parallel import map_shapes
from skfmap._stateless import StatelessShapeTransformer
from skfmap._typing import FloatArray, SparseMatrix
from skfmap._validation import check_choice, check_number, label
from skfmap._version import Versioned
from skfmap.exceptions import MeshError, OrientationWarning
from skfmap.functional.eigenbasis import laplacian_eigenbasis
from skfmap.geometry.faults import (
    count_components,
    degenerate_faces,
    nonmanifold_edges,
    repeated_corners,
    unreferenced_vertices,
)
from skfmap.geometry.laplacian import LAPLACIANS
from skfmap.geometry.orientation import orient_faces
from skfmap.io import as_meshes
from skfmap.shapes import Mesh, SpectralShape

__all__ = ["SpectralBasis"]

_BLOCK = 128


class SpectralBasis(Versioned, StatelessShapeTransformer, BaseEstimator):
    """Compute the first Laplacian eigenfunctions of each mesh.

    Parameters
    ----------
    n_components : int, default=120
        Number of eigenfunctions, the constant one included. More than the learner uses: the rest serve descriptors and
        refinement.
    laplacian : {"cotangent", "robust"}, default="cotangent"
        ``"cotangent"``: libigl's cotangent stiffness and barycentric lumped mass matrix. ``"robust"``: the tufted
        intrinsic Delaunay Laplacian, for non-manifold and badly shaped meshes.
    memory : str or joblib.Memory, optional
        Where results are cached, by mesh content and parameters.
    n_jobs : int, optional
        Shapes at a time; see joblib.
    verbose : int, default=0
        Verbosity of joblib's progress.

    See Also
    --------
    DescriptorTransformer : The next step.

    Notes
    -----
    Stateless: `transform` works without `fit`, and each shape is treated by itself. Shapes are scaled to unit area
    inside. Eigenfunctions come from shift-invert Lanczos with a fixed start vector; the sign of each makes the integral
    of its cube positive. Eigenfunctions are computed in blocks of 128 and cut to ``n_components``, so that a search
    over it computes (and caches) each basis once. Faces are wound consistently and outwards where that can be told;
    vertices keep their numbers.

    Examples
    --------
    >>> from skfmap import SpectralBasis
    >>> from skfmap.datasets import make_sphere
    >>> (shape,) = SpectralBasis(n_components=5).transform([make_sphere(n_subdivisions=4)])
    >>> (shape.evals / shape.evals[1]).round(1).tolist()  # l (l + 1): 0, then 2 three times, then 6
    [0.0, 1.0, 1.0, 1.0, 3.0]
    """

    def __init__(
        self,
        n_components: int = 120,
        *,
        laplacian: str = "cotangent",
        memory: Any = None,
        n_jobs: int | None = None,
        verbose: int = 0,
    ) -> None:
        self.n_components = n_components
        self.laplacian = laplacian
        self.memory = memory
        self.n_jobs = n_jobs
        self.verbose = verbose

    def fit(self, X: Sequence[Any], y: object = None) -> Self:  # noqa: ARG002
        """Check the parameters and the meshes; nothing is learned.

        Parameters
        ----------
        X : sequence of meshes
            Each a Mesh, a trimesh.Trimesh, a (vertices, faces) pair or a path.
        y : ignored
            For scikit-learn's interface.

        Returns
        -------
        SpectralBasis
            Itself.
        """
        self._check_parameters()
        as_meshes(X)
        return self

    def transform(self, X: Sequence[Any]) -> list[SpectralShape]:
        """Compute the basis of each mesh.

        Parameters
        ----------
        X : sequence of meshes
            Each a Mesh, a trimesh.Trimesh, a (vertices, faces) pair or a path.

        Returns
        -------
        list of SpectralShape
            In the order of ``X``.

        Raises
        ------
        MeshError
            If a mesh has unreferenced vertices, several components, degenerate or non-manifold parts that the chosen
            Laplacian cannot deal with, or too few vertices; the message names the shape and the remedy.
        TypeError
            If ``X`` is one mesh rather than a sequence of meshes.

        Warns
        -----
        OrientationWarning
            If it cannot be told which side of a mesh is its outside.
        """
        self._check_parameters()
        meshes = as_meshes(X)
        shapes = map_shapes(
            _spectral_shape,
            ((mesh, self.laplacian, self.n_components, self.memory) for mesh in meshes),
            n_jobs=self.n_jobs,
            verbose=self.verbose,
        )
        _warn_of_unknown_sides(shapes)
        return shapes

    def _check_parameters(self) -> None:
        check_number(self.n_components, "n_components", low=2, integer=True)
        check_choice(self.laplacian, "laplacian", LAPLACIANS)


def _warn_of_unknown_sides(shapes: Sequence[SpectralShape]) -> None:
    unknown = [(i, shape.name) for i, shape in enumerate(shapes) if not shape.outward]
    names = [f"X[{i}]" if name is None else repr(name) for i, name in unknown]
    if names:
        warnings.warn(
            f"It cannot be told which side of {', '.join(names)} is the outside: no consistent winding, or no volume "
            "enclosed. Oriented probes and mean curvature may have the wrong sign there, and left be taken for right; "
            "check the winding of the faces, or use DescriptorTransformer('paper').",
            OrientationWarning,
            stacklevel=3,
        )


def _spectral_shape(mesh: Mesh, laplacian: str, n_components: int, memory: Any) -> SpectralShape:
    _check_mesh(mesh, laplacian, n_components)
    faces, consistent, outward = orient_faces(mesh.vertices, mesh.faces)
    oriented = mesh if np.array_equal(faces, mesh.faces) else Mesh(mesh.vertices, faces, mesh.name)
    compute = cached(_eigenbasis, memory)
    try:
        evals, evecs, mass, stiffness = compute(
            oriented, oriented.content_hash, laplacian, _n_computed(n_components, mesh.n_vertices)
        )
    except (np.linalg.LinAlgError, RuntimeError) as error:
        raise MeshError(
            f"No eigenbasis for {label(mesh.name)}: {error}. Mend the mesh"
            + (", or try SpectralBasis(laplacian='robust')." if laplacian == "cotangent" else ".")
        ) from error
    spectral = SpectralShape(oriented, evals, evecs, mass, stiffness, oriented.area, consistent, outward, laplacian)
    return spectral.truncate(n_components)


def _n_computed(n_components: int, n_vertices: int) -> int:
    """Return how many eigenfunctions are computed: whole blocks, so that every smaller number is a part of them."""
    return min(_BLOCK * -(-int(n_components) // _BLOCK), n_vertices - 1)


def _eigenbasis(
    mesh: Mesh,
    content_hash: str,  # noqa: ARG001
    laplacian: str,
    n_components: int,
) -> tuple[FloatArray, FloatArray, FloatArray, SparseMatrix]:
    stiffness, mass = LAPLACIANS[laplacian](mesh.vertices / np.sqrt(mesh.area), mesh.faces)
    mass = mass / mass.sum()
    evals, evecs = laplacian_eigenbasis(stiffness, mass, n_components)
    return evals, evecs, mass, stiffness


def _check_mesh(mesh: Mesh, laplacian: str, n_components: int) -> None:
    """Raise where an eigenbasis would be wrong or would bring down the libraries beneath."""
    who = label(mesh.name)
    if len(loose := unreferenced_vertices(mesh.faces, mesh.n_vertices)):
        raise MeshError(
            f"{who} has {len(loose)} vertices that no face uses, the first is vertex {loose[0]}. Remove them, and "
            "renumber its correspondences to match."
        )
    if len(repeated := repeated_corners(mesh.faces)):
        raise MeshError(
            f"{who} has {len(repeated)} faces that name a vertex twice, the first is face {repeated[0]}; "
            "remove these faces (vertex numbers stay as they are)."
        )
    if (n_parts := count_components(mesh.faces, mesh.n_vertices)) > 1:
        raise MeshError(
            f"{who} has {n_parts} connected components; a functional map cannot relate them. Keep the largest, or "
            "merge duplicate vertices if they split the surface along seams."
        )
    if n_components >= mesh.n_vertices:
        raise MeshError(
            f"{who} has {mesh.n_vertices} vertices, too few for n_components={n_components}; lower n_components (and "
            "the learner's n_functions), or refine the mesh."
        )
    if not mesh.area > 0:
        raise MeshError(f"{who} has no area; check its coordinates.")
    if laplacian == "cotangent":
        _check_cotangent(mesh, who)


def _check_cotangent(mesh: Mesh, who: str) -> None:
    remedy = "use SpectralBasis(laplacian='robust')."
    if len(flat := degenerate_faces(mesh.vertices, mesh.faces)):
        raise MeshError(
            f"{who} has {len(flat)} faces without area, the first is face {flat[0]}; mend them, or {remedy}"
        )
    if len(edges := nonmanifold_edges(mesh.faces)):
        raise MeshError(
            f"{who} has {len(edges)} edges with more than two faces, the first is {edges[0].tolist()}; mend them, or "
            f"{remedy}"
        )
