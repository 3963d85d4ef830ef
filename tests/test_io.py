"""Mesh files: vertices keep number and order, or the file is refused."""

import dataclasses
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh

from skfmap import Mesh, SpectralBasis, check_mesh
from skfmap.datasets import make_sphere
from skfmap.exceptions import MeshError, RepairWarning
from skfmap.io import WRITTEN_SUFFIXES, as_mesh, as_meshes, read_mesh, write_mesh
from skfmap.shapes import Registered

EXACT = [".off", ".obj", ".ply"]


@pytest.fixture(scope="module")
def seamed():
    """Return a sphere with shuffled vertices, three of them there twice, as along a seam."""
    sphere = make_sphere(2)
    rng = np.random.default_rng(0)
    vertices = np.concatenate([sphere.vertices, sphere.vertices[[5, 9, 40]]])
    faces = sphere.faces.copy()
    for copy, original in zip((66, 67, 68), (5, 9, 40), strict=True):
        row = np.flatnonzero((faces == original).any(axis=1))[0]
        faces[row] = np.where(faces[row] == original, copy, faces[row])
    order = rng.permutation(len(vertices))
    return Mesh(vertices[order], rng.permutation(np.argsort(order)[faces]), name="seamed")


@pytest.fixture
def write(tmp_path):
    """Return a function that writes text or bytes to a file and returns its path."""

    def write(name, content):
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


@pytest.mark.parametrize("suffix", [*EXACT, ".OFF"])
def test_round_trip_keeps_every_vertex_at_its_number(seamed, tmp_path, suffix):
    path = tmp_path / f"some.name{suffix}"
    write_mesh(seamed, path)
    again = read_mesh(path)
    np.testing.assert_allclose(again.vertices, seamed.vertices, atol=1e-6)
    np.testing.assert_array_equal(again.faces, seamed.faces)
    assert again.name == "some.name"


@pytest.mark.parametrize("suffix", [".off", ".ply"])
def test_a_second_round_trip_changes_nothing(seamed, tmp_path, suffix):
    write_mesh(seamed, tmp_path / f"a{suffix}")
    once = read_mesh(tmp_path / f"a{suffix}")
    write_mesh(once, tmp_path / f"b{suffix}")
    assert read_mesh(str(tmp_path / f"b{suffix}")).content_hash == once.content_hash


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_both_kinds_of_ply(seamed, tmp_path, encoding):
    path = tmp_path / "a.ply"
    trimesh.Trimesh(seamed.vertices, seamed.faces, process=False).export(path, encoding=encoding)
    assert (b"format ascii" in path.read_bytes()) == (encoding == "ascii")
    again = read_mesh(path)
    np.testing.assert_allclose(again.vertices, seamed.vertices, atol=1e-6)
    np.testing.assert_array_equal(again.faces, seamed.faces)


def test_stl_corners_at_one_place_become_one_vertex(tetrahedron, tmp_path):
    write_mesh(Mesh(*tetrahedron), tmp_path / "a.stl")
    mesh = read_mesh(tmp_path / "a.stl")
    # Faces [0, 2, 1], [0, 1, 3], ...: the vertices appear in the order 0, 2, 1, 3.
    np.testing.assert_array_equal(mesh.vertices, tetrahedron[0][[0, 2, 1, 3]])
    np.testing.assert_array_equal(mesh.faces, np.array([0, 2, 1, 3])[tetrahedron[1]])


@pytest.mark.parametrize("suffix", [".stl"])
def test_ascii_stl_is_welded_too(tetrahedron, tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    trimesh.Trimesh(*tetrahedron, process=False).export(path, file_type="stl_ascii")
    assert read_mesh(path).n_vertices == 4


def test_stl_keeps_vertices_that_are_only_near(write):
    lines = ["solid a"]
    for corners in ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(1, 0, 0), (1.0001, 1, 0), (0, 1.0001, 0)]):
        points = [f"vertex {x} {y} {z}" for x, y, z in corners]
        lines += ["facet normal 0 0 1", "outer loop", *points, "endloop", "endfacet"]
    assert read_mesh(write("a.stl", "\n".join([*lines, "endsolid a", ""]))).n_vertices == 5


