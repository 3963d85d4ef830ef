"""Inputs of the field that were once wrong without a word: one test for each kind."""

import base64
import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.model_selection import KFold, LeaveOneOut, cross_val_predict

from skfmap import Mesh, SpectralBasis, check_mesh, repair_mesh
from skfmap.commands.inputs import mesh_files
from skfmap.datasets import load_collection, make_creatures, make_sphere
from skfmap.exceptions import (
    CorrespondenceError,
    CoverageWarning,
    MeshError,
    RepairWarning,
    SkippedShapeWarning,
)
from skfmap.functional import wrong_pairs
from skfmap.geometry.polygons import triangulate
from skfmap.io import as_meshes, read_arrays, read_mesh, write_mesh
from skfmap.model_selection import PinnedReference
from skfmap.shapes import Correspondence, SkippedShape
from skfmap.shapes.crowded import crowded_points


@pytest.fixture
def write(tmp_path):
    """Return a function that writes text or bytes to a file and returns its path."""

    def write(name, content):
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def _area(vertices, faces):
    a, b, c = (vertices[faces[:, j]] for j in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


# Polygons


def _star(radii):
    """Return a polygon that is seen whole from the origin, and its area by the shoelace formula."""
    angle = 2 * np.pi * np.arange(len(radii)) / len(radii)
    x, y = radii * np.cos(angle), radii * np.sin(angle)
    area = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
    return np.stack([x, y, np.zeros(len(radii))], axis=1), area


@settings(max_examples=60, deadline=None)
@given(
    radii=st.lists(st.floats(0.2, 1), min_size=4, max_size=12),
    first=st.integers(0, 11),
    seed=st.integers(0, 99),
)
def test_a_polygon_keeps_its_area_and_its_side_wherever_it_begins(radii, first, seed):
    flat, area = _star(np.array(radii))
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    vertices = 40 * flat @ turn.T + [3, -5, 9]
    n = len(radii)
    faces, crossing = triangulate(vertices, np.roll(np.arange(n), first), np.array([n]))
    assert len(faces) == n - 2
    assert len(crossing) == 0
    a, b, c = (vertices[faces[:, j]] for j in range(3))
    along = np.cross(b - a, c - a) @ turn[:, 2] / 2
    assert (along > -1e-9).all()
    np.testing.assert_allclose(along.sum(), 1600 * area, rtol=1e-9)


DENTED = np.array([[0.0, 0, 0], [2, 1, 0], [0, 2, 0], [1, 1, 0]])


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("form", ["obj", "off", "ply", "binary ply"])
def test_a_dented_quad_has_its_area_in_every_format(write, form, first):
    order = np.roll(np.arange(4), first)
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in DENTED)
    said = " ".join(map(str, order))
    head = (
        "ply\nformat {} 1.0\nelement vertex 4\nproperty double x\nproperty double y\n"
        "property double z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    files = {
        "obj": ("a.obj", rows.replace("\n", "\nv ").join(["v ", ""]).removesuffix("v ")
                + f"f {' '.join(map(str, order + 1))}\n"),
        "off": ("a.off", f"OFF\n4 1 0\n{rows}4 {said}\n"),
        "ply": ("a.ply", head.format("ascii") + f"{rows}4 {said}\n"),
        "binary ply": (
            "a.ply",
            head.format("binary_big_endian").encode()
            + DENTED.astype(">f8").tobytes() + struct.pack(">B4i", 4, *order),
        ),
    }  # fmt: skip
    vertices, faces = read_arrays(write(*files[form]))
    np.testing.assert_array_equal(vertices, DENTED)
    assert _area(vertices, faces) == pytest.approx(1)


def test_a_hole_that_a_way_leads_to_stays_open():
    outer, inner = [[0, 0], [4, 0], [4, 4], [0, 4]], [[1, 1], [1, 3], [3, 3], [3, 1]]
    vertices = np.pad(np.array([*outer, *inner], dtype=float), ((0, 0), (0, 1)))
    faces, _ = triangulate(vertices, np.array([0, 1, 2, 3, 0, 4, 5, 6, 7, 4]), np.array([10]))
    assert _area(vertices, faces) == pytest.approx(16 - 4)


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_a_polygon_that_crosses_itself_is_named_and_left_out(write, tilt):
    rows = f"0 0 0\n2 1 {tilt}\n2 0 0\n0 1.5 0\n5 5 5\n"
    path = write("bow.off", f"OFF\n5 2 0\n{rows}3 0 1 4\n4 0 1 2 3\n")
    with pytest.warns(RepairWarning, match=r"bow\.off.*cross themselves.*face 1"):
        _, faces = read_arrays(path)
    assert faces[0].tolist() == [0, 1, 4]
    assert len(np.unique(faces[1:])) < 3
    with pytest.warns(RepairWarning, match="cross"):
        assert "faces with a repeated vertex" in str(check_mesh(path))


def test_lines_and_points_among_the_faces_are_no_triangles_but_are_not_lost(write):
    path = write("a.off", "OFF\n4 3 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 0 3\n4 0 1 3 2\n1 2\n")
    _, faces = read_arrays(path)
    assert faces.tolist() == [[0, 3, 3], [0, 1, 3], [0, 3, 2], [2, 2, 2]]


# PLY files: what is stored beside positions


def _ball():
    ball = make_sphere(n_subdivisions=2)
    return ball.vertices.astype(np.float32).astype(np.float64), ball.faces


