"""Landmarks that lie between vertices: where they are, how they are joined, learned and scored."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import skfmap
from skfmap import Correspondence, Landmarks, Mesh, SpectralBasis
from skfmap._measures import PlaceDistances
from skfmap.datasets import make_sphere
from skfmap.exceptions import CorrespondenceError, MeshError
from skfmap.geometry.closest import nearest_places
from skfmap.ground_truth import ground_truth_maps
from skfmap.learner.training_set import TrainingSet
from skfmap.metrics import GeodesicDistances, geodesic_error, pair_errors, reference_distances
from skfmap.persistence import load_model, save_model
from skfmap.registration.part import _samples
from skfmap.shapes import JoinedPairs, SurfacePlaces
from skfmap.shapes.correspondence import _correspondence

few = settings(max_examples=25)


def on_faces(mesh, n, seed=0):
    """Return random points of the faces of a mesh."""
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet([1, 1, 1], n)
    return np.einsum(
        "nc,ncd->nd", weights, mesh.vertices[mesh.faces[rng.integers(mesh.n_faces, size=n)]]
    )


def positions(truth, vertices):
    """Return the coordinates of the places of a correspondence."""
    return np.einsum("nc,ncd->nd", truth.places.weights, vertices[truth.places.corners])


def midpoints(mesh, n, seed=0):
    """Return the middle points of n well-mixed edges."""
    faces = mesh.faces[np.random.default_rng(seed).choice(mesh.n_faces, n, replace=False)]
    return mesh.vertices[faces[:, :2]].mean(axis=1)


@pytest.fixture(scope="module")
def named(collection):
    """Sixty named landmarks of each body between its vertices, in an order of each body's own."""
    found = []
    for i, (mesh, truth) in enumerate(zip(collection.meshes, collection.truths, strict=True)):
        near = mesh.vertices[truth.pairs[::5, 0]]
        at = near + 0.02 * np.random.default_rng(i).standard_normal(near.shape)
        order = np.random.default_rng(i).permutation(60)
        names = [f"L{t}" for t in order]
        found.append(Correspondence.from_points(at[order], mesh, names))
    return found


# Where points are on the surface


@pytest.mark.parametrize("make", [make_sphere, lambda: skfmap.datasets.make_creatures(1).meshes[0]])
def test_points_of_the_surface_are_their_own_places(make):
    mesh = make()
    points = on_faces(mesh, 50)
    truth = Correspondence.from_points(points, mesh)
    np.testing.assert_allclose(positions(truth, mesh.vertices), points, atol=1e-12)
    np.testing.assert_allclose(truth.distance, 0, atol=1e-12)
    np.testing.assert_allclose(truth.places.weights.sum(axis=1), 1, atol=1e-14)
    np.testing.assert_array_equal(truth.pairs[:, 0], truth.places.vertices)
    np.testing.assert_array_equal(truth.coordinates, points)


def test_no_point_of_the_surface_is_nearer_than_the_place(collection):
    mesh = collection.meshes[0]
    points = on_faces(mesh, 30) * np.random.default_rng(1).uniform(0.9, 1.1, (30, 1))
    truth = Correspondence.from_points(points, mesh)
    samples = on_faces(mesh, 20_000, seed=2)
    nearest = np.linalg.norm(samples[None] - points[:, None], axis=2).min(axis=1)
    assert (truth.distance <= nearest).all()
    assert (truth.distance > nearest - 0.05).all()
    apart = np.linalg.norm(positions(truth, mesh.vertices) - points, axis=1)
    np.testing.assert_allclose(truth.distance, apart, atol=1e-14)


def test_a_moved_shape_has_the_same_places(collection):
    mesh = collection.meshes[1]
    points = on_faces(mesh, 40) * 1.03
    turn = Rotation.random(random_state=3).as_matrix()
    moved = Mesh(25 * mesh.vertices @ turn + 100, mesh.faces)
    there = Correspondence.from_points(25 * points @ turn + 100, moved)
    here = Correspondence.from_points(points, mesh)
    np.testing.assert_allclose(there.distance, 25 * here.distance, rtol=1e-9)
    np.testing.assert_allclose(
        positions(there, mesh.vertices), positions(here, mesh.vertices), atol=1e-9
    )


