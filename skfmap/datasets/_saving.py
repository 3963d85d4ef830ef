"""Saving of a collection of shapes to a folder."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from skfmap._tools.types import IntArray
from skfmap._tools.validation import check_folder, check_index_range, label
from skfmap.exceptions import CorrespondenceError
from skfmap.io import WRITTEN_SUFFIXES, write_landmarks, write_mesh
from skfmap.io.file_names import file_stem
from skfmap.shapes import Correspondence, Landmarks, Mesh

__all__ = ["save_collection"]

# The vertices of STL files have no fixed order, so correspondences cannot refer to them.
_SUFFIXES = tuple(suffix for suffix in WRITTEN_SUFFIXES if suffix != ".stl")


def save_collection(
    folder: str | Path,
    meshes: Sequence[Mesh],
    correspondences: Sequence[Correspondence],
    *,
    suffix: str = ".off",
) -> list[Path]:
    """Write meshes and their correspondences to a folder that `load_collection` can read.

    Each mesh is written to ``NAME.off``. Its pairs are written to ``NAME.txt``, in two columns for
    vertex and template point, and its symmetric pairs, if any, to ``NAME.sym.txt``. If points have
    names, or lie between vertices, landmarks are written to ``NAME.csv`` instead; points without
    names are named by number, counted from 1.

    Parameters
    ----------
    folder : str or Path
        An empty or new folder, because `load_collection` might also read other files in it.
    meshes : sequence of Mesh
        The shapes, with unique names. `load_collection` takes the first name in natural order as
        the reference; to use the first of these meshes, pass it ``reference=meshes[0].name``.
    correspondences : sequence of Correspondence
        Correspondence of each shape with the template.
    suffix : str, default=".off"
        Format of the meshes: .off, .obj, .ply, .glb, .vtk or .vtp. PLY and GLB have single
        precision.

    Returns
    -------
    list of Path
        The files of the meshes.

    Raises
    ------
    ValueError
        If a mesh has no name, two meshes have the same name, a name cannot be used for a file, the
        numbers of meshes and correspondences differ, or the suffix is not supported.
    CorrespondenceError
        If files cannot represent a correspondence: it has soft pairs, no pairs, symmetric answers
        for named points, or several places for one point; or if only some of them have names.
    FileExistsError
        If the folder is not empty.
    FileNotFoundError
        If the parent of the folder does not exist.
    TypeError
        If a mesh is not a `Mesh`, or a correspondence is not a `Correspondence`.

    See Also
    --------
    load_collection : Load a collection from a folder.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from skfmap.datasets import load_collection, make_creatures, save_collection
    >>> creatures = make_creatures(n_shapes=3, n_vertices=500)
    >>> folder = Path(tempfile.mkdtemp()) / "cats"
    >>> paths = save_collection(folder, creatures.meshes, creatures.correspondences)
    >>> [path.name for path in paths]
    ['cat0.off', 'cat1.off', 'cat2.off']
    >>> again = load_collection(folder)
    >>> bool((again.correspondences[1].pairs == creatures.correspondences[1].pairs).all())
    True
    """
    if suffix not in _SUFFIXES:
        raise ValueError(f"suffix must be one of {', '.join(_SUFFIXES)}; got {suffix!r}.")
    if len(meshes) != len(correspondences):
        raise ValueError(
            f"Give one correspondence per mesh; got {len(meshes)} meshes and "
            f"{len(correspondences)} correspondences."
        )
    _check_names(meshes)
    pairs = list(zip(meshes, correspondences, strict=True))
    kept = [_as_kept(mesh, truth) for mesh, truth in pairs]
    if len({isinstance(one, Landmarks) for one in kept}) > 1:
        raise CorrespondenceError(
            "Some correspondences have named or measured points and others numbered points, so "
            "files would not tell which correspond. Give all correspondences of the same kind."
        )
    folder = check_folder(folder)
    folder.mkdir(exist_ok=True)
    if any(path.name[0] != "." for path in folder.iterdir()):
        raise FileExistsError(f"{folder} is not empty; give an empty folder, or a new one.")
    paths = [folder / f"{mesh.name}{suffix}" for mesh in meshes]
    for path, (mesh, truth), one in zip(paths, pairs, kept, strict=True):
        write_mesh(mesh, path)
        _write(one, truth, folder / str(mesh.name))
    return paths


def _check_names(meshes: Sequence[Mesh]) -> None:
    seen: set[str] = set()
    for i, mesh in enumerate(meshes):
        if not isinstance(mesh, Mesh):
            raise TypeError(
                f"meshes[{i}] must be a skfmap.Mesh; got {type(mesh).__name__}. Leave out skipped "
                "shapes and their correspondences."
            )
        name = mesh.name
        if not name or file_stem(name) != name or name[0] == ".":
            raise ValueError(
                f"meshes[{i}] is called {name!r}, which cannot be used as the name of a file. Give "
                f"it another name: Mesh(vertices, faces, name='shape{i}')."
            )
        if name.casefold() in seen:  # some systems ignore case
            raise ValueError(f"Two meshes are called {name!r}; give each mesh its own name.")
        seen.add(name.casefold())


def _as_kept(mesh: Mesh, truth: Correspondence) -> Landmarks | IntArray:
    """Return the landmarks or pairs to write; raise an error if a file cannot represent them."""
    if not isinstance(truth, Correspondence):
        raise TypeError(f"correspondences must be Correspondence; got {type(truth).__name__}.")
    who = label(mesh.name)
    if not len(truth.pairs):
        raise CorrespondenceError(f"{who} has no pairs; leave out it and its correspondence.")
    if truth.weights is not None or truth.symmetric_weights is not None:
        raise CorrespondenceError(
            f"{who} has soft pairs, whose weights cannot be written to these files. Save them with "
            "joblib.dump, or give only the pairs: Correspondence(truth.pairs)."
        )
    for each in (truth.pairs, truth.symmetric_pairs):
        if each is not None:
            check_index_range(each[:, 0], mesh.n_vertices, f"The pairs of {who}")
    by_name = truth.names is not None or truth.places is not None or truth.coordinates is not None
    return _as_landmarks(mesh, truth) if by_name else truth.pairs


def _as_landmarks(mesh: Mesh, truth: Correspondence) -> Landmarks:
    """Return landmarks at the measured points, or, without those, at their places on the mesh."""
    points = truth.pairs[:, 1]
    if len(np.unique(points)) < len(points) or truth.has_symmetric:
        raise CorrespondenceError(
            f"{label(mesh.name)} has points with names or between vertices, and several places for "
            "one of them or symmetric answers, which a landmark file cannot represent. Leave these "
            "out."
        )
    if truth.coordinates is not None:
        at = truth.coordinates
    elif truth.places is not None:
        at = np.einsum("nc,ncd->nd", truth.places.weights, mesh.vertices[truth.places.corners])
    else:
        at = mesh.vertices[truth.pairs[:, 0]]
    names = [str(t + 1) if truth.names is None else truth.names[t] for t in points.tolist()]
    return Landmarks(at, names, name=mesh.name)


def _write(kept: Landmarks | IntArray, truth: Correspondence, stem: Path) -> None:
    if isinstance(kept, Landmarks):
        write_landmarks(kept, stem.with_name(f"{stem.name}.csv"))
        return
    _write_pairs(kept, stem.with_name(f"{stem.name}.txt"))
    if truth.symmetric_pairs is not None:
        _write_pairs(truth.symmetric_pairs, stem.with_name(f"{stem.name}.sym.txt"))


def _write_pairs(pairs: IntArray, path: Path) -> None:
    np.savetxt(path, pairs, fmt="%d", header="vertex, template point", encoding="utf-8")