def _binary_ply(vertices, faces, *, extra, record, order="<", comment=b""):
    name = {"<": b"little", ">": b"big"}[order]
    head = (
        b"ply\nformat binary_" + name + b"_endian 1.0\n" + comment + b"element vertex %d\n"
        b"property float x\nproperty float y\nproperty float z\nelement face %d\n"
        b"property list uchar int vertex_indices\n" % (len(vertices), len(faces))
    )
    return (
        head + extra + b"end_header\n" + vertices.astype(f"{order}f4").tobytes()
        + b"".join(record(face) for face in faces)
    )  # fmt: skip


@pytest.mark.parametrize("n_loose", [0, 1, 30])
@pytest.mark.parametrize("order", "<>")
def test_texture_coordinates_of_corners_split_no_vertices(write, n_loose, order):
    """However many vertices there are that no face uses: as many as copies would be, too."""
    vertices, faces = _ball()
    loose = np.tile([[3.0, 3.0, 3.0]], (n_loose, 1))
    rng = np.random.default_rng(0)
    stored = np.concatenate([loose, vertices])
    content = _binary_ply(
        stored,
        faces + n_loose,
        extra=b"property list uchar float texcoord\nproperty uchar flags\n",
        record=lambda face: struct.pack(f"{order}B3iB6fB", 3, *face, 6, *rng.random(6), 7),
        order=order,
    )
    found, triangles = read_arrays(write("a.ply", content))
    np.testing.assert_array_equal(found, stored)
    np.testing.assert_array_equal(triangles, faces + n_loose)


def test_lists_of_many_lengths_are_read_record_by_record(write):
    vertices, faces = _ball()
    lengths = np.arange(len(faces)) % 4

    def record(face):
        n = lengths[np.flatnonzero((faces == face).all(axis=1))[0]]
        return struct.pack(f"<B3iB{n}f", 3, *face, n, *range(n))

    extra = b"property list uchar float texcoord\n"
    found, triangles = read_arrays(
        write("a.ply", _binary_ply(vertices, faces, extra=extra, record=record))
    )
    np.testing.assert_array_equal(found, vertices)
    np.testing.assert_array_equal(triangles, faces)


@pytest.mark.parametrize("comment", ["Mâchoire nº 4", "下顎骨", "Нижняя челюсть"])
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "cp1252", "shift_jis", "cp1251", "gbk"])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_comments_in_any_encoding(write, comment, encoding, form):
    said = b"comment " + comment.encode(encoding, errors="replace") + b"\xff\n"
    head = (
        b"ply\nformat %s 1.0\n" % form.encode() + said + b"element vertex 3\nproperty float x\n"
        b"property float y\nproperty float z\nobj_info " + said + b"element face 1\n"
        b"property list uchar int vertex_indices\nend_header\n"
    )
    body = (
        b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
        if form == "ascii"
        else np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
        + struct.pack("<B3i", 3, 0, 1, 2)
    )
    vertices, faces = read_arrays(write("a.ply", head + body))
    np.testing.assert_array_equal(vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("form", ["ascii", "binary"])
@pytest.mark.parametrize("parted", ["by -1", "by records"])
def test_triangle_strips_are_read(write, form, parted):
    """A band of two strips: triangles are wound alike, and cover it once."""
    x, y = np.meshgrid(np.arange(5.0), np.arange(3.0), indexing="xy")
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(15)], axis=1)
    strips = [[v for i in range(5) for v in (row * 5 + 5 + i, row * 5 + i)] for row in range(2)]
    lists = strips if parted == "by records" else [[*strips[0], -1, *strips[1]]]
    head = (
        f"ply\nformat {form}{'_little_endian' * (form == 'binary')} 1.0\nelement vertex 15\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element tristrips {len(lists)}\nproperty list int int vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        rows = [*vertices.tolist(), *([len(one), *one] for one in lists)]
        body = "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
    else:
        body = vertices.astype("<f4").tobytes() + b"".join(
            np.array([len(one), *one], "<i4").tobytes() for one in lists
        )
    found, faces = read_arrays(write("a.ply", head + body))
    a, b, c = (found[faces[:, j]] for j in range(3))
    np.testing.assert_allclose(np.cross(b - a, c - a), np.tile([0, 0, 1], (16, 1)))


def test_what_a_ply_file_holds_instead_of_faces_is_said(write):
    head = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
    head += "property float z\n"
    grid = "element range_grid 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0\n"
    for rest, said in [(grid, "range_grid"), ("end_header\n0 0 0\n", "a point cloud")]:
        with pytest.raises(MeshError, match=rf"a\.ply.*{said}"):
            read_arrays(write("a.ply", head + rest))


# OFF files


@pytest.mark.parametrize("weight", [1.0, 2.0, -0.5])
@pytest.mark.parametrize("head", ["4OFF", "C4OFF", "STN4OFF"])
def test_homogeneous_coordinates_are_divided(write, weight, head):
    vertices, faces = _ball()
    behind = {"4OFF": [], "C4OFF": [9, 9, 9, 1], "STN4OFF": [0, 0, 1, 0.3, 0.4]}[head]
    rows = [[*(weight * v).tolist(), weight, *behind] for v in vertices]
    rows += [[3, *face] for face in faces.tolist()]
    text = "".join(" ".join(map(repr, row)) + "\n" for row in rows)
    mesh = read_mesh(write("a.off", f"{head}\n{len(vertices)} {len(faces)} 0\n{text}"))
    np.testing.assert_allclose(mesh.vertices, vertices, rtol=1e-15)
    np.testing.assert_array_equal(mesh.faces, faces)


@pytest.mark.parametrize(
    ("head", "behind"),
    [
        ("COFF", [0.1, 0.2, 0.3, 1]),
        ("COFF", [255, 0, 0]),
        ("NOFF", [0, 0, 1]),
        ("STOFF", [0.5, 0.5]),
        ("CNOFF", [0, 0, 1, 9, 9, 9, 9]),
        ("STCNOFF", [0, 0, 1, 9, 9, 9, 9, 0.1, 0.2]),
        ("nOFF\n3", []),
        ("nOFF 3", []),
    ],
)
def test_what_stands_behind_positions_is_left_out(write, head, behind):
    vertices, faces = _ball()
    rows = [[*v, *behind] for v in vertices.tolist()] + [[3, *face] for face in faces.tolist()]
    text = "".join(" ".join(map(repr, row)) + "\n" for row in rows)
    mesh = read_mesh(write("a.off", f"{head}\n{len(vertices)} {len(faces)} 0\n{text}"))
    np.testing.assert_array_equal(mesh.vertices, vertices)
    np.testing.assert_array_equal(mesh.faces, faces)


def test_off_files_may_break_lines_anywhere(write):
    text = "OFF\n4 2\n0 0 0 1 0\n0 0 1 0 1 1 0 3 0 1\n2 3 1\n3 2\n"
    text = text.replace("4 2\n", "4 2 0\n")
    vertices, faces = read_arrays(write("a.off", text))
    np.testing.assert_array_equal(vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    assert faces.tolist() == [[0, 1, 2], [1, 3, 2]]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"OFF BINARY\n" + bytes(64), "binary OFF file"),
        ("nOFF\n2\n3 1 0\n0 0\n1 0\n0 1\n3 0 1 2\n", "points with 2 dimensions"),
        ("4OFF\n3 1 0\n0 0 0 1\n1 0 0 0\n0 1 0 1\n3 0 1 2\n", r"at infinity \(1\)"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 x\n3 0 1 2\n", "'0 1 x'"),
        ("PLY\n", "neither with OFF"),
    ],
)
def test_what_is_wrong_with_an_off_file(write, content, said):
    with pytest.raises(MeshError, match=rf"a\.off .*{said}"):
        read_arrays(write("a.off", content))


