"""Surfaces of FreeSurfer and GIFTI."""

import base64
import zlib

import numpy as np
import pytest

from skfmap.datasets import make_sphere
from skfmap.exceptions import MeshError
from skfmap.io import read_mesh

BALL = make_sphere(n_subdivisions=1)
_POINTS, _FACES = "NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE"


def _freesurfer(head=b"created by us on Monday\n\n", n=None, m=None, footer=b""):
    counts = [BALL.n_vertices if n is None else n, BALL.n_faces if m is None else m]
    numbers = [np.array(counts, ">i4"), BALL.vertices.astype(">f4"), BALL.faces.astype(">i4")]
    return b"\xff\xff\xfe" + head + b"".join(one.tobytes() for one in numbers) + footer


def _array(intent, values, kind, encoding, *, order="<", columns=False, dims=None):
    rows = values.T if columns else values
    if encoding == "ASCII":
        data = " ".join(map(repr, rows.ravel().tolist()))
    else:
        raw = np.ascontiguousarray(rows, dtype=order + kind).tobytes()
        raw = zlib.compress(raw) if encoding == "GZipBase64Binary" else raw
        data = base64.b64encode(raw).decode()
    names = {"f4": "NIFTI_TYPE_FLOAT32", "i4": "NIFTI_TYPE_INT32"}
    n, k = dims or values.shape
    return (
        f'<DataArray Intent="{intent}" DataType="{names[kind]}" Dimensionality="2" Dim0="{n}" '
        f'Dim1="{k}" Encoding="{encoding}" ArrayIndexingOrder="{"Column" if columns else "Row"}'
        f'MajorOrder" Endian="{"Little" if order == "<" else "Big"}Endian" ExternalFileName="">'
        f"<MetaData/><CoordinateSystemTransformMatrix><MatrixData>1 0 0</MatrixData>"
        f"</CoordinateSystemTransformMatrix><Data>{data}</Data></DataArray>"
    )


def _gifti(*arrays):
    head = '<?xml version="1.0" encoding="UTF-8"?><!DOCTYPE GIFTI SYSTEM "http://x.org/gifti.dtd">'
    return f'{head}<GIFTI Version="1.0">{"".join(arrays)}</GIFTI>'.encode()


def _surface(encoding="Base64Binary", **how):
    points = _array(_POINTS, BALL.vertices, "f4", encoding, **how)
    return [points, _array(_FACES, BALL.faces, "i4", encoding, **how)]


def _write(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("head", [b"created by us on Monday\n\n", b"one line alone\n"])
@pytest.mark.parametrize("footer", [b"", b"\0\0\0\x14valid = 1"])
def test_freesurfer_surfaces_keep_their_vertices(tmp_path, head, footer):
    mesh = read_mesh(_write(tmp_path, "lh.pial", _freesurfer(head, footer=footer)))
    np.testing.assert_array_equal(mesh.vertices, BALL.vertices.astype(np.float32))
    np.testing.assert_array_equal(mesh.faces, BALL.faces)
    assert mesh.name == "lh"


@pytest.mark.parametrize("encoding", ["ASCII", "Base64Binary", "GZipBase64Binary"])
@pytest.mark.parametrize("how", [{}, {"order": ">"}, {"columns": True}])
def test_gifti_surfaces_keep_their_vertices(tmp_path, encoding, how):
    mesh = read_mesh(_write(tmp_path, "lh.surf.gii", _gifti(*_surface(encoding, **how))))
    np.testing.assert_allclose(mesh.vertices, BALL.vertices, atol=1e-7)
    np.testing.assert_array_equal(mesh.faces, BALL.faces)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (_freesurfer()[:-400], "too short to hold"),
        (_freesurfer(n=-1), "too short to hold"),
        (_freesurfer()[:20], "within its header"),
        (b"\xff\xff\xff" + bytes(50), "quadrangles.*mris_convert"),
        (b"text", "its first bytes are different"),
        (_freesurfer(m=0), "no faces"),
    ],
)
def test_what_is_no_freesurfer_surface_is_refused(tmp_path, content, message):
    with pytest.raises(MeshError, match=message):
        read_mesh(_write(tmp_path, "lh.white", content))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (_gifti(_array("NIFTI_INTENT_SHAPE", BALL.vertices, "f4", "ASCII")), "INTENT_SHAPE.*surf"),
        (_gifti(*_surface(), *_surface()), "several surfaces"),
        (_gifti(*_surface("ExternalFileBinary")), "in another file"),
        (_gifti(*_surface(dims=(7, 3))), "declares 7 rows of 3"),
        (_gifti(*_surface())[:-200], "not a complete XML"),
        (_gifti(*_surface()).replace(b"FLOAT32", b"COMPLEX"), "COMPLEX"),
        (_gifti(*_surface()).replace(b"Base64Binary", b"GZipBase64Binary"), "unpacked"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]><GIFTI>&b;</GIFTI>', "XML entities"),
    ],
)
def test_what_is_no_gifti_surface_is_refused(tmp_path, content, message):
    with pytest.raises(MeshError, match=message):
        read_mesh(_write(tmp_path, "lh.surf.gii", content))


def test_files_are_read_as_nibabel_writes_them(tmp_path):
    nibabel = pytest.importorskip("nibabel")
    nibabel.freesurfer.write_geometry(tmp_path / "lh.white", BALL.vertices, BALL.faces)
    arrays = [
        nibabel.gifti.GiftiDataArray(BALL.vertices.astype("f4"), intent=_POINTS),
        nibabel.gifti.GiftiDataArray(BALL.faces.astype("i4"), intent=_FACES),
    ]
    nibabel.save(nibabel.gifti.GiftiImage(darrays=arrays), tmp_path / "rh.surf.gii")
    for name in ("lh.white", "rh.surf.gii"):
        mesh = read_mesh(tmp_path / name)
        np.testing.assert_allclose(mesh.vertices, BALL.vertices, atol=1e-7)
        np.testing.assert_array_equal(mesh.faces, BALL.faces)
