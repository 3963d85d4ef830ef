"""Probe functions that are defined by the user."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import as_reals, check_number, label
from skfmap.descriptors.family import ProbeFamily
from skfmap.functional.projection import project
from skfmap.shapes import SpectralShape

__all__ = ["FunctionProbes"]


class FunctionProbes(ProbeFamily):
    """Probe functions computed by a Python function, like FunctionTransformer for tables.

    Parameters
    ----------
    function : callable
        Takes a `SpectralShape` (at unit area: ``vertices``, ``mesh.faces``, ``mass``, ``evals``,
        ``evecs``, all of the working mesh) and returns values at its vertices, of shape
        (n_vertices,) or (n_vertices, n_functions). It may also return values at the vertices of the
        given mesh, which `SpectralShape.restrict` takes to the working mesh. Its scales must be
        constants at unit area, so that a probe has the same meaning on every shape.
    n_functions : int, default=1
        Number of functions that it returns.
    kw_args : dict, optional
        Additional keyword arguments of ``function``.

    Notes
    -----
    If `DescriptorTransformer` has a ``memory``, results are cached, provided that ``function`` is
    defined in a module; a lambda or a closure is called each time, because it cannot be identified.
    The cache key includes the source of ``function``, and of the functions it calls in modules that
    are not installed: if any of these changes, the values are computed again.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap import DescriptorTransformer, SpectralBasis
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.descriptors import FunctionProbes, paper_families
    >>> def depth(shape, power=2.0):
    ...     return np.linalg.norm(shape.vertices - shape.mass @ shape.vertices, axis=1) ** power
    >>> families = [*paper_families(), ("depth", FunctionProbes(depth, kw_args={"power": 3.0}))]
    >>> shapes = SpectralBasis(20).transform([make_sphere(3)])
    >>> (shape,) = DescriptorTransformer(families).transform(shapes)
    >>> shape.probe_names[-1]
    'depth[depth]'
    """

    def __init__(
        self,
        function: Callable[..., npt.ArrayLike],
        n_functions: int = 1,
        *,
        kw_args: dict[str, object] | None = None,
    ) -> None:
        self.function = function
        self.n_functions = n_functions
        self.kw_args = kw_args

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        if not callable(self.function):
            raise TypeError(f"function must be callable; got {self.function!r}.")
        check_number(self.n_functions, "n_functions", low=1, integer=True)
        if not (self.kw_args is None or isinstance(self.kw_args, dict)):
            raise TypeError(f"kw_args must be a dict or None; got {self.kw_args!r}.")

    def labels(self) -> list[str]:
        """Return the name of the function, with a number if there are several."""
        name = getattr(self.function, "__name__", type(self.function).__name__)
        return [name] if self.n_functions == 1 else [f"{name}_{i}" for i in range(self.n_functions)]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        values = as_reals(
            self.function(shape, **(self.kw_args or {})), f"What {self.function!r} returns"
        )
        columns = values[:, None] if values.ndim == 1 else values
        if columns.ndim == 2 and len(columns) == shape.n_given != shape.mesh.n_vertices:
            columns = shape.restrict(columns)
        if (
            columns.shape != (shape.mesh.n_vertices, self.n_functions)
            or not np.isfinite(columns).all()
        ):
            raise ValueError(
                f"{self.labels()[0]} must return finite values of shape ({shape.mesh.n_vertices}, "
                f"{self.n_functions}) on {label(shape.name)}; got shape {values.shape}"
                + ("." if np.isfinite(values).all() else " with NaN or infinite values.")
            )
        return project(columns, shape.evecs, shape.mass)
