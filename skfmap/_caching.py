"""Results kept on disk, by content and parameters."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from sklearn.utils.validation import check_memory

__all__ = ["cached"]


def cached(function: Callable[..., Any], memory: Any, ignore: str) -> Callable[..., Any]:
    """Return ``function`` with its results kept in ``memory`` (None, a path or a joblib.Memory).

    The argument named ``ignore`` is left out of the key; another argument holds a hash of its content.
    """
    store = check_memory(str(memory) if isinstance(memory, Path) else memory)
    kept: Callable[..., Any] = store.cache(function, ignore=[ignore])
    return kept
