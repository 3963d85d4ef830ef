"""Reports that show at a glance whether a trained model can be trusted."""

from skfmap.report._evaluation import Evaluation, evaluate, thin_out
from skfmap.report._landmark_errors import LandmarkEvaluation, evaluate_landmarks
from skfmap.report._landmarks_page import landmark_table, write_landmarks_page
from skfmap.report._page import write_report

__all__ = [
    "Evaluation",
    "LandmarkEvaluation",
    "evaluate",
    "evaluate_landmarks",
    "landmark_table",
    "thin_out",
    "write_landmarks_page",
    "write_report",
]
