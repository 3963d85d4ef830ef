"""VTK surfaces (ParaView, 3D Slicer): legacy .vtk files of type POLYDATA, and .vtp files."""

import base64
import re
import zlib
from collections.abc import Iterator
from xml.parsers import expat

import numpy as np

from skfmap._tools.types import Array, FloatArray, IntArray
from skfmap.exceptions import MeshError
from skfmap.io.numbers import Polygons, numbers_of, strips_as_polygons, whole

__all__ = ["read_vtk", "read_vtp"]

_LEGACY_TYPES = {
    "unsigned_char": "u1", "char": "i1", "unsigned_short": "u2", "short": "i2",
    "unsigned_int": "u4", "int": "i4", "unsigned_long": "u8", "long": "i8",
    "vtkidtype": "i8", "vtktypeint64": "i8", "float": "f4", "double": "f8",
}  # fmt: skip
_TYPES = {
    **{f"{sign}Int{8 * n}": f"{kind}{n}" for sign, kind in (("", "i"), ("U", "u"))
       for n in (1, 2, 4, 8)},
    "Float32": "f4", "Float64": "f8",
}  # fmt: skip
_ADVICE = "Save its surface as PLY: in ParaView, Extract Surface, then Save Data."


def read_vtk(content: bytes) -> tuple[FloatArray, Polygons]:
    """Return the points and polygons of a legacy VTK file; triangle strips become triangles.

    Raises
    ------
    MeshError
        If the content cannot be read. The message continues a sentence that begins with the path.
    """
    if not content.startswith(b"# vtk DataFile"):
        raise MeshError("is not a legacy VTK file: it does not begin with '# vtk DataFile'.")
    if len(head := content.split(b"\n", 4)) < 4:
        raise MeshError("ends within its header: the file is truncated.")
    kind = head[2].strip().upper()
    at = sum(len(line) + 1 for line in head[:3])
    reader = _Legacy(content, at, binary=kind == b"BINARY")
    dataset = reader.words()
    if [word.upper() for word in dataset] != ["DATASET", "POLYDATA"]:
        said = " ".join(dataset[1:]) or "nothing"
        raise MeshError(f"contains {said}, not the POLYDATA of a surface. {_ADVICE}")
    points: FloatArray | None = None
    polygons: list[Polygons] = []
    while words := reader.words():
        word = words[0].upper()
        if word in ("POINT_DATA", "CELL_DATA"):
            break
        if word == "POINTS":
            points = reader.values(3 * int(words[1]), words[2]).reshape(-1, 3).astype(np.float64)
        elif word in ("POLYGONS", "TRIANGLE_STRIPS", "LINES", "VERTICES"):
            cells = reader.cells(int(words[1]), int(words[2]))
            if word == "POLYGONS":
                polygons.append(cells)
            elif word == "TRIANGLE_STRIPS":
                polygons.append(strips_as_polygons(cells))
        elif word == "FIELD":
            reader.skip_field(int(words[2]))
        elif word != "METADATA":
            raise MeshError(f"has {words[0]!r} where points or polygons should be. {_ADVICE}")
        else:
            reader.skip_metadata()
    return _surface(points, polygons)


class _Legacy:
    """Reader that moves through the content of a legacy file."""

    def __init__(self, content: bytes, at: int, *, binary: bool) -> None:
        self.content, self.at, self.binary = content, at, binary

    def _line(self) -> bytes:
        end = self.content.find(b"\n", self.at) + 1 or len(self.content)
        line, self.at = self.content[self.at : end], end
        return line

    def words(self) -> list[str]:
        """Return the words of the next non-blank line; an empty list at the end."""
        while self.at < len(self.content):
            if words := self._line().decode("latin-1").split():
                return words
        return []

    def values(self, n: int, kind: str) -> Array:
        """Return the next n numbers."""
        if kind.lower() not in _LEGACY_TYPES:
            raise MeshError(f"contains numbers of type {kind!r}, which is not supported. {_ADVICE}")
        if self.binary:
            dtype = np.dtype(">" + _LEGACY_TYPES[kind.lower()])
            if self.at + n * dtype.itemsize > len(self.content):
                raise MeshError("is shorter than it declares: the file is truncated.")
            out = np.frombuffer(self.content, dtype, n, self.at)
            self.at += n * dtype.itemsize
            return out
        words: list[bytes] = []
        while len(words) < n and self.at < len(self.content):
            words += self._line().split()
        if len(words) != n:
            raise MeshError(
                f"declares {n} numbers, but {len(words)} follow: it is truncated or damaged."
            )
        return numbers_of(words, "a number")

    def cells(self, n: int, size: int) -> Polygons:
        """Return cells, stored as counts before their corners or, since version 5, as offsets."""
        place = self.at
        words = self.words()
        if words[:1] == ["OFFSETS"]:
            offsets = whole(self.values(n, words[1]).astype(np.float64), "a face")
            kind = self.words()[1]
            return Polygons(
                whole(self.values(size, kind).astype(np.float64), "a face"), np.diff(offsets)
            )
        self.at = place
        table = whole(self.values(size, "int").astype(np.float64), "a face")
        return _without_counts(table, n)

    def skip_field(self, n_arrays: int) -> None:
        for _ in range(n_arrays):
            words = self.words()
            self.values(int(words[1]) * int(words[2]), words[3])

    def skip_metadata(self) -> None:
        """Skip lines up to and including the next empty one."""
        while self.at < len(self.content) and self._line().strip():
            pass


