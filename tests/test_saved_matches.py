"""Matches leave Python, and know the meshes they are about."""

import builtins
import csv
import pickle
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
import trimesh
from matplotlib import pyplot as plt

import skfmap
from skfmap import Landmarks, Match, Mesh, SpectralBasis
from skfmap.datasets import make_sphere
from skfmap.exceptions import CorrespondenceError, MeshError
from skfmap.geometry.position_colours import colours_of_position
from skfmap.io import read_landmarks, read_mesh, read_uv, write_mesh
from skfmap.io.vtk_written import vtk_of, vtp_of
from skfmap.shapes import GivenMesh

_TURN = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])


@pytest.fixture(autouse=True)
def _close_figures():
    yield
    plt.close("all")


@pytest.fixture
def match(fitted, probed):
    (found,) = fitted.match(probed[5:])
    return found


@pytest.fixture
def turned():
    """A ball matched to itself, turned and at another place: each vertex to the one it was."""
    ball = make_sphere(n_subdivisions=3)
    order = np.random.default_rng(0).permutation(ball.n_vertices)
    back = np.argsort(order)
    moved = Mesh(2 * ball.vertices[order] @ _TURN + 5, back[ball.faces])
    n, C = ball.n_vertices, np.eye(2)
    matrix = sp.csr_array((np.ones(n), (np.arange(n), order)), shape=(n, n))
    return Match(
        order,
        np.linspace(0, 0.1, n),
        None,
        C,
        C,
        name="a/b",
        matrix=matrix,
        inverse=back,
        given=GivenMesh.of(moved),
        reference_given=GivenMesh.of(ball),
    )


# What a match knows


def test_a_match_knows_the_meshes_it_is_about(match, collection):
    assert match.mesh.content_hash == collection.meshes[5].content_hash
    assert match.reference_mesh.content_hash == collection.meshes[0].content_hash
    assert match.reference_hash == match.reference_mesh.content_hash


def test_a_match_of_thinned_meshes_knows_those_that_were_given(collection):
    fine = [SpectralBasis(20, max_vertices=300).transform([mesh])[0] for mesh in collection.meshes]
    shapes = skfmap.DescriptorTransformer().transform(fine)
    learner = skfmap.WeightedFunctionalMapLearner(n_functions=10, confidence=None, tol=1e-2)
    (found,) = learner.fit(shapes[:3], collection.truths[:3]).match(shapes[5:])
    assert found.mesh.content_hash == collection.meshes[5].content_hash
    assert found.reference_mesh.content_hash == collection.meshes[0].content_hash
    assert len(found.p2p) == found.mesh.n_vertices


def test_a_match_between_new_shapes_knows_both(fitted, probed, collection):
    (found,) = fitted.match_between(probed[4:6], [(1, 0)])
    assert found.mesh.content_hash == collection.meshes[5].content_hash
    assert found.reference_mesh.content_hash == collection.meshes[4].content_hash
    assert len(found.plot(show=["match"]).axes) == 2
    plt.close("all")


def test_a_mesh_that_has_changed_since_is_told(tmp_path, turned, match):
    path = tmp_path / "ball.off"
    write_mesh(turned.mesh, path)
    there = read_mesh(path)
    given = replace(GivenMesh.of(there), source=path)
    assert replace(match, given=given).mesh.content_hash == there.content_hash
    write_mesh(make_sphere(n_subdivisions=1), path)
    with pytest.raises(MeshError, match="has changed since"):
        _ = replace(match, given=given).mesh
    with pytest.raises(MeshError, match="does not know the mesh of the shape"):
        _ = replace(match, given=None).mesh


def test_the_mesh_of_a_shape_that_was_skipped_is_not_known(fitted, probed):
    skipped = skfmap.shapes.SkippedShape("gone", "it is broken.", 10)
    found = fitted.match([probed[5], skipped])
    assert found[1].given is None
    with pytest.raises(MeshError, match=r"the shape was skipped.*\.csv or \.npz"):
        _ = found[1].mesh
    assert found[0].mesh.n_vertices == len(found[0].p2p)


