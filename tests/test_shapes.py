"""Frozen data: what goes in is checked and copied, what comes out cannot be changed."""

import copy
import pickle
from dataclasses import FrozenInstanceError

import joblib
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from skfmap import Correspondence, Match, Mesh, SpectralBasis, check_mesh, repair_mesh
from skfmap.datasets import make_sphere
from skfmap.exceptions import CorrespondenceError, MeshError

quick = settings(max_examples=40)


@pytest.fixture
def mesh(tetrahedron):
    return Mesh(*tetrahedron, name="tetra")


def rows_of(joined):
    """Return the joined pairs as a sorted list."""
    columns = (joined.vertices_i, joined.vertices_0, joined.points, joined.weights)
    return sorted(zip(*(column.tolist() for column in columns), strict=True))


# Mesh


def test_mesh_cannot_be_changed(mesh):
    with pytest.raises(FrozenInstanceError):
        mesh.name = "other"
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0, 0] = 1
    with pytest.raises(ValueError, match="read-only"):
        mesh.faces[0] = 0


def test_mesh_shares_no_memory_with_its_input(tetrahedron):
    vertices, faces = (array.copy() for array in tetrahedron)
    mesh = Mesh(vertices, faces)
    before = mesh.content_hash
    assert not np.shares_memory(mesh.vertices, vertices)
    assert not np.shares_memory(mesh.faces, faces)
    vertices[0] = 5
    faces[0] = 0
    np.testing.assert_array_equal(mesh.vertices, tetrahedron[0])
    np.testing.assert_array_equal(mesh.faces, tetrahedron[1])
    assert mesh.content_hash == before == Mesh(*tetrahedron).content_hash


def test_making_a_mesh_leaves_its_input_as_it_was(tetrahedron):
    vertices, faces = (
        np.asfortranarray(tetrahedron[0], dtype=np.float32),
        tetrahedron[1].astype(np.uint16),
    )
    Mesh(vertices, faces)
    assert vertices.flags.writeable
    assert faces.flags.writeable
    assert vertices.dtype == np.float32
    np.testing.assert_array_equal(vertices, tetrahedron[0])
    np.testing.assert_array_equal(faces, tetrahedron[1])


@pytest.mark.parametrize("dtype", [np.int32, np.uint8, np.uint64])
def test_hash_is_of_the_content_and_not_of_name_dtype_or_layout(tetrahedron, mesh, dtype):
    vertices, faces = tetrahedron
    same = Mesh(np.asfortranarray(vertices), faces.astype(dtype), name="another")
    assert same.content_hash == mesh.content_hash


@pytest.mark.parametrize("index", [(0, 0), (3, 2)])
def test_hash_sees_one_coordinate(tetrahedron, mesh, index):
    vertices = tetrahedron[0].copy()
    vertices[index] = np.nextafter(vertices[index], 2)
    assert Mesh(vertices, tetrahedron[1]).content_hash != mesh.content_hash


def test_hash_sees_the_order_of_faces_and_vertices(tetrahedron, mesh):
    vertices, faces = tetrahedron
    assert Mesh(vertices, faces[::-1]).content_hash != mesh.content_hash
    assert Mesh(vertices[::-1], faces).content_hash != mesh.content_hash


@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, lambda mesh: pickle.loads(pickle.dumps(mesh))]
)
def test_copies_of_a_mesh_are_the_mesh(mesh, duplicate):
    other = duplicate(mesh)
    assert other.name == "tetra"
    assert other.content_hash == mesh.content_hash
    np.testing.assert_array_equal(other.vertices, mesh.vertices)
    np.testing.assert_array_equal(other.faces, mesh.faces)


@pytest.mark.parametrize(
    "duplicate", [copy.deepcopy, lambda mesh: pickle.loads(pickle.dumps(mesh))]
)
def test_copies_of_a_mesh_cannot_be_changed_either(mesh, duplicate):
    other = duplicate(mesh)
    with pytest.raises(ValueError, match="read-only"):
        other.vertices[0, 0] = 1


