"""OFF files: vertices and polygons as text."""

import re

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.exceptions import MeshError
from skfmap.io.numbers import (
    Polygons,
    as_text,
    numbers_of,
    polygons_of_lines,
    table_of_lines,
    whole,
)

__all__ = ["read_off"]

# Prefixes: texture coordinates, colours, normals, homogeneous coordinates, other dimensions.
# Colours and normals are written in either order. Only n and N differ by their case.
_KEYWORD = re.compile(rb"(?:ST)?(?:C?N?|NC)(4)?(n)?OFF|[oO]ff")


def read_off(content: bytes) -> tuple[FloatArray, Polygons]:
    """Return the vertices and faces of an OFF file, including COFF, NOFF, STOFF and 4OFF.

    Anything after the coordinates of a vertex is ignored. The homogeneous coordinates of 4OFF are
    divided by the fourth one.

    Raises
    ------
    MeshError
        If the content cannot be read. The message continues a sentence that begins with the path.
    """
    content = as_text(content)
    if re.match(rb"\s*\S*OFF\s+BINARY\b", content):
        raise MeshError("is a binary OFF file, which is not supported. Save it as text, or as PLY.")
    lines = [line.split(b"#", maxsplit=1)[0].strip() for line in content.splitlines()]
    lines = [line for line in lines if line]
    words = lines[0].split() if lines else []
    keyword = _KEYWORD.fullmatch(words[0]) if words else None
    if keyword is None:
        if len(words) != 3 or not all(word.isdigit() for word in words):
            raise MeshError(
                "is not an OFF file: it begins neither with OFF nor with its numbers of vertices, "
                "faces and edges. It may be in another format."
            )
    else:  # treat the rest of the keyword's line as a line of its own
        rest = b" ".join(words[1:])
        lines = [rest, *lines[1:]] if rest else lines[1:]
    homogeneous = keyword is not None and keyword[1] is not None
    if keyword is not None and keyword[2] is not None:
        lines = _of_three_dimensions(lines)
    n_vertices, n_faces, lines = _counts(lines)
    if n_faces == 0:
        raise MeshError(
            f"contains {n_vertices} vertices and no faces: it is a point cloud, or truncated."
        )
    per_vertex = 4 if homogeneous else 3
    if not _has_line_for_each(lines, n_vertices, n_faces, per_vertex):
        return _of_words(lines, n_vertices, n_faces, per_vertex)
    points = table_of_lines(lines[:n_vertices], range(per_vertex), "a vertex")
    return _divided(points), polygons_of_lines(lines[n_vertices : n_vertices + n_faces])


def _of_three_dimensions(lines: list[bytes]) -> list[bytes]:
    words = lines[0].split() if lines else []
    if not words or words[0] != b"3":
        said = words[0].decode("latin-1") if words else "?"
        raise MeshError(f"contains points with {said} dimensions; a mesh must have three.")
    rest = b" ".join(words[1:])
    return [rest, *lines[1:]] if rest else lines[1:]


def _counts(lines: list[bytes]) -> tuple[int, int, list[bytes]]:
    """Return the numbers of vertices and faces, and the remaining lines."""
    words = lines[0].split() if lines else []
    if len(words) < 2 or not all(word.isdigit() for word in words[:3]):
        said = lines[0].decode("latin-1")[:60] if lines else ""
        raise MeshError(
            f"does not declare its numbers of vertices and faces, but has {said!r} in their place. "
            "It is damaged, or in another format."
        )
    rest = b" ".join(words[3:])
    return int(words[0]), int(words[1]), ([rest] if rest else []) + lines[1:]


def _has_line_for_each(lines: list[bytes], n_vertices: int, n_faces: int, per_vertex: int) -> bool:
    """Return whether each vertex and each face has its own line; raise if more lines follow.

    Otherwise line breaks may be anywhere between numbers.
    """
    body = lines[: n_vertices + n_faces]
    one_each = all(len(line.split(maxsplit=per_vertex)) >= per_vertex for line in body[:n_vertices])
    one_each &= all(
        len(words := line.split()) > 0 and words[0].isdigit() and len(words) > int(words[0])
        for line in body[n_vertices:]
    )
    if one_each and len(lines) > n_vertices + n_faces:
        raise MeshError(
            f"declares {n_faces} faces, but more lines follow. Its header is wrong, or two files "
            "were joined."
        )
    return one_each and len(body) == n_vertices + n_faces


def _of_words(
    lines: list[bytes], n_vertices: int, n_faces: int, per_vertex: int
) -> tuple[FloatArray, Polygons]:
    """Read numbers regardless of line breaks; all of them must be used up."""
    words = b" ".join(lines).split()
    at = n = per_vertex * n_vertices
    counts: list[int] = []
    corners: list[bytes] = []
    while len(counts) < n_faces and at < len(words) and words[at].isdigit():
        count = int(words[at])
        if at + count >= len(words):
            break
        counts.append(count)
        corners += words[at + 1 : at + 1 + count]
        at += 1 + count
    if len(counts) < n_faces or at < len(words):
        return _complain(lines, n_vertices, n_faces, len(counts))
    points = numbers_of(words[:n], "a vertex").reshape(-1, per_vertex)
    return _divided(points), Polygons(
        whole(numbers_of(corners, "a face"), "a face"), np.array(counts)
    )


def _complain(
    lines: list[bytes], n_vertices: int, n_faces: int, n_read: int
) -> tuple[FloatArray, Polygons]:
    polygons_of_lines(
        lines[n_vertices : n_vertices + n_faces]
    )  # raises an error if a single face is at fault
    raise MeshError(
        f"declares {n_vertices} vertices and {n_faces} faces, but only {n_read} faces could be "
        "read: the file is truncated, or its header is wrong."
    )


def _divided(points: FloatArray) -> FloatArray:
    """Convert homogeneous coordinates to three dimensions; return others unchanged."""
    if points.shape[1] == 3:
        return points
    scale = points[:, 3:]
    if (scale == 0).any():
        raise MeshError(
            f"has a vertex at infinity ({int(np.flatnonzero(scale == 0)[0])}): its fourth "
            "(homogeneous) coordinate is 0. Remove it before saving."
        )
    return np.asarray(points[:, :3] / scale)