def test_renumbered_vertices_take_places_with_them(collection):
    mesh = collection.meshes[1]
    truth = Correspondence.from_points(on_faces(mesh, 40), mesh)
    new = np.random.default_rng(0).permutation(mesh.n_vertices)
    vertices = np.empty_like(mesh.vertices)
    vertices[new] = mesh.vertices
    moved = truth.renumber(new)
    np.testing.assert_allclose(
        positions(moved, vertices), positions(truth, mesh.vertices), atol=1e-15
    )
    np.testing.assert_array_equal(moved.pairs[:, 0], new[truth.pairs[:, 0]])


def test_a_place_stays_where_half_of_its_weight_does():
    corners, weights = (
        [[0, 1, 2], [0, 1, 2], [2, 1, 0]],
        [[0.3, 0.5, 0.2], [0.6, 0.4, 0], [1, 0, 0]],
    )
    truth = Correspondence(
        [[1, 0], [0, 1], [2, 2]], places=(np.array(corners), weights), names=["a", "b", "c"]
    )
    left = truth.renumber([-1, 0, 1])
    assert left.known_names == ("a", "c")
    np.testing.assert_array_equal(left.pairs, [[0, 0], [1, 2]])
    at = np.zeros((2, 2))
    np.add.at(at, (np.arange(2)[:, None], left.places.corners), left.places.weights)
    np.testing.assert_allclose(at, [[5 / 7, 2 / 7], [0, 1]])


def test_points_on_slivers_and_faces_without_area_have_places():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-13, 0], [0.25, 0, 0], [2, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 3, 1]])
    points = np.array([[0.1, 0, 0], [0.5, 0, 0.2], [0.9, -0.1, 0]])
    found = nearest_places(points, vertices, faces)
    there = np.einsum("nc,ncd->nd", found.weights, vertices[found.corners])
    np.testing.assert_allclose(there, [[0.1, 0, 0], [0.5, 0, 0], [0.9, 0, 0]], atol=1e-9)
    np.testing.assert_allclose(found.distances, [0, 0.2, 0.1], atol=1e-9)


def test_unsound_faces_hold_no_places():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [np.nan, 0, 0]])
    faces = [[3, 1, 2], [0, 0, 1], [0, 1, 2], [0, 1, 9]]
    truth = Correspondence.from_points([[0.2, 0.3, 0]], (vertices, faces))
    np.testing.assert_array_equal(np.sort(truth.places.corners[0]), [0, 1, 2])
    assert truth.n_vertices == 4


def test_a_mesh_comes_as_any_object_with_vertices_and_faces():
    trimesh = pytest.importorskip("trimesh")
    sphere = make_sphere(2)
    points = on_faces(sphere, 10)
    own = Correspondence.from_points(points, sphere)
    for mesh in (
        trimesh.Trimesh(sphere.vertices, sphere.faces, process=False),
        (sphere.vertices, sphere.faces),
        [sphere.vertices.tolist(), sphere.faces.tolist()],
    ):
        other = Correspondence.from_points(points, mesh)
        np.testing.assert_array_equal(other.places.corners, own.places.corners)


def test_missing_landmarks_have_no_pair_and_keep_the_numbers_of_others():
    sphere = make_sphere(2)
    points = on_faces(sphere, 5)
    points[[1, 3]] = np.nan
    truth = Correspondence.from_points(Landmarks(points, list("abcde")), sphere)
    assert truth.pairs[:, 1].tolist() == [0, 2, 4]
    assert truth.known_names == ("a", "c", "e")
    assert truth.names == tuple("abcde")
    nothing = Correspondence.from_points(np.full((5, 3), np.nan), sphere)
    assert len(nothing.pairs) == 0