def _without_counts(table: IntArray, n: int) -> Polygons:
    counts, at = [], 0
    kept = np.ones(len(table), dtype=bool)
    for _ in range(n):
        if at >= len(table):
            break
        counts.append(int(table[at]))
        kept[at] = False
        at += 1 + counts[-1]
    if len(counts) < n or at != len(table) or min(counts, default=0) < 0:
        raise MeshError("has faces whose numbers of corners do not add up: the file is damaged.")
    return Polygons(table[kept], np.array(counts, dtype=np.int64))


def read_vtp(content: bytes) -> tuple[FloatArray, Polygons]:
    """Return the points and polygons of a .vtp file, in text or binary form, or with zlib.

    Raises
    ------
    MeshError
        If the content cannot be read. The message continues a sentence that begins with the path.
    """
    content, appended, raw = _without_appended(content)
    arrays = _Arrays(appended, raw)
    arrays.parse(content)
    points: list[FloatArray] = []
    polygons: list[Polygons] = []
    n_points = 0
    for piece in arrays.pieces:
        if ("Points", "") not in piece:
            continue
        own = np.asarray(piece["Points", ""], dtype=np.float64).reshape(-1, 3)
        for section in ("Polys", "Strips"):
            if (section, "connectivity") in piece and (section, "offsets") in piece:
                ends = whole(np.asarray(piece[section, "offsets"], dtype=np.float64), "a face")
                corners = np.asarray(piece[section, "connectivity"], dtype=np.float64)
                cells = Polygons(whole(corners, "a face") + n_points, np.diff(ends, prepend=0))
                if (cells.counts < 0).any() or cells.counts.sum() != len(cells.corners):
                    raise MeshError("has faces whose offsets do not add up: the file is damaged.")
                polygons.append(cells if section == "Polys" else strips_as_polygons(cells))
        points.append(own)
        n_points += len(own)
    return _surface(np.concatenate(points) if points else None, polygons)


def _surface(points: FloatArray | None, polygons: list[Polygons]) -> tuple[FloatArray, Polygons]:
    if points is None or not len(points):
        raise MeshError(f"contains no points. {_ADVICE}")
    counts = np.concatenate([one.counts for one in polygons]) if polygons else np.empty(0, int)
    if not len(counts):
        raise MeshError(
            f"contains {len(points)} points and no polygons: it has lines, or is a point cloud. "
            f"{_ADVICE}"
        )
    return points, Polygons(np.concatenate([one.corners for one in polygons]), counts)


def _without_appended(content: bytes) -> tuple[bytes, bytes, bool]:
    """Split a file into its XML part and its appended data; return also whether these are raw."""
    found = re.search(rb"<AppendedData[^>]*encoding\s*=\s*[\"'](\w+)[\"'][^>]*>\s*_", content)
    if found is None:
        return content, b"", False
    end = content.rfind(b"</AppendedData>")
    end = end if end >= found.end() else len(content)
    return (
        content[: found.end() - 1] + content[end:],
        content[found.end() : end],
        found[1] == b"raw",
    )


