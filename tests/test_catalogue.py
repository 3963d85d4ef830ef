"""Each fault, in each position, through the whole pipeline: no cell is another's traceback.

A match that comes out of it is as right as that of a sound mesh, or is told to be doubtful. What
happens to a mesh with a fault is written in one row: as it is, with the cotangent Laplacian and
with the robust one, and where it may be mended. The position changes nothing.
"""

import warnings
from functools import cache
from types import SimpleNamespace

import joblib
import numpy as np
import pytest
from scipy.spatial import cKDTree
from sklearn.pipeline import make_pipeline

import skfmap
from skfmap import (
    DescriptorTransformer,
    Mesh,
    SpectralBasis,
    WeightedFunctionalMapLearner,
    check_mesh,
    repair_mesh,
)
from skfmap.datasets import load_collection, make_sphere
from skfmap.exceptions import (
    MeshError,
    OrientationWarning,
    RepairWarning,
    SkippedShapeWarning,
    UnfamiliarShapeWarning,
)
from skfmap.metrics import pair_errors, reference_distances
from skfmap.shapes import SkippedShape

WORKS, WARNS, REFUSED = "works", "warns", "refused"
MENDED, HOPELESS = "mended", "hopeless"


def nan_vertex(vertices, faces):
    vertices[5] = np.nan
    return vertices, faces


def infinite_vertex(vertices, faces):
    vertices[5, 0] = np.inf
    return vertices, faces


def index_out_of_range(vertices, faces):
    faces[3, 1] = len(vertices)
    return vertices, faces


def negative_index(vertices, faces):
    faces[3, 1] = -1
    return vertices, faces


def repeated_corner(vertices, faces):
    faces[7, 0] = faces[7, 1]
    return vertices, faces


def face_twice(vertices, faces):
    return vertices, np.concatenate([faces, faces[:1]])


def unreferenced_vertex(vertices, faces):
    return np.concatenate([[[9.0, 9, 9]], vertices]), faces + 1


def face_without_area(vertices, faces):
    vertices[faces[7, 0]] = vertices[faces[7, 1]]
    return vertices, faces


def seam(vertices, faces):
    """Cut the mesh at the plane x = 0 into two, each with its own copy of the vertices on it."""
    left = (vertices[faces].mean(axis=1)[:, 0] < 0).nonzero()[0]
    cut = faces.copy()
    cut[left] += len(vertices)
    used, renumbered = np.unique(cut, return_inverse=True)
    return np.concatenate([vertices, vertices])[used], renumbered.reshape(cut.shape)


def two_bodies(vertices, faces):
    return np.concatenate([vertices, 0.1 * vertices + 9]), np.concatenate(
        [faces, faces + len(vertices)]
    )


def fin(vertices, faces):
    a, b, c = faces[7]
    tip = vertices[[a, b]].mean(axis=0) + 0.05 * (vertices[a] - vertices[c])
    return np.concatenate([vertices, [tip]]), np.concatenate([faces, [[b, a, len(vertices)]]])


def touching_point(vertices, faces):
    """Merge two far vertices: the surface touches itself there."""
    a, b = faces[0, 0], np.linalg.norm(vertices - vertices[faces[0, 0]], axis=1).argmax()
    merged = np.where(faces == b, a, faces)
    used, renumbered = np.unique(merged, return_inverse=True)
    return vertices[used], renumbered.reshape(faces.shape)


def hole(vertices, faces):
    return vertices, faces[~(faces == faces[7, 0]).any(axis=1) | (np.arange(len(faces)) == 7)]


def inconsistent_winding(vertices, faces):
    faces[::3] = faces[::3][:, [0, 2, 1]]
    return vertices, faces


def inside_out(vertices, faces):
    return vertices, faces[:, [0, 2, 1]]


def sliver(vertices, faces):
    a, b, c = faces[7]
    vertices[c] = 0.5 * (vertices[a] + vertices[b]) + 1e-4 * (vertices[c] - vertices[a])
    return vertices, faces


def tiny(vertices, faces):
    return 1e-60 * vertices, faces


def huge(vertices, faces):
    return 1e60 * vertices, faces


def beyond_numbers(vertices, faces):
    return 1e-180 * vertices, faces


def far_away(vertices, faces):
    return vertices + 1e7, faces


def without_digits(vertices, faces):
    return (vertices + 3e6).astype(np.float32).astype(float), faces


