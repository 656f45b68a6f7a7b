"""What a flight taught about its camera and clock, for people and for ``run.json``."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from uasthn_cli.fusion.constants import Constant
from uasthn_cli.fusion.pose_smoother import SmoothedPoses
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.pipeline import FusedFlight


def flight_record(flight: FusedFlight, poses: SmoothedPoses | None = None) -> dict[str, Any]:
    """Return diffusion and constants with their standard errors, ready for ``run.json``."""
    constants = flight.constants
    return {
        "diffusion_m_per_sqrt_s": flight.diffusion_m_per_sqrt_s,
        "mount_yaw_deg": _entry(constants.yaw_rad, math.degrees(1.0)),
        "height_log_scale": _entry(constants.log_scale, 1.0),
        "clock_s": _entry(constants.clock_s, 1.0),
        "poses": None if poses is None else _poses_record(poses),
    }


def flight_lines(
    camera: CameraSpec, flight: FusedFlight, poses: SmoothedPoses | None = None
) -> list[str]:
    """Return a line for each constant that is certain, with the option that states it next time.

    They were corrected in this run already; so were roll and pitch, certain or not.
    """
    mount = [] if poses is None else [_mount_line(camera, poses)]
    return [*_lines(camera, flight), *mount]


def _lines(camera: CameraSpec, flight: FusedFlight) -> Iterator[str]:
    constants = flight.constants
    yaw, scale, clock = constants.yaw_rad, constants.log_scale, constants.clock_s
    if yaw is not None and yaw.is_significant:
        turn_deg, error_deg = math.degrees(yaw.value), math.degrees(yaw.error)
        yield (
            f"Heading is off by {turn_deg:+.2f}° (± {error_deg:.2f}°), corrected;"
            f" next time: --mount-yaw {camera.mount_yaw_deg + turn_deg:.2f}"
        )
    if scale is not None and scale.is_significant:
        percent = 100 * math.expm1(scale.value)
        hint = ""
        if camera.hfov_deg is not None:
            half = math.tan(math.radians(camera.hfov_deg) / 2) * math.exp(scale.value)
            hint = f"; if it is the lens, next time: --hfov {2 * math.degrees(math.atan(half)):.2f}"
        yield (
            f"Height or field of view is off by {percent:+.1f} % (± {100 * scale.error:.1f} %),"
            f" corrected{hint}"
        )
    if clock is not None and clock.is_significant:
        yield (
            f"Frames are stamped {clock.value:+.2f} s (± {clock.error:.2f} s) too early, corrected;"
            f" next time: add {clock.value:+.2f} to --time-offset"
        )


def _mount_line(camera: CameraSpec, poses: SmoothedPoses) -> str:
    """Return what was corrected of roll and pitch, on what evidence, and how to state it."""
    parts, options = [], []
    for word, angle, stated_deg in (
        ("roll", poses.mount_roll_rad, camera.mount_roll_deg),
        ("pitch", poses.mount_pitch_rad, camera.mount_pitch_deg),
    ):
        value_deg, error_deg = math.degrees(angle.value), math.degrees(angle.error)
        parts.append(f"{word} {value_deg:+.2f}° (± {error_deg:.2f}°)")
        if angle.is_significant:
            options.append(f"--mount-{word} {stated_deg + value_deg:.2f}")
    hint = f"; next time: {' '.join(options)}" if options else ""
    places = poses.mount_roll_rad.count
    return (
        f"The camera's mount is off by {', '.join(parts)}, corrected as far as {places} frames'"
        f" places and {poses.frames_with_perspective} frames' perspective tell{hint}"
    )


def _poses_record(poses: SmoothedPoses) -> dict[str, Any]:
    """Return what the camera's attitude rests on: mount and clock, as far as the flight tells."""
    degree = math.degrees(1.0)
    errors_rad = np.sqrt(np.trace(poses.tilt_covariances_rad2, axis1=1, axis2=2) / 2)
    return {
        "mount_roll_deg": _posterior(poses.mount_roll_rad, degree),
        "mount_pitch_deg": _posterior(poses.mount_pitch_rad, degree),
        "clock_s": _posterior(poses.clock_s, 1.0),
        "attitude_error_deg": round(degree * float(np.median(errors_rad)), 6),
        "frames_with_perspective": poses.frames_with_perspective,
    }


def _posterior(constant: Constant, factor: float) -> dict[str, float]:
    """Return mean and deviation after the flight was seen."""
    return {
        "value": round(constant.value * factor, 6),
        "error": round(constant.error * factor, 6),
    }


def _entry(constant: Constant | None, factor: float) -> dict[str, Any] | None:
    if constant is None:
        return None
    return {
        "value": round(constant.value * factor, 6),
        "error": round(constant.error * factor, 6),
        "count": constant.count,
        "corrected": constant.is_significant,
    }
