"""Type aliases shared by all layers."""

from typing import Any, Protocol, TypeAlias, Union

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

__all__ = [
    "Array",
    "BoolArray",
    "FloatArray",
    "IntArray",
    "Model",
    "SparseMatrix",
]

Array: TypeAlias = npt.NDArray[Any]
FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
# Quoted, as scipy 1.14 has no generic classes.
SparseMatrix: TypeAlias = Union["sp.csc_array[np.float64]", "sp.csr_array[np.float64]"]


class Model(Protocol):
    """What `skfmap.match` takes: a learner, a Pipeline that ends in one, a fitted search."""

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the parameters, as every estimator of scikit-learn does."""
