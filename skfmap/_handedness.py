"""Shapes that are mirrored: their oriented probes say the opposite of everything else."""

import warnings
from collections.abc import Sequence

import numpy as np

from skfmap._inputs import place
from skfmap._matching import Matcher, penalised_error
from skfmap._skipped import Sorted
from skfmap._training import Training
from skfmap._typing import FloatArray
from skfmap.exceptions import OrientationWarning
from skfmap.shapes import ProbedShape

__all__ = ["warn_of_mirrored_shapes", "warn_of_mirrored_training_shapes"]

# Families whose names begin so change sign under a reflection.
_ODD = "oriented"
# Correlation of oriented probes with their images under the known map; that of sound TOSCA shapes is 0.3 to 0.9.
_AGAINST = -0.1
# Objective of equation (2) as a mirror image, as a share of that as it is.
_MUCH_BETTER = 0.7


def warn_of_mirrored_training_shapes(training: Training, places: Sequence[int]) -> None:
    """Warn of shapes whose known maps take oriented probes to their opposites; they stood at these places of X."""
    odd = _odd(training.reference)
    if not odd.any():
        return
    suspects = [
        place(i, shape)
        for i, shape, one in zip(places, training.shapes, training.known, strict=True)
        if _agreement(training.reference, shape, one.C, odd) < _AGAINST
    ]
    if suspects:
        warnings.warn(
            f"The correspondences of {', '.join(suspects)} take left for right: oriented probes run against those of "
            f"the reference {training.reference.name!r}. The meshes are mirrored or inside out, or the "
            "correspondences are the symmetric ones; mirror the mesh back (negate one coordinate and reverse the "
            "faces), or use DescriptorTransformer('paper').",
            OrientationWarning,
            stacklevel=5,
        )


def warn_of_mirrored_shapes(matcher: Matcher, given: Sorted) -> list[int]:
    """Warn of new shapes that fit much better once their oriented probes are negated; return which."""
    odd = _odd(matcher.reference)
    if not odd.any():
        return []
    mirrored = [i for i, shape in enumerate(given.shapes) if _is_mirrored(matcher, shape, odd)]
    suspects = [place(given.places[i], given.shapes[i]) for i in mirrored]
    if suspects:
        warnings.warn(
            f"As mirror images, these shapes fit the reference much better: {', '.join(suspects)}. Left may be taken "
            "for right there; check that the mesh is not mirrored or inside out (a scan with one axis negated, or "
            "faces wound inwards on an open surface).",
            OrientationWarning,
            stacklevel=4,
        )
    return mirrored


def _odd(shape: ProbedShape) -> FloatArray:
    return np.array([category.startswith(_ODD) for category in shape.probe_categories])


def _agreement(reference: ProbedShape, shape: ProbedShape, C: FloatArray, odd: FloatArray) -> float:
    """Return the correlation of the oriented probes of a shape with those that the map carries over."""
    k = len(C)
    own, carried = shape.probes[1:k, odd], (C @ reference.probes[:k])[1:, odd]
    own, carried = (values / np.maximum(np.linalg.norm(values, axis=0), 1e-300) for values in (own, carried))
    return float((own * carried).sum() / odd.sum())


def _is_mirrored(matcher: Matcher, shape: ProbedShape, odd: FloatArray) -> bool:
    mirrored = _with_probes(shape, np.where(odd, -shape.probes, shape.probes))
    as_is, as_image = (penalised_error(matcher, one) for one in (shape, mirrored))
    return as_image < _MUCH_BETTER * as_is


def _with_probes(shape: ProbedShape, probes: FloatArray) -> ProbedShape:
    return ProbedShape(shape.spectral, probes, shape.probe_names, shape.probe_categories, shape.recipe)
