"""How far off the camera's position is when its attitude is.

A frame is found by what it shows: the map tells where its centre lies. The camera stands above
another place unless it looks straight down, and how far from it only the attitude says.
"""

import numpy as np

from uasthn_cli.geometry.rotation import rotation_ned_from_body
from uasthn_cli.types import Attitude, FloatArray


def centre_from_camera_m(attitude: Attitude, height_m: float) -> FloatArray:
    """Return metres (east, north) ``(2,)`` from below a camera to where it looks, on flat ground.

    ``attitude`` is the camera's, the top of its image forward.
    """
    axis = rotation_ned_from_body(attitude)[:, 2]
    return np.asarray(axis[[1, 0]] * (height_m / axis[2]))


def camera_per_tilt_m(attitude: Attitude, height_m: float) -> FloatArray:
    """Return metres (east, north) that the camera is moved by a radian of roll, and of pitch.

    ``attitude`` is the camera's, the top of its image forward. The result is ``(2, 2)``, a column
    per angle; angles are small turns about the camera's own axes, to be added to the assumed ones,
    and the ground point at the frame's centre stays where it is. Near straight down a radian of
    roll moves the camera to the image's right by its height, one of pitch to the image's bottom.
    """
    rotation = rotation_ned_from_body(attitude)
    axis = rotation[:, 2]
    turns = np.stack([-rotation[:, 1], rotation[:, 0]], axis=1)  # of the optical axis
    # the centre lies height * axis / axis[2] from the point below the camera
    lever_north_east = (turns[:2] * axis[2] - np.outer(axis[:2], turns[2])) / axis[2] ** 2
    return np.asarray(-height_m * lever_north_east[::-1])


def camera_covariance_m2(
    centre_covariance_m2: FloatArray,
    tilt_covariance_rad2: FloatArray,
    attitude: Attitude,
    height_m: float,
) -> FloatArray:
    """Return the covariance ``(2, 2)`` (east, north) of a camera's position.

    The centre's ``(2, 2)`` and, added to it, what an error of the attitude makes of the camera:
    ``tilt_covariance_rad2`` ``(2, 2)`` is that of roll and pitch about the axes of the camera,
    whose ``attitude`` has the top of its image forward.
    """
    lever = camera_per_tilt_m(attitude, height_m)
    return np.asarray(centre_covariance_m2 + lever @ tilt_covariance_rad2 @ lever.T)
