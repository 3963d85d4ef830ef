"""Results kept on disk by content and parameters, computed once whichever process asks first."""

import hashlib
import inspect
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, TypeAlias, TypeVar

import joblib
import numpy as np
import numpy.typing as npt
from filelock import FileLock
from sklearn.utils.validation import check_memory

from skfmap._tools.warn import warn
from skfmap.exceptions import CacheWarning

__all__ = ["MemoryLike", "cached", "code_of", "hash_of_arrays"]

MemoryLike: TypeAlias = str | Path | joblib.Memory | None
_Result = TypeVar("_Result")


def hash_of_arrays(*arrays: npt.ArrayLike) -> str:
    """Return a hash of the content of numeric arrays, their types and their shapes."""
    digest = hashlib.sha256()
    for array in map(np.asarray, arrays):
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def cached(function: Callable[..., _Result], memory: MemoryLike) -> Callable[..., _Result]:
    """Return ``function(content, content_hash, *key)`` with its results kept in ``memory``.

    Parameters
    ----------
    function : callable
        A function of a module. Its first argument carries the content and is left out of the key;
        the second is a hash of that content.
    memory : None, str, Path or joblib.Memory
        Where results are kept; nowhere if None.

    Returns
    -------
    callable
        Takes the same arguments. While one process computes a result, others that ask for it wait.
    """
    # What is kept was computed by some version of this package, not only of `function`: the key
    # holds its code.
    store = _store_of(memory)
    if store.location is None:
        return function
    remembered = store.cache(function, ignore=[function.__code__.co_varnames[0]])

    def recall(content: object, content_hash: str, *rest: object) -> _Result:
        _agree_on_code(remembered, store.location)
        key = (f"{content_hash}-{_code_of_package()}", *rest)
        if remembered.check_call_in_cache(content, *key):
            return remembered(content, *key)
        lock = _lock(store.location, joblib.hash((function.__qualname__, key)))
        if lock is None:
            return function(content, content_hash, *rest)
        with lock:
            return remembered(content, *key)

    return recall


# Functions whose code this process has compared with that of the cache, by folder.
_AGREED: set[tuple[str, str]] = set()


def _agree_on_code(remembered: Any, location: str) -> None:
    """Compare a function's code with what the cache holds of it, once in a process.

    joblib does so before each entry, and writes it where it is missing: of two processes at once,
    one would read what the other has written by half, take it for another function's, and wipe what
    is kept of this one. Hence a lock of the function, not of the entry.
    """
    named = (str(location), str(remembered.func_id))
    if named in _AGREED:
        return
    lock = _lock(location, joblib.hash(named), tell=False)
    if lock is not None:
        with lock:
            remembered._check_previous_func_code(stacklevel=2)
    _AGREED.add(named)


def _store_of(memory: MemoryLike) -> joblib.Memory:
    """Return a joblib.Memory; raise if there can be none."""
    try:
        return check_memory(str(memory) if isinstance(memory, Path) else memory)
    except (OSError, ValueError) as error:
        raise ValueError(
            f"memory={memory!r} cannot hold a cache: {error}. Give a folder that can be written "
            "to, or None."
        ) from error


def _lock(location: str, name: str, *, tell: bool = True) -> FileLock | None:
    """Return a lock that is not yet held, or None, and a warning, where nothing can be written."""
    folder = Path(location) / "skfmap-locks"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / f"{name}.lock")
        with lock:  # raises where it cannot be had
            pass
    except OSError as error:
        if not tell:
            return None
        warn(
            f"The cache {location} cannot be written to ({error}): what it holds is used, what it "
            "does not hold is computed and not kept.",
            CacheWarning,
        )
        return None
    return lock


def code_of(item: Callable[..., object]) -> str | None:
    """Return a hash of the source of a class or function that a user wrote, and of what it calls.

    Functions and classes of the same module, and those imported from other modules by name, are
    followed. None if the source cannot be read, or does not tell the whole: a lambda, a closure, a
    bound method, a module of one's own that is used as a whole.
    """
    sources: dict[object, str] = {}
    if not _collect_sources(item, sources):
        return None
    return hashlib.sha256("".join(sources.values()).encode()).hexdigest() if sources else ""


def _collect_sources(item: Callable[..., object], sources: dict[object, str]) -> bool:
    """Add the source of an item and of what it refers to; return whether that tells the whole."""
    if item in sources or _is_installed(getattr(item, "__module__", None)):
        return True
    if not isinstance(item, type) and not _is_plain(item):
        return False
    try:
        sources[item] = inspect.getsource(item)
    except (OSError, TypeError):
        return False
    return all(_collect_reference(value, sources) for value in _globals_of(item))


def _collect_reference(value: object, sources: dict[object, str]) -> bool:
    if inspect.ismodule(value):
        return _is_installed(value.__name__)
    if isinstance(value, (FunctionType, type)):
        return _collect_sources(value, sources)
    if isinstance(value, np.ndarray) and value.dtype != object:
        sources[hash_of_arrays(value)] = hash_of_arrays(value)
        return True
    plain = isinstance(
        value, (bool, int, float, complex, str, bytes, tuple, list, dict, set, type(None))
    )
    if plain:
        sources[repr(value)] = repr(value)
    return plain or _is_installed(type(value).__module__)


def _globals_of(item: object) -> list[object]:
    """Return what a function, or the methods of a class, find in their module."""
    members = vars(item).values() if isinstance(item, type) else [item]
    functions = [f for f in members if isinstance(f, FunctionType)]
    names = {(f, name) for f in functions for name in _names_in(f.__code__)}
    found = sorted(
        ((name, f.__globals__[name]) for f, name in names if name in f.__globals__),
        key=lambda one: one[0],
    )
    return [value for _, value in found]


def _names_in(code: CodeType) -> set[str]:
    """Return the names that code and the functions inside it use."""
    inner = (_names_in(item) for item in code.co_consts if isinstance(item, CodeType))
    return set(code.co_names).union(*inner)


def _is_installed(module: str | None) -> bool:
    """Return whether a module is of Python, of this package, or of an installed package.

    Their versions tell them apart; their sources need not be read.
    """
    top = (module or "").partition(".")[0]
    if top == "skfmap" or (top in sys.stdlib_module_names and top != "__main__"):
        return True
    return "site-packages" in str(getattr(sys.modules.get(top), "__file__", None) or "")


def _is_plain(item: object) -> bool:
    """Return whether this is a function with a name that carries no values of its own."""
    return isinstance(item, FunctionType) and item.__name__ != "<lambda>" and not item.__closure__


@lru_cache
def _code_of_package() -> str:
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]  # 64 bits: versions of one package do not collide
