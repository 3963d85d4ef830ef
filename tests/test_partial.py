"""Parts of shapes, matched to the whole reference."""

import pickle
import warnings

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import Mesh, PartialMatcher
from skfmap.datasets import make_creatures
from skfmap.exceptions import (
    OrientationWarning,
    RepairWarning,
    SkippedShapeWarning,
    StabilityWarning,
    UnfamiliarShapeWarning,
)
from skfmap.functional.samples import farthest_points
from skfmap.geometry.closest import ClosestPoints
from skfmap.geometry.cutting import rim_length
from skfmap.geometry.faults import count_components
from skfmap.geometry.geodesics import edge_path_distances
from skfmap.geometry.normals import vertex_normals
from skfmap.geometry.sphere import subdivided_octahedron
from skfmap.partial import Cut, DiscCut, LimbCut, PlaneCut, ViewCut
from skfmap.partial.consistency import hypotheses
from skfmap.partial.laying import lay_on_part
from skfmap.partial.scan import Scan, scan_of
from skfmap.partial.trust import _coverage_model
from skfmap.partial.winding import is_inside_out
from skfmap.persistence import load_model, save_model
from skfmap.registration import Deformation

CUTS = [PlaneCut, LimbCut, DiscCut, ViewCut]


@pytest.fixture(scope="module")
def creatures():
    return make_creatures(n_shapes=6, n_vertices=600, n_points=400)


@pytest.fixture(scope="module")
def pipeline():
    return make_pipeline(
        skfmap.SpectralBasis(40),
        skfmap.DescriptorTransformer(),
        skfmap.WeightedFunctionalMapLearner(n_functions=20, confidence=None),
    )


@pytest.fixture(scope="module")
def matcher(creatures, pipeline):
    """Return a fitted matcher; do not fit it again or change it."""
    model = PartialMatcher(pipeline, cuts=["planes", "limbs"], n_cuts=3, n_calibrated=1)
    return model.fit(creatures.meshes[:5], creatures.correspondences[:5])


@pytest.fixture(scope="module")
def scan(creatures):
    """Return a part of the sixth creature, cut by a plane that no training shape was cut by."""
    return PlaneCut(0.6, 0.6).cut(creatures.meshes[5], np.random.default_rng(11))


@pytest.fixture(scope="module")
def match(matcher, scan):
    return skfmap.match(matcher, [scan])[0]


def shown(creatures, scan):
    """Return which template points a scan of the sixth creature shows, and all its vertices."""
    at = creatures.meshes[5].vertices[_vertices(creatures, 5)]
    near = ClosestPoints(scan.vertices, scan.faces).of(at)
    return (near.distances < 0.02 * np.sqrt(creatures.meshes[0].area)) & ~near.on_rim, at


def _vertices(creatures, i):
    pairs = creatures.correspondences[i].pairs
    return pairs[np.argsort(pairs[:, 1]), 0]


def error_of(match, creatures, scan):
    """Return the mean distance between answers and truth, in sqrt(area); on the straight line."""
    reference = creatures.meshes[0]
    seen, at = shown(creatures, scan)
    _, own = cKDTree(scan.vertices).query(at[seen])
    found = match.p2p[own]
    truth = reference.vertices[_vertices(creatures, 0)[seen]]
    away = np.linalg.norm(reference.vertices[found] - truth, axis=1)[found >= 0]
    return away.mean() / np.sqrt(reference.area)


@pytest.mark.parametrize("kind", CUTS)
def test_parts_lie_on_the_shape_and_leave_the_share_of_the_area(kind, creatures):
    mesh = creatures.meshes[1]
    for seed in range(3):
        part = kind(0.5, 0.8).cut(mesh, np.random.default_rng(seed))
        near = ClosestPoints(mesh.vertices, mesh.faces).of(part.vertices)
        assert near.distances.max() < 1e-9 * np.sqrt(mesh.area)
        agree = np.einsum("na,na->n", near.normals, vertex_normals(part.vertices, part.faces))
        assert np.quantile(agree, 0.1) > 0.7
        low, high = (0.2, 1.0) if kind is ViewCut else (0.45, 0.85)
        assert low * mesh.area < part.area < high * mesh.area
        assert rim_length(part.vertices, part.faces) > 0


