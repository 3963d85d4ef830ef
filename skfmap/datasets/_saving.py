"""Collections written to a folder."""

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

# STL has no vertex numbers that correspondences could count on.
_SUFFIXES = tuple(suffix for suffix in WRITTEN_SUFFIXES if suffix != ".stl")


def save_collection(
    folder: str | Path,
    meshes: Sequence[Mesh],
    correspondences: Sequence[Correspondence],
    *,
    suffix: str = ".off",
) -> list[Path]:
    """Write meshes and their correspondences to a folder that `load_collection` reads again.

    Each mesh becomes ``NAME.off``. Beside it lies ``NAME.txt``, two columns with vertex and
    template point, and ``NAME.sym.txt`` with symmetric answers where they are known; or
    ``NAME.csv`` with a line for each landmark, where points have names or were measured between
    vertices. Measured points without names are called by their number, from 1.

    Parameters
    ----------
    folder : str or Path
        A folder that is empty or not there yet: what already lies there might be read along.
    meshes : sequence of Mesh
        The shapes, each with a name of its own. `load_collection` takes the first in natural order
        as the reference; give it ``reference=meshes[0].name`` for the first of these.
    correspondences : sequence of Correspondence
        Where each lies on the template.
    suffix : str, default=".off"
        Format of the meshes: .off, .obj, .ply, .glb, .vtk or .vtp. PLY and GLB hold single
        precision.

    Returns
    -------
    list of Path
        The files of the meshes.

    Raises
    ------
    ValueError
        If a mesh has no name, two have one, a name cannot be that of a file, there are not as many
        correspondences as meshes, or the suffix is another.
    CorrespondenceError
        If files cannot hold a correspondence: one of soft pairs, without any pair, with a symmetric
        answer for named points, or with several places for one point; or if only some have names.
    FileExistsError
        If there is anything in the folder.
    FileNotFoundError
        If the folder would lie in one that does not exist.
    TypeError
        If a mesh is no `Mesh`, or a correspondence no `Correspondence`.

    See Also
    --------
    load_collection : Read them again.

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
            f"Give a correspondence for each mesh; got {len(meshes)} meshes and "
            f"{len(correspondences)} correspondences."
        )
    _check_names(meshes)
    pairs = list(zip(meshes, correspondences, strict=True))
    kept = [_as_kept(mesh, truth) for mesh, truth in pairs]
    if len({isinstance(one, Landmarks) for one in kept}) > 1:
        raise CorrespondenceError(
            "Some correspondences have points by name or measured points, and others points by "
            "number, so that files would not say which correspond. Give all of them of one kind."
        )
    folder = check_folder(folder)
    folder.mkdir(exist_ok=True)
    if any(path.name[0] != "." for path in folder.iterdir()):
        raise FileExistsError(f"{folder} is not empty; give a folder that is, or a new one.")
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
                f"meshes[{i}] must be a skfmap.Mesh; got {type(mesh).__name__}. Leave out what was "
                "skipped, with its correspondence."
            )
        name = mesh.name
        if not name or file_stem(name) != name or name[0] == ".":
            raise ValueError(
                f"meshes[{i}] is called {name!r}, which cannot be the name of a file; "
                f"Mesh(vertices, faces, name='shape{i}') gives another."
            )
        if name.casefold() in seen:  # as some systems compare
            raise ValueError(f"Two meshes are called {name!r}; give each a name of its own.")
        seen.add(name.casefold())


def _as_kept(mesh: Mesh, truth: Correspondence) -> Landmarks | IntArray:
    """Return what a file is to hold: landmarks, or pairs; raise where none holds it all."""
    if not isinstance(truth, Correspondence):
        raise TypeError(f"Correspondences are saved; got {type(truth).__name__}.")
    who = label(mesh.name)
    if not len(truth.pairs):
        raise CorrespondenceError(f"{who} has no pairs; leave it out, with its correspondence.")
    if truth.weights is not None or truth.symmetric_weights is not None:
        raise CorrespondenceError(
            f"{who} has soft pairs, whose weights no such file holds; keep them by joblib.dump, or "
            "give the pairs alone: Correspondence(truth.pairs)."
        )
    for each in (truth.pairs, truth.symmetric_pairs):
        if each is not None:
            check_index_range(each[:, 0], mesh.n_vertices, f"The pairs of {who}")
    by_name = truth.names is not None or truth.places is not None or truth.coordinates is not None
    return _as_landmarks(mesh, truth) if by_name else truth.pairs


def _as_landmarks(mesh: Mesh, truth: Correspondence) -> Landmarks:
    """Return points with names, where they were measured, or else where they lie on the mesh."""
    points = truth.pairs[:, 1]
    if len(np.unique(points)) < len(points) or truth.has_symmetric:
        raise CorrespondenceError(
            f"{label(mesh.name)} has points by name or between vertices, and several places for "
            "one of them, or symmetric answers, which no file of landmarks holds."
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
