"""Probe functions: the paper's nine families, and the oriented one that tells left from right."""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Any, Self

import numpy as np
from sklearn.base import BaseEstimator, clone
from sklearn.utils.metaestimators import _BaseComposition

from skfmap._caching import cached, code_of
from skfmap._parallel import map_shapes
from skfmap._skipped import sort_out, spread, warn_of_skipped
from skfmap._stateless import StatelessShapeTransformer
from skfmap._typing import FloatArray
from skfmap._validation import as_reals, check_choice, check_number, check_samples, label
from skfmap._version import Versioned
from skfmap.exceptions import MeshError
from skfmap.functional.projection import diffuse, project
from skfmap.functional.signatures import heat_kernel_signature, wave_kernel_signature
from skfmap.geometry.curvature import clip_by_area, gaussian_curvature, log_magnitude, mean_curvature
from skfmap.geometry.oriented import integrated_oriented_products
from skfmap.geometry.saliency import mesh_saliency
from skfmap.shapes import ProbedShape, SkippedShape, SpectralShape

__all__ = [
    "DescriptorTransformer",
    "DiffusedCurvature",
    "FunctionProbes",
    "HeatKernelSignature",
    "MeshSaliency",
    "OrientedProducts",
    "ProbeFamily",
    "WaveKernelSignature",
    "default_families",
    "paper_families",
]


