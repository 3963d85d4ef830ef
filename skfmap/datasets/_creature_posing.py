"""Bending of a creature at its joints, and transfer of points between body plans."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from skfmap._tools.types import FloatArray
from skfmap.datasets._creature_body import PARTS, Body
from skfmap.datasets._creature_field import mirror, part_distances, project

__all__ = ["Pose", "bend", "carry", "draw_pose", "draw_sizes"]

# Rotation of each motion on the two sides, of shape (2, 3): about x (pitch), y (roll) and z (yaw),
# in degrees.
Pose = Mapping[str, FloatArray]

# A point also follows parts that are farther than its nearest part by less than this, in
# centimetres; never varied.
_SOFTNESS = 10.0
# Least distance between limbs in centimetres. 93 % of poses of full strength satisfy it; with 0 or
# 3, 96 or 90 % would.
_CLEARANCE = 1.5
# Largest number of poses to draw; the probability that all 100 are rejected is 1e-117.
_ATTEMPTS = 100
# Points along the axis of a part at which its distance to others is measured; never varied.
_N_SAMPLES = 5
# Newton steps to the surface of the other body. Points of the cat start at most 2.5 centimetres
# from that of the horse; after two steps they are 0.0003 away, and after four on it.
_N_STEPS = 6

# Limbs and their side: 0 for x > 0 or the middle, 1 for x < 0.
_TAIL = (("tail3", "tail4", "tail5", "tail6"), 0)
_THIGHS = ((("thigh",), 0), (("thigh",), 1))
_LIMBS = (
    (("shin", "cannon", "hind_paw"), 0),
    (("shin", "cannon", "hind_paw"), 1),
    (("forearm", "pastern", "fore_paw"), 0),
    (("forearm", "pastern", "fore_paw"), 1),
    (("head", "snout"), 0),
    _TAIL,
)
# Pairs of limbs that must keep their distance.
_RIVALS = (*combinations(_LIMBS, 2), *((_TAIL, thigh) for thigh in _THIGHS))

# Smallest and largest pitch, roll and yaw in degrees, for limbs on the side x > 0; invented.
_RANGES: Mapping[str, tuple[tuple[float, float], tuple[float, float], tuple[float, float]]] = {
    "spine": ((-18, 18), (-8, 8), (-20, 20)),
    "neck": ((-22, 20), (-8, 8), (-22, 22)),
    "head": ((-25, 25), (-15, 15), (-30, 30)),
    "thigh": ((-34, 27), (-12, 2), (-6, 6)),
    "shin": ((-40, 22), (0, 0), (0, 0)),
    "cannon": ((-18, 40), (0, 0), (0, 0)),
    "arm": ((-27, 42), (-12, 2), (-6, 6)),
    "forearm": ((-10, 55), (0, 0), (0, 0)),
    "pastern": ((-50, 10), (0, 0), (0, 0)),
    "dock": ((-40, 25), (0, 0), (-25, 25)),
    "tail": ((-28, 20), (0, 0), (-28, 28)),
    "tip": ((-32, 32), (0, 0), (-32, 32)),
}


def draw_pose(body: Body, rng: np.random.Generator, strength: float) -> Pose:
    """Draw a random pose in which limbs do not touch.

    The motions of the two sides are drawn independently.

    Parameters
    ----------
    body : Body
        The body to bend.
    rng : numpy.random.Generator
        Source of the angles, which are uniform in their ranges.
    strength : float
        Factor of the angles; 0 is the rest pose.

    Returns
    -------
    mapping of str to ndarray of shape (2, 3)
        Pitch, roll and yaw of each motion in degrees, on the side x > 0 (or in the middle) and on
        the other side.

    Raises
    ------
    RuntimeError
        If limbs touch in every pose drawn.
    """
    for _ in range(_ATTEMPTS):
        pose = {}
        for name, ranges in _RANGES.items():
            low, high = np.array(ranges, dtype=np.float64).T
            pose[name] = strength * rng.uniform(low, high, size=(2, 3))
        if _limbs_clear(body, pose):
            return pose
    raise RuntimeError(
        f"Limbs touch in all of {_ATTEMPTS} random poses. Lower pose_strength, or try another "
        "random_state."
    )


def draw_sizes(rng: np.random.Generator, variation: float) -> FloatArray:
    """Draw random scale factors of the parts, the same on both sides.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of the factors, which are uniform.
    variation : float
        Largest difference of a factor from 1.

    Returns
    -------
    ndarray of shape (n_parts,)
        Scale factor of each part in ``PARTS``.
    """
    return 1.0 + variation * rng.uniform(-1.0, 1.0, size=len(PARTS))


def bend(body: Body, points: FloatArray, pose: Pose, sizes: FloatArray) -> FloatArray:
    """Bend a creature into a pose; each point follows the parts near to it.

    Parameters
    ----------
    body : Body
        The body at rest.
    points : ndarray of shape (n, 3)
        Points on the body.
    pose : mapping of str to ndarray of shape (2, 3)
        Pitch, roll and yaw of each motion in degrees, on the two sides.
    sizes : ndarray of shape (n_parts,)
        Scale factor of each part, about its start.

    Returns
    -------
    ndarray of shape (n, 3)
        The points in the pose.
    """
    weights = _weights(body, points)
    moved = np.zeros_like(points)
    for side in (0, 1):
        for weight, (linear, shift) in zip(
            weights[side], _motions(body, pose, sizes, side), strict=True
        ):
            moved += weight[:, None] * (points @ linear.T + shift)
    return moved


def carry(source: Body, target: Body, points: FloatArray) -> FloatArray:
    """Transfer points from the surface of one body plan to that of another, part by part.

    Parameters
    ----------
    source, target : Body
        The two bodies at rest.
    points : ndarray of shape (n, 3)
        Points on the surface of ``source``.

    Returns
    -------
    ndarray of shape (n, 3)
        Points on the surface of ``target``, at the same fraction of the length of corresponding
        parts and in the same direction from their axes.
    """
    moved = np.zeros_like(points)
    ends = list(zip(source.starts, source.ends, target.starts, target.ends, strict=True))
    own, opposite = _weights(source, points)
    for part, weight, mirrored_weight in zip(ends, own, opposite, strict=True):
        moved += weight[:, None] * _carry_along(points, *part)
        moved += mirrored_weight[:, None] * mirror(_carry_along(mirror(points), *part))
    return project(target, moved, n_steps=_N_STEPS)


def _weights(body: Body, points: FloatArray) -> FloatArray:
    """Return the weight of each part on each side for each point, of shape (2, n_parts, n)."""
    sides = np.stack([part_distances(body, points), part_distances(body, mirror(points))])
    sides[1, [not part.paired for part in PARTS]] = np.inf
    excess = sides - sides.min(axis=(0, 1))
    raw = np.maximum(1.0 - excess / _SOFTNESS, 0.0) ** 2
    return np.asarray(raw / raw.sum(axis=(0, 1)))


def _motions(
    body: Body, pose: Pose, sizes: FloatArray, side: int
) -> list[tuple[FloatArray, FloatArray]]:
    """Return the motion (linear part, shift) of each part on side 0 (x > 0) or side 1."""
    turns: dict[str | None, FloatArray] = {None: np.eye(3)}
    motions: dict[str | None, tuple[FloatArray, FloatArray]] = {None: (np.eye(3), np.zeros(3))}
    for part, size in zip(PARTS, sizes, strict=True):
        mirrored = side == 1 and part.paired
        turn = turns[part.parent]
        if part.motion is not None:
            turn = turn @ _turn(pose[part.motion][side if part.paired else 0], mirrored)
        joint = np.array(body.joints[part.start][:3])
        pivot = mirror(joint) if mirrored else joint
        linear, shift = motions[part.parent]
        turns[part.name] = turn
        motions[part.name] = size * turn, linear @ pivot + shift - size * turn @ pivot
    return [motions[part.name] for part in PARTS]


def _limbs_clear(body: Body, pose: Pose) -> bool:
    """Return whether legs, head and tail keep their distance from each other."""
    motions = [_motions(body, pose, np.ones(len(PARTS)), side) for side in (0, 1)]
    for first, second in _RIVALS:
        a, b = (_limb(body, motions[side], names, side) for names, side in (first, second))
        if (cdist(a[:, :3], b[:, :3]) - a[:, None, 3] - b[:, 3]).min() < _CLEARANCE:
            return False
    return True


def _limb(
    body: Body, motions: list[tuple[FloatArray, FloatArray]], names: tuple[str, ...], side: int
) -> FloatArray:
    """Return points along the axis of a bent limb: rows (x, y, z, radius)."""
    rows = []
    for part, (linear, shift), start, end in zip(
        PARTS, motions, body.starts, body.ends, strict=True
    ):
        if part.name in names:
            axis = start + np.linspace(0.0, 1.0, _N_SAMPLES)[:, None] * (end - start)
            centres = mirror(axis[:, :3]) if side == 1 and part.paired else axis[:, :3]
            rows.append(np.column_stack([centres @ linear.T + shift, axis[:, 3]]))
    return np.concatenate(rows)


def _turn(angles: FloatArray, mirrored: bool) -> FloatArray:
    pitch, roll, yaw = angles * [1.0, -1.0, -1.0] if mirrored else angles
    return np.asarray(Rotation.from_euler("xyz", [pitch, roll, yaw], degrees=True).as_matrix())


def _carry_along(
    points: FloatArray,
    start: FloatArray,
    end: FloatArray,
    new_start: FloatArray,
    new_end: FloatArray,
) -> FloatArray:
    """Map points around one part to points around another, scaling length and thickness."""
    axis, new_axis = end - start, new_end - new_start
    length, new_length = np.linalg.norm(axis[:3]), np.linalg.norm(new_axis[:3])
    local = (points - start[:3]) @ _frame(axis[:3]).T
    along = np.clip(local[:, 0] / length, 0.0, 1.0)
    thicker = (new_start[3] + along * new_axis[3]) / (start[3] + along * axis[3])
    local[:, 0] -= along * length
    local *= thicker[:, None]
    local[:, 0] += along * new_length
    return np.asarray(new_start[:3] + local @ _frame(new_axis[:3]))


def _frame(axis: FloatArray) -> FloatArray:
    """Return an orthonormal frame as rows: the axis, x made orthogonal to it, and their product."""
    along = axis / np.linalg.norm(axis)
    sideways = np.array([1.0, 0.0, 0.0]) - along[0] * along
    sideways /= np.linalg.norm(sideways)
    return np.array([along, sideways, np.cross(along, sideways)])
