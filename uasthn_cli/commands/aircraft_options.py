"""Options of ``synth`` for what real aircraft have wrong; all of it is off by default."""

from typing import Any, Final

from uasthn_cli.commands.options import gathered
from uasthn_cli.commands.parameter_types import FiniteRange
from uasthn_cli.commands.sections import section_option
from uasthn_cli.synth.aircraft_errors import (
    LARGEST_ATTITUDE_DRIFT_DEG,
    LARGEST_CLOCK_ERROR_S,
    LARGEST_LOSS,
    LARGEST_MOUNT_TILT_DEG,
    LARGEST_RELIEF_M,
    STRONGEST_K1,
    AircraftErrors,
)

_NONE: Final = AircraftErrors()

_error_option = section_option("Aircraft: what its log does not know (all off by default)")


def _number(flag: str, field: str, limits: tuple[float, float], metavar: str, help: str) -> Any:
    """Return an option for a number whose default is that of the field."""
    return _error_option(
        flag,
        field,
        type=FiniteRange(*limits),
        default=getattr(_NONE, field),
        show_default=True,
        metavar=metavar,
        help=help,
    )


_TILT: Final = (-LARGEST_MOUNT_TILT_DEG, LARGEST_MOUNT_TILT_DEG)

aircraft_options: Final = gathered(
    "errors",
    AircraftErrors,
    _number(
        "--mount-roll",
        "mount_roll_deg",
        _TILT,
        "DEG",
        "The camera's mount is turned against the vehicle; a small roll adds to the vehicle's.",
    ),
    _number(
        "--mount-pitch", "mount_pitch_deg", _TILT, "DEG", "Likewise; adds to the vehicle's pitch."
    ),
    _number(
        "--mount-yaw",
        "mount_yaw_deg",
        (-180.0, 180.0),
        "DEG",
        "Likewise, about the down axis, clockwise seen from above.",
    ),
    _number(
        "--attitude-drift-deg",
        "attitude_drift_deg",
        (0.0, LARGEST_ATTITUDE_DRIFT_DEG),
        "DEG",
        "The farthest that each of logged roll, pitch and yaw strays, within about a minute.",
    ),
    _number(
        "--relief-m",
        "relief_m",
        (0.0, LARGEST_RELIEF_M),
        "M",
        "Ground that rises and falls by so much in all, under a level flight; its heights are in"
        " dem.tif.",
    ),
    _number(
        "--lens-k1",
        "lens_k1",
        (-STRONGEST_K1, STRONGEST_K1),
        "K",
        "Radial distortion of the lens, OpenCV's k1; below 0 is barrel.",
    ),
    _number(
        "--clock-late-s",
        "clock_late_s",
        (-LARGEST_CLOCK_ERROR_S, LARGEST_CLOCK_ERROR_S),
        "S",
        "How late the camera's clock is: a frame taken at 12:00:02.5 is named 12:00:00 with 2.5,"
        " which is also what geotag's --time-offset must add.",
    ),
    _number(
        "--lose-frames",
        "lose_frames",
        (0.0, LARGEST_LOSS),
        "SHARE",
        "Share of the frames that are missing, at random.",
    ),
    _number(
        "--lose-messages",
        "lose_messages",
        (0.0, LARGEST_LOSS),
        "SHARE",
        "Share of the log's camera messages that are missing, at random.",
    ),
    _error_option(
        "--renumber",
        is_flag=True,
        help="Name frames frame_0001.png, frame_0002.png … instead of by time.",
    ),
)
