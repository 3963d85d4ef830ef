"""The transformer that computes the Laplacian eigenfunctions of meshes."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self, TypeAlias, cast

import numpy as np
from sklearn.base import BaseEstimator

from skfmap._tools.caching import MemoryLike, cached, hash_of_arrays
from skfmap._tools.parallel import map_shapes
from skfmap._tools.stateless import StatelessShapeTransformer
from skfmap._tools.types import (
    FloatArray,
    Laplacian,
    OnInvalid,
    SparseMatrix,
)
from skfmap._tools.validation import check_choice, check_number, label
from skfmap._tools.warn import warn
from skfmap._version import Versioned
from skfmap._working_mesh import WorkingMesh, working_mesh
from skfmap.exceptions import MeshError, OrientationWarning
from skfmap.functional.eigenbasis import laplacian_eigenbasis
from skfmap.geometry.laplacian import LAPLACIANS
from skfmap.io import MeshLike, as_arrays, as_mesh, check_meshes, n_vertices_of, named
from skfmap.shapes import GivenMesh, Mesh, SkippedShape, SpectralShape
from skfmap.shapes.skipped_shape import SetAside
from skfmap.shapes.usable import warn_of_repairs, warn_of_skipped

__all__ = ["SpectralBasis"]

# Eigenfunctions are computed in blocks of this many; the first block includes the default of 120
# (`docs/speed.rst`, "Bases", has times for 128).
_BLOCK = 128
# Approximate file size per vertex: 38 bytes for binary PLY, about 90 for OFF.
_BYTES = 60


ON_INVALID = ("mend", "raise", "skip")


class _How(NamedTuple):
    """Parameters of a basis, in the form that is sent to its workers."""

    laplacian: str
    n_components: int
    max_vertices: int | None
    wrap: str | None
    on_invalid: str
    memory: MemoryLike


# A shape, and messages about what was done to its mesh.
_Made: TypeAlias = tuple[SpectralShape | SkippedShape, tuple[str, ...]]


class SpectralBasis(Versioned, StatelessShapeTransformer, BaseEstimator):
    """Compute the first Laplacian eigenfunctions of each mesh.

    Parameters
    ----------
    n_components : int, default=120
        Number of eigenfunctions, including the constant one. This is more than the learner uses;
        descriptors and refinement use the rest.
    laplacian : {"cotangent", "robust"}, default="cotangent"
        ``"cotangent"``: libigl's cotangent stiffness and barycentric lumped mass matrix.
        ``"robust"``: the tufted intrinsic Delaunay Laplacian, for non-manifold and badly shaped
        meshes.
    max_vertices : int or None, default=6000
        A mesh with more vertices is thinned to this number, and everything is computed on the
        thinned mesh; answers are still on the given vertices. None never thins. Functional maps are
        smooth: with 3,000, 5,000, 8,000 and 12,000 of 25,000 vertices, errors on creatures are
        1.21 % of sqrt(area) each time, while the time of a refined match grows tenfold.
    wrap : {"auto"} or None, default=None
        Whether to wrap a mesh that is not the surface of one body but has hundreds of tunnels, or
        debris all around: the working mesh is then the outer shell around it, with tunnels and
        pores closed. Given vertices that the shell does not reach, such as those of inner walls,
        get -1 and NaN. None never wraps: on mouse skulls with 250 or more tunnels, refined matches
        put landmarks within 0.32 mm without wrapping and 0.42 mm with it. Nothing is wrapped with
        ``on_invalid="raise"``.
    on_invalid : {"mend", "raise", "skip"}, default="mend"
        What to do with a mesh that cannot be used as it is. ``"mend"`` mends it as
        `skfmap.repair_mesh` does, with a warning that says what was done, and raises an error if
        that is impossible; answers have the vertex indices of the given mesh, with -1 where a
        vertex was removed. ``"raise"`` never mends. ``"skip"`` mends, and if that is impossible
        puts a `skfmap.shapes.SkippedShape` in its place, with a warning: the learner leaves it out,
        and its answers are NaN and -1.
    memory : str or joblib.Memory, optional
        Where results are cached, by mesh content and parameters.
    n_jobs : int, optional
        Number of shapes processed in parallel; see joblib.
    verbose : int, default=0
        Verbosity of joblib's progress.

    See Also
    --------
    DescriptorTransformer : The next step.

    Notes
    -----
    This transformer is stateless: `transform` works without `fit`, and each shape is processed
    separately. Internally, shapes are scaled to unit area. Eigenfunctions are computed by
    shift-invert Lanczos with a fixed start vector; the sign of each makes the integral of its cube
    positive. They are computed in blocks of 128 and truncated to ``n_components``, so that a search
    over ``n_components`` computes (and caches) each basis once. Faces are wound consistently, and
    outwards where the outside can be determined.

    Each mesh is turned into a *working mesh*, which is sound and connected and has at most
    ``max_vertices`` vertices. `SpectralShape` records where on it each given vertex lies. The given
    meshes are not kept: if ``X`` holds paths, a worker reads one mesh, thins it and drops it.

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
        laplacian: Laplacian = "cotangent",
        max_vertices: int | None = 6000,
        wrap: Literal["auto"] | None = None,
        on_invalid: OnInvalid = "mend",
        memory: MemoryLike = None,
        n_jobs: int | None = None,
        verbose: int = 0,
    ) -> None:
        self.n_components = n_components
        self.laplacian = laplacian
        self.max_vertices = max_vertices
        self.wrap = wrap
        self.on_invalid = on_invalid
        self.memory = memory
        self.n_jobs = n_jobs
        self.verbose = verbose

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a saved state; models from before there were working meshes never thin."""
        before = {"max_vertices": None, "wrap": None} if "max_vertices" not in state else {}
        state = {**before, **state}
        if state.get("on_invalid") == "repair":
            state["on_invalid"] = "skip"  # the current name of this option
        super().__setstate__(state)

    def fit(self, X: Sequence[MeshLike], y: object = None) -> Self:  # noqa: ARG002
        """Check the parameters and the types of the items, without reading or learning anything.

        Parameters
        ----------
        X : sequence of meshes
            Each a Mesh, a trimesh.Trimesh, a (vertices, faces) pair or a path.
        y : ignored
            Present for API consistency by convention.

        Returns
        -------
        SpectralBasis
            The transformer itself.
        """
        self._check_parameters()
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
            In the order of ``X``; with ``on_invalid="skip"``, a `skfmap.shapes.SkippedShape` where
            a mesh cannot be used.

        Raises
        ------
        MeshError
            If a mesh cannot be used because it cannot be read, has no surface or no area, or has
            too few vertices; with ``on_invalid="raise"`` also if it has unreferenced vertices,
            several components, or degenerate or non-manifold parts that the chosen Laplacian cannot
            handle. The message names the shape and the remedy.
        TypeError
            If ``X`` is one mesh rather than a sequence of meshes.

        Warns
        -----
        OrientationWarning
            If the outside of a mesh cannot be determined.
        RepairWarning, SkippedShapeWarning
            If meshes were mended or left out, depending on ``on_invalid``.
        """
        self._check_parameters()
        items = check_meshes(X)
        how = _How(
            self.laplacian,
            self.n_components,
            self.max_vertices,
            self.wrap,
            self.on_invalid,
            self.memory,
        )
        made = map_shapes(
            _made_or_skipped if self.on_invalid == "skip" else _made,
            ((item, i, how) for i, item in enumerate(items)),
            n_jobs=self.n_jobs,
            verbose=self.verbose,
            # Solvers and matrix products release the GIL, thinning does not.
            prefer=None if any(_may_be_thinned(item, how) for item in items) else "threads",
        )
        shapes = [_found_at(shape, item) for (shape, _), item in zip(made, items, strict=True)]
        warn_of_repairs([(shape, ", ".join(told)) for shape, told in made])
        warn_of_skipped(shapes, told=items)
        _warn_of_unknown_sides(shapes)
        return cast("list[SpectralShape]", shapes)  # none is skipped unless on_invalid is "skip"

    def _check_parameters(self) -> None:
        check_choice(self.on_invalid, "on_invalid", ON_INVALID)
        check_number(self.n_components, "n_components", low=2, integer=True)
        check_choice(self.laplacian, "laplacian", LAPLACIANS)
        if self.max_vertices is not None:
            check_number(self.max_vertices, "max_vertices", low=100, integer=True)
            if self.max_vertices <= self.n_components:
                raise ValueError(
                    f"max_vertices={self.max_vertices} leaves too few vertices for n_components="
                    f"{self.n_components}; raise it, preferably to 3,000 or more."
                )
        if self.wrap is not None:
            check_choice(self.wrap, "wrap", ("auto",))


