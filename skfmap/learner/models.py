"""Functions for any fitted model: a learner, a Pipeline that ends in one, or a search."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from skfmap._tools.types import (
    FloatArray,
    Interpolation,
    Model,
    RefineOverride,
)
from skfmap._tools.unwrap import learner_and_shapes
from skfmap.refinement import Refinement
from skfmap.shapes import Landmarks, Match, Registered

__all__ = ["functional_maps", "match", "match_between", "predict_landmarks", "register"]


def match(
    model: Model,
    X: Sequence[Any],
    *,
    refine: RefineOverride | Refinement | None = "fitted",
    interpolate: Interpolation = None,
) -> list[Match]:
    """Match shapes with any fitted model.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, BridgedLearner, Pipeline or fitted search
        The model.
    X : sequence
        The input of the model: meshes if it is a pipeline that starts with `SpectralBasis`.
    refine, interpolate : optional
        As in `WeightedFunctionalMapLearner.match`.

    Returns
    -------
    list of Match
        Point-to-point map from each shape to the reference, expected errors, confidence and
        functional maps.
    """
    learner, shapes = learner_and_shapes(model, X)
    return list(learner.match(shapes, refine=refine, interpolate=interpolate))


def match_between(
    model: Model, X: Sequence[Any], pairs: Iterable[tuple[int, int]] | None = None
) -> list[Match]:
    """Match new shapes to one another, with any fitted model.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, BridgedLearner, Pipeline or fitted search
        The model.
    X : sequence
        The input of the model: meshes if it is a pipeline that starts with `SpectralBasis`.
    pairs : iterable of (int, int), optional
        Indices (i, j) into ``X``, to match ``X[i]`` to ``X[j]``. By default, all pairs of different
        shapes in both directions.

    Returns
    -------
    list of Match
        One match for each pair, from ``X[i]`` to ``X[j]``, which is its reference; see
        `WeightedFunctionalMapLearner.match_between`, and `PartialMatcher.match_between` for parts.

    Raises
    ------
    TypeError, ValueError
        If ``pairs`` does not contain pairs of indices into ``X``, or the model cannot match pairs.

    Examples
    --------
    >>> from sklearn.pipeline import make_pipeline
    >>> import skfmap
    >>> from skfmap.datasets import make_creatures
    >>> creatures = make_creatures(n_shapes=5, n_vertices=500)
    >>> model = make_pipeline(
    ...     skfmap.SpectralBasis(n_components=30),
    ...     skfmap.DescriptorTransformer(),
    ...     skfmap.WeightedFunctionalMapLearner(n_functions=20),
    ... )
    >>> model = model.fit(creatures.meshes[:3], creatures.correspondences[:3])
    >>> there, back = skfmap.match_between(model, creatures.meshes[3:])
    >>> there.p2p.shape == (creatures.meshes[3].n_vertices,)
    True
    >>> bool((back.p2p == there.inverse).all())
    True
    """
    learner, shapes = learner_and_shapes(model, X)
    if not hasattr(learner, "match_between"):
        raise TypeError(
            f"{type(learner).__name__} cannot match pairs of new shapes. Combine two matches to "
            "the reference with one.to(other), or fit the pipeline inside it directly."
        )
    return list(learner.match_between(shapes, pairs))


def register(model: Model, X: Sequence[Any]) -> list[Registered]:
    """Lay the reference's mesh onto shapes, with any model fitted with ``refine="register"``.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, Pipeline or fitted search
        The model, fitted with ``refine="register"`` or a `Registration`. Or a
        `skfmap.PartialMatcher`, for parts.
    X : sequence
        The input of the model: meshes if it is a pipeline that starts with `SpectralBasis`.

    Returns
    -------
    list of Registered
        Vertices of the reference's mesh on each shape, and how well they fit it.

    Examples
    --------
    >>> from sklearn.pipeline import make_pipeline
    >>> import skfmap
    >>> from skfmap.datasets import make_creatures
    >>> creatures = make_creatures(n_shapes=4, n_vertices=500)
    >>> model = make_pipeline(
    ...     skfmap.SpectralBasis(n_components=30),
    ...     skfmap.DescriptorTransformer(),
    ...     skfmap.WeightedFunctionalMapLearner(n_functions=20, refine="register"),
    ... )
    >>> model = model.fit(creatures.meshes[:3], creatures.correspondences[:3])
    >>> laid, = skfmap.register(model, creatures.meshes[3:])
    >>> laid.vertices.shape == creatures.meshes[0].vertices.shape
    True
    """
    learner, shapes = learner_and_shapes(model, X)
    if not hasattr(learner, "register"):
        raise TypeError(
            f"{type(learner).__name__} cannot lay meshes onto shapes; fit its learner directly, "
            "with refine='register'."
        )
    return list(learner.register(shapes))


def predict_landmarks(
    model: Model, X: Sequence[Any], *, coverage: float = 0.9, on_surface: bool = False
) -> list[Landmarks]:
    """Place the landmarks of the training shapes on new shapes, with any fitted model.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, Pipeline or fitted search
        The model, fitted with correspondences of measured points.
    X : sequence
        The input of the model: meshes if it is a pipeline that starts with `SpectralBasis`.
    coverage, on_surface : float, bool
        See `WeightedFunctionalMapLearner.predict_landmarks`.

    Returns
    -------
    list of Landmarks
        Landmarks in the units and coordinates of each mesh, with the expected error and the radius
        of a ball that contains the observer's point with probability ``coverage``.

    Raises
    ------
    TypeError
        If the learner cannot place landmarks on shapes.
    ValueError
        If it was fitted without measured points.

    Examples
    --------
    >>> from sklearn.pipeline import make_pipeline
    >>> import skfmap
    >>> from skfmap.datasets import make_creatures
    >>> creatures = make_creatures(n_shapes=4, n_vertices=500)
    >>> meshes, measured = creatures.meshes, []
    >>> for mesh, truth in zip(meshes, creatures.correspondences):
    ...     points = mesh.vertices[truth.pairs[truth.pairs[:, 1] % 3 == 0, 0]]
    ...     names = [f"point {t}" for t in truth.pairs[:, 1] if t % 3 == 0]
    ...     measured.append(skfmap.Correspondence.from_points(points, mesh, names))
    >>> model = make_pipeline(
    ...     skfmap.SpectralBasis(n_components=30),
    ...     skfmap.DescriptorTransformer(),
    ...     skfmap.WeightedFunctionalMapLearner(n_functions=10),
    ... )
    >>> marks, = skfmap.predict_landmarks(model.fit(meshes[:3], measured[:3]), meshes[3:])
    >>> marks.point("point 0").shape, marks.expected_error.shape == (len(marks.names),)
    ((3,), True)
    """
    learner, shapes = learner_and_shapes(model, X)
    if not hasattr(learner, "predict_landmarks"):
        raise TypeError(
            f"{type(learner).__name__} cannot place landmarks on shapes; fit its learner directly."
        )
    return list(learner.predict_landmarks(shapes, coverage=coverage, on_surface=on_surface))


def functional_maps(model: Model, X: Sequence[Any]) -> FloatArray:
    """Return the full functional maps of shapes, with any fitted model.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, BridgedLearner, Pipeline or fitted search
        The model.
    X : sequence
        The input of the model.

    Returns
    -------
    maps : ndarray of shape (n_shapes, k, k)
        Learned maps X_i(D), from functions on the reference to functions on each shape.
    """
    learner, shapes = learner_and_shapes(model, X)
    return np.asarray(learner.functional_maps(shapes))
