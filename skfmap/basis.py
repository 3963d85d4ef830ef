"""From meshes to shapes with a basis of Laplacian eigenfunctions."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Self, TypeAlias, cast

import numpy as np
from sklearn.base import BaseEstimator

from skfmap._tools.caching import MemoryLike, cached
from skfmap._tools.parallel import map_shapes
from skfmap._tools.stateless import StatelessShapeTransformer
from skfmap._tools.types import FloatArray, SparseMatrix
from skfmap._tools.validation import LARGEST_AREA, SMALLEST_AREA, check_choice, check_number, label
from skfmap._tools.warn import warn
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
from skfmap.health import repair_mesh
from skfmap.io import MeshLike, as_mesh, as_meshes, check_meshes, n_vertices_of, named
from skfmap.shapes import Mesh, SkippedShape, SpectralShape
from skfmap.shapes.usable import warn_of_repairs, warn_of_skipped

__all__ = ["SpectralBasis"]

# Eigenfunctions are computed in blocks of so many, the first of which holds the default of 120
# (`docs/speed.rst`, "Bases", has times for 128).
_BLOCK = 128


# Laplacian, number of components and memory of a basis.
_How: TypeAlias = tuple[str, int, MemoryLike]


class SpectralBasis(Versioned, StatelessShapeTransformer, BaseEstimator):
    """Compute the first Laplacian eigenfunctions of each mesh.

    Parameters
    ----------
    n_components : int, default=120
        Number of eigenfunctions, the constant one included. More than the learner uses: the rest
        serve descriptors and refinement.
    laplacian : {"cotangent", "robust"}, default="cotangent"
        ``"cotangent"``: libigl's cotangent stiffness and barycentric lumped mass matrix.
        ``"robust"``: the tufted intrinsic Delaunay Laplacian, for non-manifold and badly shaped
        meshes.
    on_invalid : {"raise", "repair", "skip"}, default="raise"
        What to do with a mesh that cannot be used. ``"repair"`` mends it as `skfmap.repair_mesh`
        does, with a warning that says what was done; matches are given back in the numbers that the
        mesh came with, -1 where a vertex was removed. ``"skip"`` puts a
        `skfmap.shapes.SkippedShape` in its place, with a warning: the learner leaves it out, and
        answers NaN and -1; ``"repair"`` does so where a mesh cannot be mended.
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
    Stateless: `transform` works without `fit`, and each shape is treated by itself. Shapes are
    scaled to unit area inside. Eigenfunctions come from shift-invert Lanczos with a fixed start
    vector; the sign of each makes the integral of its cube positive. Eigenfunctions are computed in
    blocks of 128 and cut to ``n_components``, so that a search over it computes (and caches) each
    basis once. Faces are wound consistently and outwards where that can be told; vertices keep
    their numbers.

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
        on_invalid: str = "raise",
        memory: MemoryLike = None,
        n_jobs: int | None = None,
        verbose: int = 0,
    ) -> None:
        self.n_components = n_components
        self.laplacian = laplacian
        self.on_invalid = on_invalid
        self.memory = memory
        self.n_jobs = n_jobs
        self.verbose = verbose

    def fit(self, X: Sequence[MeshLike], y: object = None) -> Self:  # noqa: ARG002
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
        if self.on_invalid == "raise":
            as_meshes(X)
        else:
            check_meshes(X)
        return self

    def transform(self, X: Sequence[MeshLike]) -> list[SpectralShape]:
        """Compute the basis of each mesh.

        Parameters
        ----------
        X : sequence of meshes
            Each a Mesh, a trimesh.Trimesh, a (vertices, faces) pair or a path.

        Returns
        -------
        list of SpectralShape
            In the order of ``X``; unless ``on_invalid="raise"``, a `skfmap.shapes.SkippedShape`
            where a mesh cannot be used.

        Raises
        ------
        MeshError
            With ``on_invalid="raise"``: if a mesh has unreferenced vertices, several components,
            degenerate or non-manifold parts that the chosen Laplacian cannot deal with, or too few
            vertices; the message names the shape and the remedy.
        TypeError
            If ``X`` is one mesh rather than a sequence of meshes.

        Warns
        -----
        OrientationWarning
            If it cannot be told which side of a mesh is its outside.
        RepairWarning, SkippedShapeWarning
            If meshes were mended, or left out, as ``on_invalid`` says.
        """
        self._check_parameters()
        meshes = as_meshes(X) if self.on_invalid == "raise" else check_meshes(X)
        made = map_shapes(
            _OUTCOMES[self.on_invalid],
            (
                (mesh, i, self.laplacian, self.n_components, self.memory)
                for i, mesh in enumerate(meshes)
            ),
            n_jobs=self.n_jobs,
            verbose=self.verbose,
            prefer="threads",
        )
        shapes = [shape for shape, _ in made]
        warn_of_repairs(made)
        warn_of_skipped(shapes, told=meshes)
        _warn_of_unknown_sides(shapes)
        return cast("list[SpectralShape]", shapes)  # none is skipped unless that is asked for

    def _check_parameters(self) -> None:
        check_choice(self.on_invalid, "on_invalid", _OUTCOMES)
        check_number(self.n_components, "n_components", low=2, integer=True)
        check_choice(self.laplacian, "laplacian", LAPLACIANS)


