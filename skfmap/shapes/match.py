"""A shape matched to the reference."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from skfmap._tools.types import BoolArray, FloatArray, IntArray, SparseMatrix
from skfmap._tools.validation import as_array, check_number, label
from skfmap.shapes import outlets
from skfmap.shapes.given_mesh import GivenMesh
from skfmap.shapes.landmarks import Landmarks
from skfmap.shapes.mesh import Mesh

__all__ = ["Match"]


@dataclass(frozen=True, eq=False, repr=False)
class Match:
    """A shape matched to the reference.

    The two maps point opposite ways: ``functional_map`` pulls functions back from S_0 to S_i,
    ``p2p`` sends points of S_i to S_0.

    Attributes
    ----------
    p2p : ndarray of int, shape (n_vertices_i,)
        Point-to-point map: vertex of the reference S_0 for each vertex of S_i.
    expected_error : ndarray of shape (n_vertices_i,) or None
        Geodesic error to expect at each vertex of S_i, in units of sqrt(area) of the reference, as
        calibrated on the training shapes; NaN where there is no match. None if the learner
        calibrates no errors (``confidence=None``).
    confidence : ndarray of shape (n_vertices_i,) or None
        Between 0 and 1: how often a training vertex that looked like this one landed within 0.1
        sqrt(area).
    functional_map : ndarray of shape (k, k)
        Full map X_i(D), from functions on S_0 to functions on S_i, on unit-area shapes.
    reduced_map : ndarray of shape (k, p)
        X_i(D) Y_p.
    name : str or None
        Name of S_i.
    reference_name : str or None
        Name of S_0.
    refined_map : ndarray of shape (n, n) or None
        The functional map that the last step of the refinement matched points in; it runs as
        ``functional_map`` does.
    n_supporting : ndarray of int, shape (n_vertices_i,)
        How many of the stable functions Y, the most stable first, agree that a vertex and its match
        are one point.
    matrix : sparse array of shape (n_vertices_i, n_vertices_0)
        The point map as a matrix whose rows sum to 1: with one entry each, or barycentric or soft
        if asked. It pulls functions on S_0 back to S_i.
    inverse : ndarray of int, shape (n_vertices_0,)
        Point map of the other direction: vertex of S_i for each vertex of S_0, found in the same
        embedding.
    reference_hash : str or None
        ``content_hash`` of the mesh of S_0.
    misfit : float
        Mean distance between matched points of the embedding, in units of the worst training shape
        that was left out. Beyond 1 ``expected_error`` is raised, and ``confidence`` lowered, by its
        square.
    familiar : bool or None
        Whether the shape is like the training shapes: False where `UnfamiliarShapeWarning` named
        it. None if nothing tells: the learner calibrates no errors, and lays no mesh onto shapes.
    covered : ndarray of bool, shape (n_vertices_0,), or None
        Which vertices of the reference the shape shows; all where it is whole. None unless a
        `skfmap.PartialMatcher` matched it.
    covered_probability : ndarray of shape (n_vertices_0,) or None
        How likely each of them is to be shown.
    scale : float or None
        What the coordinates of the shape have to be multiplied by to be in the units of the
        training shapes, where that was estimated (``PartialMatcher(scale="estimated")``).
    given, reference_given : GivenMesh or None
        The meshes of S_i and S_0, or where they are to be found again; ``mesh`` and
        ``reference_mesh`` open them.

    Notes
    -----
    A pickle of matches holds their meshes, some 70 bytes for each vertex, which is about as much as
    the answers take; that of the reference once for all matches of a list. Of a mesh that was given
    as a path, and thinned or mended, it holds the path alone, and the file is read again when it is
    needed. ``dataclasses.replace(match, given=None, reference_given=None)`` leaves them out.
    """

    p2p: IntArray
    expected_error: FloatArray | None
    confidence: FloatArray | None
    functional_map: FloatArray
    reduced_map: FloatArray
    name: str | None = None
    reference_name: str | None = None
    refined_map: FloatArray | None = None
    n_supporting: IntArray | None = None
    matrix: SparseMatrix | Any = None
    inverse: IntArray | Any = None
    reference_hash: str | None = None
    misfit: float = float("nan")
    familiar: bool | None = None
    covered: BoolArray | None = None
    covered_probability: FloatArray | None = None
    given: GivenMesh | None = None
    reference_given: GivenMesh | None = None
    scale: float | None = None

    @property
    def mesh(self) -> Mesh:
        """The mesh of S_i as it was given; of one that is broken, its sound faces.

        Raises
        ------
        MeshError
            If it is not known, or its file has changed since.
        """
        return outlets.open_mesh(self.given, "the mesh of the shape")

    @property
    def reference_mesh(self) -> Mesh:
        """The mesh of S_0 as it was given; raises as ``mesh`` does."""
        return outlets.open_mesh(self.reference_given, "the mesh of the reference")

    def save(
        self,
        path: str | Path,
        *,
        landmarks: Landmarks | None = None,
        uv: npt.ArrayLike | None = None,
        texture: Any = None,
        overwrite: bool = False,
    ) -> list[Path]:
        """Write the match as other programs read it.

        ==================  =======================================================================
        ``.csv``            Columns ``vertex, reference_vertex, expected_error, confidence``, for
                            spreadsheets and R. Vertices count from 0; -1 and blanks where there is
                            no match.
        ``.npz``            All arrays, for `numpy.load`; the matrix as its three parts.
        ``.ply``            The shape in the colours of its match, with the expected error as
                            ``quality`` (MeshLab), and it, the confidence and the vertex of the
                            reference as scalars (CloudCompare).
        ``.glb``            The shape in these colours, or with ``uv`` and ``texture``, for Blender.
        ``.vtp``, ``.vtk``  The shape with all arrays at its vertices, for ParaView.
        ``.fcsv``,          ``landmarks`` carried to the shape, for 3D Slicer.
        ``.mrk.json``
        ==================  =======================================================================

        Parameters
        ----------
        path : str or Path
            File, whose suffix chooses the format; or a folder, which is made, for ``NAME.csv``,
            ``.npz``, ``.ply``, ``.glb`` and ``.vtp``, and ``.fcsv`` and ``.mrk.json`` if there are
            landmarks.
        landmarks : Landmarks, optional
            Of the reference, in the units of its mesh.
        uv : array-like of shape (n_vertices_0, 2), optional
            Texture coordinates of the reference's vertices, which a ``.glb`` file gets instead of
            colours; `skfmap.io.read_uv` reads those of an OBJ file. They are carried as `transfer`
            does. Faces of the shape that lie across a seam of the texture show a strip of it.
        texture : path or image of PIL, optional
            What ``uv`` looks up.
        overwrite : bool, default=False
            Whether files that are there may be replaced.

        Returns
        -------
        list of Path
            The files that were written.

        Raises
        ------
        FileExistsError
            If there is such a file, and ``overwrite`` is False.
        ValueError
            If the suffix is another, the landmarks are missing or lie far from the reference, or
            single precision, which ``.glb`` has, cannot hold the mesh.
        MeshError
            If a mesh is needed that the match does not know, or that has changed since.

        Examples
        --------
        >>> import tempfile
        >>> from sklearn.pipeline import make_pipeline
        >>> import skfmap
        >>> from skfmap.datasets import make_creatures
        >>> creatures = make_creatures(n_shapes=3, n_vertices=500)
        >>> model = make_pipeline(
        ...     skfmap.SpectralBasis(n_components=20),
        ...     skfmap.DescriptorTransformer(),
        ...     skfmap.WeightedFunctionalMapLearner(n_functions=10, confidence=None),
        ... )
        >>> model = model.fit(creatures.meshes[:2], creatures.correspondences[:2])
        >>> match, = skfmap.match(model, creatures.meshes[2:])
        >>> [path.suffix for path in match.save(tempfile.mkdtemp())]
        ['.csv', '.npz', '.ply', '.glb', '.vtp']
        """
        extras = {"landmarks": landmarks, "uv": uv, "texture": texture}
        return outlets.save_match(self, path, **extras, overwrite=overwrite)

    def plot(self, *, interactive: bool = False, **options: Any) -> Any:
        """Draw the match: colours carried from the reference, and how far to trust them.

        Parameters
        ----------
        interactive : bool, default=False
            Whether it is a page to turn the shapes in, which a notebook shows; plotly draws it
            (``pip install 'skfmap[pages]'``).
        **options : optional
            As in `skfmap.plotting.plot_matches`: ``show``, ``errors``, ``camera``, ``align``, and
            ``path`` for a picture.

        Returns
        -------
        matplotlib Figure or skfmap.plotting.Page
            The picture, or the page.
        """
        return outlets.plot_match(self, interactive=interactive, **options)

    def _repr_html_(self) -> str:
        return outlets.html_of(self)

    def transfer(self, values: object, *, max_error: float | None = None) -> Any:
        """Carry a function, labels or texture coordinates from the reference to this shape.

        Numbers are interpolated as ``matrix`` says. Labels (integers, booleans, strings) are voted
        on with its weights.

        Parameters
        ----------
        values : array-like of shape (n_vertices_0,) or (n_vertices_0, n_columns)
            What the vertices of the reference hold; labels one-dimensional.
            Masked entries are unknown, and mask whatever they would reach.
        max_error : float, optional
            Vertices with a larger ``expected_error``, in units of sqrt(area), are masked, as are
            all without a match.

        Returns
        -------
        numpy.ma.MaskedArray of shape (n_vertices_i,) or (n_vertices_i, n_columns)
            Values at the vertices of S_i. ``.data`` has all of them, ``.mask`` marks those that are
            not trusted, and ``.filled(...)`` replaces them.

        Raises
        ------
        ValueError
            If ``values`` does not have one entry for each vertex of the reference, or the match no
            matrix.
        TypeError
            If ``values`` are Python objects of other kinds than text.

        Examples
        --------
        >>> import numpy as np
        >>> import scipy.sparse as sp
        >>> from skfmap import Match
        >>> C, error = np.eye(1), np.array([0.01, 0.2])
        >>> swapped = sp.csr_array([[0, 1.0], [1, 0]])
        >>> match = Match(np.array([1, 0]), error, 1 - error, C, C, matrix=swapped)
        >>> match.transfer(["head", "tail"], max_error=0.1)
        masked_array(data=['tail', --],
                     mask=[False,  True],
               fill_value='N/A',
                    dtype='<U4')
        """
        if self.matrix is None:
            raise ValueError("This Match holds no matrix; take it from a learner's match.")
        unknown = np.ma.getmaskarray(values) if isinstance(values, np.ma.MaskedArray) else None
        given = _as_values(values.data if isinstance(values, np.ma.MaskedArray) else values)
        n_0 = self.matrix.shape[1]
        if given.ndim not in (1, 2) or len(given) != n_0 or given.size == 0:
            raise ValueError(
                f"values must have one entry or row for each of the {n_0} vertices of the "
                f"reference; got shape {given.shape}."
            )
        if np.issubdtype(given.dtype, np.inexact):
            carried = self.matrix @ given
        elif given.ndim == 2:
            carried = np.stack([self._vote(column) for column in given.T], axis=1)
        else:
            carried = self._vote(given)
        doubtful = self.p2p < 0
        if self.expected_error is not None:
            doubtful = doubtful | np.isnan(self.expected_error)
        if max_error is not None:
            doubtful = doubtful | (
                self._errors_to_expect() > check_number(max_error, "max_error", low=0)
            )
        mask = np.broadcast_to(doubtful.reshape(-1, *[1] * (given.ndim - 1)), carried.shape)
        if unknown is not None:
            mask = mask | (self.matrix @ unknown.astype(np.float64) > 0)
        return np.ma.MaskedArray(carried, mask)

    def to(self, other: "Match") -> tuple[IntArray, FloatArray | None]:
        """Return the point map from this shape to another that was matched to the same reference.

        It goes over the reference's vertices, for two matches at hand. `skfmap.match_between` needs
        the shapes and the model, errs less, and returns all that a match has.

        Parameters
        ----------
        other : Match
            Of the other shape.

        Returns
        -------
        p2p : ndarray of int, shape (n_vertices_i,)
            Vertex of the other shape for each vertex of this one; -1 where either has no match.
        expected_error : ndarray of shape (n_vertices_i,) or None
            Sum of the errors expected on both ways, in units of sqrt(area); NaN where there is no
            match, None if a match has none.

        Raises
        ------
        ValueError
            If the two were matched to different references.
        """
        if self.matrix is None or other.matrix is None or other.inverse is None:
            raise ValueError(
                "Both matches must come from a learner's match, with their matrices and inverses."
            )
        if self._reference() != other._reference():
            raise ValueError(
                f"Both shapes must be matched to one reference; got {self.reference_name!r} and "
                f"{other.reference_name!r}."
            )
        p2p = np.append(other.inverse, -1)[self.p2p]  # what is -1 finds the last
        if self.expected_error is None or other.expected_error is None:
            return p2p, None
        return p2p, self.expected_error + np.append(other.expected_error, np.nan)[p2p]

    def _errors_to_expect(self) -> FloatArray:
        if self.expected_error is None:
            raise ValueError(
                f"The match of {label(self.name, 'shape')} has no expected errors: the learner "
                "was fitted with confidence=None. Fit it with confidence='cross-fit', or leave "
                "max_error out."
            )
        return self.expected_error

    def _reference(self) -> tuple[str | None, str | None, int]:
        """Return what tells references apart."""
        return self.reference_name, self.reference_hash, self.matrix.shape[1]

    def _vote(self, labels: Any) -> Any:
        """Return the label of most weight at each vertex; the first in order among equals."""
        kinds, kind_of = np.unique(labels, return_inverse=True)
        members = sp.coo_array(
            (np.ones(len(labels)), (np.arange(len(labels)), kind_of)),
            shape=(len(labels), len(kinds)),
        )
        return kinds[np.asarray((self.matrix @ members.tocsr()).todense()).argmax(axis=1)]

    def __repr__(self) -> str:
        """Return a line with both names, the mean expected error, and how many have no match."""
        errors = self.expected_error
        known = self.p2p >= 0 if errors is None else ~np.isnan(errors)
        n_known = int(known.sum())
        says = f"{n_known} vertices" if n_known else "no match"
        if errors is not None and n_known:
            says = f"mean expected error {errors[known].mean():.3f} sqrt(area)"
        if 0 < n_known < len(self.p2p):
            says += f", {len(self.p2p) - n_known} of {len(self.p2p)} vertices without a match"
        if self.familiar is False:
            says += ", unlike the training shapes"
        return f"Match({self.name!r} -> {self.reference_name!r}, {says})"


def _as_values(values: object) -> Any:
    """Return what is to be carried as an array.

    Texts that pandas keeps as objects become texts of numpy.
    """
    given = as_array(values, "values")
    if given.dtype.kind not in "biufcSUO":
        raise TypeError(f"values must be numbers or labels; got dtype {given.dtype}.")
    if given.dtype.kind == "O":
        if not all(isinstance(value, str) for value in given.ravel()):
            raise TypeError("values are Python objects; give numbers, or labels that are all text.")
        return given.astype(str)
    return given
