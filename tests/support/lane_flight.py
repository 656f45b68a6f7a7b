"""A flight in lanes whose logged position wanders, what is made of it, and how far off that is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from posed_flight import SIZE_PX, FloatArray, Pose, PosedFlight, corner_pixels, degrees, ground_m

from uasthn_cli.geometry.geodesy import distance_m
from uasthn_cli.pipeline import FusedFlight, Run, drive
from uasthn_cli.types import Fix, FrameResult, Located

LANES, FRAMES_A_LANE = 8, 4
SEARCH_RADIUS_M = 50.0


def lane_poses(drift_m: float = 2.0, lanes: int = LANES) -> tuple[Pose, ...]:
    """Return frames flown east and west in turn; the log's error takes a random step at each."""
    random = np.random.default_rng(4)
    error_m = np.array([14.0, -9.0])
    poses = []
    for lane in range(lanes):
        columns = np.linspace(120.0, 264.0, FRAMES_A_LANE)
        yaw_deg = 90.0 if lane % 2 == 0 else -90.0
        for east_m in columns if lane % 2 == 0 else columns[::-1]:
            wrong_m = (float(error_m[0]), float(error_m[1]))
            south_m = 110.0 + 20.0 * lane
            poses.append(Pose(float(east_m), south_m, yaw_deg=yaw_deg, prior_error_m=wrong_m))
            error_m = error_m + random.normal(0.0, drift_m, 2)
    return tuple(poses)


@dataclass(frozen=True, slots=True)
class Fused:
    """What frames gave alone, the flight they make, and its answers."""

    located: list[Located]
    flight: FusedFlight
    results: list[FrameResult]

    @property
    def fixes(self) -> list[Fix]:
        """Return the flight's answers; every frame must have one."""
        fixes = [result for result in self.results if isinstance(result, Fix)]
        assert len(fixes) == len(self.results)
        return fixes

    @property
    def singles(self) -> list[Fix]:
        """Return each frame's own answer; every frame must have one."""
        fixes = [entry.result for entry in self.located if isinstance(entry.result, Fix)]
        assert len(fixes) == len(self.located)
        return fixes


def fused(run: Run) -> Fused:
    """Take a run through all of its steps."""
    outcome = drive(run)
    assert outcome.flight is not None
    return Fused(list(outcome.located), outcome.flight, outcome.results)


def errors_m(fixes: Sequence[Fix], flight: PosedFlight) -> FloatArray:
    """Return how far camera, centre and the farthest corner are from the truth ``(T, 3)``."""
    pixels = np.vstack([(np.array(SIZE_PX) - 1.0) / 2.0, corner_pixels()])
    errors = []
    for fix, pose in zip(fixes, flight.poses, strict=True):
        center, *corners = degrees(ground_m(pose, pixels, flight.mount_yaw_deg))
        camera = degrees(np.array([[pose.east_m, pose.south_m]]))[0]
        errors.append(
            [
                float(distance_m(np.array([fix.lat_deg, fix.lon_deg]), camera)),
                float(distance_m(np.array([fix.center_lat_deg, fix.center_lon_deg]), center)),
                float(distance_m(fix.corners_deg, np.array(corners)).max()),
            ]
        )
    return np.array(errors)
