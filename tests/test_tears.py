"""Where the map of a scan tears, as where parts of it are glued."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import PartialMatcher
from skfmap.datasets import make_creatures
from skfmap.exceptions import UnfamiliarShapeWarning
from skfmap.geometry.geodesics import edge_path_distances
from skfmap.partial.body import shared_regions
from skfmap.partial.glue import tears_of_wholes, torn_vertices, warn_of_tears, with_tears
from skfmap.partial.tears import faces_with_edges, sizes_of_tears, without_islands

N_LONG, N_WIDE, STEP = 41, 11, 0.05


def strip():
    """Return a strip of area 1 and its faces; vertex (i, j) has the number i * N_WIDE + j."""
    i, j = (grid.ravel() for grid in np.mgrid[:N_LONG, :N_WIDE])
    vertices = np.column_stack([STEP * i, STEP * j, np.zeros(len(i))])
    corner = (np.arange(N_LONG - 1)[:, None] * N_WIDE + np.arange(N_WIDE - 1)).ravel()
    return vertices, np.concatenate([joined(corner, corner + N_WIDE)])


def joined(one, other):
    """Return two triangles between each (one, one + 1) and (other, other + 1)."""
    return np.concatenate(
        [np.column_stack([one, other, other + 1]), np.column_stack([one, other + 1, one + 1])]
    )


def folded(vertices):
    """Return the strip folded in the middle: two parallel planes, a step apart."""
    x, y, _ = vertices.T
    around = np.clip(x - (1 - STEP / 2), 0, STEP)
    return np.column_stack([np.where(x > 1, 2 - x, x), y, around])


@pytest.fixture(scope="module")
def regions():
    vertices, faces = strip()
    return shared_regions(vertices, faces, np.full(len(vertices), 1 / len(vertices)))


@pytest.fixture(scope="module")
def glued():
    """Return the folded strip, whose planes are joined across the gap, and what is joined."""
    vertices, faces = strip()
    rows = np.arange(N_WIDE - 1)
    bridge = joined(4 * N_WIDE + rows, (N_LONG - 5) * N_WIDE + rows)
    torn = np.isin(np.arange(len(vertices)), bridge)
    return folded(vertices), np.concatenate([faces, bridge]), torn


def test_two_planes_glued_at_a_known_place_tear_exactly_there(regions, glued):
    vertices, faces, torn = glued
    identity = np.arange(len(vertices))
    assert torn.sum() == 2 * N_WIDE
    assert np.array_equal(torn_vertices(regions, vertices, faces, identity), torn)
    unanswered = np.where(torn, -1, identity)  # nothing is known of the glue
    assert not torn_vertices(regions, vertices, faces, unanswered).any()


def test_a_smooth_map_does_not_tear(regions):
    vertices, faces = strip()
    identity = np.arange(len(vertices))
    for placed in (vertices, folded(vertices), vertices * [0.7, 1.4, 1]):
        assert not torn_vertices(regions, placed, faces, identity).any()
    i, j = np.divmod(identity, N_WIDE)
    mirrored = (N_LONG - 1 - i) * N_WIDE + j
    assert not torn_vertices(regions, vertices, faces, mirrored).any()
    doubled = np.minimum(2 * i, N_LONG - 1) * N_WIDE + j
    assert not torn_vertices(regions, vertices, faces, doubled).any()


def test_single_vertices_answered_wrongly_are_noise_and_a_wrong_half_is_not(regions):
    vertices, faces = strip()
    answers = np.arange(len(vertices))
    answers[10 * N_WIDE + 5] = len(vertices) - 1
    answers[N_WIDE * 30] = 0
    assert not torn_vertices(regions, vertices, faces, answers).any()
    i, j = np.divmod(np.arange(len(vertices)), N_WIDE)
    swapped = np.where(i <= 20, 20 - i, i) * N_WIDE + j  # the first half is turned about
    torn = torn_vertices(regions, vertices, faces, swapped)
    assert np.array_equal(np.flatnonzero(torn), np.flatnonzero((i == 20) | (i == 21)))


@pytest.mark.parametrize("seed", [0, 1])
def test_tears_follow_renumbering_and_ignore_rotation(seed, regions, glued):
    vertices, faces, torn = glued
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(vertices))
    number = np.argsort(order)
    shuffled = number[faces][rng.permutation(len(faces))]
    turned = Rotation.random(random_state=seed).apply(vertices[order]) + rng.normal(size=3)
    assert np.array_equal(torn_vertices(regions, turned, shuffled, order), torn[order])


def test_the_size_of_a_tear_is_how_many_vertices_have_to_move():
    star = np.column_stack([np.zeros(9, dtype=int), np.arange(1, 10)])
    ladder = np.column_stack([np.arange(10, 17), np.arange(20, 27)])
    linked = np.concatenate([ladder, np.column_stack([np.arange(10, 16), np.arange(21, 27)])])
    edges = np.concatenate([star, linked])
    sizes = sizes_of_tears(edges, 30)
    assert (sizes[: len(star)] == 1).all()
    assert (sizes[len(star) :] == 7).all()
    order = np.random.default_rng(0).permutation(len(edges))
    assert np.array_equal(sizes_of_tears(edges[order][:, ::-1], 30), sizes[order])
    assert len(sizes_of_tears(edges[:0], 30)) == 0


def test_islands_take_the_answers_of_the_shore():
    vertices = np.arange(5.0)[:, None] * [1, 0, 0]
    edges = np.column_stack([np.arange(4), np.arange(1, 5)])
    is_torn = np.array([False, True, True, False])
    filled = without_islands(vertices, np.ones(5), edges, is_torn, np.array([7, 7, 3, 8, 8]), 1.5)
    assert filled[2] in (7, 8)
    assert filled[[0, 1, 3, 4]].tolist() == [7, 7, 8, 8]


def test_faces_are_found_by_their_edges_whichever_way_these_run():
    faces = np.array([[0, 1, 2], [2, 1, 3], [3, 4, 2]])
    assert faces_with_edges(faces, np.array([[2, 1]]), 5).tolist() == [True, True, False]
    assert not faces_with_edges(faces, np.array([[0, 4]]), 5).any()


@pytest.fixture(scope="module")
def creatures():
    return make_creatures(n_shapes=5, n_vertices=500, n_points=300)


@pytest.fixture(scope="module")
def matcher(creatures):
    """Return a fitted matcher; do not fit it again or change it."""
    pipeline = make_pipeline(
        skfmap.SpectralBasis(40),
        skfmap.DescriptorTransformer(),
        skfmap.WeightedFunctionalMapLearner(n_functions=20, confidence=None),
    )
    model = PartialMatcher(pipeline, cuts=["planes"], n_cuts=2, n_calibrated=1)
    return model.fit(creatures.meshes[:4], creatures.correspondences[:4])


def test_sound_whole_shapes_are_answered_as_before_and_do_not_tear(matcher, creatures):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        matches = skfmap.match(matcher, creatures.meshes)
        plain = skfmap.match(matcher.estimator_, creatures.meshes)
    for one, other in zip(matches, plain, strict=True):
        assert not one.torn.any()
        assert len(one.torn) == len(one.p2p)
        assert other.torn is None
        assert np.array_equal(one.p2p, other.p2p)


def test_units_of_whole_shapes_do_not_matter_for_tears(matcher, creatures):
    mesh, known = creatures.meshes[4], matcher._knowledge()
    (match,) = skfmap.match(matcher.estimator_, [mesh])
    i, across = np.arange(mesh.n_vertices), mesh.vertices[:, 0] < np.median(mesh.vertices[:, 0])
    wrong = replace(match, p2p=np.where(across, match.p2p[0], match.p2p[i[::-1]]))
    told = {}
    for scale in (1.0, 1000.0):
        larger = skfmap.Mesh(scale * mesh.vertices, mesh.faces)
        told[scale] = tears_of_wholes(known, [larger], {0: wrong})
        assert told[scale][1] == [0]
    assert np.array_equal(told[1.0][0][0].torn, told[1000.0][0][0].torn)


def test_what_lies_on_a_tear_is_told_and_not_trusted(matcher, creatures):
    mesh, known = creatures.meshes[4], matcher._knowledge()
    scan = skfmap.partial.PlaneCut(0.8, 0.8).cut(mesh, np.random.default_rng(0))
    (match,) = skfmap.match(matcher, [scan])
    along = scan.vertices[:, 0]
    reference = creatures.meshes[0]
    far = int(edge_path_distances(reference.vertices, reference.faces, np.array([0]))[0].argmax())
    p2p = np.where(along < np.median(along), 0, far)  # two places alone
    told = with_tears(known, scan.vertices, scan.faces, matcher.unit_, replace(match, p2p=p2p))
    crossing = scan.faces[np.ptp(p2p[scan.faces], axis=1) > 0]
    assert told.torn.any()
    assert np.isin(np.flatnonzero(told.torn), crossing).all()  # but islands
    assert told.familiar is False
    assert (told.confidence[told.torn] <= 0.5).all()
    way = matcher.body_.regions.ways(np.array([0]), np.array([far]))[0]
    assert (told.expected_error[told.torn] > way / 2 - 0.1).all()
    same = ~told.torn
    np.testing.assert_array_equal(told.expected_error[same], match.expected_error[same])
    blank = np.flatnonzero(told.torn)[:1]
    blank = np.append(blank, np.flatnonzero(same)[:1])
    unknown = np.isin(np.arange(len(p2p)), blank)
    without = replace(
        match,
        p2p=np.where(unknown, -1, p2p),
        expected_error=np.where(unknown, np.nan, match.expected_error),
        confidence=np.where(unknown, np.nan, match.confidence),
    )
    still = with_tears(known, scan.vertices, scan.faces, matcher.unit_, without)
    assert still.torn.any()
    assert np.array_equal(np.isnan(still.expected_error), np.isnan(without.expected_error))
    assert np.array_equal(np.isnan(still.confidence), np.isnan(without.confidence))
    with pytest.warns(UnfamiliarShapeWarning, match=f"{told.torn.sum()} vertices"):
        warn_of_tears({0: told})
