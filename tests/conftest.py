"""A small collection of bumpy bodies with known correspondences, in closed form."""

import os
from types import SimpleNamespace

import hypothesis
import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree
from scipy.spatial.transform import Rotation
from sklearn.pipeline import Pipeline
from threadpoolctl import threadpool_limits

from skfmap import (
    Correspondence,
    DescriptorTransformer,
    Mesh,
    SpectralBasis,
    WeightedFunctionalMapLearner,
)

# The same random cases in every run, on every machine; others each time in a longer campaign.
hypothesis.settings.register_profile(
    "skfmap", derandomize=os.environ.get("SKFMAP_EXAMPLES", "1") == "1", deadline=None
)
hypothesis.settings.load_profile("skfmap")

_CENTRES = np.array(
    [[1, 0.2, 0.1], [-1, 0.5, 0.2], [0.1, 1, -0.3], [0.3, -0.6, 1], [-0.4, -0.6, -0.8]]
)
_HEIGHTS = np.array([1.2, 0.8, 0.6, 1.0, 0.5])
_SHARPNESS = np.array([8.0, 10.0, 14.0, 10.0, 12.0])
_MIRROR = np.array([1.0, -1.0, 1.0])


def _directions(n_vertices, seed):
    """Return points of a Fibonacci sphere, rotated, and the outward faces of their hull."""
    steps = np.arange(n_vertices) + 0.5
    z, angle = 1 - 2 * steps / n_vertices, steps * np.pi * (1 + 5**0.5)
    ring = np.sqrt(1 - z**2)
    points = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
    points = points @ Rotation.random(random_state=seed).as_matrix().T
    faces = ConvexHull(points).simplices.astype(np.int64)
    a, b, c = (points[faces[:, j]] for j in range(3))
    inward = (np.cross(b - a, c - a) * a).sum(axis=1) < 0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return points, faces


def _body(directions, bend, symmetric):
    """Return points of a star-shaped body in the given directions, twisted about its long axis."""
    centres = np.concatenate([_CENTRES[:4], _CENTRES[:4] * _MIRROR]) if symmetric else _CENTRES
    heights = np.tile(_HEIGHTS[:4], 2) if symmetric else _HEIGHTS
    sharpness = np.tile(_SHARPNESS[:4], 2) if symmetric else _SHARPNESS
    centres = centres / np.linalg.norm(centres, axis=1, keepdims=True)
    radius = 1 + (heights * np.exp(sharpness * (directions @ centres.T - 1))).sum(axis=1)
    x, y, z = (directions * radius[:, None] * [1.2, 1.0, 0.8]).T
    if symmetric:  # bend up and down, which keeps the mirror plane y = 0
        return np.column_stack([x, y, z + bend * x**2])
    angle = bend * x
    return np.column_stack(
        [x, y * np.cos(angle) - z * np.sin(angle), y * np.sin(angle) + z * np.cos(angle)]
    )


def _collection(poses, symmetric):
    template = _directions(300, 99)[0]
    meshes, truths = [], []
    for i, (n_vertices, bend) in enumerate(poses):
        directions, faces = _directions(n_vertices, i)
        tree = cKDTree(directions)
        mirrored = tree.query(template * _MIRROR)[1] if symmetric else None
        meshes.append(Mesh(_body(directions, bend, symmetric), faces, name=f"body{i}"))
        truths.append(Correspondence.from_template(tree.query(template)[1], mirrored))
    return SimpleNamespace(meshes=meshes, truths=truths, names=[mesh.name for mesh in meshes])


def _probed(meshes, families=None):
    return DescriptorTransformer(families).transform(SpectralBasis(30).transform(meshes))


@pytest.fixture(scope="session", autouse=True)
def _one_thread():
    """Keep OpenMP from waiting for cores that others hold: fifty times as slow on small shapes."""
    with (
        threadpool_limits(limits=int(os.environ.get("SKFMAP_BLAS_THREADS", "1"))),
        pytest.MonkeyPatch.context() as patch,
    ):
        # Of the processes that tests start.
        for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            patch.setenv(variable, "1")
        yield


@pytest.fixture(scope="session")
def collection():
    """Six bodies of unequal connectivity, twisted by unequal amounts, without symmetry."""
    return _collection(
        [(500, 0.0), (420, 0.1), (560, -0.1), (460, 0.15), (620, -0.15), (380, 0.05)],
        symmetric=False,
    )


@pytest.fixture(scope="session")
def symmetric_collection():
    """Four bodies with a mirror plane, their symmetric answers included."""
    return _collection([(500, 0.0), (420, 0.05), (560, -0.05), (460, 0.1)], symmetric=True)


@pytest.fixture(scope="session")
def make_bodies():
    """Return the function from (n_vertices, bend) of each body to a collection."""
    return _collection


@pytest.fixture(scope="session")
def points_on_bodies():
    """Return the function from a bend to 40 corresponding points of that body, between vertices."""
    directions = _directions(40, 98)[0]
    return lambda bend: _body(directions, bend, symmetric=False)


@pytest.fixture(scope="session")
def probed(collection):
    """Return the probed shapes of the collection, in its order."""
    return _probed(collection.meshes)


@pytest.fixture(scope="session")
def symmetric_probed(symmetric_collection):
    """Return the probed shapes of the symmetric collection."""
    return _probed(symmetric_collection.meshes)


@pytest.fixture(scope="session")
def probe():
    """Return the function from meshes (and families) to probed shapes, as the fixtures use it."""
    return _probed


@pytest.fixture(scope="session")
def make_learner(tmp_path_factory):
    """Return a function that makes a learner that is fitted in a tenth of a second.

    What does not depend on weights, as distances on the reference, is computed once in a session
    (memory=None: anew). Matches are not refined but where it is asked for.
    """
    given = {
        "n_functions": 12,
        "tol": 1e-3,
        "refine": None,
        "memory": str(tmp_path_factory.mktemp("learners")),
    }
    return lambda **parameters: WeightedFunctionalMapLearner(**{**given, **parameters})


@pytest.fixture(scope="session")
def make_model(make_learner):
    """Return a function that makes an unfitted pipeline of small size."""

    def make(memory=None, **parameters):
        return Pipeline(
            [
                ("basis", SpectralBasis(30, memory=memory)),
                ("probes", DescriptorTransformer(memory=memory)),
                ("learner", make_learner(**({"memory": memory} if memory else {}), **parameters)),
            ]
        )

    return make


@pytest.fixture(scope="session")
def model(collection, make_model):
    """Return a pipeline fitted on all bodies but the last; do not fit it again or change it."""
    return (
        make_model()
        .set_params(learner__memory=None)
        .fit(collection.meshes[:5], collection.truths[:5])
    )


@pytest.fixture(scope="session")
def fitted(make_learner, probed, collection):
    """Return a learner fitted on all bodies but the last; do not fit it again or change it."""
    return make_learner(memory=None).fit(probed[:5], collection.truths[:5])


@pytest.fixture(scope="session")
def tetrahedron():
    """Return vertices and outward faces."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    return vertices, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
