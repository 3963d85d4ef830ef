"""STL files, which are read with trimesh."""

import io
import logging
import re
from typing import Any

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.exceptions import MeshError
from skfmap.io.numbers import as_text

__all__ = ["read_stl"]


def read_stl(content: bytes) -> tuple[FloatArray, IntArray]:
    """Return the triangles of an STL file; corners at exactly the same position are one vertex.

    Raises
    ------
    MeshError
        If the content cannot be read. The message continues a sentence that begins with the path.
    """
    n_said = int.from_bytes(content[80:84], "little")
    if len(content) < 84 or len(content) != 84 + 50 * n_said:
        content, n_said = _stl_text(content, n_said)
    loaded = _load(content)
    if len(loaded.faces) != n_said:
        raise MeshError(
            f"contains {n_said} triangles, but {len(loaded.faces)} were read. Export it as PLY."
        )
    vertices, faces = _weld(np.asarray(loaded.vertices), np.asarray(loaded.faces))
    if len(faces) == 0:
        raise MeshError("contains no triangles. Export it again, or leave it out.")
    return vertices, faces


def _stl_text(content: bytes, n_said: int) -> tuple[bytes, int]:
    """Return a text STL file and its number of triangles; raise an error if it is incomplete."""
    try:
        text = as_text(content)
    except MeshError:
        text = content
    if not text.lstrip().lower().startswith(b"solid") or b"\0" in text:
        n_there = max(0, (len(content) - 84) // 50)
        if len(content) < 84:
            raise MeshError(
                "is not an STL file, or is truncated: it has neither the first word of a text file "
                "nor the 84 bytes that begin a binary one. Export it again."
            )
        n_more = len(content) - 84 - 50 * n_said
        if n_more > 0 and n_said > 0:
            raise MeshError(
                f"has {n_more} bytes after the {n_said} triangles that it declares: it has a "
                "second solid, or is damaged. Export it again."
            )
        raise MeshError(
            f"declares {n_said} triangles, but its size is that of {n_there}: it is truncated, "
            "damaged, or not an STL file. Export it again."
        )
    words = re.findall(rb"^\s*(facet|vertex|endfacet|endsolid)\b", text.lower(), re.MULTILINE)
    n_facets = words.count(b"facet")
    whole = words.count(b"endfacet") == n_facets and words.count(b"vertex") == 3 * n_facets
    if not whole or b"endsolid" not in words:
        raise MeshError(
            f"begins {n_facets} triangles, but ends {words.count(b'endfacet')} of them with "
            f"{words.count(b'vertex')} corners: the file is truncated or damaged. Export it again."
        )
    return text, n_facets


def _weld(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    if len(vertices) == 0:
        return vertices, faces
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return vertices[np.sort(first)], rank[inverse.ravel()][faces]


def _load(content: bytes) -> Any:
    """Read a file as one mesh without merging vertices, which keep their indices."""
    import trimesh  # noqa: PLC0415

    # Without a handler, trimesh would write tracebacks to standard error.
    logging.getLogger("trimesh").addHandler(logging.NullHandler())
    try:
        return trimesh.load(io.BytesIO(content), file_type="stl", process=False, force="mesh")
    except Exception as error:
        said = str(error).rstrip(".")
        raise MeshError(
            "contains no triangle mesh: it is truncated, or not in the format of its suffix. The "
            f"reader reports {type(error).__name__}: {said}."
        ) from error