def test_joblib_sees_the_same_mesh_before_and_after_its_area_is_known(tetrahedron):
    mesh = Mesh(*tetrahedron)
    before = joblib.hash(mesh)
    assert mesh.area > 0
    assert mesh.content_hash
    assert joblib.hash(mesh) == before


def test_samples_do_not_look_like_arrays(mesh, probed, collection):
    for thing in (mesh, probed[0], probed[0].spectral, collection.truths[0]):
        for attribute in ("__len__", "__array__", "__array_interface__", "__iter__", "__getitem__"):
            assert not hasattr(thing, attribute), (thing, attribute)
    assert not hasattr(mesh, "shape")


def test_area_and_counts(mesh):
    assert mesh.area == pytest.approx(1.5 + np.sqrt(3) / 2)
    assert (mesh.n_vertices, mesh.n_faces) == (4, 4)
    assert repr(mesh) == "Mesh('tetra', n_vertices=4, n_faces=4)"
    assert repr(Mesh(mesh.vertices, mesh.faces)) == "Mesh(n_vertices=4, n_faces=4)"


TRIANGLE = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "first is vertex 0"),
        ([[0, 0, 0], [1, 0, 0], [0, np.inf, 0]], [[0, 1, 2]], "first is vertex 2"),
        ([["a", "b", "c"]], [[0, 1, 2]], "must hold real numbers"),
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], r"\(n_vertices, 3\)"),
        (np.zeros(9), [[0, 1, 2]], r"\(n_vertices, 3\)"),
        (np.zeros((0, 3)), [[0, 1, 2]], "no vertices"),
        (TRIANGLE, [[0, 1, 3]], "refer to vertex 3, but there are 3"),
        (TRIANGLE, [[1, 2, 3]], "0-based"),
        (TRIANGLE, [[0, 1, -1]], "refer to vertex -1"),
        (TRIANGLE, [[0, 1, 2, 0]], "triangles"),
        (TRIANGLE, [0, 1, 2], "triangles"),
        (TRIANGLE, [[0.0, 1, 2]], "integers"),
        (TRIANGLE, [[True, False, True]], "integers"),
        (TRIANGLE, np.zeros((0, 3), int), "point clouds"),
        (TRIANGLE, [[0, 1, 2], [0, 1, 2, 0]], "triangles"),
        ([[0.0, 0, 0], [1, 0], [0, 1, 0]], [[0, 1, 2]], "vertices"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_bad_meshes_are_refused_by_name(vertices, faces, message):
    with pytest.raises(MeshError, match=message) as error:
        Mesh(vertices, faces, name="the cat")
    assert "the cat" in str(error.value)


def test_a_point_cloud_without_any_faces_is_refused_as_such():
    with pytest.raises(MeshError, match="faces"):
        Mesh(TRIANGLE, [], name="cloud")


# SpectralShape, ProbedShape, Match


def test_spectral_shape_keeps_both_units(collection):
    mesh = collection.meshes[5]
    big = Mesh(10 * mesh.vertices, mesh.faces)
    one, other = SpectralBasis(6).transform([mesh, big])
    np.testing.assert_allclose(one.evals, other.evals, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(
        one.evals_in_mesh_units, 100 * other.evals_in_mesh_units, rtol=1e-8, atol=1e-9
    )
    np.testing.assert_allclose(one.vertices, other.vertices)
    assert other.area == pytest.approx(100 * one.area)
    assert Mesh(one.vertices, mesh.faces).area == pytest.approx(1)
    assert one.mass.sum() == pytest.approx(1)


def test_truncation_keeps_the_first_functions(probed):
    shape = probed[0].spectral
    cut = shape.truncate(5)
    assert cut.n_components == 5
    np.testing.assert_array_equal(cut.evecs, shape.evecs[:, :5])
    assert cut.mesh is shape.mesh


def test_a_single_function_of_the_probed_shape_is_its_column(probed):
    shape = probed[1]
    functions = shape.functions()
    assert functions.shape == (shape.spectral.mesh.n_vertices, len(shape.probe_names))
    np.testing.assert_allclose(functions[:, 3], shape.spectral.evecs @ shape.probes[:, 3])
    assert "body1" in repr(shape)
    assert "body1" in repr(shape.spectral)


def test_match_says_both_names():
    match = Match(
        np.zeros(2, int), np.array([0.1, 0.3]), np.ones(2), np.eye(2), np.eye(2), "cat1", "cat0"
    )
    assert repr(match) == "Match('cat1' -> 'cat0', mean expected error 0.200 sqrt(area))"


# Correspondence


@quick
@given(st.permutations(range(9)), st.permutations(range(9)))
def test_all_constructors_say_the_same(points, points_0):
    """Vertex v stands on template point ``points[v]``, said in four ways."""
    points = np.array(points)
    matrix = np.zeros((9, 9))
    matrix[np.arange(9), points] = 1
    forms = [
        Correspondence.from_vertices(points),
        Correspondence.from_template(np.argsort(points)),
        Correspondence.from_matrix(matrix),
        Correspondence.from_matrix(sp.csr_array(matrix)),
        Correspondence(np.column_stack([np.arange(9), points])),
    ]
    reference = Correspondence.from_vertices(points_0)
    expected = sorted((v, list(points_0).index(p), p, 1.0) for v, p in enumerate(points.tolist()))
    for form in forms:
        assert rows_of(form.join(reference)) == expected
        assert rows_of(form.join(form)) == sorted(
            (v, v, p, 1.0) for v, p in enumerate(points.tolist())
        )


_pairs = st.lists(st.tuples(st.integers(0, 5), st.integers(0, 4)), max_size=12)


@quick
@given(_pairs, _pairs, st.randoms())
def test_join_agrees_with_brute_force(pairs_i, pairs_0, random):
    weights_i, weights_0 = ([random.randint(0, 3) for _ in pairs] for pairs in (pairs_i, pairs_0))
    a = Correspondence(np.reshape(pairs_i, (-1, 2)).astype(int), weights=weights_i)
    b = Correspondence(np.reshape(pairs_0, (-1, 2)).astype(int), weights=weights_0)
    on_point = {
        p: sum(w for (_, q), w in zip(pairs_0, weights_0, strict=True) if q == p)
        for _, p in pairs_0
    }
    expected = [
        (v, v_0, point, w * (w_0 / on_point[point]))
        for (v, point), w in zip(pairs_i, weights_i, strict=True)
        for (v_0, point_0), w_0 in zip(pairs_0, weights_0, strict=True)
        if point == point_0 and w * w_0 > 0
    ]
    joined = a.join(b)
    assert rows_of(joined) == sorted(expected)
    assert joined.vertices_i.tolist() == [
        row[0] for row in expected
    ]  # in the order of the first shape's pairs


def test_unknown_vertices_and_points_are_left_out():
    assert Correspondence.from_vertices([2, -1, 0]).pairs.tolist() == [[0, 2], [2, 0]]
    assert Correspondence.from_template([2, -1, 0]).pairs.tolist() == [[2, 0], [0, 2]]
    assert Correspondence.from_vertices([-1, -1]).pairs.shape == (0, 2)
    for make in (Correspondence.from_vertices, Correspondence.from_template):
        with pytest.raises(CorrespondenceError, match="-2"):
            make([0, -2])


def test_one_dimension_is_refused_with_both_readings():
    with pytest.raises(TypeError, match="from_vertices") as error:
        Correspondence([2, 0, 1])
    assert "from_template" in str(error.value)
    with pytest.raises(TypeError, match="from_template"):
        Correspondence([[0, 1]], [2, 0, 1])


@pytest.mark.parametrize(
    "make",
    [
        lambda a: Correspondence(np.column_stack([a, a])),
        Correspondence.from_vertices,
        Correspondence.from_template,
    ],
)
@pytest.mark.parametrize("dtype", [float, bool, object])
def test_only_integers_number_vertices(make, dtype):
    with pytest.raises(TypeError, match="integers"):
        make(np.array([0, 1, 2], dtype=dtype))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[0, 1, 2]],), r"\(n_pairs, 2\)"),
        (([[0, -1]],), "negative index -1"),
        (([[-3, 1]],), "negative index -3"),
        (([[0, 1]], [[0, -1]]), "symmetric_pairs holds the negative"),
    ],
)
def test_bad_pairs_are_refused(arguments, message):
    with pytest.raises(CorrespondenceError, match=message):
        Correspondence(*arguments)


