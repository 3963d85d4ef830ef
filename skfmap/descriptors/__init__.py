"""Probe functions: the nine families of the paper, an oriented family, and others.

The oriented family distinguishes left from right. There are also families for your own functions,
and for the coordinates of aligned shapes.
"""

from skfmap.descriptors.coordinates import Coordinates
from skfmap.descriptors.curvature import DiffusedCurvature, MeshSaliency
from skfmap.descriptors.defaults import default_families, paper_families
from skfmap.descriptors.family import ProbeFamily
from skfmap.descriptors.oriented import OrientedProducts
from skfmap.descriptors.own_functions import FunctionProbes
from skfmap.descriptors.signatures import HeatKernelSignature, WaveKernelSignature
from skfmap.descriptors.transformer import DescriptorTransformer

__all__ = [
    "Coordinates",
    "DescriptorTransformer",
    "DiffusedCurvature",
    "FunctionProbes",
    "HeatKernelSignature",
    "MeshSaliency",
    "OrientedProducts",
    "ProbeFamily",
    "WaveKernelSignature",
    "default_families",
    "paper_families",
]
