"""The transformer that computes probe functions."""

import hashlib
from collections.abc import Callable, Sequence
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt
from sklearn.base import clone
from sklearn.utils.metaestimators import _BaseComposition

from skfmap._tools.caching import MemoryLike, cached, code_of
from skfmap._tools.parallel import map_shapes
from skfmap._tools.stateless import StatelessShapeTransformer
from skfmap._tools.types import FloatArray, RaiseOrSkip
from skfmap._tools.validation import check_choice
from skfmap._version import Versioned
from skfmap.descriptors.defaults import SHORTHANDS, default_families
from skfmap.descriptors.family import ProbeFamily, check_spectral, finite_coefficients
from skfmap.exceptions import MeshError
from skfmap.shapes import ProbedShape, SkippedShape, SpectralShape
from skfmap.shapes.usable import pick_usable, put_back, warn_of_skipped

__all__ = ["DescriptorTransformer"]


class DescriptorTransformer(Versioned, StatelessShapeTransformer, _BaseComposition):
    """Compute the probe functions of each shape, as raw coefficients in its basis.

    Parameters
    ----------
    families : list of (str, ProbeFamily), {"paper", "paper-310"}, or None
        Named families, as in FeatureUnion; their parameters can be set as ``name__parameter``. None
        stands for `default_families` (the nine families of the paper and the oriented one: 105
        functions), ``"paper"`` for the nine families of the paper (50 functions), and
        ``"paper-310"`` for the 310 functions of section 5.3.
    on_invalid : {"raise", "skip"}, default="raise"
        What to do with a shape that a family cannot handle, such as a surface without an outside,
        for which oriented probes are undefined. ``"skip"`` replaces it by a
        `skfmap.shapes.SkippedShape`, with a warning.
    memory : str or joblib.Memory, optional
        Where results are cached, by mesh content and parameters.
    n_jobs : int, optional
        Number of shapes processed in parallel; see joblib.
    verbose : int, default=0
        Verbosity of joblib's progress.

    See Also
    --------
    SpectralBasis : The previous step.
    WeightedFunctionalMapLearner : The next step; it centres and normalises the columns.

    Notes
    -----
    This transformer is stateless. All scales are constants at unit area. The name of a family is
    the category of its functions.

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
        families: list[tuple[str, ProbeFamily]] | Literal["paper", "paper-310"] | None = None,
        *,
        on_invalid: RaiseOrSkip = "raise",
        memory: MemoryLike = None,
        n_jobs: int | None = None,
        verbose: int = 0,
    ) -> None:
        self.families = families
        self.on_invalid = on_invalid
        self.memory = memory
        self.n_jobs = n_jobs
        self.verbose = verbose

    def fit(self, X: Sequence[SpectralShape], y: object = None) -> Self:  # noqa: ARG002
        """Check the parameters and the shapes, without learning anything.

        Parameters
        ----------
        X : sequence of SpectralShape
            Shapes from `SpectralBasis`.
        y : ignored
            Present for API consistency by convention.

        Returns
        -------
        DescriptorTransformer
            The transformer itself.
        """
        self._checked_families()
        check_spectral(X)
        return self

    def transform(self, X: Sequence[SpectralShape]) -> list[ProbedShape]:
        """Compute the probe functions of each shape.

        Parameters
        ----------
        X : sequence of SpectralShape
            Shapes from `SpectralBasis`.

        Returns
        -------
        list of ProbedShape
            Shapes with their raw coefficients, in the order of ``X``.

        Raises
        ------
        MeshError
            If there are oriented probes and a surface has no consistent winding, unless
            ``on_invalid="skip"``.
        """
        families = self._checked_families()
        given = pick_usable(check_spectral(X))
        names, categories = tuple(self.get_feature_names_out()), tuple(self.probe_categories_)
        arrays = map_shapes(
            _coefficients if self.on_invalid == "raise" else _coefficients_or_skip,
            ((shape, [family for _, family in families], self.memory) for shape in given.shapes),
            n_jobs=self.n_jobs,
            verbose=self.verbose,
            prefer="threads",
        )
        probed = [
            array
            if isinstance(array, SkippedShape)
            else ProbedShape(shape, array, names, categories, _recipe(shape, families))
            for shape, array in zip(given.shapes, arrays, strict=True)
        ]
        warn_of_skipped(probed)
        return put_back(probed, given, lambda skipped: skipped)

    def get_feature_names_out(
        self,
        input_features: object = None,  # noqa: ARG002
    ) -> npt.NDArray[np.object_]:
        """Return the names of the probe functions, ``family[label]``, as an object array."""
        families = self._checked_families()
        return np.array(
            [f"{name}[{text}]" for name, family in families for text in family.labels()],
            dtype=object,
        )

    @property
    def probe_categories_(self) -> npt.NDArray[np.object_]:
        """Family of each probe function; an object array of shape (n_probes,)."""
        families = self._checked_families()
        return np.array([name for name, family in families for _ in family.labels()], dtype=object)

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the parameters; if ``deep``, also those of families, as ``name__parameter``."""
        params: dict[str, Any] = super().get_params(deep=False)
        if deep:
            for name, family in self._resolved():
                params[name] = family
                params.update(
                    {f"{name}__{key}": value for key, value in family.get_params().items()}
                )
        return params

    def set_params(self, **params: object) -> Self:
        """Set parameters; ``name__parameter`` sets a parameter of a family.

        Setting one of these replaces a shorthand by its list of families.
        """
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
        """Return the list that ``families`` stands for, or an empty list if it is invalid."""
        if self.families is None:
            return default_families()
        if isinstance(self.families, str):
            return SHORTHANDS[self.families]() if self.families in SHORTHANDS else []
        return self.families if _are_pairs(self.families) else []

    def _checked_families(self) -> list[tuple[str, ProbeFamily]]:
        check_choice(self.on_invalid, "on_invalid", ("raise", "skip"))
        if isinstance(self.families, str) and self.families not in SHORTHANDS:
            raise ValueError(
                f"families must be None, a list, or one of {sorted(SHORTHANDS)}; got "
                f"{self.families!r}."
            )
        if not (
            self.families is None or isinstance(self.families, str) or _are_pairs(self.families)
        ):
            raise TypeError(
                f"families must be a list of (name, ProbeFamily) pairs; got {self.families!r}."
            )
        families = self._resolved()
        if not families:
            raise ValueError("families is empty; give at least one (name, family) pair.")
        for name, family in families:
            if not isinstance(family, ProbeFamily):
                raise TypeError(
                    f"Family {name!r} must be a ProbeFamily; got {type(family).__name__}."
                )
            family.check_parameters()
        self._validate_names([name for name, _ in families])
        return families


