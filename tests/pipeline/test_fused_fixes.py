"""Support by neighbours, and a place straight from geometry against rays traced one by one."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from posed_flight import HFOV_DEG, SIZE_PX, Pose, corner_pixels, degrees, ground_m

from uasthn_cli.fusion.constants import FlightConstants
from uasthn_cli.fusion.offsets import OffsetGrid
from uasthn_cli.geometry.geodesy import LocalFrame, distance_m
from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.pipeline.flight_stage import FusedFlight, moved_prior
from uasthn_cli.pipeline.fused_fixes import fused_offsets_m, place_from_geometry, support_of
from uasthn_cli.types import Attitude, FrameFile, OffsetLikelihood, Prior


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=40))
def test_support_is_the_mean_backing_of_the_25_nearest_frames(backing: list[float]) -> None:
    found = support_of(np.array(backing))
    for index, share in enumerate(found):
        start = min(max(0, index - 12), max(0, len(backing) - 25))
        near = backing[start : start + 25]
        assert share == pytest.approx(sum(near) / len(near))


def prior_of(pose: Pose) -> Prior:
    lat_deg, lon_deg = degrees(np.array([[pose.east_m, pose.south_m]]))[0]
    angles = (math.radians(angle) for angle in (pose.roll_deg, pose.pitch_deg, pose.yaw_deg))
    frame = FrameFile("a.png", Path("a.png"))
    return Prior(frame, 0.0, lat_deg, lon_deg, pose.height_m, Attitude(*angles), "relative_alt")


@pytest.mark.parametrize("mount_yaw_deg", [0.0, 90.0])
@pytest.mark.parametrize(
    "pose",
    [
        Pose(180.0, 150.0),
        Pose(210.0, 170.0, 90.0, yaw_deg=70.0),
        Pose(190.0, 160.0, 110.0, roll_deg=9.0, pitch_deg=-6.0, yaw_deg=-130.0),
    ],
)
def test_convention_a_right_prior_gives_the_right_place(pose: Pose, mount_yaw_deg: float) -> None:
    camera = CameraSpec(hfov_deg=HFOV_DEG, mount_yaw_deg=mount_yaw_deg).model(*SIZE_PX)
    prior = prior_of(pose)
    local = LocalFrame(prior.lat_deg - 0.003, prior.lon_deg + 0.004)
    placed = place_from_geometry(camera, prior, local).in_degrees(local)
    pixels = np.vstack([(np.array(SIZE_PX) - 1.0) / 2.0, corner_pixels()])
    expected = degrees(ground_m(pose, pixels, mount_yaw_deg))
    assert distance_m(placed[1:], expected).max() < 0.1  # local metres, not the map's
    assert float(distance_m(placed[0], np.array([prior.lat_deg, prior.lon_deg]))) < 1e-3


PRIOR = prior_of(Pose(180.0, 150.0))
LOCAL = LocalFrame(PRIOR.lat_deg, PRIOR.lon_deg)


@given(east_m=st.floats(-300, 300), north_m=st.floats(-300, 300))
def test_convention_a_prior_moves_east_and_north(east_m: float, north_m: float) -> None:
    prior, local = PRIOR, LOCAL
    moved = moved_prior(prior, np.array([east_m, north_m]), local)
    found = local.to_metres(np.array([moved.lat_deg, moved.lon_deg]))
    assert found == pytest.approx([east_m, north_m], abs=1e-3)
    assert moved.frame == prior.frame
    assert moved.attitude == prior.attitude


def hill(grid: OffsetGrid, column: int, centre_m: tuple[float, float]) -> OffsetLikelihood:
    steps = np.arange(grid.size)
    values = -0.5 * ((steps[None, :] - column) ** 2 + (steps[:, None] - grid.half) ** 2) / 4.0
    return OffsetLikelihood.of(values, grid.cell_m, np.array(centre_m))


WIDE, NEAR = OffsetGrid(20, 4.0), OffsetGrid(12, 0.5)


def flight_of(*offsets_m: tuple[float, float]) -> FusedFlight:
    posterior = np.exp(hill(WIDE, WIDE.half, (0.0, 0.0)).log_likelihood)
    return FusedFlight(
        frames=(),
        times_s=np.arange(float(len(offsets_m))),
        offsets_m=np.array(offsets_m),
        posteriors=[posterior / posterior.sum()] * len(offsets_m),
        grid=WIDE,
        diffusion_m_per_sqrt_s=0.5,
        constants=FlightConstants(),
        corrected_priors=(),
    )


def test_the_second_look_moves_a_frame_within_its_cell() -> None:
    flight = flight_of((8.0, 4.0), (8.0, 4.0))
    refined = [hill(NEAR, NEAR.half + 3, (8.0, 4.0)), hill(NEAR, NEAR.half + 3, (8.0, 4.0))]
    offsets_m, covariances_m2 = fused_offsets_m(flight, refined, NEAR)
    assert offsets_m == pytest.approx(np.array([[9.5, 4.0]] * 2), abs=0.1)
    assert np.sqrt(covariances_m2[:, 0, 0]).max() < 1.5


def test_a_frame_that_shows_nothing_near_follows_its_neighbours_and_is_less_sure() -> None:
    flight = flight_of(*[(8.0, 4.0)] * 3)
    seen = hill(NEAR, NEAR.half + 3, (8.0, 4.0))
    offsets_m, covariances_m2 = fused_offsets_m(flight, [seen, None, seen], NEAR)
    assert offsets_m[1] == pytest.approx([9.5, 4.0], abs=0.2)
    spread = np.trace(covariances_m2, axis1=1, axis2=2)
    assert spread[1] > spread[0]


def test_without_any_second_look_the_first_fusion_stands() -> None:
    flight = flight_of((0.0, 0.0), (0.0, 0.0))
    offsets_m, covariances_m2 = fused_offsets_m(flight, [None, None], NEAR)
    assert offsets_m.tolist() == flight.offsets_m.tolist()
    # two cells of 4 m per axis, and the cell's own variance
    assert covariances_m2[0] == pytest.approx(np.eye(2) * (64.0 + 16 / 12), rel=0.1)
