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

    The two maps go in opposite directions: ``functional_map`` pulls functions back from S_0 to S_i,
    and ``p2p`` sends vertices of S_i to vertices of S_0.

    Attributes
    ----------
    p2p : ndarray of int, shape (n_vertices_i,)
        Point-to-point map: the vertex of the reference S_0 for each vertex of S_i; -1 where there
        is no match.
    expected_error : ndarray of shape (n_vertices_i,) or None
        Expected geodesic error at each vertex of S_i, in units of sqrt(area) of the reference,
        calibrated on the training shapes. NaN where there is no match; None if the learner
        calibrates no errors (``confidence=None``).
    confidence : ndarray of shape (n_vertices_i,) or None
        Number between 0 and 1: the fraction of similar training vertices that were matched to
        within 0.1 sqrt(area) of their true point.
    functional_map : ndarray of shape (k, k)
        Full map X_i(D), from functions on S_0 to functions on S_i, on unit-area shapes.
    reduced_map : ndarray of shape (k, p)
        Reduced map X_i(D) Y_p.
    name : str or None
        Name of S_i.
    reference_name : str or None
        Name of S_0.
    refined_map : ndarray of shape (n, n) or None
        Functional map in which the last step of the refinement matched points. It has the same
        direction as ``functional_map``.
    n_supporting : ndarray of int, shape (n_vertices_i,)
        Number of stable functions in Y, counted from the most stable, that agree that a vertex and
        its match are the same point.
    matrix : sparse array of shape (n_vertices_i, n_vertices_0)
        Point-to-point map as a matrix whose rows sum to 1. Rows have one entry each, or are
        barycentric or soft on request. The matrix pulls functions on S_0 back to S_i.
    inverse : ndarray of int, shape (n_vertices_0,)
        Point-to-point map in the other direction: the vertex of S_i for each vertex of S_0, found
        in the same embedding.
    reference_hash : str or None
        ``content_hash`` of the mesh of S_0.
    misfit : float
        Mean distance between matched points in the embedding, divided by that of the worst
        training shape when it was left out. Above 1, ``expected_error`` is raised and
        ``confidence`` lowered by its square.
    familiar : bool or None
        Whether the shape is similar to the training shapes. False if an `UnfamiliarShapeWarning`
        named it. None if this is not known, because the learner neither calibrates errors nor
        registers meshes.
    covered : ndarray of bool, shape (n_vertices_0,), or None
        Which vertices of the reference are present on the shape; all of them if it is whole. None
        unless a `skfmap.PartialMatcher` matched it.
    covered_probability : ndarray of shape (n_vertices_0,) or None
        Probability that each vertex of the reference is present on the shape.
    torn : ndarray of bool, shape (n_vertices_i,), or None
        At which vertices of S_i the map tears: where ``p2p`` sends vertices that are neighbours on
        S_i far apart on S_0, as where a hand is glued to a thigh, or where the match is wrong. None
        unless a `skfmap.PartialMatcher` matched it.
    scale : float or None
        Factor that converts the coordinates of the shape to the units of the training shapes, if it
        was estimated (``PartialMatcher(scale="estimated")``).
    given, reference_given : GivenMesh or None
        The given meshes of S_i and S_0, or where to find them again; ``mesh`` and
        ``reference_mesh`` open them.

    Notes
    -----
    A pickle of matches contains their meshes, at about 70 bytes per vertex, which is roughly the
    size of the results themselves. The mesh of the reference is stored once for all matches in a
    list. A mesh that was given as a path and then thinned or mended is stored as that path, and the
    file is read again when it is needed. To leave the meshes out, use
    ``dataclasses.replace(match, given=None, reference_given=None)``.
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
    torn: BoolArray | None = None
    given: GivenMesh | None = None
    reference_given: GivenMesh | None = None
    scale: float | None = None

    @property
    def mesh(self) -> Mesh:
        """The given mesh of S_i; only its sound faces if the mesh is broken.

        Raises
        ------
        MeshError
            If the mesh is not known, or its file has changed since.
        """
        return outlets.open_mesh(self.given, "the mesh of the shape")

    @property
    def reference_mesh(self) -> Mesh:
        """The given mesh of S_0; raises the same errors as ``mesh``."""
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
        """Write the match to a file, or in several formats to a folder.

        ==================  =======================================================================
        ``.csv``            Columns ``vertex, reference_vertex, expected_error, confidence``, for
                            spreadsheets and R. Vertices are counted from 0. Where there is no
                            match, the vertex is -1 and the other columns are blank.
        ``.npz``            All arrays, for `numpy.load`. The matrix is stored as its three parts.
        ``.ply``            The shape in the colours of its match, with the expected error as
                            ``quality`` (MeshLab), and with the expected error, the confidence and
                            the matched vertex as scalars (CloudCompare).
        ``.glb``            The shape in these colours, or with ``uv`` and ``texture``, for Blender.
        ``.vtp``, ``.vtk``  The shape with all arrays at its vertices, for ParaView.
        ``.fcsv``,          ``landmarks`` transferred to the shape, for 3D Slicer.
        ``.mrk.json``
        ==================  =======================================================================

        Parameters
        ----------
        path : str or Path
            A file, whose suffix selects the format; or a folder, which is created if needed and
            gets ``NAME.csv``, ``.npz``, ``.ply``, ``.glb`` and ``.vtp``, and, if landmarks are
            given, ``.fcsv`` and ``.mrk.json``.
        landmarks : Landmarks, optional
            Landmarks of the reference, in the units of its mesh.
        uv : array-like of shape (n_vertices_0, 2), optional
            Texture coordinates of the vertices of the reference. A ``.glb`` file then gets texture
            coordinates, carried over as by `transfer`, instead of colours. Faces of the shape that
            cross a seam of the texture show a strip of it. `skfmap.io.read_uv` reads the
            coordinates of an OBJ file.
        texture : path or PIL image, optional
            Image that ``uv`` refers to.
        overwrite : bool, default=False
            Whether existing files may be replaced.

        Returns
        -------
        list of Path
            The files that were written.

        Raises
        ------
        FileExistsError
            If a file exists and ``overwrite`` is False.
        ValueError
            If the suffix is not supported, the landmarks are missing or lie far from the reference,
            or the mesh cannot be stored in the single precision of ``.glb``.
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
        """Draw the match, coloured by the reference, with its expected error.

        Parameters
        ----------
        interactive : bool, default=False
            Whether to make an interactive page, in which the shapes can be turned, instead of a
            picture. Notebooks display it. It needs plotly (``pip install 'skfmap[pages]'``).
        **options : optional
            Options of `skfmap.plotting.plot_matches`: ``show``, ``errors``, ``camera``, ``align``,
            and, for a picture, ``path``.

        Returns
        -------
        matplotlib Figure or skfmap.plotting.Page
            The picture or the page.
        """
        return outlets.plot_match(self, interactive=interactive, **options)

    def _repr_html_(self) -> str:
        return outlets.html_of(self)

    def transfer(self, values: object, *, max_error: float | None = None) -> Any:
        """Carry a function, labels or texture coordinates from the reference to this shape.

        Floating-point values are interpolated with the weights in ``matrix``. Labels (integers,
        booleans, strings) are decided by a vote with the same weights.

        Parameters
        ----------
        values : array-like of shape (n_vertices_0,) or (n_vertices_0, n_columns)
            Values or labels at the vertices of the reference. Masked entries count as unknown;
            every vertex that depends on one is masked in the result.
        max_error : float, optional
            Vertices with a larger ``expected_error``, in units of sqrt(area), are masked. Vertices
            without a match are always masked.

        Returns
        -------
        numpy.ma.MaskedArray of shape (n_vertices_i,) or (n_vertices_i, n_columns)
            Values at the vertices of S_i. ``.data`` holds all values, ``.mask`` marks those not to
            be trusted, and ``.filled(...)`` replaces them.

        Raises
        ------
        ValueError
            If ``values`` does not have one entry for each vertex of the reference, or the match has
            no matrix.
        TypeError
            If ``values`` holds Python objects other than strings.

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
            raise ValueError("This Match has no matrix; use a match returned by skfmap.match.")
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
        """Return the point-to-point map to another shape that was matched to the same reference.

        The map composes two existing matches at the vertices of the reference.
        `skfmap.match_between` needs the shapes and the model, but is more accurate and returns a
        complete `Match`.

        Parameters
        ----------
        other : Match
            Match of the other shape.

        Returns
        -------
        p2p : ndarray of int, shape (n_vertices_i,)
            Vertex of the other shape for each vertex of this one; -1 where either has no match.
        expected_error : ndarray of shape (n_vertices_i,) or None
            Sum of the expected errors of both matches, in units of sqrt(area). NaN where there is
            no match; None if one of the matches has no expected errors.

        Raises
        ------
        ValueError
            If the two were matched to different references.
        """
        if self.matrix is None or other.matrix is None or other.inverse is None:
            raise ValueError(
                "Both matches need a matrix and an inverse; use matches returned by skfmap.match."
            )
        if self._reference() != other._reference():
            raise ValueError(
                f"Both shapes must be matched to the same reference; got {self.reference_name!r} "
                f"and {other.reference_name!r}."
            )
        p2p = np.append(other.inverse, -1)[self.p2p]  # -1 selects the appended entry
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
        """Return what identifies the reference."""
        return self.reference_name, self.reference_hash, self.matrix.shape[1]

    def _vote(self, labels: Any) -> Any:
        """Return the label with the largest weight at each vertex; ties go to the smallest."""
        kinds, kind_of = np.unique(labels, return_inverse=True)
        members = sp.coo_array(
            (np.ones(len(labels)), (np.arange(len(labels)), kind_of)),
            shape=(len(labels), len(kinds)),
        )
        return kinds[np.asarray((self.matrix @ members.tocsr()).todense()).argmax(axis=1)]

    def __repr__(self) -> str:
        """Return one line with both names, the mean expected error and the unmatched vertices."""
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
    """Return the values to carry over as an array.

    Strings that pandas stores as objects become numpy strings.
    """
    given = as_array(values, "values")
    if given.dtype.kind not in "biufcSUO":
        raise TypeError(f"values must be numbers or labels; got dtype {given.dtype}.")
    if given.dtype.kind == "O":
        if not all(isinstance(value, str) for value in given.ravel()):
            raise TypeError(
                "values holds Python objects; give numbers, or labels that are strings."
            )
        return given.astype(str)
    return given
