"""Writing of matches in the formats of other programs."""

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from skfmap._tools.types import Array, FloatArray, IntArray
from skfmap._tools.validation import as_reals, check_folder, label
from skfmap.exceptions import CorrespondenceError
from skfmap.geometry.closest import nearest_places
from skfmap.geometry.geodesics import mean_edge_length
from skfmap.geometry.position_colours import colours_of_position
from skfmap.io.file_names import file_stem
from skfmap.io.landmarks import write_landmarks
from skfmap.io.meshes import check_single_precision
from skfmap.io.vtk_written import vtk_of, vtp_of
from skfmap.shapes import Landmarks, Match, Mesh

__all__ = ["MATCH_SUFFIXES", "carried_landmarks", "read_image", "save_match"]

MATCH_SUFFIXES = (".csv", ".npz", ".ply", ".glb", ".vtp", ".vtk", ".fcsv", ".mrk.json")
"""Formats in which a match can be saved."""

_USUAL = (".csv", ".npz", ".ply", ".glb", ".vtp")
_OF_LANDMARKS = (".fcsv", ".mrk.json")
_HEADER = ("vertex", "reference_vertex", "expected_error", "confidence")
_GREY = 0.72  # vertices without a match
# Largest plausible median distance of landmarks from the reference, as a fraction of its extent.
_FAR = 0.1
# Largest distance, in mean edge lengths, between the images of the corners of a face. If it is
# exceeded, the map is torn there, and a landmark follows the corner with the largest weight.
_TORN = 6.0


class _Extras(NamedTuple):
    """Optional contents of a file besides the match."""

    landmarks: Landmarks | None
    uv: FloatArray | None
    texture: Any


def save_match(
    match: Match,
    path: str | Path,
    *,
    landmarks: Landmarks | None = None,
    uv: npt.ArrayLike | None = None,
    texture: Any = None,
    overwrite: bool = False,
) -> list[Path]:
    """Write a match to a file, or in the usual formats to a folder; see `Match.save`."""
    extras = _Extras(landmarks, _checked_uv(match, uv, texture), read_image(texture))
    targets = _targets(match, Path(path), landmarks)
    there = [one for one in targets if one.exists()]
    if there and not overwrite:
        raise FileExistsError(
            f"{there[0]} already exists; write to another file, or pass overwrite=True."
        )
    contents = {target: _content(match, target, extras) for target in targets}
    targets[0].parent.mkdir(exist_ok=True)
    for target, content in contents.items():
        if isinstance(content, Landmarks):
            write_landmarks(content, target, overwrite=overwrite)
        else:
            target.write_bytes(content)
    return targets


def _targets(match: Match, path: Path, landmarks: Landmarks | None) -> list[Path]:
    """Return the files to write, which are in a folder unless ``path`` is a file."""
    check_folder(path)
    if not path.is_dir() and path.suffix:
        if _suffix(path) is None:
            raise ValueError(
                f"{path} has the suffix {path.suffix!r}; a match is saved as "
                f"{', '.join(MATCH_SUFFIXES)}, or to a folder."
            )
        return [path]
    if path.is_file():
        raise NotADirectoryError(
            f"{path} is a file. Give a folder, or a name with one of the suffixes "
            f"{', '.join(MATCH_SUFFIXES)}."
        )
    stem = file_stem(match.name or "match")
    suffixes = (*_USUAL, *(_OF_LANDMARKS if landmarks is not None else ()))
    return [path / f"{stem}{suffix}" for suffix in suffixes]


def _suffix(path: Path) -> str | None:
    name = path.name.lower()
    return next((suffix for suffix in MATCH_SUFFIXES if name.endswith(suffix)), None)


def _content(match: Match, path: Path, extras: _Extras) -> bytes | Landmarks:
    suffix = _suffix(path)
    if suffix in _OF_LANDMARKS:
        if extras.landmarks is None:
            raise ValueError(
                f"{path} is a landmark file. Give the landmarks of the reference: "
                "match.save(path, landmarks=skfmap.io.read_landmarks(...)). If the model was "
                "trained with landmarks, skfmap.predict_landmarks is more accurate."
            )
        return carried_landmarks(match, extras.landmarks)
    if suffix == ".csv":
        return _table(match)
    if suffix == ".npz":
        return _archive(match)
    mesh = match.mesh
    if suffix == ".ply":
        return _ply(match, mesh)
    if suffix == ".glb":
        check_single_precision(mesh, path)
        return _glb(match, mesh, extras)
    writer: Callable[..., bytes] = vtp_of if suffix == ".vtp" else vtk_of
    return writer(mesh.vertices, mesh.faces, _arrays(match))


