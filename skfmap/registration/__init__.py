"""Registration of the reference mesh to each shape, and matches obtained from it."""

from skfmap.registration.deformation import Deformation
from skfmap.registration.part import Laid, Registration
from skfmap.registration.quality import Limits, Quality

__all__ = ["Deformation", "Laid", "Limits", "Quality", "Registration"]