def _may_be_thinned(item: MeshLike, how: _How) -> bool:
    """Return whether a mesh has more vertices than a working mesh; files are judged by size."""
    if how.max_vertices is None or isinstance(item, SkippedShape):
        return False
    if isinstance(item, (str, Path)):
        path = Path(item)
        return path.is_file() and path.stat().st_size > _BYTES * how.max_vertices
    return n_vertices_of(item) > how.max_vertices


def _found_at(shape: SpectralShape | SkippedShape, item: MeshLike) -> SpectralShape | SkippedShape:
    """Return the shape with the caller's mesh, since workers do not send it back."""
    if isinstance(shape, SkippedShape) or shape.given is None:
        return shape
    return replace(shape, given=shape.given.found_at(item))


def _warn_of_unknown_sides(shapes: Sequence[SpectralShape | SkippedShape]) -> None:
    unknown = [
        (i, shape.name)
        for i, shape in enumerate(shapes)
        if not isinstance(shape, SkippedShape) and not shape.outward
    ]
    names = [f"X[{i}]" if name is None else repr(name) for i, name in unknown]
    if names:
        warn(
            f"It cannot be determined which side of {', '.join(names)} is the outside: the winding "
            "is inconsistent, or no volume is enclosed. Oriented probes and mean curvature may "
            "have the wrong sign there, and left and right may be confused; check the winding of "
            "the faces, or use DescriptorTransformer('paper').",
            OrientationWarning,
        )


