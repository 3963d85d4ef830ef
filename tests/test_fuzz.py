"""Hostile files give the mesh that they hold or an error of ours, in bounded time and memory."""

import io
import os
import random
import struct
import subprocess
import sys
import time
import tracemalloc
import warnings

import numpy as np
import pytest
import trimesh

from skfmap import Correspondence, Mesh
from skfmap.datasets import load_collection, make_sphere
from skfmap.exceptions import CorrespondenceError, MeshError
from skfmap.io import read_mesh, write_mesh

_TRIANGLE = b"0 0 0\n1 0 0\n0 1 0\n"
_FACE_LIST = b"property list uchar int vertex_indices"


def _ply(n_vertices, n_faces, text_format=b"ascii", faces=_FACE_LIST, first=b""):
    head = b"ply\nformat " + text_format + b" 1.0\n" + first + b"element vertex " + n_vertices
    return (
        head
        + b"\nproperty float x\nproperty float y\nproperty float z\nelement face "
        + n_faces
        + b"\n"
        + (faces + b"\nend_header\n")
    )


_OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
HOSTILE = {
    "vertices.off": b"OFF\n2000000000 1 0\n" + _TRIANGLE + b"3 0 1 2\n",
    "faces.off": b"OFF\n3 2000000000 0\n" + _TRIANGLE + b"3 0 1 2\n",
    "polygon.off": b"OFF\n3 1 0\n" + _TRIANGLE + b"1000000000 0 1 2\n",
    "cut-short.off": b"OFF\n3 1 0\n" + _TRIANGLE + b"4 0 1 2\n",
    "negative.off": b"OFF\n-3 -1 0\n" + _TRIANGLE + b"3 0 1 2\n",
    "fraction.off": b"OFF\n3.5 1 0\n" + _TRIANGLE + b"3 0 1 2\n",
    "words.off": b"OFF\nthree one zero\n" + _TRIANGLE,
    "empty.off": b"",
    "header.off": b"OFF",
    "zeros.off": b"\0" * 1000,
    "binary.off": b"OFF BINARY\n" + bytes(range(256)) * 4,
    "overflow.off": b"OFF\n3 1 0\n1e400 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    "index.off": b"OFF\n3 1 0\n" + _TRIANGLE + b"3 0 1 99999999999999999999\n",
    "zipped.off": b"\x1f\x8b\x08\x00" + b"\0" * 100,
    "vertices.ply": _ply(b"4000000000", b"1", b"binary_little_endian") + b"\0" * 100,
    "text-vertices.ply": _ply(b"4000000000", b"1") + _TRIANGLE + b"3 0 1 2\n",
    "list.ply": _ply(b"3", b"1", b"binary_little_endian", b"property list uint int vertex_indices")
    + np.zeros((3, 3), "<f4").tobytes()
    + struct.pack("<I", 4_000_000_000)
    + b"\0" * 12,
    "cut-short.ply": _ply(b"3", b"1") + _TRIANGLE + b"5 0 1 2\n",
    "negative.ply": _ply(b"-3", b"1") + _TRIANGLE,
    "negative-index.ply": _ply(b"3", b"1") + _TRIANGLE + b"3 -1 0 1\n",
    "endless.ply": b"ply\nformat ascii 1.0\nelement vertex 3\n" + b"property float x\n" * 20_000,
    "long-line.ply": b"ply\n" + b"comment " + b"x" * 2_000_000,
    "type.ply": b"ply\nformat ascii 1.0\nelement vertex 3\nproperty banana x\nend_header\n"
    + _TRIANGLE,
    "index.obj": _OBJ + b"f 1 2 99999999999\n",
    "zero.obj": _OBJ + b"f 0 1 2\n",
    "zero-texture.obj": _OBJ + b"f 1/1 0/2 3/3\n",
    "negative.obj": _OBJ + b"f -5 1 2\n",
    "nan.obj": b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "spaces.obj": b"v" + b" " * 1_000_000 + b"1",
    "lines.obj": (b" " * 1000 + b"\n") * 2000,
    "count.stl": b"\0" * 80 + struct.pack("<I", 4_000_000_000) + b"\0" * 200,
    "truncated.stl": b"\0" * 80 + struct.pack("<I", 2) + b"\0" * 60,
    "solid.stl": b"solid x\n" + b"facet normal 0 0 0\n" * 20_000,
}
UNUSUAL = {
    "utf16.off": (b"OFF\n3 1 0\n" + _TRIANGLE + b"3 0 1 2\n").decode().encode("utf-16"),
    "utf16.obj": (_OBJ + b"f 1 2 3\n").decode().encode("utf-16"),
    "crlf.off": b"OFF\r\n3 1 0\r\n0 0 0\r\n1 0 0\r\n0 1 0\r\n3 0 1 2\r\n",
    "cr.off": b"OFF\r3 1 0\r0 0 0\r1 0 0\r0 1 0\r3 0 1 2\r",
    "mark.off": b"\xef\xbb\xbfOFF\n3 1 0\n" + _TRIANGLE + b"3 0 1 2\n",
    "one-line.off": b"OFF 3 1 0\n" + _TRIANGLE + b"3 0 1 2\n",
    "colours.off": b"OFF\n3 1 0\n" + _TRIANGLE + b"3 0 1 2 255 0 0\n",
    "relative.obj": _OBJ + b"f -3 -2 -1\n",
    "slashes.obj": _OBJ + b"f 1//1 2/2 3\n",
    "texture-zero.obj": _OBJ + b"f 1/0 2/0 3/0\n",
    "path.obj": b"mtllib ../../../../etc/passwd\nusemtl x\n" + _OBJ + b"f 1 2 3\n",
    "path.ply": _ply(b"3", b"1", first=b"comment TextureFile ../../../etc/passwd\n")
    + _TRIANGLE
    + b"3 0 1 2\n",
}


