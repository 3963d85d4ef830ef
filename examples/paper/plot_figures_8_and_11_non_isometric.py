"""
Figures 8 and 11: another body, another mesh, sparse landmarks
==============================================================

Nothing in the learning assumes that shapes are isometric. The paper maps a man, and a gorilla, to
women: other proportions, other connectivity, and a thousand landmarks picked by hand instead of a
correspondence of every vertex.
"""

# %%
# Here a cat is mapped to horses, with 450 landmarks to learn from and 450 others to score: 310
# probes, most of which say little across two species.
import os
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from skfmap import DescriptorTransformer, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import load_collection, make_creatures
from skfmap.plotting import Camera, plot_functions

STRATEGIES = {"naive": None, "learned": "function"}


# %%
# The two most stable functions (after the constant one) on the reference, and carried to the last
# shape, which was not trained on, by the naive map and by the learned one; and where the *known*
# map puts those of the learned weights.
def figure(collection, n_training, camera=None, families="paper-310"):
    """Draw the stable functions of both maps on the reference, and carried to the last shape."""
    shapes = DescriptorTransformer(families).transform(
        SpectralBasis(60).transform(collection.meshes)
    )
    points = np.random.default_rng(0).permutation(
        np.unique(collection.correspondences[0].pairs[:, 1])
    )
    given, held_out = points[::2], points[1::2]
    truths = [truth.restrict(given) for truth in collection.correspondences]
    (scored_0, scored) = (collection.correspondences[i].restrict(held_out) for i in (0, -1))
    reference, unseen = (shape.spectral for shape in (shapes[0], shapes[-1]))
    meshes, functions, captions = [], [], []
    for name, weighting in STRATEGIES.items():
        learner = WeightedFunctionalMapLearner(weighting=weighting, refine=None)
        learner.fit(shapes[: n_training + 1], truths[: n_training + 1])
        Y = learner.stable_basis_[:, 1:3]
        (X,), (C,) = (
            learner.functional_maps(shapes[-1:]),
            learner.ground_truth_maps(shapes[-1:], truths[-1:]),
        )
        errors = np.linalg.norm((X - C) @ Y, axis=0)
        meshes += [reference.mesh, unseen.mesh, unseen.mesh]
        functions += [
            reference.evecs[:, :50] @ Y,
            unseen.evecs[:, :50] @ X @ Y,
            unseen.evecs[:, :50] @ C @ Y,
        ]
        captions += [
            f"{name}: reference",
            f"by X(D), error {errors[0]:.2f}, {errors[1]:.2f}",
            "by the known map",
        ]
        (pairs,) = learner.pair_errors(
            shapes[-1:], [scored], reference_y=scored_0, matching="cut", n_stable=25
        )
        kinds = ("direct", "per_vertex") if pairs.symmetric is not None else ("direct",)
        print(
            f"{name:>8}: error (5) {errors.round(2)}, reduced map, mean geodesic error",
            ", ".join(f"{kind} {pairs.mean(kind):.3f}" for kind in kinds),
        )
    plot_functions(
        meshes,
        functions,
        captions=captions,
        labels=["first", "second"],
        limits=(-4, 4),
        camera=camera,
    )
    plt.show()


bodies = ["cat"] + 11 * ["horse"]
horses = make_creatures(n_shapes=12, n_vertices=1000, body=bodies, n_points=900)
figure(horses, n_training=10)

# %%
# The same with the paper's 50 probes.
figure(horses, n_training=10, families="paper")

# %%
# What the paper saw, and what we see
# -----------------------------------
#
# The paper: the most stable functions of the naive maps are transferred badly, those of the learned
# weights correctly; they single out the head, the hands and the feet. We see such functions, for
# the cat and the horses as for the man and the women of TOSCA (hands first, then feet against
# hands). From the man to the woman that was left out, learned with ten others and 310 probes from
# 450 landmarks, their errors (5) are 0.06 and 0.06; those of the naive map 0.07 and 0.08. So here,
# too, our naive map is better than the paper's at its best functions, for the reasons given at
# figure 3.
#
# In points, in the 25 most stable functions, symmetric answers correct, learning helps from man to
# woman: 0.052 to 0.045, and with 50 probes 0.048 to 0.042. From the cat to a horse it does not:
# 0.093 to 0.115, and with 50 probes 0.120 to 0.155, although the functions shown are carried
# better. We have not found out why.
#
# The gorilla of figure 11 is not among our shapes. Direct errors, about 0.28, are those of
# symmetric probes, which cannot tell left from right; the default probes can (:doc:`/benchmarks`:
# 0.036).

folder = os.environ.get("SKFMAP_DATA")
if folder:
    people = load_collection(Path(folder) / "tosca_nonisometric", "*", reference="8_man_01")
    camera = Camera(azimuth=20, elevation=10)
    figure(people, n_training=10, camera=camera)

# %%
# From the man to a woman with the paper's 50 probes.
if folder:
    figure(people, n_training=10, camera=camera, families="paper")