# Encodings, and files that were cut short


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
@pytest.mark.parametrize("suffix", ["off", "obj", "ply"])
def test_text_in_other_encodings_is_read_or_named(write, suffix, encoding):
    vertices, faces = _ball()
    options = {"encoding": "ascii"} if suffix == "ply" else {}
    text = trimesh.Trimesh(vertices, faces, process=False).export(file_type=suffix, **options)
    text = text.decode() if isinstance(text, bytes) else text
    path = write(f"a.{suffix}", text.encode(encoding))
    if encoding in ("utf-16-le", "utf-16-be"):  # no mark
        with pytest.raises(MeshError, match=r"UTF-16 text without a byte order mark\. Save it"):
            read_arrays(path)
        return
    found, triangles = read_arrays(path)
    np.testing.assert_allclose(found, vertices, atol=1e-7)
    np.testing.assert_array_equal(triangles, faces)


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
@pytest.mark.parametrize("share", [0.001, 0.1, 0.5, 0.99])
def test_a_truncated_stl_file_is_called_so(write, kind, share):
    content = trimesh.Trimesh(*_ball(), process=False).export(file_type=kind)
    content = content.encode() if isinstance(content, str) else content
    with pytest.raises(MeshError, match=r"a\.stl .*(truncated|cut short)"):
        read_arrays(write("a.stl", content[: int(share * len(content))]))


def test_a_binary_stl_file_may_begin_like_text(write):
    content = trimesh.Trimesh(*_ball(), process=False).export(file_type="stl")
    vertices, faces = read_arrays(write("a.stl", b"solid body".ljust(80) + content[80:]))
    assert (len(vertices), len(faces)) == (66, 128)


def test_an_stl_file_of_several_solids_is_read_whole(write):
    """Two halves of a ball, one behind the other, make all of it."""
    vertices, faces = _ball()
    halves = [trimesh.Trimesh(vertices, part, process=False) for part in np.split(faces, 2)]
    text = "\n".join(half.export(file_type="stl_ascii") for half in halves)
    found, triangles = read_arrays(write("a.stl", text + "\n"))
    assert (len(found), len(triangles)) == (66, 128)
    assert _area(found, triangles) == pytest.approx(_area(vertices, faces), rel=1e-6)


def test_pairs_may_be_in_utf_16(tmp_path):
    _fill(tmp_path, 1)
    (tmp_path / "s0.txt").write_bytes("3 0\n5 1\n".encode("utf-16"))
    assert load_collection(tmp_path).correspondences[0].pairs.tolist() == [[3, 0], [5, 1]]


# glTF


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
@pytest.mark.parametrize("n_loose", [0, 2])
def test_gltf_files_are_read_in_their_order(tmp_path, suffix, n_loose):
    vertices, faces = _ball()
    vertices = np.concatenate([np.full((n_loose, 3), 2.0), vertices])
    mesh = trimesh.Trimesh(vertices, faces + n_loose, process=False)
    if suffix == "glb":
        mesh.export(tmp_path / "a.glb")
    else:
        for name, content in trimesh.Scene(mesh).export(file_type="gltf").items():
            (tmp_path / name.replace("model.gltf", "a.gltf")).write_bytes(content)
    found, triangles = read_arrays(tmp_path / f"a.{suffix}")
    np.testing.assert_array_equal(found, vertices)
    np.testing.assert_array_equal(triangles, faces + n_loose)