class _Arrays:
    """The arrays of each piece, by section and name."""

    def __init__(self, appended: bytes, raw: bool) -> None:
        self.appended, self.raw = appended, raw
        self.pieces: list[dict[tuple[str, str], Array]] = []
        self._section = ""
        self._array: dict[str, str] | None = None
        self._text: list[str] = []
        self._nested = 0  # depth of tags within the array, which describe it
        self._order, self._header, self._compressed = "<", "u4", False

    def parse(self, content: bytes) -> None:
        parser = expat.ParserCreate()
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text_of_array
        parser.EntityDeclHandler = _no_entities
        try:
            parser.Parse(content, True)
        except expat.ExpatError as error:
            raise MeshError(
                f"is not a complete XML file ({error}): it is truncated or damaged."
            ) from None

    def _text_of_array(self, text: str) -> None:
        if self._array is not None and not self._nested:
            self._text.append(text)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if self._array is not None:
            self._nested += 1
        elif tag == "VTKFile":
            if attributes.get("type") != "PolyData":
                raise MeshError(f"contains {attributes.get('type')}, not PolyData. {_ADVICE}")
            self._order = ">" if attributes.get("byte_order") == "BigEndian" else "<"
            self._header = _TYPES.get(attributes.get("header_type", "UInt32"), "u4")
            compressor = attributes.get("compressor", "")
            if compressor not in ("", "vtkZLibDataCompressor"):
                raise MeshError(f"is compressed by {compressor}; use ZLib or none. {_ADVICE}")
            self._compressed = bool(compressor)
        elif tag == "Piece":
            self.pieces.append({})
        elif tag in ("Points", "Polys", "Strips", "Lines", "Verts", "PointData", "CellData"):
            self._section = tag
        elif tag == "DataArray":
            self._array = attributes
            self._text.clear()

    def _end(self, tag: str) -> None:
        if self._nested:
            self._nested -= 1
            return
        if tag != "DataArray" or self._array is None or not self.pieces:
            return
        if self._section in ("Points", "Polys", "Strips"):
            name = "" if self._section == "Points" else self._array.get("Name", "")
            self.pieces[-1][self._section, name] = self._values(self._array, "".join(self._text))
        self._array = None

    def _values(self, array: dict[str, str], text: str) -> Array:
        kind = _TYPES.get(array.get("type", ""))
        if kind is None:
            raise MeshError(
                f"contains numbers of type {array.get('type')!r}, which is not supported."
            )
        form = array.get("format", "ascii")
        if form == "ascii":
            return numbers_of(text.encode().split(), "a number")
        if form == "appended":
            data = self.appended[int(array.get("offset", "0")) :]
            return np.frombuffer(self._bytes(data, self.raw), self._order + kind)
        return np.frombuffer(self._bytes(text.strip().encode(), False), self._order + kind)

    def _bytes(self, data: bytes, raw: bool) -> bytes:
        """Return the content of a block of data, which begins with its size or those of parts."""
        size = np.dtype(self._order + self._header)
        try:
            if not self._compressed:
                n = int(np.frombuffer(_head(data, size.itemsize, raw), size)[0])
                body = _head(data, size.itemsize + n, raw)[size.itemsize :]
                whole_block = body
            else:
                n_blocks = int(np.frombuffer(_head(data, size.itemsize, raw), size)[0])
                n_head = (3 + n_blocks) * size.itemsize
                sizes = np.frombuffer(_head(data, n_head, raw), size)[3:].astype(np.int64)
                skipped = n_head if raw else 4 * -(-n_head // 3)
                packed = _head(data[skipped:], int(sizes.sum()), raw)
                whole_block = b"".join(_unpacked(packed, sizes))
                n = len(whole_block)
        except (ValueError, IndexError, zlib.error):
            raise MeshError(
                "contains data that cannot be unpacked: it is truncated or damaged."
            ) from None
        if len(whole_block) != n:
            raise MeshError("is shorter than it declares: the file is truncated.")
        return whole_block


def _head(data: bytes, n: int, raw: bool) -> bytes:
    """Return the first n bytes of a block, or fewer if it is shorter."""
    if raw:
        return data[:n]
    return base64.b64decode(data[: 4 * -(-n // 3)])[:n]


def _unpacked(packed: bytes, sizes: IntArray) -> Iterator[bytes]:
    at = 0
    for n in sizes.tolist():
        yield zlib.decompress(packed[at : at + n])
        at += n


def _no_entities(*_: object) -> None:
    raise MeshError("declares XML entities, which VTK files never do.")
