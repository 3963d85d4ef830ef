"""Camera for pictures of shapes."""

from dataclasses import dataclass

import numpy as np

from skfmap._tools.types import FloatArray
from skfmap._tools.validation import check_choice, check_number

__all__ = ["Camera", "check_camera", "turn_upright"]


@dataclass(frozen=True)
class Camera:
    """Direction from which all shapes of a picture are seen, in parallel projection.

    Parameters
    ----------
    up : {"x", "y", "z"}, default="z"
        Axis of the meshes that points up.
    azimuth : float, default=60
        Rotation about the up axis, in degrees.
    elevation : float, default=20
        Angle above the horizon, in degrees, from -90 to 90.

    Raises
    ------
    TypeError
        If a parameter has the wrong type.
    ValueError
        If a parameter is out of range.

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
            Points in the coordinates of the mesh.

        Returns
        -------
        ndarray of shape (n, 3)
            The same points in camera coordinates.
        """
        return self.project_upright(turn_upright(points, self.up))

    def project_upright(self, points: FloatArray) -> FloatArray:
        """Return camera coordinates of points whose z axis already points up."""
        return np.asarray(points @ self._axes().T)

    def position(self) -> FloatArray:
        """Return the unit vector towards the camera, in upright coordinates (z up)."""
        return self._axes()[2]

    def _axes(self) -> FloatArray:
        turn, lift = np.radians([self.azimuth, self.elevation])
        right = [np.cos(turn), np.sin(turn), 0.0]
        towards = [np.cos(lift) * np.sin(turn), -np.cos(lift) * np.cos(turn), np.sin(lift)]
        return np.array([right, np.cross(towards, right), towards])


def turn_upright(points: FloatArray, up: str) -> FloatArray:
    """Return points rotated so that the axis ``up`` becomes z; handedness is preserved."""
    order = {"z": [0, 1, 2], "y": [2, 0, 1], "x": [1, 2, 0]}[up]
    return np.asarray(points, dtype=np.float64)[..., order]


def check_camera(camera: object) -> Camera:
    """Return the given camera, or the default one for None."""
    if camera is None:
        return Camera()
    if not isinstance(camera, Camera):
        raise TypeError(f"camera must be a Camera, for instance Camera(up='y'); got {camera!r}.")
    return camera
