"""Mesh files made otherwise than usual: positions and faces are those of the file, or it is named.

Found by a search for others of the kinds in test_cases.py.
"""

import base64
import gzip
import json
import struct

import numpy as np
import pytest

from skfmap.datasets import load_collection, make_sphere
from skfmap.exceptions import MeshError, SkippedShapeWarning
from skfmap.io import read_arrays, read_mesh, read_uv, write_mesh

_BALL = make_sphere(1)
_V, _F = _BALL.vertices.astype("<f4").astype(float), _BALL.faces
_N, _M = len(_V), len(_F)


@pytest.fixture
def write(tmp_path):
    """Return a function that writes text or bytes to a file and returns its path."""

    def write(name, content):
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def _assert_ball(path, vertices=_V, faces=_F):
    found, triangles = read_arrays(path)
    np.testing.assert_allclose(found, vertices, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(triangles, faces)


def _numbers(rows):
    return "".join(" ".join(f"{x!r}" for x in row) + "\n" for row in np.asarray(rows).tolist())


# PLY

_HEAD = (
    f"element vertex {_N}",
    *(f"property float {axis}" for axis in "xyz"),
    f"element face {_M}",
    "property list uchar int vertex_indices",
)


def _ply(head, body, form="ascii", ends="\n"):
    lines = ["ply", f"format {form} 1.0", *head, "end_header", ""]
    return ends.join(lines).encode("latin-1") + body


def _records(faces, order="<", kind="i4"):
    table = np.zeros(len(faces), dtype=[("n", "u1"), ("corners", order + kind, 3)])
    table["n"], table["corners"] = 3, faces
    return table.tobytes()


@pytest.mark.parametrize("first", [1.0, np.frombuffer(b"\x0a\x00\x80\x3f", "<f4")[0]])
def test_lines_of_a_ply_head_may_end_as_on_old_macs(write, first):
    vertices = _V.copy()
    vertices[0, 0] = first  # whose first byte may be that of a line's end
    body = vertices.astype("<f4").tobytes() + _records(_F)
    _assert_ball(write("a.ply", _ply(_HEAD, body, "binary_little_endian", "\r")), vertices)
    text = (_numbers(vertices) + _numbers(np.insert(_F, 0, 3, axis=1))).replace("\n", "\r")
    _assert_ball(write("b.ply", _ply(_HEAD, text.encode(), ends="\r")), vertices)


@pytest.mark.parametrize("comment", ["größe Ċ Ĭ", "größe\n", "下顎骨 ഊ"])
@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_comments_of_a_ply_head_may_be_in_utf_16(write, comment, encoding):
    head = "\n".join([*_HEAD, "end_header", ""]).encode()
    said = b"ply\nformat binary_little_endian 1.0\ncomment " + comment.encode(encoding) + b"\n"
    _assert_ball(write("a.ply", said + head + _V.astype("<f4").tobytes() + _records(_F)))


def test_faces_and_triangle_strips_of_one_ply_file_are_both_read(write):
    strips = np.concatenate([[*face, -1] for face in _F[9:]]).astype("<i4")
    head = [
        *_HEAD[:4],
        *("element face 9", _HEAD[5]),
        *("element tristrips 1", "property list int int vertex_indices"),
    ]
    body = _V.astype("<f4").tobytes() + _records(_F[:9])
    body += struct.pack("<i", len(strips)) + strips.tobytes()
    _assert_ball(write("a.ply", _ply(head, body, "binary_little_endian")))


def test_ply_indices_may_have_eight_bytes(write):
    head = [*_HEAD[:5], "property list uchar int64 vertex_index"]
    body = _V.astype(">f4").tobytes() + _records(_F, ">", "i8")
    _assert_ball(write("a.ply", _ply(head, body, "binary_big_endian")))


# OBJ

_OBJ_V = "".join(f"v {line}\n" for line in _numbers(_V).splitlines())
_OBJ_F = "".join(f"f {line}\n" for line in _numbers(_F + 1).splitlines())


@pytest.mark.parametrize(
    "line", ["# C:\\models\\", "mtllib C:\\models\\", "o part\\", "usemtl \\ "]
)
def test_a_path_that_ends_in_a_backslash_swallows_no_line_of_an_obj_file(write, line):
    _assert_ball(write("a.obj", f"{line}\n{_OBJ_V}{line}\r\n{_OBJ_F}"))
    _assert_ball(
        write("b.obj", _OBJ_V.replace("\n", f" {line}\n") + _OBJ_F)
        if "#" in line
        else write("b.obj", f"{_OBJ_V}{line}\n{_OBJ_F}")
    )


@pytest.mark.parametrize("ends", ["\\\n", "\\\r\n", "\\ \n", "\\\r"])
def test_lines_of_vertices_and_faces_of_an_obj_file_go_on_behind_a_backslash(write, ends):
    broken = "".join(
        f"{a} {b} {ends}{c} {ends} {d}\n"
        for a, b, c, d in map(str.split, (_OBJ_V + _OBJ_F).splitlines())
    )
    _assert_ball(write("a.obj", broken))


def test_the_old_name_of_faces_of_obj_files_is_known(write):
    faces = "".join(
        "fo" + line[1:] if i % 2 else line
        for i, line in enumerate(_OBJ_F.splitlines(keepends=True))
    )
    _assert_ball(write("a.obj", _OBJ_V + faces))
    path = write("b.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nfo 1/3 2/1 3/2\n")
    assert read_uv(path).tolist() == [[0, 1], [0, 0], [1, 0]]


# OFF


@pytest.mark.parametrize(
    ("keyword", "before", "behind"),
    [("NCOFF", 1, 7), ("CNOFF", 1, 7), ("C4OFF", -0.5, 4), ("ST4nOFF 3", 2, 2), ("off", 1, 0)],
)
def test_words_that_off_files_begin_with(write, keyword, before, behind):
    rows = before * _V
    if "4" in keyword:
        rows = np.column_stack([rows, np.full(_N, before)])
    rows = np.column_stack([rows, np.full((_N, behind), 0.3)])
    faces = _numbers(np.insert(_F, 0, 3, axis=1))
    _assert_ball(write("a.off", f"{keyword}\n{_N} {_M} 0\n{_numbers(rows)}{faces}"))


# STL


def test_what_stands_behind_the_triangles_of_an_stl_file_is_told(write, tmp_path):
    write_mesh(_BALL, tmp_path / "a.stl")
    with pytest.raises(MeshError, match=r"has 7 bytes after the 32 triangles"):
        read_mesh(write("b.stl", (tmp_path / "a.stl").read_bytes() + b"\0\0extra"))


# glTF

_KINDS = {"float32": 5126, "uint8": 5121, "uint16": 5123, "int16": 5122}


def _glb(arrays, meshes, nodes=({"mesh": 0},), scenes=None, **more):
    """Return a .glb file whose accessors are the arrays."""
    binary, views, accessors = b"", [], []
    for array in arrays:
        binary += b"\0" * (-len(binary) % 4)
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": array.nbytes})
        accessors.append(
            {
                "bufferView": len(views) - 1,
                "componentType": _KINDS[array.dtype.name],
                "count": len(array),
                "type": "VEC3" if array.ndim == 2 else "SCALAR",
            }
        )
        binary += array.tobytes()
    binary += b"\0" * (-len(binary) % 4)
    scene = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [{"primitives": each} if isinstance(each, list) else each for each in meshes],
        "nodes": list(nodes),
        "scenes": scenes or [{"nodes": [0]}],
    } | more
    scene = {key: value for key, value in scene.items() if value is not None}
    head = json.dumps(scene).encode()
    head += b" " * (-len(head) % 4)
    chunks = struct.pack("<I4s", len(head), b"JSON") + head
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _part(vertices, faces=None, **more):
    indices = {} if faces is None else {"indices": faces}
    return {"attributes": {"POSITION": vertices}, **indices, **more}


