"""Inputs of the field that were once wrong without a word: one test for each kind."""

import struct
import warnings

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from skfmap import Mesh, check_mesh
from skfmap.datasets import make_sphere
from skfmap.exceptions import MeshError, RepairWarning
from skfmap.geometry.polygons import triangulate
from skfmap.io import read_arrays, read_mesh


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
        assert "faces that name a vertex twice" in str(check_mesh(path))


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
    for rest, said in [(grid, "range_grid"), ("end_header\n0 0 0\n", "a cloud of points")]:
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
        ("nOFF\n2\n3 1 0\n0 0\n1 0\n0 1\n3 0 1 2\n", "points of 2 dimensions"),
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
