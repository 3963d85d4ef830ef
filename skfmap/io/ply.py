"""PLY files: vertices, polygons and triangle strips, in text and binary form."""

import re
from typing import NamedTuple

import numpy as np

from skfmap._tools.types import Array, FloatArray, IntArray
from skfmap.exceptions import MeshError
from skfmap.io.numbers import Polygons, as_text, strips_as_polygons, table_of_lines, whole

__all__ = ["read_ply"]

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "int64": "i8", "uint64": "u8",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_INDICES = ("vertex_indices", "vertex_index")
_SHOWN = 60  # largest number of characters of a line quoted in a message
_END = re.compile(rb"(?<=\n)end_header[ \t]*\r?\n")
_END_OF_OLD_MAC = re.compile(rb"(?<=\r)end_header[ \t]*\r")


class _Property(NamedTuple):
    name: str
    kind: str
    count_kind: str | None  # type of the length if it is a list


class _Element(NamedTuple):
    name: str
    n: int
    properties: tuple[_Property, ...]


class _List(NamedTuple):
    """The concatenated lists of an element, with their lengths."""

    values: Array
    counts: IntArray


def read_ply(content: bytes) -> tuple[FloatArray, Polygons]:
    """Return the vertices and faces of a PLY file as stored.

    All other properties and elements are ignored, so texture coordinates of corners do not split
    vertices. Triangle strips become triangles.

    Raises
    ------
    MeshError
        If the content cannot be read. The message continues a sentence that begins with the path.
    """
    if not content.startswith(b"ply"):
        content = as_text(content)
    order, elements, body = _header(content)
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise MeshError(f"contains no vertices, only {', '.join(names) or 'nothing'}.")
    read = (_of_text if order == "" else _of_bytes)(body, order, elements)
    vertices = _positions(read["vertex"])
    polygons: list[Polygons] = []
    if "face" in read and (found := _indices(read["face"], "faces")).counts.size:
        polygons.append(Polygons(whole(found.values, "a face"), found.counts))
    if "tristrips" in read:
        strips = _indices(read["tristrips"], "triangle strips")
        corners = whole(strips.values, "a triangle strip")
        polygons.append(strips_as_polygons(Polygons(corners, strips.counts)))
    if polygons:
        corners, counts = (np.concatenate(each) for each in zip(*polygons, strict=True))
        return vertices, Polygons(corners, counts)
    what = (
        "it has range images (range_grid), which are not supported. Save it with faces"
        if "range_grid" in names
        else "it is a point cloud, or truncated"
    )
    raise MeshError(f"contains {len(vertices)} vertices and no faces: {what}.")


def _header(content: bytes) -> tuple[str, list[_Element], bytes]:
    # All lines end as the first one does; data may begin with a byte that looks like a line end.
    old_mac = re.match(rb"ply[ \t]*\r(?!\n)", content)
    end = (_END_OF_OLD_MAC if old_mac else _END).search(content)
    if not re.match(rb"ply[ \t]*[\r\n]", content) or end is None:
        what = (
            "its header has no end" if content.startswith(b"ply") else "it does not begin with ply"
        )
        raise MeshError(f"is not a PLY file: {what}. It is truncated, or in another format.")
    # Comments may be in any encoding; everything else is ASCII. Comments in UTF-16 contain zero
    # bytes, and bytes that look like line breaks.
    lines = re.split(r"\r\n|\n|\r", content[: end.start()].decode("latin-1"))
    order, elements, wide = None, list[_Element](), False
    for line in lines[1:]:
        words = line.strip("\0").split()
        if not words or words[0] in ("comment", "obj_info"):
            wide |= "\0" in line
            continue
        try:
            if words[0] == "format":
                order = _ORDERS[words[1]]
            elif words[0] == "element":
                elements.append(_Element(words[1], int(words[2]), ()))
            elif words[0] == "property":
                last = elements[-1]
                properties = (*last.properties, _property(words))
                elements[-1] = last._replace(properties=properties)
            else:
                raise KeyError
        except (KeyError, IndexError, ValueError):
            if wide and not (line.isascii() and line.isprintable()):
                continue  # the rest of a comment
            raise MeshError(
                f"has an invalid line in its header: {line[:_SHOWN]!r}. The file is damaged."
            ) from None
    if order is None or any(element.n < 0 for element in elements):
        raise MeshError("has an incomplete header. The file is damaged.")
    return order, elements, content[end.end() :]


