"""The two body plans: a common skeleton, with different joints and thicknesses."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skfmap._tools.types import FloatArray

__all__ = ["BODIES", "PARTS", "Body", "Part"]


class Part(NamedTuple):
    """A body segment: a bone that rotates about its start, and the flesh around it.

    Attributes
    ----------
    name : str
        Name of the part.
    parent : str or None
        Name of the part that it is attached to.
    start, end : str
        Joints at its ends.
    blend : float
        Width over which it blends into the parts before it.
    motion : str or None
        Motion that rotates it (see ``_creature_posing``); None if it only follows its parent.
    paired : bool
        Whether there is one on each side; the joints are then those of the side x > 0.
    """

    name: str
    parent: str | None
    start: str
    end: str
    blend: float
    motion: str | None
    paired: bool = False


# All parts and joints are invented; lengths are in centimetres.
PARTS = (
    Part("pelvis", None, "rump", "loin", 2.0, None),
    Part("belly", "pelvis", "loin", "ribs", 3.0, "spine"),
    Part("chest", "belly", "ribs", "withers", 3.0, "spine"),
    Part("neck", "chest", "withers", "nape", 4.0, "neck"),
    Part("nape", "neck", "nape", "skull", 3.0, "neck"),
    Part("head", "nape", "skull", "brow", 2.0, "head"),
    Part("snout", "head", "brow", "nose", 3.0, None),
    Part("ear", "head", "ear_base", "ear_tip", 2.0, None, True),
    Part("thigh", "pelvis", "hip", "knee", 7.0, "thigh", True),
    Part("shin", "thigh", "knee", "hock", 3.0, "shin", True),
    Part("cannon", "shin", "hock", "hind_ankle", 2.0, "cannon", True),
    Part("hind_paw", "cannon", "hind_ankle", "hind_toe", 2.0, None, True),
    Part("arm", "chest", "shoulder", "elbow", 7.0, "arm", True),
    Part("forearm", "arm", "elbow", "wrist", 3.0, "forearm", True),
    Part("pastern", "forearm", "wrist", "fore_ankle", 2.0, "pastern", True),
    Part("fore_paw", "pastern", "fore_ankle", "fore_toe", 2.0, None, True),
    Part("tail1", "pelvis", "tail0", "tail1", 4.0, "dock"),
    Part("tail2", "tail1", "tail1", "tail2", 1.0, "tail"),
    Part("tail3", "tail2", "tail2", "tail3", 1.0, "tail"),
    Part("tail4", "tail3", "tail3", "tail4", 1.0, "tail"),
    Part("tail5", "tail4", "tail4", "tail5", 1.0, "tip"),
    Part("tail6", "tail5", "tail5", "tail6", 1.0, "tip"),
)


@dataclass(frozen=True)
class Body:
    """Dimensions of a creature at rest, in centimetres: x sideways, y forwards, z up.

    Attributes
    ----------
    joints : mapping of str to (x, y, z, radius)
        Position of each joint, and the radius of the body there.
    """

    joints: Mapping[str, tuple[float, float, float, float]]

    @property
    def starts(self) -> FloatArray:
        """Start of each part: rows (x, y, z, radius)."""
        return np.array([self.joints[part.start] for part in PARTS])

    @property
    def ends(self) -> FloatArray:
        """End of each part: rows (x, y, z, radius)."""
        return np.array([self.joints[part.end] for part in PARTS])


_CAT = Body(
    {
        "rump": (0.0, -32.0, 53.0, 15.0),
        "loin": (0.0, -13.0, 54.5, 13.5),
        "ribs": (0.0, 8.0, 54.0, 15.5),
        "withers": (0.0, 27.0, 55.0, 16.0),
        "nape": (0.0, 42.0, 64.0, 11.0),
        "skull": (0.0, 55.0, 73.0, 11.5),
        "brow": (0.0, 61.0, 72.5, 11.0),
        "nose": (0.0, 73.5, 68.0, 5.0),
        "ear_base": (6.5, 54.0, 81.5, 5.0),
        "ear_tip": (11.5, 52.5, 93.0, 2.4),
        "hip": (9.0, -28.0, 48.0, 12.0),
        "knee": (12.5, -20.0, 31.0, 8.0),
        "hock": (12.5, -38.0, 19.0, 4.8),
        "hind_ankle": (12.5, -33.0, 6.0, 4.4),
        "hind_toe": (12.5, -25.0, 4.6, 4.8),
        "shoulder": (9.0, 28.0, 46.0, 10.0),
        "elbow": (11.5, 24.0, 32.0, 6.6),
        "wrist": (11.5, 27.5, 14.0, 4.8),
        "fore_ankle": (11.5, 28.5, 5.5, 4.5),
        "fore_toe": (11.5, 36.5, 4.6, 4.9),
        "tail0": (0.0, -40.0, 60.0, 6.0),
        "tail1": (0.0, -53.0, 63.0, 4.8),
        "tail2": (0.0, -66.0, 64.0, 4.5),
        "tail3": (0.0, -79.0, 65.0, 4.3),
        "tail4": (0.0, -92.0, 67.5, 4.1),
        "tail5": (0.0, -104.0, 72.0, 3.9),
        "tail6": (0.0, -115.0, 79.0, 3.6),
    }
)

_HORSE = Body(
    {
        "rump": (0.0, -40.0, 77.0, 16.5),
        "loin": (0.0, -20.0, 76.0, 15.0),
        "ribs": (0.0, -2.0, 74.0, 16.0),
        "withers": (0.0, 16.0, 75.0, 16.5),
        "nape": (0.0, 38.0, 98.0, 10.0),
        "skull": (0.0, 57.0, 121.0, 7.5),
        "brow": (0.0, 63.0, 117.0, 8.0),
        "nose": (0.0, 79.0, 94.0, 5.4),
        "ear_base": (4.5, 54.5, 126.5, 3.8),
        "ear_tip": (7.0, 53.0, 136.0, 2.2),
        "hip": (9.5, -42.0, 70.0, 12.5),
        "knee": (12.0, -33.0, 52.0, 8.0),
        "hock": (12.0, -51.0, 33.0, 4.7),
        "hind_ankle": (12.0, -47.0, 8.0, 4.1),
        "hind_toe": (12.0, -43.0, 4.6, 4.8),
        "shoulder": (9.5, 20.0, 67.0, 10.5),
        "elbow": (11.5, 15.0, 53.0, 7.0),
        "wrist": (11.5, 17.0, 30.0, 4.6),
        "fore_ankle": (11.5, 16.0, 8.0, 4.1),
        "fore_toe": (11.5, 20.0, 4.6, 4.8),
        "tail0": (0.0, -52.0, 84.0, 5.0),
        "tail1": (0.0, -61.0, 86.0, 4.2),
        "tail2": (0.0, -67.0, 83.5, 4.2),
        "tail3": (0.0, -71.0, 78.5, 4.2),
        "tail4": (0.0, -73.0, 72.5, 4.1),
        "tail5": (0.0, -74.0, 66.0, 3.9),
        "tail6": (0.0, -74.0, 60.0, 3.6),
    }
)

BODIES: Mapping[str, Body] = {"cat": _CAT, "horse": _HORSE}
