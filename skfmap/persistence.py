"""Saving and loading of models with skops, which inspects a file before it creates any object.

This module lists the types that a file may contain.
"""

import copy
import io
import json
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, ZipFile

import numpy as np
import scipy.sparse as sp

from skfmap._tools.validation import check_folder
from skfmap.exceptions import OutdatedModelError
from skfmap.shapes import (
    Correspondence,
    GivenMesh,
    Landmarks,
    Mesh,
    ProbedShape,
    Prolongation,
    SpectralShape,
)

__all__ = ["TRUSTED_TYPES", "load_model", "save_model"]

TRUSTED_TYPES = (
    "scipy.sparse._csc.csc_array",
    "scipy.sparse._csr.csr_array",
    "skfmap.basis.SpectralBasis",
    "skfmap.descriptors.coordinates.Coordinates",
    "skfmap.descriptors.curvature.DiffusedCurvature",
    "skfmap.descriptors.curvature.MeshSaliency",
    "skfmap.descriptors.oriented.OrientedProducts",
    "skfmap.descriptors.own_functions.FunctionProbes",
    "skfmap.descriptors.signatures.HeatKernelSignature",
    "skfmap.descriptors.signatures.WaveKernelSignature",
    "skfmap.descriptors.transformer.DescriptorTransformer",
    "skfmap.functional.regularization.LearnedMask",
    "skfmap.known_maps.AutoKnownMaps",
    "skfmap.known_maps.FromLandmarks",
    "skfmap.known_maps.InSpace",
    "skfmap.known_maps.KnownMapsRecord",
    "skfmap.known_maps.PairsAsGiven",
    "skfmap.learner.across.Across",
    "skfmap.learner.bridged.BridgedLearner",
    "skfmap.learner.confidence.CrossFitConfidence",
    "skfmap.learner.error_model.ErrorModel",
    "skfmap.learner.estimator.WeightedFunctionalMapLearner",
    "skfmap.learner.matcher.Matcher",
    "skfmap.learner.matcher.Settings",
    "skfmap.learner.training_set.FitRecord",
    *(f"skfmap.partial.cuts.{name}" for name in ("DiscCut", "LimbCut", "PlaneCut", "ViewCut")),
    "skfmap.partial.body.Body",
    "skfmap.partial.body.Regions",
    "skfmap.partial.matcher.PartialMatcher",
    "skfmap.partial.recognition.Recogniser",
    "skfmap.partial.trust.PartTrust",
    "skfmap.refinement.BijectiveZoomOut",
    "skfmap.refinement.ICP",
    "skfmap.refinement.ZoomOut",
    "skfmap.geometry.elasticity.ElasticSurface",
    "skfmap.learner.landmark_model.LandmarkModel",
    "skfmap.learner.landmark_model.LeftOut",
    "skfmap.registration.deformation.Deformation",
    "skfmap.registration.part.Registration",
    "skfmap.registration.quality.Limits",
    "skfmap.registration.quality.Quality",
    "skfmap.shape_space.ShapeSpace",
    "skfmap.shapes.correspondence.Correspondence",
    "skfmap.shapes.landmarks.Landmarks",
    "skfmap.shapes.mesh.Mesh",
    "skfmap.shapes.probed_shape.ProbedShape",
    "skfmap.shapes.given_mesh.GivenMesh",
    "skfmap.shapes.prolongation.Prolongation",
    "skfmap.shapes.spectral_shape.SpectralShape",
    "skfmap.shapes.surface_places.SurfacePlaces",
    # Names in files of 0.1.0 (skfmap.learner.legacy).
    "skfmap._bridge.Across",
    "skfmap._confidence.ErrorModel",
    "skfmap._matching.Settings",
    *(
        f"skfmap.descriptors.{name}"
        for name in ("DescriptorTransformer", "DiffusedCurvature", "FunctionProbes")
    ),
    *(
        f"skfmap.descriptors.{name}"
        for name in ("HeatKernelSignature", "MeshSaliency", "OrientedProducts")
    ),
    "skfmap.descriptors.WaveKernelSignature",
    "skfmap.learner.WeightedFunctionalMapLearner",
    *(
        f"skfmap.shapes.{name}"
        for name in ("Correspondence", "Mesh", "ProbedShape", "SpectralShape")
    ),
)
"""Types of a model other than numbers, strings, containers, arrays and scikit-learn's Pipeline."""

