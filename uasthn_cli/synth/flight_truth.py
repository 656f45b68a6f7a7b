"""The truth of a rendered flight: ``truth.csv``."""

import csv
import io
import math
from pathlib import Path

import numpy as np

from uasthn_cli.geometry.corners import image_corners_px
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.synth.exposures import Exposure
from uasthn_cli.synth.relief import MEAN_GROUND_AMSL_M, Relief
from uasthn_cli.synth.sight import Sight
from uasthn_cli.types import CameraModel

TRUTH_COLUMNS = (
    *("frame", "lat", "lon", "center_lat", "center_lon", "unix_time_s", "agl_m"),
    *("tl_lat", "tl_lon", "tr_lat", "tr_lon", "bl_lat", "bl_lon", "br_lat", "br_lon"),
)
POSE_COLUMNS = ("alt_amsl_m", "roll_deg", "pitch_deg", "yaw_deg")
"""The camera's height above sea level and its own angles (yaw: that of the image's top)."""


def write_truth(
    path: Path,
    place: LocalFrame,
    camera: CameraModel,
    relief: Relief | None,
    exposures: list[Exposure],
    *,
    with_pose: bool,
) -> None:
    """Write camera, ground point at the centre and ground corners of every frame, on the surface.

    ``with_pose`` adds :data:`POSE_COLUMNS`; flights without errors of the aircraft go without.

    Raises:
        SyntheticFlightError: a frame does not see the ground with all of its corners.
    """
    sight = Sight(camera, relief)
    centre = np.array([[camera.principal_x_px, camera.principal_y_px]])
    points_px = np.concatenate([centre, image_corners_px(camera.width_px, camera.height_px)])
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow((*TRUTH_COLUMNS, *POSE_COLUMNS) if with_pose else TRUTH_COLUMNS)
    for exposure in exposures:
        pose = exposure.pose
        below = np.array([[pose.east_m, pose.north_m]])
        ground_m = 0.0 if relief is None else float(relief.at(below)[0])
        degrees = place.to_degrees(np.concatenate([below, sight.seen_m(exposure, points_px)]))
        cells = [f"{value:.8f}" for value in degrees.ravel()]
        middle = [f"{exposure.time_utc_s:.3f}", f"{pose.height_m - ground_m:.2f}"]
        ends = _pose_cells(exposure) if with_pose else ()
        rows.writerow([exposure.name, *cells[:4], *middle, *cells[4:], *ends])
    path.write_text(text.getvalue(), encoding="utf-8")


def _pose_cells(exposure: Exposure) -> tuple[str, ...]:
    """Return the cells of :data:`POSE_COLUMNS`."""
    attitude = exposure.pose.attitude
    return (
        f"{exposure.pose.height_m + MEAN_GROUND_AMSL_M:.2f}",
        f"{math.degrees(attitude.roll_rad):.4f}",
        f"{math.degrees(attitude.pitch_rad):.4f}",
        f"{math.degrees(attitude.yaw_rad) % 360.0:.4f}",
    )
