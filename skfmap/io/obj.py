"""OBJ files: vertices, polygons and texture coordinates; normals and materials are ignored."""

import re
from pathlib import Path

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap.exceptions import MeshError
from skfmap.io.numbers import Polygons, as_text, table_of_lines

__all__ = ["read_obj", "read_uv"]

# A backslash at the end of a line of vertices or faces continues it in the next line. Elsewhere it
# may be the end of a path, and continues nothing.
_CONTINUED = re.compile(rb"\\[ \t]*\n")
_GEOMETRY = re.compile(rb"^[ \t]*(?:vt?|fo?)[ \t](?:[^#\n]*\\[ \t]*\n)+", re.MULTILINE)
# Keywords of surfaces that are not polygons.
_FREE_FORM = {b"curv", b"curv2", b"surf"}


def _lines(content: bytes) -> list[bytes]:
    """Return the lines of a text, with continued lines joined."""
    text = as_text(content)
    if b"\\" not in text:
        return text.splitlines()
    text = re.sub(rb"\r\n?", b"\n", text)
    return _GEOMETRY.sub(lambda found: _CONTINUED.sub(b" ", found[0]), text).splitlines()


def read_obj(content: bytes) -> tuple[FloatArray, Polygons]:
    """Return the vertices and faces of an OBJ file.

    Vertex numbers count from 1; negative numbers count back from the last vertex. Weights and
    colours of vertices, and texture coordinates and normals of faces, are ignored.

    Raises
    ------
    MeshError
        If the content cannot be read. The message continues a sentence that begins with the path.
    """
    points: list[bytes] = []
    corners: list[int] = []
    counts: list[int] = []
    curved = False
    for line in _lines(content):
        words = line.split(b"#", maxsplit=1)[0].split()
        if not words:
            continue
        if words[0] == b"v":
            points.append(b" ".join(words[1:]))
        elif words[0] in (b"f", b"fo"):  # the second is an old name of the first
            counts.append(len(words) - 1)
            corners += [_number(word, len(points), line) for word in words[1:]]
        curved |= words[0] in _FREE_FORM
    if not counts:
        what = (
            "it has curved surfaces, which are not polygons. Save it as polygons"
            if curved
            else "it is a point cloud, or truncated"
        )
        raise MeshError(f"contains {len(points)} vertices and no faces: {what}.")
    vertices = table_of_lines(points, range(3), "a vertex")
    return vertices, Polygons(np.array(corners, dtype=np.int64), np.array(counts))


def _number(word: bytes, n_vertices: int, line: bytes) -> int:
    """Return the index of a vertex, counted from 0."""
    said = line.decode("latin-1").strip()[:60]
    try:
        number = int(word.split(b"/", maxsplit=1)[0])
    except ValueError:
        raise MeshError(
            f"has a face whose vertices are not integers: {said!r}. The file is damaged."
        ) from None
    if number == 0 or number < -n_vertices:
        raise MeshError(
            f"has a face with an invalid vertex number ({said!r}); OBJ files count from 1."
        )
    return number - 1 if number > 0 else n_vertices + number


def read_uv(path: str | Path) -> FloatArray:
    r"""Read the texture coordinates of the vertices of an OBJ file.

    A vertex on a seam of the texture has several texture coordinates; those in the first face that
    uses the vertex are returned.

    Parameters
    ----------
    path : str or Path
        File to read.

    Returns
    -------
    ndarray of shape (n_vertices, 2)
        Texture coordinates of the vertices, in the order of the file, from the lower left corner
        of the image; NaN for vertices without any.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    MeshError
        If the file has no texture coordinates.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from skfmap.io import read_uv
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "one.obj"
    >>> corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    >>> _ = path.write_text(corners + "f 1/3 2/1 3/2\n")
    >>> read_uv(path).tolist()
    [[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]]
    """
    if not Path(path).is_file():
        raise FileNotFoundError(f"There is no mesh file {path}.")
    n_vertices, places, pairs = 0, list[bytes](), dict[int, int]()
    for line in _lines(Path(path).read_bytes()):
        words = line.split(b"#", maxsplit=1)[0].split() or [b""]
        if words[0] == b"v":
            n_vertices += 1
        elif words[0] == b"vt":
            places.append(b" ".join([*words[1:3], b"0"][:2]))
        elif words[0] in (b"f", b"fo"):
            for word in words[1:]:
                parts = word.split(b"/")
                if len(parts) > 1 and parts[1]:
                    vertex = _number(word, n_vertices, line)
                    pairs.setdefault(vertex, _number(parts[1], len(places), line))
    if not pairs or max(pairs) >= n_vertices or max(pairs.values()) >= len(places):
        raise MeshError(
            f"{path} has no texture coordinates for its faces, or lacks some that they refer to. "
            "Export it with texture coordinates: in Blender, tick UV Coordinates."
        )
    uv = np.full((n_vertices, 2), np.nan)
    uv[list(pairs)] = table_of_lines(places, range(2), "a texture coordinate")[list(pairs.values())]
    return uv
