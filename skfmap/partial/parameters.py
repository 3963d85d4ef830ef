"""The pipeline that `PartialMatcher` is given."""

from typing import Any

from sklearn.pipeline import Pipeline

from skfmap.basis import SpectralBasis
from skfmap.learner import BridgedLearner, WeightedFunctionalMapLearner

__all__ = ["check_estimator", "learner_of"]


def check_estimator(estimator: object) -> None:
    """Raise TypeError unless an estimator is a pipeline from meshes to a learner."""
    if not isinstance(estimator, Pipeline) or len(estimator) < 2:
        raise TypeError(
            "estimator must be a Pipeline from meshes to a learner, make_pipeline("
            "SpectralBasis(), DescriptorTransformer(), WeightedFunctionalMapLearner()); got "
            f"{type(estimator).__name__}."
        )
    if not isinstance(estimator[-1], (WeightedFunctionalMapLearner, BridgedLearner)):
        raise TypeError(
            "the last step of estimator must be a WeightedFunctionalMapLearner or a "
            f"BridgedLearner; got {type(estimator[-1]).__name__}."
        )
    if not isinstance(estimator[0], SpectralBasis):
        raise TypeError(
            "the first step of estimator must be a SpectralBasis, which limits the number of "
            f"vertices of scans; got {type(estimator[0]).__name__}."
        )


def learner_of(pipeline: Pipeline) -> Any:
    """Return the learner at the end of a pipeline, or the one inside a `BridgedLearner`."""
    last = pipeline[-1]
    return last.estimator_ if isinstance(last, BridgedLearner) else last