# What is refused


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda p: p * 1000, r"divided by 1000 \(metres against millimetres"),
        (lambda p: p / 1000, r"multiplied by 1000 \(metres against millimetres"),
        (lambda p: p * 100, r"divided by 100 \(metres against centimetres"),
        (lambda p: p * 25.4, r"divided by 25.4 \(inches against millimetres"),
        (lambda p: p * [-1, -1, 1], r"x and y negated \(RAS against LPS"),
        (
            lambda p: p * [-0.001, -0.001, 0.001],
            r"multiplied by 1000 .* and with x and y negated",
        ),
        (lambda p: p + 7, "Check that the file belongs to this specimen, and that the mesh"),
        (lambda p: p * 7, r"span .* times its extent\. Check that the file belongs"),
    ],
)
def test_points_that_lie_off_the_mesh_are_an_error_with_the_likely_reason(
    collection, change, reason
):
    body = collection.meshes[0]
    mesh = Mesh(body.vertices + np.array([4, 3, 1]), body.faces, name="jaw")
    points = on_faces(mesh, 13)
    with pytest.raises(CorrespondenceError, match=r"do not lie on shape 'jaw'.*" + reason):
        Correspondence.from_points(change(points), mesh)


def test_points_that_lie_a_little_off_are_refused_where_other_signs_fit_far_better(
    symmetric_collection,
):
    body = symmetric_collection.meshes[0]
    swapped = body.vertices[:, [1, 0, 2]] + [0.12, 0, 0]  # x and y negated: nearly itself
    mesh = Mesh(swapped, body.faces, name="jaw")
    points = on_faces(mesh, 40) * [-1, -1, 1]
    with pytest.raises(CorrespondenceError, match="RAS against LPS"):
        Correspondence.from_points(points, mesh)


def test_one_point_far_off_is_named_and_may_be_allowed(collection):
    mesh = collection.meshes[0]
    points = on_faces(mesh, 13)
    points[4] += 3 * points[4] / np.linalg.norm(points[4])
    names = [f"point {t}" for t in range(13)]
    with pytest.raises(CorrespondenceError, match=r"of shape 'body0'.*20%.*: 'point 4' \("):
        Correspondence.from_points(points, mesh, names)
    assert len(Correspondence.from_points(points, mesh, names, max_distance=5).pairs) == 13
    points[4] = np.nan
    assert len(Correspondence.from_points(points, mesh, names).pairs) == 12


def test_what_is_no_mesh_or_no_points_is_refused():
    sphere = make_sphere(1)
    with pytest.raises(TypeError, match=r"got str\. Read files with skfmap\.io\.read_mesh"):
        Correspondence.from_points([[0, 0, 1]], "sphere.ply")
    with pytest.raises(CorrespondenceError, match="already have names"):
        Correspondence.from_points(Landmarks([[0, 0, 1]]), sphere, ["north"])
    with pytest.raises(ValueError, match="max_distance"):
        Correspondence.from_points([[0, 0, 1]], sphere, max_distance=-1)
    with pytest.raises(MeshError, match="no sound face"):
        Correspondence.from_points([[0, 0, 1]], (sphere.vertices, [[0, 0, 1]]))
    with pytest.raises(MeshError, match="must have shape"):
        Correspondence.from_points([[0, 0, 1]], (sphere.vertices[:, :2], sphere.faces))
    with pytest.raises(MeshError, match="must be integers"):
        Correspondence.from_points([[0, 0, 1]], (sphere.vertices, sphere.faces + 0.5))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"places": 3}, "pair of arrays"),
        ({"places": ([[0, 1, 2]], [[0.5, 0.4, 0.3]])}, "must sum to 1"),
        ({"places": ([[0, 1, 2]], [[1.5, -0.5, 0]])}, "must be non-negative"),
        ({"places": ([[0, 1]], [[1, 0, 0]])}, "integers of shape"),
        ({"places": ([[0, 1, -2]], [[1, 0, 0]])}, "negative index"),
        ({"places": ([[0, 1, 2]], [[0.2, 0.5, 0.3]])}, "its largest weight at another corner"),
        ({"names": "nose"}, "sequence of strings"),
        ({"names": 5}, "sequence of strings"),
        ({"names": ["nose", "nose"]}, "have the same name: nose"),
        ({"names": []}, "There are 0 names"),
        ({"coordinates": [[0, 0, np.nan]]}, "coordinates must be finite"),
        ({"distance": [1, 2]}, r"distance must be finite, of shape \(1,\)"),
    ],
)
def test_places_names_and_coordinates_that_do_not_fit_are_refused(given, message):
    with pytest.raises(CorrespondenceError, match=message):
        Correspondence([[0, 0]], **given)


