"""Type aliases shared by all layers."""

from collections.abc import Callable
from typing import Any, Literal, Protocol, TypeAlias, Union

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

__all__ = [
    "Array",
    "BoolArray",
    "Confidences",
    "DistanceMethod",
    "ErrorKind",
    "FloatArray",
    "IntArray",
    "Interpolation",
    "KnownMapsWord",
    "Laplacian",
    "Matching",
    "MatchingOverride",
    "Model",
    "Normalize",
    "OnInvalid",
    "OnMirrored",
    "RaiseOrSkip",
    "RefineOnMaps",
    "RefineOverride",
    "RefineWord",
    "RegularizerWord",
    "SparseMatrix",
    "Weighting",
    "WeightingWord",
]

Array: TypeAlias = npt.NDArray[Any]
FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]

# The words that parameters take, so that a type checker finds others.
Confidences: TypeAlias = Literal["cross-fit"]
DistanceMethod: TypeAlias = Literal["heat", "exact", "dijkstra"]
ErrorKind: TypeAlias = Literal["direct", "consistent", "per_vertex"]
Interpolation: TypeAlias = Literal["barycentric", "soft"] | None
KnownMapsWord: TypeAlias = Literal["auto", "pairs", "from-landmarks", "in-space"]
Laplacian: TypeAlias = Literal["cotangent", "robust"]
Matching: TypeAlias = Literal["soft", "cut"]
MatchingOverride: TypeAlias = Literal["fitted", "soft", "cut"]
Normalize: TypeAlias = Literal["shape", "reference"]
OnInvalid: TypeAlias = Literal["mend", "raise", "skip"]
OnMirrored: TypeAlias = Literal["warn", "reflect"]
RaiseOrSkip: TypeAlias = Literal["raise", "skip"]
RefineOnMaps: TypeAlias = Literal["bijective-zoomout", "icp", "zoomout"]
RefineOverride: TypeAlias = Literal["fitted", "bijective-zoomout", "register", "icp", "zoomout"]
RefineWord: TypeAlias = Literal["auto", "bijective-zoomout", "register", "icp", "zoomout"]
RegularizerWord: TypeAlias = Literal["laplacian", "resolvent", "learned"]
WeightingWord: TypeAlias = Literal["function", "category", "unique"]
# A text is a sequence too, but no sequence of labels.
Weighting: TypeAlias = (
    WeightingWord | list[Any] | tuple[Any, ...] | Array | Callable[..., Any] | None
)
# Quoted, as scipy 1.14 has no generic classes.
SparseMatrix: TypeAlias = Union["sp.csc_array[np.float64]", "sp.csr_array[np.float64]"]


class Model(Protocol):
    """What `skfmap.match` takes: a learner, a Pipeline that ends in one, a fitted search."""

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the parameters, as every estimator of scikit-learn does."""
