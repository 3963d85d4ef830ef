"""Elastic surfaces, what is learned of deformations, and how a mesh is laid: closed forms."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.spatial.transform import Rotation

from skfmap.functional.similarity import best_similarity
from skfmap.geometry.closest import ClosestPoints, face_normals
from skfmap.geometry.elasticity import ElasticSurface, nearest_rotations
from skfmap.geometry.sphere import subdivided_octahedron
from skfmap.registration.deformation import Deformation
from skfmap.registration.laying import Anchors, flipped_faces, lay, lay_on_points, unfold


def turn(seed):
    return Rotation.random(random_state=seed).as_matrix()


def vertex_areas(vertices, faces):
    a, b, c = (vertices[faces[:, j]] for j in range(3))
    thirds = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    return np.bincount(faces.ravel(), np.repeat(thirds, 3), minlength=len(vertices))


@pytest.fixture(scope="module")
def body():
    """Return vertices and faces of an ellipsoid without equal axes, bent, of 258 vertices."""
    vertices, faces = subdivided_octahedron(3)
    vertices = vertices * [1.0, 0.7, 0.5]
    return vertices + np.outer(0.3 * vertices[:, 0] ** 2, [0, 0, 1]), faces


@pytest.fixture(scope="module")
def surface(body):
    return ElasticSurface.at_rest(*body)


def bent(vertices, strength):
    """Return the vertices bent sideways, which stretches one side and compresses the other."""
    angle = strength * vertices[:, 0]
    x, y, z = vertices.T
    return np.column_stack([x + y * np.sin(angle), y * np.cos(angle), z])


def moved(vertices, seed):
    return vertices @ turn(seed).T + np.random.default_rng(seed).normal(size=3)


# Rotations


def test_rotations_are_recovered_exactly():
    turns = np.stack([turn(seed) for seed in range(20)])
    np.testing.assert_allclose(nearest_rotations(turns), turns, atol=1e-12)
    np.testing.assert_allclose(nearest_rotations(7 * turns), turns, atol=1e-12)


def test_rotations_are_the_nearest_by_singular_values():
    """By another route: U V' of the decomposition, its last column turned where it reflects."""
    matrices = np.random.default_rng(0).normal(size=(500, 3, 3))
    U, _, Vt = np.linalg.svd(matrices)
    reflects = np.linalg.det(U @ Vt) < 0
    assert 100 < reflects.sum() < 400
    U[reflects, :, 2] *= -1
    np.testing.assert_allclose(nearest_rotations(matrices), U @ Vt, atol=1e-10)


def test_the_rotation_of_a_rigid_motion_is_found_at_every_vertex(body, surface):
    found = surface.rotations(body[0] @ turn(1).T + 3)
    np.testing.assert_allclose(found, np.broadcast_to(turn(1), found.shape), atol=1e-10)


def test_rotations_at_vertices_fit_their_edges_best(body, surface):
    """As scipy's solution of Wahba's problem does, vertex by vertex."""
    now = bent(body[0], 0.8)
    found = surface.rotations(now)
    vectors = surface.along_edges(now)
    for vertex in range(0, len(now), 37):
        at = (surface.edges == vertex).any(axis=1)
        best, _ = Rotation.align_vectors(vectors[at], surface.vectors[at], surface.weights[at])
        np.testing.assert_allclose(found[vertex], best.as_matrix(), atol=1e-7)


def test_where_edges_leave_a_turn_open_it_is_that_of_the_whole(body, surface):
    """Neighbours on one point, and on one line: the rotations turn with the shape all the same."""
    _, faces = body
    around = np.unique(faces[(faces == 0).any(axis=1)])
    for flattened in (np.zeros(3), np.array([0.0, 0, 1])):
        now = bent(body[0], 0.8)
        now[around] = now[0] + np.outer(now[around] @ flattened, flattened)
        plain = surface.rotations(now)
        turned = surface.rotations(now @ turn(1).T + 3)
        np.testing.assert_allclose(turned, turn(1) @ plain, atol=1e-5)


# The energy


def energy(surface, vertices, rotations):
    """The sum in the docstring, edge by edge."""
    i, j = surface.edges.T
    turned = np.einsum("eab,eb->ea", (rotations[i] + rotations[j]) / 2, surface.vectors)
    return float(surface.weights @ np.square(vertices[i] - vertices[j] - turned).sum(axis=1))