class ProbeFamily(StatelessShapeTransformer, BaseEstimator, ABC):
    """A family of probe functions; derive from it to add one.

    A family is stateless: its scales are constants on shapes of unit area, so that a probe means the same on every
    shape. Subclasses store parameters in ``__init__`` and implement `check_parameters`, `labels` and `coefficients`.
    """

    @abstractmethod
    def check_parameters(self) -> None:
        """Raise ValueError or TypeError for a parameter that cannot be used."""

    @abstractmethod
    def labels(self) -> list[str]:
        """Return what tells the functions of the family apart, one label each."""

    @abstractmethod
    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the raw coefficients of the functions, shape (n_components, n_functions)."""

    def fit(self, X: Sequence[SpectralShape], y: object = None) -> Self:  # noqa: ARG002
        """Check the parameters; nothing is learned."""
        self.check_parameters()
        return self

    def transform(self, X: Sequence[SpectralShape]) -> list[FloatArray]:
        """Return the coefficients of the functions on each shape, each of shape (n_components, n_functions).

        Shapes that were skipped are left out.
        """
        self.check_parameters()
        return [_finite(self, shape) for shape in sort_out(_check_spectral(X)).shapes]


class HeatKernelSignature(ProbeFamily):
    """Heat kernel signature (Sun, Ovsjanikov, Guibas 2009).

    Parameters
    ----------
    n_functions : int, default=5
        Number of times, in geometric progression.
    t_min, t_max : float, default=0.01, 1.0
        First and last time on the shape of unit area. The paper leaves them open; there, 0.01 sees details of about
        0.15 sqrt(area), and at 1 only the slowest functions are left.
    """

    def __init__(self, n_functions: int = 5, *, t_min: float = 0.01, t_max: float = 1.0) -> None:
        self.n_functions = n_functions
        self.t_min = t_min
        self.t_max = t_max

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        _check_range(self.n_functions, self.t_min, self.t_max, "t_min", "t_max")

    def labels(self) -> list[str]:
        """Return the times."""
        return [f"t={t:.3g}" for t in self._times()]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        return project(heat_kernel_signature(shape.evals, shape.evecs, self._times()), shape.evecs, shape.mass)

    def _times(self) -> FloatArray:
        return np.geomspace(self.t_min, self.t_max, self.n_functions)


class WaveKernelSignature(ProbeFamily):
    """Wave kernel signature (Aubry, Schlickewei, Cremers 2011) at one variance.

    Parameters
    ----------
    n_functions : int, default=5
        Number of energies, in geometric progression.
    sigma : float, default=0.3
        Standard deviation in log eigenvalue; independent of the number of energies, unlike the authors' rule, which
        breaks down below 28 of them. The paper's three variances are pinned at 0.1, 0.3 and 0.6.
    lambda_min, lambda_max : float, default=5, 400
        Eigenvalues at unit area that the first and the last energy sit at.
    """

    def __init__(
        self, n_functions: int = 5, *, sigma: float = 0.3, lambda_min: float = 5.0, lambda_max: float = 400.0
    ) -> None:
        self.n_functions = n_functions
        self.sigma = sigma
        self.lambda_min = lambda_min
        self.lambda_max = lambda_max

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        _check_range(self.n_functions, self.lambda_min, self.lambda_max, "lambda_min", "lambda_max")
        check_number(self.sigma, "sigma", low=1e-3)

    def labels(self) -> list[str]:
        """Return the energies, as eigenvalues."""
        return [f"lambda={e:.3g}" for e in self._energies()]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        values = wave_kernel_signature(shape.evals, shape.evecs, np.log(self._energies()), self.sigma)
        return project(values, shape.evecs, shape.mass)

    def _energies(self) -> FloatArray:
        return np.geomspace(self.lambda_min, self.lambda_max, self.n_functions)


class DiffusedCurvature(ProbeFamily):
    """Gaussian or mean curvature, made a family of functions by heat diffusion at several times (section 5.1).

    Parameters
    ----------
    kind : {"gaussian", "mean"}, default="gaussian"
        Gaussian curvature is the angle defect per area; mean curvature is positive where the surface is convex.
    logarithm : bool, default=False
        Whether to diffuse the logarithm of the absolute value, which puts more weight on flat areas.
    n_functions : int, default=5
        Number of diffusion times, in geometric progression.
    t_min, t_max : float, default=1e-3, 0.1
        First and last time on the shape of unit area. Diffusion is exact in the basis: coefficients decay as
        exp(-t lambda).
    percentile : float, default=2
        The initial function is clipped to its area-weighted percentiles ``percentile`` and ``100 - percentile``.
    floor : float, default=1
        With ``logarithm``: curvature magnitude at unit area below which the logarithm stays flat; about the 1st
        percentile of the magnitude of Gaussian curvature, and the 5th of mean curvature, on a TOSCA cat.
    """

    def __init__(
        self,
        kind: str = "gaussian",
        *,
        logarithm: bool = False,
        n_functions: int = 5,
        t_min: float = 1e-3,
        t_max: float = 0.1,
        percentile: float = 2.0,
        floor: float = 1.0,
    ) -> None:
        self.kind = kind
        self.logarithm = logarithm
        self.n_functions = n_functions
        self.t_min = t_min
        self.t_max = t_max
        self.percentile = percentile
        self.floor = floor

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        check_choice(self.kind, "kind", ("gaussian", "mean"))
        _check_range(self.n_functions, self.t_min, self.t_max, "t_min", "t_max")
        check_number(self.percentile, "percentile", low=0, high=49)
        check_number(self.floor, "floor", low=0, strict=True)

    def labels(self) -> list[str]:
        """Return the diffusion times."""
        return [f"t={t:.3g}" for t in self._times()]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        curvature = _gaussian_curvature(shape) if self.kind == "gaussian" else _mean_curvature(shape)
        values = log_magnitude(curvature, self.floor) if self.logarithm else curvature
        initial = clip_by_area(values, shape.mass, self.percentile)
        return diffuse(project(initial, shape.evecs, shape.mass), shape.evals, self._times())

    def _times(self) -> FloatArray:
        return np.geomspace(self.t_min, self.t_max, self.n_functions)


class MeshSaliency(ProbeFamily):
    """Mesh saliency (Lee, Varshney, Jacobs 2005): how mean curvature differs between two scales.

    Parameters
    ----------
    n_functions : int, default=10
        Number of scales sigma, in geometric progression; each compares sigma with 2 sigma.
    sigma_min, sigma_max : float, default=0.025, 0.1
        Smallest and largest scale in units of sqrt(area), measured along the surface (Lee's fraction of the bounding
        box depends on the pose). 0.025 is 1.5 mean edges of a mesh of 5,000 vertices.
    percentile : float, default=2
        Area-weighted percentiles that the mean curvature is clipped to first.
    """

    def __init__(
        self, n_functions: int = 10, *, sigma_min: float = 0.025, sigma_max: float = 0.1, percentile: float = 2.0
    ) -> None:
        self.n_functions = n_functions
        self.sigma_min = sigma_min
        self.sigma_max = sigma_max
        self.percentile = percentile

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        _check_range(self.n_functions, self.sigma_min, self.sigma_max, "sigma_min", "sigma_max")
        check_number(self.percentile, "percentile", low=0, high=49)

    def labels(self) -> list[str]:
        """Return the scales."""
        return [f"sigma={s:.3g}" for s in self._scales()]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        curvature = clip_by_area(_mean_curvature(shape), shape.mass, self.percentile)
        values = mesh_saliency(curvature, shape.stiffness, shape.mass, self._scales())
        return project(values, shape.evecs, shape.mass)

    def _scales(self) -> FloatArray:
        return np.geomspace(self.sigma_min, self.sigma_max, self.n_functions)


class OrientedProducts(ProbeFamily):
    """Products <grad f x grad g, n> of pairs of signatures: they change sign under a reflection.

    The probes of the paper do not change under a shape's left-right symmetry, and so cannot tell left from right. These
    do, once the faces are wound outwards. As an operator this is the orientation term of Ren et al. 2018.

    Parameters
    ----------
    n_sources : int, default=11
        Number of signatures that are paired, each with each other: 11 give 55 functions.
    sigma : float, default=0.3
        Standard deviation of the wave kernel signatures, in log eigenvalue.
    lambda_min, lambda_max : float, default=5, 400
        Eigenvalues at unit area that the first and the last energy sit at.
    """

    def __init__(
        self, n_sources: int = 11, *, sigma: float = 0.3, lambda_min: float = 5.0, lambda_max: float = 400.0
    ) -> None:
        self.n_sources = n_sources
        self.sigma = sigma
        self.lambda_min = lambda_min
        self.lambda_max = lambda_max

    def check_parameters(self) -> None:
        """Raise for parameters that cannot be used."""
        _check_range(
            self.n_sources, self.lambda_min, self.lambda_max, "lambda_min", "lambda_max", count="n_sources", least=2
        )
        check_number(self.sigma, "sigma", low=0, strict=True)

    def labels(self) -> list[str]:
        """Return the pairs of energies."""
        return [f"lambda={a:.3g}x{b:.3g}" for a, b in combinations(self._energies(), 2)]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        if not shape.oriented:
            raise MeshError(
                f"The faces of {label(shape.name)} cannot be wound consistently, so it has no left and right; mend "
                "its non-manifold edges, or use DescriptorTransformer('paper')."
            )
        sources = wave_kernel_signature(shape.evals, shape.evecs, np.log(self._energies()), self.sigma)
        first, second = np.array(list(combinations(range(self.n_sources), 2))).T
        integrals = integrated_oriented_products(sources[:, first], sources[:, second], shape.mesh.faces)
        coefficients = shape.evecs.T @ integrals
        # On a surface of revolution all gradients are parallel, and on one with two mirror planes no low function tells
        # left from right: what is left is rounding, and must not be normalised.
        steepness = np.sqrt((sources * (shape.stiffness @ sources)).sum(axis=0))
        noise = np.abs(coefficients) <= 1e-8 * steepness[first] * steepness[second]
        return np.asarray(np.where(noise, 0.0, coefficients))

    def _energies(self) -> FloatArray:
        return np.geomspace(self.lambda_min, self.lambda_max, self.n_sources)


class FunctionProbes(ProbeFamily):
    """Probe functions that a plain Python function computes, as FunctionTransformer wraps one for tables.

    Parameters
    ----------
    function : callable
        Takes a `SpectralShape` (of unit area: ``vertices``, ``mesh.faces``, ``mass``, ``evals``, ``evecs``) and returns
        values at its vertices, shape (n_vertices,) or (n_vertices, n_functions). Its scales must be constants at unit
        area, so that a probe means the same on every shape.
    n_functions : int, default=1
        Number of functions that it returns.
    kw_args : dict, optional
        Further arguments of ``function``.

    Notes
    -----
    Results are cached where `DescriptorTransformer` has a ``memory`` if ``function`` is a function of a module; a
    lambda or a closure is computed each time, because nothing tells one from the next. The source of ``function`` is
    part of the key, that of what it calls is not.

    Examples
    --------
    >>> import numpy as np
    >>> from skfmap import DescriptorTransformer, SpectralBasis
    >>> from skfmap.datasets import make_sphere
    >>> from skfmap.descriptors import FunctionProbes, paper_families
    >>> def depth(shape, power=2.0):
    ...     return np.linalg.norm(shape.vertices - shape.mass @ shape.vertices, axis=1) ** power
    >>> families = [*paper_families(), ("depth", FunctionProbes(depth, kw_args={"power": 3.0}))]
    >>> (shape,) = DescriptorTransformer(families).transform(SpectralBasis(20).transform([make_sphere(3)]))
    >>> shape.probe_names[-1]
    'depth[depth]'
    """

    def __init__(
        self,
        function: Callable[..., FloatArray],
        n_functions: int = 1,
        *,
        kw_args: dict[str, Any] | None = None,
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
        """Return the name of the function, numbered if there are several."""
        name = getattr(self.function, "__name__", type(self.function).__name__)
        return [name] if self.n_functions == 1 else [f"{name}_{i}" for i in range(self.n_functions)]

    def coefficients(self, shape: SpectralShape) -> FloatArray:
        """Return the coefficients, shape (n_components, n_functions)."""
        values = as_reals(self.function(shape, **(self.kw_args or {})), f"What {self.function!r} returns")
        columns = values[:, None] if values.ndim == 1 else values
        if columns.shape != (shape.mesh.n_vertices, self.n_functions) or not np.isfinite(columns).all():
            raise ValueError(
                f"{self.labels()[0]} must return finite values of shape ({shape.mesh.n_vertices}, {self.n_functions}) "
                f"on {label(shape.name)}; got shape {values.shape}"
                + ("." if np.isfinite(values).all() else " with NaN or infinite values.")
            )
        return project(columns, shape.evecs, shape.mass)


def paper_families(n_functions: int = 5) -> list[tuple[str, ProbeFamily]]:
    """Return the nine families of section 5.1: ``n_functions`` each, twice as many of saliency.

    5 gives the 50 probes of section 5.2, 31 the 310 of section 5.3.
    """
    return [
        ("hks", HeatKernelSignature(n_functions)),
        ("wks_narrow", WaveKernelSignature(n_functions, sigma=0.1)),
        ("wks_medium", WaveKernelSignature(n_functions, sigma=0.3)),
        ("wks_wide", WaveKernelSignature(n_functions, sigma=0.6)),
        ("gaussian_curvature", DiffusedCurvature("gaussian", n_functions=n_functions)),
        ("mean_curvature", DiffusedCurvature("mean", n_functions=n_functions)),
        ("log_gaussian_curvature", DiffusedCurvature("gaussian", logarithm=True, n_functions=n_functions)),
        ("log_mean_curvature", DiffusedCurvature("mean", logarithm=True, n_functions=n_functions)),
        ("saliency", MeshSaliency(2 * n_functions)),
    ]


def default_families() -> list[tuple[str, ProbeFamily]]:
    """Return the paper's nine families and the oriented one."""
    return [*paper_families(), ("oriented", OrientedProducts())]


