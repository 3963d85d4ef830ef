"""glTF scenes: .glb and .gltf files."""

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np

from skfmap._tools.types import Array, FloatArray, IntArray
from skfmap.exceptions import MeshError
from skfmap.io.numbers import Polygons, strips_as_polygons

__all__ = ["read_gltf"]

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COLUMNS = {"SCALAR": 1, "VEC3": 3}
_LIST, _STRIP, _FAN = 4, 5, 6  # modes with triangles
# Numbers that are unpacked for each byte of the file. A mesh may be shown several times, but a
# small file must not fill the memory.
_NUMBERS_PER_BYTE = 16


class _Part(NamedTuple):
    """Vertices and triangles of a part of a node's mesh."""

    vertices: FloatArray
    faces: IntArray


def read_gltf(path: Path, content: bytes) -> tuple[FloatArray, IntArray]:
    """Return the triangles of the scene in a .glb or .gltf file, transformed by its nodes.

    Nodes are concatenated in the order of the file. Parts of a mesh that share their vertices, such
    as those with different materials, store them only once.

    Raises
    ------
    MeshError
        If the content cannot be read, is compressed, or has no triangles. The message continues a
        sentence that begins with the path.
    """
    scene, binary = _opened(content, path.suffix.lower())
    required = " ".join(scene.get("extensionsRequired", ())).lower()
    if "draco" in required or "meshopt" in required:
        raise MeshError("is compressed (Draco or meshopt). Export it without compression.")
    try:
        data = _Data(scene, binary, path.parent, len(content))
        parts = [part for node, matrix in _nodes(scene) for part in _parts(data, node, matrix)]
    except (KeyError, IndexError, TypeError, ValueError, RecursionError) as error:
        if isinstance(error, MeshError):
            raise
        raise MeshError("is not a glTF file, or is damaged. Export it again.") from None
    if not any(len(part.faces) for part in parts):
        raise MeshError("contains no triangles. Export a mesh, not points or lines.")
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return (
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)]),
    )


def _opened(content: bytes, suffix: str) -> tuple[dict[str, Any], bytes]:
    """Return the JSON description in a file, and the binary data of a .glb file."""
    binary = b""
    if suffix == ".glb":
        if content[:4] != b"glTF":
            raise MeshError("is not a .glb file: it does not begin with glTF. Export it again.")
        if int.from_bytes(content[8:12], "little") > len(content):
            raise MeshError(
                "is shorter than its declared length: the file is truncated. Export it again."
            )
        end = 20 + int.from_bytes(content[12:16], "little")
        content, binary = content[20:end], content[end + 8 :]
    try:
        scene = dict(json.loads(content.decode("utf-8-sig")))
        version = str(scene["asset"]["version"])
    except (ValueError, KeyError, TypeError):
        raise MeshError("is not a glTF file, or is damaged. Export it again.") from None
    if not version.startswith("2"):
        raise MeshError(f"has version {version} of glTF. Export it as version 2, or as PLY.")
    return scene, binary


def _nodes(scene: dict[str, Any]) -> Iterator[tuple[dict[str, Any], FloatArray]]:
    """Yield the nodes of the default scene that have a mesh, with their transformations.

    Without a scene, all nodes are used; without nodes, all meshes.
    """
    nodes = scene.get("nodes", [])
    if not nodes:
        for i in range(len(scene.get("meshes", []))):
            yield {"mesh": i}, np.eye(4)
        return
    children = {child for node in nodes for child in node.get("children", ())}
    roots = [i for i in range(len(nodes)) if i not in children]
    if scene.get("scenes"):
        roots = scene["scenes"][scene.get("scene", 0)].get("nodes", [])
    waiting = [(i, np.eye(4), 0) for i in reversed(roots)]
    while waiting:
        i, outer, depth = waiting.pop()
        if depth > len(nodes):
            raise MeshError("has nodes that contain themselves: the file is damaged.")
        node = nodes[i]
        matrix = outer @ _placed(node)
        if "mesh" in node:
            yield node, matrix
        waiting += [(child, matrix, depth + 1) for child in reversed(node.get("children", ()))]