_P, _I = _V.astype("f4"), _F.astype("u2").ravel()


def test_materials_of_a_glb_file_share_its_vertices(write):
    parts = [_part(0, 1, material=0), _part(0, 2, material=1)]
    _assert_ball(write("a.glb", _glb([_P, _I[:48], _I[48:]], [parts], materials=[{}, {}])))


def test_nodes_of_a_glb_file_keep_their_order_and_their_place(write):
    turn = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]  # a quarter around z
    nodes = [
        {"name": "z", "children": [1], "scale": [2, 2, 2], "translation": [1, 0, 0]},
        {"name": "y", "mesh": 0, "rotation": turn, "translation": [0, 3, 0]},
        {"name": "a", "mesh": 0, "matrix": np.diag([-1.0, 1, 1, 1]).ravel().tolist()},
    ]
    turned = _V @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    wanted = np.concatenate([2 * turned + np.array([1, 6, 0]), _V * [-1, 1, 1]])
    faces = np.concatenate([_F, _F[:, [0, 2, 1]] + _N])
    content = _glb([_P, _I], [[_part(0, 1)]], nodes, [{"nodes": [0, 2]}])
    _assert_ball(write("a.glb", content), wanted, faces)
    other = _glb([_P, _I], [[_part(0, 1)]], nodes, [{"nodes": [0]}, {"nodes": [2]}], scene=1)
    _assert_ball(write("b.glb", other), _V * [-1, 1, 1], _F[:, [0, 2, 1]])


