"""The reference laid onto each shape: its mesh in the shape's form, and points from there."""

from skfmap.registration.deformation import Deformation
from skfmap.registration.part import Laid, Registration
from skfmap.registration.quality import Limits, Quality

__all__ = ["Deformation", "Laid", "Limits", "Quality", "Registration"]