@pytest.mark.parametrize("kind", CUTS)
def test_a_seed_makes_one_part(kind, creatures):
    one, same, other = (
        kind().cut(creatures.meshes[1], np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    assert one.content_hash == same.content_hash != other.content_hash
    assert clone(kind(0.2, 0.3)).get_params() == {"low": 0.2, "high": 0.3}


def test_a_part_is_matched_and_says_what_it_shows(match, matcher, creatures, scan):
    seen, _ = shown(creatures, scan)
    covered = match.covered[_vertices(creatures, 0)]
    union = (covered & seen).sum() / (covered | seen).sum()
    assert union > max(0.8, 1.2 * seen.mean())  # to call everything covered has the latter
    assert error_of(match, creatures, scan) < 0.07
    assert match.familiar
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (plain,) = skfmap.match(matcher.estimator_, [scan])
    assert error_of(plain, creatures, scan) > 3 * error_of(match, creatures, scan)


def test_the_answer_is_whole(match, creatures, scan):
    n_i, n_0 = scan.n_vertices, creatures.meshes[0].n_vertices
    known = match.p2p >= 0
    assert match.p2p.shape == match.expected_error.shape == match.confidence.shape == (n_i,)
    assert match.covered.shape == match.covered_probability.shape == match.inverse.shape == (n_0,)
    assert np.array_equal(match.covered, match.covered_probability >= 0.5)
    assert np.array_equal(match.inverse >= 0, match.covered)
    assert np.array_equal(np.isfinite(match.expected_error), known)
    assert match.matrix.sum(axis=1) == pytest.approx(known.astype(float))
    carried = match.transfer(creatures.meshes[0].vertices)
    assert np.allclose(carried.data[known], creatures.meshes[0].vertices[match.p2p[known]])


def test_round_trips_of_what_is_covered_come_back(match, creatures):
    reference = creatures.meshes[0]
    at = np.flatnonzero(match.covered)
    back = match.p2p[match.inverse[at]]
    away = np.linalg.norm(reference.vertices[at] - reference.vertices[back], axis=1)
    assert np.median(away) < 0.05 * np.sqrt(reference.area)


def test_where_a_scan_is_and_how_it_is_turned_does_not_matter(matcher, match, scan):
    turned = Rotation.random(random_state=5).apply(scan.vertices.copy()) + np.array([100.0, -20, 3])
    (moved,) = skfmap.match(matcher, [Mesh(turned, scan.faces)])
    assert (moved.p2p == match.p2p).mean() > 0.95
    assert (moved.covered == match.covered).mean() > 0.98


def test_what_was_given_is_not_changed_and_answers_are_the_same_for_any_number_of_jobs(
    matcher, match, scan, creatures
):
    before = scan.content_hash
    first, second = skfmap.match(with_parameters(matcher, n_jobs=2), [scan, scan])
    for one in (first, second):
        assert np.array_equal(one.p2p, match.p2p)
        assert np.array_equal(one.covered_probability, match.covered_probability)
    assert scan.content_hash == before


def test_whole_shapes_are_answered_by_the_pipeline(matcher, creatures):
    whole = creatures.meshes[5]
    (one,), (other,) = (skfmap.match(model, [whole]) for model in (matcher, matcher.estimator_))
    assert np.array_equal(one.p2p, other.p2p)
    assert np.array_equal(one.functional_map, other.functional_map)
    assert one.covered.all()
    assert (one.covered_probability == 1).all()
    assert other.covered is None
    maps = skfmap.functional_maps(matcher, [whole])
    assert np.array_equal(maps[0], one.functional_map)
    assert np.array_equal(matcher.predict([whole])[0], one.reduced_map)


def test_matches_know_their_meshes_and_names_wherever_whole_shapes_stand(
    matcher, scan, creatures, tmp_path
):
    """Whole shapes go to the pipeline without the others, which must not be told from answers."""
    whole, reference = creatures.meshes[5], creatures.meshes[0]
    crumb = DiscCut(0.1, 0.1).cut(whole, np.random.default_rng(0))
    given = [scan, crumb, whole]
    with pytest.warns(SkippedShapeWarning, match=r"X\[1\]"):
        matches = skfmap.match(matcher, [(one.vertices, one.faces) for one in given])
    for i, (match, mesh) in enumerate(zip(matches, given, strict=True)):
        assert match.name == match.mesh.name == f"shape {i}"
        np.testing.assert_array_equal(match.mesh.vertices, mesh.vertices)
        np.testing.assert_array_equal(match.reference_mesh.vertices, reference.vertices)
        assert len(match.save(tmp_path)) == 5
    with np.load(tmp_path / "shape 0.npz", allow_pickle=False) as saved:
        np.testing.assert_array_equal(saved["covered"], matches[0].covered)
        np.testing.assert_array_equal(saved["covered_probability"], matches[0].covered_probability)


def test_warnings_of_whole_shapes_among_parts_count_as_x_does(matcher, scan, creatures):
    whole = creatures.meshes[5]
    loose = np.concatenate([whole.vertices, whole.vertices[:3] + 100 * np.ptp(whole.vertices)])
    n = whole.n_vertices
    broken = loose, np.concatenate([whole.faces, [[n, n + 1, n + 1]]])
    with pytest.warns(RepairWarning, match="shape 1"):
        part, found = skfmap.match(matcher, [(scan.vertices, scan.faces), broken])
    assert (part.name, found.name) == ("shape 0", "shape 1")
    assert found.covered.all()


def test_a_hole_as_small_as_an_eye_leaves_a_shape_whole(matcher, creatures):
    whole = creatures.meshes[5]
    holed = Mesh(whole.vertices, whole.faces[1:])
    assert skfmap.match(matcher, [holed])[0].covered.all()


def test_what_does_not_belong_to_the_body_is_told(matcher, match, scan):
    """A plate apart from the scan, has no answer, and does not change that of the scan.

    Pieces smaller than debris are not looked at, so it has a few per cent of the area.
    """
    side = 0.15 * np.sqrt(scan.area)
    plate = scan.vertices.max(axis=0) + side * np.array(
        [[6.0, 6, 6], [7, 6, 6], [7, 7, 6], [6, 7, 6], [6.5, 6.5, 6]]
    )
    n = scan.n_vertices
    faces = n + np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    both = Mesh(np.concatenate([scan.vertices, plate]), np.concatenate([scan.faces, faces]))
    (found,) = skfmap.match(matcher, [both])
    assert (found.p2p[n:] == -1).all()
    assert np.isnan(found.expected_error[n:]).all()
    assert (found.p2p[:n] == match.p2p).mean() > 0.5
    assert (found.covered == match.covered).mean() > 0.9


def test_a_part_that_is_too_small_is_told_and_not_matched(matcher, creatures, scan):
    crumb = DiscCut(0.1, 0.1).cut(creatures.meshes[5], np.random.default_rng(0))
    with pytest.warns(SkippedShapeWarning, match=r"X\[1\] .*too little to say where it belongs"):
        fine, nothing = skfmap.match(matcher, [scan, crumb])
    assert (fine.p2p >= 0).any()
    assert (nothing.p2p == -1).all()
    assert not nothing.covered.any()
    assert np.isnan(nothing.covered_probability).all()


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (1000.0, "1000 times smaller would explain that: multiply its coordinates by 0.001"),
        (0.01, "100 times larger would explain that: multiply its coordinates by 100"),
        (25.4, "25.4 times smaller"),
        (4.0, "in the units of the training shapes"),
    ],
)
def test_other_units_are_told_and_what_to_multiply_by(matcher, scan, factor, told):
    with pytest.warns(SkippedShapeWarning, match=told):
        skfmap.match(matcher, [Mesh(factor * scan.vertices, scan.faces)])