def test_gltf_files_that_cannot_be_read_say_why(write, tmp_path):
    trimesh.Trimesh(*_ball(), process=False).export(tmp_path / "a.glb")
    whole = (tmp_path / "a.glb").read_bytes()
    with pytest.raises(MeshError, match=r"b\.glb .*truncated"):
        read_arrays(write("b.glb", whole[:-400]))
    with pytest.raises(MeshError, match=r"c\.glb .*does not begin with glTF"):
        read_arrays(write("c.glb", b"glXX" + whole[4:]))
    draco = '{"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"]}'
    with pytest.raises(MeshError, match=r"d\.gltf .*without compression"):
        read_arrays(write("d.gltf", draco))


def test_reading_is_quiet_where_nothing_is_wrong(write):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = read_mesh(write("a.off", "OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"))
    assert isinstance(mesh, Mesh)


# Tables of paths


@pytest.fixture
def three_paths(tmp_path):
    paths = []
    for i in range(3):
        write_mesh(make_sphere(n_subdivisions=1 + i), tmp_path / f"s{i}.off")
        paths.append(str(tmp_path / f"s{i}.off"))
    return paths


TABLES = {
    "data frame": lambda paths: pd.DataFrame({"path": paths}),
    "data frame, other index": lambda paths: pd.DataFrame({"file": paths}, index=[7, 3, 5]),
    "series": lambda paths: pd.Series(paths, index=[7, 3, 5]),
    "index": pd.Index,
    "texts": np.array,
    "objects": lambda paths: np.array(paths, dtype=object),
    "a column of texts": lambda paths: np.array(paths)[:, None],
    "a column of paths": lambda paths: np.array([Path(path) for path in paths])[:, None],
    "categories": lambda paths: pd.Series(pd.Categorical(paths)),
}


@pytest.mark.parametrize("table", TABLES)
def test_a_table_of_one_column_holds_meshes(three_paths, table):
    meshes = as_meshes(TABLES[table](three_paths))
    assert [mesh.n_vertices for mesh in meshes] == [18, 66, 258]


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (lambda paths: pd.DataFrame({"id": [1, 2, 3], "path": paths}), r"2 columns \('id', 'path'"),
        (lambda paths: np.array([paths, paths]).T, r"table of 2 columns.*X\[:, 0\]"),
        (lambda paths: pd.DataFrame(index=[0, 1]), "0 columns"),
    ],
)
def test_a_table_of_several_columns_is_an_error_that_says_so(three_paths, table, said):
    with pytest.raises(TypeError, match=said):
        as_meshes(table(three_paths))


# Folders


def _fill(folder, n=3):
    """Write spheres s0, s1, ... whose vertices correspond by number."""
    ball = make_sphere(n_subdivisions=2)
    for i in range(n):
        write_mesh(Mesh(ball.vertices * [1, 1, 1 + i], ball.faces), folder / f"s{i}.off")
    return ball


MISSING = ["", "NA", "nan", "NaN", "#N/A", "# missing", "#missing", "  ", "-1", "?", "null"]


@pytest.mark.parametrize("missing", MISSING)
@pytest.mark.parametrize("line", [0, 1, 10, 58, 59])
@pytest.mark.parametrize("kind", [".vts", ".template.txt", ".vertices.txt"])
def test_a_line_without_a_number_keeps_the_place_of_all_others(tmp_path, kind, line, missing):
    """Of 60 points, however it is said that one is unknown, 59 are where they were."""
    if missing == "-1" and kind == ".vts":
        return  # these count from 1, and -1 is refused
    ball = _fill(tmp_path)
    n = ball.n_vertices if kind == ".vertices.txt" else 60
    rng = np.random.default_rng(line)
    numbers = [rng.permutation(ball.n_vertices)[:n] for _ in range(3)]
    for i in range(3):
        rows = (numbers[i] + (kind == ".vts")).astype(str).astype(object)
        if i == 1:
            rows[line] = missing
        (tmp_path / f"s{i}{kind}").write_text("\n".join(rows) + "\n")
    read = load_collection(tmp_path).correspondences
    for i in range(3):
        kept = np.flatnonzero(np.arange(n) != (line if i == 1 else -1))
        want = np.stack([numbers[i][kept], kept], axis=1)
        want = want[:, ::-1] if kind == ".vertices.txt" else want
        assert sorted(map(tuple, read[i].pairs.tolist())) == sorted(map(tuple, want.tolist()))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1\n# the nose\n3\n", r"line 2: the comment '# the nose' is between numbers"),
        ("# of cat\n\n3\n", r"line 2 is empty and follows a comment"),
        ("1\nnose\n3\n", r"line 2: 'nose' is not a single whole number"),
        ("1\n2 3\n4\n", r"line 2: '2 3' is not a single whole number"),
        ("NA\n\n", r"all its points are missing"),
    ],
)
def test_a_line_whose_meaning_cannot_be_told_is_named(tmp_path, text, said):
    _fill(tmp_path, 1)
    (tmp_path / "s0.template.txt").write_text(text)
    with pytest.raises(CorrespondenceError, match=rf"s0\.template\.txt.*{said}"):
        load_collection(tmp_path)


def test_heads_and_comments_behind_numbers_are_no_points(tmp_path):
    _fill(tmp_path, 1)
    text = "# vertex of each point\n# by hand\n5 # nose\n# missing\n7,\n"
    for encoding in ("utf-8", "utf-16", "latin-1"):
        (tmp_path / "s0.template.txt").write_bytes(text.encode(encoding))
        assert load_collection(tmp_path).correspondences[0].pairs.tolist() == [[5, 0], [7, 2]]