@pytest.mark.parametrize("weights", [[1.0, 2.0], [-1.0], [np.nan], [np.inf]])
def test_bad_weights_are_refused(weights):
    with pytest.raises(CorrespondenceError, match="weights must"):
        Correspondence([[0, 1]], weights=weights)
    with pytest.raises(CorrespondenceError, match="symmetric_weights must"):
        Correspondence([[0, 1]], [[0, 1]], symmetric_weights=weights)


def test_symmetric_weights_without_symmetric_pairs_are_refused():
    with pytest.raises(CorrespondenceError, match="without symmetric_pairs"):
        Correspondence([[0, 1]], symmetric_weights=[1.0])


def test_negative_entries_of_a_matrix_are_refused():
    with pytest.raises(CorrespondenceError, match="non-negative"):
        Correspondence.from_matrix([[0.5, -0.5]])
    with pytest.raises(CorrespondenceError, match="n_vertices, n_points"):
        Correspondence.from_matrix(np.ones(3))


def test_two_dimensions_are_refused_where_one_is_meant():
    for make in (Correspondence.from_vertices, Correspondence.from_template):
        with pytest.raises(CorrespondenceError, match="one-dimensional"):
            make([[0, 1], [1, 0]])


def test_a_soft_matrix_keeps_its_weights_and_is_left_alone():
    data = np.array([0.25, 0.5, 0.0, 1.0, 0.25])
    rows, columns = np.array([0, 0, 1, 2, 0]), np.array([1, 2, 0, 0, 1])
    matrix = sp.coo_array((data, (rows, columns)), shape=(3, 3))
    truth = Correspondence.from_matrix(matrix)
    assert dict(zip(map(tuple, truth.pairs.tolist()), truth.weights.tolist(), strict=True)) == {
        (0, 1): 0.5,  # entries given twice add up
        (0, 2): 0.5,
        (2, 0): 1.0,
    }
    assert matrix.nnz == 5
    plain = Correspondence.from_vertices([0, 1, 2])
    assert rows_of(truth.join(plain)) == [(0, 1, 1, 0.5), (0, 2, 2, 0.5), (2, 0, 0, 1.0)]
    assert rows_of(plain.join(truth)) == [(0, 2, 0, 1.0), (1, 0, 1, 1.0), (2, 0, 2, 1.0)]
    assert truth.join(truth).weights.tolist() == [0.5, 0.5, 1.0]