def test_a_flake_of_no_size_is_no_whole_shape(matcher, scan):
    """Its rim is short, but long for its area."""
    flake = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]) * 0.02 * np.sqrt(scan.area)
    with pytest.warns(SkippedShapeWarning, match="too little"):
        (nothing,) = skfmap.match(matcher, [(flake, np.array([[0, 1, 2]]))])
    assert (nothing.p2p == -1).all()


def test_another_kind_of_body_is_told(matcher, collection, creatures):
    body = collection.meshes[1]
    scale = np.sqrt(creatures.meshes[0].area / body.area)
    strange = PlaneCut(0.7, 0.7).cut(
        Mesh(scale * body.vertices, body.faces, "bumpy"), np.random.default_rng(0)
    )
    with pytest.warns(UnfamiliarShapeWarning, match=r"X\[0\] \('bumpy'\)"):
        (found,) = skfmap.match(matcher, [strange])
    assert found.familiar is False


def test_fine_scans_of_several_pieces_are_thinned(matcher, match, scan):
    """Each triangle is cut in four, and an end of the scan is cut off."""
    fine = trimesh.remesh.subdivide(scan.vertices, scan.faces)
    n, low = len(fine[0]), np.quantile(scan.vertices[:, 0], 0.3)
    cut = (fine[0][fine[1], 0] < low).sum(axis=1)
    faces = fine[1][(cut == 0) | (cut == 3)]
    thin = scan_of(fine[0], faces, matcher.unit_, n // 4)
    assert len(thin.vertices) <= n // 4 + 40
    assert count_components(thin.faces, len(thin.vertices)) >= 2
    near = ClosestPoints(scan.vertices / matcher.unit_, scan.faces).of(thin.vertices)
    assert near.distances.max() < 0.03
    assert thin.from_rim.max() < np.inf
    assert len(scan_of(fine[0], faces, matcher.unit_, None).vertices) > 0.9 * n


def test_models_survive_files(matcher, match, scan, tmp_path):
    path = tmp_path / "model.skops"
    save_model(matcher, path)
    for again in (load_model(path), pickle.loads(pickle.dumps(matcher))):
        (found,) = skfmap.match(again, [scan])
        assert np.array_equal(found.p2p, match.p2p)
        assert np.array_equal(found.expected_error, match.expected_error)


def test_two_parts_are_matched_through_the_reference(matcher, match, creatures):
    other = PlaneCut(0.7, 0.7).cut(creatures.meshes[1], np.random.default_rng(4))
    (second,) = skfmap.match(matcher, [other])
    p2p, expected = match.to(second)
    known = p2p >= 0
    assert (second.covered[match.p2p[known]]).all()
    assert np.array_equal(np.isfinite(expected), known)


@pytest.fixture(scope="module")
def three(creatures, scan):
    """Return two parts and a whole shape, of three creatures."""
    other = PlaneCut(0.7, 0.7).cut(creatures.meshes[1], np.random.default_rng(4))
    return [scan, other, creatures.meshes[2]]


@pytest.fixture(scope="module")
def between(matcher, three):
    pairs = [(0, 1), (1, 0), (0, 2), (2, 0), (1, 1), (2, 2)]
    return dict(zip(pairs, skfmap.match_between(matcher, three, pairs), strict=True))


@pytest.mark.parametrize("pair", [(0, 1), (0, 2)])
def test_pairs_of_parts_go_both_ways(pair, between, three):
    """What one way is the inverse of the other, and each tells what the other shows of it."""
    i, j = pair
    there, back = between[i, j], between[j, i]
    assert (len(there.p2p), len(there.covered)) == (three[i].n_vertices, three[j].n_vertices)
    assert np.array_equal(there.inverse, back.p2p)
    assert np.array_equal(there.covered, back.p2p >= 0)
    assert np.array_equal(back.covered, there.p2p >= 0)
    known = there.p2p >= 0
    assert 0.2 < known.mean() <= 1
    assert there.matrix.sum(axis=1) == pytest.approx(known.astype(float))
    at = three[j].vertices
    again = np.flatnonzero(known & back.covered)
    assert np.array_equal(there.mesh.vertices, three[i].vertices)
    assert np.array_equal(there.reference_mesh.vertices, at)
    assert there.reference_hash == three[j].content_hash
    middle = np.linalg.norm(
        three[i].vertices[again] - three[i].vertices[back.p2p[there.p2p[again]]], axis=1
    )
    assert np.nanmedian(middle) < 0.06 * np.sqrt(three[i].area)


@pytest.mark.parametrize(("pair", "own", "other"), [((0, 1), 5, 1), ((1, 0), 1, 5), ((0, 2), 5, 2)])
def test_pairs_of_parts_agree_with_the_truth_and_not_worse_than_over_the_reference(
    pair, own, other, between, three, creatures, matcher
):
    at, there = (creatures.meshes[k].vertices[_vertices(creatures, k)] for k in (own, other))
    unit, (i, j) = np.sqrt(creatures.meshes[0].area), pair
    away, rows = cKDTree(three[i].vertices).query(at)
    shown = away < 0.02 * unit
    shown &= cKDTree(three[j].vertices).query(there)[0] < 0.02 * unit
    rows, truth = rows[shown], there[shown]

    def error(p2p):
        found = p2p[rows]
        gaps = np.linalg.norm(three[j].vertices[found] - truth, axis=1)[found >= 0]
        return gaps.mean() / unit, (found >= 0).mean()

    match = between[pair]
    gap, answered = error(match.p2p)
    one, two = skfmap.match(matcher, [three[i], three[j]])
    over, _ = error(one.to(two)[0])
    assert answered > 0.8
    assert gap < 0.09
    assert gap < 1.05 * over


def test_a_part_to_itself_and_whole_shapes_to_whole_ones(between, three, matcher):
    itself, whole = between[1, 1], between[2, 2]
    known = itself.p2p >= 0
    assert known.mean() > 0.9
    assert np.array_equal(itself.p2p[known], np.flatnonzero(known))
    assert (itself.expected_error[known] == 0).all()
    (alone,) = skfmap.match_between(matcher.estimator_, three[2:], [(0, 0)])
    assert np.array_equal(whole.p2p, alone.p2p)
    assert np.array_equal(whole.functional_map, alone.functional_map)
    assert whole.covered.all()


def test_pairs_with_what_cannot_be_matched_are_told_once(matcher, three, creatures):
    crumb = DiscCut(0.1, 0.1).cut(creatures.meshes[5], np.random.default_rng(0))
    with pytest.warns(SkippedShapeWarning, match=r"X\[1\]") as told:
        there, back, fine = skfmap.match_between(
            matcher, [three[0], crumb, three[1]], [(0, 1), (1, 0), (0, 2)]
        )
    assert len(told) == 1
    for match in (there, back):
        assert (match.p2p == -1).all()
        assert not match.covered.any()
        assert np.isnan(match.covered_probability).all()
    assert (len(there.covered), len(back.covered)) == (crumb.n_vertices, three[0].n_vertices)
    assert (fine.p2p >= 0).any()


def test_pairs_of_no_indices_are_refused(matcher, scan):
    with pytest.raises(ValueError, match="each index of pairs"):
        skfmap.match_between(matcher, [scan], [(0, 1)])


class _Half(Cut):
    def part(self, vertices, faces, share, rng):
        height = vertices[faces, 2].mean(axis=1)
        return vertices, faces[height <= np.quantile(height, share)]


@pytest.mark.parametrize("wrong", [{"refine": "bogus"}, {"interpolate": "bogus"}])
def test_words_of_a_match_are_checked_where_all_are_parts(wrong, matcher, scan):
    with pytest.raises(ValueError, match=f"{next(iter(wrong))} must be one of"):
        matcher.match([scan], **wrong)


def test_the_reference_is_laid_onto_a_part(matcher, match, scan, creatures):
    reference = creatures.meshes[0]
    (laid,) = skfmap.register(matcher, [scan])
    assert laid.fits
    assert np.array_equal(laid.faces, reference.faces)
    near = ClosestPoints(scan.vertices, scan.faces).of(laid.vertices)
    assert np.allclose(near.distances, laid.distance)
    unit = np.sqrt(reference.area)
    assert laid.distance[match.covered].mean() < 0.02 * unit < laid.distance[~match.covered].mean()
    # What is not scanned lies where the creature is.
    hidden = ~shown(creatures, scan)[0]
    at = creatures.meshes[5].vertices[_vertices(creatures, 5)]
    gaps = np.linalg.norm(laid.vertices[_vertices(creatures, 0)] - at, axis=1) / unit
    assert gaps[hidden].mean() < 0.15
    assert laid.mesh.name == scan.name


def test_laid_meshes_turn_with_the_scan(matcher, scan):
    turn = Rotation.random(random_state=2).as_matrix()
    moved = Mesh(scan.vertices @ turn.T + 7.0, scan.faces)
    one, other = skfmap.register(matcher, [scan, moved])
    gaps = np.linalg.norm(one.vertices @ turn.T + 7.0 - other.vertices, axis=1)
    assert np.median(gaps) < 0.01 * np.sqrt(scan.area)


def test_whole_shapes_are_registered_by_the_pipeline_or_it_is_told(matcher, scan, creatures):
    with pytest.raises(ValueError, match="refine='register'"):
        skfmap.register(matcher, [scan, creatures.meshes[5]])
    crumb = DiscCut(0.1, 0.1).cut(creatures.meshes[5], np.random.default_rng(0))
    with pytest.warns(SkippedShapeWarning, match=r"X\[0\]"):
        (nothing,) = skfmap.register(matcher, [crumb])
    assert np.isnan(nothing.vertices).all()
    assert not nothing.fits


def with_parameters(matcher, **given):
    """Return a fitted matcher with other parameters, of those that fit does not look at."""
    again = clone(matcher).set_params(**given)
    again.__dict__.update({k: v for k, v in vars(matcher).items() if k.endswith("_")})
    return again


def test_faces_that_are_wound_inwards_are_told_and_turned(matcher, match, scan):
    with pytest.warns(OrientationWarning, match=r"wound inwards on X\[1\]"):
        right, turned = skfmap.match(matcher, [scan, Mesh(scan.vertices, scan.faces[:, ::-1])])
    for found in (right, turned):
        assert np.array_equal(found.p2p, match.p2p)
        assert np.array_equal(found.covered, match.covered)
    assert turned.familiar


@pytest.mark.parametrize("factor", [0.001, 40.0])
def test_the_scale_of_a_scan_is_estimated_with_its_map(factor, matcher, match, scan, creatures):
    anything = with_parameters(matcher, scale="estimated")
    (found,) = skfmap.match(anything, [Mesh(factor * scan.vertices, scan.faces)])
    assert found.scale * factor == pytest.approx(1, abs=0.12)
    assert found.familiar
    assert error_of(found, creatures, scan) < 1.5 * error_of(match, creatures, scan) + 0.01
    (laid,) = skfmap.register(anything, [Mesh(factor * scan.vertices, scan.faces)])
    assert laid.distance[found.covered].mean() < 0.02 * factor * np.sqrt(creatures.meshes[0].area)


def test_whole_shapes_in_other_units_need_no_estimate(matcher, creatures):
    whole = creatures.meshes[5]
    for model in (matcher, with_parameters(matcher, scale="estimated")):
        (found,) = skfmap.match(model, [Mesh(1000 * whole.vertices, whole.faces)])
        assert found.covered.all()
        assert found.scale is None


@pytest.mark.parametrize(("usual", "wanted"), [(-3.0, [False, True]), (-20.0, [False, False])])
def test_only_scans_below_the_usual_score_are_reversed(usual, wanted, scan, matcher, monkeypatch):
    def score(_, one):
        return -4.0 - 8.0 * (not np.array_equal(one.faces, scan.faces))

    monkeypatch.setattr("skfmap.partial.winding.score_of", score)
    scans = [Scan(scan.vertices, scan.faces), Scan(scan.vertices, scan.faces[:, ::-1])]
    assert [is_inside_out(matcher.body_, one, usual) for one in scans] == wanted


@pytest.fixture(scope="module")
def measuring(creatures, pipeline):
    """Return a matcher that learned measured points."""
    pipeline = clone(pipeline).set_params(weightedfunctionalmaplearner__n_functions=12)
    model = PartialMatcher(pipeline, cuts=["planes", "limbs"], n_cuts=2, n_calibrated=1)
    return model.fit(creatures.meshes[:4], [marks_of(creatures, i) for i in range(4)])


def marks_of(creatures, i):
    at = creatures.meshes[i].vertices[_vertices(creatures, i)[::4]]
    return skfmap.Correspondence.from_points(at, creatures.meshes[i])


def test_landmarks_are_placed_where_a_part_shows_them(measuring, scan, creatures):
    found, whole = skfmap.predict_landmarks(measuring, [scan, creatures.meshes[5]])
    seen, at = (rows[::4] for rows in shown(creatures, scan))
    placed = found.placed
    assert (placed == seen).mean() > 0.8
    unit = np.sqrt(creatures.meshes[0].area)
    both = placed & seen
    gaps = np.linalg.norm(found.points[both] - at[both], axis=1)
    assert gaps.mean() < 0.1 * unit
    assert 0.3 < found.expected_error[both].mean() / gaps.mean() < 3
    assert np.isnan(found.expected_error[~placed]).all()
    (alone,) = skfmap.predict_landmarks(measuring.estimator_, [creatures.meshes[5]])
    np.testing.assert_array_equal(whole.points, alone.points)


def test_landmarks_need_measured_points_also_where_all_are_parts(matcher, scan):
    with pytest.raises(ValueError, match="fitted with measured points"):
        skfmap.predict_landmarks(matcher, [scan])


@pytest.mark.parametrize(("covered", "what"), [(True, "nothing of"), (False, "all of")])
def test_cuts_that_remove_nothing_or_all_are_an_error(covered, what):
    with pytest.raises(ValueError, match=f"The cuts removed {what} the training shapes"):
        _coverage_model(np.zeros((5, 3)), np.full(5, covered))


def test_cuts_of_ones_own(creatures, pipeline):
    part = _Half(0.5, 0.5).cut(creatures.meshes[1], np.random.default_rng(0))
    assert 0.3 < part.area / creatures.meshes[1].area < 0.7
    model = PartialMatcher(pipeline, cuts=[_Half(), "discs"])
    assert [type(one) for one in model._check_parameters()] == [_Half, DiscCut]


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"cuts": "slices"}, ValueError, "cuts must be one of 'planes'"),
        ({"cuts": PlaneCut}, ValueError, r"Did you mean PlaneCut\(\)"),
        ({"cuts": PlaneCut(0.9, 0.4)}, ValueError, "high"),
        ({"cuts": []}, ValueError, "cuts must be"),
        ({"n_cuts": 0}, ValueError, "n_cuts"),
        ({"scale": "millimetres"}, ValueError, "scale must be one of 'estimated', 'known'"),
        ({"n_calibrated": 13}, ValueError, "n_calibrated"),
        ({"estimator": skfmap.WeightedFunctionalMapLearner()}, TypeError, "must be a Pipeline"),
        (
            {"estimator": make_pipeline("passthrough", skfmap.WeightedFunctionalMapLearner())},
            TypeError,
            "the first step of estimator must be a SpectralBasis",
        ),
    ],
)
def test_wrong_parameters(given, error, message, creatures, pipeline):
    model = PartialMatcher(**{"estimator": pipeline, **given})
    with pytest.raises(error, match=message):
        model.fit(creatures.meshes[:4], creatures.correspondences[:4])