_PLAIN_TYPES = {
    *(f"builtins.{name}" for name in ("bool", "dict", "float", "int", "list", "str", "tuple")),
    *(
        f"numpy.{name}"
        for name in ("bool", "dtype", "float32", "float64", "int32", "int64", "ndarray")
    ),
    "sklearn.pipeline.Pipeline",
}
# The loaders of skops that may create objects from a file. Loaders that call a function named in
# the file are not allowed.
_PLAIN_LOADERS = {
    *(
        "CachedNode",
        "ConstructorFromReduceNode",
        "DTypeNode",
        "DictNode",
        "JsonNode",
        "ListNode",
        "NdArrayNode",
    ),
    *("ObjectNode", "SparseMatrixNode", "TupleNode", "TypeNode"),
}
# Types that only their own constructor may create, because it checks its arguments.
_LOADERS_OF = {
    name: {"CachedNode", "ConstructorFromReduceNode"}
    for name in ("skfmap.shapes.mesh.Mesh", "skfmap.shapes.Mesh")
}
# Object arrays contain only names of probe functions.
_TEXT_LOADERS = {"CachedNode", "JsonNode", "ListNode", "TupleNode", "TypeNode"}


def save_model(model: Any, path: str | Path) -> None:
    """Write a fitted learner or pipeline to a file that `load_model` can read.

    Caches (``memory``) belong to this machine and are not saved.

    Parameters
    ----------
    model : WeightedFunctionalMapLearner, Pipeline or transformer
        The model. For a search, save ``best_estimator_``.
    path : str or Path
        File to write, by convention with the suffix ``.skops``. An existing file is replaced, but
        only after the new one has been written completely; if writing fails, the old file is
        unchanged.

    Raises
    ------
    ImportError
        If skops is not installed.
    TypeError
        If ``model`` is not an estimator.
    FileNotFoundError
        If the folder does not exist.
    """
    skops = _skops()
    if not hasattr(model, "get_params"):
        raise TypeError(f"model must be a learner, a pipeline or a transformer; got {model!r}.")
    check_folder(path)
    model = copy.deepcopy(model)
    _set_memory(model, None)
    with tempfile.TemporaryDirectory(dir=Path(path).parent, prefix=".skfmap-") as folder:
        whole = Path(folder) / Path(path).name
        skops.dump(model, whole)
        whole.replace(path)


