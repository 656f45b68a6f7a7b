"""Heights over an elevation model: above the footprint's ground, by the datum that evidence has."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from uasthn_cli.config import DemDatum
from uasthn_cli.errors import MapElsewhereError, NoPositionError
from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.geometry.surface import FlatGround, Relief, Surface
from uasthn_cli.ingest.height import Start
from uasthn_cli.pipeline import open_ground
from uasthn_cli.pipeline.fused_fixes import place_from_geometry, place_over_surface
from uasthn_cli.pipeline.ground import Datum, Ground
from uasthn_cli.pipeline.open_ground import Evidence, choose_datums
from uasthn_cli.types import Attitude, CameraModel, FrameFile, Prior

LOCAL = LocalFrame(24.0, 56.2)
CAMERA = CameraModel(320, 256, 400.0, 400.0, 159.5, 127.5)
PRIOR = Prior(
    frame=FrameFile("a.png", Path("a.png")),
    time_utc_s=0.0,
    lat_deg=24.0,
    lon_deg=56.2,
    height_above_ground_m=200.0,
    attitude=Attitude(0.05, -0.08, 0.6),
    height_source="relative_alt",
    alt_amsl_m=330.0,
    above_start_m=200.0,
)
TAKE_OFF = Datum(DemDatum.TAKE_OFF, 120.0, "heights above take-off")
METRES = np.arange(-500.0, 501.0, 10.0)


def ground(surface: Surface, datum: Datum = TAKE_OFF) -> Ground:
    return Ground(Path("dem.tif"), surface, LOCAL, CAMERA, datum)


def ridge(height_m: float = 40.0, width_m: float = 40.0) -> Relief:
    """Return a ridge along north below the camera, on ground of 90 m."""
    profile = 90.0 + height_m * np.exp(-((METRES / width_m) ** 2))
    return Relief(np.tile(profile, (METRES.size, 1)), -500.0, 500.0, 10.0)


@pytest.mark.parametrize(
    ("datum", "altitude_m"),
    [(TAKE_OFF, 320.0), (Datum(DemDatum.AMSL, 0.0, ""), 330.0)],
    ids=["take-off", "amsl"],
)
def test_height_counts_from_the_mean_ground_of_the_footprint(
    datum: Datum, altitude_m: float
) -> None:
    settled = ground(ridge(), datum).settled(PRIOR)
    assert settled.ground_m is not None
    assert 95.0 < settled.ground_m < 125.0  # neither the valley's height nor the ridge's
    assert settled.ground_m + settled.height_above_ground_m == pytest.approx(altitude_m)
    assert settled.height_source == "dem"


def test_where_nothing_is_known_the_log_s_height_stands() -> None:
    nothing = Relief(np.full((3, 3), np.nan), -10.0, 10.0, 10.0)
    assert ground(nothing).settled(PRIOR) == PRIOR
    assert ground(nothing).over(CAMERA, PRIOR) is None
    unknown = replace(PRIOR, above_start_m=math.nan)
    assert ground(ridge()).settled(unknown).ground_m is None


def test_settling_again_elsewhere_keeps_the_altitude() -> None:
    hills = ground(ridge())
    first = hills.settled(PRIOR)
    moved = hills.settled(replace(first, lon_deg=56.2015))
    assert first.ground_m is not None and moved.ground_m is not None
    assert moved.ground_m < first.ground_m
    altitudes_m = [p.ground_m + p.height_above_ground_m for p in (first, moved) if p.ground_m]
    assert altitudes_m == pytest.approx([320.0, 320.0])


def test_over_a_flat_model_a_frame_lies_where_flat_ground_has_it() -> None:
    flat = ground(FlatGround(120.0))
    settled = flat.settled(PRIOR)
    over = flat.over(CAMERA, settled)
    assert over is not None
    placed, expected = (
        place_over_surface(over, settled, LOCAL),
        place_from_geometry(CAMERA, PRIOR, LOCAL),
    )
    assert placed.corners_m == pytest.approx(expected.corners_m, abs=1e-4)
    assert placed.center_m == pytest.approx(expected.center_m, abs=1e-4)
    assert placed.camera_m == pytest.approx(expected.camera_m)
    assert placed.gsd_m == pytest.approx(expected.gsd_m)


def test_corners_lie_on_the_surface() -> None:
    hills = ground(ridge(width_m=150.0))
    settled = hills.settled(replace(PRIOR, attitude=Attitude(0.0, 0.0, 0.0)))
    over = hills.over(CAMERA, settled)
    assert over is not None
    placed = place_over_surface(over, settled, LOCAL)
    heights_m = 320.0 - hills.surface.heights_m(placed.corners_m)
    half_width_m = np.abs(placed.corners_m[:, 0])
    assert half_width_m == pytest.approx(heights_m * 159.5 / 400.0, abs=1e-3)


def test_a_frame_is_on_the_ground_by_the_model_not_by_the_height_above_take_off() -> None:
    valley, hill = replace(PRIOR, above_start_m=-20.0), replace(PRIOR, above_start_m=-29.5)
    priors = SimpleNamespace(results=[valley, hill])
    low = ground(FlatGround(90.0))
    seen, grounded = low.settled_results(priors)  # type: ignore[arg-type]
    assert isinstance(seen, Prior)
    assert seen.height_above_ground_m == pytest.approx(10.0)
    assert "on the ground: 0.5 m above it by dem" in getattr(grounded, "detail", "")


START = Start(24.0, 56.2, 0.4, 118.0, is_assumed=False)


def evidence(start: Start = START, *, has_amsl: bool = True) -> Evidence:
    return Evidence(Path("dem.tif"), start, has_amsl, flight_m=101.0)


@pytest.fixture
def height_at_take_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the model have 120 m at take-off."""
    monkeypatch.setattr(open_ground, "_height_at_m", lambda _path, _start: 120.0)