def test_too_few_shapes(creatures, pipeline):
    with pytest.raises(ValueError, match="needs the reference and two more"):
        PartialMatcher(pipeline).fit(creatures.meshes[:2], creatures.correspondences[:2])


def test_three_shapes_are_few_and_a_weight_of_nothing_leaves_one_out(creatures, pipeline, scan):
    model = PartialMatcher(pipeline, cuts="planes", n_cuts=1, n_calibrated=1)
    with pytest.warns(StabilityWarning, match="from 2 shapes besides the reference") as told:
        model.fit(creatures.meshes[:4], creatures.correspondences[:4], [0, 1, 0, 1])
    assert len(told) == 1
    assert len(model.areas_) == 3
    (match,) = skfmap.match(model, [scan])
    assert match.reference_name == creatures.meshes[0].name
    assert 0.3 < match.covered.mean() < 0.9


def test_distances_correct_what_surroundings_get_wrong(creatures):
    """A third of the points are told a wrong region; distances to the others put them right."""
    mesh, rng = creatures.meshes[0], np.random.default_rng(0)
    unit = np.sqrt(mesh.area)
    rows = farthest_points(mesh.vertices, 80)
    apart = edge_path_distances(mesh.vertices / unit, mesh.faces, rows)[:, rows]
    at = mesh.vertices[rows] / unit
    straight = np.linalg.norm(at[:, None] - at[None], axis=2)
    told = np.arange(80)
    wrong = rng.permutation(80)[:27]
    told[wrong] = rng.permutation(told[wrong])
    logarithms = np.full((80, 80), -4.0, dtype=np.float32)
    logarithms[np.arange(80), told] = -0.5
    among = straight, np.zeros_like(straight)
    best, _ = hypotheses(logarithms, apart[:, :40], straight[:, :40], apart, among, 2)[:2]
    found = best.beliefs.argmax(axis=1)
    assert apart[told, np.arange(80)].mean() > 0.15
    assert apart[found, np.arange(80)].mean() < 0.03
    assert best.beliefs.sum(axis=1) == pytest.approx(1.0, abs=1e-5)


