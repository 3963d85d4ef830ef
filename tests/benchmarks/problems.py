"""Learning problems for the benchmarks: the cats, or the package's own creatures."""

import os
import tempfile
import warnings
from pathlib import Path

import joblib
import numpy as np

from skfmap import DescriptorTransformer, SpectralBasis
from skfmap.datasets import load_collection, make_creatures
from skfmap.ground_truth import ground_truth_maps

DATA = Path(os.environ.get("SKFMAP_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
# Probes of the paper's experiment, the default ones, and six times as many of the paper's.
FAMILIES = {50: "paper", 105: None, 310: "paper-310"}
MEMORY = joblib.Memory(Path(tempfile.gettempdir()) / "skfmap-benchmarks", verbose=0)


@MEMORY.cache
def learning_arrays(collection, n_training, k, m):
    """Return arguments of `learn_functional_maps` for ``n_training`` shapes and the reference.

    Kept in the folder for temporary files, because three hundred creatures take minutes to make.
    """
    if collection == "cats":
        given = load_collection(DATA / "tosca_isometric", "cat*", "cat0")
    else:
        given = make_creatures(n_training + 1, 1500)
    meshes, truths = given.meshes[: n_training + 1], given.correspondences[: n_training + 1]
    spectral = SpectralBasis(n_jobs=2, memory=MEMORY).transform(meshes)
    reference, *shapes = DescriptorTransformer(FAMILIES[m], n_jobs=2).transform(spectral)
    joins = [truth.join(truths[0]) for truth in truths[1:]]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        maps = ground_truth_maps(shapes, reference, joins, k)
    return {
        "probes_0": reference.probes[:k],
        "probes": np.stack([shape.probes[:k] for shape in shapes]),
        "evals_0": reference.spectral.evals[:k],
        "evals": np.stack([shape.spectral.evals[:k] for shape in shapes]),
        "maps": np.asarray(maps),
        "categories": list(reference.probe_categories),
    }
