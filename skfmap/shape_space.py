"""Mean and principal modes of registered shapes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.decomposition import PCA
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted

from skfmap._tools.types import (
    BoolArray,
    FloatArray,
    IntArray,
    OnMirrored,
)
from skfmap._tools.validation import (
    as_reals,
    check_choice,
    check_faces,
    check_number,
    check_samples,
    is_finite,
)
from skfmap._tools.warn import warn
from skfmap._version import Versioned
from skfmap.exceptions import MeshError, OrientationWarning
from skfmap.functional.similarity import MIRROR, STIFF, best_similarity, left_by_similarities
from skfmap.geometry.faults import area_and_longest_edge
from skfmap.shapes import Mesh, Registered

__all__ = ["ShapeSpace", "stack"]

# A shape is a mirror image if a similarity with a reflection leaves at most `STIFF`, as a fraction
# of the sum of squares, and one without a reflection at least this many times as much. Between any
# two of twenty mouse mandibles or eleven skulls, those of the same side leave at most 0.006, and
# those of different sides at least 0.013.
_TIMES = 2.0
# Deviations below this fraction of the mean size are rounding errors, and so are squares below it.
_ROUNDING = 1e-9
# Scores above this fraction of the largest count as equal to it.
_AS_LARGE = 0.999


def stack(registered: Sequence[Registered]) -> FloatArray:
    """Return the vertices of registered meshes as one array.

    Parameters
    ----------
    registered : sequence of Registered
        Registered meshes, from `skfmap.register`.

    Returns
    -------
    ndarray of shape (n_shapes, n_vertices_0, 3)
        One row per shape, in its own units and position; vertices correspond to those of the
        reference.

    Raises
    ------
    MeshError
        If shapes were left out, if the reference does not fit some of them, or if they were
        registered to different references; the message names them.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.shape_space import stack
    >>> from skfmap.shapes import Registered
    >>> ball = make_sphere(n_subdivisions=1)
    >>> laid = Registered(ball.vertices, ball.faces, np.zeros(18), 0, 0.0, 0.0, 0.0, fits=True)
    >>> stack([laid, laid]).shape
    (2, 18, 3)
    """
    shapes = check_samples(registered, "Registered", "registered")
    for i, shape in enumerate(shapes):
        if not isinstance(shape, Registered):
            raise TypeError(
                f"registered[{i}] must be what skfmap.register returns; got {type(shape).__name__}."
            )
    left_out = [not is_finite(shape.vertices).all() for shape in shapes]
    misfits = [not shape.fits for shape in shapes]
    if any(left_out) or any(misfits):
        raise MeshError(_unusable(shapes, left_out, misfits))
    _shared_faces(shapes)
    return np.array([shape.vertices for shape in shapes], dtype=np.float64)


class ShapeSpace(Versioned, TransformerMixin, BaseEstimator):
    r"""Mean and principal modes of shapes with the same connectivity.

    Shapes are rotated and translated onto their mean (generalised Procrustes alignment), and the
    remaining variation is split into principal components. Each vertex is weighted by the area
    around it on the mean, so the result does not depend on where a mesh is finer.

    A shape is the mean plus a sum of modes, each multiplied by its score. Scores are in the units
    of the meshes: a shape with score s in one mode, and 0 in the others, has a root mean square
    distance of s from the mean over the surface.

    Parameters
    ----------
    n_components : int or float, optional
        Number of modes, or the fraction of variance to explain, between 0 and 1. By default all
        modes, one fewer than the number of shapes.
    scale : bool, default=False
        Whether shapes are first scaled to centroid size 1. Otherwise size is a part of shape.
    on_mirrored : {"warn", "reflect"}, default="warn"
        What to do with mirror images of the first shape, such as a right femur among left ones.
        ``"reflect"`` reflects them. Mirror images are only detected among shapes that differ by
        little more than a similarity.
    faces : array-like of int, shape (n_faces, 3), optional
        Faces of shapes that are given as an array. Without faces, as for landmarks, all points have
        the same weight, and there are no meshes of the mean and the modes.
    max_iter : int, default=100
        Maximum number of iterations of the alignment.
    tol : float, default=1e-9
        The alignment has converged when the mean moves by at most this fraction of its size.

    Attributes
    ----------
    mean_ : ndarray of shape (n_vertices, 3)
        Vertices of the mean shape, with its centroid at the origin, oriented like the first shape.
    modes_ : ndarray of shape (n_modes, n_vertices, 3)
        Displacements of the vertices for each mode, in order of decreasing variance. Modes are
        orthonormal with respect to the area-weighted mean over the surface.
    standard_deviations_ : ndarray of shape (n_modes,)
        Standard deviations of the scores of the training shapes, in the units of the meshes.
    explained_variance_ratio_ : ndarray of shape (n_modes,)
        Fraction of the variance of the aligned shapes that each mode explains.
    centroid_sizes_ : ndarray of shape (n_shapes,)
        Size of each training shape before scaling: the root mean square distance of its surface
        from its centroid.
    mirrored_ : ndarray of bool, shape (n_shapes,)
        Which training shapes are mirror images of the first.
    weights_ : ndarray of shape (n_vertices,)
        Fraction of the area of the mean that each vertex represents.
    faces_ : ndarray of int, shape (n_faces, 3), or None
        Faces that all shapes have.
    n_iter_ : int
        Number of iterations of the alignment.

    See Also
    --------
    skfmap.register : Lays the mesh of a reference onto shapes, so that they have the same faces.

    Notes
    -----
    The sign of a mode is chosen so that the largest of its scores is positive. Modes suit shapes
    that vary little: they are straight lines, while the limbs of a body that bends move on arcs.

    References
    ----------
    .. [1] J. C. Gower. "Generalized Procrustes analysis". Psychometrika, 1975.
    .. [2] T. F. Cootes, C. J. Taylor, D. H. Cooper, J. Graham. "Active shape models: their training
       and application". Computer Vision and Image Understanding, 1995.

    Examples
    --------
    Stretched spheres vary in one mode:

    >>> import numpy as np
    >>> from skfmap import Mesh
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.shape_space import ShapeSpace
    >>> ball = make_sphere(n_subdivisions=2)
    >>> eggs = [Mesh(ball.vertices * [1, 1, z], ball.faces) for z in (1.0, 1.1, 1.3)]
    >>> space = ShapeSpace().fit(eggs)
    >>> space.explained_variance_ratio_.round(6).tolist()
    [1.0]
    >>> space.transform(eggs).shape
    (3, 1)
    >>> space.mode_mesh(0, 2.0)
    Mesh('mean +2 sd of mode 0', n_vertices=66, n_faces=128)
    """

    def __init__(
        self,
        n_components: int | float | None = None,
        *,
        scale: bool = False,
        on_mirrored: OnMirrored = "warn",
        faces: Any = None,
        max_iter: int = 100,
        tol: float = 1e-9,
    ) -> None:
        self.n_components = n_components
        self.scale = scale
        self.on_mirrored = on_mirrored
        self.faces = faces
        self.max_iter = max_iter
        self.tol = tol

    def fit(self, X: Any, y: object = None) -> Self:  # noqa: ARG002
        """Align shapes, and find their mean and modes.

        Parameters
        ----------
        X : sequence of Registered, sequence of Mesh, or array of shape (n_shapes, n_vertices, 3)
            Shapes whose vertices correspond by index.
        y : ignored
            Present for API consistency by convention.

        Returns
        -------
        ShapeSpace
            The fitted estimator.

        Raises
        ------
        MeshError
            If shapes have different faces, were left out, or do not fit; the message names them.
        ValueError
            If there are fewer than two shapes, or they are all the same.

        Warns
        -----
        OrientationWarning
            If some shapes are mirror images of the first, and ``on_mirrored="warn"``.
        ConvergenceWarning
            If the alignment did not converge.
        """
        self._check_parameters()
        points, faces, names = _read(X, self.faces)
        self._check_n_components(len(points))
        self.faces_ = faces
        self.mirrored_ = self._told_mirrored(points, _frame(points[0], faces), names)
        frame, aligned = self._align_all(self._on_one_side(points, self.mirrored_))
        self.mean_, self.weights_ = frame.mean, frame.weights
        self.centroid_sizes_ = np.array([_size(shape, self.weights_) for shape in points])
        self._split(aligned)
        return self

    def transform(self, X: Any) -> FloatArray:
        """Return the scores of shapes.

        Parameters
        ----------
        X : sequence of Registered, sequence of Mesh, or array of shape (n_shapes, n_vertices, 3)
            Shapes with the same vertices and faces as those given to `fit`.

        Returns
        -------
        ndarray of shape (n_shapes, n_modes)
            Distance of each shape from the mean along each mode, in the units of the meshes.
        """
        check_is_fitted(self)
        points, faces, names = _read(X, None)
        if points.shape[1:] != self.mean_.shape or not _same(faces, self.faces_):
            got = f"{points.shape[1]} vertices"
            got += " in other faces" if points.shape[1] == len(self.mean_) else ""
            raise MeshError(
                f"X must have the {len(self.mean_)} vertices and the faces of the shapes given to "
                f"fit; got {got}. Register the shapes with the same model."
            )
        frame = _frame(self.mean_, self.faces_)
        mirrored = self._told_mirrored(points, frame, names)
        moved = self._aligned(self._on_one_side(points, mirrored), frame) - self.mean_
        return np.einsum("v,svd,mvd->sm", self.weights_, moved, self.modes_, optimize=True)

    def inverse_transform(self, X: npt.ArrayLike) -> FloatArray:
        """Return the shapes with the given scores.

        Parameters
        ----------
        X : array-like of shape (n_shapes, n_modes)
            Scores.

        Returns
        -------
        ndarray of shape (n_shapes, n_vertices, 3)
            Vertices, aligned with the mean.
        """
        check_is_fitted(self)
        scores = as_reals(X, "X")
        if scores.ndim != 2 or scores.shape[1] != len(self.modes_):
            raise ValueError(
                f"X must hold scores of {len(self.modes_)} modes, shape (n_shapes, "
                f"{len(self.modes_)}); got {scores.shape}."
            )
        return np.asarray(self.mean_ + np.einsum("sm,mvd->svd", scores, self.modes_, optimize=True))

    @property
    def mean_mesh_(self) -> Mesh:
        """The mean shape as a mesh."""
        faces = self._faces_of_meshes()
        return Mesh(self.mean_, faces, "mean")

    def mode_mesh(self, mode: int, deviations: float) -> Mesh:
        """Return the mean shape, moved along a mode.

        Parameters
        ----------
        mode : int
            Index of the mode, from 0.
        deviations : float
            Score in standard deviations of the training shapes; -2 and 2 are common values.

        Returns
        -------
        Mesh
            The shape, aligned with the mean.
        """
        faces = self._faces_of_meshes()
        check_number(mode, "mode", low=0, high=len(self.modes_) - 1, integer=True)
        check_number(deviations, "deviations", low=-np.inf)
        moved = self.mean_ + deviations * self.standard_deviations_[mode] * self.modes_[mode]
        return Mesh(moved, faces, f"mean {deviations:+g} sd of mode {mode}")

    def get_feature_names_out(
        self,
        input_features: object = None,  # noqa: ARG002
    ) -> npt.NDArray[np.object_]:
        """Return the names of the scores (``mode0`` and so on) as an object array."""
        check_is_fitted(self)
        return np.array([f"mode{i}" for i in range(len(self.modes_))], dtype=object)

    def __sklearn_tags__(self) -> Tags:
        """Return tags that declare three-dimensional input."""
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = False
        tags.input_tags.three_d_array = True
        return tags

    def _check_parameters(self) -> None:
        check_choice(self.scale, "scale", (True, False))
        check_choice(self.on_mirrored, "on_mirrored", ("warn", "reflect"))
        check_number(self.max_iter, "max_iter", low=1, integer=True)
        check_number(self.tol, "tol", low=0.0)

    def _check_n_components(self, n_shapes: int) -> None:
        if n_shapes < 2:
            raise ValueError("X has only one shape, so there is no variation; give two or more.")
        given = self.n_components
        if isinstance(given, (float, np.floating)):
            if not 0 < given < 1:
                raise ValueError(
                    "n_components must be an integer, or a fraction of variance between 0 and 1; "
                    f"got {given!r}."
                )
        elif given is not None:
            check_number(given, "n_components", low=1, integer=True)
            if given >= n_shapes:
                raise ValueError(
                    f"n_components must be less than the number of shapes: {n_shapes} shapes have "
                    f"{n_shapes - 1} modes; got {given!r}. None keeps all modes."
                )

    def _told_mirrored(
        self, points: FloatArray, frame: "_Frame", names: Sequence[str]
    ) -> BoolArray:
        """Return which shapes are mirror images, and warn unless they are reflected."""
        left = [left_by_similarities(shape, frame.mean, frame.weights) for shape in points]
        mirrored = np.array([a <= STIFF and b >= max(_TIMES * a, _ROUNDING) for b, a in left])
        if self.on_mirrored == "warn" and mirrored.any():
            told = ", ".join(name for name, is_one in zip(names, mirrored, strict=True) if is_one)
            warn(
                f"These shapes are mirror images of the others: {told}. The difference between "
                "left and right then counts as variation. Set on_mirrored='reflect', or leave "
                "them out.",
                OrientationWarning,
            )
        return mirrored

    def _on_one_side(self, points: FloatArray, mirrored: BoolArray) -> FloatArray:
        if self.on_mirrored == "warn":
            return points
        return np.where(mirrored[:, None, None], points * MIRROR, points)

    def _align_all(self, points: FloatArray) -> tuple["_Frame", FloatArray]:
        """Return the mean, and all shapes aligned with it, starting from the first shape."""
        frame = _frame(points[0], self.faces_)
        frame = _frame(self._aligned(points[:1], frame)[0], self.faces_)
        for n_iter in range(1, self.max_iter + 1):
            self.n_iter_ = n_iter
            aligned = self._aligned(points, frame)
            before, frame = frame, _frame(aligned.mean(axis=0), self.faces_)
            size = _size(frame.mean, frame.weights)
            if _size(frame.mean - before.mean, frame.weights) <= self.tol * size:
                break
        else:
            warn(
                f"The alignment did not converge in {self.max_iter} iterations; increase max_iter "
                "or tol.",
                ConvergenceWarning,
            )
        return frame, aligned

    def _aligned(self, points: FloatArray, frame: "_Frame") -> FloatArray:
        """Return shapes rotated onto the mean of a frame, with their centroids at the origin."""
        aligned = np.empty_like(points)
        for shape, out in zip(points, aligned, strict=True):
            centred = shape - frame.weights @ shape
            if self.scale:
                centred = _of_unit_size(centred, frame.weights)
            out[:] = centred @ best_similarity(centred, frame.mean, frame.weights).rotation
        return aligned

    def _split(self, aligned: FloatArray) -> None:
        """Find the modes of aligned shapes."""
        moved = aligned - self.mean_
        weighted = (moved * np.sqrt(self.weights_)[:, None]).reshape(len(moved), -1)
        least = _ROUNDING * _size(self.mean_, self.weights_)
        if np.sqrt((weighted**2).sum(axis=1).max()) <= least:
            raise ValueError(
                "All shapes in X are the same, up to rotation and translation; without variation "
                "there are no modes."
            )
        n_components = len(moved) - 1 if self.n_components is None else self.n_components
        share = isinstance(n_components, (float, np.floating))
        n_components = float(n_components) if share else int(n_components)
        pca = PCA(n_components, svd_solver="full").fit(weighted)
        scores = weighted @ pca.components_.T
        real = np.sqrt(pca.explained_variance_) > least
        scores = scores[:, real] * _signs(scores[:, real])
        # By regression, so that vertices without a face, whose weight is 0, move too.
        self.modes_ = np.einsum(
            "sm,svd->mvd", scores / np.square(scores).sum(axis=0), moved, optimize=True
        )
        self.standard_deviations_ = np.sqrt(pca.explained_variance_[real])
        self.explained_variance_ratio_ = pca.explained_variance_ratio_[real]

    def _faces_of_meshes(self) -> IntArray:
        check_is_fitted(self)
        if self.faces_ is None:
            raise AttributeError(
                "Points without faces have no meshes. Fit registered shapes or meshes, or set "
                "ShapeSpace(faces=...)."
            )
        return np.asarray(self.faces_)


class _Frame(NamedTuple):
    """The mean that shapes are aligned with, and the weights of its vertices, which sum to 1."""

    mean: FloatArray
    weights: FloatArray


def _frame(mean: FloatArray, faces: IntArray | None) -> _Frame:
    if faces is None:
        return _Frame(mean, np.full(len(mean), 1 / len(mean)))
    areas, _ = area_and_longest_edge(mean, faces)
    if not areas.any():
        raise MeshError("The first shape, or the mean of all, has no area; leave such shapes out.")
    weights = np.bincount(faces.ravel(), np.repeat(areas, 3), minlength=len(mean))
    return _Frame(mean, weights / weights.sum())


def _size(points: FloatArray, weights: FloatArray) -> float:
    """Return the root mean square distance from the centroid."""
    return float(np.sqrt(weights @ np.square(points - weights @ points).sum(axis=1)))


def _of_unit_size(points: FloatArray, weights: FloatArray) -> FloatArray:
    size = _size(points, weights)
    if size == 0:
        raise MeshError("All vertices of a shape coincide, so it has no size; leave it out.")
    return points / size


def _signs(scores: FloatArray) -> FloatArray:
    """Return the sign of the largest score of each mode; of equal ones, the first."""
    size = np.abs(scores)
    largest = np.argmax(size >= _AS_LARGE * size.max(axis=0), axis=0)
    return np.sign(scores[largest, np.arange(scores.shape[1])])


def _read(X: Any, faces: npt.ArrayLike | None) -> tuple[FloatArray, IntArray | None, list[str]]:
    """Return points of shape (n_shapes, n_vertices, 3), faces, and names for messages."""
    if isinstance(X, np.ndarray) and X.dtype.kind in "biufc":
        points = _as_points(X)
        checked = None if faces is None else check_faces(faces, points.shape[1], "ShapeSpace")
        return points, checked, [f"shape {i}" for i in range(len(points))]
    shapes = check_samples(X, "Registered, Mesh, or an array of shape (n_shapes, n_vertices, 3)")
    names = [_called(shape, i) for i, shape in enumerate(shapes)]
    if faces is not None and all(isinstance(shape, (Registered, Mesh)) for shape in shapes):
        raise ValueError(
            "ShapeSpace(faces=...) is for shapes that are given as an array, but these have their "
            "own faces. Leave it out."
        )
    if all(isinstance(shape, Registered) for shape in shapes):
        return stack(shapes), np.asarray(shapes[0].faces), names
    for i, shape in enumerate(shapes):
        if not isinstance(shape, Mesh):
            raise TypeError(
                "All items of X must be Mesh, or all Registered (from skfmap.register); got "
                f"{type(shape).__name__} at X[{i}].{_remedy(shape)}"
            )
    _shared_faces(shapes)
    return np.array([mesh.vertices for mesh in shapes]), shapes[0].faces, names


def _remedy(shape: object) -> str:
    """Return the advice for an item of the wrong type, for use in a message."""
    if isinstance(shape, Registered):
        return " Give its .mesh."
    if isinstance(shape, (str, Path)):
        return " Read it with skfmap.io.read_mesh."
    if isinstance(shape, np.ndarray):
        return " Give vertices as one array, np.stack(X), and ShapeSpace(faces=...)."
    return ""


def _as_points(X: npt.NDArray[Any]) -> FloatArray:
    """Return an array as points; raise if it does not contain the vertices of shapes."""
    points = as_reals(X, "X")
    if points.ndim != 3 or points.shape[2] != 3 or 0 in points.shape:
        raise ValueError(
            "X must contain the vertices of shapes, in an array of shape (n_shapes, n_vertices, "
            f"3); got {points.shape}."
        )
    wrong = [i for i, shape in enumerate(points) if not is_finite(shape).all()]
    if wrong:
        raise MeshError(
            f"X has NaN or too large coordinates in shape {', '.join(map(str, wrong))}; leave it "
            "out."
        )
    return points


def _called(shape: Any, index: int) -> str:
    name = getattr(shape, "name", None)
    return f"shape {index}" if name is None else repr(name)


def _same(faces: IntArray | None, others: IntArray | None) -> bool:
    return others is None or faces is None or np.array_equal(faces, others)


def _shared_faces(shapes: Sequence[Any]) -> None:
    """Raise unless all shapes have the vertices and faces of the first."""
    first = shapes[0]
    for i, shape in enumerate(shapes):
        if len(shape.vertices) != len(first.vertices) or not _same(shape.faces, first.faces):
            raise MeshError(
                f"{_called(shape, i)} {_difference(shape, first, _called(first, 0))}. Vertices "
                "must correspond by index: lay one reference onto all shapes with skfmap.register."
            )


def _difference(shape: Any, first: Any, who: str) -> str:
    """Return how the vertices or faces of a shape differ from the first's, for a message."""
    counts, others = ((len(one.vertices), len(one.faces)) for one in (shape, first))
    if counts == others:
        return f"has as many vertices and faces as {who}, but the faces themselves differ"
    return (
        f"has {counts[0]} vertices and {counts[1]} faces, unlike {who} ({others[0]} and "
        f"{others[1]})"
    )


def _unusable(
    shapes: Sequence[Registered], left_out: Sequence[bool], misfits: Sequence[bool]
) -> str:
    """Return a message about shapes that were left out, or that the reference does not fit."""
    absent = [_called(shape, i) for i, shape in enumerate(shapes) if left_out[i]]
    bad = [_called(s, i) for i, s in enumerate(shapes) if misfits[i] and not left_out[i]]
    told = [f"{', '.join(absent)}: left out, so there are no vertices."] if absent else []
    told += [f"{', '.join(bad)}: the reference does not fit."] if bad else []
    return " ".join(told) + (
        " Leave these out: [one for one in registered if one.fits]. To keep a mesh that does not "
        "fit, give arrays: np.array([one.vertices for one in registered])."
    )