def test_a_pickle_of_matches_holds_the_reference_once(fitted, probed):
    matches = fitted.match(probed[3:6])
    again = pickle.loads(pickle.dumps(matches))
    assert again[0].reference_given.source is again[2].reference_given.source
    sizes = [len(pickle.dumps(matches[:n])) for n in (1, 2)]
    own = [len(pickle.dumps(replace(one, given=None, reference_given=None))) for one in matches[:2]]
    mesh = 24 * (matches[1].mesh.n_vertices + matches[1].mesh.n_faces)
    assert sizes[1] - sizes[0] < own[1] + mesh + 1000  # and not another reference


def test_a_pickle_holds_the_path_of_a_thinned_mesh_and_not_the_mesh(collection, tmp_path):
    paths = []
    for mesh in collection.meshes[:4]:
        paths.append(str(tmp_path / f"{mesh.name}.off"))
        write_mesh(mesh, paths[-1])
    thin = SpectralBasis(20, max_vertices=300)
    shapes = skfmap.DescriptorTransformer().transform(thin.transform(paths))
    learner = skfmap.WeightedFunctionalMapLearner(n_functions=10, confidence=None, tol=1e-2)
    (found,) = learner.fit(shapes[:3], collection.truths[:3]).match(shapes[3:])
    again = pickle.loads(pickle.dumps(found))
    assert again.given.source == paths[3]
    assert len(pickle.dumps(found.given)) < 1000
    assert again.mesh.n_vertices == len(found.p2p)


def test_a_match_is_drawn_from_itself_alone(match, collection):
    figure = skfmap.plotting.plot_matches([match])
    given = skfmap.plotting.plot_matches([match], collection.meshes[5:], collection.meshes[0])
    for one, other in zip(figure.axes, given.axes, strict=True):
        assert one.get_title() == other.get_title()
        for drawn, wanted in zip(one.collections, other.collections, strict=True):
            np.testing.assert_array_equal(drawn.get_facecolor(), wanted.get_facecolor())


def test_matches_to_several_references_are_not_drawn_together(match, turned):
    with pytest.raises(ValueError, match="different references"):
        skfmap.plotting.plot_matches([match, turned])


# Files


def test_a_folder_gets_the_usual_files(turned, tmp_path):
    marks = Landmarks(turned.reference_mesh.vertices[:2], ["a", "b"])
    written = turned.save(tmp_path / "out", landmarks=marks)
    suffixes = ("csv", "npz", "ply", "glb", "vtp", "fcsv", "mrk.json")
    assert [path.name for path in written] == [f"a_b.{suffix}" for suffix in suffixes]
    with pytest.raises(FileExistsError, match=r"overwrite=True"):
        turned.save(tmp_path / "out")
    assert turned.save(tmp_path / "out", overwrite=True) == written[:5]


def test_names_that_no_file_can_have_are_changed(turned, tmp_path):
    for name, stem in {"a/b\\c:d": "a_b_c_d", "one\ntwo\0three": "one_two_three"}.items():
        paths = replace(turned, name=name).save(tmp_path)
        assert {path.stem for path in paths} == {stem}


def test_long_names_are_cut_and_stay_apart(turned, tmp_path):
    written = [
        replace(turned, name="ö" * 150 + end).save(tmp_path, landmarks=marks)
        for end in "ab"
        for marks in [Landmarks(turned.reference_mesh.vertices[:1], ["nose"])]
    ]
    assert len({path.name for paths in written for path in paths}) == 14
    assert all(path.is_file() and path.name.startswith("ö" * 90) for path in written[0])
    with pytest.raises(ValueError, match=r"A name of 304 letters.*give a shorter"):
        turned.save(tmp_path / f"{'x' * 300}.csv")
    with pytest.raises(ValueError, match=r"A name of 304 letters.*give a shorter"):
        write_mesh(turned.mesh, tmp_path / f"{'x' * 300}.ply")


def test_what_cannot_be_written_leaves_no_empty_folder(match, tmp_path):
    unknown = replace(match, given=None)
    with pytest.raises(ValueError, match="mesh"):
        unknown.save(tmp_path / "out")
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(NotADirectoryError, match=r"is a file. Give a folder"):
        match.save(tmp_path / "file")


