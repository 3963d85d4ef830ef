"""Loading of models that were saved before the learner was composed of parts.

The module provides their classes under the old names, and converts their state.
"""

import sys
from typing import Any, NamedTuple

from skfmap.exceptions import OutdatedModelError
from skfmap.learner.across import Across
from skfmap.learner.confidence import REFINED, UNREFINED, CrossFitConfidence
from skfmap.learner.error_model import ErrorModel
from skfmap.learner.matcher import Matcher
from skfmap.learner.matcher import Settings as NewSettings
from skfmap.learner.training_set import FitRecord
from skfmap.refinement import REFINEMENTS

__all__ = ["Across", "ErrorModel", "Settings", "upgraded"]


class Settings(NamedTuple):
    """Old settings of a matcher."""

    alpha: float
    normalize: str
    regularizer: Any
    matching: str
    n_stable: int
    refine: str | None


# Attributes that older models do not have.
_NOT_KNOWN = {"landmarks_": None, "known_maps_": None}

# Files refer to these classes by their old modules.
for _module in ("_bridge", "_confidence", "_matching"):
    sys.modules.setdefault(f"skfmap.{_module}", sys.modules[__name__])


def upgraded(state: dict[str, Any]) -> dict[str, Any]:
    """Return the state of a learner in the current form; a current state is returned unchanged.

    Raises
    ------
    OutdatedModelError
        If the model matched through a bridge.
    """
    if "bridge" not in state:
        return {**_NOT_KNOWN, **state} if "matcher_" in state else state
    if state["bridge"] is not None:
        raise OutdatedModelError(
            "This model matches through a bridge, and was saved before BridgedLearner existed. Fit "
            "it again, with skfmap.BridgedLearner around the learner."
        )
    parameters = {
        name: value for name, value in state.items() if not name.endswith("_") and name[0] != "_"
    }
    del parameters["bridge"]
    kept = {"_skfmap_version", "_sklearn_version"} & state.keys()
    upgrade = {**parameters, "confidence": "cross-fit", **{name: state[name] for name in kept}}
    return upgrade | _fitted(state) if "_settings" in state else upgrade


def _fitted(old: dict[str, Any]) -> dict[str, Any]:
    settings = old["_settings"]
    refine = None if settings.refine is None else REFINEMENTS[settings.refine]()
    matcher = Matcher(
        old["reference_"],
        old["weights_"],
        old["stable_basis_"],
        old["residual_covariance_"],
        old["truncation_covariance_"],
        NewSettings(*settings[:5]),
        refine,
    )
    confidence = CrossFitConfidence()
    kinds = {UNREFINED: UNREFINED, settings.refine: REFINED}
    confidence.error_models_ = {kinds[kind]: model for kind, model in old["error_models_"].items()}
    confidence.misfits_, confidence.training_errors_ = old["misfits_"], old["training_errors_"]
    record = FitRecord(
        *(
            old[name]
            for name in (
                "reference_index_",
                "reference_correspondence_",
                "n_training_shapes_",
                "_n_training",
            )
        ),
        *(old[name] for name in ("stability_", "epsilon_", "loss_curve_", "n_iter_", "converged_")),
    )
    return {**_NOT_KNOWN, "matcher_": matcher, "confidence_": confidence, "record_": record}
