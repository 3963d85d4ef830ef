"""Creatures: whole surfaces, own connectivities, correspondences, near-isometric bending."""

import numpy as np
import potpourri3d as pp3d
import pytest

from skfmap.datasets import make_creatures
from skfmap.datasets._creature_body import BODIES
from skfmap.datasets._creature_field import mirror, project, signed_distance

N_POINTS = 300


@pytest.fixture(scope="module")
def cats():
    return make_creatures(4, 1000, n_points=N_POINTS)


@pytest.fixture(scope="module")
def horses():
    return make_creatures(2, 1000, n_points=N_POINTS, body="horse")


@pytest.fixture(scope="module")
def meshes(cats, horses):
    return cats.meshes + horses.meshes


def directed_edges(mesh):
    return np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])


def n_components(mesh):
    label = np.arange(mesh.n_vertices)
    edges = directed_edges(mesh)
    while True:
        lower = label.copy()
        np.minimum.at(lower, edges[:, 1], label[edges[:, 0]])
        if (lower == label).all():
            return len(np.unique(label))
        label = lower


def vertices_of_points(correspondence):
    return correspondence.pairs[np.argsort(correspondence.pairs[:, 1]), 0]


def symmetric_vertices_of_points(correspondence):
    return correspondence.symmetric_pairs[np.argsort(correspondence.symmetric_pairs[:, 1]), 0]


def geodesic_distances(mesh, correspondence, points):
    """Distances between the vertices of template points, over the square root of the area."""
    vertices = vertices_of_points(correspondence)[points]
    solver = pp3d.MeshHeatMethodDistanceSolver(np.array(mesh.vertices), np.array(mesh.faces))
    rows = np.array([solver.compute_distance(int(vertex))[vertices] for vertex in vertices])
    return (rows + rows.T) / 2 / np.sqrt(mesh.area)


def test_surfaces_are_closed_and_manifold(meshes):
    for mesh in meshes:
        edges = directed_edges(mesh)
        directed = np.unique(edges, axis=0)
        assert len(directed) == len(edges)
        assert np.array_equal(directed, np.unique(edges[:, ::-1], axis=0))
        assert np.array_equal(np.unique(mesh.faces), np.arange(mesh.n_vertices))


def test_vertex_stars_are_single_fans(meshes):
    """Around each vertex, the opposite edges form one closed ring."""
    for mesh in meshes:
        following = [{} for _ in range(mesh.n_vertices)]
        for a, b, c in mesh.faces.tolist():
            following[a][b] = c
            following[b][c] = a
            following[c][a] = b
        for ring in following:
            start = at = next(iter(ring))
            length = 0
            while length == 0 or at != start:
                at = ring[at]
                length += 1
            assert length == len(ring)


def test_surfaces_are_spheres_in_one_piece(meshes):
    for mesh in meshes:
        n_edges = len(directed_edges(mesh)) // 2
        assert mesh.n_vertices - n_edges + mesh.n_faces == 2
        assert n_components(mesh) == 1


def test_faces_are_wound_outwards(meshes):
    for mesh in meshes:
        a, b, c = (mesh.vertices[mesh.faces[:, j]] for j in range(3))
        assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0


def test_triangles_are_well_shaped(meshes):
    for mesh in meshes:
        corners = mesh.vertices[mesh.faces]
        angles = []
        for j in range(3):
            u, v = corners[:, (j + 1) % 3] - corners[:, j], corners[:, (j + 2) % 3] - corners[:, j]
            angles.append(np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(axis=1)))
        smallest = np.degrees(np.min(angles, axis=0))
        assert smallest.min() > 0.5
        assert (smallest > 10).mean() > 0.99


@pytest.mark.parametrize("n_vertices", [500, 5000])
def test_vertices_are_as_many_as_asked(n_vertices):
    mesh = make_creatures(1, n_vertices, n_points=2).meshes[0]
    assert mesh.n_vertices == n_vertices


def test_connectivities_differ(cats):
    """The number of vertices with each number of neighbours does not depend on the numbering."""
    counts = {
        tuple(np.bincount(np.bincount(mesh.faces.ravel()), minlength=12)) for mesh in cats.meshes
    }
    assert len(counts) == len(cats.meshes)


def test_same_seed_same_bytes_and_prefix(cats):
    again = make_creatures(2, 1000, n_points=N_POINTS)
    for a, b in zip(again.meshes, cats.meshes[:2], strict=True):
        assert a.content_hash == b.content_hash
    for a, b in zip(again.correspondences, cats.correspondences[:2], strict=True):
        assert np.array_equal(a.pairs, b.pairs)
        assert np.array_equal(a.symmetric_pairs, b.symmetric_pairs)


def test_seeds_differ(cats):
    other = make_creatures(2, 1000, n_points=N_POINTS, random_state=1)
    for a, b in zip(other.meshes, cats.meshes[:2], strict=True):
        assert a.content_hash != b.content_hash


def test_one_body_or_one_per_shape(cats, horses):
    mixed = make_creatures(2, 1000, n_points=N_POINTS, body=["cat", "horse"])
    assert mixed.names == ["cat0", "horse1"]
    assert mixed.meshes[0].content_hash == cats.meshes[0].content_hash
    assert mixed.meshes[1].content_hash == horses.meshes[1].content_hash