@pytest.mark.parametrize("nodes", [[{"mesh": 0}], []])
def test_a_glb_file_may_have_no_scene(write, nodes):
    content = _glb([_P, _I], [[_part(0, 1)]], nodes, scenes=[])
    _assert_ball(write("a.glb", content))


def test_strips_fans_and_corners_without_numbers_of_a_glb_file(write):
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "f4")
    order = np.array([0, 1, 3, 2], "u1")
    strip = _glb([square, order], [[_part(0, 1, mode=5)]])
    _assert_ball(write("a.glb", strip), square, [[0, 1, 3], [3, 1, 2]])
    _assert_ball(
        write("b.glb", _glb([square], [[_part(0, mode=6)]])), square, [[0, 1, 2], [0, 2, 3]]
    )
    corners = _V[_F.ravel()].astype("f4")
    content = _glb([corners, _P], [[_part(0), _part(1, mode=0)]])
    _assert_ball(write("c.glb", content), corners, np.arange(3 * _M).reshape(-1, 3))


def test_morph_targets_of_a_glb_file_count_as_far_as_they_weigh(write):
    mesh = {"primitives": [_part(0, 1, targets=[{"POSITION": 2}])], "weights": [0.5]}
    arrays = [_P, _I, np.ones_like(_P)]
    _assert_ball(write("a.glb", _glb(arrays, [mesh])), _V + 0.5)
    _assert_ball(write("b.glb", _glb(arrays, [mesh], [{"mesh": 0, "weights": [0.0]}])))


def test_whole_numbers_of_a_glb_file_are_scaled_as_it_says(write):
    steps = np.round(_V * 32767).astype("i2")
    node = {"mesh": 0, "scale": [1 / 32767] * 3}
    _assert_ball(write("a.glb", _glb([steps, _I], [[_part(0, 1)]], [node])), steps / 32767)


@pytest.mark.parametrize("beside", [False, True])
def test_gltf_arrays_may_lie_between_others_and_be_mended_here_and_there(write, beside):
    rows = np.zeros(_N, dtype=[("at", "<f4", 3), ("uv", "<f4", 2)])
    rows["at"] = _V
    binary = rows.tobytes() + _I.tobytes() + struct.pack("<HH", 4, 0) + struct.pack("<3f", 9, 8, 7)
    if beside:
        write("my data.bin", binary)
    uri = "my%20data.bin" if beside else f"data:;base64,{base64.b64encode(binary).decode()}"
    lengths = [rows.nbytes, _I.nbytes, 4, 12]
    views = [
        {"buffer": 0, "byteOffset": sum(lengths[:i]), "byteLength": n}
        for i, n in enumerate(lengths)
    ]
    views[0]["byteStride"] = 20
    sparse = {
        "count": 1,
        "indices": {"bufferView": 2, "componentType": 5123},
        "values": {"bufferView": 3},
    }
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": _N, "type": "VEC3", "sparse": sparse},
        {"bufferView": 1, "componentType": 5123, "count": 3 * _M, "type": "SCALAR"},
    ]
    scene = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": uri, "byteLength": len(binary)}],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [{"primitives": [_part(0, 1)]}],
    }
    wanted = _V.copy()
    wanted[4] = [9, 8, 7]
    _assert_ball(write("a.gltf", json.dumps(scene)), wanted)
    scene["buffers"][0]["uri"] = "gone.bin"
    with pytest.raises(MeshError, match=r"in another file, gone\.bin, which is missing"):
        read_arrays(write("b.gltf", json.dumps(scene)))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (_glb([_P, np.array([0, 1, 99], "u2")], [[_part(0, 1)]]), "vertex 99, but its part has 18"),
        (_glb([_P, np.array([0, 1], "u2")], [[_part(0, 1)]]), "triangles with 2 corners"),
        (_glb([_P, _I], [[_part(0, 1, mode=1)]]), "contains no triangles"),
        (_glb([_P, _I], [[_part(0, 7)]]), "not a glTF file, or is damaged"),
        (
            _glb([_P, _I], [[_part(0, 1)]], [{"mesh": 0, "children": [0]}]),
            "nodes that contain themselves",
        ),
        (
            _glb(
                [_P, _I],
                [[_part(0, 1)]],
                [{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {}}}],
            ),
            "has instances of a mesh",
        ),
        (
            _glb(
                [_P, _I],
                [[_part(0, 1)]],
                accessors=[{"componentType": 5126, "count": 18, "type": "VEC3"}] * 2,
            ),
            "compressed",
        ),
        (
            _glb(
                [_P, _I],
                [[_part(0, 1)]],
                accessors=[{"componentType": 5126, "count": 99, "type": "VEC3", "bufferView": 0}]
                * 2,
            ),
            "shorter than declared",
        ),
    ],
)
def test_glb_files_that_are_damaged_are_named(write, content, said):
    with pytest.raises(MeshError, match=said):
        read_arrays(write("a.glb", content))