def test_a_table_has_a_line_for_each_vertex(match, tmp_path):
    unknown = np.arange(len(match.p2p)) == 1
    error = np.where(unknown, np.nan, match.expected_error)
    doubtful = replace(match, p2p=np.where(unknown, -1, match.p2p), expected_error=error)
    (path,) = doubtful.save(tmp_path / "match.csv")
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["vertex", "reference_vertex", "expected_error", "confidence"]
    assert [int(row["vertex"]) for row in rows] == list(range(len(match.p2p)))
    assert [int(row["reference_vertex"]) for row in rows] == doubtful.p2p.tolist()
    assert rows[1]["expected_error"] == ""
    assert float(rows[2]["expected_error"]) == pytest.approx(match.expected_error[2], rel=1e-6)


def test_an_archive_has_all_numbers(match, tmp_path):
    torn = np.arange(len(match.p2p)) % 2 == 0
    match = replace(match, scale=0.001, torn=torn)
    (path,) = match.save(tmp_path / "match.npz")
    with np.load(path, allow_pickle=False) as saved:
        parts = [saved[f"matrix_{part}"] for part in ("data", "indices", "indptr")]
        matrix = sp.csr_array(tuple(parts), shape=tuple(saved["matrix_shape"]))
        for name in ("p2p", "expected_error", "inverse", "functional_map", "reduced_map"):
            np.testing.assert_array_equal(saved[name], getattr(match, name))
        assert str(saved["reference_name"]) == match.reference_name
        assert bool(saved["familiar"]) is match.familiar
        assert float(saved["scale"]) == match.scale
        np.testing.assert_array_equal(saved["torn"], torn)
    assert abs(matrix - match.matrix).max() == 0


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".vtp", ".vtk"])
def test_shapes_keep_their_vertices_and_faces(turned, tmp_path, suffix):
    (path,) = turned.save(tmp_path / f"ball{suffix}")
    again = read_mesh(path)
    np.testing.assert_allclose(again.vertices, turned.mesh.vertices, rtol=1e-6)
    np.testing.assert_array_equal(again.faces, turned.mesh.faces)


def test_ply_has_colours_and_scalars_where_meshlab_looks_for_them(turned, tmp_path):
    (path,) = turned.save(tmp_path / "ball.ply")
    loaded = trimesh.load(path, process=False)
    wanted = colours_of_position(turned.reference_mesh.vertices)[turned.p2p]
    np.testing.assert_allclose(loaded.visual.vertex_colors[:, :3] / 255, wanted, atol=1 / 255)
    rows = loaded.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_allclose(rows["quality"], turned.expected_error, rtol=1e-6)
    np.testing.assert_array_equal(rows["scalar_reference_vertex"], turned.p2p)
    assert "scalar_confidence" not in rows.dtype.names  # there is none


def test_colours_of_glb_are_linear(turned, tmp_path):
    (path,) = turned.save(tmp_path / "ball.glb")
    (loaded,) = trimesh.load(path, process=False).geometry.values()
    share = loaded.visual.vertex_colors[:, :3] / 255
    seen = np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)
    wanted = colours_of_position(turned.reference_mesh.vertices)[turned.p2p]
    np.testing.assert_allclose(seen, wanted, atol=0.03)


def test_a_texture_is_carried_with_its_coordinates(turned, tmp_path):
    image_module = pytest.importorskip("PIL.Image")
    pixels = np.random.default_rng(0).integers(0, 255, (4, 4, 3)).astype(np.uint8)
    image_module.fromarray(pixels).save(tmp_path / "skin.png")
    uv = np.random.default_rng(1).random((turned.reference_mesh.n_vertices, 2))
    uv[3] = np.nan  # in no face: as read_uv says
    (path,) = turned.save(tmp_path / "ball.glb", uv=uv, texture=tmp_path / "skin.png")
    (loaded,) = trimesh.load(path, process=False).geometry.values()
    np.testing.assert_allclose(loaded.visual.uv, np.nan_to_num(uv)[turned.p2p], atol=1e-6)
    held = np.asarray(loaded.visual.material.baseColorTexture.convert("RGB"))
    np.testing.assert_array_equal(held, pixels)


def test_texture_coordinates_of_an_obj_file_are_those_of_its_vertices(tmp_path):
    path = tmp_path / "seam.obj"
    corners = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0", "v 9 9 9"]
    places = ["vt 0.5 0.25", "vt 1 0 0", "vt 0 1", "vt 0.75 0.75", "vt 0.1 0.2"]
    path.write_text("\n".join([*corners, *places, "f 1/1/1 2/2/1 3/3/1", "f -5/5 3/4 4/-1"]))
    expected = [[0.5, 0.25], [1, 0], [0, 1], [0.1, 0.2], [np.nan, np.nan]]
    np.testing.assert_array_equal(read_uv(path), expected)
    path.write_text("\n".join([*corners, "f 1 2 3"]))
    with pytest.raises(MeshError, match="no texture coordinates"):
        read_uv(path)