def test_rigid_motions_cost_nothing(body, surface):
    now = moved(body[0], 2)
    assert energy(surface, now, surface.rotations(now)) < 1e-20
    still = surface.stiffness @ now - surface.turned(surface.rotations(now))
    assert np.abs(still).max() < 1e-12, "and nothing pulls"
    stretched = bent(body[0], 0.8)
    assert energy(surface, stretched, surface.rotations(stretched)) > 0.1


def test_the_gradient_is_that_of_finite_differences(body, surface):
    """The energy is quadratic for given rotations, so that central differences are exact."""
    rng = np.random.default_rng(0)
    now, rotations = bent(body[0], 0.8), np.stack([turn(seed) for seed in range(len(body[0]))])
    gradient = 2 * (surface.stiffness @ now - surface.turned(rotations))
    for _ in range(5):
        way = rng.normal(size=now.shape)
        ahead, behind = (energy(surface, now + sign * way, rotations) for sign in (1, -1))
        assert (gradient * way).sum() == pytest.approx((ahead - behind) / 2, rel=1e-9)


def test_the_stiffness_is_the_quadratic_form_of_the_edges(body, surface):
    values = np.random.default_rng(1).normal(size=len(body[0]))
    i, j = surface.edges.T
    by_edges = float(surface.weights @ np.square(values[i] - values[j]))
    assert values @ surface.stiffness @ values == pytest.approx(by_edges)
    assert np.abs(surface.stiffness @ np.ones(len(values))).max() < 1e-12
    counts = np.bincount(surface.edges.ravel(), minlength=len(values))
    np.testing.assert_array_equal(surface.ends @ np.ones(len(i)), counts)


def test_edges_are_those_of_the_mesh_once_each_and_never_push(body, surface):
    _, faces = body
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    expected = np.unique(np.sort(sides, axis=1), axis=0)
    found = np.sort(surface.edges, axis=1)
    np.testing.assert_array_equal(found[np.lexsort(found.T[::-1])], expected)
    flat = np.array([[0.0, 0, 0], [10, 0, 0], [5, 0.1, 0], [5, -0.1, 0]])
    obtuse = ElasticSurface.at_rest(flat, np.array([[0, 1, 2], [1, 0, 3]]))
    assert obtuse.weights.min() == 1e-3, "the long edge's cotangents are about -50"
    assert obtuse.weights.max() > 1


def test_equilateral_triangles_weigh_by_their_cotangents():
    height = np.sqrt(3) / 2
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, height, 0], [0.5, -height, 0]])
    pair = ElasticSurface.at_rest(corners, np.array([[0, 1, 2], [1, 0, 3]]))
    weights = dict(zip(map(tuple, np.sort(pair.edges, axis=1).tolist()), pair.weights, strict=True))
    half = 1 / np.sqrt(3) / 2  # half the cotangent of 60 degrees, of each face beside the edge
    assert weights.pop((0, 1)) == pytest.approx(2 * half)
    assert list(weights.values()) == pytest.approx([half] * 4)


def test_what_is_seen_from_rest_knows_no_pose(body, surface):
    np.testing.assert_allclose(
        surface.seen_from_rest(moved(body[0], 3)), surface.vectors, atol=1e-12
    )
    stretched = bent(body[0], 0.8)
    np.testing.assert_allclose(
        surface.seen_from_rest(moved(stretched, 4)), surface.seen_from_rest(stretched), atol=1e-10
    )
    larger = surface.seen_from_rest(1.3 * moved(body[0], 5))
    np.testing.assert_allclose(larger, 1.3 * surface.vectors, atol=1e-12)


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_strains_are_logarithms(body, surface, scale):
    strains = surface.strains(scale * moved(body[0], 6))
    np.testing.assert_allclose(strains, abs(np.log(scale)), atol=1e-12)


def test_other_edges_at_rest_keep_the_matrices(body, surface):
    other = surface.with_vectors(2 * surface.vectors)
    assert other.stiffness is surface.stiffness
    assert other.strains(2 * moved(body[0], 7)).max() < 1e-12
    assert surface.strains(moved(body[0], 7)).max() < 1e-12, "the first is not changed"


def test_a_surface_in_a_file_holds_no_matrices(surface):
    assert surface.stiffness.nnz  # made before
    saved = pickle.dumps(surface)
    again = pickle.loads(saved)
    assert set(vars(again)) == {"edges", "weights", "vectors", "n_vertices"}
    assert abs(again.stiffness - surface.stiffness).max() == 0


# What is learned of deformations