def no_faces(vertices, faces):
    return vertices, faces[:0]


def nothing(vertices, faces):
    return vertices[:0], faces[:0]


# fault: cotangent, robust, and where it may be mended
CATALOGUE = {
    nan_vertex: (REFUSED, REFUSED, MENDED),
    infinite_vertex: (REFUSED, REFUSED, MENDED),
    index_out_of_range: (REFUSED, REFUSED, MENDED),
    negative_index: (REFUSED, REFUSED, MENDED),
    repeated_corner: (REFUSED, REFUSED, MENDED),
    face_twice: (REFUSED, WARNS, MENDED),
    unreferenced_vertex: (REFUSED, REFUSED, MENDED),
    face_without_area: (REFUSED, WORKS, MENDED),
    seam: (REFUSED, REFUSED, MENDED),
    two_bodies: (REFUSED, REFUSED, MENDED),
    fin: (REFUSED, WARNS, MENDED),
    touching_point: (WORKS, WORKS, MENDED),
    hole: (WORKS, WORKS, WORKS),
    inconsistent_winding: (WORKS, WORKS, WORKS),
    inside_out: (WORKS, WORKS, WORKS),
    sliver: (WORKS, WORKS, WORKS),
    tiny: (WORKS, WORKS, WORKS),
    huge: (WORKS, WORKS, WORKS),
    beyond_numbers: (REFUSED, REFUSED, HOPELESS),
    far_away: (WORKS, WORKS, WORKS),
    without_digits: (REFUSED, WORKS, HOPELESS),
    no_faces: (REFUSED, REFUSED, HOPELESS),
    nothing: (REFUSED, REFUSED, HOPELESS),
}
HELPED = [fault for fault, row in CATALOGUE.items() if row[2] == MENDED]
LOST = [fault for fault, row in CATALOGUE.items() if row[2] == HOPELESS]
# Vertices have other numbers than in the sound mesh.
RENUMBERED = (unreferenced_vertex, seam, touching_point)
# As it is, it cannot be told which side is the outside.
WITHOUT_SIDES = (fin, face_twice)
POSITIONS = {"reference": 0, "training": 2, "new": 5}
# New shapes are matched from the fifth on, so that the broken one is the second of them.
CALLED = {"reference": "shape 0", "training": "shape 2", "new": "shape 1"}


@pytest.fixture(scope="module")
def memory(tmp_path_factory):
    return str(tmp_path_factory.mktemp("cache"))


def _broken(collection, fault, place):
    body = collection.meshes[place]
    with np.errstate(all="ignore"):
        return fault(body.vertices.copy(), body.faces.copy())


@pytest.fixture(scope="module")
def make(memory):
    """Return a function that makes an unfitted, small pipeline, which keeps what it computes."""

    def make_small(families=None, **parameters):
        return make_pipeline(
            SpectralBasis(20, memory=memory, **parameters),
            DescriptorTransformer(families, memory=memory),
            WeightedFunctionalMapLearner(
                n_functions=8, weighting="category", tol=1e-2, refine=None, memory=memory
            ),
        )

    return make_small


@pytest.fixture(scope="module")
def sound(make, collection):
    """Return a function that fits a pipeline on sound bodies, for all faults of new shapes."""

    @cache
    def fitted(families, **parameters):
        return make(families, **parameters).fit(collection.meshes[:5], collection.truths[:5])

    return fitted


@pytest.fixture(scope="module")
def outcome_of(make, sound, collection):
    """Return a function that runs everything with a broken mesh in one place.

    It returns what happened, the message, and the matches.
    """

    @cache
    def run(fault, place, on_invalid, laplacian="cotangent"):
        broken = _with_broken(collection, fault, place)
        families = "paper" if fault in WITHOUT_SIDES and on_invalid == "raise" else None
        how = {"laplacian": laplacian, "on_invalid": on_invalid}

        def learn_and_match():
            model = (
                sound(families, **how)
                if place >= 5
                else make(families, **how).fit(broken.meshes[:5], broken.truths[:5])
            )
            return model, skfmap.match(model, broken.meshes[4:])

        return _told(learn_and_match, broken.truths[4:])

    return run


