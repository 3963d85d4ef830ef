"""What the learner is given: shapes and correspondences, sound, skipped or refused."""

from dataclasses import replace

import numpy as np
import pytest

from skfmap import Correspondence, SpectralBasis
from skfmap.exceptions import CorrespondenceError, CoverageWarning, SkippedShapeWarning
from skfmap.learner.inputs import (
    check_correspondences,
    check_new_shapes,
    check_scored,
    check_shapes,
)
from skfmap.shapes import Prolongation, SkippedShape


def test_template_points_may_have_any_numbers(probed, collection, make_learner):
    """Keys of a data base: no table as long as the largest is made."""
    far = [Correspondence(np.add(truth.pairs, [0, 2**40])) for truth in collection.truths]
    one = make_learner(weighting=None).fit(probed[:3], far[:3])
    other = make_learner(weighting=None).fit(probed[:3], collection.truths[:3])
    np.testing.assert_array_equal(one.predict(probed[3:]), other.predict(probed[3:]))


def test_a_reference_is_no_unordered_set_and_no_generator(collection, model, probed):
    with pytest.raises(TypeError, match=r"got a set. Make it a list: list\(X\)"):
        SpectralBasis(20).transform(set(collection.meshes))
    for call in (
        lambda: SpectralBasis(20).fit(mesh for mesh in collection.meshes),
        lambda: model.predict(mesh for mesh in collection.meshes),
        lambda: model[-1].score((shape for shape in probed), collection.truths),
    ):
        with pytest.raises(TypeError, match="got a generator"):
            call()


def test_shapes_must_go_together_to_be_learned_from(probed, probe, collection):
    broken = SkippedShape("broken", "It has no faces.")
    given = [broken, *probed[:2]]
    assert check_shapes(given, 12) is not None
    with pytest.raises(TypeError, match=r"X is one probed shape.*wrap it in a list: \[X\]"):
        check_shapes(probed[0], 12)
    with pytest.raises(TypeError, match=r"X\[1\] is a SpectralShape, not a ProbedShape"):
        check_shapes([probed[0], probed[1].spectral], 12)
    with pytest.raises(ValueError, match=r"X\[1\] \('body0'\) has 30 eigenfunctions, fewer than"):
        check_shapes(given, 31)
    (other,) = probe(collection.meshes[2:3], "paper")
    with pytest.raises(
        ValueError, match=r"X\[3\] \('body2'\) has different probe functions from the"
    ):
        check_shapes([*given, other], 12)


def test_new_shapes_keep_their_index_beside_those_that_are_skipped(probed):
    broken = SkippedShape("broken", "It has no faces.")
    usable = check_new_shapes([broken, probed[1], broken, probed[2]], probed[0], 12)
    assert usable.indices == [1, 3]
    assert usable.shapes == [probed[1], probed[2]]
    assert sorted(usable.skipped) == [0, 2]
    strange = replace(probed[1], recipe=("another",) * len(probed[1].recipe))
    with pytest.raises(
        ValueError, match=r"X\[0\] \('body1'\) were computed with different parameters.*train"
    ):
        check_new_shapes([strange], probed[0], 12)


def test_correspondences_may_be_tables_of_pairs(probed, collection):
    tables = [truth.pairs for truth in collection.truths[:2]]
    for given in (tables, [table.tolist() for table in tables], np.stack(tables)):
        for one, table in zip(check_correspondences(given, probed[:2]), tables, strict=True):
            np.testing.assert_array_equal(one.pairs, table)


def test_pairs_of_vertices_without_a_place_are_left_out(probed):
    """The second vertex that was given is gone, and the others have moved up."""
    mesh = probed[1].spectral.mesh
    n = mesh.n_vertices
    vertex_map = np.concatenate([[0, -1], np.arange(1, n)])
    places = Prolongation.of_vertices(vertex_map, mesh.faces)
    mended = replace(probed[1], spectral=replace(probed[1].spectral, prolongation=places))
    truth = Correspondence([[0, 5], [1, 6], [n, 7]])
    with pytest.warns(CoverageWarning, match=r"1 of the 3 pairs of X\[0\] \('body1'\)"):
        (checked,) = check_correspondences([truth], [mended])
    assert checked.pairs.tolist() == [[0, 5], [n, 7]]
    with pytest.raises(CorrespondenceError, match="All pairs of shape 'body1'"):
        check_correspondences([Correspondence([[1, 6]])], [mended])


def test_a_correspondence_that_does_not_fit_is_refused_or_becomes_a_skipped_shape(
    probed, collection
):
    broken = SkippedShape("broken", "It has no faces.")
    shapes, truths = [broken, *probed[:2]], [*collection.truths[:2], Correspondence([[10**5, 1]])]
    with pytest.raises(CorrespondenceError, match=r"The pairs of y\[2\] \(of 'body1'\) refer to"):
        check_correspondences(truths, shapes)
    first, second, third = check_correspondences(truths, shapes, skip=True)
    assert first is broken
    np.testing.assert_array_equal(second.pairs, truths[1].pairs)
    assert third.name == "body1"
    assert third.reason.startswith("The pairs of y[2] (of 'body1') refer to vertex 100000")
    assert third.n_vertices == probed[1].spectral.mesh.n_vertices


def test_a_shape_whose_answer_is_skipped_is_not_scored(probed, collection):
    truths = [Correspondence([[10**5, 1]]), collection.truths[1]]
    with pytest.warns(SkippedShapeWarning, match=r"X\[0\], shape 'body0': The pairs of y\[0\]"):
        usable, answers = check_scored(probed[:2], truths, probed[2], 12, skip=True)
    assert usable.indices == [1]
    assert len(answers) == 1
    np.testing.assert_array_equal(answers[0].pairs, truths[1].pairs)
