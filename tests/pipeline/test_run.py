"""A miniature flight whose thermal frames are the map's own grey: the truth must come out."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from posed_flight import (
    HFOV_DEG,
    SEARCH_RADIUS_M,
    SIZE_PX,
    TAKE_OFF_AMSL_M,
    Pose,
    PosedFlight,
    alone,
    corner_pixels,
    degrees,
    ground_m,
    make_posed_flight,
    opened,
    write_log,
)
from small_flight import MAP_CRS, MAP_GSD_M

from uasthn_cli.config import (
    MAX_MAP_ENLARGEMENT,
    THERMAL_WIDTH_PX,
    Aggregation,
    CropTtaConfig,
)
from uasthn_cli.errors import NoPositionError
from uasthn_cli.geometry.geodesy import distance_m, is_geographic
from uasthn_cli.matching.ncc import NccChannel, NccEstimator
from uasthn_cli.outputs.result_json import encode_located
from uasthn_cli.pipeline import Run
from uasthn_cli.types import Fix, FrameResult, Located

CENTER_PX = (np.array(SIZE_PX) - 1.0) / 2.0


@pytest.fixture(scope="module")
def run(flight: PosedFlight) -> Iterator[Run]:
    with opened(flight) as run:
        yield run


@pytest.fixture(scope="module")
def fixes(run: Run) -> list[Fix]:
    results = alone(run)
    return [result for result in results if isinstance(result, Fix)]


def errors_m(fix: Fix, pose: Pose, mount_yaw_deg: float = 0.0) -> dict[str, float]:
    """Return how far camera, centre and the farthest corner are from the truth."""
    pixels = np.vstack([CENTER_PX, corner_pixels()])
    center, *corners = degrees(ground_m(pose, pixels, mount_yaw_deg))
    camera = degrees(np.array([[pose.east_m, pose.south_m]]))[0]
    return {
        "camera": float(distance_m(np.array([fix.lat_deg, fix.lon_deg]), camera)),
        "center": float(distance_m(np.array([fix.center_lat_deg, fix.center_lon_deg]), center)),
        "corners": float(distance_m(fix.corners_deg, np.array(corners)).max()),
    }


def footprint_m(height_m: float) -> float:
    """Return how wide a nadir frame is on the ground."""
    return 2.0 * height_m * math.tan(math.radians(HFOV_DEG) / 2.0)


def encode_all(results: list[FrameResult]) -> list[str]:
    return [encode_located(Located(result, None)) for result in results]


def one_alone(run: Run, name: str) -> FrameResult:
    """Return what one frame gave alone."""
    skipped = {entry.frame.name for entry in run.priors.results} - {name}
    (entry,) = run.locate(skipped)
    return entry.result


def test_every_frame_is_placed_and_accepted(flight: PosedFlight, fixes: list[Fix]) -> None:
    assert [fix.prior.frame.name for fix in fixes] == flight.names
    assert all(fix.accepted and fix.reason is None for fix in fixes)


def test_convention_camera_centre_and_corners_are_found_to_a_map_pixel(
    flight: PosedFlight, fixes: list[Fix]
) -> None:
    for fix, pose in zip(fixes, flight.poses, strict=True):
        errors = errors_m(fix, pose)
        assert max(errors.values()) < MAP_GSD_M, (pose, errors)


def test_convention_the_attitude_is_that_of_the_camera(
    flight: PosedFlight, fixes: list[Fix]
) -> None:
    for fix, pose in zip(fixes, flight.poses, strict=True):
        assert abs(math.remainder(fix.yaw_deg - pose.yaw_deg, 360.0)) < 0.3
        assert 0.0 <= fix.yaw_deg < 360.0
        assert (fix.roll_deg, fix.pitch_deg) == pytest.approx((pose.roll_deg, pose.pitch_deg))


def test_height_and_altitude_are_the_logs(flight: PosedFlight, fixes: list[Fix]) -> None:
    for fix, pose in zip(fixes, flight.poses, strict=True):
        assert fix.height_above_ground_m == pytest.approx(pose.height_m)
        assert fix.alt_amsl_m == pytest.approx(pose.height_m + TAKE_OFF_AMSL_M)


def test_the_camera_is_less_certain_than_the_centre(fixes: list[Fix]) -> None:
    """By a degree of roll and of pitch, which a metre of height turns into 17 mm."""
    for fix in fixes:
        tilt_m2 = (math.radians(1.0) * fix.height_above_ground_m) ** 2
        added_m2 = np.linalg.eigvalsh(fix.camera_covariance_m2 - fix.trust.covariance_m2)
        assert (added_m2 >= 0.999 * tilt_m2).all()
        assert (added_m2 < 1.2 * tilt_m2).all()  # more where the camera looks aside
        assert fix.camera_ce90_m > fix.trust.ce90_m


def test_the_gsd_is_that_of_the_middle_pixel(flight: PosedFlight, fixes: list[Fix]) -> None:
    steps = np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
    for fix, pose in zip(fixes, flight.poses, strict=True):
        right, left, below, above = ground_m(pose, CENTER_PX + steps)
        sides = np.linalg.norm([right - left, below - above], axis=1)
        assert fix.gsd_m == pytest.approx(sides.mean(), rel=0.01)


def test_the_offset_is_the_priors_error(flight: PosedFlight, fixes: list[Fix]) -> None:
    for fix, pose in zip(fixes, flight.poses, strict=True):
        assert fix.offset_m == pytest.approx(math.hypot(*pose.prior_error_m), abs=1.0)


def test_crops_of_a_clear_frame_agree(fixes: list[Fix]) -> None:
    for fix in fixes:
        assert fix.corner_std_m.shape == (4, 2)
        assert fix.corner_std_m.max() < 1.0
        assert 0.0 < fix.uncertainty_m == pytest.approx(fix.corner_std_m.min())


def test_convention_a_camera_mounted_sideways(tmp_path: Path) -> None:
    poses = (Pose(180.0, 170.0, yaw_deg=20.0, pitch_deg=5.0), Pose(205.0, 180.0, yaw_deg=-75.0))
    flight = make_posed_flight(tmp_path, poses, mount_yaw_deg=90.0)
    with opened(flight) as run:
        results = alone(run)
    for fix, pose in zip(results, poses, strict=True):
        assert isinstance(fix, Fix)
        assert max(errors_m(fix, pose, 90.0).values()) < MAP_GSD_M
        top_deg = pose.yaw_deg + 90.0
        assert abs(math.remainder(fix.yaw_deg - top_deg, 360.0)) < 0.3
        # the image's top is the aircraft's right: its nose up is the image rolled
        assert (fix.roll_deg, fix.pitch_deg) == pytest.approx((pose.pitch_deg, 0.0), abs=1e-6)


def test_a_coarser_grid_finds_the_same_places(flight: PosedFlight) -> None:
    with opened(flight, gsd_m=2.0) as run:
        results = alone(run)
    for fix, pose in zip(results, flight.poses, strict=True):
        assert isinstance(fix, Fix)
        assert errors_m(fix, pose)["center"] < 2.0
        assert errors_m(fix, pose)["corners"] < 2.0


def test_the_mean_of_the_views_is_as_good_on_a_clear_frame(flight: PosedFlight) -> None:
    with opened(flight, aggregation=Aggregation.MEAN) as run:
        results = alone(run)
    for fix, pose in zip(results, flight.poses, strict=True):
        assert isinstance(fix, Fix)
        assert errors_m(fix, pose)["center"] < MAP_GSD_M


def test_an_error_beyond_the_search_radius_is_not_found(flight: PosedFlight) -> None:
    with opened(flight, search_radius_m=10.0) as run:
        results = alone(run)
    for fix in results:
        assert isinstance(fix, Fix)
        # 16 px: the window is snapped outward to whole tiles
        assert fix.offset_m <= 10.0 + 16 * MAP_GSD_M


def test_frames_named_in_skip_are_left_out(flight: PosedFlight, run: Run, fixes: list[Fix]) -> None:
    skipped = {flight.names[0], flight.names[3]}
    rest = [entry.result for entry in run.locate(skipped)]
    kept = [fix for fix in fixes if fix.prior.frame.name not in skipped]
    assert encode_all(rest) == encode_all([*kept])
    assert run.names == flight.names


def test_two_runs_give_equal_results(flight: PosedFlight, fixes: list[Fix]) -> None:
    with opened(flight) as again:
        assert encode_all(alone(again)) == encode_all([*fixes])


def test_another_seed_draws_other_crops(flight: PosedFlight, fixes: list[Fix]) -> None:
    with opened(flight, crops=CropTtaConfig(seed=1)) as run:
        other = one_alone(run, flight.names[0])
    assert isinstance(other, Fix)
    assert not np.array_equal(other.corner_std_m, fixes[0].corner_std_m)
    assert np.array_equal(other.corners_deg, fixes[0].corners_deg)


def test_timings_name_the_stages(run: Run, fixes: list[Fix]) -> None:
    assert {"log", "decode", "rectify", "map", "features", "search"} <= set(run.timings)
    assert all(seconds > 0.0 for seconds in run.timings.values())
    assert fixes


def test_a_run_tells_what_was_chosen(run: Run) -> None:
    described = run.describe()
    assert described["estimator"] == "ncc"
    assert described["map_gsd_m"] == pytest.approx(footprint_m(100.0) / THERMAL_WIDTH_PX, rel=0.03)
    assert described["height_source"]
    assert described["time_base"]["why"]
    assert not is_geographic(run.map_crs)
    assert MAP_CRS.removeprefix("EPSG:") in run.map_crs


def test_a_coarse_map_is_enlarged_only_so_far(tmp_path: Path) -> None:
    low = make_posed_flight(tmp_path, (Pose(180.0, 170.0, height_m=40.0),))
    with opened(low) as run:
        found_m = run.describe()["map_gsd_m"]
    assert footprint_m(40.0) / THERMAL_WIDTH_PX < MAP_GSD_M / MAX_MAP_ENLARGEMENT
    assert found_m == pytest.approx(MAP_GSD_M / MAX_MAP_ENLARGEMENT, rel=1e-3)


def test_an_estimator_can_be_given(flight: PosedFlight) -> None:
    with opened(flight, NccEstimator(NccChannel.GRADIENT)) as run:
        assert run.describe()["estimator"] == "ncc-gradient"
        assert run.calibration is None
        fix = one_alone(run, flight.names[0])
    assert isinstance(fix, Fix)
    assert errors_m(fix, flight.poses[0])["center"] < MAP_GSD_M


def test_a_log_of_another_day_ends_the_run(flight: PosedFlight, tmp_path: Path) -> None:
    later = tuple(flight.poses[:1])
    log = tmp_path / "short.tlog"
    write_log(log, later)
    other = PosedFlight(log, tmp_path / "frames", flight.map, later)
    other.frames.mkdir()
    source = flight.frames / flight.names[0]
    (other.frames / "frame_1500000000000.png").write_bytes(source.read_bytes())
    with pytest.raises(NoPositionError, match="no frame has a position"), opened(other):
        pass


def test_the_window_holds_the_search_radius(flight: PosedFlight) -> None:
    """A prior off by almost the radius in any direction is still found."""
    assert math.hypot(14.0, 9.0) < SEARCH_RADIUS_M
    with opened(flight, search_radius_m=18.0) as run:
        results = alone(run)
    for fix, pose in zip(results, flight.poses, strict=True):
        assert isinstance(fix, Fix)
        assert errors_m(fix, pose)["center"] < MAP_GSD_M
