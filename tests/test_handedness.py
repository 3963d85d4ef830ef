"""Mirrored shapes are found out, in training and after it."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from skfmap import DescriptorTransformer, Mesh, SpectralBasis
from skfmap.exceptions import OrientationWarning


@pytest.fixture(scope="module")
def mirrored(collection):
    """Return the last two bodies as a scan with one axis negated has them."""
    meshes = [
        Mesh(m.vertices * [1, -1, 1], m.faces[:, ::-1], name="mirrored " + m.name)
        for m in collection.meshes[4:]
    ]
    return DescriptorTransformer().transform(SpectralBasis(30).transform(meshes))


def test_a_new_mirrored_shape_is_found_out(fitted, mirrored, probed):
    with pytest.warns(
        OrientationWarning,
        match=r"better: X\[0\] \('mirrored body4'\), X\[2\] \('mirrored body5'\)\.",
    ):
        fitted.match([mirrored[0], probed[5], mirrored[1]])


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_a_mirrored_training_shape_is_found_out(make_learner, mirrored, probed, collection):
    with pytest.warns(
        OrientationWarning,
        match=r"The correspondences of X\[\d\] \('mirrored body4'\) take left for right",
    ):
        make_learner(max_iter=5).fit([*probed[:4], mirrored[0]], collection.truths[:5])


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.DisagreementWarning")
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_symmetric_answers_given_for_true_ones_are_found_out(
    make_learner, symmetric_probed, symmetric_collection
):
    truths = list(symmetric_collection.truths)
    truths[2] = replace(truths[2], pairs=truths[2].symmetric_pairs, symmetric_pairs=None)
    with pytest.warns(OrientationWarning, match=r"X\[2\] \('body2'\) take left for right"):
        make_learner(max_iter=5).fit(symmetric_probed, truths)


def test_sound_shapes_and_paper_probes_raise_no_alarm(
    make_learner, fitted, probed, mirrored, collection
):
    with warnings.catch_warnings():
        warnings.simplefilter("error", OrientationWarning)
        fitted.match(probed)
        paper = DescriptorTransformer("paper").transform(
            [shape.spectral for shape in [*probed[:3], mirrored[0]]]
        )
        make_learner(max_iter=5, tol=1e9).fit(paper, [*collection.truths[:3], collection.truths[4]])


def test_a_body_that_is_its_own_mirror_image_raises_no_alarm(
    make_learner, symmetric_probed, symmetric_collection
):
    learner = make_learner(n_functions=10).fit(
        symmetric_probed[:3], symmetric_collection.truths[:3]
    )
    mesh = symmetric_collection.meshes[3]
    image = Mesh(mesh.vertices * np.array([1, -1, 1]), mesh.faces[:, ::-1])
    with warnings.catch_warnings():
        warnings.simplefilter("error", OrientationWarning)
        learner.match(DescriptorTransformer().transform(SpectralBasis(30).transform([image])))