def test_how_far_pieces_are_apart_tells_the_side_that_surroundings_leave_open():
    """Regions 0 to 3 are a trunk, 4 to 7 a hand near one end of it, 8 to 11 one near the other."""
    line = np.arange(4) * 0.06
    at = np.concatenate(
        [
            np.column_stack([line, np.zeros(4)]),
            np.column_stack([np.zeros(4), 0.2 + line]),
            np.column_stack([np.full(4, 0.6), 0.2 + line]),
        ]
    )
    apart = np.linalg.norm(at[:, None] - at[None], axis=2)
    along = np.where(np.eye(3, dtype=bool).repeat(4, 0).repeat(4, 1), apart, apart + 0.3)
    for hand in (4, 8):
        shown = np.r_[0:4, hand : hand + 4]
        logarithms = np.full((8, 12), -8.0, dtype=np.float32)
        logarithms[np.arange(4), np.arange(4)] = 0
        for side in (4, 8):
            logarithms[4 + np.arange(4), side + np.arange(4)] = -0.7
        scanned = along[np.ix_(shown, shown)].copy()
        scanned[:4, 4:] = scanned[4:, :4] = np.inf
        lines = apart, np.zeros_like(apart)
        (found,) = hypotheses(logarithms, scanned, apart[np.ix_(shown, shown)], along, lines, 1)
        assert np.array_equal(found.beliefs.argmax(axis=1), shown)


def test_what_is_believed_elsewhere_is_not_drawn():
    """Of two balls in one place the part shows one, which is drawn to it; the other stays."""
    ball, faces = subdivided_octahedron(3)
    ball, n = 0.1 * ball, len(ball)
    aside, off = np.array([0.5, 0, 0]), np.array([0.03, 0, 0])
    vertices_0 = np.concatenate([ball - aside, ball + aside])
    both = np.concatenate([faces, faces + n])
    start = np.concatenate([ball, ball]) + off
    places = vertices_0[:n]
    laid = lay_on_part(
        Deformation.of_reference(vertices_0, both),
        both,
        np.ones(2 * n),
        vertices_0,
        (ball, faces),
        places,
        start,
        stiffness=0.3,
        n_rounds=4,
    )
    assert np.linalg.norm(laid[:n], axis=1) == pytest.approx(0.1, abs=0.004)
    assert laid[n:] == pytest.approx(start[n:], abs=1e-6)
