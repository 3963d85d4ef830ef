"""The mirror image of a shape, and the two witnesses of one among training shapes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skfmap import DescriptorTransformer, Mesh, SpectralBasis
from skfmap.datasets import make_creatures
from skfmap.functional.similarity import left_by_similarities
from skfmap.geometry.normals import vertex_normals
from skfmap.learner.mirrored import is_against, is_mirror_image, mirror_image, odd_probes
from skfmap.learner.training_set import TrainingSet


@pytest.fixture(scope="module")
def thinned():
    """Return a creature on a working mesh that is coarser than the given one."""
    (mesh,) = make_creatures(n_shapes=1, n_vertices=1200).meshes
    spectral = SpectralBasis(20, max_vertices=400).transform([mesh])
    return DescriptorTransformer().transform(spectral)[0]


@pytest.mark.parametrize("kind", ["given", "thinned"])
def test_the_image_is_what_the_steps_before_make_of_the_mirrored_working_mesh(
    kind, probed, thinned
):
    shape = probed[1] if kind == "given" else thinned
    image = mirror_image(shape)
    np.testing.assert_array_equal(
        image.spectral.mesh.vertices, shape.spectral.mesh.vertices * [-1, 1, 1]
    )
    (again,) = DescriptorTransformer().transform([image.spectral])
    scale = np.abs(again.probes).max(axis=0)
    np.testing.assert_allclose(image.probes / scale, again.probes / scale, atol=1e-7)
    assert (image.probes[:, odd_probes(shape)] == -shape.probes[:, odd_probes(shape)]).all()
    normals, of_image = (
        vertex_normals(one.spectral.mesh.vertices, one.spectral.mesh.faces)
        for one in (shape, image)
    )
    np.testing.assert_allclose(of_image, normals * [-1, 1, 1], atol=1e-12)


@pytest.mark.parametrize("kind", ["given", "thinned"])
def test_answers_of_the_image_are_on_the_given_mesh(kind, probed, thinned):
    shape = probed[1] if kind == "given" else thinned
    spectral, image = shape.spectral, mirror_image(shape).spectral
    assert (spectral.n_given > spectral.mesh.n_vertices) == (kind == "thinned")
    difference = image.prolongation_matrix - spectral.prolongation_matrix
    assert abs(difference).max() < 1e-6, "coordinates are in single precision"
    assert image.given_hash == spectral.given_hash
    assert image.given.name == shape.name


def test_the_image_of_the_image_is_the_shape(thinned):
    again = mirror_image(mirror_image(thinned))
    assert not again.reflected
    assert mirror_image(thinned).reflected
    assert again.spectral.mesh.content_hash == thinned.spectral.mesh.content_hash
    np.testing.assert_array_equal(again.probes, thinned.probes)
    for name in ("face", "coordinates"):
        np.testing.assert_array_equal(
            getattr(again.spectral.prolongation, name), getattr(thinned.spectral.prolongation, name)
        )


@pytest.mark.parametrize("sign", [1, -1])
def test_a_similarity_leaves_nothing_of_its_own_images(sign):
    rng = np.random.default_rng(0)
    points = rng.normal(size=(20, 3))
    images = 3 * sign * points @ Rotation.random(random_state=1).as_matrix() + [1, 2, 3]
    left = left_by_similarities(points, images, rng.uniform(0.1, 1, size=20))
    assert left[0 if sign > 0 else 1] < 1e-12
    assert left[1 if sign > 0 else 0] > 0.1


def test_what_similarities_leave_in_closed_form():
    axes = np.array([3.0, 2, 1])
    points = np.concatenate([np.diag(axes), -np.diag(axes)])
    rotated, reflected = left_by_similarities(points, points * [1, 1, -1], np.ones(6))
    assert reflected == pytest.approx(0, abs=1e-12)
    assert rotated == pytest.approx(1 - ((9 + 4 - 1) / (9 + 4 + 1)) ** 2)
    flat = points * [1, 1, 0]
    assert np.ptp(left_by_similarities(flat, points, np.ones(6))) < 1e-12, "flat has no side"
    assert left_by_similarities(0 * points, points, np.ones(6)) == (1.0, 1.0)


def _witnesses(reference, shape, truths):
    training = TrainingSet.from_samples([reference, shape], truths, n_functions=12)
    return [
        told(training.shapes[0], training.reference, training.joins[0], training.known[0])
        for told in (is_mirror_image, is_against)
    ]


def test_witnesses_that_contradict_each_other_are_told_and_nothing_is_reflected(probed, collection):
    truths = [collection.truths[0]] * 2
    odd = odd_probes(probed[0])
    image = mirror_image(probed[0])
    inside_out = replace(probed[0], probes=image.probes)
    outside_in = replace(image, probes=probed[0].probes)
    told = {
        name: _witnesses(probed[0], shape, truths)
        for name, shape in [
            ("itself", probed[0]),
            ("image", image),
            ("inside out", inside_out),
            ("outside in", outside_in),
        ]
    }
    assert told == {
        "itself": [False, False],
        "image": [True, True],
        "inside out": [False, True],
        "outside in": [False, True],
    }
    even = replace(probed[0], probes=np.where(odd, 0.0, probed[0].probes))
    silent = mirror_image(even)
    assert _witnesses(even, silent, truths) == [True, True], "space alone"


def test_where_a_similarity_explains_nothing_oriented_probes_decide(probed, collection):
    truths = [collection.truths[0]] * 2
    spectral = probed[0].spectral
    bent = spectral.mesh.vertices @ np.diag([1, 1, 9])
    bent[:, 0] += np.square(bent[:, 2])
    elsewhere = replace(spectral, mesh=Mesh(bent, spectral.mesh.faces, "bent"))
    shape = replace(probed[0], spectral=elsewhere)
    assert _witnesses(probed[0], shape, truths) == [False, False]
    assert _witnesses(probed[0], mirror_image(shape), truths) == [True, True]
