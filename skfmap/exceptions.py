"""Errors and warnings of skfmap; each message names the shape, the fault and the remedy."""

__all__ = [
    "CacheWarning",
    "CorrespondenceError",
    "CoverageWarning",
    "DisagreementWarning",
    "MeshError",
    "OrientationWarning",
    "OutdatedModelError",
    "RepairWarning",
    "SkippedShapeWarning",
    "StabilityWarning",
    "UnfamiliarShapeWarning",
    "VersionWarning",
]


class CacheWarning(UserWarning):
    """Results cannot be kept in ``memory``; they are computed again each time."""


class MeshError(ValueError):
    """A mesh cannot be used as it is; the message says which one, why, and what to do."""


class CorrespondenceError(ValueError):
    """Correspondences do not fit their shape, or two shapes share no template point."""


class CoverageWarning(UserWarning):
    """Correspondences determine a known functional map only in part."""


class DisagreementWarning(UserWarning):
    """Correspondences of training shapes contradict each other."""


class VersionWarning(UserWarning):
    """A model was saved by another version of skfmap."""


class OutdatedModelError(ValueError):
    """A saved model is of a kind that is no longer supported; the message says how to refit it."""


class OrientationWarning(UserWarning):
    """It cannot be determined which side of a mesh is its outside."""


class RepairWarning(UserWarning):
    """Meshes were mended before they were used."""


class SkippedShapeWarning(UserWarning):
    """Shapes were left out because they cannot be used; they keep their indices."""


class StabilityWarning(UserWarning):
    """Learned maps carry hardly any function well, or weights are at their bounds."""


class UnfamiliarShapeWarning(UserWarning):
    """A shape is unlike the training shapes, so its errors may exceed the expected ones."""
