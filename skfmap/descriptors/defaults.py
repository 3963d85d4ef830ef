"""The families of the paper, and the default families."""

from skfmap.descriptors.curvature import DiffusedCurvature, MeshSaliency
from skfmap.descriptors.family import ProbeFamily
from skfmap.descriptors.oriented import OrientedProducts
from skfmap.descriptors.signatures import HeatKernelSignature, WaveKernelSignature

__all__ = ["SHORTHANDS", "default_families", "paper_families"]


def paper_families(n_functions: int = 5) -> list[tuple[str, ProbeFamily]]:
    """Return the nine families of section 5.1.

    Each has ``n_functions`` functions; saliency has twice as many. With 5 these are the 50 probes
    of section 5.2, with 31 the 310 probes of section 5.3.
    """
    return [
        ("hks", HeatKernelSignature(n_functions)),
        ("wks_narrow", WaveKernelSignature(n_functions, sigma=0.1)),
        ("wks_medium", WaveKernelSignature(n_functions, sigma=0.3)),
        ("wks_wide", WaveKernelSignature(n_functions, sigma=0.6)),
        ("gaussian_curvature", DiffusedCurvature("gaussian", n_functions=n_functions)),
        ("mean_curvature", DiffusedCurvature("mean", n_functions=n_functions)),
        (
            "log_gaussian_curvature",
            DiffusedCurvature("gaussian", logarithm=True, n_functions=n_functions),
        ),
        ("log_mean_curvature", DiffusedCurvature("mean", logarithm=True, n_functions=n_functions)),
        ("saliency", MeshSaliency(2 * n_functions)),
    ]


def default_families() -> list[tuple[str, ProbeFamily]]:
    """Return the nine families of the paper and the oriented one."""
    return [*paper_families(), ("oriented", OrientedProducts())]


SHORTHANDS = {"paper": lambda: paper_families(5), "paper-310": lambda: paper_families(31)}