# Names


def test_named_points_are_joined_by_name_and_numbered_as_on_this_shape():
    one = Correspondence([[10, 0], [11, 1], [12, 2]], names=["a", "b", "c"])
    other = Correspondence([[20, 0], [21, 1], [22, 2]], names=["d", "c", "a"])
    joined = one.join(other)
    assert joined.vertices_i.tolist() == [10, 12]
    assert joined.vertices_0.tolist() == [22, 21]
    assert joined.points.tolist() == [0, 2]


def test_the_symmetric_answer_is_joined_by_name_too():
    one = Correspondence([[10, 0], [11, 1]], names=["left", "right"])
    other = Correspondence([[20, 0], [21, 1]], [[21, 0], [20, 1]], names=["right", "left"])
    assert one.join(other).vertices_0.tolist() == [21, 20]
    assert one.join(other, symmetric=True).vertices_0.tolist() == [20, 21]


def test_names_that_cannot_be_joined_are_an_error_that_tells_them():
    named = Correspondence([[1, 0]], names=["nose"])
    with pytest.raises(CorrespondenceError, match=r"names .*nose.* the other does not"):
        named.join(Correspondence([[1, 0]]))
    with pytest.raises(CorrespondenceError, match=r"names .*nose.* the other does not"):
        Correspondence([[1, 0]]).join(named)
    with pytest.raises(CorrespondenceError, match="in common: nose against chin, ear"):
        named.join(Correspondence([[1, 0]], names=["chin", "ear"]))


def test_numbers_by_names_leave_out_what_is_not_listed():
    truth = Correspondence(
        [[5, 0], [6, 1], [7, 2]],
        [[6, 0], [5, 1]],
        weights=[1, 2, 3],
        symmetric_weights=[4, 5],
        names=["left", "right", "tip"],
    )
    found = truth.number_by(["tip", "right", "ear"])
    assert found.pairs.tolist() == [[6, 1], [7, 0]]
    assert found.weights.tolist() == [2, 3]
    assert found.symmetric_pairs.tolist() == [[5, 1]]
    assert found.symmetric_weights.tolist() == [5]
    assert found.known_names == ("tip", "right")
    with pytest.raises(CorrespondenceError, match="in common: ear against left, right, tip"):
        truth.number_by(["ear"])


def test_restriction_takes_names(named):
    truth = named[0]
    some = truth.restrict(["L3", "L7"])
    assert set(some.known_names) == {"L3", "L7"}
    assert some.names == truth.names
    numbers = [truth.names.index("L3"), truth.names.index("L7")]
    np.testing.assert_array_equal(some.pairs, truth.restrict(numbers).pairs)
    np.testing.assert_array_equal(some.distance, truth.restrict(numbers).distance)
    assert truth.restrict("L3").known_names == ("L3",)
    assert set(truth.restrict(np.array(["L3", "L7"], dtype=object)).known_names) == {"L3", "L7"}
    with pytest.raises(CorrespondenceError, match=r"called ear\. The names are L"):
        truth.restrict(["ear"])
    with pytest.raises(CorrespondenceError, match="have no names"):
        Correspondence([[1, 0]]).restrict(["ear"])


@few
@given(st.permutations(range(6)), st.sets(st.integers(0, 5)), st.integers(0, 2**16))
def test_what_is_joined_depends_on_no_order_of_names(order, missing, seed):
    """Whatever the order of one side and what it lacks, each name meets its own place."""
    sphere = make_sphere(2)
    points, others = on_faces(sphere, 6, seed), on_faces(sphere, 6, seed + 1)
    names = list("abcdef")
    one = Correspondence.from_points(points, sphere, names)
    shuffled = others[order].copy()
    shuffled[[j for j, t in enumerate(order) if t in missing]] = np.nan
    other = Correspondence.from_points(shuffled, sphere, [names[t] for t in order])
    joined = one.join(other)
    assert joined.points.tolist() == [t for t in range(6) if t not in missing]
    for places, at in ((joined.places_i, points), (joined.places_0, others)):
        there = np.einsum("nc,ncd->nd", places.weights, sphere.vertices[places.corners])
        np.testing.assert_allclose(there, at[joined.points], atol=1e-12)
    back = other.join(one)
    assert sorted(joined.vertices_i.tolist()) == sorted(back.vertices_0.tolist())
    kept = other.number_by(names)
    np.testing.assert_array_equal(one.join(kept).vertices_0, joined.vertices_0)


