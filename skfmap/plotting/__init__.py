"""Pictures of functions on meshes, of matches and of learned models.

Pictures are matplotlib figures, which need no display. Pages are interactive HTML pages, in which
shapes can be turned.
"""

from skfmap.plotting._basis_error import BasisErrorDisplay
from skfmap.plotting._camera import Camera
from skfmap.plotting._error_curve import ErrorCurveDisplay
from skfmap.plotting._page import (
    Page,
    functions_page,
    matches_page,
    write_functions_page,
    write_matches_page,
)
from skfmap.plotting._pictures import plot_function, plot_functions, plot_matches
from skfmap.plotting._reliability import ReliabilityDisplay
from skfmap.plotting._singular_values import SingularValuesDisplay
from skfmap.plotting._weights import WeightsDisplay

__all__ = [
    "BasisErrorDisplay",
    "Camera",
    "ErrorCurveDisplay",
    "Page",
    "ReliabilityDisplay",
    "SingularValuesDisplay",
    "WeightsDisplay",
    "functions_page",
    "matches_page",
    "plot_function",
    "plot_functions",
    "plot_matches",
    "write_functions_page",
    "write_matches_page",
]
