"""What a new shape of 5,000 vertices costs, and its functional map against pyFM's, in one run.

    python tests/benchmarks/new_shape.py

Needs the cats. pyFM (``pip install pyfmaps``; it is in the dependency group "benchmarks") gets the
same probes on the same pair and the same regulariser, without its commutativity terms, which we do
not have. One thread.
"""

import time
import warnings

import numpy as np
from problems import DATA
from timing import median_seconds, one_thread

from skfmap import DescriptorTransformer, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import load_collection
from skfmap.functional import penalty_of, scale_by, solve_functional_map

K = 50
ALPHA = 0.01


def steps(learner, mesh):
    """Print the time of each step for a new shape."""
    basis, probes = SpectralBasis(), DescriptorTransformer()
    (spectral,) = basis.transform([mesh])
    shapes = probes.transform([spectral])
    routes = {
        "basis (128 functions computed)": lambda: basis.transform([mesh]),
        "probes": lambda: probes.transform([spectral]),
        "predict": lambda: learner.predict(shapes),
        "match, with expected errors": lambda: learner.match(shapes),
        "all, from the mesh": lambda: learner.match(probes.transform(basis.transform([mesh]))),
        "unrefined match": lambda: learner.match(shapes, refine=None),
    }
    for name, seconds in median_seconds(routes, 5).items():
        print(f"{name:<34}{seconds:>8.3f} s")


def against_pyfm(reference, shape):
    """Print the time of a functional map, ours and pyFM's, and how well each fits the objective."""
    try:
        from pyFM.functional import FunctionalMapping  # noqa: PLC0415
        from pyFM.mesh import TriMesh  # noqa: PLC0415
    except ImportError:
        print("pyFM is not installed: pip install pyfmaps")
        return
    g_0, g_i = (scale_by(one.probes[:K], one.probes[:K], "shape") for one in (reference, shape))
    evals_0, evals_i = (one.spectral.evals[:K] for one in (reference, shape))
    penalty, ones = penalty_of(evals_i, evals_0, ALPHA, "laplacian"), np.ones(g_0.shape[1])
    sides = []
    for one in (reference, shape):
        mesh = TriMesh(one.spectral.vertices, one.spectral.mesh.faces)
        mesh.process(k=K, verbose=False)
        sides.append(mesh)
    model = FunctionalMapping(*sides)
    # The same probes as functions on the vertices, in the very eigenfunctions that pyFM uses.
    model.add_descriptors(
        *(mesh.eigenvectors[:, :K] @ g for mesh, g in zip(sides, (g_0, g_i), strict=True)), False
    )
    # pyFM divides its mask of squared differences by their sum.
    whole = np.square(sides[0].eigenvalues[None, :K] - sides[1].eigenvalues[:K, None]).sum()
    weights = {
        "w_descr": 1.0,
        "w_lap": ALPHA * whole / evals_0[-1] ** 2,
        "w_dcomm": 0,
        "w_orient": 0,
    }
    options = {"use_resolvent_laplacian": False, "normalize_weights": False}

    def theirs(**tighter):
        model.fit(K=(K, K), **weights, **options, **tighter)
        return model.FM_12

    routes = {
        "ours": lambda: solve_functional_map(g_0, g_i, penalty, ones),
        "pyFM": theirs,
        "pyFM, converged": lambda: theirs(factr=10.0, pgtol=1e-12),
    }

    def objective(C):
        return np.square(C @ g_0 - g_i).sum() + (penalty * C**2).sum()

    seconds = median_seconds(routes, 3)
    for name, route in routes.items():
        ratio = seconds[name] / seconds["ours"]
        print(
            f"{name:<34}{1e3 * seconds[name]:>8.1f} ms {ratio:>8.1f} times   objective "
            f"{objective(route()):.4f}"
        )


def main():
    collection = load_collection(DATA / "tosca_isometric", "cat*", "cat0")
    shapes = DescriptorTransformer(n_jobs=2).transform(
        SpectralBasis(n_jobs=2).transform(collection.meshes)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        started = time.perf_counter()
        learner = WeightedFunctionalMapLearner(n_jobs=2).fit(
            shapes[:-1], collection.correspondences[:-1]
        )
        print(f"{'fit on nine shapes, two cores':<34}{time.perf_counter() - started:>8.3f} s")
        learner.set_params(n_jobs=None)
        with one_thread():
            steps(learner, collection.meshes[-1])
            against_pyfm(shapes[0], shapes[-1])


if __name__ == "__main__":
    main()
