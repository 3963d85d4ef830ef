"""The first 100 eigenfunctions of large meshes, against scipy's shift-invert Lanczos, in one run.

    python tests/benchmarks/bases.py

Meshes: a TOSCA cat of 27,894 vertices and the same cat subdivided once (111,500), if the data
folder is there; else creatures of 20,000 vertices and 80,000. Residuals are those of |L v - lambda
M v| in the norm of the inverse mass matrix, for unit functions, over max(lambda, 1); the largest of
all is printed. One thread.
"""

import time

import igl
import numpy as np
import scipy.sparse as sp
import trimesh
from problems import DATA
from scipy.sparse.linalg import eigsh
from timing import one_thread

from skfmap.datasets import make_creatures
from skfmap.functional import laplacian_eigenbasis
from skfmap.geometry.laplacian import cotangent_laplacian
from skfmap.io import as_meshes

N_COMPONENTS = 100
REPEATS = 3


def plain(stiffness, mass):
    """Return what `scipy.sparse.linalg.eigsh` finds, given but the shift and a start vector."""
    M = sp.diags_array(mass).tocsc()
    return eigsh(stiffness, N_COMPONENTS, M=M, sigma=-0.01, v0=np.ones(len(mass)))


def residual(stiffness, mass, evals, evecs):
    left = stiffness @ evecs - mass[:, None] * evecs * evals
    return (np.linalg.norm(left / np.sqrt(mass)[:, None], axis=0) / np.maximum(evals, 1)).max()


def meshes():
    """Yield name, vertices and faces at unit area."""
    files = sorted((DATA / "tosca_full").glob("cat0*"))
    (mesh,) = as_meshes(files[:1]) if files else make_creatures(1, 20000).meshes
    fine = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).subdivide()
    for vertices, faces in (
        (mesh.vertices, mesh.faces),
        (np.asarray(fine.vertices), np.asarray(fine.faces)),
    ):
        yield vertices / np.sqrt(igl.doublearea(vertices, faces).sum() / 2), faces


def main():
    routes = {
        "eigsh": plain,
        "ours": lambda stiffness, mass: laplacian_eigenbasis(stiffness, mass, N_COMPONENTS),
    }
    for vertices, faces in meshes():
        stiffness, mass = cotangent_laplacian(vertices, faces)
        mass = mass / mass.sum()
        seconds, results = {name: [] for name in routes}, {}
        with one_thread():
            for _ in range(REPEATS):
                for name, route in routes.items():
                    started = time.perf_counter()
                    results[name] = route(stiffness, mass)
                    seconds[name].append(time.perf_counter() - started)
        for name, (evals, evecs) in results.items():
            left = residual(stiffness, mass, evals, evecs)
            print(
                f"{len(mass):>8} vertices  {name:<6}{np.median(seconds[name]):>8.2f} s   residual "
                f"{left:.1e}"
            )
        ratio = np.median(seconds["eigsh"]) / np.median(seconds["ours"])
        apart = np.abs(results["ours"][0] - np.sort(results["eigsh"][0])).max()
        print(f"{'':>18}ratio {ratio:.2f}, eigenvalues {apart:.0e} apart", flush=True)


if __name__ == "__main__":
    main()