@pytest.mark.parametrize("stiff", [False, True])
def test_the_mean_of_rigidly_moved_copies_is_the_reference(body, surface, stiff):
    vertices, faces = body
    areas = vertex_areas(vertices, faces) if stiff else None
    copies = [moved(vertices, seed) for seed in range(4)]
    learned = Deformation.learned(vertices, faces, copies, areas=areas)
    np.testing.assert_allclose(learned.mean.vectors, surface.vectors, atol=1e-12)
    assert learned.deviations.max() < 1e-12
    at_rest = learned.shape_at_rest - learned.shape_at_rest.mean(axis=0)
    np.testing.assert_allclose(at_rest, vertices - vertices.mean(axis=0), atol=1e-4)


def test_stiff_shapes_are_averaged_whatever_their_size(body, surface):
    vertices, faces = body
    copies = [size * moved(vertices, seed) for seed, size in enumerate([0.5, 2.0, 3.0])]
    learned = Deformation.learned(vertices, faces, copies, areas=np.ones(len(vertices)))
    np.testing.assert_allclose(learned.shape_at_rest, vertices, atol=1e-12)
    np.testing.assert_allclose(learned.mean.vectors, surface.vectors, atol=1e-12)


def test_the_mean_of_stiff_shapes_is_that_of_their_coordinates(body):
    """Of shapes that alignment leaves as they are: differences that no similarity makes."""
    vertices, faces = subdivided_octahedron(3)
    bump = np.outer(vertices[:, 0] * vertices[:, 1] * vertices[:, 2], [1.0, 0, 0])
    shapes = [vertices + 0.1 * bump, vertices - 0.1 * bump]
    learned = Deformation.learned(vertices, faces, shapes, areas=np.ones(len(vertices)))
    np.testing.assert_allclose(learned.shape_at_rest, vertices, atol=1e-6)


def test_a_family_of_one_parameter_has_one_mode_in_closed_form(body, surface):
    """Bodies of other sizes and poses: the edges are those of the reference times the size."""
    vertices, faces = body
    sizes = np.array([1.0, 1.3, 0.9, 1.2])
    laid = [size * moved(vertices, seed) for seed, size in enumerate(sizes[1:])]
    learned = Deformation.learned(vertices, faces, laid)
    np.testing.assert_allclose(learned.mean.vectors, sizes.mean() * surface.vectors, atol=1e-12)
    np.testing.assert_allclose(
        surface.along_edges(learned.shape_at_rest), learned.mean.vectors, atol=1e-4
    )
    way = (np.sqrt(surface.weights)[:, None] * surface.vectors).ravel()
    length = np.linalg.norm(way)
    assert learned.modes.shape == (3, way.size)
    assert abs(learned.modes[0] @ way) == pytest.approx(length, rel=1e-5)
    spread = np.sqrt(np.square(sizes - sizes.mean()).sum() / 3)
    assert learned.deviations == pytest.approx([spread * length, 0, 0], abs=1e-10)
    adapted = learned.adapted(1.27 * moved(vertices, 9))
    np.testing.assert_allclose(adapted.vectors, 1.27 * surface.vectors, atol=1e-6)


def test_modes_are_orthonormal_and_as_many_as_shapes_but_twenty(body):
    vertices, faces = body
    rng = np.random.default_rng(0)
    laid = [vertices * rng.uniform(0.8, 1.2, size=3) for _ in range(25)]
    for n, kept in ((1, 1), (3, 3), (25, 20)):
        learned = Deformation.learned(vertices, faces, laid[:n])
        modes = learned.modes.astype(np.float64)
        assert learned.modes.dtype == np.float32
        np.testing.assert_allclose(modes @ modes.T, np.eye(kept), atol=1e-5)
        assert (np.diff(learned.deviations) <= 0).all()


def test_training_shapes_are_adapted_to_and_others_less(body):
    vertices, faces = body
    strengths = [0.3, -0.4, 0.8]
    laid = [moved(bent(vertices, strength), 10 + i) for i, strength in enumerate(strengths)]
    learned = Deformation.learned(vertices, faces, laid)

    def missed(now):
        seen = learned.mean.seen_from_rest(now)
        off = [seen - edges for edges in (learned.adapted(now).vectors, learned.mean.vectors)]
        return np.linalg.norm(off[0]) / np.linalg.norm(off[1])

    assert max(map(missed, laid)) < 0.05
    assert missed(bent(vertices, 0.6)) < 0.2, "between those that taught it"
    swollen = vertices * (1 + 0.3 * np.sin(9 * vertices[:, :1]))
    assert missed(swollen) > 0.8, "which no training shape showed"