def _made(item: MeshLike, i: int, how: _How) -> _Made:
    """Return the shape of a mesh, or raise."""
    if isinstance(item, SetAside):
        return item, ()
    name = named(item, i)
    mends = how.on_invalid != "raise"
    given = as_arrays(item, i) if mends else as_mesh(item, i)
    working = working_mesh(
        given,
        name,
        mend=mends,
        wrap=how.wrap is not None,
        max_vertices=how.max_vertices,
        laplacian=how.laplacian,
        memory=how.memory,
    )
    shape = _spectral_shape(working, how)
    if working.prolongation is not None:
        vertices, faces = (given.vertices, given.faces) if isinstance(given, Mesh) else given
        counts = len(vertices), len(faces)
        shape = replace(shape, given=GivenMesh(name, *counts, hash_of_arrays(vertices, faces)))
    return shape, working.told


def _made_or_skipped(item: MeshLike, i: int, how: _How) -> _Made:
    """Return the shape of a mesh, or a skipped one if it cannot be used."""
    if isinstance(item, SkippedShape):
        return item, ()
    try:
        return _made(item, i, how)
    except (MeshError, OSError) as error:
        return SkippedShape(named(item, i), str(error), n_vertices_of(item)), ()


def _spectral_shape(working: WorkingMesh, how: _How) -> SpectralShape:
    mesh = working.mesh
    _check_size(mesh, how.n_components)
    compute = cached(_eigenbasis, how.memory)
    try:
        evals, evecs, mass, stiffness = compute(
            mesh, mesh.content_hash, how.laplacian, _n_computed(how.n_components, mesh.n_vertices)
        )
    except (np.linalg.LinAlgError, RuntimeError) as error:
        raise MeshError(
            f"The eigenbasis of {label(mesh.name)} cannot be computed: {error}. Mend the mesh"
            + (
                ", or try SpectralBasis(laplacian='robust')."
                if how.laplacian == "cotangent"
                else "."
            )
        ) from error
    if not (np.isfinite(evals).all() and np.isfinite(evecs).all()):
        raise MeshError(
            f"The eigenbasis of {label(mesh.name)} cannot be computed: its eigenfunctions are not "
            "finite. Its coordinates may have lost precision far from the origin, or its faces may "
            "be degenerate; see skfmap.check_mesh."
        )
    shape = SpectralShape(
        mesh,
        evals,
        evecs,
        mass,
        stiffness,
        mesh.area,
        working.consistent,
        working.outward,
        how.laplacian,
        working.prolongation,
    )
    return shape.truncate(how.n_components)


def _check_size(mesh: Mesh, n_components: int) -> None:
    if n_components >= mesh.n_vertices:
        raise MeshError(
            f"{label(mesh.name)} has {mesh.n_vertices} vertices, which is too few for "
            f"n_components={n_components}; lower n_components (and n_functions of the learner), or "
            "subdivide the mesh."
        )


def _n_computed(n_components: int, n_vertices: int) -> int:
    """Return the number of eigenfunctions to compute, rounded up to whole blocks."""
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