OBJ_CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"


def test_obj_with_one_normal_and_texture_point_per_vertex(write):
    extra = "vt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\nvn 0 0 1\nvn 0 1 0\nvn 1 0 0\nvn 1 1 1\n"
    faces = "f 1/1/1 3/3/3 2/2/2\nf 1/1/1 2/2/2 4/4/4\nf 1/1/1 4/4/4 3/3/3\nf 2/2/2 3/3/3 4/4/4\n"
    mesh = read_mesh(write("a.obj", OBJ_CORNERS + extra + faces))
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert sorted(map(sorted, mesh.faces.tolist())) == [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]


@pytest.mark.parametrize(
    "faces",
    [
        "f 1/1 3/2 2/3\nf 1/4 2/1 4/2\nf 1/1 4/3 3/4\nf 2/2 3/1 4/4\n",  # texture seams
        "f 1//1 3//1 2//1\nf 1//2 2//2 4//2\nf 1//3 4//3 3//3\nf 2//4 3//4 4//4\n",  # flat shading
        "usemtl a\nf 1 3 2\nf 1 2 4\nusemtl b\nf 1 4 3\nf 2 3 4\n",  # two materials
        "g a\nf 2 3 4\ng b\nf 1 3 2\nf 1 2 4\nf 1 4 3\n",  # two groups
        "o a\nf 2 3 4\no b\nf 1 3 2\nf 1 2 4\nf 1 4 3\n",  # two objects
    ],
)
def test_obj_keeps_its_vertices_or_is_refused(write, faces):
    extra = "vt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\nvn 0 0 1\nvn 0 1 0\nvn 1 0 0\nvn 1 1 1\n"
    path = write("a.obj", OBJ_CORNERS + extra + faces)
    try:
        mesh = read_mesh(path)
    except MeshError as error:
        assert "a.obj" in str(error)  # noqa: PT017
    else:
        np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        assert sorted(map(sorted, mesh.faces.tolist())) == [
            [0, 1, 2],
            [0, 1, 3],
            [0, 2, 3],
            [1, 2, 3],
        ]