# Copies


def test_copies_hold_all_and_are_immutable(named):
    truth = named[0].restrict(["L1", "L2", "L3"])
    for other in (pickle.loads(pickle.dumps(truth)), copy.deepcopy(truth), copy.copy(truth)):
        assert repr(other) == "Correspondence(n_pairs=3, n_symmetric_pairs=none, named)"
        assert other.names == truth.names
        assert isinstance(other.places, SurfacePlaces)
        for one, own in (
            (other.pairs, truth.pairs),
            (other.places.corners, truth.places.corners),
            (other.places.weights, truth.places.weights),
            (other.coordinates, truth.coordinates),
            (other.distance, truth.distance),
        ):
            np.testing.assert_array_equal(one, own)
            with pytest.raises(ValueError, match="read-only"):
                one[0] = 0


def test_pickles_from_before_places_are_read():
    pairs = np.array([[3, 0]])
    old = _correspondence(pairs, None, None, None, 5)
    assert old.places is None
    assert old.names is None
    assert old.__reduce__() == (_correspondence, (old.pairs, None, None, None, 5))


# Known maps and fits


def test_vertices_given_as_points_make_the_same_known_maps(collection):
    shapes = SpectralBasis(30).transform(collection.meshes[:3])
    shapes = skfmap.DescriptorTransformer().transform(shapes)
    truths = [truth.restrict(range(0, 300, 3)) for truth in collection.truths[:3]]
    as_points = [
        Correspondence.from_points(
            mesh.vertices[truth.pairs[np.argsort(truth.pairs[:, 1]), 0]], mesh
        )
        for mesh, truth in zip(collection.meshes, truths, strict=False)
    ]
    maps = [
        ground_truth_maps(shapes[1:], shapes[0], [one.join(given[0]) for one in given[1:]], 20)
        for given in (truths, as_points)
    ]
    np.testing.assert_allclose(maps[0], maps[1], atol=1e-10)


def test_places_make_better_known_maps_than_nearest_vertices(make_bodies):
    """Of two meshes of one surface, by landmarks in the middle of the edges of one."""
    bodies = make_bodies([(500, 0.0), (620, 0.0)], symmetric=False)
    shapes = SpectralBasis(30).transform(bodies.meshes)
    shapes = skfmap.DescriptorTransformer().transform(shapes)
    errors = {"places": [], "vertices": []}
    for i, j in ((0, 1), (1, 0)):
        dense = on_faces(bodies.meshes[i], 4000)
        best = maps_between(shapes, bodies.meshes, i, j, dense)
        points = midpoints(bodies.meshes[i], 90, seed=i)
        for kind, found in errors.items():
            C = maps_between(shapes, bodies.meshes, i, j, points, vertices=kind == "vertices")
            found.append(np.linalg.norm(C - best))
    assert (np.array(errors["places"]) < 0.5 * np.array(errors["vertices"])).all()


def maps_between(shapes, meshes, i, j, points, *, vertices=False):
    """Return the known map that points of one surface make."""
    one, other = (Correspondence.from_points(points, meshes[which]) for which in (i, j))
    if vertices:
        one, other = Correspondence(one.pairs), Correspondence(other.pairs)
    return ground_truth_maps([shapes[i]], shapes[j], [one.join(other)], 20)[0]


def test_a_fit_by_names_is_the_fit_by_one_numbering(probed, named):
    names = [f"L{t}" for t in range(60)]
    unnamed = [
        Correspondence(one.pairs, places=one.places, n_vertices=one.n_vertices)
        for one in (truth.number_by(names) for truth in named)
    ]
    for reference in ("first", "medoid"):
        by_name, by_number = (
            skfmap.WeightedFunctionalMapLearner(
                n_functions=15, confidence=None, reference=reference
            ).fit(probed, truths)
            for truths in (named, unnamed)
        )
        assert by_name.reference_index_ == by_number.reference_index_
        np.testing.assert_allclose(by_name.weights_, by_number.weights_, rtol=1e-6)


