"""What a real aircraft has wrong and a rendered one can have: mount, attitude, relief, lens, clock.

Free of heavy imports.
"""

import math
from dataclasses import dataclass
from typing import Final

from uasthn_cli.errors import SyntheticFlightError

LARGEST_MOUNT_TILT_DEG: Final = 30.0
LARGEST_ATTITUDE_DRIFT_DEG: Final = 20.0
LARGEST_RELIEF_M: Final = 1000.0
STRONGEST_K1: Final = 0.5
LARGEST_CLOCK_ERROR_S: Final = 1e6
LARGEST_LOSS: Final = 0.9


@dataclass(frozen=True, slots=True)
class AircraftErrors:
    """Errors of one aircraft that its log does not know; all of them default to none.

    ``mount_roll_deg``, ``mount_pitch_deg`` and ``mount_yaw_deg`` turn the camera against the
    vehicle: ``R_ned_camera = R_ned_vehicle @ R_mount``, both of
    :func:`~uasthn_cli.geometry.rotation.rotation_ned_from_body`, so that a small pitch of the mount
    adds to the vehicle's. ``attitude_drift_deg`` is how far each of the logged roll, pitch and yaw
    strays at most. ``relief_m`` is the height between the lowest and the highest ground.
    ``lens_k1`` is OpenCV's first radial coefficient. ``clock_late_s`` is what must be added to the
    time in a frame's name, as ``--time-offset`` of ``geotag`` does: 2.5 when a frame of 12:00:02.5
    is named 12:00:00. ``lose_frames`` and ``lose_messages`` are the shares of frames and of the
    log's camera messages that are missing; ``renumber`` names frames by running number.
    """

    mount_roll_deg: float = 0.0
    mount_pitch_deg: float = 0.0
    mount_yaw_deg: float = 0.0
    attitude_drift_deg: float = 0.0
    relief_m: float = 0.0
    lens_k1: float = 0.0
    clock_late_s: float = 0.0
    lose_frames: float = 0.0
    lose_messages: float = 0.0
    renumber: bool = False

    def __post_init__(self) -> None:
        """Refuse what no aircraft has.

        Raises:
            SyntheticFlightError: a value is out of its range; the message says which.
        """
        ranges = {
            "mount roll": (self.mount_roll_deg, -LARGEST_MOUNT_TILT_DEG, LARGEST_MOUNT_TILT_DEG),
            "mount pitch": (self.mount_pitch_deg, -LARGEST_MOUNT_TILT_DEG, LARGEST_MOUNT_TILT_DEG),
            "mount yaw": (self.mount_yaw_deg, -180.0, 180.0),
            "attitude drift": (self.attitude_drift_deg, 0.0, LARGEST_ATTITUDE_DRIFT_DEG),
            "relief": (self.relief_m, 0.0, LARGEST_RELIEF_M),
            "lens k1": (self.lens_k1, -STRONGEST_K1, STRONGEST_K1),
            "clock error": (self.clock_late_s, -LARGEST_CLOCK_ERROR_S, LARGEST_CLOCK_ERROR_S),
            "share of lost frames": (self.lose_frames, 0.0, LARGEST_LOSS),
            "share of lost messages": (self.lose_messages, 0.0, LARGEST_LOSS),
        }
        for name, (value, least, most) in ranges.items():
            if not least <= value <= most:
                raise SyntheticFlightError(f"{name} {value:g}: between {least:g} and {most:g}")
        if self.renumber and self.clock_late_s:
            raise SyntheticFlightError(
                "frames named by number carry no time that a clock could make wrong:"
                " renumber them, or set their clock"
            )

    @property
    def turns_camera(self) -> bool:
        """Whether the camera is not mounted as the log has it."""
        return any((self.mount_roll_deg, self.mount_pitch_deg, self.mount_yaw_deg))

    def lens_folds_at(self) -> float:
        """Return the distance from the axis, in focal lengths, beyond which the lens shows nothing.

        With ``k1 < 0``, ``r (1 + k1 r²)`` has a largest value: no ray arrives farther out.
        """
        if self.lens_k1 >= 0.0:
            return math.inf
        return 2.0 / 3.0 / math.sqrt(-3.0 * self.lens_k1)