def test_bunch_is_complete(cats):
    assert cats.names == [mesh.name for mesh in cats.meshes] == ["cat0", "cat1", "cat2", "cat3"]
    assert cats.template_points.shape == (N_POINTS, 3)
    assert "cat" in cats.DESCR


def test_correspondences_cover_the_template(cats, horses):
    for mesh, correspondence in zip(
        cats.meshes + horses.meshes, cats.correspondences + horses.correspondences, strict=True
    ):
        for pairs in (correspondence.pairs, correspondence.symmetric_pairs):
            assert np.array_equal(np.sort(pairs[:, 1]), np.arange(N_POINTS))
            assert pairs[:, 0].max() < mesh.n_vertices
        assert len(np.unique(correspondence.pairs[:, 0])) > 0.9 * N_POINTS


def test_symmetric_answer_is_that_of_the_mirrored_point(cats):
    points = cats.template_points
    partner = np.roll(np.arange(N_POINTS), N_POINTS // 2)
    assert np.array_equal(points[partner], mirror(points))
    assert np.array_equal(partner[partner], np.arange(N_POINTS))
    for correspondence in cats.correspondences:
        direct, symmetric = (
            vertices_of_points(correspondence),
            symmetric_vertices_of_points(correspondence),
        )
        assert np.array_equal(symmetric, direct[partner])


def test_first_shape_is_at_rest_and_lies_on_its_template(cats):
    mesh = cats.meshes[0]
    assert abs(signed_distance(BODIES["cat"], mesh.vertices)).max() < 0.05
    gap = np.linalg.norm(
        mesh.vertices[vertices_of_points(cats.correspondences[0])] - cats.template_points, axis=1
    )
    edge = np.sqrt(mesh.area / mesh.n_vertices)
    assert np.median(gap) < edge
    assert gap.max() < 3 * edge


@pytest.mark.parametrize("body", sorted(BODIES))
def test_bodies_are_symmetric_and_legs_stand_apart(body):
    rng = np.random.default_rng(0)
    points = rng.uniform([-40, -100, 0], [40, 100, 110], size=(500, 3))
    values = signed_distance(BODIES[body], points)
    assert np.allclose(values, signed_distance(BODIES[body], mirror(points)), atol=1e-9)
    assert (
        abs(
            signed_distance(BODIES[body], project(BODIES[body], points[abs(values) < 3], n_steps=4))
        ).max()
        < 0.05
    )
    between = np.column_stack([np.zeros(50), np.linspace(-60, 60, 50), np.full(50, 12.0)])
    assert signed_distance(BODIES[body], between).min() > 4.0


def test_bending_is_nearly_isometric_and_bodies_are_not(cats, horses):
    points = np.arange(0, N_POINTS, 12)
    rest = geodesic_distances(cats.meshes[0], cats.correspondences[0], points)
    far = rest > 0.2

    def distortions(mesh, correspondence):
        difference = abs(geodesic_distances(mesh, correspondence, points) - rest)
        return (difference[far] / rest[far]).mean(), np.sqrt((difference**2).mean())

    posed = np.array(
        [
            distortions(*shape)
            for shape in zip(cats.meshes[1:], cats.correspondences[1:], strict=True)
        ]
    )
    other = distortions(horses.meshes[0], horses.correspondences[0])
    assert posed[:, 0].mean() < 0.08
    assert posed[:, 0].max() < 0.11
    assert other[1] > 1.5 * posed[:, 1].mean()


def test_no_pose_without_strength():
    still, posed = make_creatures(2, 500, n_points=2, pose_strength=0.0, variation=0.0).meshes
    rotation_free = [
        np.sort(np.linalg.norm(mesh.vertices[:, :2], axis=1))[-1] for mesh in (still, posed)
    ]
    assert rotation_free[0] == pytest.approx(rotation_free[1], rel=0.05)
    assert np.ptp(posed.vertices[:, 2]) == pytest.approx(np.ptp(still.vertices[:, 2]), rel=0.1)
    assert posed.area == pytest.approx(still.area, rel=0.02)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"n_shapes": 0}, ValueError),
        ({"n_shapes": 1.5}, TypeError),
        ({"n_vertices": 100}, ValueError),
        ({"n_vertices": 10**6}, ValueError),
        ({"n_points": 7}, ValueError),
        ({"n_points": 10**6}, ValueError),
        ({"pose_strength": 1.5}, ValueError),
        ({"pose_strength": "much"}, TypeError),
        ({"variation": 0.5}, ValueError),
        ({"random_state": -1}, ValueError),
        ({"random_state": None}, TypeError),
        ({"body": "fish"}, ValueError),
        ({"n_shapes": 3, "body": ["cat", "horse"]}, ValueError),
        ({"n_shapes": 1, "body": ["fish"]}, ValueError),
    ],
)
def test_bad_arguments(arguments, error):
    with pytest.raises(error, match=next(reversed(arguments))):
        make_creatures(**arguments)
