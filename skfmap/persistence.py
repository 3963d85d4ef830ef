"""Models in files: by skops, which looks at a file before anything in it runs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

__all__ = ["TRUSTED_TYPES", "load_model", "save_model"]

TRUSTED_TYPES = (
    "scipy.sparse._csc.csc_array",
    "scipy.sparse._csr.csr_array",
    "skfmap._bridge.Across",
    "skfmap._confidence.ErrorModel",
    "skfmap._matching.Settings",
    "skfmap.basis.SpectralBasis",
    "skfmap.descriptors.DescriptorTransformer",
    "skfmap.descriptors.DiffusedCurvature",
    "skfmap.descriptors.FunctionProbes",
    "skfmap.descriptors.HeatKernelSignature",
    "skfmap.descriptors.MeshSaliency",
    "skfmap.descriptors.OrientedProducts",
    "skfmap.descriptors.WaveKernelSignature",
    "skfmap.functional.regularization.LearnedMask",
    "skfmap.learner.WeightedFunctionalMapLearner",
    "skfmap.shapes.Correspondence",
    "skfmap.shapes.Mesh",
    "skfmap.shapes.ProbedShape",
    "skfmap.shapes.SpectralShape",
)
"""What a model of this package is made of beside numbers, arrays and scikit-learn's own classes."""


def save_model(model: Any, path: str | Path) -> None:
    """Write a fitted learner or pipeline to a file that `load_model` reads.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, Pipeline or transformer
        The model. Of a search, save ``best_estimator_``.
    path : str or Path
        File to write; ``.skops`` is the custom.

    Raises
    ------
    ImportError
        If skops is not installed.
    """
    _skops().dump(model, Path(path))


def load_model(path: str | Path, *, trusted: Sequence[str] = ()) -> Any:
    """Read a model that `save_model` wrote; a file with anything but models in it is refused before it is loaded.

    ``pickle`` and ``joblib.load`` run whatever code a file names; skops makes only objects of known types.

    Parameters
    ----------
    path : str or Path
        The file.
    trusted : sequence of str
        Further types and functions that may be made, by their full name: your own probe families and functions.

    Returns
    -------
    object
        The model, with bit by bit the same predictions.

    Raises
    ------
    ImportError
        If skops is not installed.
    TypeError
        If the file holds types that are not trusted; the message names them.

    Warns
    -----
    VersionWarning
        If another version of skfmap saved it.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from skfmap import SpectralBasis
    >>> from skfmap.persistence import load_model, save_model
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "basis.skops"
    >>> save_model(SpectralBasis(n_components=30), path)
    >>> load_model(path)
    SpectralBasis(n_components=30)
    """
    skops = _skops()
    allowed = {*TRUSTED_TYPES, *trusted}
    strange = sorted(set(skops.get_untrusted_types(file=Path(path))) - allowed)
    if strange:
        raise TypeError(
            f"{path} holds types that are no part of a model of skfmap: {', '.join(strange)}. If you know all of them "
            "and trust whoever made the file, load it with trusted=[...] naming them."
        )
    return skops.load(Path(path), trusted=sorted(allowed))


def _skops() -> Any:
    try:
        import skops.io  # noqa: PLC0415
    except ImportError as error:
        raise ImportError("Files that are safe to load need skops: pip install 'skfmap[skops]'.") from error
    return skops.io