def load_model(path: str | Path, *, trusted: Sequence[str] = (), memory: Any = None) -> Any:
    """Read a model that `save_model` wrote.

    A file that contains anything other than a model is rejected before it is loaded. ``pickle`` and
    ``joblib.load`` run any code that a file names. This function creates only objects of known
    types, calls no function that the file names, and reads no other file: a cache (``memory``)
    named in the file is ignored, because caches are read with pickle.

    Parameters
    ----------
    path : str or Path
        The file.
    trusted : sequence of str
        Full names of further types and functions to accept, such as your own probe families and
        functions, or other estimators of scikit-learn.
    memory : None, str, Path or joblib.Memory
        Cache for all steps of the model.

    Returns
    -------
    object
        The model; its predictions are identical, bit by bit.

    Raises
    ------
    ImportError
        If skops is not installed.
    FileNotFoundError
        If the file does not exist.
    TypeError
        If the file contains types that are not trusted; the message names them.
    OutdatedModelError
        If an earlier release saved a kind of model that must be fitted again.
    ValueError
        If the file was not written by `save_model`, is damaged, or is compressed (a small file
        could then fill the memory), or if the parts of the model are inconsistent.

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
    skops, path = _skops(), Path(path)
    if isinstance(trusted, str):
        raise TypeError(f"trusted must be a list of full names, such as [{trusted!r}].")
    if not path.is_file():
        raise FileNotFoundError(f"There is no model file {path}.")
    content, allowed = path.read_bytes(), {*TRUSTED_TYPES, *trusted}
    try:
        strange = _strange_types(_schema(content), allowed, set(trusted))
        # Both checks must pass: ours, of the types that a model has, and that of skops, of types
        # that are dangerous. Ours comes first, because some versions of skops import what a file
        # names in order to inspect it.
        strange = strange or set(skops.get_untrusted_types(data=content)) - allowed
        model = None if strange else skops.loads(content, trusted=sorted(allowed))
        _check_parts(model)
    except OutdatedModelError:
        raise
    except Exception as error:
        raise ValueError(
            f"{path} is not a valid file of save_model: {type(error).__name__}: {error}. Was it "
            "written by joblib or pickle, which load_model does not read, or truncated in transfer?"
        ) from error
    if strange:
        raise TypeError(
            f"{path} contains types that are not part of a skfmap model: "
            f"{', '.join(sorted(strange))}. If you know all of them and trust the author of the "
            "file, list them in load_model(..., trusted=[...])."
        )
    _set_memory(model, memory)
    return model


def _schema(content: bytes) -> Any:
    """Return the tree of the objects in a file, before any of them is created."""
    with ZipFile(io.BytesIO(content)) as archive:
        members = archive.infolist()
        if any(member.compress_type != ZIP_STORED for member in members):
            raise ValueError("it is compressed, but save_model never compresses")
        if sum(member.file_size for member in members) > len(content):
            raise ValueError("it declares more data than it contains")
        schema = json.loads(archive.read("schema.json"))
    files = [str(node["file"]) for node in _nodes(schema) if "file" in node]
    if len(set(files)) < len(files):
        raise ValueError("it uses one array several times, which save_model never does")
    return schema


def _strange_types(schema: Any, allowed: set[str], trusted: set[str]) -> set[str]:
    """Return the full names of types or loaders that are not part of a model."""
    strange = set()
    for node in _nodes(schema):
        name = _full_name(node)
        known = name in _PLAIN_TYPES or name in allowed
        usual = node["__loader__"] in _PLAIN_LOADERS and node["__loader__"] in _LOADERS_OF.get(
            name, _PLAIN_LOADERS
        )
        if not known or not (usual or name in trusted):
            strange.add(name)
        if node["__loader__"] == "NdArrayNode" and node.get("type") != "numpy":
            strange |= {
                _full_name(one)
                for one in _nodes(node["content"])
                if one["__loader__"] not in _TEXT_LOADERS
            }
    return strange


def _full_name(node: dict[str, Any]) -> str:
    return f"{node['__module__']}.{node['__class__']}"


def _nodes(schema: Any) -> Iterator[dict[str, Any]]:
    """Yield the description of each object in a tree."""
    if isinstance(schema, dict):
        if "__loader__" in schema:
            yield schema
        schema = list(schema.values())
    if isinstance(schema, list):
        for item in schema:
            yield from _nodes(item)


def _parts(item: Any, seen: dict[int, Any]) -> Iterator[Any]:
    """Yield an object and everything it contains, each once."""
    if id(item) in seen:
        return
    seen[id(item)] = item
    yield item
    inner: Iterable[Any] = item if isinstance(item, (list, tuple, set, frozenset)) else ()
    if isinstance(item, dict):
        inner = (*item.keys(), *item.values())
    elif isinstance(item, np.ndarray) and item.dtype.hasobject:
        inner = item.ravel().tolist()
    for part in (*inner, *getattr(item, "__dict__", {}).values()):
        yield from _parts(part, seen)


def _set_memory(model: Any, memory: Any) -> None:
    for part in _parts(model, {}):
        if "memory" in getattr(part, "__dict__", {}):
            part.memory = memory


def _check_parts(model: Any) -> None:
    """Raise for values in a file that could crash compiled code.

    These are invalid indices of sparse arrays, and arrays of inconsistent sizes.
    """
    for part in list(_parts(model, {})):
        if is_dataclass(part) and not isinstance(part, type):
            _forget_what_is_derived(part)
        if isinstance(part, (Correspondence, Landmarks, Mesh)):
            replace(part)  # runs the checks of the constructor
        elif sp.issparse(part):
            part.check_format(full_check=True)  # type: ignore[attr-defined]
        elif isinstance(part, SpectralShape):
            n, k = part.mesh.n_vertices, len(part.evals)
            _check_sizes(part.evecs, (n, k), "eigenfunctions")
            _check_sizes(part.mass, (n,), "mass")
            _check_sizes(part.stiffness, (n, n), "stiffness")
            if part.prolongation is not None:
                _check_prolongation(part.prolongation, part.mesh.n_faces)
        elif isinstance(part, GivenMesh) and isinstance(part.source, (str, Path)):
            raise ValueError(f"the given mesh would be read from another file, {part.source!r}")
        elif isinstance(part, ProbedShape):
            _check_sizes(part.probes, (len(part.spectral.evals), len(part.probe_names)), "probes")


def _check_prolongation(prolongation: Prolongation, n_faces: int) -> None:
    face, n = prolongation.face, len(prolongation.face)
    _check_sizes(prolongation.coordinates, (n, 2), "places")
    if face.shape != (n,) or face.dtype.kind != "i" or not ((face >= -1) & (face < n_faces)).all():
        raise ValueError(f"the places are not on the {n_faces} faces of the working mesh")


def _forget_what_is_derived(part: Any) -> None:
    """Remove cached values (areas, hashes) from a dataclass, so that they are computed afresh."""
    for name in set(vars(part)) - {field.name for field in fields(part)}:
        del vars(part)[name]


def _check_sizes(array: Any, shape: tuple[int, ...], what: str) -> None:
    if array.shape != shape or not np.issubdtype(array.dtype, np.floating):
        raise ValueError(
            f"the {what} have shape {array.shape} and dtype {array.dtype}, not {shape} and floats"
        )


def _skops() -> Any:
    try:
        import skops.io  # noqa: PLC0415
    except ImportError as error:
        raise ImportError(
            "Saving and loading models safely needs skops: pip install 'skfmap[skops]'."
        ) from error
    return skops.io