def test_what_training_showed_takes_less_energy(body):
    vertices, faces = body
    laid = [moved(bent(vertices, strength), 10 + i) for i, strength in enumerate([0.3, -0.4, 0.8])]
    learned, plain = Deformation.learned(vertices, faces, laid), Deformation.of_reference(*body)
    for now in laid:
        assert learned.energy(now) < 0.01 * plain.energy(now)
        assert learned.energy(moved(now, 3)) == pytest.approx(learned.energy(now), rel=1e-6)
    swollen = vertices * (1 + 0.3 * np.sin(9 * vertices[:, :1]))
    assert learned.energy(swollen) > 0.6 * plain.energy(swollen), "which no training shape showed"


def test_what_components_leave_shrinks_the_way_along_them(body):
    """The closed form: variance / (variance + mean square of what is left)."""
    vertices, faces = body
    learned = Deformation.learned(vertices, faces, [bent(vertices, 0.5)])
    now = vertices * [1.1, 1.0, 0.9]
    roots = np.repeat(np.sqrt(learned.mean.weights), 3)
    mode = learned.modes[0].astype(np.float64)
    seen = roots * (learned.mean.seen_from_rest(now) - learned.mean.vectors).ravel()
    left = np.square(seen - mode * (mode @ seen)).mean()
    variance = learned.deviations[0] ** 2
    expected = variance / (variance + left) * (mode @ seen) * mode / roots
    found = (learned.adapted(now).vectors - learned.mean.vectors).ravel()
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_where_nothing_was_learned_the_reference_is_at_rest(body, surface):
    vertices, faces = body
    nothing = Deformation.of_reference(vertices, faces)
    assert nothing.adapted(bent(vertices, 0.5)) is nothing.mean
    np.testing.assert_array_equal(nothing.mean.vectors, surface.vectors)


# Folds


@pytest.fixture(scope="module")
def folded(body):
    """Return the body, bent and moved, with one vertex drawn over the opposite edge of a face."""
    vertices, faces = body
    smooth = moved(vertices, 20)
    face, vertex = 200, faces[200, 0]
    other = smooth[faces[face, 1:]].mean(axis=0)
    drawn = smooth.copy()
    drawn[vertex] += 1.2 * (other - drawn[vertex])
    return smooth, drawn, face


def test_a_face_that_is_turned_by_hand_is_counted_and_no_other(body, folded):
    vertices, faces = body
    smooth, drawn, face = folded
    rest = Deformation.of_reference(vertices, faces)
    assert not flipped_faces(rest, faces, smooth).any()
    assert not flipped_faces(rest, faces, bent(vertices, 1.0)).any(), "bending folds nothing"
    np.testing.assert_array_equal(np.flatnonzero(flipped_faces(rest, faces, drawn)), [face])
    against = np.einsum("na,na->n", face_normals(smooth, faces), face_normals(drawn, faces)) < 0
    np.testing.assert_array_equal(np.flatnonzero(against), [face])


def test_a_fold_is_taken_out_and_nothing_else_is_touched(body, folded):
    vertices, faces = body
    smooth, drawn, face = folded
    rest = Deformation.of_reference(vertices, faces)
    flat = unfold(rest, faces, drawn)
    assert not flipped_faces(rest, faces, flat).any()
    np.testing.assert_allclose(flat, smooth, atol=1e-12)
    around = np.isin(faces, faces[face]).any(axis=1)
    beyond = np.setdiff1d(np.arange(len(vertices)), faces[around])
    assert len(beyond) > 200
    np.testing.assert_array_equal(flat[beyond], drawn[beyond])


def test_what_has_no_fold_stays_as_it_is(body):
    vertices, faces = body
    now = bent(vertices, 0.5)
    np.testing.assert_array_equal(
        unfold(Deformation.of_reference(vertices, faces), faces, now), now
    )


# Laid on points and on surfaces


def on_vertices(points, weights=None):
    n = len(points)
    weights = np.ones(n) if weights is None else weights
    return Anchors(sp.eye_array(n, format="csr"), points, weights)


def test_points_of_a_rigid_copy_are_met_and_wrong_ones_count_little(body):
    vertices, faces = body
    rest, there = Deformation.of_reference(vertices, faces), moved(vertices, 30)
    np.testing.assert_allclose(lay_on_points(rest, on_vertices(there), there), there, atol=1e-10)
    wrong = np.random.default_rng(0).permutation(len(vertices))[:12]
    points = there.copy()
    points[wrong] += 0.5
    trusted = lay_on_points(rest, on_vertices(points), points)
    assert np.linalg.norm(trusted - there, axis=1).max() < 0.01
    weights = np.ones(len(vertices))
    weights[wrong] = 0
    unheard = lay_on_points(rest, on_vertices(points, weights), there)
    np.testing.assert_allclose(unheard, there, atol=1e-10)