def test_many_to_one_on_both_sides():
    a = Correspondence([[0, 7], [1, 7], [5, 9]])
    b = Correspondence([[3, 7], [4, 7], [3, 8]])
    assert rows_of(a.join(b)) == [(0, 3, 7, 0.5), (0, 4, 7, 0.5), (1, 3, 7, 0.5), (1, 4, 7, 0.5)]


def test_an_empty_join_is_empty_and_of_the_right_types():
    joined = Correspondence([[0, 1]]).join(Correspondence([[0, 2]]))
    nothing = Correspondence(np.empty((0, 2), int)).join(Correspondence([[0, 2]]))
    for pairs in (joined, nothing):
        assert (
            len(pairs.points)
            == len(pairs.vertices_i)
            == len(pairs.vertices_0)
            == len(pairs.weights)
            == 0
        )
        assert np.issubdtype(pairs.vertices_0.dtype, np.integer)


def test_symmetric_join_leads_to_the_counterpart():
    a = Correspondence.from_template([4, 5])
    b = Correspondence.from_template([0, 1], symmetric=[1, -1])
    assert rows_of(a.join(b, symmetric=True)) == [(4, 1, 0, 1.0)]
    assert b.has_symmetric
    assert not a.has_symmetric
    with pytest.raises(CorrespondenceError, match="symmetric"):
        b.join(a, symmetric=True)