def test_nan_in_an_array_is_a_missing_point(tmp_path):
    _fill(tmp_path, 1)
    np.save(tmp_path / "s0.template.npy", [3.0, np.nan, 5.0])
    assert load_collection(tmp_path).correspondences[0].pairs.tolist() == [[3, 0], [5, 2]]


@pytest.mark.parametrize("sentinel", [0, 65, 9999])
@pytest.mark.parametrize("kind", [".template.txt", ".vertices.txt"])
def test_a_number_that_stands_for_none_is_warned_of(tmp_path, kind, sentinel):
    if kind == ".template.txt" and sentinel > 65:
        return  # no such vertex: refused
    _fill(tmp_path)
    for i in range(3):
        numbers = np.arange(66)
        numbers[40 : 55 if i == 1 else 40] = sentinel
        np.savetxt(tmp_path / f"s{i}{kind}", numbers, fmt="%d")
    n = 15 + (sentinel < 66)
    with pytest.warns(CoverageWarning, match=rf"'s1' \(.* {sentinel} stands for {n} of 66") as told:
        load_collection(tmp_path)
    assert "'s0'" not in str(told[0].message)


def test_a_number_that_stands_for_none_is_warned_of_in_memory_too(make_learner, probed, collection):
    truths = list(collection.truths[:4])
    pairs = truths[2].pairs.copy()
    pairs[:40, 1] = 0
    truths[2] = Correspondence(pairs)
    with pytest.warns(CoverageWarning) as told:
        make_learner(weighting=None).fit(probed[:4], truths)
    (message,) = [str(one.message) for one in told if "occurs very often" in str(one.message)]
    assert "'body2') (template point 0 stands for 4" in message
    assert "body1" not in message


@settings(max_examples=40, deadline=None)
@given(n=st.integers(1, 400), coarse=st.integers(1, 400), seed=st.integers(0, 99))
def test_templates_and_meshes_of_other_resolutions_are_not_warned_of(n, coarse, seed):
    """Nearest points of one even sampling of a circle on another."""
    start = np.random.default_rng(seed).random()
    nearest = np.floor((np.arange(n) / n + start) % 1 * coarse).astype(int)
    assert crowded_points(np.arange(n), nearest) == ""


@pytest.mark.parametrize(
    "change", ["rotated", "reordered", "three cut away", "turned", "diagonals"]
)
def test_meshes_numbered_alike_correspond_by_number_whatever_their_faces(tmp_path, change):
    ball = make_sphere(n_subdivisions=2)
    rng = np.random.default_rng(0)
    faces = {
        "rotated": np.roll(ball.faces, 1, axis=1),
        "reordered": rng.permutation(ball.faces),
        "three cut away": np.delete(ball.faces, [5, 40, 90], axis=0),
        "turned": ball.faces[:, ::-1],
        "diagonals": _other_diagonals(ball.faces),
    }[change]
    write_mesh(ball, tmp_path / "a.off")
    write_mesh(Mesh(ball.vertices * [1, 1, 2], faces), tmp_path / "b.off")
    data = load_collection(tmp_path)
    assert "by number" in data.DESCR
    assert data.correspondences[1].pairs.tolist() == [[i, i] for i in range(66)]


def _other_diagonals(faces):
    """Turn the edge between each of some pairs of neighbouring faces."""
    faces, done = faces.copy(), set()
    for i, one in enumerate(faces.tolist()):
        for j in range(i + 1, len(faces)):
            common = set(one) & set(faces[j].tolist())
            if len(common) == 2 and not {i, j} & done:
                (a,), (b,) = set(one) - common, set(faces[j].tolist()) - common
                at = one.index(a)
                p, q = one[(at + 1) % 3], one[(at + 2) % 3]
                faces[i], faces[j] = (a, p, b), (a, b, q)
                done |= {i, j}
                break
    return faces


def test_by_number_can_be_asked_for(tmp_path):
    ball = make_sphere(n_subdivisions=2)
    order = np.random.default_rng(1).permutation(66)
    write_mesh(ball, tmp_path / "a.off")
    write_mesh(Mesh(ball.vertices[order], np.argsort(order)[ball.faces]), tmp_path / "b.off")
    with pytest.raises(CorrespondenceError, match=r"'b' has other faces.*by_number=True"):
        load_collection(tmp_path)
    (tmp_path / "a.txt").write_text("0 0\n1 1\n")
    data = load_collection(tmp_path, by_number=True)
    assert data.correspondences[1].pairs.tolist() == [[i, i] for i in range(66)]
    write_mesh(make_sphere(n_subdivisions=1), tmp_path / "c.off")
    with pytest.raises(CorrespondenceError, match="'c' has 18 vertices, but 'a' has 66"):
        load_collection(tmp_path, by_number=True)


def test_formats_that_are_not_read_are_named(tmp_path):
    _fill(tmp_path)
    for name in ("s0.msh", "t.msh", "t.dae", "u.wrl", ".hidden.msh", "notes.txt", "s1.png"):
        (tmp_path / name).write_bytes(b"")
    with pytest.warns(SkippedShapeWarning) as told:
        names = load_collection(tmp_path).names
    assert names == ["s0", "s1", "s2"]
    (message,) = [str(one.message) for one in told]
    assert "t.dae, t.msh, u.wrl are left out" in message
    assert "MeshLab" in message
    with pytest.raises(FileNotFoundError, match=r"no mesh 't'.*t\.msh.*meshio"):
        load_collection(tmp_path, "t")
    with pytest.raises(MeshError, match=r"'\.fbx'.*Blender can save it"):
        read_mesh(tmp_path / "a.fbx")