def _table(match: Match) -> bytes:
    """Return a CSV file with a line for each vertex; unknown values are blank."""
    columns = [
        _texts(values, len(match.p2p)) for values in (match.expected_error, match.confidence)
    ]
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(_HEADER)
    writer.writerows(zip(range(len(match.p2p)), match.p2p.tolist(), *columns, strict=True))
    return file.getvalue().encode()


def _texts(values: FloatArray | None, n: int) -> list[str]:
    if values is None:
        return [""] * n
    return ["" if np.isnan(value) else f"{value:.8g}" for value in values]


def _archive(match: Match) -> bytes:
    """Return an .npz file with all arrays of a match except those that are None."""
    names = (
        *("p2p", "expected_error", "confidence", "n_supporting", "inverse", "functional_map"),
        *("reduced_map", "refined_map", "covered", "covered_probability", "torn"),
    )
    arrays = {name: getattr(match, name) for name in names}
    arrays |= {name: getattr(match, name) for name in ("name", "reference_name", "reference_hash")}
    arrays |= {"misfit": match.misfit, "familiar": match.familiar, "scale": match.scale}
    if match.matrix is not None:
        matrix = match.matrix.tocsr()
        arrays |= {
            f"matrix_{part}": getattr(matrix, part) for part in ("data", "indices", "indptr")
        }
        arrays["matrix_shape"] = matrix.shape
    file = io.BytesIO()
    known: dict[str, Any] = {name: one for name, one in arrays.items() if one is not None}
    np.savez_compressed(file, **known)
    return file.getvalue()


def _arrays(match: Match) -> dict[str, Array]:
    """Return the arrays at the vertices, by name."""
    arrays: dict[str, Array | None] = {
        "reference_vertex": match.p2p,
        "expected_error": match.expected_error,
        "confidence": match.confidence,
        "n_supporting": match.n_supporting,
        "colour": _colours(match),
        "place_on_reference": _places(match),
    }
    return {name: values for name, values in arrays.items() if values is not None}


def _places(match: Match) -> FloatArray | None:
    """Return the position of each vertex on the reference; NaN where there is no match."""
    if match.matrix is None:
        return None
    at = np.asarray(match.matrix @ match.reference_mesh.vertices)
    at[match.p2p < 0] = np.nan
    return at


def _colours(match: Match) -> Array:
    """Return the colours carried over from the reference, as bytes of shape (n, 3)."""
    colours = np.vstack([colours_of_position(match.reference_mesh.vertices), [[_GREY] * 3]])
    return np.round(255 * np.clip(colours[match.p2p], 0, 1)).astype(np.uint8)


def _ply(match: Match, mesh: Mesh) -> bytes:
    """Return a PLY file; MeshLab reads the scalar ``quality``, CloudCompare reads all scalars."""
    scalars: dict[str, tuple[str, Array | None]] = {
        "quality": ("<f4", match.expected_error),
        "scalar_confidence": ("<f4", match.confidence),
        "scalar_reference_vertex": ("<i4", match.p2p),
    }
    held = {name: (kind, values) for name, (kind, values) in scalars.items() if values is not None}
    layout = [(axis, "<f8") for axis in "xyz"]
    layout += [(colour, "u1") for colour in ("red", "green", "blue")]
    rows = np.empty(mesh.n_vertices, dtype=[*layout, *((n, k) for n, (k, _) in held.items())])
    for j, axis in enumerate("xyz"):
        rows[axis] = mesh.vertices[:, j]
    for j, colour in enumerate(("red", "green", "blue")):
        rows[colour] = _colours(match)[:, j]
    for name, (_, values) in held.items():
        rows[name] = values
    faces = np.empty(mesh.n_faces, dtype=[("n", "u1"), ("corners", "<i4", 3)])
    faces["n"], faces["corners"] = 3, mesh.faces
    types = {"f8": "double", "f4": "float", "i4": "int", "u1": "uchar"}
    properties = [f"property {types[rows.dtype[n].str[1:]]} {n}" for n in rows.dtype.names or ()]
    header = [
        *("ply", "format binary_little_endian 1.0", f"element vertex {mesh.n_vertices}"),
        *properties,
        f"element face {mesh.n_faces}",
        *("property list uchar int vertex_indices", "end_header", ""),
    ]
    return "\n".join(header).encode() + rows.tobytes() + faces.tobytes()


