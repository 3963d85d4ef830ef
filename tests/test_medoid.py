"""The most average shape: of three of which one lies between the others, that one."""

import numpy as np
import pytest

from skfmap import Correspondence, Mesh
from skfmap.datasets import make_sphere
from skfmap.descriptors import HeatKernelSignature
from skfmap.exceptions import CorrespondenceError
from skfmap.learner.medoid import medoid_index


@pytest.fixture(scope="module")
def stretched(probe):
    """Return a function from stretches along x to ellipsoids, all of which share their vertices."""
    ball = make_sphere(n_subdivisions=3)

    def shapes(*stretches):
        meshes = [Mesh(ball.vertices * [s, 1, 1], ball.faces, name=f"by {s}") for s in stretches]
        return probe(meshes, [("hks", HeatKernelSignature())])

    return shapes


def _same(shapes):
    return [
        Correspondence.from_vertices(np.arange(shape.spectral.mesh.n_vertices)) for shape in shapes
    ]


@pytest.mark.parametrize(
    ("stretches", "medoid"), [((1.6, 1.3, 1), 1), ((1.3, 1.6, 1), 0), ((1, 1.6, 1.3), 2)]
)
def test_the_shape_between_the_others_is_the_medoid(stretched, stretches, medoid):
    shapes = stretched(*stretches)
    assert medoid_index(shapes, _same(shapes), None) == medoid
    assert medoid_index(shapes, _same(shapes), 2) == medoid


def test_one_stray_among_equals_is_not_the_medoid(stretched):
    shapes = stretched(2, 1, 1)
    assert medoid_index(shapes, _same(shapes), None) == 1, "the first of the two that are equal"


def test_units_and_numbering_choose_nothing(stretched, probe):
    """The shape between the others, renumbered and in millimetres."""
    shapes = stretched(1.6, 1.3, 1)
    order = np.random.default_rng(0).permutation(shapes[1].spectral.mesh.n_vertices)
    mesh = shapes[1].spectral.mesh
    other = Mesh(1000 * mesh.vertices[np.argsort(order)], order[mesh.faces])
    moved = probe([other], [("hks", HeatKernelSignature())])
    truths = _same(shapes)
    truths[1] = Correspondence.from_template(order)
    assert medoid_index([shapes[0], *moved, shapes[2]], truths, None) == 1


def test_only_template_points_that_all_have_are_compared(stretched):
    shapes = stretched(1.6, 1.3, 1)
    few = [
        truth.restrict(np.arange(100 * i, 100 * i + 150))
        for i, truth in enumerate(_same(shapes[:2]))
    ]
    assert medoid_index(shapes, [*few, *_same(shapes[2:])], None) == 1, "50 points are left"
    few[1] = few[1].restrict(np.arange(149, 300))
    with pytest.raises(CorrespondenceError, match="template points that all shapes have"):
        medoid_index(shapes, [*few, *_same(shapes[2:])], None)
