"""What is mended is a closed surface again where it was one, and nothing is joined that was not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skfmap import check_mesh, repair_mesh
from skfmap.datasets import make_creatures, make_sphere
from skfmap.exceptions import MeshError
from skfmap.geometry.faults import (
    boundary_pieces,
    components,
    degenerate_faces,
    half_edges,
    is_wound_consistently,
    label_fans,
    nonmanifold_vertices,
)
from skfmap.geometry.mending import mend

generators = st.integers(0, 2**32 - 1).map(np.random.default_rng)
BALL = make_sphere(n_subdivisions=3)


@pytest.fixture(scope="module")
def creature():
    mesh = make_creatures(2, n_vertices=600).meshes[0]
    return mesh.vertices, mesh.faces


def euler(mended):
    return len(mended.vertices) - len(half_edges(mended.faces).count) + len(mended.faces)


def area(vertices, faces):
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def assert_manifold(mended):
    assert half_edges(mended.faces).count.max() <= 2
    assert len(nonmanifold_vertices(mended.faces, len(mended.vertices))) == 0
    assert len(np.unique(components(mended.faces, len(mended.vertices)))) == 1
    assert len(degenerate_faces(mended.vertices, mended.faces)) == 0
    assert len(np.unique(mended.faces)) == len(mended.vertices)


def assert_ball(mended):
    """Assert that the surface is closed, has no handle, and is wound consistently."""
    assert_manifold(mended)
    assert len(boundary_pieces(mended.faces)) == 0
    assert is_wound_consistently(mended.faces)
    assert euler(mended) == 2


def corners_of(vertices, faces):
    """Return the triangles as points, in an order that does not depend on their numbers."""
    corners = np.array([np.roll(t, -np.lexsort(t.T)[0], axis=0) for t in vertices[faces]])
    return corners[np.lexsort(corners.reshape(len(corners), -1).T)]


def cut(vertices, faces, chosen):
    """Cut a surface along edges: faces on both sides get vertices of their own."""
    edges = half_edges(faces)
    pairs = edges.pairs[:, ~chosen]
    everywhere = np.ones(len(vertices), dtype=bool)
    _, fan = label_fans(edges, pairs, np.equal(*edges.start[pairs]), everywhere)
    _, first, number = np.unique(fan, return_index=True, return_inverse=True)
    return vertices[faces.ravel()[first]], number.reshape(faces.shape), faces.ravel()[first]


# Seams


@given(generators, st.floats(0.0, 0.5))
@settings(max_examples=50, deadline=None)
def test_what_was_cut_along_seams_is_the_same_surface_again(rng, share):
    edges = half_edges(BALL.faces)
    points, faces, of = cut(BALL.vertices, BALL.faces, rng.random(edges.pairs.shape[1]) < share)
    mended = mend(points, faces)
    assert_ball(mended)
    np.testing.assert_array_equal(
        corners_of(mended.vertices, mended.faces), corners_of(BALL.vertices, BALL.faces)
    )
    # All copies of a vertex are found at one, and those of others elsewhere.
    np.testing.assert_array_equal(mended.vertices[mended.vertex_map], points)
    assert len(np.unique(np.stack([of, mended.vertex_map]), axis=1).T) == BALL.n_vertices


def test_triangles_with_vertices_of_their_own_are_a_surface():
    mended = mend(
        BALL.vertices[BALL.faces].reshape(-1, 3), np.arange(BALL.faces.size).reshape(-1, 3)
    )
    assert_ball(mended)
    assert len(mended.vertices) == BALL.n_vertices


@pytest.mark.parametrize(("gap", "closed"), [(1e-7, True), (1e-6, True), (1e-3, False)])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_a_crack_is_closed_if_it_is_hardly_there(gap, closed, unit):
    rng = np.random.default_rng(0)
    above = BALL.vertices[BALL.faces].mean(axis=1)[:, 2] > 0
    number = np.unique(BALL.faces[above])
    faces = BALL.faces.copy()
    new = np.full(BALL.n_vertices, -1)
    new[number] = BALL.n_vertices + np.arange(len(number))
    faces[above] = new[faces[above]]
    moved = BALL.vertices[number] + gap * rng.uniform(-1, 1, (len(number), 3))
    vertices = unit * np.concatenate([BALL.vertices, moved])
    mended = mend(vertices, faces)
    assert (len(boundary_pieces(mended.faces)) == 0) == closed
    if closed:
        assert_ball(mended)
        assert len(mended.vertices) == BALL.n_vertices
        kept = mended.vertex_map >= 0
        distance = np.linalg.norm(mended.vertices[mended.vertex_map[kept]] - vertices[kept], axis=1)
        assert distance.max() < 4 * gap * unit


def test_the_rims_of_a_plate_that_is_thinner_than_a_crack_are_not_joined():
    """Two sheets that lie on each other are two pieces, not a bag without volume."""
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 0]])
    fan = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    mended = mend(np.concatenate([square, square]), np.concatenate([fan, 5 + fan[:, ::-1]]))
    assert len(boundary_pieces(mended.faces)) == 1
    np.testing.assert_array_equal(mended.vertices, square)


def test_bodies_that_touch_are_not_joined():
    """At a vertex of each, at an edge, at whole faces: they have no rim, and stay two."""
    cube = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([t for a, b, c, d in sides for t in ([a, b, c], [a, c, d])])
    for shift, kept in (([1, 1, 1], 6), ([1, 1, 0], 6), ([1, 0, 0], 10)):
        vertices = np.concatenate([cube, 1.0 * cube + shift])
        mended = mend(vertices, np.concatenate([faces, faces + 8]))
        assert_ball(mended)
        np.testing.assert_array_equal(mended.vertices, cube)
        # Where they share their vertices they come apart, but for a wall that both have: it goes.
        _, first, number = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
        shared = np.concatenate([number.ravel()[faces], number.ravel()[faces + 8]])
        mended = mend(vertices[first], shared)
        assert_ball(mended)
        assert area(mended.vertices, mended.faces) == pytest.approx(kept)
        assert mended.tally["debris"] == pytest.approx(1 - kept / 12)


# Edges with more than two faces


def test_fins_are_cut_off_whatever_their_angle(creature):
    vertices, faces = creature
    rng = np.random.default_rng(0)
    for _ in range(10):
        chosen = rng.choice(len(faces), 5, replace=False)
        a, b = vertices[faces[chosen, 0]], vertices[faces[chosen, 1]]
        tips = (a + b) / 2 + 0.5 * np.linalg.norm(a - b) * rng.uniform(-1, 1, (5, 3))
        fins = np.column_stack([faces[chosen, :2], len(vertices) + np.arange(5)])
        mended = mend(np.concatenate([vertices, tips]), np.concatenate([faces, fins]))
        np.testing.assert_array_equal(mended.faces, faces)
        assert (mended.vertex_map[-5:] == -1).all()
        assert mended.tally["pieces"] == 6


def test_a_neck_that_was_collapsed_keeps_its_faces():
    """A tube of three sides, of whose middle ring two vertices were made one.

    Two sheets have an edge in common then, and the way around its ends leads through both.
    """
    rings = [[np.cos(t), np.sin(t), z] for z in range(5) for t in (0, 2.1, 4.2)]
    faces = [
        t
        for k in range(4)
        for i, j in ((0, 1), (1, 2), (2, 0))
        for t in (
            [3 * k + i, 3 * k + j, 3 * k + 3 + i],
            [3 * k + j, 3 * k + 3 + j, 3 * k + 3 + i],
        )
    ]
    faces = np.array([*faces, [2, 1, 0], [12, 13, 14]])
    faces[faces == 7] = 6
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])]
    faces = faces[faces[:, 2] != faces[:, 0]]
    vertices = np.array(rings)
    assert half_edges(faces).count.max() == 4
    mended = mend(vertices, faces)
    assert_manifold(mended)
    assert len(boundary_pieces(mended.faces)) == 0
    assert area(mended.vertices, mended.faces) == pytest.approx(area(vertices, faces))


def test_surfaces_that_touch_in_a_point_come_apart():
    wrong = np.arange(BALL.n_vertices)
    wrong[np.linalg.norm(BALL.vertices - BALL.vertices[0], axis=1).argmax()] = 0
    mended = mend(BALL.vertices, wrong[BALL.faces])
    assert_ball(mended)
    assert mended.tally == {"touching vertices": 1}
    np.testing.assert_array_equal(mended.vertices[-1], mended.vertices[mended.vertex_map[0]])


# Faces


@given(generators, st.integers(1, 8))
@settings(max_examples=50, deadline=None)
def test_faces_without_area_leave_no_hole_that_has_any(rng, n):
    """Vertices moved onto a neighbour, or onto the middle of the edge across from them."""
    vertices = BALL.vertices.copy()
    for face in BALL.faces[rng.choice(len(BALL.faces), n, replace=False)]:
        vertices[face[0]] = (
            vertices[face[1:]].mean(axis=0) if rng.random() < 0.5 else vertices[face[1]]
        )
    mended = mend(vertices, BALL.faces)
    assert_manifold(mended)
    assert len(boundary_pieces(mended.faces)) == 0
    assert area(mended.vertices, mended.faces) == pytest.approx(
        area(vertices, BALL.faces), rel=0.02
    )


@given(generators)
@settings(max_examples=20, deadline=None)
def test_faces_are_wound_as_most_of_their_neighbours_are(rng):
    turned = rng.random(len(BALL.faces)) < 0.4
    mended = mend(BALL.vertices, np.where(turned[:, None], BALL.faces[:, ::-1], BALL.faces))
    assert is_wound_consistently(mended.faces)
    assert mended.tally == {"turned faces": turned.sum()}


def test_a_face_that_stands_there_twice_goes_once():
    mended = mend(BALL.vertices, np.concatenate([BALL.faces, BALL.faces[3:6, [1, 2, 0]]]))
    np.testing.assert_array_equal(mended.faces, BALL.faces)
    assert mended.tally == {"faces twice": 3}


# Twists


def crosscap(vertices, faces, at):
    """Take away the faces around a vertex of degree 6, and merge opposite vertices of the hole."""
    rim = {
        a: b
        for a, b, _ in (
            np.roll(t, -1 - list(t).index(at)) for t in faces[(faces == at).any(axis=1)]
        )
    }
    loop = [next(iter(rim))]
    while len(loop) < len(rim):
        loop.append(rim[loop[-1]])
    assert len(loop) == 6
    merged = np.arange(len(vertices))
    merged[loop[3:]] = loop[:3]
    return vertices, merged[faces[~(faces == at).any(axis=1)]]


def test_where_one_spot_has_no_winding_few_faces_are_left_out():
    ball = make_sphere(n_subdivisions=6)
    valence = np.bincount(ball.faces.ravel())
    for at in np.flatnonzero(valence == 6)[[50, 5000, 9000]]:
        vertices, faces = crosscap(ball.vertices, ball.faces, at)
        for turned in (np.zeros(len(faces), dtype=bool), np.arange(len(faces)) % 3 == 0):
            wound = np.where(turned[:, None], faces[:, ::-1], faces)
            mended = mend(vertices, wound)
            assert is_wound_consistently(mended.faces)
            assert_manifold(mended)
            assert mended.tally["twisted faces"] <= 12
            assert len(mended.faces) >= len(faces) - 12


def test_a_moebius_band_is_left_as_it_is():
    n = 24
    here, nxt = np.arange(n), np.roll(np.arange(n), -1)
    swap = here == n - 1
    low, high = np.where(swap, nxt + n, nxt), np.where(swap, nxt, nxt + n)
    faces = np.concatenate([np.stack([here, low, high], 1), np.stack([here, high, here + n], 1)])
    t = 2 * np.pi * here / n
    side = np.stack([np.cos(t / 2) * np.cos(t), np.cos(t / 2) * np.sin(t), np.sin(t / 2)], 1)
    circle = np.stack([np.cos(t), np.sin(t), 0 * t], 1)
    mended = mend(np.concatenate([circle + 0.2 * side, circle - 0.2 * side]), faces)
    assert mended.tally == {}
    np.testing.assert_array_equal(mended.faces, faces)


# Pieces, numbers, words


def test_debris_is_left_out_and_counted(creature):
    vertices, faces = creature
    crumbs = [0.01 * BALL.vertices + np.array([i, 0, 0]) for i in range(4)]
    all_vertices = np.concatenate([*crumbs, vertices])
    all_faces = np.concatenate(
        [*(BALL.faces + i * BALL.n_vertices for i in range(4)), faces + 4 * BALL.n_vertices]
    )
    mended = mend(all_vertices, all_faces)
    np.testing.assert_array_equal(mended.vertices, vertices)
    np.testing.assert_array_equal(mended.faces, faces)
    assert mended.tally["pieces"] == 5
    assert mended.tally["debris"] == pytest.approx(
        4 * area(crumbs[0], BALL.faces) / area(all_vertices, all_faces)
    )
    np.testing.assert_array_equal(
        mended.vertex_map, [*[-1] * 4 * BALL.n_vertices, *range(len(vertices))]
    )


def test_what_is_sound_is_not_touched(creature):
    mended = mend(*creature)
    assert mended.tally == {}
    np.testing.assert_array_equal(mended.vertices, creature[0])
    np.testing.assert_array_equal(mended.faces, creature[1])
    np.testing.assert_array_equal(mended.vertex_map, np.arange(len(creature[0])))


def test_a_loose_vertex_at_the_place_of_another_is_found_there():
    vertices = np.concatenate([BALL.vertices, BALL.vertices[5:6], [[2.0, 0, 0]]])
    repair = repair_mesh((vertices, BALL.faces))
    assert repair.vertex_map[-2:].tolist() == [5, -1]


def test_a_repair_says_what_it_did(creature):
    vertices, faces = creature
    a, b, c = faces[7]
    fin = [b, a, len(vertices)]
    tip = 2 * vertices[a] - vertices[c]
    crumb = 0.01 * BALL.vertices
    broken = (
        np.concatenate([vertices, [tip], crumb, [[np.nan] * 3]]),
        np.concatenate([faces, [fin], BALL.faces + len(vertices) + 1]),
    )
    report = check_mesh(broken)
    assert report.usable()
    assert not report.usable(on_invalid="raise")
    assert {fault.level for fault in report.faults} <= {"mended", "note"}
    repair = repair_mesh(broken)
    n_lost = BALL.n_vertices + 2
    assert repair.done[0] == "separated the surface at 1 edges with more than two faces"
    assert repair.done[1].startswith("kept the largest of 3 components, 99.")
    assert repair.done[2].startswith(f"removed {n_lost} vertices that no face used")
    assert len(repair.done) == 3
    np.testing.assert_array_equal(repair.mesh.faces, faces)
    assert check_mesh(repair.mesh).faults == ()


def test_what_single_precision_has_merged_far_from_the_origin_is_said_to_be_lost(creature):
    vertices, faces = creature
    far = vertices / np.ptp(vertices) + np.array([5e5, 5.4e6, 100])
    assert check_mesh((far, faces)).usable("cotangent", "raise")
    lost = far.astype(np.float32)
    assert "subtract an offset before saving" in str(check_mesh((lost, faces)))
    with pytest.raises(MeshError, match="subtract an offset before saving"):
        repair_mesh((lost, faces))
    assert check_mesh((1000 * vertices / np.ptp(vertices) + [5e5, 5.4e6, 0], faces)).usable()
