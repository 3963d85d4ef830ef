"""The folders that the pages speak of, so that every code block of theirs runs as it is written."""

import os
import shutil
import warnings

import numpy as np
import pytest
import trimesh
from filelock import FileLock
from matplotlib import pyplot as plt
from threadpoolctl import threadpool_limits

from skfmap import Mesh
from skfmap.datasets import make_creatures
from skfmap.io import write_mesh

# No pages: what builds them.
collect_ignore = [
    "conf.py",
    "figures.py",
    "formulas.py",
    "layers.py",
    "check_links.py",
    "_build",
    "generated",
]


@pytest.fixture(scope="session", autouse=True)
def _one_thread():
    """Keep threads from waiting for cores that others hold, which takes many times as long."""
    with threadpool_limits(limits=int(os.environ.get("SKFMAP_BLAS_THREADS", "1"))):
        yield


@pytest.fixture(scope="session")
def _folders(tmp_path_factory):
    """Return the folder of all pages, shared by the workers of pytest-xdist; the first fills it."""
    together = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        together = together.parent
    place = together / "pages"
    with FileLock(together / "pages.lock"):
        if not place.exists():
            unfinished = tmp_path_factory.mktemp("pages")
            _write_creatures(unfinished)
            unfinished.rename(place)
    return place


def _write_creatures(place):
    """Write six creatures: five in meshes/ with their correspondences, one in new/ without."""
    (place / "meshes").mkdir()
    (place / "new").mkdir()
    creatures = make_creatures(n_shapes=6, n_vertices=600, n_points=400)
    for mesh, truth in zip(creatures.meshes[:5], creatures.correspondences, strict=False):
        write_mesh(mesh, place / "meshes" / f"{mesh.name}.off")
        for suffix, pairs in ((".vts", truth.pairs), (".sym.vts", truth.symmetric_pairs)):
            vertices = pairs[np.argsort(pairs[:, 1]), 0] + 1
            np.savetxt(place / "meshes" / f"{mesh.name}{suffix}", vertices, fmt="%d")
    write_mesh(creatures.meshes[5], place / "new" / "scan.ply")
    finer = trimesh.remesh.subdivide(creatures.meshes[5].vertices, creatures.meshes[5].faces)
    write_mesh(Mesh(*finer), place / "new" / "scan-full.ply")


@pytest.fixture(autouse=True)
def _in_a_folder_of_meshes(_folders, tmp_path, monkeypatch):
    place = tmp_path / "work"
    shutil.copytree(_folders, place)
    monkeypatch.chdir(place)
    with warnings.catch_warnings():
        yield
    plt.close("all")
