"""A part of the paper's findings on real shapes, where they are found."""

import os
from pathlib import Path

import numpy as np
import pytest

from skfmap import DescriptorTransformer, SpectralBasis, WeightedFunctionalMapLearner
from skfmap.datasets import load_collection
from skfmap.exceptions import UnfamiliarShapeWarning

DATA = Path(os.environ.get("SKFMAP_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
pytestmark = [
    pytest.mark.tosca,
    pytest.mark.skipif(
        not (DATA / "tosca_isometric").is_dir(), reason="the TOSCA shapes are not here"
    ),
]


@pytest.fixture(scope="module")
def cats():
    collection = load_collection(DATA / "tosca_isometric", "cat[0-4]", "cat0")
    return SpectralBasis().transform(collection.meshes), collection.correspondences


@pytest.fixture(scope="module")
def probed(cats):
    return DescriptorTransformer().transform(cats[0])


@pytest.fixture(scope="module")
def learner(cats, probed):
    return WeightedFunctionalMapLearner().fit(probed[:4], cats[1][:4])


def errors(learner, shapes, truths):
    return [
        learner.pair_errors(shapes[4:], truths[4:], matching="cut", n_stable=share, refine=None)[0]
        for share in (1.0, 0.5)
    ]


def test_correspondences_and_reading_order(cats):
    shapes, truths = cats
    assert [shape.name for shape in shapes] == ["cat0", "cat1", "cat2", "cat3", "cat4"]
    assert all(len(truth.pairs) == len(truth.symmetric_pairs) == 5000 for truth in truths)
    # On the standing cat the symmetric counterpart is the mirror image, so far as meshing allows.
    vertices, truth = shapes[0].vertices, truths[0]
    gap = np.linalg.norm(
        vertices[truth.pairs[:, 0]] * [-1, 1, 1] - vertices[truth.symmetric_pairs[:, 0]], axis=1
    )
    assert np.median(gap) < 0.03


def test_learning_and_reducing_both_help(cats):
    shapes, truths = DescriptorTransformer("paper").transform(cats[0]), cats[1]
    naive, learned = (
        WeightedFunctionalMapLearner(weighting=w, refine=None, confidence=None).fit(
            shapes[:4], truths[:4]
        )
        for w in (None, "function")
    )
    naive_full, naive_reduced = (e.mean("per_vertex") for e in errors(naive, shapes, truths))
    learned_full, learned_reduced = (e.mean("per_vertex") for e in errors(learned, shapes, truths))
    assert naive_reduced < naive_full
    assert learned_reduced < learned_full
    assert learned_reduced < naive_reduced


def test_oriented_probes_tell_left_from_right(cats, probed, learner):
    _, reduced = errors(learner, probed, cats[1])
    assert reduced.mean("direct") == reduced.mean("consistent") < 0.06


def test_another_species_is_told(probed, learner):
    """A horse matched by cats: answers without a warning would be believed."""
    learner.match(probed[4:])  # a cat in a new pose: not a word
    horse = load_collection(DATA / "tosca_isometric", "horse0").meshes
    with pytest.warns(UnfamiliarShapeWarning, match="'horse0'"):
        learner.match(DescriptorTransformer().transform(SpectralBasis().transform(horse)))