def _are_pairs(families: object) -> bool:
    """Return whether these are (name, estimator) pairs."""
    return isinstance(families, (list, tuple)) and all(
        isinstance(item, (tuple, list))
        and len(item) == 2
        and isinstance(item[0], str)
        and hasattr(item[1], "get_params")
        for item in families
    )


def _recipe(shape: SpectralShape, families: list[tuple[str, ProbeFamily]]) -> tuple[str, ...]:
    """Return what the coefficients depend on besides the mesh, as text that is reproducible."""
    parts = [
        f"{name}: {type(family).__name__} {_told(family.get_params())}" for name, family in families
    ]
    return f"n_components={shape.n_components}", f"laplacian={shape.laplacian!r}", *parts


def _told(params: dict[str, Any]) -> list[tuple[str, Any]]:
    """Return parameters with the names of functions instead of their addresses."""
    return [
        (key, _name_of(value) if callable(value) else value)
        for key, value in sorted(params.items())
    ]


def _name_of(function: Callable[..., object]) -> str:
    """Return the name of a function; for a lambda also a hash of its code."""
    name = str(getattr(function, "__qualname__", type(function).__qualname__))
    code = getattr(function, "__code__", None)
    if code is None or "<lambda>" not in name:
        return name
    constants = [
        item for item in code.co_consts if isinstance(item, (int, float, complex, str, tuple))
    ]
    digest = hashlib.sha256(repr((code.co_code, constants, code.co_names)).encode()).hexdigest()
    return f"{name}-{digest[:8]}"  # 32 bits distinguish the lambdas of one model


def _codes(family: ProbeFamily) -> list[str | None]:
    """Return hashes of the code of a family and of its parameters; None if one is unknown."""
    functions = [value for value in family.get_params().values() if callable(value)]
    return [code_of(item) for item in (type(family), *functions)]


def _coefficients(
    shape: SpectralShape, families: list[ProbeFamily], memory: MemoryLike
) -> FloatArray:
    codes = [code for family in families for code in _codes(family)]
    compute = cached(_stacked, memory if None not in codes else None)
    return np.asarray(
        compute(
            shape, shape.mesh.content_hash, families, shape.n_components, shape.laplacian, codes
        )
    )


def _coefficients_or_skip(
    shape: SpectralShape, families: list[ProbeFamily], memory: MemoryLike
) -> FloatArray | SkippedShape:
    try:
        return _coefficients(shape, families, memory)
    except MeshError as error:
        return SkippedShape(shape.name, str(error), shape.n_given)


def _stacked(
    shape: SpectralShape,
    content_hash: str,  # noqa: ARG001
    families: list[ProbeFamily],
    *key: object,  # noqa: ARG001
) -> FloatArray:
    return np.column_stack([finite_coefficients(family, shape) for family in families])
