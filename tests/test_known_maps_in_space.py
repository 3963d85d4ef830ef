"""Known maps of stiff kinds, built in space from few landmarks; slips that landmarks show."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sklearn.base import clone

from skfmap import Correspondence, Landmarks, Mesh
from skfmap.exceptions import CoverageWarning, DisagreementWarning, OrientationWarning
from skfmap.functional.similarity import STIFF, left_by_similarities
from skfmap.known_maps import GivenPairs, InSpace, PairsAsGiven, kind_of
from skfmap.registration.by_landmarks import build_in_space, exchanged

BENDS = (0.0, 0.03, -0.03, 0.02)
NAMES = tuple(f"mark {i}" for i in range(13))


@pytest.fixture(scope="module")
def bones(make_bodies):
    """Four bodies that hardly bend."""
    return make_bodies(list(zip((500, 420, 560, 460), BENDS, strict=True)), symmetric=False)


@pytest.fixture(scope="module")
def shapes(bones, probe):
    return probe(bones.meshes)


@pytest.fixture(scope="module")
def marks(points_on_bodies):
    return [Landmarks(points_on_bodies(bend)[::3][:13], NAMES) for bend in BENDS]


@pytest.fixture(scope="module")
def measured(bones, marks):
    return [Correspondence.from_points(*both) for both in zip(marks, bones.meshes, strict=True)]


def pairs_of(shapes, truths, k=15):
    joins = [truth.join(truths[0]) for truth in truths[1:]]
    return GivenPairs(shapes[1:], shapes[0], joins, k)


def test_stiff_kinds_are_told_from_those_that_bend(shapes, measured, probed, points_on_bodies):
    assert kind_of(pairs_of(shapes, measured)) == "in-space"
    assert kind_of(pairs_of(shapes, measured, k=6)) == "pairs"
    rng = np.random.default_rng(0)
    bent = [
        Correspondence.from_points(
            shape.spectral.mesh.vertices[rng.permutation(400)[:13]], shape.spectral.mesh, NAMES
        )
        for shape in probed[:3]
    ]
    assert kind_of(pairs_of(probed[:3], bent)) == "from-landmarks"


def test_maps_from_thirteen_landmarks_are_those_of_all_points(shapes, measured, bones):
    few, many = pairs_of(shapes, measured), pairs_of(shapes, bones.truths)
    for built, known in zip(InSpace().build(few), PairsAsGiven().build(many), strict=True):
        assert built.kind == "in-space"
        assert not built.wrong.any()
        assert built.errors.max() < 0.1  # of landmarks left out
        true = dict(zip(known.pairs.vertices_i, known.pairs.vertices_0, strict=True))
        both = [
            (image, true[vertex])
            for vertex, image in zip(built.pairs.vertices_i, built.pairs.vertices_0, strict=True)
            if vertex in true
        ]
        at = shapes[0].spectral.vertices[np.array(both)]
        off = np.linalg.norm(at[:, 0] - at[:, 1], axis=1)
        assert len(both) > 150
        assert off.mean() < 0.06  # the mean edge is 0.1


def test_the_learner_learns_from_them_and_says_so(make_learner, shapes, measured):
    learner = make_learner(n_functions=15).fit(shapes, measured)
    assert learner.known_maps_.kinds == ["", *["in-space"] * 3]
    assert "13 landmarks" in str(learner.known_maps_)
    assert learner.known_maps_.mean_error < 0.05
    named = make_learner(n_functions=15).set_params(known_maps="in-space").fit(shapes, measured)
    assert np.array_equal(named.weights_, learner.weights_)


def test_a_specimen_may_stand_anywhere(shapes, measured, bones, marks, probe):
    turn = Rotation.random(random_state=1).as_matrix()
    moved = 25.4 * bones.meshes[1].vertices @ turn.T + [3.0, 5, -100]
    points = 25.4 * marks[1].points @ turn.T + [3.0, 5, -100]
    mesh = Mesh(moved, bones.meshes[1].faces, "moved")
    other = [shapes[0], *probe([mesh])]
    truths = [measured[0], Correspondence.from_points(points, mesh, NAMES)]
    one, two = (
        InSpace().build(pairs_of(*both))[0]
        for both in ((shapes[:2], measured[:2]), (other, truths))
    )
    same = one.pairs.vertices_0 == two.pairs.vertices_0
    assert same.mean() > 0.99
    np.testing.assert_allclose(one.errors, two.errors, atol=0.02)


def test_exchanged_landmarks_are_named_and_left_out(make_learner, shapes, measured, bones, marks):
    points = marks[2].points.copy()
    points[[4, 9]] = points[[9, 4]]
    slip = Correspondence.from_points(Landmarks(points, NAMES), bones.meshes[2])
    truths = [*measured[:2], slip, measured[3]]
    built = InSpace().build(pairs_of(shapes, truths))[1]
    assert built.exchanged == [(4, 9)]
    assert np.flatnonzero(built.wrong).tolist() == [4, 9]
    with pytest.warns(CoverageWarning, match=r"'mark 4' and 'mark 9' of X\[2\] \('body2'\)"):
        make_learner(n_functions=15).fit(shapes, truths)


def _moved(truth, mesh, rows, to):
    points = truth.coordinates.copy()
    points[rows] = to
    return Correspondence.from_points(Landmarks(points, NAMES), mesh)


@pytest.mark.parametrize("refine", ["bijective-zoomout", "register"])
def test_exchanged_landmarks_count_no_more_than_missing_ones(
    make_learner, shapes, measured, bones, refine
):
    slip = _moved(measured[2], bones.meshes[2], [4, 9], measured[2].coordinates[[9, 4]])
    missing = _moved(measured[2], bones.meshes[2], [4, 9], np.nan)
    learner = make_learner(n_functions=15, refine=refine, confidence="cross-fit")
    with pytest.warns(CoverageWarning, match="swapped"):
        one = clone(learner).fit(shapes, [*measured[:2], slip, measured[3]])
    other = clone(learner).fit(shapes, [*measured[:2], missing, measured[3]])
    (one,), (other,) = (fitted.predict_landmarks(shapes[1:2]) for fitted in (one, other))
    size = np.sqrt(shapes[1].spectral.area)
    np.testing.assert_allclose(one.points, other.points, atol=0.005 * size)
    np.testing.assert_allclose(one.expected_error, other.expected_error, atol=0.005 * size)


@pytest.mark.filterwarnings("ignore::skfmap.exceptions.DisagreementWarning")
def test_landmarks_exchanged_on_the_reference_are_taken_from_the_others(
    make_learner, shapes, measured, bones, marks
):
    slip = _moved(measured[0], bones.meshes[0], [4, 9], measured[0].coordinates[[9, 4]])
    learner = make_learner(n_functions=15, refine="bijective-zoomout", confidence="cross-fit")
    with pytest.warns(CoverageWarning, match="'mark 4' and 'mark 9' of the reference. They"):
        fitted = learner.fit(shapes, [slip, *measured[1:]])
    (found,) = fitted.predict_landmarks(shapes[3:])
    off = np.linalg.norm(found.points - marks[3].points, axis=1)
    assert off.max() < 0.1 * np.sqrt(shapes[3].spectral.area)


def test_names_spelt_otherwise_are_told(make_learner, shapes, measured, bones):
    for other in ("Mark_4", "nose"):
        names = [other if name == "mark 4" else name for name in NAMES]
        odd = Correspondence.from_points(Landmarks(measured[2].coordinates, names), bones.meshes[2])
        with pytest.warns(CoverageWarning, match=f"'{other}' of X\\[2\\]"):
            make_learner(n_functions=12).fit(shapes, [*measured[:2], odd, measured[3]])


def test_a_mirrored_specimen_is_named_and_laid_on_as_its_image(
    make_learner, shapes, measured, bones, marks, probe
):
    flip = np.array([1.0, -1, 1])
    mesh = Mesh(bones.meshes[1].vertices * flip, bones.meshes[1].faces[:, ::-1], "left")
    mirrored = Correspondence.from_points(Landmarks(marks[1].points * flip, NAMES), mesh)
    X, y = [shapes[0], *probe([mesh]), *shapes[2:]], [measured[0], mirrored, *measured[2:]]
    built = InSpace().build(pairs_of(X, y))
    plain = InSpace().build(pairs_of(shapes, measured))
    assert not built[0].wrong.any()
    assert (built[0].pairs.vertices_0 == plain[0].pairs.vertices_0).mean() > 0.97
    with pytest.warns(OrientationWarning, match="left"):
        make_learner(n_functions=15).fit(X, y)
    with pytest.warns(OrientationWarning, match="left"):
        make_learner(n_functions=15, on_mirrored="reflect").fit(X, y)


def test_a_mirrored_specimen_does_not_spoil_what_is_promised(
    make_learner, shapes, measured, bones, marks, probe
):
    flip = np.array([1.0, -1, 1])
    mesh = Mesh(bones.meshes[1].vertices * flip, bones.meshes[1].faces[:, ::-1], "left")
    mirrored = Correspondence.from_points(Landmarks(marks[1].points * flip, NAMES), mesh)
    learner = make_learner(n_functions=15, refine="auto", confidence="cross-fit")
    with (
        pytest.warns(OrientationWarning, match="left"),
        pytest.warns(DisagreementWarning, match="left"),
    ):
        with_it = clone(learner).fit([*shapes, *probe([mesh])], [*measured, mirrored])
    without = clone(learner).fit(shapes, measured)
    promised = [one.landmarks_.expected_errors().mean() for one in (with_it, without)]
    assert promised[0] == pytest.approx(promised[1], rel=0.3)
    assert len(with_it.landmarks_.left_out.indices) == 3


def test_landmarks_out_of_place_are_found(shapes, measured):
    (pairs,) = pairs_of(shapes[:2], measured[:2]).joins
    spectral_0, spectral = shapes[0].spectral, shapes[1].spectral
    places_0 = spectral_0.place_matrix(pairs.vertices_0, pairs.places_0)
    points = spectral.vertices_at(pairs.vertices_i, pairs.places_i).copy()
    points[3] = -points[3]  # through the body, to the other side
    built = build_in_space(spectral_0, (spectral.vertices, spectral.mesh.faces), places_0, points)
    assert np.flatnonzero(built.wrong).tolist() == [3]
    assert built.exchanged == []


@given(st.integers(0, 10_000), st.integers(7, 20))
def test_any_two_landmarks_that_are_exchanged_are_found(seed, n):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 3))
    a, b = sorted(rng.permutation(n)[:2].tolist())
    other = 3 * points @ Rotation.random(random_state=seed).as_matrix() + rng.normal(size=3)
    other += 1e-3 * rng.normal(size=other.shape)
    assert exchanged(points, other) == []
    other[[a, b]] = other[[b, a]]
    assert exchanged(points, other) == [(a, b)]


def test_few_landmarks_tell_no_slips():
    points = np.random.default_rng(0).normal(size=(5, 3))
    assert exchanged(points, points[[1, 0, 2, 3, 4]]) == []


def test_parameters_are_those_of_a_part(make_learner):
    learner = make_learner(known_maps=InSpace(enough=1.0))
    assert clone(learner).known_maps.enough == 1.0
    assert repr(InSpace()) == "InSpace()"


def test_a_mirrored_specimen_that_is_nearly_flat_is_laid_on_as_its_image(bones, marks, probe):
    """A rotation explains its landmarks nearly as well."""
    thin = np.array([1.0, 1, 0.12])
    meshes = [Mesh(mesh.vertices * thin, mesh.faces, mesh.name) for mesh in bones.meshes[:2]]
    flipped = Mesh(meshes[1].vertices * [1.0, 1, -1], meshes[1].faces[:, ::-1], "left")
    points = [one.points * thin for one in marks[:2]]
    left = left_by_similarities(points[1] * [1, 1, -1], points[0], np.ones(13))
    assert left[1] < left[0] < STIFF
    x = probe([*meshes, flipped])
    y = [
        Correspondence.from_points(Landmarks(at, NAMES), mesh)
        for at, mesh in zip((*points, points[1] * [1, 1, -1]), (*meshes, flipped), strict=True)
    ]
    plain, mirrored = InSpace().build(pairs_of(x, y))
    assert (plain.pairs.vertices_0 == mirrored.pairs.vertices_0).mean() > 0.97