def _warn_of_unknown_sides(shapes: Sequence[SpectralShape | SkippedShape]) -> None:
    unknown = [
        (i, shape.name)
        for i, shape in enumerate(shapes)
        if not isinstance(shape, SkippedShape) and not shape.outward
    ]
    names = [f"X[{i}]" if name is None else repr(name) for i, name in unknown]
    if names:
        warn(
            f"It cannot be told which side of {', '.join(names)} is the outside: no consistent "
            "winding, or no volume enclosed. Oriented probes and mean curvature may have the "
            "wrong sign there, and left be taken for right; check the winding of the faces, or "
            "use DescriptorTransformer('paper').",
            OrientationWarning,
        )


def _or_raise(item: MeshLike, i: int, *how: *_How) -> tuple[SpectralShape, str]:
    return _spectral_shape(as_mesh(item, i), *how), ""


def _or_skip(item: MeshLike, i: int, *how: *_How) -> tuple[SpectralShape | SkippedShape, str]:
    """Return the shape, or a skipped one if the mesh cannot be read or used."""
    if isinstance(item, SkippedShape):
        return item, ""
    mesh = None
    try:
        mesh = as_mesh(item, i)
        return _spectral_shape(mesh, *how), ""
    except (MeshError, OSError) as error:
        name, n_vertices = (
            (named(item, i), n_vertices_of(item)) if mesh is None else (mesh.name, mesh.n_vertices)
        )
        return SkippedShape(name, str(error), n_vertices), ""


def _or_repair(item: MeshLike, i: int, *how: *_How) -> tuple[SpectralShape | SkippedShape, str]:
    """Return the shape, if need be of the mended mesh, or a skipped one if nothing helps."""
    shape, _ = _or_skip(item, i, *how)
    if not isinstance(shape, SkippedShape) or isinstance(item, SkippedShape):
        return shape, ""
    try:
        repair = repair_mesh(item)
        if not repair.done:
            return shape, ""
        mended = _spectral_shape(Mesh(repair.mesh.vertices, repair.mesh.faces, shape.name), *how)
    except (MeshError, OSError) as hopeless:
        if str(hopeless) == shape.reason:
            return shape, ""
        return replace(shape, reason=f"{shape.reason} It cannot be mended: {hopeless}"), ""
    return replace(mended, vertex_map=repair.vertex_map if repair.renumbered else None), ", ".join(
        repair.done
    )


_OUTCOMES = {"raise": _or_raise, "repair": _or_repair, "skip": _or_skip}


def _spectral_shape(
    mesh: Mesh, laplacian: str, n_components: int, memory: MemoryLike
) -> SpectralShape:
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
    if not (np.isfinite(evals).all() and np.isfinite(evecs).all()):
        raise MeshError(
            f"No eigenbasis for {label(mesh.name)}: its eigenfunctions are not numbers. Its "
            "coordinates may have lost their digits far from the origin, or its faces their "
            "shape; see skfmap.check_mesh."
        )
    spectral = SpectralShape(
        oriented, evals, evecs, mass, stiffness, oriented.area, consistent, outward, laplacian
    )
    return spectral.truncate(n_components)


def _n_computed(n_components: int, n_vertices: int) -> int:
    """Return how many eigenfunctions are computed: whole blocks, of which fewer are a part."""
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
            f"{who} has {len(loose)} vertices that no face uses, the first is vertex {loose[0]}. "
            "Remove them, and renumber its correspondences to match."
        )
    if len(repeated := repeated_corners(mesh.faces)):
        raise MeshError(
            f"{who} has {len(repeated)} faces that name a vertex twice, the first is face "
            f"{repeated[0]}; remove these faces (vertex numbers stay as they are)."
        )
    if (n_parts := count_components(mesh.faces, mesh.n_vertices)) > 1:
        raise MeshError(
            f"{who} has {n_parts} connected components; a functional map cannot relate them. Keep "
            "the largest, or merge duplicate vertices if they split the surface along seams."
        )
    if n_components >= mesh.n_vertices:
        raise MeshError(
            f"{who} has {mesh.n_vertices} vertices, too few for n_components={n_components}; "
            "lower n_components (and the learner's n_functions), or refine the mesh."
        )
    if not SMALLEST_AREA < mesh.area < LARGEST_AREA:
        raise MeshError(
            f"{who} has an area of {mesh.area:.2g}, too extreme to compute with; check its "
            "coordinates, or choose another unit of length."
        )
    if laplacian == "cotangent":
        _check_cotangent(mesh, who)


def _check_cotangent(mesh: Mesh, who: str) -> None:
    remedy = "use SpectralBasis(laplacian='robust')."
    if len(flat := degenerate_faces(mesh.vertices, mesh.faces)):
        raise MeshError(
            f"{who} has {len(flat)} faces without area, the first is face {flat[0]}; mend them, "
            f"or {remedy}"
        )
    if len(edges := nonmanifold_edges(mesh.faces)):
        raise MeshError(
            f"{who} has {len(edges)} edges with more than two faces, the first is "
            f"{edges[0].tolist()}; mend them, or {remedy}"
        )
