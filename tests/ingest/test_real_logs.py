"""Real logs and flights: they read, or are refused in one line, and their priors are right."""

import itertools
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from uasthn_cli.config import PriorConfig, TimeBase
from uasthn_cli.errors import LogUnreadableError, NoPositionError, UasthnError
from uasthn_cli.geometry.geodesy import distance_m
from uasthn_cli.ingest.frames import list_frames
from uasthn_cli.ingest.interpolate import linear, make_track
from uasthn_cli.ingest.mavlink import read_telemetry
from uasthn_cli.ingest.priors import PriorSet, build_priors
from uasthn_cli.ingest.timebase import choose_time_base, log_spans_s
from uasthn_cli.types import FrameFile, Prior


def flight_priors(folder: Path) -> PriorSet:
    telemetry = read_telemetry(folder / "flight.tlog")
    return build_priors(telemetry, list_frames(folder / "frames"), config=PriorConfig())


@pytest.mark.parametrize(
    ("name", "positions", "base", "words"),
    [
        ("ardupilot_vtol_sim_2018.tlog", 807, TimeBase.VEHICLE, "differ by"),
        ("brasilia_20211202-132613.tlog", 1043, TimeBase.VEHICLE, "set back"),
        ("nebraska_2013_no_system_time.tlog", 974, TimeBase.RECORD, "no usable SYSTEM_TIME"),
        ("vancouver_2018.tlog", 772, TimeBase.VEHICLE, "differ by"),
    ],
)
def test_real_logs_are_read(
    shared_dir: Path, name: str, positions: int, base: TimeBase, words: str
) -> None:
    telemetry = read_telemetry(shared_dir / "telemetry" / name)
    assert len(telemetry.positions.stamps) == positions
    choice = choose_time_base(telemetry)
    assert choice.base is base
    assert words in choice.why
    assert len(log_spans_s(telemetry, choice.clock)) >= 1


@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        ("brasilia_20211125_no_position.tlog", NoPositionError, "no valid position"),
        ("ardupilot_dataflash_2021.bin", LogUnreadableError, "dataflash"),
        ("px4_small.ulg", LogUnreadableError, "ULog"),
    ],
)
def test_other_real_logs_are_refused_in_one_line(
    shared_dir: Path, name: str, error: type[UasthnError], words: str
) -> None:
    with pytest.raises(error, match=words) as caught:
        read_telemetry(shared_dir / "telemetry" / name)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_log_is_left_out(shared_dir: Path) -> None:
    assert len(list((shared_dir / "telemetry").iterdir())) == 7


def test_the_three_flights_of_one_log_follow_each_other(shared_dir: Path) -> None:
    telemetry = read_telemetry(shared_dir / "telemetry" / "brasilia_20211202-132613.tlog")
    spans = log_spans_s(telemetry, choose_time_base(telemetry).clock)
    assert len(spans) == 3
    assert spans == sorted(spans)
    assert all(later[0] > earlier[1] for earlier, later in itertools.pairwise(spans))


def test_canberra_poses_without_being_told_the_clock(shared_dir: Path) -> None:
    folder = shared_dir / "flights" / "canberra_2018_colour"
    telemetry = read_telemetry(folder / "flight.tlog")
    reference = pd.read_csv(folder / "frames_pose_2018.csv")
    frames = [FrameFile(name, folder / name) for name in reference["file"]]
    found = build_priors(telemetry, frames, config=PriorConfig())
    assert found.time_base.base is TimeBase.RECORD
    assert "100% of the frame times" in found.time_base.why
    assert len(frames) == 18
    for prior, row in zip(found.results, reference.to_dict("records"), strict=True):
        assert isinstance(prior, Prior)
        place, expected = (prior.lat_deg, prior.lon_deg), (row["lat"], row["lon"])
        assert distance_m(np.array(place), np.array(expected)) < 3.0
        angles = (prior.attitude.roll_rad, prior.attitude.pitch_rad, prior.attitude.yaw_rad)
        for angle, field in zip(angles, ("roll_deg", "pitch_deg", "yaw_deg"), strict=True):
            assert abs(math.remainder(math.degrees(angle) - row[field], 360.0)) < 3.0
        # the terrain under the aircraft is a few metres above or below its take-off point
        assert prior.height_source == "terrain_report"
        assert abs(prior.height_above_ground_m - row["relalt_m"]) < 6.0


def test_canberra_heights_above_take_off(shared_dir: Path) -> None:
    folder = shared_dir / "flights" / "canberra_2018_colour"
    telemetry = read_telemetry(folder / "flight.tlog")
    reference = pd.read_csv(folder / "frames_pose_2018.csv")
    clock = choose_time_base(telemetry, TimeBase.AUTO, reference["utc"].to_numpy()).clock
    positions = telemetry.positions
    track = make_track("position", clock, positions.stamps, (positions.height_m,))
    heights_m = [linear(track.bracket(utc_s, 2.0))[0] for utc_s in reference["utc"]]
    np.testing.assert_allclose(heights_m, reference["relalt_m"], atol=0.5)


@pytest.mark.parametrize(
    ("name", "frames", "median_m"), [("farms_bing", 59, 46.8), ("dunes_east", 61, 204.4)]
)
def test_every_frame_of_the_desert_flights_gets_its_prior(
    shared_dir: Path, name: str, frames: int, median_m: float
) -> None:
    folder = shared_dir / "flights" / name
    found = flight_priors(folder)
    truth = pd.read_csv(folder / "truth.csv").set_index("frame")
    priors = [result for result in found.results if isinstance(result, Prior)]
    assert len(priors) == len(found.results) == frames
    true = truth.loc[[prior.frame.name for prior in priors]]
    places = np.array([(prior.lat_deg, prior.lon_deg) for prior in priors])
    errors_m = distance_m(places, true[["lat", "lon"]].to_numpy())
    assert float(np.median(errors_m)) == pytest.approx(median_m, abs=1.0)
    heights = np.array([prior.height_above_ground_m for prior in priors])
    np.testing.assert_allclose(heights / true["agl_m"].to_numpy(), 1.0, atol=0.06)
    times_s = [prior.time_utc_s for prior in priors]
    np.testing.assert_allclose(times_s, true["unix_time_s"].to_numpy(), atol=1e-3)
    turned_deg = np.degrees([prior.attitude.yaw_rad for prior in priors]) - image_top_deg(true)
    assert np.abs((turned_deg + 180.0) % 360.0 - 180.0).max() < 6.0


def image_top_deg(truth: pd.DataFrame) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """Return the bearing from the middle of the bottom edge to that of the top edge."""
    top = truth[["tl_lat", "tl_lon"]].to_numpy() + truth[["tr_lat", "tr_lon"]].to_numpy()
    bottom = truth[["bl_lat", "bl_lon"]].to_numpy() + truth[["br_lat", "br_lon"]].to_numpy()
    north, east = (top - bottom).T
    narrowing = np.cos(np.radians(truth["lat"].to_numpy()))
    return np.asarray(np.degrees(np.arctan2(east * narrowing, north)), dtype=np.float64)