def _read(path, content):
    """Read a file, hold time and memory to account, and return the mesh or the error."""
    path.write_bytes(content)
    tracemalloc.start()
    started = time.process_time()  # of this process, whatever else the machine does
    try:
        return read_mesh(path)
    except MeshError as error:
        return error
    finally:
        seconds, peak = time.process_time() - started, tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert seconds < 5  # a second on a quiet machine
        assert peak < 100 * len(content) + 3e7


@pytest.fixture(autouse=True, scope="module")
def _reader():
    """Import the reader before time counts."""
    assert trimesh


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_an_error_of_our_own(tmp_path, name):
    error = _read(tmp_path / name, HOSTILE[name])
    assert isinstance(error, MeshError)
    assert name.split(".")[0] in str(error)


@pytest.mark.parametrize("name", UNUSUAL)
def test_an_unusual_file_is_read(tmp_path, name):
    mesh = _read(tmp_path / name, UNUSUAL[name])
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2]])


_NUMBERS = (
    b"-1",
    b"0",
    b"999999999999",
    b"1e400",
    b"nan",
    b"inf",
    b"0x10",
    b"4294967296",
    b"",
    b"1.5",
    b"\xff\xfe",
)
_ENCODINGS = ("utf-16", "utf-8-sig", "utf-32")


def _mutated(content, rng):
    """Return a file that was truncated, overwritten, spliced, recoded, or had counts changed."""
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(content) + 1)
        end = min(len(content), at + rng.randint(1, 300))
        kind = rng.randrange(7)
        if kind == 0:
            content = content[:at]
        elif kind == 1:
            content = (
                content[:at] + bytes(rng.randrange(256) for _ in range(end - at)) + content[end:]
            )
        elif kind == 2:
            content = content[:at] + bytes(rng.randrange(256) for _ in range(20)) + content[at:]
        elif kind == 3:
            words = content[:400].split(b" ")
            words[rng.randrange(len(words))] = rng.choice(_NUMBERS)
            content = b" ".join(words) + content[400:]
        elif kind == 4:
            content = content[:at] + content[end:]
        elif kind == 5:
            content = content[:end] + content[at:]
        else:
            content = content.decode("latin1").encode(rng.choice(_ENCODINGS))
    return content


def _seed_files():
    sphere = make_sphere(n_subdivisions=2)
    sound = trimesh.Trimesh(sphere.vertices, sphere.faces, process=False)
    kinds = {
        "off": [{}],
        "obj": [{}],
        "ply": [{"encoding": "binary"}, {"encoding": "ascii"}],
        "stl": [{}],
        "stl_ascii": [{}],
    }
    for kind, options in kinds.items():
        for option in options:
            content = sound.export(file_type=kind, **option)
            yield (
                kind.removesuffix("_ascii"),
                content if isinstance(content, bytes) else content.encode(),
            )


# SKFMAP_FUZZ=3000 for fifty times as many.
_N_MUTATIONS = int(os.environ.get("SKFMAP_FUZZ", "60"))


@pytest.mark.filterwarnings("ignore:.*cross themselves:skfmap.exceptions.RepairWarning")
@pytest.mark.parametrize(("suffix", "content"), list(_seed_files()))
def test_mutated_files_are_meshes_or_errors_of_our_own(tmp_path, suffix, content):
    rng = random.Random(content[:200])
    for _ in range(_N_MUTATIONS):
        outcome = _read(tmp_path / f"fuzz.{suffix}", _mutated(content, rng))
        assert isinstance(outcome, (Mesh, MeshError))


def _npy(values, head=None):
    buffer = io.BytesIO()
    np.save(buffer, values, allow_pickle=True)
    content = buffer.getvalue()
    if head is None:
        return content
    return content[:8] + len(head).to_bytes(2, "little") + head + content[10 + len(head) :]