def test_obj_that_loses_one_vertex_and_gains_another_is_not_renumbered(write):
    """No face uses vertex 0 and a texture seam splits vertex 2: the count alone does not tell."""
    vertices = [[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in vertices) + "vt 0 0\nvt 1 1\n"
    text += "f 2/1 4/1 3/1\nf 2/1 3/2 5/1\nf 2/1 5/1 4/1\nf 3/1 4/1 5/1\n"
    path = write("a.obj", text)
    try:
        mesh = read_mesh(path)
    except MeshError:
        return
    np.testing.assert_array_equal(mesh.vertices, vertices)


def test_obj_with_an_unused_vertex_is_not_renumbered(write):
    text = "v 9 9 9\n" + OBJ_CORNERS + "f 2 4 3\nf 2 3 5\nf 2 5 4\nf 3 4 5\n"
    try:
        mesh = read_mesh(write("a.obj", text))
    except MeshError:
        return
    np.testing.assert_array_equal(mesh.vertices[0], [9, 9, 9])
    assert mesh.n_vertices == 5


OFF_BODY = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


@pytest.mark.parametrize(
    "head",
    [
        "OFF\n4 4 6\n",
        "OFF\n# a comment\n4 4 6\n",
        "# made by hand\nOFF\n\n4 4 0\n",
        "OFF 4 4 6\n",
        "OFF # four\n4 4 6\n",
    ],
)
def test_off_headers(write, tetrahedron, head):
    mesh = read_mesh(write("a.off", head + OFF_BODY))
    np.testing.assert_array_equal(mesh.vertices, tetrahedron[0])
    np.testing.assert_array_equal(mesh.faces, tetrahedron[1])


@pytest.mark.parametrize(
    ("head", "old", "new"),
    [
        ("OFF\n4 4 6\n# corners\n", "", ""),
        ("OFF\n4 4 6\n", "0 0 0\n1", "0 0 0 # origin\n1"),
        ("OFF\n4 4 6\n", "3 0 2 1", "# faces\n3 0 2 1"),
        ("OFF\n4 4 6\n", "3 0 2 1", "3 0 2 1 # first"),
        ("OFF\n# one\n4 4 6\n", "3 0 2 1", "# two\n3 0 2 1 # three"),
        ("OFF\n4 4 6\n", "3 1 2 3", "3 1 2 3\n# end"),
    ],
)
def test_off_comments_are_no_data(write, tetrahedron, head, old, new):
    mesh = read_mesh(write("a.off", head + OFF_BODY.replace(old, new, 1)))
    np.testing.assert_array_equal(mesh.vertices, tetrahedron[0])
    np.testing.assert_array_equal(mesh.faces, tetrahedron[1])


def test_off_colours_are_left_out(write, tetrahedron):
    body = (
        "0 0 0 9 9 9 9\n1 0 0 9 9 9 9\n0 1 0 9 9 9 9\n0 0 1 9 9 9 9\n3 0 2 1 255 0 0\n"
        + OFF_BODY[32:]
    )
    mesh = read_mesh(write("a.off", "COFF\n4 4 6\n" + body))
    np.testing.assert_array_equal(mesh.vertices, tetrahedron[0])
    np.testing.assert_array_equal(mesh.faces, tetrahedron[1])


def test_windows_line_ends(write, tetrahedron):
    mesh = read_mesh(write("a.off", ("OFF\n4 4 6\n" + OFF_BODY).replace("\n", "\r\n")))
    np.testing.assert_array_equal(mesh.faces, tetrahedron[1])


def test_off_faces_that_point_past_the_vertices_are_refused(write):
    with pytest.raises(MeshError, match=r"\ba\b|/a\."):
        read_mesh(write("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"))


@pytest.mark.parametrize("suffix", WRITTEN_SUFFIXES)
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9, 0.97])
def test_truncated_files_are_refused(tmp_path, suffix, share):
    path = tmp_path / f"a{suffix}"
    write_mesh(make_sphere(2), path)
    content = path.read_bytes()
    if suffix == ".obj":  # it holds no count, so that only vertices can be missed
        content = content[: content.index(b"\nf ")]
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(MeshError, match=r"\ba\b|/a\."):
        read_mesh(path)


@pytest.mark.parametrize("file_type", ["ply", "stl_ascii"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.97])
def test_truncated_text_is_refused(tmp_path, file_type, share):
    path = tmp_path / f"a.{file_type[:3]}"
    sphere = make_sphere(2)
    options = {"encoding": "ascii"} if file_type == "ply" else {}
    trimesh.Trimesh(sphere.vertices, sphere.faces, process=False).export(
        path, file_type=file_type, **options
    )
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(MeshError, match=r"\ba\b|/a\."):
        read_mesh(path)


@pytest.mark.parametrize("suffix", WRITTEN_SUFFIXES)
@pytest.mark.parametrize("n_bytes", [0, 1, 83, 84, 5000])
def test_garbage_is_refused(write, suffix, n_bytes):
    path = write(f"a{suffix}", np.random.default_rng(n_bytes).bytes(n_bytes))
    with pytest.raises(MeshError, match=r"\ba\b|/a\."):
        read_mesh(path)


@pytest.mark.parametrize("suffix", [".off", ".ply", ".stl", ".obj"])
def test_text_that_is_no_mesh_is_refused(write, suffix):
    with pytest.raises(MeshError, match=r"\ba\b|/a\."):
        read_mesh(write(f"a{suffix}", "Dear reader,\n\nthis is a letter.\n"))


def test_a_point_cloud_is_refused(write):
    with pytest.raises(MeshError, match=r"\ba\b|/a\."):
        read_mesh(write("a.off", "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n"))


def test_missing_files_and_unknown_suffixes(tmp_path, tetrahedron):
    with pytest.raises(FileNotFoundError, match=r"cat.off"):
        read_mesh(tmp_path / "cat.off")
    (tmp_path / "folder.off").mkdir()
    with pytest.raises(FileNotFoundError, match=r"folder.off"):
        read_mesh(tmp_path / "folder.off")
    with pytest.raises(MeshError, match=r"'.xyz'.*\.off"):
        read_mesh(tmp_path / "cat.xyz")
    with pytest.raises(ValueError, match=r"'.gltf'"):
        write_mesh(Mesh(*tetrahedron), tmp_path / "cat.gltf")
    assert not (tmp_path / "cat.gltf").exists()