def _glb(match: Match, mesh: Mesh, extras: _Extras) -> bytes:
    """Return a GLB file with the colours of the match or the texture of the reference."""
    import trimesh  # noqa: PLC0415

    if extras.uv is None:
        colours = np.hstack([_linear(_colours(match)), np.full((mesh.n_vertices, 1), 255)])
        visual = trimesh.visual.ColorVisuals(vertex_colors=colours.astype(np.uint8))
    else:
        carried = np.nan_to_num(match.transfer(extras.uv).filled(0.0))
        visual = trimesh.visual.TextureVisuals(uv=carried, image=extras.texture)
    written = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False, visual=visual)
    return bytes(written.export(file_type="glb"))


def _linear(colours: Array) -> Array:
    """Convert sRGB colours (IEC 61966-2-1) to the linear colours that glTF vertices have."""
    share = colours / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.round(255 * linear))


def read_image(texture: Any) -> Any:
    """Return a PIL image, given an image or the path of one; None stays None."""
    if texture is None:
        return None
    from PIL import Image  # noqa: PLC0415

    if isinstance(texture, Image.Image):
        return texture
    if not isinstance(texture, (str, Path)):
        raise TypeError(
            f"texture must be a PIL image or the path of an image; got {type(texture).__name__}."
        )
    if not Path(texture).is_file():
        raise FileNotFoundError(f"There is no image file {texture}.")
    with Image.open(texture) as image:
        return image.convert("RGB")


def _checked_uv(match: Match, uv: npt.ArrayLike | None, texture: Any) -> FloatArray | None:
    if (uv is None) != (texture is None):
        raise ValueError(
            "Give both uv and texture: the texture coordinates of the reference's vertices "
            "(skfmap.io.read_uv reads those of an OBJ file), and the image that they refer to."
        )
    if uv is None:
        return None
    given = as_reals(uv, "uv")
    n_0 = None if match.matrix is None else match.matrix.shape[1]
    if given.ndim != 2 or given.shape[1] != 2 or (n_0 is not None and len(given) != n_0):
        raise ValueError(
            f"uv must hold two coordinates for each of the {n_0} vertices of the reference; got "
            f"shape {given.shape}."
        )
    return given


def carried_landmarks(match: Match, landmarks: Landmarks) -> Landmarks:
    """Transfer landmarks of the reference to the surface of the matched shape.

    Parameters
    ----------
    match : Match
        Match of the shape.
    landmarks : Landmarks
        Landmarks of the reference, in the units and the coordinate system of its mesh.

    Returns
    -------
    Landmarks
        Landmarks on the shape; NaN where there is no match.

    Raises
    ------
    CorrespondenceError
        If the landmarks lie far from the reference.
    """
    if not isinstance(landmarks, Landmarks):
        raise TypeError(f"landmarks must be skfmap.Landmarks; got {type(landmarks).__name__}.")
    mesh, reference, placed = match.mesh, match.reference_mesh, landmarks.placed
    points = np.full((len(landmarks.names), 3), np.nan)
    if placed.any():
        found = nearest_places(landmarks.points[placed], reference.vertices, reference.faces)
        extent = float(np.linalg.norm(np.ptp(reference.vertices, axis=0)))
        if np.median(found.distances) > _FAR * extent:
            raise CorrespondenceError(
                f"The landmarks lie {np.median(found.distances):.3g} from the reference "
                f"{label(reference.name)}, whose extent is {extent:.3g}. Check that they belong to "
                "it, in its units and coordinate system (read_landmarks takes system='LPS')."
            )
        points[placed] = _images(match, mesh, found.corners, found.weights)
    return Landmarks(points, landmarks.names, name=match.name)


def _images(match: Match, mesh: Mesh, corners: IntArray, weights: FloatArray) -> FloatArray:
    """Return the points on a shape that match places on the reference; NaN where there is none."""
    images = match.inverse[corners]
    at = np.where(images[..., None] >= 0, mesh.vertices[images], np.nan)
    nearest = np.take_along_axis(at, weights.argmax(axis=1)[:, None, None], axis=1)[:, 0]
    apart = np.linalg.norm(at - np.roll(at, 1, axis=1), axis=2).max(axis=1)
    between = np.einsum("nc,ncd->nd", weights, np.nan_to_num(at))
    whole = apart <= _TORN * mean_edge_length(mesh.vertices, mesh.faces)  # False where unknown
    points = np.where(whole[:, None], between, nearest)
    known = np.isfinite(points).all(axis=1)
    if known.any():
        found = nearest_places(points[known], mesh.vertices, mesh.faces)
        points[known] = np.einsum("nc,ncd->nd", found.weights, mesh.vertices[found.corners])
    return points