def _with_broken(collection, fault, place):
    """Return the bodies with a broken one among them, and their correspondences."""
    meshes, truths = list(collection.meshes), list(collection.truths)
    meshes[place] = _broken(collection, fault, place)
    if fault in RENUMBERED:
        truths[place] = _at_the_same_places(
            truths[place], collection.meshes[place].vertices, meshes[place][0]
        )
    return SimpleNamespace(meshes=meshes, truths=truths)


def _told(learn_and_match, truths):
    """Return what happened, the message, and the matches, which are right or called doubtful."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            model, matches = learn_and_match()
        except MeshError as error:
            return REFUSED, str(error), None
    told = [
        w
        for w in caught
        if issubclass(w.category, (OrientationWarning, RepairWarning, SkippedShapeWarning))
    ]
    doubted = [str(w.message) for w in caught if issubclass(w.category, UnfamiliarShapeWarning)]
    for match, truth in zip(matches, truths, strict=True):
        assert _is_right(model[-1], match, truth) or any(
            repr(match.name) in message for message in doubted
        )
    return (WARNS if told else WORKS), " ".join(str(w.message) for w in told), matches


def _without_warnings(function):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return function()


def _at_the_same_places(truth, vertices, moved):
    """Return the correspondence of the vertices that have not moved, by their new indices."""
    distance, number = cKDTree(moved).query(vertices[truth.pairs[:, 0]])
    return skfmap.Correspondence(np.column_stack([number, truth.pairs[:, 1]])[distance == 0])


def _is_right(learner, match, truth):
    """Return whether a match is about as good as those of sound bodies, or as bad as it says.

    Where there is no match, none is wrong. With a broken reference all are bad: the training shapes
    have shown it. Errors are measured on the reference's working mesh, of which all that have an
    answer are vertices here.
    """
    pairs = truth.pairs[match.p2p[truth.pairs[:, 0]] >= 0] if len(match.p2p) else truth.pairs[:0]
    if len(pairs) == 0:
        return True
    reference = learner.reference_.spectral
    errors = pair_errors(
        reference.working_vertices(np.maximum(match.p2p, 0)),
        skfmap.Correspondence(pairs),
        learner.reference_correspondence_.renumber(
            reference.working_vertices(np.arange(reference.n_given))
        ),
        reference_distances(reference.mesh),
    )
    return errors.mean() < max(0.09, 1.2 * np.nanmean(match.expected_error))


@pytest.mark.parametrize("position", POSITIONS)
@pytest.mark.parametrize("fault", CATALOGUE)
def test_as_it_is_a_fault_is_refused_by_name_or_works(outcome_of, fault, position):
    place = POSITIONS[position]
    for laplacian, expected in zip(("cotangent", "robust"), CATALOGUE[fault], strict=False):
        outcome, message, matches = outcome_of(fault, place, "raise", laplacian)
        assert outcome == expected, (laplacian, message)
        assert "mended" not in message
        if outcome == REFUSED:
            assert CALLED[position] in message
        else:
            assert all(
                np.isfinite(match.expected_error).all() and (match.p2p >= 0).all()
                for match in matches
            )


@pytest.mark.parametrize("position", POSITIONS)
@pytest.mark.parametrize("fault", CATALOGUE)
def test_a_fault_is_mended_by_name_or_works(outcome_of, collection, fault, position):
    """Answers are on the vertices that were given, of the reference too."""
    place, expected = POSITIONS[position], CATALOGUE[fault][2]
    outcome, message, matches = outcome_of(fault, place, "mend")
    assert outcome == {WORKS: WORKS, MENDED: WARNS, HOPELESS: REFUSED}[expected], message
    assert outcome == WORKS or CALLED[position] in message
    assert ("Meshes were mended" in message) == (expected == MENDED)
    if expected == HOPELESS:
        return
    broken = _with_broken(collection, fault, place)
    counts = [len(_vertices(mesh)) for mesh in broken.meshes]
    gone = [_removed(fault if i == place else None, counts[i]) for i in (0, 4, 5)]
    for match, n, without in zip(matches, counts[4:], gone[1:], strict=True):
        assert match.matrix.shape == (n, counts[0])
        np.testing.assert_array_equal(match.p2p < 0, without)
        np.testing.assert_array_equal(np.isnan(match.expected_error), without)
        np.testing.assert_allclose(match.matrix.sum(axis=1), ~without)
        np.testing.assert_array_equal(match.inverse < 0, gone[0])
        assert not gone[0][match.p2p[~without]].any()
        assert not without[match.inverse[~gone[0]]].any()
        carried = match.transfer(np.arange(float(counts[0])))
        np.testing.assert_array_equal(carried.filled(-1), match.p2p)


def _vertices(mesh):
    return mesh.vertices if isinstance(mesh, Mesh) else mesh[0]


def _removed(fault, n):
    """Return which of the vertices of a mesh with this fault have no place on the mended one."""
    removed = np.zeros(n, dtype=bool)
    removed[_REMOVED.get(fault, [])] = True
    removed[n // 2 :] |= fault is two_bodies
    return removed


# Vertices that mending removes, but for those of a second body.
_REMOVED = {nan_vertex: [5], infinite_vertex: [5], unreferenced_vertex: [0], fin: [-1]}


@pytest.mark.parametrize("position", POSITIONS)
@pytest.mark.parametrize("fault", HELPED)
def test_answers_are_those_of_a_mesh_that_was_mended_by_hand(
    outcome_of, make, sound, collection, fault, position
):
    """Two routes: mended inside, or before, and then given as it is in its new numbers."""
    place = POSITIONS[position]
    _, _, matches = outcome_of(fault, place, "mend")
    by_hand = _with_broken(collection, fault, place)
    repair = repair_mesh(by_hand.meshes[place])
    by_hand.meshes[place] = repair.mesh
    by_hand.truths[place] = by_hand.truths[place].renumber(repair.vertex_map)

    def learn_and_match():
        how = {"laplacian": "cotangent", "on_invalid": "raise"}
        model = (
            sound(None, **how)
            if position == "new"
            else make(**how).fit(by_hand.meshes[:5], by_hand.truths[:5])
        )
        return skfmap.match(model, by_hand.meshes[4:])

    alike = np.arange(max(len(repair.vertex_map), 1000))
    new_numbers = {i: repair.vertex_map if i == place else alike for i in (0, 4, 5)}
    places_0 = _copies_as_one(by_hand.meshes[0])
    for i, match, plain in zip((4, 5), matches, _without_warnings(learn_and_match), strict=True):
        kept = np.flatnonzero(match.p2p >= 0)
        now = new_numbers[i][kept]
        there = new_numbers[0][match.p2p[kept]]
        np.testing.assert_array_equal(places_0[there], places_0[plain.p2p[now]])
        np.testing.assert_array_equal(match.expected_error[kept], plain.expected_error[now])
        kept_0 = np.flatnonzero(match.inverse >= 0)
        back = new_numbers[i][match.inverse[kept_0]]
        places_i = _copies_as_one(by_hand.meshes[i])
        np.testing.assert_array_equal(
            places_i[back], places_i[plain.inverse[new_numbers[0][kept_0]]]
        )


def _copies_as_one(mesh):
    """Return a number for each vertex, the same for those at one place."""
    return np.unique(mesh.vertices, axis=0, return_inverse=True)[1].ravel()


@pytest.mark.parametrize("position", POSITIONS)
@pytest.mark.parametrize("fault", CATALOGUE)
def test_what_nothing_helps_is_left_out_and_keeps_its_place(outcome_of, fault, position):
    """All else is as where it may be mended."""
    place = POSITIONS[position]
    outcome, message, matches = outcome_of(fault, place, "skip")
    if fault not in LOST:
        mended, told, others = outcome_of(fault, place, "mend")
        assert (outcome, message) == (mended, told)
        for one, other in zip(matches, others, strict=True):
            np.testing.assert_array_equal(one.p2p, other.p2p)
            np.testing.assert_array_equal(one.expected_error, other.expected_error)
        return
    if position == "reference":
        assert outcome == REFUSED
        assert "The reference, X[0] ('shape 0'), cannot be used" in message
        return
    assert outcome == WARNS
    assert f"X[{place if position == 'training' else 1}], shape '{CALLED[position]}'" in message
    assert "are left out" in message
    assert len(matches) == 2
    if position == "new":
        assert (matches[1].p2p == -1).all()
        assert np.isnan(matches[1].expected_error).all()
        assert np.isnan(matches[1].functional_map).all()
    assert np.isfinite(matches[0].expected_error).all()


@pytest.mark.parametrize("fault", CATALOGUE)
def test_the_report_agrees_with_what_happens(collection, fault):
    mesh = _broken(collection, fault, 2)
    report = check_mesh(mesh)
    for laplacian, expected in zip(("cotangent", "robust"), CATALOGUE[fault], strict=False):
        assert report.usable(laplacian, "raise") == (expected != REFUSED), str(report)
    assert report.usable() == (fault not in LOST), str(report)
    if fault not in (tiny, huge):
        assert report.faults
    if fault in LOST:
        with pytest.raises(MeshError, match=r"Nothing is left|cannot be mended"):
            repair_mesh(mesh)
        return
    before = [np.array(part) for part in mesh]
    repair = repair_mesh(mesh)
    for part, old in zip(mesh, before, strict=True):
        np.testing.assert_array_equal(part, old)  # nothing given is modified
    again = repair_mesh(repair.mesh)
    assert again.done == ()
    assert not again.renumbered
    kept = repair.vertex_map >= 0
    np.testing.assert_array_equal(repair.mesh.vertices[repair.vertex_map[kept]], before[0][kept])


def test_one_broken_shape_does_not_lose_the_others(outcome_of, make, collection):
    """The answers for the others are those of a run without the broken one, bit for bit."""
    _, _, with_it = outcome_of(no_faces, 2, "skip")
    sound = [i for i in range(5) if i != 2]
    model = make().fit([collection.meshes[i] for i in sound], [collection.truths[i] for i in sound])
    for one, other in zip(with_it, skfmap.match(model, collection.meshes[4:]), strict=True):
        np.testing.assert_array_equal(one.p2p, other.p2p)
        np.testing.assert_array_equal(one.expected_error, other.expected_error)


def test_predictions_and_scores_of_skipped_shapes_are_not_a_number(make, collection):
    meshes = [*collection.meshes[:5], (np.zeros((3, 3)), np.array([[0, 1, 9]]))]
    model = make(on_invalid="skip").fit(meshes[:4], collection.truths[:4])
    with pytest.warns(
        SkippedShapeWarning, match=r"1 of 2 shapes are left out. X\[1\], shape 'shape 1'"
    ):
        reduced = model.predict(meshes[4:])
    assert np.isfinite(reduced[0]).all()
    assert np.isnan(reduced[1]).all()
    with pytest.warns(SkippedShapeWarning, match="left out"):
        score = model.score(meshes[4:], collection.truths[4:])
    assert score == model.score(meshes[4:5], collection.truths[4:5])
    with pytest.warns(SkippedShapeWarning, match="left out"):
        assert np.isnan(model.score(meshes[5:], collection.truths[5:]))
    learner, shapes = model[-1], model[0].set_params(on_invalid="skip")
    with pytest.warns(SkippedShapeWarning, match="left out"):
        placed = model[1].transform(shapes.transform(meshes[4:]))
    assert [len(p2p) for p2p in learner.point_maps(placed)] == [meshes[4].n_vertices, 3]
    assert np.isnan(learner.ground_truth_maps(placed, collection.truths[4:])[1]).all()


def test_a_mended_shape_is_scored_in_the_numbers_that_it_came_with(make, collection):
    """With one vertex more, in front, errors are those of the sound mesh at the next index."""
    model = make().fit(collection.meshes[:4], collection.truths[:4])
    sound = collection.meshes[4]
    shifted = skfmap.Correspondence(np.add(collection.truths[4].pairs, [1, 0]))
    broken = unreferenced_vertex(sound.vertices.copy(), sound.faces.copy())
    with pytest.warns(RepairWarning, match="removed 1 vertices that no face used"):
        shapes = model[:-1].transform([broken])
    (plain,) = model[-1].pair_errors(model[:-1].transform([sound]), collection.truths[4:5])
    (mended,) = model[-1].pair_errors(shapes, [shifted])
    np.testing.assert_array_equal(mended.vertices, plain.vertices + 1)
    np.testing.assert_array_equal(mended.direct, plain.direct)
    (p2p,) = model[-1].point_maps(shapes)
    assert p2p[0] == -1
    np.testing.assert_array_equal(p2p[1:], model[-1].point_maps(model[:-1].transform([sound]))[0])


def test_faults_that_only_a_check_sees():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    bow = np.concatenate([vertices, vertices[1:] * -1])
    two = np.concatenate([tetrahedron, np.array([[0, 4, 5], [0, 6, 4], [0, 5, 6], [4, 6, 5]])])
    assert [fault.kind for fault in check_mesh((bow, two)).faults] == [
        "vertices where parts of the surface touch at a point"
    ]
    ring = [
        [0, 1, 2],
        [1, 3, 2],
        [2, 3, 4],
        [3, 5, 4],
        [4, 5, 1],
        [5, 0, 1],
    ]  # a band with half a twist
    strip = np.array([[np.cos(t), np.sin(t), z] for t in (0, 2.1, 4.2) for z in (0.0, 0.4)])
    assert "cannot be wound consistently" in str(check_mesh((strip, np.array(ring))))
    assert "unreadable" in str(check_mesh("no/such/file.off"))
    assert "nothing is left" in str(check_mesh((vertices, [[0, 1, 7], [0, 0, 1]])))
    assert check_mesh(Mesh(vertices, tetrahedron)).faults == ()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("mesh", "skfmap reads .off"),
        (3, "a int; a mesh is a skfmap.Mesh"),
        (None, "a NoneType; a mesh is a skfmap.Mesh"),
        ((1, 2, 3), "a tuple; a mesh is a skfmap.Mesh"),
        (([["a", "b", "c"]], [[0, 1, 2]]), "must hold real numbers"),
    ],
)
def test_what_is_no_mesh_is_said_to_be_none(wrong, message):
    assert not check_mesh(wrong).usable()
    assert not check_mesh(wrong).usable("robust", "raise")
    with pytest.raises((MeshError, OSError, TypeError), match=message):
        repair_mesh(wrong)


# The same from files, which is how most of them come


def _rows(form, values):
    return "".join(form % tuple(row) for row in values.tolist())


def _off(vertices, faces):
    return (
        f"OFF\n{len(vertices)} {len(faces)} 0\n"
        + _rows("%r %r %r\n", vertices)
        + _rows("3 %d %d %d\n", faces)
    )


def _obj(vertices, faces):
    return _rows("v %r %r %r\n", vertices) + _rows("f %d %d %d\n", faces + 1)


def _ply(vertices, faces):
    head = f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz")
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    return head + _rows("%r %r %r\n", vertices) + _rows("3 %d %d %d\n", faces)


WRITERS = {".off": _off, ".obj": _obj, ".ply": _ply}
# What readers of some versions refuse, by the name of the file; nothing is known of the vertices
# then.
UNREADABLE = {
    (fault, suffix) for fault in (index_out_of_range, negative_index) for suffix in (".off", ".obj")
}
UNREADABLE |= {(fault, suffix) for fault in (no_faces, nothing) for suffix in WRITERS} | {
    (unreferenced_vertex, ".obj")
}


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("fault", CATALOGUE)
def test_a_file_is_checked_and_mended_as_its_arrays_are(tmp_path, collection, fault, suffix):
    vertices, faces = _broken(collection, fault, 2)
    path = tmp_path / f"body{suffix}"
    path.write_text(WRITERS[suffix](vertices, faces))
    report = check_mesh(path)
    assert report.name == "body"
    if report.faults and report.faults[0].kind == "unreadable":
        assert (fault, suffix) in UNREADABLE
        with pytest.raises(MeshError, match=r"body"):
            repair_mesh(path)
        return
    assert report.faults == check_mesh((vertices, faces)).faults
    if fault in LOST:
        with pytest.raises(MeshError, match="'body'"):
            SpectralBasis(5).transform([path])
        (skipped,) = _without_warnings(
            lambda: SpectralBasis(5, on_invalid="skip").transform([path])
        )
        assert isinstance(skipped, SkippedShape)
        assert (skipped.name, skipped.n_vertices) == ("body", len(vertices))
        return
    one, other = repair_mesh(path), repair_mesh((vertices, faces))
    assert one.done == other.done
    np.testing.assert_array_equal(one.vertex_map, other.vertex_map)
    np.testing.assert_array_equal(one.mesh.faces, other.mesh.faces)
    shape, of_arrays = _without_warnings(
        lambda: SpectralBasis(5).transform([path, (vertices, faces)])
    )
    assert shape.name == "body"
    assert shape.n_given == len(vertices)
    np.testing.assert_array_equal(shape.evecs, of_arrays.evecs)
    every = np.arange(len(vertices))
    np.testing.assert_array_equal(shape.working_vertices(every), of_arrays.working_vertices(every))


@pytest.mark.parametrize("fault", CATALOGUE)
def test_a_broken_file_in_a_folder_does_not_lose_the_others(tmp_path, collection, make, fault):
    """Read, mended or left out, learned from; and all are matched in the numbers of their files.

    What is read alike from files of several formats is learned from once.
    """
    meshes = [(mesh.vertices, mesh.faces) for mesh in collection.meshes[:4]]
    truths = list(collection.truths[:4])
    meshes[2] = _broken(collection, fault, 2)
    if fault in RENUMBERED:
        truths[2] = _at_the_same_places(truths[2], collection.meshes[2].vertices, meshes[2][0])
    learned = {}
    for suffix, write in WRITERS.items():
        folder = tmp_path / suffix[1:]
        folder.mkdir()
        for i, (mesh, truth) in enumerate(zip(meshes, truths, strict=True)):
            (folder / f"body{i}{suffix}").write_text(write(*mesh))
            np.savetxt(folder / f"body{i}.txt", truth.pairs, fmt="%d")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            data = load_collection(folder, on_invalid="skip")
            content = joblib.hash([data.meshes, data.correspondences])
            if content not in learned:
                model = make("paper", on_invalid="skip").fit(data.meshes, data.correspondences)
                learned[content] = skfmap.match(model, data.meshes), caught
        matches, while_learning = learned[content]
        kinds = (RepairWarning, SkippedShapeWarning)
        told = [str(w.message) for w in [*caught, *while_learning] if issubclass(w.category, kinds)]
        assert bool(told) == (CATALOGUE[fault][2] != WORKS), suffix
        assert all("body2" in message for message in told), suffix
        unreadable = check_mesh(folder / f"body2{suffix}").faults[:1]
        lost = fault in LOST or any(one.kind == "unreadable" for one in unreadable)
        assert (matches[2].p2p >= 0).any() != lost, suffix
        assert ("no match" in repr(matches[2])) == lost, suffix
        if (fault, suffix) not in UNREADABLE:
            assert len(matches[2].p2p) == len(meshes[2][0]), suffix
        assert all((matches[i].p2p >= 0).all() for i in (0, 1, 3)), suffix


def test_vertices_that_correspond_by_number_do_so_in_a_mended_file(tmp_path):
    ball = make_sphere(n_subdivisions=2)
    for i in range(3):
        vertices, faces = ball.vertices.copy(), ball.faces.copy()
        if i == 1:
            vertices[[5, 9]] = np.nan
        (tmp_path / f"ball{i}.off").write_text(_off(vertices, faces))
    with pytest.raises(MeshError, match="2 vertices with NaN"):
        load_collection(tmp_path, on_invalid="raise")
    for on_invalid in ("mend", "skip"):
        with pytest.warns(
            RepairWarning, match=r"'ball1': left out \d+ faces .*\(2 vertices with NaN"
        ):
            data = load_collection(tmp_path, on_invalid=on_invalid)
        assert [len(truth.pairs) for truth in data.correspondences] == 3 * [ball.n_vertices]
    with pytest.warns(RepairWarning, match="'ball1': removed 2 vertices"):
        mended = SpectralBasis(10).transform(data.meshes)[1]
    assert np.flatnonzero(mended.working_vertices(np.arange(ball.n_vertices)) < 0).tolist() == [
        5,
        9,
    ]
    with pytest.warns(RepairWarning, match="'ball1': left out"):
        assert load_collection(tmp_path, reference="ball1").meshes[0].n_vertices == ball.n_vertices
    with pytest.raises(MeshError, match="vertices with NaN"):
        load_collection(tmp_path, reference="ball1", on_invalid="raise")


def test_what_was_left_out_before_is_said_to_have_been(tmp_path, recwarn):
    ball = make_sphere(n_subdivisions=1)
    text = _off(ball.vertices, ball.faces)
    (tmp_path / "ball0.off").write_text(text)
    (tmp_path / "ball1.off").write_text(text[: len(text) // 2])
    data = load_collection(tmp_path, on_invalid="skip")
    assert len(recwarn) == 1
    with pytest.raises(MeshError, match=r"X\[1\], shape 'ball1' was skipped before: .*ball1.off"):
        SpectralBasis(5).transform(data.meshes)
    shapes = SpectralBasis(5, on_invalid="skip").transform(data.meshes)
    assert isinstance(shapes[1], SkippedShape)
    assert len(recwarn) == 1  # told once