def test_names_of_some_shapes_only_are_refused(probed, named, collection):
    learner = skfmap.WeightedFunctionalMapLearner(n_functions=15, confidence=None)
    with pytest.raises(CorrespondenceError, match=r"X\[0\].*have names.*X\[1\].*do not"):
        learner.fit(probed[:2], [named[0], collection.truths[1]])
    others = Correspondence(named[1].pairs, names=[f"other {t}" for t in range(60)])
    with pytest.raises(CorrespondenceError, match=r"share no template point \(other .* against L"):
        learner.fit(probed[:2], [named[0], others])


def test_places_of_a_mesh_with_fewer_vertices_are_refused(probed):
    learner = skfmap.WeightedFunctionalMapLearner(n_functions=15, confidence=None)
    truth = Correspondence([[0, 0]], places=([[0, 1, 10**6]], [[1.0, 0, 0]]))
    with pytest.raises(CorrespondenceError, match=r"The places of y\[0\].*vertex 1000000"):
        learner.fit(probed[:2], [truth, truth])


def test_a_saved_model_keeps_places_and_names(probed, named, tmp_path):
    learner = skfmap.WeightedFunctionalMapLearner(n_functions=15, confidence=None)
    learner.fit(probed[:4], named[:4])
    save_model(learner, tmp_path / "model.skops")
    loaded = load_model(tmp_path / "model.skops")
    before, after = learner.reference_correspondence_, loaded.reference_correspondence_
    assert after.names == before.names
    np.testing.assert_array_equal(after.places.weights, before.places.weights)
    assert loaded.score(probed[4:], named[4:]) == learner.score(probed[4:], named[4:])


# Scores


@pytest.mark.parametrize("max_vertices", [None, 300])
def test_a_perfect_answer_has_no_error_between_vertices(collection, max_vertices):
    mesh = collection.meshes[0]
    spectral = SpectralBasis(30, max_vertices=max_vertices).transform([mesh])[0]
    distances = PlaceDistances(spectral, reference_distances(spectral.mesh))
    truth = Correspondence.from_points(on_faces(mesh, 40), mesh)
    p2p = np.arange(mesh.n_vertices)
    np.testing.assert_allclose(pair_errors(p2p, truth, truth, distances).direct, 0, atol=1e-7)


def test_errors_are_distances_of_places_on_the_sphere():
    """Between the ends of arcs: within the faces' flatness of a great circle's length."""
    sphere = make_sphere(4)
    rng = np.random.default_rng(0)
    true, sent = (on_faces(sphere, 60, seed) for seed in (1, 2))
    truth_0 = Correspondence.from_points(true, sphere)
    truth_i = Correspondence(np.column_stack([np.arange(60), np.arange(60)]))
    p2p = rng.integers(sphere.n_vertices, size=sphere.n_vertices)
    distances = GeodesicDistances(sphere, "exact")
    errors = pair_errors(p2p, truth_i, truth_0, distances).direct
    unit = true / np.linalg.norm(true, axis=1, keepdims=True)
    arcs = np.arccos(np.clip((sphere.vertices[p2p[:60]] * unit).sum(axis=1), -1, 1))
    np.testing.assert_allclose(errors * np.sqrt(sphere.area), arcs, rtol=0.005, atol=0.02)
    places = Correspondence.from_points(sent, sphere).places
    back = distances.between_places(places, truth_0.places)
    arcs = np.arccos(
        np.clip(
            (sent * true).sum(axis=1) / np.prod(np.linalg.norm([sent, true], axis=2), axis=0), -1, 1
        )
    )
    np.testing.assert_allclose(back * np.sqrt(sphere.area), arcs, rtol=0.005, atol=0.02)


