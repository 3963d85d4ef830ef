"""What there is to learn from: sorting out, the reference, known maps."""

import numpy as np
import pytest

from skfmap import Correspondence
from skfmap.exceptions import CorrespondenceError, MeshError, SkippedShapeWarning
from skfmap.functional import learn_functional_maps
from skfmap.ground_truth import ground_truth_maps
from skfmap.learner import LearningOptions, TrainingSet
from skfmap.learner.medoid import medoid_index
from skfmap.shapes import SkippedShape

OPTIONS = LearningOptions(tol=1e-3)

# What is wrong with the correspondence of a training shape: what is said.
_WRONG = {
    "out of range": (lambda t: Correspondence(np.add(t.pairs, [10_000, 0])), "refer to vertex"),
    "of another size": (
        lambda t: Correspondence.from_vertices(np.zeros(7, dtype=int)),
        "was made for 7 vertices",
    ),
    "unknown everywhere": (lambda t: Correspondence.from_template([-1] * 300), "has no pairs"),
    "fewer than k": (lambda t: t.restrict(np.arange(5)), "too few for n_functions=12"),
    "of another template": (
        lambda t: Correspondence(np.add(t.pairs, [0, 900])),
        "share no template point",
    ),
}


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.SkippedShapeWarning")
@pytest.mark.parametrize("wrong", _WRONG)
def test_a_correspondence_that_does_not_fit_is_refused_or_skipped(
    collection, probed, make_learner, wrong
):
    change, message = _WRONG[wrong]
    truths = [*collection.truths[:2], change(collection.truths[2]), *collection.truths[3:5]]
    with pytest.raises(CorrespondenceError, match=message):
        make_learner().fit(probed[:5], truths)
    with pytest.warns(SkippedShapeWarning, match=rf"X\[2\], shape 'body2'.*{message}"):
        learner = make_learner(on_invalid="skip").fit(probed[:5], truths)
    rest = [0, 1, 3, 4]
    alone = make_learner().fit([probed[i] for i in rest], [collection.truths[i] for i in rest])
    np.testing.assert_array_equal(learner.weights_, alone.weights_)
    first = [change(collection.truths[0]), *collection.truths[1:5]]
    nothing = "reference, X.0. .'body0'., cannot be used|at least two usable shapes"
    with pytest.raises((MeshError, ValueError), match=nothing):
        make_learner(on_invalid="skip").fit(probed[:5], first)


def _samples(shapes, truths, **given):
    return TrainingSet.from_samples(
        shapes, truths, **{"n_functions": 12, "options": OPTIONS} | given
    )


@pytest.fixture(scope="module")
def training(probed, collection):
    return _samples(
        probed[:4], collection.truths[:4], sample_weight=[9, 1, 0, 2], reference="body1"
    )


def test_skipped_shapes_are_sorted_out_and_keep_their_index(probed, collection):
    broken = SkippedShape("broken", "It has no faces.")
    shapes, truths = [probed[0], broken, *probed[1:4]], [*collection.truths[:4]]
    truths.insert(1, truths[0])
    truths[3] = Correspondence([[10**5, 1]])
    training = _samples(shapes, truths, reference="body1", on_invalid="skip")
    assert training.reference.name == "body1"
    assert training.reference_index == 2
    assert training.n_given == 5
    assert training.indices.tolist() == [0, 4]
    assert [shape.name for shape in training.shapes] == ["body0", "body3"]
    assert [training.describe(i) for i in (0, 1)] == ["X[0] ('body0')", "X[4] ('body3')"]
    assert training.skipped.startswith(
        "2 of 5 shapes are left out. X[1], shape 'broken': It has no"
    )
    assert "X[3], shape 'body2'" in training.skipped


def test_the_reference_is_the_first_or_the_one_of_that_name(probed, collection):
    shapes, truths = probed[:3], collection.truths[:3]
    assert _samples(shapes, truths).reference_index == 0
    assert _samples(shapes, truths, reference="body2").indices.tolist() == [0, 1]
    with pytest.raises(ValueError, match="reference='body9' must name exactly one of the training"):
        _samples(shapes, truths, reference="body9")
    with pytest.raises(ValueError, match=r"must name exactly one.*'body0', 'body1', 'body1'"):
        _samples([*shapes[:2], shapes[1]], [*truths[:2], truths[1]], reference="body1")