def test_what_register_returns_is_written_as_its_mesh(tmp_path, tetrahedron):
    vertices, faces = tetrahedron
    values = {"n_flipped": 0, "off": 0.0, "uncovered": 0.0, "stretched": 0.0, "fits": True}
    laid = Registered(vertices, faces, np.zeros(len(vertices)), **values, name="cat1")
    write_mesh(laid, tmp_path / "laid.off")
    back = read_mesh(tmp_path / "laid.off")
    np.testing.assert_array_equal(back.vertices, vertices)
    np.testing.assert_array_equal(back.faces, faces)
    with pytest.raises(TypeError, match=r"must be a skfmap\.Mesh, .*; got list\. .* one by one"):
        write_mesh([laid], tmp_path / "all.off")
    with pytest.raises(TypeError, match=r"got str\.$"):
        write_mesh(tmp_path.name, laid)
    nowhere = dataclasses.replace(laid, vertices=np.nan * vertices)
    with pytest.raises(MeshError, match="'cat1' was skipped"):
        write_mesh(nowhere, tmp_path / "none.off")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["laid.off"]


def test_reading_warns_of_nothing(tmp_path, tetrahedron):
    for suffix in WRITTEN_SUFFIXES:
        write_mesh(Mesh(*tetrahedron), tmp_path / f"a{suffix}")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert read_mesh(tmp_path / f"a{suffix}").n_faces == 4


# What a user would hold


@pytest.fixture
def forms(tetrahedron, tmp_path):
    """Return one mesh in every form that is taken."""
    mesh = Mesh(*tetrahedron)
    write_mesh(mesh, tmp_path / "file.off")
    return {
        "Mesh": mesh,
        "Trimesh": trimesh.Trimesh(*tetrahedron, process=False),
        "tuple": tetrahedron,
        "lists": [tetrahedron[0].tolist(), tetrahedron[1].tolist()],
        "str": str(tmp_path / "file.off"),
        "Path": Path(tmp_path / "file.off"),
    }


FORMS = ["Mesh", "Trimesh", "tuple", "lists", "str", "Path"]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("container", ["list", "tuple", "array"])
def test_every_form_in_every_container(forms, form, n, container):
    X = np.empty(n, dtype=object)
    for i in range(n):
        X[i] = forms[form]
    if container != "array":
        X = {"list": list, "tuple": tuple}[container](X)
    assert [mesh.content_hash for mesh in as_meshes(X)] == [forms["Mesh"].content_hash] * n


def test_forms_can_be_mixed(forms):
    meshes = as_meshes([forms[form] for form in FORMS])
    assert {mesh.content_hash for mesh in meshes} == {forms["Mesh"].content_hash}
    assert meshes[0] is forms["Mesh"]
    assert [mesh.name for mesh in meshes[2:]] == ["shape 2", "shape 3", "file", "file"]


@pytest.mark.parametrize("form", FORMS)
def test_one_bare_mesh_is_refused_with_the_remedy(forms, form):
    with pytest.raises(TypeError, match=r"(?i)wrap it in a list"):
        as_meshes(forms[form])


def test_two_pairs_with_as_many_faces_as_vertices_are_two_meshes(tetrahedron):
    whole = (tetrahedron[0].astype(int), tetrahedron[1])  # nothing but shapes of (4, 3) integers
    assert len(as_meshes([whole, whole])) == 2
    assert len(as_meshes([list(whole), list(whole)])) == 2
    with pytest.raises(TypeError, match=r"(?i)wrap it in a list"):
        as_meshes(whole)


@pytest.mark.parametrize("X", [np.zeros((4, 3)), {"a": 1}, 3, None])
def test_what_is_no_collection_is_refused(X):
    with pytest.raises(TypeError, match="sequence of meshes"):
        as_meshes(X)