def test_a_place_at_a_vertex_is_as_far_as_the_vertex(collection):
    mesh = collection.meshes[0]
    distances = GeodesicDistances(mesh)
    rng = np.random.default_rng(0)
    points, sources = rng.integers(mesh.n_vertices, size=(2, 50))
    as_places = distances.between_places(
        SurfacePlaces.at_vertices(points), SurfacePlaces.at_vertices(sources)
    )
    np.testing.assert_allclose(as_places, distances.between(points, sources), rtol=1e-6)


def test_scores_of_named_places_need_no_common_order(collection, named):
    distances = GeodesicDistances(collection.meshes[0])
    tree_to_0 = collection.truths[1].join(collection.truths[0])
    p2p = np.zeros(collection.meshes[1].n_vertices, dtype=int)
    p2p[tree_to_0.vertices_i] = tree_to_0.vertices_0
    names = named[0].names
    own = geodesic_error(p2p, named[1], named[0], distances)
    assert own == pytest.approx(geodesic_error(p2p, named[1].number_by(names), named[0], distances))


def test_pairs_without_places_are_the_same_in_a_selection():
    pairs = JoinedPairs(*(np.arange(4) for _ in range(3)), np.ones(4))
    assert pairs.take(np.array([2])).places_i is None
    assert pairs.take(np.array([2])).vertices_0.tolist() == [2]


def test_functions_and_coordinates_at_places_are_interpolated(collection):
    mesh = collection.meshes[0]
    truth = Correspondence.from_points(on_faces(mesh, 20), mesh)
    spectral = SpectralBasis(12).transform([mesh])[0]
    at = spectral.place_matrix(truth.pairs[:, 0], truth.places)
    np.testing.assert_allclose(
        at @ spectral.mesh.vertices, positions(truth, mesh.vertices), atol=1e-12
    )
    np.testing.assert_allclose(
        at @ spectral.evecs, spectral.evecs_at(truth.pairs[:, 0], 12, truth.places), atol=1e-12
    )


def test_errors_that_are_learned_from_are_those_of_places(make_bodies):
    """The identity has none, although no landmark is at a vertex."""
    body = make_bodies([(500, 0.0)], symmetric=False).meshes[0]
    shapes = skfmap.DescriptorTransformer().transform(SpectralBasis(30).transform([body, body]))
    truth = Correspondence.from_points(midpoints(body, 60), body)
    learner = skfmap.WeightedFunctionalMapLearner(n_functions=20, refine="icp")
    learner.fit(shapes, [truth, truth])
    assert learner.confidence_.training_errors_[1] == pytest.approx(0, abs=1e-6)
    assert -learner.score(shapes[1:], [truth]) == pytest.approx(0, abs=1e-6)


def test_places_of_a_thinned_mesh_are_means_over_the_places_of_their_corners(collection):
    mesh = collection.meshes[0]
    truth = Correspondence.from_points(on_faces(mesh, 20), mesh)
    spectral = SpectralBasis(12, max_vertices=300).transform([mesh])[0]
    assert not spectral.keeps_vertices
    found = spectral.vertices_at(truth.pairs[:, 0], truth.places)
    corners = spectral.vertices_at(truth.places.corners.ravel()).reshape(-1, 3, 3)
    expected = np.einsum("nc,ncd->nd", truth.places.weights, corners)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    off = np.linalg.norm(found * np.sqrt(spectral.area) - truth.coordinates, axis=1)
    assert off.max() < 0.1


def test_a_registration_is_drawn_to_places(collection, probed, named):
    """From the landmarks on the reference to those measured on the shape, not to vertices."""
    learner = skfmap.WeightedFunctionalMapLearner(n_functions=15, confidence=None, refine=None)
    learner.fit(probed[:3], named[:3])
    training = TrainingSet.from_samples(probed[:3], named[:3], n_functions=15)
    drawn = _samples(training, learner.matcher_, None, "similarity")[0].pairs
    for which, found in ((1, drawn.points), (0, drawn.places @ probed[0].spectral.vertices)):
        truth, mesh = named[which].number_by(named[0].names), collection.meshes[which]
        order = np.argsort(truth.pairs[:, 1])
        there = truth.coordinates if which == 1 else positions(truth, mesh.vertices)
        expected = there[order] / np.sqrt(mesh.area)
        joined = training.joins[0].points
        np.testing.assert_allclose(found, expected[joined], atol=1e-9)