def test_a_mesh_is_drawn_to_a_surface_the_nearer_the_softer_it_is():
    vertices, faces = subdivided_octahedron(3)
    areas = vertex_areas(vertices, faces)
    target = ClosestPoints(*subdivided_octahedron(4))
    flat = vertices * [1.0, 1.0, 0.9]
    rest = Deformation.of_reference(flat, faces)
    off = [
        target.of(lay(rest, faces, target, flat, areas, stiffness=stiffness)).distances.mean()
        for stiffness in (100.0, 1.0, 0.01)
    ]
    assert off[0] > 3 * off[1] > 9 * off[2]
    assert off[2] < 1e-3


def test_nothing_is_drawn_where_nothing_was_scanned():
    """Onto a half sphere: the other half of the mesh stays round, as it was at rest."""
    vertices, faces = subdivided_octahedron(3)
    upper, kept = subdivided_octahedron(4)
    kept = kept[(upper[kept, 2] > -1e-9).all(axis=1)]
    target = ClosestPoints(upper * 1.02, kept)
    rest = Deformation.of_reference(vertices, faces)
    laid = lay(rest, faces, target, vertices, vertex_areas(vertices, faces), stiffness=0.1)
    below = vertices[:, 2] < -0.2
    np.testing.assert_allclose(np.linalg.norm(laid[below], axis=1), 1.0, atol=0.04)
    above = vertices[:, 2] > 0.2
    np.testing.assert_allclose(np.linalg.norm(laid[above], axis=1), 1.02, atol=0.01)


def test_what_training_shapes_showed_costs_nothing(body):
    """From the mean shape: bodies that taper as training shapes do are met the better for it."""
    vertices, faces = body

    def tapered(by):
        return vertices * (1 + by * vertices[:, :1])

    areas = vertex_areas(vertices, faces)
    learned = Deformation.learned(vertices, faces, [tapered(by) for by in (0.2, -0.2, 0.3)])
    unaware = replace(learned, modes=learned.modes[:0], deviations=learned.deviations[:0])
    target, rest = ClosestPoints(tapered(0.25), faces), learned.shape_at_rest
    start = best_similarity(rest, tapered(0.25), areas).apply(rest)
    off = [
        target.of(lay(one, faces, target, start, areas, stiffness=0.3)).distances.mean()
        for one in (learned, unaware)
    ]
    assert off[0] < 0.6 * off[1]


def test_vertices_are_drawn_by_their_areas():
    vertices, faces = subdivided_octahedron(3)
    flat = vertices * [1.0, 1.0, 0.9]
    target, above = ClosestPoints(vertices, faces), vertices[:, 2] > 0.3
    areas = np.where(above, 10.0, 1.0)
    rest = Deformation.of_reference(flat, faces)
    off = target.of(lay(rest, faces, target, flat, areas, stiffness=10.0)).distances
    assert off[above].mean() < 0.7 * off[vertices[:, 2] < -0.3].mean()


@pytest.mark.parametrize("away", ["inside out", "far"])
def test_where_nothing_draws_nothing_moves(away):
    """The inner wall of a hollow body, which is nearer than any other, and a surface elsewhere."""
    vertices, faces = subdivided_octahedron(3)
    wall = (0.95 * vertices, faces[:, ::-1]) if away == "inside out" else (vertices + 30, faces)
    rest, areas = Deformation.of_reference(vertices, faces), vertex_areas(vertices, faces)
    laid = lay(rest, faces, ClosestPoints(*wall), vertices, areas, stiffness=0.3)
    np.testing.assert_allclose(laid, vertices, atol=1e-6)


def test_anchors_hold_the_places_that_they_name(body):
    vertices, faces = body
    rest, target = Deformation.of_reference(vertices, faces), ClosestPoints(*body)
    places = sp.csr_array(np.full((1, 3), 1 / 3)) @ sp.eye_array(len(vertices)).tocsr()[faces[7]]
    points = places @ vertices + [[0.0, 0, 0.05]]
    held = Anchors(places, points, np.array([1e6]))
    areas = vertex_areas(vertices, faces)
    laid = lay(rest, faces, target, vertices, areas, stiffness=1.0, anchors=held)
    np.testing.assert_allclose(places @ laid, points, atol=1e-4)
    free = lay(rest, faces, target, vertices, areas, stiffness=1.0)
    np.testing.assert_allclose(free, vertices, atol=1e-10, err_msg="it lies on the surface already")