def test_an_empty_collection_is_refused():
    for X in ([], (), np.empty(0, dtype=object)):
        with pytest.raises(ValueError, match="empty"):
            as_meshes(X)


def test_what_is_no_mesh_is_refused_by_its_place(tetrahedron):
    with pytest.raises(TypeError, match=r"X\[1\] is a int"):
        as_meshes([tetrahedron, 3])
    with pytest.raises(TypeError, match="a mesh is a"):
        as_mesh(None)
    with pytest.raises(MeshError, match="shape 1"):
        as_meshes([tetrahedron, (tetrahedron[0], tetrahedron[1] + 4)])


def test_paths_in_a_string_array_are_paths(forms):
    assert len(as_meshes(np.array([forms["str"], forms["str"]]))) == 2


def test_the_import_brings_in_neither_trimesh_nor_matplotlib():
    code = (
        "import sys, skfmap; heavy = ('trimesh', 'matplotlib'); "
        "print([name for name in heavy if name in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize(
    "text",
    [
        "v 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 \\\r\n3\r\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 \\\n3\n",
        "\ufeffv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    ],
    ids=["continued, Windows", "continued", "byte order mark"],
)
def test_obj_files_of_editors_are_read_whole(tmp_path, text):
    (tmp_path / "a.obj").write_bytes(text.encode())
    mesh = read_mesh(tmp_path / "a.obj")
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2]])


def test_minus_zero_is_no_vertex(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 -0\n")
    with pytest.raises(MeshError, match="an invalid vertex number"):
        read_mesh(tmp_path / "a.obj")


def _loose(mesh, name):
    """Return the mesh with a vertex in front of all others that no face uses."""
    return Mesh(np.concatenate([[[9.0, 9, 9]], mesh.vertices]), mesh.faces + 1, name)


def test_a_list_of_two_tables_is_a_mesh_everywhere():
    ball = _loose(make_sphere(n_subdivisions=2), "ball")
    pair = [ball.vertices.tolist(), ball.faces.tolist()]
    assert [fault.kind for fault in check_mesh(pair).faults] == ["unreferenced vertices"]
    with pytest.warns(RepairWarning, match="shape 0"):
        (shape,) = SpectralBasis(10, on_invalid="skip").transform([pair])
    assert shape.mesh.n_vertices == 66


@pytest.mark.parametrize(
    ("name", "content", "faces"),
    [
        (
            "relative.obj",
            "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 0 0 5\nv 1 0 5\nv 1 1 5\nf -3 -2 -1\n",
            [[0, 1, 2], [3, 4, 5]],
        ),
        ("comments.obj", "v 0 0 0 # one\nv 1 0 0\nv 1 1 0\nf 1 2 3 # face\n# end", [[0, 1, 2]]),
        ("returns.obj", "v 0 0 0\rv 1 0 0\rv 1 1 0\rf 1 2 3\r", [[0, 1, 2]]),
        (
            "longer.off",
            "OFF\n4 1 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 2\n3 1 2 3\n",
            "but more lines follow",
        ),
        (
            "fraction.ply",
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float "
            "y\nproperty float z\nelement face 1\nproperty list uchar int "
            "vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2.7\n",
            "not integers",
        ),
        ("before.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -4 -2 -1\n", "an invalid vertex number"),
    ],
)
def test_files_say_one_thing(tmp_path, name, content, faces):
    path = tmp_path / name
    path.write_bytes(content.encode())
    if isinstance(faces, str):
        with pytest.raises(MeshError, match=faces):
            read_mesh(path)
    else:
        assert read_mesh(path).faces.tolist() == faces


def test_what_holds_a_mesh_says_to_give_it():
    ball = make_sphere(n_subdivisions=1)
    shares = dict.fromkeys(("off", "uncovered", "stretched", "energy"), 0.0)
    laid = Registered(ball.vertices, ball.faces, np.zeros(18), 0, **shares, fits=True)
    with pytest.raises(TypeError, match=r"X\[0\] is a Registered.*Give its \.mesh"):
        as_meshes([laid])
    with pytest.raises(TypeError, match=r"a path\.$"):
        as_mesh(7)
