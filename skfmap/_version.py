"""The version of the package, and a check of the version that saved a model."""

from typing import Any

from skfmap._tools.documented import Documented
from skfmap._tools.warn import warn
from skfmap.exceptions import VersionWarning

__all__ = ["Versioned", "__version__"]

__version__ = "0.1.0"


class Versioned(Documented):
    """Mixin for estimators whose pickles record the version; list it before BaseEstimator."""

    def __getstate__(self) -> dict[str, Any]:
        """Return the state to save."""
        return {**super().__getstate__(), "_skfmap_version": __version__}  # type: ignore[dict-item]

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a saved state; warn if another version saved it."""
        saved = state.get("_skfmap_version", "unknown")
        if saved != __version__:
            warn(
                f"This {type(self).__name__} was saved by skfmap {saved} and is loaded by "
                f"{__version__}, so its results may differ. Fit it again, or install the version "
                "that saved it.",
                VersionWarning,
            )
        kept = {key: value for key, value in state.items() if key != "_skfmap_version"}
        super().__setstate__(kept)  # type: ignore[misc]