def test_landmarks_that_are_not_read_are_named_where_others_are_missing(tmp_path):
    _fill(tmp_path)
    for name in ("s0_Landmarks.xlsx", "s1.nts", "s2_points.json", "s2.json", "notes.xlsx"):
        (tmp_path / name).write_bytes(b"")
    with pytest.warns(SkippedShapeWarning) as told:
        load_collection(tmp_path)
    (message,) = [str(one.message) for one in told]
    assert "s0_Landmarks.xlsx, s1.nts, s2_points.json are not read." in message
    assert "a spreadsheet as .csv" in message
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_collection(tmp_path, by_number=True)
        for i in range(3):
            (tmp_path / f"s{i}.txt").write_text("3 0\n5 1\n")
        load_collection(tmp_path)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (lambda paths: dict(zip("abc", paths, strict=True)), r"got a dict.*list\(X\.values\(\)\)"),
        (lambda paths: pd.DataFrame(index=paths), r"of 0 columns.*list\(X\.index\)"),
        (lambda paths: make_creatures(n_shapes=2, n_vertices=500), r"got a Collection.*X\.meshes"),
    ],
)
def test_what_holds_meshes_otherwise_is_told_how_to_give(three_paths, given, said):
    with pytest.raises(TypeError, match=said):
        SpectralBasis(5).transform(given(three_paths))


@pytest.mark.parametrize("around", ["{}\n", "{} ", '"{}"', "{}\r\n"])
def test_blanks_and_quotes_around_a_path_are_told(three_paths, around):
    path = str(three_paths[0])
    with pytest.raises(MeshError, match="blanks or quotes around it; give") as error:
        read_mesh(around.format(path))
    assert repr(path) in str(error.value)


def test_the_command_line_names_them_too(tmp_path):
    _fill(tmp_path, 1)
    (tmp_path / "t.dae").write_bytes(b"")
    with pytest.warns(SkippedShapeWarning, match=r"t\.dae"):
        assert [path.name for path in mesh_files([tmp_path])] == ["s0.off"]


# One reference in every fold


def _skipped(name):
    return SkippedShape(name, "It is broken.", 5)


@pytest.mark.parametrize("cv", [2, 3, LeaveOneOut(), KFold(3, shuffle=True, random_state=1)])
@pytest.mark.parametrize("skipped", [[], [4], [1, 6]])
def test_every_sample_is_predicted_once_and_never_without_the_reference(cv, skipped):
    X = [_skipped(f"s{i}") if i in skipped else f"s{i}" for i in range(8)]
    splits = list(PinnedReference(cv, predict_all=True).split(X))
    assert sorted(np.concatenate([test for _, test in splits])) == list(range(8))
    plain = list(PinnedReference(cv).split(X))
    for (train, test), (train_0, test_0) in zip(splits, plain, strict=True):
        assert train.tolist() == train_0.tolist()
        assert train[0] == 0
        assert not set(train[1:]) & set(test)
        assert set(test) - {0, *skipped} == set(test_0)


def test_cross_val_predict_gives_maps_to_one_reference(make_learner, probed, collection):
    X, y = probed, collection.truths
    learner = make_learner(weighting=None)
    maps = cross_val_predict(learner, X, y, cv=PinnedReference(2, predict_all=True))
    for train, test in PinnedReference(2).split(X):
        fitted = clone(learner).fit([X[i] for i in train], [y[i] for i in train])
        assert fitted.reference_.name == X[0].name
        np.testing.assert_allclose(maps[test], fitted.predict([X[i] for i in test]), atol=1e-12)


def test_a_named_reference_that_a_fold_lacks_is_an_error(make_learner, probed, collection):
    learner = make_learner(weighting=None, reference=probed[0].name)
    with pytest.raises(ValueError, match="must name exactly one of the training shapes"):
        cross_val_predict(learner, probed, collection.truths, cv=2)


def test_a_data_frame_of_paths_is_split_by_its_rows():
    X = pd.DataFrame({"path": [f"s{i}.off" for i in range(7)]})
    assert len(list(PinnedReference(3).split(X))) == PinnedReference(3).get_n_splits(X) == 3


# Seams


def _split(mesh, share, away, rng):
    """Give a part of the vertices between two halves a copy, some way from where they are."""
    vertices, faces = mesh.vertices, mesh.faces.copy()
    upper = vertices[faces].mean(axis=1)[:, 2] > 0.1
    border = np.intersect1d(faces[upper], faces[~upper])
    border = border[: int(share * len(border))]
    number = np.arange(len(vertices))
    number[border] = len(vertices) + np.arange(len(border))
    faces[upper] = number[faces[upper]]
    moved = vertices[border] + away * rng.uniform(-1, 1, (len(border), 3))
    return np.concatenate([vertices, moved]), faces


@pytest.mark.parametrize("share", [0.5, 1.0])
@pytest.mark.parametrize("away", [0.0, 1e-6, 1e-5, 5e-5])
def test_a_seam_is_closed_as_far_as_four_digits_tell(share, away):
    ball = make_sphere(n_subdivisions=3)
    vertices, faces = _split(ball, share, away, np.random.default_rng(0))
    repair = repair_mesh((vertices, faces))
    np.testing.assert_array_equal(repair.mesh.faces, ball.faces)
    assert (repair.vertex_map >= 0).all()