@pytest.mark.usefixtures("height_at_take_off")
@pytest.mark.parametrize(
    ("asked", "start", "expected"),
    [
        (DemDatum.AUTO, START, ["take-off"]),
        (DemDatum.AUTO, replace(START, height_m=260.0), ["amsl", "flight"]),
        (DemDatum.AUTO, replace(START, is_assumed=True), ["take-off"]),
        (DemDatum.AUTO, replace(START, is_assumed=True, ground_amsl_m=380.0), ["amsl", "flight"]),
        (DemDatum.TAKE_OFF, START, ["take-off"]),
        (DemDatum.AMSL, START, ["amsl"]),
        (DemDatum.FLIGHT, START, ["flight"]),
    ],
)
def test_take_off_comes_first_where_the_log_shows_it(
    asked: DemDatum, start: Start, expected: list[str]
) -> None:
    datums = choose_datums(asked, evidence(start))
    assert [datum.kind for datum in datums] == expected
    zeros_m = {"take-off": 120.0, "amsl": 0.0, "flight": 101.0}
    assert [datum.zero_m for datum in datums] == [zeros_m[kind] for kind in expected]


@pytest.mark.usefixtures("height_at_take_off")
def test_what_the_log_does_not_have_cannot_be_asked_for() -> None:
    with pytest.raises(NoPositionError, match="starts 260 m above it"):
        choose_datums(DemDatum.TAKE_OFF, evidence(replace(START, height_m=260.0)))
    with pytest.raises(NoPositionError, match="needs altitudes above sea level"):
        choose_datums(DemDatum.AMSL, evidence(has_amsl=False))


def test_a_model_that_does_not_reach_take_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(open_ground, "_height_at_m", lambda _path, _start: None)
    with pytest.raises(MapElsewhereError, match="no height at take-off"):
        choose_datums(DemDatum.TAKE_OFF, evidence())
    (only,) = choose_datums(DemDatum.AUTO, evidence(has_amsl=False))
    assert only.kind is DemDatum.FLIGHT
    assert "no height at take-off" in only.why
