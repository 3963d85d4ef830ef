"""Where pictures of shapes are taken from."""

from dataclasses import dataclass

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import check_choice, check_number

__all__ = ["Camera", "check_camera", "turn_upright"]


@dataclass(frozen=True)
class Camera:
    """A camera far away, the same for all shapes of a picture.

    Parameters
    ----------
    up : {"x", "y", "z"}, default="z"
        Which axis of the meshes points up.
    azimuth : float, default=60
        Rotation about the up axis, in degrees.
    elevation : float, default=20
        Height above the ground, in degrees, from -90 to 90.

    Raises
    ------
    TypeError, ValueError
        If a parameter is of the wrong type or out of its range.

    Examples
    --------
    >>> from skfmap.plotting import Camera
    >>> Camera(azimuth=0, elevation=0).project([[1.0, 2.0, 3.0]]).tolist()  # from -y, z up
    [[1.0, 3.0, -2.0]]
    """

    up: str = "z"
    azimuth: float = 60.0
    elevation: float = 20.0

    def __post_init__(self) -> None:
        check_choice(self.up, "up", ("x", "y", "z"))
        check_number(self.azimuth, "azimuth", low=-np.inf)
        check_number(self.elevation, "elevation", low=-90, high=90)

    def project(self, points: FloatArray) -> FloatArray:
        """Return coordinates to the right, up, and towards the camera.

        Parameters
        ----------
        points : ndarray of shape (n, 3)
            Points of a mesh.

        Returns
        -------
        ndarray of shape (n, 3)
            The same points as the camera sees them.
        """
        return self.project_upright(turn_upright(points, self.up))

    def project_upright(self, points: FloatArray) -> FloatArray:
        """Return the same for points whose z is up already."""
        return np.asarray(points @ self._axes().T)

    def position(self) -> FloatArray:
        """Return the direction in which the camera lies, in upright coordinates (z up)."""
        return self._axes()[2]

    def _axes(self) -> FloatArray:
        turn, lift = np.radians([self.azimuth, self.elevation])
        right = [np.cos(turn), np.sin(turn), 0.0]
        towards = [np.cos(lift) * np.sin(turn), -np.cos(lift) * np.cos(turn), np.sin(lift)]
        return np.array([right, np.cross(towards, right), towards])


def turn_upright(points: FloatArray, up: str) -> FloatArray:
    """Return points with the axis that pointed up as z; a rotation, so that left stays left."""
    order = {"z": [0, 1, 2], "y": [2, 0, 1], "x": [1, 2, 0]}[up]
    return np.asarray(points, dtype=np.float64)[..., order]


def check_camera(camera: object) -> Camera:
    """Return a camera, the usual one if none is given."""
    if camera is None:
        return Camera()
    if not isinstance(camera, Camera):
        raise TypeError(f"camera must be a Camera: Camera(up='y'), for instance; got {camera!r}.")
    return camera