@pytest.mark.parametrize("away", [2e-3, 1e-2])
def test_a_seam_that_stays_open_is_told_at_the_basis(away):
    vertices, faces = _split(make_sphere(n_subdivisions=3), 1.0, away, np.random.default_rng(0))
    assert "open seams" in [fault.kind for fault in check_mesh((vertices, faces)).faults]
    with pytest.warns(RepairWarning, match=r"boundary edges that run along others.*weld"):
        SpectralBasis(5).transform([(vertices, faces)])


def test_the_rim_of_a_plain_opening_is_no_seam():
    ball = make_sphere(n_subdivisions=3)
    open_ball = (ball.vertices, ball.faces[ball.vertices[ball.faces].mean(axis=1)[:, 2] < 0.3])
    assert repair_mesh(open_ball).tally == {}


# Coordinates of surveyors


@pytest.mark.parametrize("northing", [5.5e6, 3.3e7])
@pytest.mark.parametrize("axes", [[1], [0, 1]])
def test_single_precision_far_away_is_called_by_its_name(northing, axes):
    ball = make_sphere(n_subdivisions=3)
    far = ball.vertices.copy()
    far[:, axes] += northing
    merged = far.astype(np.float32).astype(np.float64)
    said = str(check_mesh((merged, ball.faces)))
    assert "so far from the origin that single precision has merged" in said
    with pytest.raises(MeshError, match="subtract an offset before saving"):
        SpectralBasis(5).transform([(merged, ball.faces)])
    assert "fatal" not in str(check_mesh((far, ball.faces)))


# Right pairs that are called wrong


@pytest.fixture(scope="module")
def eigenfunctions():
    """Return eigenfunctions of creatures at template points that all have, one array each."""
    creatures = make_creatures(n_shapes=4, n_vertices=600)
    shapes = SpectralBasis(25).transform(creatures.meshes)
    by_point = [dict(truth.pairs[:, ::-1].tolist()) for truth in creatures.correspondences]
    common = sorted(set.intersection(*map(set, by_point)))
    return [
        shape.evecs[[vertex[point] for point in common]] * np.sqrt(shape.mass.sum())
        for shape, vertex in zip(shapes, by_point, strict=True)
    ]


@pytest.mark.parametrize("n", [50, 59, 60, 100, 200])
def test_right_pairs_are_kept_and_wrong_ones_found(eigenfunctions, n):
    """Of right pairs at most 1 % are dropped, whatever their areas; of exchanged ones most are."""
    first, *others = eigenfunctions
    rng = np.random.default_rng(n)
    dropped, found = [], []
    for evecs in others:
        for _ in range(4):
            at = rng.choice(len(first), n, replace=False)
            areas = rng.gamma(1.0, size=n)
            dropped.append(wrong_pairs(evecs[at], first[at], areas).mean())
            bad = rng.choice(n, n // 10, replace=False)
            images = first[at].copy()
            images[bad] = np.roll(images[bad], 1, axis=0)
            found.append(wrong_pairs(evecs[at], images, areas)[bad].mean())
    assert np.mean(dropped) <= 0.01
    assert np.mean(found) > 0.75


# VTK


def _as_vtk(vertices, lists, *, strips, binary, version):
    """Return a legacy file, with an array before the polygons and one behind them."""

    def numbers(values, kind):
        values = np.asarray(values)
        if binary:
            return values.astype({"float": ">f4", "int": ">i4", "vtktypeint64": ">i8"}[kind])
        return b" ".join(repr(value).encode() for value in values.ravel().tolist())

    def block(head, values, kind):
        return head.encode() + b"\n" + bytes(numbers(values, kind)) + b"\n"

    corners = [corner for one in lists for corner in one]
    counts = [len(one) for one in lists]
    word = "TRIANGLE_STRIPS" if strips else "POLYGONS"
    out = f"# vtk DataFile Version {version}\nmade here\n{'BINARY' if binary else 'ASCII'}\n"
    out = out.encode() + b"DATASET POLYDATA\n"
    out += block("FIELD FieldData 1\ntime 1 2 float", [1.5, 2.5], "float")
    out += block(f"POINTS {len(vertices)} float", vertices, "float")
    if version == "5.1":
        out += b"METADATA\nINFORMATION 0\n\n"
        out += f"{word} {len(lists) + 1} {len(corners)}\n".encode()
        out += block("OFFSETS vtktypeint64", np.cumsum([0, *counts]), "vtktypeint64")
        out += block("CONNECTIVITY vtktypeint64", corners, "vtktypeint64")
    else:
        table = [number for one in lists for number in (len(one), *one)]
        out += block(f"{word} {len(lists)} {len(table)}", table, "int")
    return out + block(
        f"POINT_DATA {len(vertices)}\nSCALARS height float 1\nLOOKUP_TABLE default",
        vertices[:, 2],
        "float",
    )


def _as_vtp(vertices, lists, *, strips, form, packed, order, header):
    ends = np.cumsum([len(one) for one in lists])
    corners = np.array([corner for one in lists for corner in one])
    size, appended = np.dtype({"<": "<", ">": ">"}[order] + header), b""

    def data(values, kind):
        nonlocal appended
        values = np.asarray(values)
        if form == "ascii":
            return 'format="ascii"', " ".join(repr(one) for one in values.ravel().tolist())
        content = values.astype(order + kind).tobytes()
        head = np.array([len(content)], size).tobytes()
        if packed:
            blocks = [content[i : i + 500] for i in range(0, len(content), 500)]
            small = [zlib.compress(one) for one in blocks]
            sizes = [len(blocks), 500, len(blocks[-1]) % 500, *map(len, small)]
            head, content = np.array(sizes, size).tobytes(), b"".join(small)
        if form == "binary":
            parts = [head, content] if packed else [head + content]
            return 'format="binary"', "".join(base64.b64encode(one).decode() for one in parts)
        at = len(appended)
        appended += head + content
        return f'format="appended" offset="{at}"', ""

    def array(name, values, kind, n=1):
        types = {"f4": "Float32", "i4": "Int32"}
        how, text = data(values, kind)
        return (
            f'<DataArray type="{types[kind]}" Name="{name}" NumberOfComponents="{n}" {how}>'
            f'<InformationKey name="x"><Value index="0">3</Value></InformationKey>{text}'
            "</DataArray>"
        )

    section = "Strips" if strips else "Polys"
    body = (
        f'<PolyData><Piece NumberOfPoints="{len(vertices)}"><PointData>'
        f"{array('height', vertices[:, 2], 'f4')}</PointData><Points>"
        f"{array('Points', vertices, 'f4', 3)}</Points><{section}>"
        f"{array('connectivity', corners, 'i4')}{array('offsets', ends, 'i4')}</{section}>"
        "</Piece></PolyData>"
    )
    names = {"u4": "UInt32", "u8": "UInt64", "<": "LittleEndian", ">": "BigEndian"}
    head = (
        f'<?xml version="1.0"?><VTKFile type="PolyData" byte_order="{names[order]}" '
        f'header_type="{names[header]}"'
        + (' compressor="vtkZLibDataCompressor">' if packed else ">")
    )
    if form == "appended":
        raw = b'<AppendedData encoding="raw">\n _' + appended + b"\n</AppendedData>"
        return (head + body).encode() + raw + b"</VTKFile>"
    return (head + body + "</VTKFile>").encode()


def _band():
    """Return a band of 5 x 3 points, as two strips and as quads."""
    x, y = np.meshgrid(np.arange(5.0), np.arange(3.0))
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(15)], axis=1)
    strips = [[v for i in range(5) for v in (row * 5 + 5 + i, row * 5 + i)] for row in range(2)]
    quads = [[a, a + 1, a + 6, a + 5] for row in range(2) for a in range(row * 5, row * 5 + 4)]
    return vertices, strips, quads


