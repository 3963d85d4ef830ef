"""Brain surfaces: triangle files of FreeSurfer, and GIFTI (.gii)."""

import base64
import zlib
from typing import Any
from xml.parsers import expat

import numpy as np

from skfmap._tools.types import Array, FloatArray, IntArray
from skfmap.exceptions import MeshError
from skfmap.io.numbers import Polygons, numbers_of, whole

__all__ = ["FREESURFER_SUFFIXES", "read_freesurfer", "read_gifti"]

FREESURFER_SUFFIXES = (".inflated", ".pial", ".smoothwm", ".sphere", ".white")
"""Suffixes of FreeSurfer surfaces, except ``.orig``, which is also used for backup copies."""

_TRIANGLES, _QUADRANGLES = b"\xff\xff\xfe", (b"\xff\xff\xff", b"\xff\xff\xfd")
_TYPES = {"NIFTI_TYPE_UINT8": "u1", "NIFTI_TYPE_INT32": "i4", "NIFTI_TYPE_UINT32": "u4"}
_TYPES |= {"NIFTI_TYPE_FLOAT32": "f4", "NIFTI_TYPE_FLOAT64": "f8", "NIFTI_TYPE_INT64": "i8"}
_POINTS, _FACES = "NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE"


def read_freesurfer(content: bytes) -> tuple[FloatArray, Polygons]:
    """Return the vertices and faces of a FreeSurfer surface, in its surface coordinates.

    Raises
    ------
    MeshError
        If the content cannot be read. The message continues a sentence that begins with the path.
    """
    if content[:3] in _QUADRANGLES:
        raise MeshError(
            "is in FreeSurfer's old format for quadrangles. Convert it to triangles with "
            "FreeSurfer's mris_convert."
        )
    if content[:3] != _TRIANGLES:
        raise MeshError(
            "is not a FreeSurfer surface: its first bytes are different. Curvatures and labels "
            "(.curv, .thickness, .label) are not surfaces."
        )
    at = content.find(b"\n", 3) + 1  # after the line that names the author
    at += content[at : at + 1] == b"\n"
    if at < 4 or len(content) < at + 8:
        raise MeshError("ends within its header: the file is truncated.")
    n, m = np.frombuffer(content, ">i4", 2, at).tolist()
    at += 8
    if n < 0 or m < 0 or len(content) < at + 12 * (n + m):
        raise MeshError(
            f"declares {n} vertices and {m} faces, but is too short to hold them: the file is "
            "truncated or damaged."
        )
    vertices = np.frombuffer(content, ">f4", 3 * n, at).reshape(-1, 3).astype(np.float64)
    corners = np.frombuffer(content, ">i4", 3 * m, at + 12 * n).astype(np.int64)
    return vertices, _triangles(vertices, corners)


def read_gifti(content: bytes) -> tuple[FloatArray, Polygons]:
    """Return the vertices and faces of a GIFTI file, in the stored coordinates.

    Raises
    ------
    MeshError
        If the file does not contain exactly one surface. The message continues a sentence that
        begins with the path.
    """
    arrays = _Arrays()
    arrays.parse(content)
    points, faces = arrays.of(_POINTS), arrays.of(_FACES)
    if not points or not faces:
        said = ", ".join(dict.fromkeys(intent for intent, _ in arrays.found)) or "nothing"
        raise MeshError(
            f"contains no surface of points and triangles, but {said}: data on a surface, whose "
            "mesh is in another file (.surf.gii)."
        )
    if len(points) > 1 or len(faces) > 1:
        raise MeshError("contains several surfaces. Save each in its own file.")
    vertices = points[0].astype(np.float64)
    corners = whole(faces[0].astype(np.float64).ravel(), "a face")
    return vertices, _triangles(vertices, corners)


def _triangles(vertices: FloatArray, corners: IntArray) -> Polygons:
    if not len(corners):
        raise MeshError(f"contains {len(vertices)} vertices and no faces. Leave it out.")
    return Polygons(corners, np.full(len(corners) // 3, 3))


class _Arrays:
    """The arrays of a GIFTI file, each with its intent."""

    def __init__(self) -> None:
        self.found: list[tuple[str, Array]] = []
        self._array: dict[str, str] = {}
        self._text: list[str] | None = None

    def of(self, intent: str) -> list[Array]:
        return [values for name, values in self.found if name == intent]

    def parse(self, content: bytes) -> None:
        parser = expat.ParserCreate()
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._data
        parser.EntityDeclHandler = _no_entities
        try:
            parser.Parse(content, True)
        except expat.ExpatError as error:
            raise MeshError(
                f"is not a complete XML file ({error}): it is truncated or damaged."
            ) from None

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if tag == "DataArray":
            self._array = attributes
        elif tag == "Data":
            self._text = []

    def _data(self, text: str) -> None:
        if self._text is not None:
            self._text.append(text)

    def _end(self, tag: str) -> None:
        if tag != "Data" or self._text is None:
            return
        intent = self._array.get("Intent", "")
        if intent in (_POINTS, _FACES):
            self.found.append((intent, _values(self._array, "".join(self._text))))
        else:
            self.found.append((intent, np.empty(0)))
        self._text = None


def _values(array: dict[str, str], text: str) -> Array:
    """Return the values of an array with three columns."""
    encoding, kind = array.get("Encoding", ""), _TYPES.get(array.get("DataType", ""))
    if encoding == "ExternalFileBinary":
        raise MeshError("keeps its numbers in another file. Save it with embedded data.")
    if kind is None:
        raise MeshError(
            f"contains numbers of type {array.get('DataType')!r}, which is not supported."
        )
    if encoding == "ASCII":
        values: Array = numbers_of(text.encode().split(), "a number")
    else:
        try:
            body = base64.b64decode(text, validate=False)
            body = zlib.decompress(body) if encoding == "GZipBase64Binary" else body
        except (ValueError, zlib.error):
            raise MeshError(
                "contains data that cannot be unpacked: it is truncated or damaged."
            ) from None
        order = ">" if array.get("Endian") == "BigEndian" else "<"
        if len(body) % np.dtype(kind).itemsize:
            raise MeshError("contains data that end within a number: it is truncated or damaged.")
        values = np.frombuffer(body, order + kind)
    shape = (_count(array, "Dim0"), _count(array, "Dim1"))
    if shape[1] != 3 or shape[0] * 3 != values.size:
        raise MeshError(
            f"declares {shape[0]} rows of {shape[1]} numbers, but contains {values.size} numbers: "
            "it is truncated or damaged."
        )
    columns = array.get("ArrayIndexingOrder") == "ColumnMajorOrder"
    return values.reshape(shape, order="F" if columns else "C")


def _count(array: dict[str, str], name: str) -> int:
    said = array.get(name, "")
    return int(said) if said.isdecimal() and len(said) < 12 else -1


def _no_entities(*_: Any) -> None:
    raise MeshError("declares XML entities, which GIFTI files never do.")