def test_the_medoid_is_the_reference_by_its_index(probed, collection):
    broken = SkippedShape("broken", "It has no faces.")
    index = medoid_index(probed[:4], collection.truths[:4], None)
    training = _samples(
        [broken, *probed[:4]],
        [collection.truths[0], *collection.truths[:4]],
        reference="medoid",
        on_invalid="skip",
    )
    assert training.reference_index == index + 1
    apart = [
        truth.restrict(np.arange(30 * i, 30 * i + 30)) for i, truth in enumerate(collection.truths)
    ]
    with pytest.raises(CorrespondenceError, match="reference='medoid' needs template points"):
        _samples(probed[:4], apart[:4], reference="medoid")


def test_a_reference_that_cannot_be_used_is_refused(probed, collection):
    broken = SkippedShape("broken", "It has no faces.")
    with pytest.raises(
        MeshError, match=r"The reference, X\[0\] \('broken'\), cannot be used: It has"
    ):
        _samples([broken, *probed[1:4]], collection.truths[:4], on_invalid="skip")
    with pytest.raises(MeshError, match=r"No shape can be used\. The first: It has no faces"):
        _samples([broken] * 2, collection.truths[:2], on_invalid="skip", reference="medoid")


def test_there_must_be_something_to_learn_from(probed, collection):
    with pytest.raises(
        ValueError, match="at least two usable shapes, the reference and one to learn from"
    ):
        _samples(probed[:1], collection.truths[:1])
    with pytest.raises(
        ValueError, match="sample_weight is zero for every shape except the reference"
    ):
        _samples(probed[:3], collection.truths[:3], sample_weight=[1, 0, 0])
    labels = OPTIONS._replace(weighting=lambda names, categories: "one text")
    with pytest.raises(TypeError, match="weighting must return one label for each probe; it"):
        _samples(probed[:3], collection.truths[:3], options=labels)


def test_arrays_are_what_equation_3_is_about(training, probed, collection):
    arrays = training.arrays()
    n_probes = probed[0].probes.shape[1]
    assert arrays["probes_0"].shape == (12, n_probes)
    np.testing.assert_array_equal(arrays["probes"][2], probed[3].probes[:12])
    np.testing.assert_array_equal(arrays["evals_0"], probed[1].spectral.evals[:12])
    np.testing.assert_array_equal(arrays["evals"][0], probed[0].spectral.evals[:12])
    np.testing.assert_array_equal(arrays["sample_weight"], [9, 0, 2])
    joins = [collection.truths[i].join(collection.truths[1]) for i in (0, 2, 3)]
    maps = ground_truth_maps([probed[i] for i in (0, 2, 3)], probed[1], joins, 12)
    np.testing.assert_allclose(arrays["maps"], maps, atol=1e-12)
    learned = training.learn(max_iter=5)
    again = learn_functional_maps(**arrays, **training.options._replace(max_iter=5)._asdict())
    np.testing.assert_array_equal(learned.weights, again.weights)


def test_only_some_of_the_shapes_are_a_training_set_of_their_own(training, probed, collection):
    some = training.only(np.array([2, 0]))
    assert [shape.name for shape in some.shapes] == ["body3", "body0"]
    assert some.indices.tolist() == [3, 0]
    assert some.share.tolist() == [2, 9]
    assert some.reference is training.reference
    alone = _samples(
        [probed[i] for i in (3, 1, 0)],
        [collection.truths[i] for i in (3, 1, 0)],
        sample_weight=[2, 1, 9],
        reference="body1",
    )
    for name, array in alone.arrays().items():
        np.testing.assert_array_equal(some.arrays()[name], array)


def test_a_record_says_what_was_learned_from_and_how_the_search_ended(training):
    assert training.used.tolist() == [0, 2]
    learned = training.learn(max_iter=2)
    record = training.record(learned)
    assert record.reference_index == 1
    assert record.reference_correspondence is training.truth_0
    assert record.n_shapes == 2, "without the one of no share"
    assert record.total_share == 11
    assert record.loss == learned.optimum.loss_curve[-1]
    assert record.n_iter == learned.optimum.n_iter <= 2
    assert record.epsilon == learned.epsilon > 0


def test_labels_of_probes_may_come_from_a_function(probed, collection):
    def by_category(names, categories):
        assert len(names) == len(categories) == probed[0].probes.shape[1]
        return categories

    labelled = OPTIONS._replace(weighting=by_category)
    own, named = (
        _samples(probed[:3], collection.truths[:3], options=options).learn(max_iter=3)
        for options in (labelled, OPTIONS._replace(weighting="category"))
    )
    np.testing.assert_array_equal(own.weights, named.weights)