@pytest.mark.parametrize("suffix", [".fcsv", ".mrk.json"])
def test_landmarks_of_the_reference_are_carried_to_the_shape(turned, tmp_path, suffix):
    ball = turned.reference_mesh
    corner = ball.vertices[7]
    middle = ball.vertices[ball.faces[3]].mean(axis=0)
    marks = Landmarks([corner, middle, [np.nan] * 3], ["corner", "middle", "missing"])
    (path,) = turned.save(tmp_path / f"ball{suffix}", landmarks=marks)
    carried = read_landmarks(path)
    np.testing.assert_allclose(carried.points[:2], 2 * marks.points[:2] @ _TURN + 5, atol=1e-6)
    assert carried.placed.tolist() == [True, True, False]


def test_landmarks_without_a_match_are_missing(turned, tmp_path):
    nowhere = replace(turned, inverse=np.full_like(turned.inverse, -1))
    marks = Landmarks(turned.reference_mesh.vertices[:1], ["a"])
    (path,) = nowhere.save(tmp_path / "ball.fcsv", landmarks=marks)
    assert not read_landmarks(path).placed.any()


def test_what_cannot_be_saved_is_told(turned, tmp_path):
    marks = Landmarks(turned.reference_mesh.vertices[:1] + 50, ["a"])
    with pytest.raises(CorrespondenceError, match="Check that they belong to it"):
        turned.save(tmp_path / "ball.fcsv", landmarks=marks)
    with pytest.raises(ValueError, match=r"landmarks=skfmap\.io\.read_landmarks"):
        turned.save(tmp_path / "ball.fcsv")
    with pytest.raises(ValueError, match=r"suffix '\.xyz'.*\.csv, \.npz"):
        turned.save(tmp_path / "ball.xyz")
    with pytest.raises(FileNotFoundError, match="no folder"):
        turned.save(tmp_path / "nowhere" / "ball.csv")
    with pytest.raises(ValueError, match="Give both uv and texture"):
        turned.save(tmp_path / "ball.glb", uv=np.zeros((3, 2)))
    far = Mesh(turned.mesh.vertices + 1e7, turned.mesh.faces)
    with pytest.raises(ValueError, match="single precision"):
        replace(turned, given=GivenMesh.of(far)).save(tmp_path / "ball.glb")
    assert list(tmp_path.iterdir()) == []


# Other libraries


def test_arrays_for_paraview_are_read_by_vtk(turned, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    points = turned.mesh.vertices
    arrays = {"whole": turned.p2p, "real": points[:, 0], "three": points}
    for suffix, writer in ((".vtp", vtp_of), (".vtk", vtk_of)):
        path = tmp_path / f"ball{suffix}"
        path.write_bytes(writer(turned.mesh.vertices, turned.mesh.faces, arrays))
        loaded = pyvista.read(path)
        np.testing.assert_array_equal(loaded.points, turned.mesh.vertices)
        np.testing.assert_array_equal(loaded.regular_faces, turned.mesh.faces)
        for name, values in arrays.items():
            np.testing.assert_array_equal(loaded.point_data[name], values)


def test_a_mesh_of_pyvista_has_the_same_vertices_and_faces(turned):
    pytest.importorskip("pyvista")
    converted = turned.mesh.to_pyvista()
    np.testing.assert_array_equal(converted.points, turned.mesh.vertices)
    np.testing.assert_array_equal(converted.regular_faces, turned.mesh.faces)


def test_meshes_of_other_libraries_are_copies(turned):
    loaded = turned.mesh.to_trimesh()
    np.testing.assert_array_equal(loaded.vertices, turned.mesh.vertices)
    np.testing.assert_array_equal(loaded.faces, turned.mesh.faces)
    loaded.vertices[0] = 7  # its own, which can be written to


def test_pyvista_is_asked_for_by_name(turned, monkeypatch):
    usual = builtins.__import__

    def without(name, *rest):
        if name == "pyvista":
            raise ImportError(name)
        return usual(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=r"skfmap\[pyvista\]"):
        turned.mesh.to_pyvista()
