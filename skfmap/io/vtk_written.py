"""Writing of surfaces with arrays at their vertices for ParaView: ``.vtp`` and ``.vtk``."""

import base64
from collections.abc import Mapping
from xml.sax.saxutils import quoteattr

import numpy as np

from skfmap._tools.types import Array, FloatArray, IntArray

__all__ = ["vtk_of", "vtp_of"]

_XML_TYPES = {"f8": "Float64", "f4": "Float32", "i8": "Int64", "i4": "Int32", "u1": "UInt8"}
_LEGACY_TYPES = {"f8": "double", "f4": "float", "i8": "vtktypeint64", "i4": "int"}
_LEGACY_TYPES["u1"] = "unsigned_char"


def vtp_of(vertices: FloatArray, faces: IntArray, arrays: Mapping[str, Array]) -> bytes:
    """Return the content of a .vtp file.

    Parameters
    ----------
    vertices : ndarray of shape (n_vertices, 3)
        Coordinates.
    faces : ndarray of int, shape (n_faces, 3)
        Triangles.
    arrays : dict of ndarray of shape (n_vertices,) or (n_vertices, n_columns)
        Arrays at the vertices, by name.

    Returns
    -------
    bytes
        Content of the file.
    """
    n, m = len(vertices), len(faces)
    ends = 3 * np.arange(1, m + 1)
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f'<PolyData><Piece NumberOfPoints="{n}" NumberOfPolys="{m}">',
        "<PointData>",
        *(_data_array(name, values) for name, values in arrays.items()),
        "</PointData>",
        f"<Points>{_data_array('Points', vertices)}</Points>",
        f"<Polys>{_data_array('connectivity', faces.ravel())}",
        f"{_data_array('offsets', ends)}</Polys>",
        "</Piece></PolyData></VTKFile>",
    ]
    return "\n".join(lines).encode()


def _data_array(name: str, values: Array) -> str:
    """Return an array as base64, preceded by its number of bytes."""
    kind = _kind(values)
    content = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
    head = np.array([len(content)], dtype="<u8").tobytes()
    text = base64.b64encode(head + content).decode()
    columns = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    return (
        f'<DataArray type="{_XML_TYPES[kind]}" Name={quoteattr(name)}{columns} format="binary">'
        f"{text}</DataArray>"
    )


def vtk_of(vertices: FloatArray, faces: IntArray, arrays: Mapping[str, Array]) -> bytes:
    """Return the content of a binary legacy .vtk file.

    The parameters are those of `vtp_of`. Blanks in names of arrays become underscores.
    """
    n, m = len(vertices), len(faces)
    cells = np.column_stack([np.full(m, 3), faces])
    parts = [
        b"# vtk DataFile Version 3.0\nwritten by skfmap\nBINARY\nDATASET POLYDATA\n",
        f"POINTS {n} double\n".encode() + _big_endian(vertices, "f8"),
        f"POLYGONS {m} {cells.size}\n".encode() + _big_endian(cells, "i4"),
    ]
    if arrays:
        parts.append(f"POINT_DATA {n}\nFIELD arrays {len(arrays)}\n".encode())
    for name, values in arrays.items():
        kind = _kind(values)
        columns = values.shape[1] if values.ndim == 2 else 1
        head = f"{'_'.join(name.split())} {columns} {n} {_LEGACY_TYPES[kind]}\n"
        parts.append(head.encode() + _big_endian(values, kind))
    return b"".join(parts)


def _big_endian(values: Array, kind: str) -> bytes:
    return np.ascontiguousarray(values, dtype=f">{kind}").tobytes() + b"\n"


def _kind(values: Array) -> str:
    """Return the type in which numbers are written: integers other than bytes have 64 bits."""
    if values.dtype == np.uint8:
        return "u1"
    return "i8" if values.dtype.kind in "iub" else "f8"
