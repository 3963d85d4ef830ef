"""Files that are read with trimesh: STL, and glTF scenes."""

import io
import json
import logging
import re
from pathlib import Path
from typing import Any

import numpy as np

from skfmap._tools.types import FloatArray, IntArray
from skfmap.exceptions import MeshError
from skfmap.io.numbers import as_text

__all__ = ["read_gltf", "read_stl"]

_TRIANGLES = (4, 5, 6)  # glTF modes: triangles, triangle strip, triangle fan


def read_stl(path: Path, content: bytes) -> tuple[FloatArray, IntArray]:
    """Return the triangles of an STL file; corners at exactly the same position are one vertex.

    Raises
    ------
    MeshError
        If the content cannot be read. The message continues a sentence that begins with the path.
    """
    n_said = int.from_bytes(content[80:84], "little")
    if len(content) < 84 or len(content) != 84 + 50 * n_said:
        content, n_said = _stl_text(content, n_said)
    loaded = _load(path, content, "stl")
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


def read_gltf(path: Path, content: bytes) -> tuple[FloatArray, IntArray]:
    """Return the triangles of a .glb or .gltf file, with its parts concatenated.

    If there is only one part, its number of vertices is compared with the one in the file.

    Raises
    ------
    MeshError
        If the content cannot be read, or was not read correctly. The message continues a sentence
        that begins with the path.
    """
    scene = _scene_of(content, path.suffix.lower())
    used = [one for mesh in scene.get("meshes", []) for one in mesh.get("primitives", [])]
    compressed = [name for name in scene.get("extensionsRequired", []) if "draco" in name.lower()]
    if compressed or any("meshopt" in name for name in scene.get("extensionsRequired", [])):
        raise MeshError("is compressed (Draco or meshopt). Export it without compression.")
    if not any(one.get("mode", 4) in _TRIANGLES for one in used):
        raise MeshError("contains no triangles. Export a mesh, not points or lines.")
    loaded = _load(path, content, path.suffix[1:].lower())
    vertices, faces = np.asarray(loaded.vertices), np.asarray(loaded.faces)
    if len(used) == 1 and (n := _n_positions(scene, used[0])) is not None and n != len(vertices):
        raise MeshError(
            f"contains {n} vertices, but {len(vertices)} were read, so correspondences would refer "
            "to the wrong ones. Export it as PLY."
        )
    return vertices, faces


def _scene_of(content: bytes, suffix: str) -> dict[str, Any]:
    """Return the JSON description of the scene in a glTF file."""
    try:
        if suffix == ".glb":
            if content[:4] != b"glTF":
                raise MeshError("is not a .glb file: it does not begin with glTF. Export it again.")
            if int.from_bytes(content[8:12], "little") > len(content):
                raise MeshError(
                    "is shorter than its declared length: the file is truncated. Export it again."
                )
            content = content[20 : 20 + int.from_bytes(content[12:16], "little")]
        scene = json.loads(content.decode("utf-8-sig"))
        version = str(scene["asset"]["version"])
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, MeshError):
            raise
        raise MeshError("is not a glTF file, or is damaged. Export it again.") from None
    if not version.startswith("2"):
        raise MeshError(f"has version {version} of glTF. Export it as version 2, or as PLY.")
    return dict(scene)


def _n_positions(scene: dict[str, Any], primitive: dict[str, Any]) -> int | None:
    try:
        return int(scene["accessors"][primitive["attributes"]["POSITION"]]["count"])
    except (KeyError, IndexError, TypeError, ValueError):
        return None


def _load(path: Path, content: bytes, kind: str) -> Any:
    """Read a file as one mesh without merging vertices, which keep their indices."""
    import trimesh  # noqa: PLC0415

    # Without a handler, trimesh would write tracebacks to standard error.
    logging.getLogger("trimesh").addHandler(logging.NullHandler())
    resolver = trimesh.visual.resolvers.FilePathResolver(str(path)) if kind == "gltf" else None
    try:
        return trimesh.load(
            io.BytesIO(content), file_type=kind, process=False, force="mesh", resolver=resolver
        )
    except Exception as error:
        said = str(error).rstrip(".")
        raise MeshError(
            "contains no triangle mesh: it is truncated, or not in the format of its suffix. The "
            f"reader reports {type(error).__name__}: {said}."
        ) from error
