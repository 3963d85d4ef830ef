"""Numbers in mesh files: tables and lists of faces, as text."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.exceptions import MeshError

__all__ = [
    "Polygons",
    "as_text",
    "numbers_of",
    "polygons_of_lines",
    "strips_as_polygons",
    "table_of_lines",
    "whole",
]

# Byte order marks. That of UTF-32 begins like that of UTF-16, so it comes first.
_MARKS = (
    (b"\xef\xbb\xbf", "utf-8"),
    (b"\xff\xfe\x00\x00", "utf-32-le"),
    (b"\x00\x00\xfe\xff", "utf-32-be"),
    (b"\xff\xfe", "utf-16-le"),
    (b"\xfe\xff", "utf-16-be"),
)

_LARGEST = 2**53  # text is read as floats, in which larger integers are not exact

_SHOWN = 60  # largest number of characters of a line quoted in a message


class Polygons(NamedTuple):
    """Faces with any number of corners, as `skfmap.geometry.polygons.triangulate` expects them."""

    corners: IntArray
    counts: IntArray


def as_text(content: bytes) -> bytes:
    """Convert the content of a text file to UTF-8, given its byte order mark.

    Raises
    ------
    MeshError
        If the content is UTF-16 without a byte order mark, or does not match its mark.
    """
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            body = content.removeprefix(mark)
            if encoding == "utf-8":
                return body  # comments may be in any encoding
            try:
                return body.decode(encoding).encode()
            except UnicodeDecodeError:
                raise MeshError(
                    f"begins as {encoding.upper()} text, but is not valid: it is damaged or "
                    "truncated. Save it as UTF-8."
                ) from None
    head = content[:64]
    if len(head) > 8 and any(set(head[i::2]) == {0} and 0 not in head[1 - i :: 2] for i in (0, 1)):
        raise MeshError("is UTF-16 text without a byte order mark. Save it as UTF-8.")
    return content


def table_of_lines(lines: Sequence[bytes], columns: Sequence[int], what: str) -> FloatArray:
    """Return the numbers in some columns of each line, of shape (n_lines, n_columns)."""
    if not lines:
        return np.empty((0, len(columns)))
    text = [line.decode("latin-1") for line in lines]
    try:
        return np.loadtxt(text, usecols=list(columns), comments=None, ndmin=2, dtype=np.float64)
    except ValueError:
        pass
    for line in text:  # find the faulty line
        words = line.split()
        try:
            [float(words[column]) for column in columns]
        except (ValueError, IndexError):
            raise MeshError(
                f"has {what} that is not {len(columns)} numbers: {line.strip()[:_SHOWN]!r}. The "
                "file is truncated or damaged."
            ) from None
    raise MeshError(f"has {what} that is not a row of numbers.")


def numbers_of(words: Sequence[bytes], what: str) -> FloatArray:
    """Return words as numbers."""
    try:
        return np.array([float(word) for word in words])
    except ValueError:
        for word in words:
            try:
                float(word)
            except ValueError:
                raise MeshError(
                    f"has {what} with {_quoted(word)}, which is not a number."
                ) from None
        raise


def whole(values: FloatArray, what: str) -> IntArray:
    """Return floats that must be whole numbers as integers."""
    with np.errstate(invalid="ignore"):
        wrong = ~((values == np.round(values)) & (np.abs(values) <= _LARGEST))
    if wrong.any():
        raise MeshError(f"has {what} whose vertices are not integers: {values[wrong][0]:g}.")
    return values.astype(np.int64)


def polygons_of_lines(lines: Sequence[bytes]) -> Polygons:
    """Return the faces of lines that begin with the number of corners; ignore what follows them."""
    heads = [line.split(maxsplit=1)[0] if line.strip() else b"" for line in lines]
    for line, head in zip(lines, heads, strict=True):
        if not head.isdigit():
            raise MeshError(
                "has a face that does not begin with its number of corners: "
                f"{_quoted(line)}. The file is damaged."
            )
        if len(head) > 9 or int(head) > len(line):  # before memory is allocated
            raise _cut_short(line, head.decode())
    counts = np.array([int(head) for head in heads], dtype=np.int64)
    start = np.cumsum(counts) - counts
    corners = np.empty(int(counts.sum()) if counts.size else 0, dtype=np.int64)
    for n in np.unique(counts[counts > 0]).tolist():
        at = np.flatnonzero(counts == n)
        own = [lines[i] for i in at.tolist()]
        corners[start[at][:, None] + np.arange(n)] = _corners(own, n)
    return Polygons(corners, counts)


def _corners(lines: Sequence[bytes], n: int) -> IntArray:
    for line in lines:
        words = line.split(maxsplit=n + 1)
        if len(words) <= n:
            raise _cut_short(line, str(n))
    try:
        return whole(table_of_lines(lines, range(1, n + 1), "a face"), "a face")
    except MeshError:
        for line in lines:
            if not all(word.lstrip(b"+-").isdigit() for word in line.split()[1 : n + 1]):
                raise MeshError(
                    f"has a face whose vertices are not integers: {_quoted(line)}."
                ) from None
        raise


def _cut_short(line: bytes, said: str) -> MeshError:
    return MeshError(f"has a truncated face: {_quoted(line)} declares {said} vertices.")


def _quoted(line: bytes) -> str:
    return repr(line.decode("latin-1").strip()[:_SHOWN])


def strips_as_polygons(strips: Polygons) -> Polygons:
    """Return the triangles of strips, in which each vertex forms one with the two before it.

    Every other triangle is reversed, to orient all alike. -1 begins a new strip. Repeated vertices
    give degenerate triangles, which are left out.
    """
    values = strips.corners
    begins = np.zeros(len(values) + 1, dtype=bool)
    begins[np.cumsum(strips.counts)] = True
    begins[0] = True
    restart = values < 0
    begins[1:][restart] = True
    begins[:-1][restart] = True
    at = np.arange(len(values))
    first = np.maximum.accumulate(np.where(begins[:-1], at, 0))
    rank = at - first
    third = np.flatnonzero((rank >= 2) & ~restart)
    faces = np.stack([values[third - 2], values[third - 1], values[third]], axis=1)
    odd = rank[third] % 2 == 1
    faces[odd] = faces[odd][:, [1, 0, 2]]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    return Polygons(faces.ravel(), np.full(len(faces), 3))
