"""The registered mesh of the reference, and landmarks, on parts."""

import numpy as np

from skfmap._tools.types import BoolArray, FloatArray
from skfmap.functional.neighbours import nearest
from skfmap.geometry.closest import ClosestPoints
from skfmap.geometry.normals import vertex_normals
from skfmap.learner.laid_out import faces_of, with_detail
from skfmap.partial.answers import Knowledge, Part
from skfmap.registration.laying import flipped_faces
from skfmap.shapes import Landmarks, Registered

__all__ = ["landmarks_on_part", "no_landmarks", "not_registered", "registered_on_part"]

# Distance from the scan, in sqrt(area), beyond which a covered vertex lies off it.
_OFF = 0.04


def registered_on_part(known: Knowledge, part: Part, name: str | None) -> Registered:
    """Return the complete given mesh of the reference laid onto a part.

    Parameters
    ----------
    known : Knowledge
        The fitted models.
    part : Part
        The part.
    name : str or None
        Name of the part.
    """
    laid, regions = part.laid, known.body.regions
    covered = known.trust.coverage(laid) >= 0.5
    vertices = with_detail(known.target, laid.vertices)
    deformation, faces = known.body.deformation, regions.faces
    return Registered(
        vertices=vertices * part.unit,
        faces=faces_of(known.target),
        distance=part.unit * ClosestPoints(part.vertices, part.sound).of(vertices).distances,
        n_flipped=int(flipped_faces(deformation, faces, laid.vertices).sum()),
        off=_share_off(known, part, covered),
        uncovered=laid.off,
        stretched=float("nan"),
        fits=known.trust.is_familiar(laid),
        name=name,
        reference_name=known.learner.reference_.name,
        energy=float(deformation.energy(laid.vertices)),
    )


def not_registered(known: Knowledge, name: str | None) -> Registered:
    """Return the result for a scan that cannot be matched, filled with NaN."""
    n_0, nan = known.target.shape.n_given, float("nan")
    return Registered(
        vertices=np.full((n_0, 3), nan),
        faces=faces_of(known.target),
        distance=np.full(n_0, nan),
        n_flipped=0,
        off=nan,
        uncovered=nan,
        stretched=nan,
        fits=False,
        name=name,
        reference_name=known.learner.reference_.name,
    )


def landmarks_on_part(
    known: Knowledge, part: Part, name: str | None, *, on_surface: bool
) -> Landmarks:
    """Return the landmarks on a part, with NaN for those that it does not show.

    Parameters
    ----------
    known, part, name : Knowledge, Part, str or None
        As in `registered_on_part`.
    on_surface : bool
        Whether landmarks that the observer places off the surface are moved onto it.
    """
    model, laid, scan = known.learner.landmarks_, part.laid, part.scan
    points = model.points_on(known.learner.reference_.spectral, laid.vertices, scan.surface)
    if on_surface:
        points = scan.surface.of(points).points
    errors = known.trust.assess(scan, laid)[0][nearest(points, scan.vertices)]
    on_whole = model.expected_errors()
    if on_whole is not None:
        errors = np.fmax(errors, on_whole)
    if not known.trust.is_familiar(laid):
        errors = np.full(len(errors), np.nan)
    shown = np.asarray(model.places @ known.trust.coverage(laid)) >= 0.5
    points, errors = np.where(shown[:, None], points, np.nan), np.where(shown, errors, np.nan)
    return Landmarks(points * part.unit, model.names, name=name, expected_error=errors * part.unit)


def no_landmarks(known: Knowledge, name: str | None) -> Landmarks:
    """Return the result for a scan that cannot be matched, filled with NaN."""
    names = known.learner.landmarks_.names
    unknown = np.full(len(names), np.nan)
    return Landmarks(np.full((len(names), 3), np.nan), names, name=name, expected_error=unknown)


def _share_off(known: Knowledge, part: Part, covered: BoolArray) -> float:
    """Return the fraction of the covered area that lies off the scan."""
    regions, vertices = known.body.regions, part.laid.vertices
    if not covered.any():
        return float("nan")
    near = part.scan.surface.of(vertices[covered])
    normals: FloatArray = vertex_normals(vertices, regions.faces)[covered]
    away = (near.distances > _OFF) | (np.einsum("na,na->n", normals, near.normals) < 0)
    return float(np.average(away, weights=regions.areas[covered]))