def _property(words: list[str]) -> _Property:
    if words[1] == "list":
        return _Property(words[4], _TYPES[words[3]], _TYPES[words[2]])
    return _Property(words[2], _TYPES[words[1]], None)


def _of_bytes(body: bytes, order: str, elements: list[_Element]) -> dict[str, dict[str, object]]:
    out, at = {}, 0
    for element in elements:
        out[element.name], at = _records(body, at, order, element)
    return out


def _records(body: bytes, at: int, order: str, element: _Element) -> tuple[dict[str, object], int]:
    """Read the records of an element from offset ``at``; return them and the offset after them."""
    if element.n == 0:
        return {}, at
    # Usually all lists are as long as those of the first record.
    lengths = _lengths_of_first(body, at, order, element)
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    for i, one in enumerate(element.properties):
        if one.count_kind is None:
            fields.append((f"v{i}", order + one.kind))
        else:
            fields += [
                (f"n{i}", order + one.count_kind),
                (f"v{i}", order + one.kind, (lengths[i],)),
            ]
    record = np.dtype(fields)
    if len(body) - at >= element.n * record.itemsize:
        table = np.frombuffer(body, record, element.n, at)
        if all((table[f"n{i}"] == n).all() for i, n in lengths.items()):
            out: dict[str, object] = {
                one.name: table[f"v{i}"]
                if one.count_kind is None
                else _List(table[f"v{i}"].ravel(), np.full(element.n, lengths[i]))
                for i, one in enumerate(element.properties)
            }
            return out, at + element.n * record.itemsize
    elif not lengths:
        raise _truncated(element, (len(body) - at) // max(record.itemsize, 1))
    return _records_one_by_one(body, at, order, element)


def _lengths_of_first(body: bytes, at: int, order: str, element: _Element) -> dict[int, int]:
    lengths = {}
    for i, one in enumerate(element.properties):
        if one.count_kind is not None:
            count = np.dtype(order + one.count_kind)
            if at + count.itemsize > len(body):
                raise _truncated(element, 0)
            lengths[i] = int(np.frombuffer(body, count, 1, at)[0])
            at += count.itemsize
            if lengths[i] < 0:
                raise MeshError(f"has a list of {lengths[i]} entries. The file is damaged.")
        at += lengths.get(i, 1) * np.dtype(one.kind).itemsize
    return lengths if at <= len(body) else dict.fromkeys(lengths, 0)


def _records_one_by_one(
    body: bytes, at: int, order: str, element: _Element
) -> tuple[dict[str, object], int]:
    kinds = [
        (None if one.count_kind is None else np.dtype(order + one.count_kind),
         np.dtype(order + one.kind))
        for one in element.properties
    ]  # fmt: skip
    values: list[list[bytes]] = [[] for _ in kinds]
    counts: list[list[int]] = [[] for _ in kinds]
    signs = [one.count_kind is not None and one.count_kind[0] == "i" for one in element.properties]
    byte_order = "big" if order == ">" else "little"
    for row in range(element.n):
        for i, (count, kind) in enumerate(kinds):
            n = 1
            if count is not None:
                part = body[at : at + count.itemsize]
                n = int.from_bytes(part, byte_order, signed=signs[i])  # type: ignore[arg-type]
                at += count.itemsize
            end = at + n * kind.itemsize
            if n < 0 or end > len(body):
                raise _truncated(element, row)
            values[i].append(body[at:end])
            counts[i].append(n)
            at = end
    out: dict[str, object] = {}
    for i, one in enumerate(element.properties):
        flat = np.frombuffer(b"".join(values[i]), kinds[i][1])
        out[one.name] = flat if one.count_kind is None else _List(flat, np.array(counts[i]))
    return out, at


def _truncated(element: _Element, n_read: int) -> MeshError:
    return MeshError(
        f"declares {element.n} {element.name} records, but contains only {n_read}: the file is "
        "truncated."
    )


def _of_text(body: bytes, order: str, elements: list[_Element]) -> dict[str, dict[str, object]]:  # noqa: ARG001
    lines = [line for line in body.splitlines() if line.strip()]
    out, at = {}, 0
    for element in elements:
        own = lines[at : at + element.n]
        if len(own) < element.n:
            raise _truncated(element, len(own))
        out[element.name] = _of_lines(own, element)
        at += element.n
    if len(lines) > at:
        raise MeshError(
            f"has {len(lines) - at} more lines than its header declares. The header is wrong, or "
            "two files were joined."
        )
    return out


def _of_lines(lines: list[bytes], element: _Element) -> dict[str, object]:
    if not any(one.count_kind for one in element.properties):
        names = [one.name for one in element.properties]
        table = table_of_lines(lines, range(len(names)), f"a {element.name}")
        return dict(zip(names, table.T, strict=True))
    out: dict[str, object] = {}
    rest = [line.split() for line in lines]
    at = np.zeros(len(lines), dtype=np.int64)
    for one in element.properties:
        counts = np.ones(len(lines), dtype=np.int64)
        if one.count_kind is not None:
            said = [_count(words, i) for words, i in zip(rest, at.tolist(), strict=True)]
            counts = np.array(said, dtype=np.int64)
            at += 1
        words = [
            words[i : i + n] for words, i, n in zip(rest, at.tolist(), counts.tolist(), strict=True)
        ]
        for line, n, own in zip(lines, counts.tolist(), words, strict=True):
            if len(own) < n:
                raise MeshError(
                    f"has a truncated {element.name}: {_quoted(line)} declares {n} "
                    f"{'vertices' if one.name in _INDICES else 'entries'}."
                )
        values = _floats(words, lines, element, one)
        at += counts
        out[one.name] = values if one.count_kind is None else _List(values, counts)
    return out


def _count(words: list[bytes], i: int) -> int:
    if i < len(words) and words[i].isdigit():
        return int(words[i])
    raise MeshError(
        f"has a list that does not begin with its length: {_quoted(b' '.join(words))}. The file is "
        "damaged."
    )


def _floats(
    words: list[list[bytes]], lines: list[bytes], element: _Element, one: _Property
) -> FloatArray:
    try:
        values = np.array([float(word) for own in words for word in own])
    except ValueError:
        values = np.array([np.nan])
    if one.name in _INDICES and not (values == np.round(values)).all():
        for line, own in zip(lines, words, strict=True):
            if not all(word.lstrip(b"+-").isdigit() for word in own):
                raise MeshError(
                    f"has a {element.name} whose vertices are not integers: {_quoted(line)}."
                )
    return values


def _quoted(line: bytes) -> str:
    return repr(line.decode("latin-1").strip()[:_SHOWN])


def _positions(vertex: dict[str, object]) -> FloatArray:
    if missing := [axis for axis in "xyz" if not isinstance(vertex.get(axis), np.ndarray)]:
        if not vertex:
            raise MeshError("contains no vertices. Export it again, or leave it out.")
        raise MeshError(f"has vertices without {', '.join(missing)}. Export it again.")
    return np.stack([np.asarray(vertex[axis], dtype=np.float64) for axis in "xyz"], axis=1)


def _indices(element: dict[str, object], what: str) -> _List:
    for name in _INDICES:
        if isinstance(found := element.get(name), _List):
            return found
    if not element:
        return _List(np.empty(0), np.empty(0, dtype=np.int64))
    raise MeshError(
        f"has {what} without the list vertex_indices, but with {', '.join(element)}. Export it "
        "again."
    )
