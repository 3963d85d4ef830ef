"""Parts of meshes, and what the surroundings of their points look like."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skfmap.datasets import make_sphere
from skfmap.geometry.cutting import (
    clip,
    keep_faces,
    rim_length,
    smooth_mask,
    visible_faces,
    without_crumbs,
)
from skfmap.geometry.faults import boundary_pieces, count_components, nonmanifold_edges
from skfmap.geometry.local_features import local_features, rim_distances

SCALES = (0.1, 0.2, 0.3)


def area_of(vertices, faces):
    a, b, c = (vertices[faces[:, j]] for j in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


@pytest.fixture(scope="module")
def ball():
    mesh = make_sphere(n_subdivisions=4)
    return mesh.vertices, mesh.faces


def test_the_two_sides_of_a_plane_make_the_whole(ball):
    rng = np.random.default_rng(0)
    for _ in range(5):
        heights = ball[0] @ rng.normal(size=3) - rng.uniform(-0.5, 0.5)
        sides = [clip(*ball, heights), clip(*ball, -heights)]
        assert sum(area_of(*side) for side in sides) == pytest.approx(area_of(*ball), rel=1e-12)
        for side in sides:
            assert not len(nonmanifold_edges(side[1]))
            assert len(boundary_pieces(side[1])) == 1
            assert np.linalg.norm(side[0], axis=1).max() <= 1 + 1e-12  # on edges, not beyond


def test_a_cap_has_the_area_of_archimedes_and_the_rim_of_its_circle(ball):
    vertices, faces = clip(*ball, ball[0] @ [0.36, 0.48, 0.8] - 0.3)
    assert area_of(vertices, faces) == pytest.approx(2 * np.pi * 0.7, rel=0.02)
    assert rim_length(vertices, faces) == pytest.approx(2 * np.pi * np.sqrt(1 - 0.09), rel=0.02)
    assert (vertices @ [0.36, 0.48, 0.8]).min() > 0.3 - 0.01
    assert rim_length(*ball) == 0.0


def test_clipping_keeps_the_winding(ball):
    vertices, faces = clip(*ball, ball[0] @ [0.1, -0.7, 0.3] + 0.2)
    a, b, c = (vertices[faces[:, j]] for j in range(3))
    assert (np.einsum("na,na->n", np.cross(b - a, c - a), a + b + c) > 0).all()


def test_of_a_convex_body_all_is_seen_that_is_turned_to_the_scanner(ball):
    vertices, faces = ball
    towards = np.array([0.6, 0.0, 0.8])
    cosines = vertices[faces].mean(axis=1) @ towards
    cosines /= np.linalg.norm(vertices[faces].mean(axis=1), axis=1)
    seen = visible_faces(vertices, faces, 3 * towards, grazing=0.3)
    assert seen[cosines > 0.32].all()
    assert not seen[cosines < 0.28].any()


def test_what_is_behind_something_is_not_seen(ball):
    vertices = np.concatenate([ball[0], 0.5 * ball[0] + [0, 0, -3], 0.5 * ball[0] + [3, 0, -3]])
    faces = np.concatenate([ball[1] + n * len(ball[0]) for n in range(3)])
    hidden, beside = visible_faces(vertices, faces, np.array([0.0, 0, 1]))[len(ball[1]) :].reshape(
        2, -1
    )
    assert not hidden.any()
    assert beside.mean() == pytest.approx(0.4, abs=0.05)  # but for what is seen at a grazing angle


def test_crumbs_go_and_the_largest_piece_stays(ball):
    vertices = np.concatenate([ball[0], 0.1 * ball[0] + 5, 0.5 * ball[0] - 5])
    faces = np.concatenate([ball[1] + n * len(ball[0]) for n in range(3)])
    kept = without_crumbs(vertices, faces, 0.1 * area_of(*ball))
    assert count_components(kept[1], len(kept[0])) == 2
    alone = without_crumbs(vertices, faces, 100.0)
    assert area_of(*alone) == pytest.approx(area_of(*ball))


def test_a_mask_is_positive_within_and_negative_outside(ball):
    inside = ball[0][ball[1]].mean(axis=1)[:, 2] > 0
    level = smooth_mask(ball[1], len(ball[0]), inside)
    assert (level[ball[0][:, 2] > 0.15] > 0).all()
    assert (level[ball[0][:, 2] < -0.15] < 0).all()
    assert level[ball[0][:, 2] > 0.8] == pytest.approx(0.5)


def test_distances_from_the_rim(ball):
    assert np.isinf(rim_distances(*ball)).all()
    half = clip(*ball, ball[0][:, 2] - 1e-3)
    pole = rim_distances(*half)[half[0][:, 2].argmax()]
    assert np.pi / 2 - 0.01 < pole < 1.15 * np.pi / 2


def bumpy(ball):
    """Return a surface without any symmetry."""
    x, y, z = ball[0].T
    height = 1 + 0.3 * np.exp(3 * (x + 0.3 * y - 1)) + 0.4 * np.exp(4 * (0.6 * y - 0.8 * z - 1))
    return ball[0] * (height + 0.2 * x * y)[:, None] * [1.3, 1.0, 0.8]


def test_features_do_not_change_as_a_shape_is_moved_or_scaled(ball):
    vertices = bumpy(ball)
    before = local_features(vertices, ball[1], SCALES, 0.5)
    moved = Rotation.random(random_state=3).apply(vertices) + np.array([3.0, -2, 5])
    assert np.abs(local_features(moved, ball[1], SCALES, 0.5) - before).max() < 1e-6
    larger = local_features(5 * vertices, ball[1], [5 * scale for scale in SCALES], 2.5)
    assert np.abs(larger - before).max() < 1e-6


def test_features_tell_a_shape_from_its_mirror_image_and_only_by_turns(ball):
    vertices = bumpy(ball)
    before = local_features(vertices, ball[1], SCALES, 0.5)
    image = local_features(vertices * [-1, 1, 1], ball[1][:, [0, 2, 1]], SCALES, 0.5)
    odd = np.abs(image + before).max(axis=0) < 1e-6
    even = np.abs(image - before).max(axis=0) < 1e-6
    assert (odd | even).all()
    assert (odd & ~even).sum() >= 3


def test_features_are_local(ball):
    vertices = bumpy(ball)
    whole = local_features(vertices, ball[1], SCALES, 0.5)
    kept = vertices[ball[1]][:, :, 0].min(axis=1) > -0.5
    part = local_features(*keep_faces(vertices, ball[1], kept), SCALES, 0.5)
    used = np.unique(ball[1][kept])
    far = vertices[used, 0] > 1.2
    spread = whole.std(axis=0) + 0.01
    assert far.sum() > 20
    changes = np.abs(part - whole[used]) / spread
    assert np.quantile(changes[far], 0.99) < 0.05
    assert np.quantile(changes[vertices[used, 0] < -0.3], 0.5) > 0.1  # there the cut is seen