def test_symmetric_constructors_agree():
    by_vertex = Correspondence.from_vertices([0, 1, 2], symmetric=[1, 0, -1])
    by_point = Correspondence.from_template([0, 1, 2], symmetric=[1, 0, -1])
    by_matrix = Correspondence.from_matrix(np.eye(3), symmetric=[[0, 1, 0], [1, 0, 0], [0, 0, 0]])
    other = Correspondence.from_vertices([2, 1, 0])
    expected = [(1, 0, 1, 1.0), (2, 1, 0, 1.0)]
    for truth in (by_vertex, by_point, by_matrix):
        assert rows_of(other.join(truth, symmetric=True)) == expected


def test_restriction_keeps_the_pairs_of_the_chosen_points():
    truth = Correspondence(
        [[0, 3], [1, 4], [2, 5], [6, 3]],
        [[1, 4], [0, 3]],
        weights=[1, 2, 3, 4],
        symmetric_weights=[5, 6],
    )
    cut = truth.restrict([3, 5])
    assert cut.pairs.tolist() == [[0, 3], [2, 5], [6, 3]]
    assert cut.weights.tolist() == [1, 3, 4]
    assert cut.symmetric_pairs.tolist() == [[0, 3]]
    assert cut.symmetric_weights.tolist() == [6]
    assert truth.pairs.shape == (4, 2)
    assert Correspondence([[0, 3]]).restrict([9]).pairs.shape == (0, 2)


def test_correspondence_cannot_be_changed_and_shares_no_memory():
    pairs, weights = np.array([[0, 1], [1, 0]]), np.array([1.0, 2.0])
    truth = Correspondence(pairs, pairs, weights=weights, symmetric_weights=weights)
    pairs[0], weights[0] = 9, 9
    assert truth.pairs.tolist() == truth.symmetric_pairs.tolist() == [[0, 1], [1, 0]]
    assert truth.weights.tolist() == truth.symmetric_weights.tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        truth.pairs[0, 0] = 1
    with pytest.raises(FrozenInstanceError):
        truth.pairs = pairs
    assert repr(truth) == "Correspondence(n_pairs=2, n_symmetric_pairs=2, soft)"


def test_correspondence_survives_pickling():
    truth = pickle.loads(pickle.dumps(Correspondence.from_template([3, 1], symmetric=[1, 3])))
    assert truth.pairs.tolist() == [[3, 0], [1, 1]]
    assert truth.symmetric_pairs.tolist() == [[1, 0], [3, 1]]


MASKED = np.ma.masked_array([4, 5, 6], mask=[0, 1, 1])


def test_what_is_masked_is_unknown_or_refused():
    assert Correspondence.from_vertices(MASKED).pairs.tolist() == [[0, 4]]
    assert Correspondence.from_template(MASKED).pairs.tolist() == [[4, 0]]
    ball = make_sphere(n_subdivisions=2)
    vertices, faces = (
        np.ma.masked_greater(np.array(ball.vertices), 0.9),
        np.ma.masked_less(np.array(ball.faces), 3),
    )
    for mesh in ((vertices, ball.faces), (ball.vertices, faces)):
        with pytest.raises(MeshError, match="must not be masked"):
            Mesh(*mesh)
        assert not check_mesh(mesh).usable()
    pairs = np.ma.masked_array([[0, 0], [1, 1]], mask=[[0, 0], [1, 1]])
    with pytest.raises(CorrespondenceError, match="pairs must not be masked"):
        Correspondence(pairs)
    with pytest.raises(CorrespondenceError, match="weights must not be masked"):
        Correspondence([[0, 0], [1, 1]], weights=np.ma.masked_array([1.0, 2], mask=[0, 1]))


@pytest.mark.parametrize(
    "change",
    [lambda v: v + 1j, lambda v: v.astype("M8[s]"), lambda v: v > 0, lambda v: v.astype(str)],
)
def test_coordinates_are_real_numbers(change):
    ball = make_sphere(n_subdivisions=2)
    with pytest.raises(MeshError, match="must hold real numbers"):
        Mesh(change(ball.vertices), ball.faces)
    assert not check_mesh((change(ball.vertices), ball.faces)).usable()
    with pytest.raises(MeshError, match="must hold real numbers"):
        repair_mesh((change(ball.vertices), ball.faces))