_SHORTHANDS = {"paper": lambda: paper_families(5), "paper-310": lambda: paper_families(31)}


class DescriptorTransformer(Versioned, StatelessShapeTransformer, _BaseComposition):
    """Compute the probe functions of each shape, as raw coefficients in its basis.

    Parameters
    ----------
    families : list of (str, ProbeFamily), {"paper", "paper-310"}, or None
        Named families, as in FeatureUnion; parameters are reachable as ``name__parameter``. None is
        `default_families` (the paper's nine and the oriented one: 105 functions), ``"paper"`` the paper's nine alone
        (50 functions), ``"paper-310"`` the 310 of section 5.3.
    on_invalid : {"raise", "skip"}, default="raise"
        What to do with a shape that a family cannot deal with, such as oriented probes with a surface that has no
        outside. ``"skip"`` puts a `skfmap.shapes.SkippedShape` in its place, with a warning.
    memory : str or joblib.Memory, optional
        Where results are cached, by mesh content and parameters.
    n_jobs : int, optional
        Shapes at a time; see joblib.
    verbose : int, default=0
        Verbosity of joblib's progress.

    See Also
    --------
    SpectralBasis : The step before.
    WeightedFunctionalMapLearner : The next step; it centres and normalises the columns.

    Notes
    -----
    Stateless. All scales are constants on shapes of unit area. The name of a family is the category of its functions.

    Examples
    --------
    >>> from skfmap import DescriptorTransformer, SpectralBasis
    >>> from skfmap.datasets import make_sphere
    >>> shapes = SpectralBasis(n_components=20).transform([make_sphere(n_subdivisions=3)])
    >>> transformer = DescriptorTransformer("paper").set_params(hks__n_functions=3)
    >>> transformer.transform(shapes)[0].probes.shape
    (20, 48)
    >>> transformer.get_feature_names_out()[:3].tolist()
    ['hks[t=0.01]', 'hks[t=0.1]', 'hks[t=1]']
    """

    def __init__(
        self,
        families: list[tuple[str, ProbeFamily]] | str | None = None,
        *,
        on_invalid: str = "raise",
        memory: Any = None,
        n_jobs: int | None = None,
        verbose: int = 0,
    ) -> None:
        self.families = families
        self.on_invalid = on_invalid
        self.memory = memory
        self.n_jobs = n_jobs
        self.verbose = verbose

    def fit(self, X: Sequence[SpectralShape], y: object = None) -> Self:  # noqa: ARG002
        """Check the parameters and the shapes; nothing is learned.

        Parameters
        ----------
        X : sequence of SpectralShape
            From `SpectralBasis`.
        y : ignored
            For scikit-learn's interface.

        Returns
        -------
        DescriptorTransformer
            Itself.
        """
        self._checked_families()
        _check_spectral(X)
        return self

    def transform(self, X: Sequence[SpectralShape]) -> list[ProbedShape]:
        """Compute the probe functions of each shape.

        Parameters
        ----------
        X : sequence of SpectralShape
            From `SpectralBasis`.

        Returns
        -------
        list of ProbedShape
            Raw coefficients, in the order of ``X``.

        Raises
        ------
        MeshError
            If oriented probes are asked for on a surface that has no consistent winding.
        """
        families = self._checked_families()
        given = sort_out(_check_spectral(X))
        names, categories = tuple(self.get_feature_names_out()), tuple(self.probe_categories_)
        arrays = map_shapes(
            _coefficients if self.on_invalid == "raise" else _coefficients_or_skip,
            ((shape, [family for _, family in families], self.memory) for shape in given.shapes),
            n_jobs=self.n_jobs,
            verbose=self.verbose,
        )
        probed = [
            array
            if isinstance(array, SkippedShape)
            else ProbedShape(shape, array, names, categories, _recipe(shape, families))
            for shape, array in zip(given.shapes, arrays, strict=True)
        ]
        warn_of_skipped(probed)
        return spread(probed, given, lambda skipped: skipped)

    def get_feature_names_out(self, input_features: object = None) -> Any:  # noqa: ARG002
        """Return the names of the probe functions, ``family[label]``; an object array of shape (n_probes,)."""
        families = self._checked_families()
        return np.array([f"{name}[{text}]" for name, family in families for text in family.labels()], dtype=object)

    @property
    def probe_categories_(self) -> Any:
        """Family of each probe function; an object array of shape (n_probes,)."""
        families = self._checked_families()
        return np.array([name for name, family in families for _ in family.labels()], dtype=object)

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the parameters; with ``deep`` those of the families too, as ``name__parameter``."""
        params: dict[str, Any] = super().get_params(deep=False)
        if deep:
            for name, family in self._resolved():
                params[name] = family
                params.update({f"{name}__{key}": value for key, value in family.get_params().items()})
        return params

    def set_params(self, **params: Any) -> Self:
        """Set parameters; ``name__parameter`` reaches into a family and turns a shorthand into its list of families."""
        own = {key: params.pop(key) for key in list(params) if key in self.get_params(deep=False)}
        super().set_params(**own)
        if params:
            given = self.families
            self.families = [(name, clone(family)) for name, family in self._resolved()]
            try:
                self._set_params("families", **params)
            except ValueError:
                self.families = given
                raise
        return self

    def _resolved(self) -> list[tuple[str, ProbeFamily]]:
        """Return the list that ``families`` stands for, or nothing if it is not usable."""
        if self.families is None:
            return default_families()
        if isinstance(self.families, str):
            return _SHORTHANDS[self.families]() if self.families in _SHORTHANDS else []
        return self.families if _are_pairs(self.families) else []

    def _checked_families(self) -> list[tuple[str, ProbeFamily]]:
        check_choice(self.on_invalid, "on_invalid", ("raise", "skip"))
        if isinstance(self.families, str) and self.families not in _SHORTHANDS:
            raise ValueError(f"families must be None, a list, or one of {sorted(_SHORTHANDS)}; got {self.families!r}.")
        if not (self.families is None or isinstance(self.families, str) or _are_pairs(self.families)):
            raise TypeError(f"families must be a list of (name, ProbeFamily) pairs; got {self.families!r}.")
        families = self._resolved()
        if not families:
            raise ValueError("families is empty; give at least one (name, family) pair.")
        for name, family in families:
            if not isinstance(family, ProbeFamily):
                raise TypeError(f"Family {name!r} must be a ProbeFamily; got {type(family).__name__}.")
            family.check_parameters()
        self._validate_names([name for name, _ in families])
        return families


def _are_pairs(families: object) -> bool:
    """Tell a list of (name, estimator) pairs from anything else."""
    return isinstance(families, (list, tuple)) and all(
        isinstance(item, (tuple, list))
        and len(item) == 2
        and isinstance(item[0], str)
        and hasattr(item[1], "get_params")
        for item in families
    )


def _recipe(shape: SpectralShape, families: list[tuple[str, ProbeFamily]]) -> tuple[str, ...]:
    """Return what the coefficients depend on beside the mesh, in words that are the same in every process."""
    parts = [f"{name}: {type(family).__name__} {_told(family.get_params())}" for name, family in families]
    return f"n_components={shape.n_components}", f"laplacian={shape.laplacian!r}", *parts


def _told(params: dict[str, Any]) -> list[tuple[str, Any]]:
    """Return parameters with the names of functions instead of their addresses."""
    return [(key, _name_of(value) if callable(value) else value) for key, value in sorted(params.items())]


def _name_of(function: Any) -> str:
    """Return the name of a function; of one without a name, its name and a hash of its code."""
    name = str(getattr(function, "__qualname__", type(function).__qualname__))
    code = getattr(function, "__code__", None)
    if code is None or "<lambda>" not in name:
        return name
    constants = [item for item in code.co_consts if isinstance(item, (int, float, complex, str, tuple))]
    digest = hashlib.sha256(repr((code.co_code, constants, code.co_names)).encode()).hexdigest()
    return f"{name}-{digest[:8]}"


def _codes(family: ProbeFamily) -> list[str | None]:
    """Return hashes of the code that a family and its parameters bring along; None where it cannot be told."""
    functions = [value for value in family.get_params().values() if callable(value)]
    return [code_of(item) for item in (type(family), *functions)]


def _coefficients(shape: SpectralShape, families: list[ProbeFamily], memory: Any) -> FloatArray:
    codes = [code for family in families for code in _codes(family)]
    compute = cached(_stacked, memory if None not in codes else None)
    return np.asarray(compute(shape, shape.mesh.content_hash, families, shape.n_components, shape.laplacian, codes))


def _coefficients_or_skip(shape: SpectralShape, *how: Any) -> FloatArray | SkippedShape:
    try:
        return _coefficients(shape, *how)
    except MeshError as error:
        n_given = shape.mesh.n_vertices if shape.vertex_map is None else len(shape.vertex_map)
        return SkippedShape(shape.name, str(error), n_given)


def _stacked(shape: SpectralShape, content_hash: str, families: list[ProbeFamily], *key: object) -> FloatArray:  # noqa: ARG001
    return np.column_stack([_finite(family, shape) for family in families])


def _finite(family: ProbeFamily, shape: SpectralShape) -> FloatArray:
    """Return the coefficients of a family; those that are no numbers are an error that names both."""
    coefficients = np.asarray(family.coefficients(shape))
    if not np.isfinite(coefficients).all():
        raise ValueError(
            f"{family!r} gives probe functions with NaN or infinite coefficients on {label(shape.name, 'shape')}; "
            "check its parameters, and the mesh with check_mesh."
        )
    return coefficients


def _check_spectral(X: object) -> Sequence[SpectralShape]:
    if isinstance(X, SpectralShape):
        raise TypeError("X must be a sequence of spectral shapes, but it is one; wrap it in a list: [X].")
    shapes = check_samples(X, "spectral shapes")
    for i, shape in enumerate(shapes):
        if not isinstance(shape, (SpectralShape, SkippedShape)):
            raise TypeError(
                f"X[{i}] is a {type(shape).__name__}, not a SpectralShape; put SpectralBasis before this step."
            )
    return shapes


def _gaussian_curvature(shape: SpectralShape) -> FloatArray:
    return gaussian_curvature(shape.mesh.vertices, shape.mesh.faces, shape.mass)


def _mean_curvature(shape: SpectralShape) -> FloatArray:
    return mean_curvature(shape.vertices, shape.mesh.faces, shape.stiffness, shape.mass)


def _check_range(
    n: object, low: object, high: object, low_name: str, high_name: str, *, count: str = "n_functions", least: int = 1
) -> None:
    check_number(n, count, low=least, integer=True)
    check_number(low, low_name, low=0, strict=True)
    check_number(high, high_name, low=0, strict=True)
    if float(high) < float(low):  # type: ignore[arg-type]
        raise ValueError(f"{high_name} must be at least {low_name}; got {high} and {low}.")