@pytest.mark.parametrize(
    "uri", ["../data.bin", "{}/data.bin", "http://x.org/data.bin", "a/../../b"]
)
def test_a_gltf_file_opens_none_from_elsewhere(write, tmp_path, uri):
    write("data.bin", b"\0" * 99)
    (tmp_path / "inner").mkdir()
    scene = json.loads(_glb([_P, _I], [[_part(0, 1)]])[20:].partition(b"BIN")[0][:-4])
    scene["buffers"][0]["uri"] = uri.format(tmp_path)
    with pytest.raises(MeshError, match="not beside it"):
        read_arrays(write("inner/a.gltf", json.dumps(scene)))


def test_a_small_gltf_file_does_not_fill_the_memory(write):
    nodes = [{"mesh": 0}] * 9
    content = _glb([_P, _I], [[_part(0, 1)]], nodes, [{"nodes": list(range(9))}])
    assert len(read_arrays(write("a.glb", content))[0]) == 9 * _N  # several times is no matter
    content = _glb([_P, _I], [[_part(0, 1)]], nodes, [{"nodes": [0] * 9999}])
    with pytest.raises(MeshError, match="many times its size"):
        read_arrays(write("b.glb", content))
    sparse = {"componentType": 5126, "count": 10**12, "type": "VEC3", "sparse": {}}
    with pytest.raises(MeshError, match="many times its size"):
        read_arrays(write("c.glb", _glb([_P, _I], [[_part(0, 1)]], accessors=[sparse] * 2)))


# Files that are no meshes, and paths


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.off", gzip.compress(b"OFF", mtime=0), r"gzip.*Unpack it first"),
        ("a.ply", b"PK\x03\x04 and so on", r"zip.*Unpack it first"),
        ("a.ply", "version https://git-lfs.github.com/spec/v1\noid sha256:4\n", "git lfs pull"),
        ("a.obj", "\n<!DOCTYPE html>\n<html>", "web page"),
    ],
)
def test_what_is_no_mesh_is_called_by_its_name(write, name, content, said):
    with pytest.raises(MeshError, match=said):
        read_mesh(write(name, content))


def test_packed_meshes_in_a_folder_are_named(write, tmp_path):
    for name in ("a.off", "b.off"):
        write_mesh(_BALL, tmp_path / name)
    for name in ("a.off.gz", "c.ply.gz", "d.vtu.zip", "notes.txt.gz", "all.zip"):
        write(name, b"")
    with pytest.warns(SkippedShapeWarning) as told:
        assert load_collection(tmp_path).names == ["a", "b"]
    (message,) = [str(one.message) for one in told]
    assert "d.vtu.zip are left out, because .gz, .zip is not read. Unpack it first." in message
    with pytest.raises(MeshError, match=r"'\.gz'.*Unpack it first"):
        read_mesh(tmp_path / "c.ply.gz")


def test_a_path_from_home_is_written_out(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    with pytest.raises(FileNotFoundError, match=r"~.scan\.ply\. Write .*scan\.ply\."):
        read_mesh("~/scan.ply")