@pytest.mark.parametrize("strips", [False, True])
@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("version", ["3.0", "5.1"])
def test_legacy_files_of_vtk_are_read(write, strips, binary, version):
    vertices, *lists = _band()
    content = _as_vtk(
        vertices, lists[not strips], strips=strips, binary=binary, version=version
    )  # fmt: skip
    _is_the_band(*read_arrays(write("a.vtk", content)), vertices)


@pytest.mark.parametrize("strips", [False, True])
@pytest.mark.parametrize("form", ["ascii", "binary", "appended"])
@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize(("order", "header"), [("<", "u4"), (">", "u8")])
def test_vtp_files_are_read(write, strips, form, packed, order, header):
    vertices, *lists = _band()
    options = {"strips": strips, "form": form, "packed": packed, "order": order, "header": header}
    content = _as_vtp(vertices, lists[not strips], **options)
    _is_the_band(*read_arrays(write("a.vtp", content)), vertices)
    if form == "appended":
        with pytest.raises(MeshError, match=r"b\.vtp .*(truncated|unpacked)"):
            read_arrays(write("b.vtp", content.replace(content[-150:-60], b"")))


def _is_the_band(found, faces, vertices):
    np.testing.assert_array_equal(found, vertices)
    a, b, c = (found[faces[:, j]] for j in range(3))
    np.testing.assert_allclose(np.cross(b - a, c - a), np.tile([0, 0, 1], (16, 1)))


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.vtk", "ply\n", "does not begin with '# vtk DataFile'"),
        (
            "a.vtk",
            "# vtk DataFile Version 3.0\n.\nASCII\nDATASET UNSTRUCTURED_GRID\n",
            "UNSTRUCTURED_GRID, not the POLYDATA.*ParaView",
        ),
        (
            "a.vtk",
            "# vtk DataFile Version 3.0\n.\nBINARY\nDATASET POLYDATA\nPOINTS 9 float\n00",
            "truncated",
        ),
        ("a.vtp", '<VTKFile type="UnstructuredGrid"></VTKFile>', "UnstructuredGrid, not PolyData"),
        ("a.vtp", '<VTKFile type="PolyData">', "not a complete XML file"),
        ("a.vtp", '<!DOCTYPE a [<!ENTITY b "b">]><VTKFile type="PolyData"/>', "XML entities"),
        ("a.vtp", '<VTKFile type="PolyData" compressor="vtkLZ4DataCompressor"/>', "LZ4.*ZLib"),
    ],
)
def test_files_of_vtk_that_cannot_be_read_say_why(write, name, content, said):
    with pytest.raises(MeshError, match=rf"a\.vt. .*{said}"):
        read_arrays(write(name, content))


def test_a_folder_of_many_formats_is_read(tmp_path):
    ball = make_sphere(n_subdivisions=1)
    write_mesh(ball, tmp_path / "a.ply")
    trimesh.Trimesh(ball.vertices, ball.faces, process=False).export(tmp_path / "b.glb")
    options = {"strips": False, "binary": True, "version": "5.1"}
    content = _as_vtk(ball.vertices, ball.faces.tolist(), **options)
    for name in ("c.vtk", "a.vtk"):
        (tmp_path / name).write_bytes(content)
    with pytest.warns(SkippedShapeWarning, match=r"a\.vtk are left out, because the folder also"):
        data = load_collection(tmp_path)
    assert data.names == ["a", "b", "c"]
    assert [mesh.n_vertices for mesh in data.meshes] == [18] * 3
