"""The learner, and the parts that it is composed of."""

from skfmap.learner.bridged import BridgedLearner
from skfmap.learner.confidence import Confidence, CrossFitConfidence, Trust
from skfmap.learner.estimator import WeightedFunctionalMapLearner
from skfmap.learner.matcher import Matcher
from skfmap.learner.models import (
    functional_maps,
    match,
    match_between,
    predict_landmarks,
    register,
)
from skfmap.learner.training_set import LearningOptions, TrainingSet

__all__ = [
    "BridgedLearner",
    "Confidence",
    "CrossFitConfidence",
    "LearningOptions",
    "Matcher",
    "TrainingSet",
    "Trust",
    "WeightedFunctionalMapLearner",
    "functional_maps",
    "match",
    "match_between",
    "predict_landmarks",
    "register",
]