def _placed(node: dict[str, Any]) -> FloatArray:
    """Return the transformation of a node, of shape (4, 4), for points as columns."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= node.get("scale", (1.0, 1.0, 1.0))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _parts(data: "_Data", node: dict[str, Any], matrix: FloatArray) -> Iterator[_Part]:
    """Yield the triangles of the mesh of a node; parts that share vertices are combined."""
    if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
        raise MeshError(
            "has instances of a mesh (EXT_mesh_gpu_instancing), which are not supported. Export it "
            "as PLY."
        )
    mesh = data.scene["meshes"][node["mesh"]]
    weights = node.get("weights", mesh.get("weights", ()))
    shared: dict[str, tuple[FloatArray, list[IntArray]]] = {}
    for one in mesh["primitives"]:
        mode = one.get("mode", _LIST)
        if mode not in (_LIST, _STRIP, _FAN) or "POSITION" not in one.get("attributes", {}):
            continue
        key = json.dumps([one["attributes"]["POSITION"], one.get("targets")])
        if key not in shared:
            shared[key] = (_positions(data, one, weights), [])
        points, faces = shared[key]
        faces.append(_triangles(data, one, mode, len(points)))
    # Reverse the faces of a mirrored part, to keep its outside.
    order = [0, 2, 1] if np.linalg.det(matrix[:3, :3]) < 0 else [0, 1, 2]
    for points, faces in shared.values():
        placed = points @ matrix[:3, :3].T + matrix[:3, 3]
        yield _Part(placed, np.concatenate(faces)[:, order])


def _positions(data: "_Data", primitive: dict[str, Any], weights: Any) -> FloatArray:
    """Return the vertices of a part, with its weighted morph targets added."""
    points = data.array(primitive["attributes"]["POSITION"]).astype(np.float64)
    for target, weight in zip(primitive.get("targets", ()), weights, strict=False):
        if weight and "POSITION" in target:
            points = points + weight * data.array(target["POSITION"])
    return points


def _triangles(data: "_Data", primitive: dict[str, Any], mode: int, n_vertices: int) -> IntArray:
    corners = np.arange(n_vertices)
    if "indices" in primitive:
        corners = data.array(primitive["indices"]).ravel().astype(np.int64)
    if corners.max(initial=0) >= n_vertices:  # it would refer to another part
        raise MeshError(
            f"has a face with vertex {corners.max()}, but its part has {n_vertices} vertices: the "
            "file is damaged."
        )
    if mode == _STRIP:
        return strips_as_polygons(Polygons(corners, np.array([len(corners)]))).corners.reshape(
            -1, 3
        )
    if mode == _FAN:
        around = np.column_stack([corners[1:-1], corners[2:]])
        return np.insert(around, 0, corners[0], axis=1)
    if len(corners) % 3:
        raise MeshError(
            f"has triangles with {len(corners)} corners, which is not a multiple of three: the "
            "file is damaged."
        )
    return corners.reshape(-1, 3)


class _Data:
    """The arrays of a file, by the index of their accessor."""

    def __init__(self, scene: dict[str, Any], binary: bytes, folder: Path, size: int) -> None:
        self.scene = scene
        self._left = _NUMBERS_PER_BYTE * size
        self._binary = binary
        self._folder = folder
        self._buffers: dict[int, bytes] = {}

    def array(self, i: int) -> Array:
        """Return an array of shape (count, columns)."""
        accessor = self.scene["accessors"][i]
        kind, n = np.dtype(_TYPES[accessor["componentType"]]), int(accessor["count"])
        columns = _COLUMNS[accessor["type"]]
        sparse = accessor.get("sparse")
        if "bufferView" in accessor:
            self._buffer(self.scene["bufferViews"][accessor["bufferView"]]["buffer"])
        self._left -= n * columns
        if self._left < 0:
            raise MeshError(
                "shows its parts so often that they would take many times its size, or is damaged. "
                "Export one mesh."
            )
        if "bufferView" in accessor:
            values = self._rows(accessor, kind, n, columns)
        elif sparse:
            values = np.zeros((n, columns), dtype=kind)
        else:
            raise MeshError("has compressed data. Export it without compression.")
        if sparse:
            n_sparse, where = int(sparse["count"]), sparse["indices"]
            at = self._rows(where, np.dtype(_TYPES[where["componentType"]]), n_sparse, 1)
            values = values.copy()
            values[at[:, 0]] = self._rows(sparse["values"], kind, n_sparse, columns)
        if accessor.get("normalized") and kind.kind in "iu":
            return np.asarray(np.maximum(values / np.iinfo(kind).max, -1.0))
        return values

    def _rows(self, where: dict[str, Any], kind: "np.dtype[Any]", n: int, columns: int) -> Array:
        """Return rows from a view of a buffer, in which they may be interleaved with others."""
        view = self.scene["bufferViews"][where["bufferView"]]
        start, step = view.get("byteOffset", 0), view.get("byteStride", columns * kind.itemsize)
        content = self._buffer(view["buffer"])[start : start + view["byteLength"]]
        offset = where.get("byteOffset", 0)
        if min(n, start, offset) < 0 or step < columns * kind.itemsize:
            raise MeshError("has invalid positions of its data: the file is damaged.")
        if n and offset + (n - 1) * step + columns * kind.itemsize > len(content):
            raise MeshError("is shorter than declared: the file, or one beside it, is truncated.")
        return np.ndarray((n, columns), kind, content, offset, (step, kind.itemsize))

    def _buffer(self, i: int) -> bytes:
        if i not in self._buffers:
            self._buffers[i] = self._opened(self.scene["buffers"][i].get("uri"))
        return self._buffers[i]

    def _opened(self, uri: str | None) -> bytes:
        if uri is None:
            return self._binary
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        name = unquote(uri)
        path = self._folder / name
        # A file from a stranger is not to open others from elsewhere.
        if "://" in uri or ".." in Path(name).parts or Path(name).is_absolute():
            raise MeshError(
                f"keeps its numbers in another file that is not beside it, {name}. Export a .glb "
                "file."
            )
        if not path.is_file():
            raise MeshError(
                f"keeps its numbers in another file, {name}, which is missing. Put that file "
                "beside it, or export a .glb file."
            )
        content = path.read_bytes()
        self._left += _NUMBERS_PER_BYTE * len(content)
        return content
