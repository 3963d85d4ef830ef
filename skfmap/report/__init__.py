"""A page that says at a glance whether a trained model can be trusted."""

from skfmap.report._evaluation import Evaluation, evaluate, thin_out
from skfmap.report._page import write_report

__all__ = ["Evaluation", "evaluate", "thin_out", "write_report"]
