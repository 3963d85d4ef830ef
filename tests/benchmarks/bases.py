"""The first 128 eigenfunctions, against scipy's shift-invert Lanczos, in one run.

    python tests/benchmarks/bases.py

Meshes: creatures of 1,500 and 8,000 vertices; TOSCA cats of 5,000 and 27,894 and the latter
subdivided once (111,500), if the data folder is there, else creatures of 5,000, 20,000 and 80,000.
"Below" is ours with the inverse taken below the first eigenvalue wanted rather than in the middle
of them. Residuals are those of |L v - lambda M v| in the norm of the inverse mass matrix, for unit
functions, over max(lambda, 1); the largest of all is printed. One thread, processor time.
"""

import time
from unittest import mock

import igl
import numpy as np
import scipy.sparse as sp
import trimesh
from problems import DATA
from scipy.sparse.linalg import eigsh
from timing import one_thread

from skfmap.datasets import make_creatures
from skfmap.functional import eigenbasis
from skfmap.geometry.laplacian import cotangent_laplacian
from skfmap.io import as_meshes

N_COMPONENTS = 128
REPEATS = 5


def plain(stiffness, mass):
    """Return what `scipy.sparse.linalg.eigsh` finds, given but the shift and a start vector."""
    M = sp.diags_array(mass).tocsc()
    evals, evecs = eigsh(stiffness, N_COMPONENTS, M=M, sigma=-0.01, v0=np.ones(len(mass)))
    return np.maximum(evals, 0), evecs


def ours(stiffness, mass):
    return eigenbasis.laplacian_eigenbasis(stiffness, mass, N_COMPONENTS)


def below(stiffness, mass):
    with mock.patch.object(eigenbasis, "_SHARE", 1e-5):
        return ours(stiffness, mass)


def residual(stiffness, mass, evals, evecs):
    left = stiffness @ evecs - mass[:, None] * evecs * evals
    return (np.linalg.norm(left / np.sqrt(mass)[:, None], axis=0) / np.maximum(evals, 1)).max()


def cat_or_creature(folder, n_vertices):
    files = sorted((DATA / folder).glob("cat0.off"))
    return as_meshes(files)[0] if files else make_creatures(1, n_vertices).meshes[0]


def meshes():
    """Yield vertices and faces at unit area."""
    large = cat_or_creature("tosca_full", 20000)
    fine = trimesh.Trimesh(large.vertices, large.faces, process=False).subdivide()
    given = [make_creatures(1, n).meshes[0] for n in (1500, 8000)]
    given = [given[0], cat_or_creature("tosca_isometric", 5000), given[1], large, fine]
    for mesh in given:
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        yield vertices / np.sqrt(igl.doublearea(vertices, faces).sum() / 2), faces


def main():
    routes = {"eigsh": plain, "below": below, "ours": ours}
    for vertices, faces in meshes():
        stiffness, mass = cotangent_laplacian(vertices, faces)
        mass = mass / mass.sum()
        seconds, results = {name: [] for name in routes}, {}
        with one_thread():
            for _ in range(REPEATS):
                for name, route in routes.items():
                    started = time.process_time()
                    results[name] = route(stiffness, mass)
                    seconds[name].append(time.process_time() - started)
        for name, (evals, evecs) in results.items():
            left = residual(stiffness, mass, evals, evecs)
            ratio = np.median(seconds[name]) / np.median(seconds["ours"])
            print(
                f"{len(mass):>8} vertices  {name:<6}{np.median(seconds[name]):>8.3f} s   residual "
                f"{left:.1e}   ratio {ratio:.2f}"
            )
        apart = np.abs(results["ours"][0] - np.sort(results["eigsh"][0])).max()
        print(f"{'':>18}eigenvalues {apart:.0e} apart", flush=True)


if __name__ == "__main__":
    main()
