"""Known maps from few landmarks: what is built, when, and what is said of the landmarks."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import skfmap
from skfmap import Correspondence, DescriptorTransformer, Mesh, SpectralBasis
from skfmap.datasets import make_creatures
from skfmap.exceptions import (
    CorrespondenceError,
    CoverageWarning,
    OrientationWarning,
    SkippedShapeWarning,
)
from skfmap.functional import (
    calibrated_covariance,
    farthest_points,
    map_from_landmarks,
    map_from_point_maps,
)
from skfmap.ground_truth import join_with_reference, known_maps
from skfmap.known_maps import AutoKnownMaps, FromLandmarks, GivenPairs, PairsAsGiven, kind_of
from skfmap.learner.training_set import TrainingSet
from skfmap.persistence import load_model, save_model

K = 20


@pytest.fixture(scope="module")
def creatures():
    """Return probed creatures, all their pairs, and template points in well-spread order."""
    made = make_creatures(n_shapes=4, n_vertices=500)
    spectral = SpectralBasis(n_components=40).transform(made.meshes)
    pairs = made.correspondences[0].pairs
    spread = farthest_points(made.meshes[0].vertices[pairs[:, 0]], 45)
    return DescriptorTransformer().transform(spectral), made.correspondences, pairs[spread, 1]


@pytest.fixture(scope="module")
def few(creatures):
    """Return the correspondences with 13 landmarks."""
    _, truths, points = creatures
    return [truth.restrict(points[:13]) for truth in truths]


def _given(shapes, truths, k=K):
    joins = [
        join_with_reference(truth, shape, truths[0], shapes[0])
        for truth, shape in zip(truths[1:], shapes[1:], strict=True)
    ]
    return GivenPairs(shapes[1:], shapes[0], joins, k)


def _learner(**parameters):
    return skfmap.WeightedFunctionalMapLearner(
        n_functions=K, **{"confidence": None, "refine": None, "tol": 1e3, **parameters}
    )


def _error(shapes, truths, pairs):
    """Return the mean distance of built pairs of the first shape from where they belong."""
    mesh = shapes[0].spectral.mesh
    true = truths[1].join(truths[0])
    where = np.full(shapes[1].spectral.n_given, -1)
    where[true.vertices_i] = true.vertices_0
    found = where[pairs.vertices_i] >= 0
    off = mesh.vertices[pairs.vertices_0[found]] - mesh.vertices[where[pairs.vertices_i[found]]]
    return float(np.linalg.norm(off, axis=1).mean() / np.sqrt(mesh.area))


def _exchange(truth, a, b):
    pairs = truth.pairs.copy()
    pairs[:, 1] = np.select([pairs[:, 1] == a, pairs[:, 1] == b], [b, a], pairs[:, 1])
    return Correspondence(pairs)


def _told(X, y, **parameters):
    """Return what a fit says of its landmarks, and the learner."""
    learner = _learner(**parameters)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        learner.fit(X, y)
    return [str(w.message) for w in caught if w.category is CoverageWarning], learner


def test_landmarks_on_a_copy_make_the_identity():
    rng = np.random.default_rng(0)
    evals, at = np.arange(6.0), np.column_stack([np.ones(9), rng.normal(size=(9, 5))])
    probes = rng.normal(size=(6, 4))
    C = map_from_landmarks(evals, evals, at, at, probes, probes)
    np.testing.assert_allclose(C, np.eye(6), atol=1e-5)
    signs = np.array([1.0, -1, 1, -1, -1, 1])
    turned = map_from_landmarks(evals, evals, at * signs, at, probes * signs[:, None], probes)
    np.testing.assert_allclose(turned, np.diag(signs), atol=1e-5)


def test_landmarks_hold_a_map_of_point_maps():
    rng = np.random.default_rng(0)
    evecs = np.column_stack([np.ones(40), rng.normal(size=(40, 4))])
    mass, p2p = np.full(40, 1 / 40), rng.integers(0, 40, 40)
    at_i, at_0 = evecs[:7], evecs[3:10]
    free = map_from_point_maps(evecs, evecs, mass, mass, p2p)
    held = map_from_point_maps(evecs, evecs, mass, mass, p2p, held=(at_i, at_0))
    # The same as pairs among the others, in a plain least-squares problem.
    rows = np.vstack([evecs * np.sqrt(1 / 40), at_i * np.sqrt(1 / 7)])
    right = np.vstack([evecs[p2p] * np.sqrt(1 / 40), at_0 * np.sqrt(1 / 7)])
    np.testing.assert_allclose(held, np.linalg.lstsq(rows, right)[0], atol=1e-12)
    missed = [np.linalg.norm(at_i @ C - at_0) for C in (free, held)]
    assert missed[1] < missed[0]


def test_a_calibrated_covariance_has_the_variances_that_were_observed():
    rng = np.random.default_rng(0)
    root, residuals = rng.normal(size=(5, 5)), rng.normal(size=(3, 5))
    residuals[:, 0] = 0
    covariance = calibrated_covariance(root @ root.T, residuals)
    np.testing.assert_allclose(np.diag(covariance), (residuals**2).mean(axis=0))
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    assert not covariance[0].any()


def test_dense_maps_are_built_from_thirteen_landmarks(creatures, few):
    shapes, truths, _ = creatures
    built = FromLandmarks().build(_given(shapes, few))
    dense = known_maps(shapes[1:], shapes[0], _given(shapes, truths).joins, K)
    made = known_maps(shapes[1:], shapes[0], [one.pairs for one in built], K)
    for one, known, true in zip(built, made, dense, strict=True):
        assert one.kind == "from-landmarks"
        assert len(one.pairs.points) > 400
        assert not one.wrong.any()
        assert np.linalg.norm(known.C - true.C) < 0.35 * np.linalg.norm(true.C)
    assert _error(shapes, truths, built[0].pairs) < 0.05


def test_landmarks_left_out_tell_how_good_the_maps_are(creatures, few):
    shapes, _, points = creatures
    _, learner = _told(shapes, few)
    record = learner.known_maps_
    assert record.kinds == ["", *3 * ["from-landmarks"]]
    assert record.n_landmarks.tolist() == [0, 13, 13, 13]
    assert (record.n_pairs[1:] > 400).all()
    np.testing.assert_array_equal(record.points, np.sort(points[:13]))
    assert np.isnan(record.landmark_errors[0]).all()
    assert 0 < record.mean_error < 0.1
    assert str(record).startswith("known maps of 3 of 3 shapes built from 13 landmarks each; a")


def test_pairs_that_are_enough_are_used_as_they_are(creatures):
    shapes, truths, points = creatures
    enough = [truth.restrict(points[: 2 * K]) for truth in truths]
    auto, plain, off = (
        _learner(known_maps=how).fit(shapes, enough) for how in ("auto", "pairs", None)
    )
    for other in (plain, off):
        np.testing.assert_array_equal(auto.weights_, other.weights_)
        np.testing.assert_array_equal(auto.truncation_covariance_, other.truncation_covariance_)
    assert auto.known_maps_.kinds == ["", "pairs", "pairs", "pairs"]
    assert auto.known_maps_.landmark_errors.shape == (4, 0)
    assert "3 shapes from the pairs as given" in str(auto.known_maps_)


def test_the_choice_looks_at_the_shape_with_fewest_pairs(creatures, few):
    shapes, truths, points = creatures
    assert kind_of(_given(shapes, truths)) == "pairs"
    mixed = [truths[0], few[1], *truths[2:]]
    assert kind_of(_given(shapes, mixed)) == "from-landmarks"
    built = AutoKnownMaps().build(_given(shapes, mixed))
    assert [one.kind for one in built] == ["from-landmarks", "pairs", "pairs"]
    exactly = [truth.restrict(points[: 2 * K]) for truth in truths]
    assert kind_of(_given(shapes, exactly)) == "pairs"
    assert kind_of(_given(shapes, exactly, K + 1)) == "from-landmarks"


def test_the_pairs_that_were_given_keep_their_own_areas(creatures, few):
    shapes, *_ = creatures
    training = TrainingSet.from_samples(shapes, few, n_functions=K, build=FromLandmarks())
    for join, known, observed in zip(
        training.joins, training.known, training.observed, strict=True
    ):
        assert len(known.areas) == len(join.points) == 13
        assert known.areas.sum() == pytest.approx(1)
        assert len(observed.areas) == len(observed.join.points) > 400
        assert observed.residuals.shape == (13, 40)


def test_too_few_landmarks_are_refused_with_a_remedy_or_left_out(creatures):
    shapes, truths, points = creatures
    y = [truths[0], truths[1].restrict(points[:7]), *truths[2:]]
    with pytest.raises(CorrespondenceError, match=r"7 distinct landmarks.*takes 8.*Place more"):
        _learner().fit(shapes, y)
    with pytest.warns(SkippedShapeWarning, match="7 distinct landmarks"):
        learner = _learner(on_invalid="skip").fit(shapes, y)
    assert learner.n_training_shapes_ == 2
    fewer = skfmap.WeightedFunctionalMapLearner(
        n_functions=7, known_maps=PairsAsGiven(), confidence=None, refine=None, tol=1e3
    )
    with pytest.warns(CoverageWarning, match="fewer than the 7 functions"):
        fewer.fit(shapes, y)


def test_repeated_landmarks_count_once(creatures):
    shapes, truths, points = creatures
    eight = [truth.restrict(points[:8]) for truth in truths]
    at = [one.pairs[one.pairs[:, 1] == points[0], 0][0] for one in eight]
    again = [
        Correspondence(np.vstack([one.pairs, [vertex, 10_000]]))
        for one, vertex in zip(eight, at, strict=True)
    ]
    assert _told(shapes, again)[1].known_maps_.n_landmarks.tolist() == [0, 8, 8, 8]
    seven = [truth.restrict(np.append(points[:7], 10_000)) for truth in again]
    with pytest.raises(CorrespondenceError, match="repeated ones count once"):
        _learner().fit(shapes, seven)


def test_exchanged_landmarks_are_named(creatures, few):
    shapes, truths, points = creatures
    y = [few[0], few[1], _exchange(few[2], points[0], points[1]), few[3]]
    (message,), learner = _told(shapes, y)
    first, second = sorted(points[:2])
    order = f"point {first} and point {second}", f"point {second} and point {first}"
    assert any(
        f"swapped, because the others put each at the other's place: {one} of" in message
        for one in order
    )
    assert shapes[2].name in message
    assert shapes[1].name not in message
    # What is built is as good as from the others alone.
    built = FromLandmarks().build(_given([shapes[0], shapes[2]], [few[0], y[2]]))[0]
    assert built.wrong.sum() == 2
    assert _error([shapes[0], shapes[2]], [truths[0], truths[2]], built.pairs) < 0.06
    assert learner.known_maps_.mean_error < 0.2


def test_names_of_exchanged_landmarks_are_told(creatures, few):
    shapes, _, points = creatures
    y = [few[0], few[1], _exchange(few[2], points[0], points[1]), few[3]]
    names = tuple(f"mark {point}" for point in range(max(points) + 1))
    (message,), _ = _told(shapes, [replace(one, names=names) for one in y])
    assert f"'mark {points[0]}'" in message
    assert f"'mark {points[1]}'" in message


def test_a_landmark_out_of_place_is_left_out_and_told(creatures, few):
    shapes, truths, points = creatures
    pairs = few[2].pairs.copy()
    at = dict(truths[2].pairs[:, ::-1].tolist())
    x = shapes[2].spectral.mesh.vertices[[at[point] for point in (points[4], *points[13:])]]
    elsewhere = at[points[13 + np.linalg.norm(x[1:] - x[0], axis=1).argmax()]]
    pairs[pairs[:, 1] == points[4], 0] = elsewhere
    y = [few[0], few[1], Correspondence(pairs), few[3]]
    (message,), _ = _told(shapes, y)
    assert f"far from where the others put them, by this many sqrt(area): point {points[4]}" in (
        message
    )


def test_a_shape_with_the_landmarks_of_another_is_told(creatures, few):
    shapes, *_ = creatures
    pairs = few[2].pairs.copy()
    pairs[:, 1] = np.roll(pairs[:, 1], 5)
    messages, _ = _told(shapes, [few[0], few[1], Correspondence(pairs), few[3]])
    unlike = [message for message in messages if "unlike the reference" in message]
    assert len(unlike) == 1
    assert shapes[2].name in unlike[0]
    assert shapes[1].name not in unlike[0]


def test_landmarks_on_one_side_or_in_one_plane_are_enough_and_told(creatures):
    shapes, truths, _ = creatures
    at = shapes[0].spectral.mesh.vertices[truths[0].pairs[:, 0]]
    rear = np.flatnonzero(at[:, 1] > np.quantile(at[:, 1], 0.6))
    flat = np.argsort(np.abs(at[:, 0] - np.median(at[:, 0])))[:40]
    for rows, said in ((rear, "from the nearest landmark"), (flat, "lie in one plane")):
        chosen = rows[farthest_points(at[rows], 12)]
        y = [truth.restrict(truths[0].pairs[chosen, 1]) for truth in truths]
        messages, _ = _told(shapes, y)
        assert any(said in message for message in messages)
        built = FromLandmarks().build(_given(shapes, y))[0]
        assert _error(shapes, truths, built.pairs) < 0.1


def test_landmarks_between_vertices_on_thinned_meshes():
    made = make_creatures(n_shapes=2, n_vertices=1200)
    spectral = SpectralBasis(n_components=40, max_vertices=500).transform(made.meshes)
    shapes = DescriptorTransformer().transform(spectral)
    assert not shapes[0].spectral.keeps_vertices
    spread = farthest_points(made.meshes[0].vertices[made.correspondences[0].pairs[:, 0]], 13)
    chosen = made.correspondences[0].pairs[spread, 1]
    marked = []
    for mesh, truth in zip(made.meshes, made.correspondences, strict=True):
        at = dict(truth.pairs[:, ::-1].tolist())
        vertices = [at[point] for point in chosen]
        faces = [mesh.faces[(mesh.faces == vertex).any(axis=1)][0] for vertex in vertices]
        inside = 0.9 * mesh.vertices[vertices] + 0.1 * mesh.vertices[faces].mean(axis=1)
        marked.append(Correspondence.from_points(inside, mesh))
    assert marked[0].places.weights.max() < 1
    (built,) = FromLandmarks().build(_given(shapes, marked))
    true = made.correspondences[1].join(made.correspondences[0])
    where = np.full(made.meshes[1].n_vertices, -1)
    where[true.vertices_i] = true.vertices_0
    known = where[built.pairs.vertices_i] >= 0
    assert known.sum() > 150
    x = made.meshes[0].vertices
    off = x[built.pairs.vertices_0[known]] - x[where[built.pairs.vertices_i[known]]]
    assert np.linalg.norm(off, axis=1).mean() < 0.06 * np.sqrt(made.meshes[0].area)


@pytest.mark.parametrize("on_mirrored", ["warn", "reflect"])
def test_a_mirrored_shape_is_found_by_few_landmarks(creatures, few, on_mirrored):
    shapes, *_ = creatures
    mesh = shapes[2].spectral.mesh
    mirrored = Mesh(mesh.vertices * [-1, 1, 1], mesh.faces[:, ::-1], "mirrored")
    spectral = SpectralBasis(n_components=40).transform([mirrored])
    X = [*shapes[:2], *DescriptorTransformer().transform(spectral), shapes[3]]
    with pytest.warns(OrientationWarning, match="mirror") as caught:
        _learner(on_mirrored=on_mirrored).fit(X, few)
    (told,) = [str(w.message) for w in caught if w.category is OrientationWarning]
    assert "mirrored" in told
    assert ("were reflected" in told) == (on_mirrored == "reflect")


def test_maps_are_built_once_with_a_memory(creatures, few, tmp_path):
    shapes, *_ = creatures
    given = _given(shapes[:2], few[:2])
    first, again, without = (
        FromLandmarks().build(given._replace(memory=memory))[0]
        for memory in (str(tmp_path), str(tmp_path), None)
    )
    for other in (again, without):
        np.testing.assert_array_equal(first.pairs.vertices_0, other.pairs.vertices_0)
        np.testing.assert_array_equal(first.errors, other.errors)


def test_the_result_does_not_depend_on_the_number_of_jobs(creatures, few):
    shapes, *_ = creatures
    one, two = (
        FromLandmarks().build(_given(shapes, few)._replace(n_jobs=n_jobs)) for n_jobs in (1, 2)
    )
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.pairs.vertices_0, b.pairs.vertices_0)


def test_expected_errors_of_maps_from_landmarks(creatures, few):
    shapes, truths, _ = creatures
    learner = _learner(confidence="cross-fit").fit(shapes[:3], few[:3])
    (match,) = learner.match(shapes[3:])
    (errors,) = learner.pair_errors(shapes[3:], truths[3:], reference_y=truths[0])
    assert 1 / 3 < np.nanmean(match.expected_error) / errors.mean("direct") < 3


def test_a_model_in_a_file_says_how_its_maps_came_about(creatures, few, tmp_path):
    shapes, *_ = creatures
    _, learner = _told(shapes, few, known_maps=FromLandmarks(n_samples=300))
    save_model(learner, tmp_path / "model.skops")
    loaded = load_model(tmp_path / "model.skops")
    assert loaded.known_maps.n_samples == 300
    assert loaded.known_maps_.kinds == learner.known_maps_.kinds
    np.testing.assert_array_equal(
        loaded.known_maps_.landmark_errors, learner.known_maps_.landmark_errors
    )


def test_a_fit_says_what_it_did(creatures, few, capsys):
    shapes, *_ = creatures
    _told(shapes, few, verbose=1)
    told = capsys.readouterr()
    assert "known maps of 3 of 3 shapes built from 13 landmarks each" in told.out + told.err


@pytest.mark.parametrize(
    ("parameter", "message"),
    [
        ("landmarks", "known_maps must be one of 'auto', 'from-landmarks', "),
        (FromLandmarks, r"Did you mean FromLandmarks\(\)\?"),
        (FromLandmarks(n_samples=10), "n_samples"),
        (FromLandmarks(final_steps=0), "final_steps"),
        (FromLandmarks(enough=-1), "enough"),
    ],
)
def test_parts_that_cannot_be_used_are_refused(creatures, few, parameter, message):
    shapes, *_ = creatures
    with pytest.raises(ValueError, match=message):
        _learner(known_maps=parameter).fit(shapes, few)