_N_VERTICES = 42
_LISTED = np.arange(_N_VERTICES)


def _archive():
    buffer = io.BytesIO()
    np.savez(buffer, a=_LISTED)
    return buffer.getvalue()


HOSTILE_TRUTHS = {
    "f.vts": b"0\n1\n",
    "f.vertices.txt": b"1e300\n" * _N_VERTICES,
    "f.template.txt": b"1e300\n1\n",
    "f.txt": b"0 0\n1 18446744073709551615\n",
    "f.vertices.npy": _npy(np.full(_N_VERTICES, 2**64 - 1, dtype=np.uint64)),
    "f.template.npy": _npy(np.array([print], dtype=object)),
    "f.npy": _archive(),
    "big/f.npy": _npy(
        _LISTED, b"{'descr': '<i8', 'fortran_order': False, 'shape': (1000000000000,)}"
    ),
    "deep/f.npy": _npy(_LISTED, b"(" * 5000),
    "minus/f.npy": _npy(_LISTED, b"{'descr': '<i8', 'fortran_order': False, 'shape': (-3,)}"),
    "structured/f.npy": _npy(np.zeros(3, dtype=[("a", "<i8"), ("b", "<i8")])),
    "complex/f.npy": _npy(np.zeros((3, 2), dtype=complex)),
    "times/f.npy": _npy(np.zeros((3, 2), dtype="M8[s]")),
    "words/f.txt": b"one two\n",
    "ragged/f.txt": b"1 2\n3\n",
    "negative/f.vts": b"-1\n",
    "code/f.txt": b"__import__('os').system('true') 1\n",
}


def _read_truth(folder, name, content):
    folder.mkdir(exist_ok=True, parents=True)
    (folder / name).write_bytes(content)
    started = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            (outcome,) = load_collection(folder).correspondences
    except CorrespondenceError as error:
        outcome = error
    assert isinstance(outcome, Correspondence) or name in str(outcome)
    assert time.process_time() - started < 5
    return outcome


def _mesh_in(folder):
    folder.mkdir(exist_ok=True, parents=True)
    write_mesh(make_sphere(n_subdivisions=1), folder / "f.off")


@pytest.mark.parametrize("name", HOSTILE_TRUTHS)
def test_hostile_correspondences_are_errors_of_our_own(tmp_path, name):
    folder = (tmp_path / name).parent
    _mesh_in(folder)
    assert isinstance(
        _read_truth(folder, (tmp_path / name).name, HOSTILE_TRUTHS[name]), CorrespondenceError
    )


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("f.vts", b"\n".join(b"%d" % (i + 1) for i in range(30))),
        ("f.vertices.txt", b"\n".join(b"%d" % i for i in range(_N_VERTICES))),
        ("f.txt", b"\n".join(b"%d %d" % (i, 2 * i) for i in range(30))),
        ("f.template.npy", _npy(_LISTED[::-1])),
        ("f.npy", _npy(np.column_stack([_LISTED, _LISTED]).astype(np.int32))),
    ],
)
def test_mutated_correspondences_fit_the_mesh_or_are_errors(tmp_path, name, content):
    _mesh_in(tmp_path)
    rng = random.Random(content)
    for _ in range(_N_MUTATIONS):
        outcome = _read_truth(tmp_path, name, _mutated(content, rng))
        if isinstance(outcome, Correspondence):
            assert outcome.pairs.min(initial=0) >= 0
            assert outcome.pairs[:, 0].max(initial=0) < _N_VERTICES
        else:
            assert isinstance(outcome, CorrespondenceError)


_NAMING_ANOTHER = {
    "f.obj": b"mtllib secret.mtl\nusemtl x\n" + _OBJ + b"f 1 2 3\n",
    "f.ply": _ply(b"3", b"1", first=b"comment TextureFile secret.mtl\n") + _TRIANGLE + b"3 0 1 2\n",
}


def test_no_path_is_taken_from_a_file(tmp_path):
    """Meshes may name another file, which can be a pipe: whoever opens it waits for ever."""
    os.mkfifo(tmp_path / "secret.mtl")
    for name, content in _NAMING_ANOTHER.items():
        (tmp_path / name).write_bytes(content)
    names = list(_NAMING_ANOTHER)
    code = f"from skfmap.io import read_mesh; print(*(read_mesh(name).n_faces for name in {names}))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
        cwd=tmp_path,
    )
    assert done.stdout == "1 1\n"


def test_the_reader_says_nothing_on_the_side(tmp_path):
    """Trimesh logs tracebacks where nobody listens."""
    path = tmp_path / "f.stl"
    path.write_bytes(HOSTILE["solid.stl"])
    code = (
        "from skfmap.io import read_mesh\n"
        f"try:\n    read_mesh({str(path)!r})\nexcept ValueError:\n    pass"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")
