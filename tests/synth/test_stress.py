"""Flights made wrong: same bytes twice, nothing at severity 0, and a truth that stays true."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from small_flight import MAP_CRS, MAP_GSD_M, NORTH_M, WEST_M, Flight, make_flight

from uasthn_cli.errors import OutputError, SyntheticFlightError
from uasthn_cli.geometry.corners import homography_from_corners, image_corners_px, transform_points
from uasthn_cli.geometry.geodesy import distance_m, to_crs
from uasthn_cli.outputs.truth import Truth, read_truth
from uasthn_cli.synth.flight import render_flight
from uasthn_cli.synth.flight_config import FlightConfig, StressConfig
from uasthn_cli.synth.flight_folder import RenderedFlight
from uasthn_cli.synth.kinds import LandscapeKind, StressCategory
from uasthn_cli.synth.stress import ON_MAP_COLUMN, render_stressed_flight, stress_flight
from uasthn_cli.types import FloatArray

WIDTH, HEIGHT = 96, 80
OF_FRAMES = {StressCategory.TEXTURELESS, StressCategory.EXPOSURE, StressCategory.GEOMETRY}
OF_MAP = {StressCategory.BEYOND_MAP, StressCategory.OUTDATED, StressCategory.WRONG_PLACE}


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return make_flight(tmp_path_factory.mktemp("healthy"))


def stressed(
    healthy: Flight, tmp_path: Path, category: StressCategory, severity: float = 1.0, seed: int = 0
) -> RenderedFlight:
    out = tmp_path / f"{category}-{severity}-{seed}"
    return stress_flight(healthy.log.parent, out, StressConfig(category, severity, seed))


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def read_grey(path: Path) -> NDArray[np.float32]:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image.astype(np.float32)


def seen_by(frame: str, truth: Truth, ground: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return what a frame would show of the ground ``(h, w)`` if the truth is true."""
    places = to_crs(MAP_CRS, truth.frames[frame].corners_deg)
    pixels = (places - [WEST_M, NORTH_M]) / [MAP_GSD_M, -MAP_GSD_M] - 0.5
    H = homography_from_corners(image_corners_px(WIDTH, HEIGHT), pixels)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpPerspective(ground, H, (WIDTH, HEIGHT), flags=flags), dtype=np.float32
    )


def likeness(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


@pytest.mark.parametrize("category", StressCategory)
def test_nothing_changes_at_severity_0(
    category: StressCategory, healthy: Flight, tmp_path: Path
) -> None:
    variant = stressed(healthy, tmp_path, category, severity=0.0)
    assert files_of(variant.map.parent) == files_of(healthy.log.parent)


@pytest.mark.parametrize("category", StressCategory)
def test_same_seed_same_bytes_another_seed_others(
    category: StressCategory, healthy: Flight, tmp_path: Path
) -> None:
    first, second, *others = (
        files_of(stressed(healthy, tmp_path / str(run), category, 0.5, seed).map.parent)
        for run, seed in enumerate((3, 3, 5, 6))
    )
    assert first == second
    # the edge of a map is one of four: seeds may agree
    assert any(first != other for other in others)


@pytest.mark.parametrize("category", StressCategory)
def test_only_what_is_meant_changes(
    category: StressCategory, healthy: Flight, tmp_path: Path
) -> None:
    before = files_of(healthy.log.parent)
    after = files_of(stressed(healthy, tmp_path, category, 0.5).map.parent)
    changed = {name.split("/")[0] for name in before if before[name] != after[name]}
    expected = set() if category in OF_MAP else {"frames"}
    expected |= set() if category in OF_FRAMES else {"map.tif"}
    if category in {StressCategory.GEOMETRY, StressCategory.BEYOND_MAP}:
        expected.add("truth.csv")
    assert changed == expected
    assert before.keys() == after.keys()


@pytest.mark.parametrize("severity", [0.5, 1.0])
def test_convention_bent_frames_show_what_their_truth_says(
    severity: float, healthy: Flight, tmp_path: Path
) -> None:
    variant = stressed(healthy, tmp_path, StressCategory.GEOMETRY, severity)
    before, after = read_truth(healthy.truth), read_truth(variant.truth)
    for name in healthy.names:
        frame = read_grey(variant.frames / name)
        # these frames are inverted pictures of the ground
        assert likeness(frame, seen_by(name, after, healthy.ground)) < -0.99
        assert likeness(frame, seen_by(name, before, healthy.ground)) > -0.98
        true = after.frames[name]
        assert true.camera_deg == pytest.approx(before.frames[name].camera_deg)
        middle = np.array([[(WIDTH - 1) / 2, (HEIGHT - 1) / 2]])
        H = homography_from_corners(image_corners_px(WIDTH, HEIGHT), true.corners_deg)
        assert distance_m(transform_points(H, middle)[0], true.center_deg) < 0.05


def test_frames_fade_to_nothing(healthy: Flight, tmp_path: Path) -> None:
    truth = read_truth(healthy.truth)
    shown = {
        severity: [
            likeness(read_grey(variant.frames / name), seen_by(name, truth, healthy.ground))
            for name in healthy.names
        ]
        for severity in (0.3, 1.0)
        for variant in [stressed(healthy, tmp_path, StressCategory.TEXTURELESS, severity)]
    }
    assert max(shown[0.3]) < -0.8
    assert max(np.abs(shown[1.0])) < 0.2


def test_repeated_ground_is_seen_where_the_truth_says(healthy: Flight, tmp_path: Path) -> None:
    for seed in (1, 2, 4, 8):
        variant = stressed(healthy, tmp_path, StressCategory.SELF_SIMILAR, 1.0, seed)
        truth = read_truth(variant.truth)
        with rasterio.open(variant.map) as raster:
            pattern = raster.read(1)
        seen = [
            likeness(read_grey(variant.frames / name), seen_by(name, truth, pattern))
            for name in healthy.names
        ]
        # dunes by night lag behind dunes by day, the others are alike or inverted
        assert min(np.abs(seen)) > 0.5
        assert len(set(np.sign(seen))) == 1


def footprint_px(variant: RenderedFlight, name: str) -> FloatArray:
    """Return points ``(n, 2)`` of a frame's footprint in pixels of the variant's map."""
    steps = np.linspace(0.01, 0.99, 25)
    u, v = (axis.reshape(-1, 1) for axis in np.meshgrid(steps, steps))
    tl, tr, bl, br = to_crs(MAP_CRS, read_truth(variant.truth).frames[name].corners_deg)
    places = (1 - u) * (1 - v) * tl + u * (1 - v) * tr + (1 - u) * v * bl + u * v * br
    with rasterio.open(variant.map) as raster:
        west, north = raster.transform.c, raster.transform.f
    return np.asarray((places - [west, north]) / [MAP_GSD_M, -MAP_GSD_M])


@pytest.mark.parametrize("severity", [0.25, 0.6, 1.0])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_map_ends_where_the_truth_says(
    severity: float, seed: int, healthy: Flight, tmp_path: Path
) -> None:
    variant = stressed(healthy, tmp_path, StressCategory.BEYOND_MAP, severity, seed)
    with rasterio.open(variant.map) as raster:
        size, cut, transform = (raster.width, raster.height), raster.read(1), raster.transform
    column = round((transform.c - WEST_M) / MAP_GSD_M)
    row = round((NORTH_M - transform.f) / MAP_GSD_M)
    original = healthy.ground[row : row + size[1], column : column + size[0]]
    assert np.array_equal(cut, original), "what is left lies where it was"
    assert cut.size < healthy.ground.size
    with variant.truth.open(newline="") as handle:
        noted = {row["frame"]: float(row[ON_MAP_COLUMN]) for row in csv.DictReader(handle)}
    for name in healthy.names:
        points = footprint_px(variant, name)
        inside = ((points > 0) & (points < size)).all(axis=1).mean()
        assert noted[name] == pytest.approx(inside, abs=0.06)
    assert np.mean(list(noted.values())) == pytest.approx(1.0 - severity, abs=0.06)


def test_another_place_is_nowhere_the_same(tmp_path: Path) -> None:
    config = FlightConfig(
        seed=7, kind=LandscapeKind.FARMS, frames=2, frame_width_px=96, frame_height_px=64
    )
    source = render_flight(tmp_path / "healthy", config)
    wrong = StressConfig(StressCategory.WRONG_PLACE, seed=1)
    variant = stress_flight(source.map.parent, tmp_path / "wrong", wrong)
    with rasterio.open(source.map) as before, rasterio.open(variant.map) as after:
        assert (before.transform, before.crs, before.shape) == (
            after.transform,
            after.crs,
            after.shape,
        )
        here, there = before.read(2), after.read(2)
    height, width = here.shape
    piece = here[height // 3 : 2 * height // 3, width // 3 : 2 * width // 3]
    found = [cv2.matchTemplate(m, piece, cv2.TM_CCOEFF_NORMED).max() for m in (here, there)]
    assert found[0] > 0.99
    assert found[1] < 0.5


@pytest.mark.parametrize("severity", [0.2, 0.7])
def test_a_share_of_the_map_is_out_of_date(
    severity: float, healthy: Flight, tmp_path: Path
) -> None:
    variant = stressed(healthy, tmp_path, StressCategory.OUTDATED, severity)
    with rasterio.open(variant.map) as raster:
        changed = (raster.read() != healthy.ground).any(axis=0)
    assert changed.mean() == pytest.approx(severity, abs=0.03)


def test_rendered_and_stressed_in_one_go(tmp_path: Path) -> None:
    flight = FlightConfig(frames=2, frame_width_px=96, frame_height_px=64, height_m=60.0)
    wrong = StressConfig(StressCategory.OUTDATED, 0.5, seed=2)
    at_once = render_stressed_flight(tmp_path / "a", flight, wrong)
    render_flight(tmp_path / "b", flight)
    stress_flight(tmp_path / "b", tmp_path / "b", wrong, overwrite=True)
    assert files_of(at_once.map.parent) == files_of(tmp_path / "b")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_an_existing_folder_is_kept(healthy: Flight, tmp_path: Path) -> None:
    stressed(healthy, tmp_path, StressCategory.EXPOSURE)
    with pytest.raises(OutputError, match="exists already"):
        stressed(healthy, tmp_path, StressCategory.EXPOSURE)


def test_a_flight_without_a_map_is_refused(tmp_path: Path) -> None:
    flight = make_flight(tmp_path / "flight", count=1)
    flight.map.unlink()
    with pytest.raises(SyntheticFlightError, match=r"no flight: map\.tif missing"):
        stressed(flight, tmp_path, StressCategory.OUTDATED)


def test_a_frame_without_truth_is_refused(tmp_path: Path) -> None:
    flight = make_flight(tmp_path / "flight", count=2)
    flight.truth.write_text("".join(flight.truth.read_text().splitlines(keepends=True)[:-1]))
    with pytest.raises(SyntheticFlightError, match="no row for frame"):
        stressed(flight, tmp_path, StressCategory.GEOMETRY)
    assert [path.name for path in tmp_path.iterdir()] == ["flight"]


def test_an_unreadable_frame_is_refused(tmp_path: Path) -> None:
    flight = make_flight(tmp_path / "flight", count=1)
    (flight.frames / flight.names[0]).write_bytes(b"no image")
    with pytest.raises(SyntheticFlightError, match="cannot be read"):
        stressed(flight, tmp_path, StressCategory.TEXTURELESS)


@pytest.mark.parametrize("severity", [-0.1, 1.1, float("nan")])
def test_severities_beyond_0_and_1_are_refused(severity: float) -> None:
    with pytest.raises(SyntheticFlightError, match="0 to 1"):
        StressConfig(StressCategory.OUTDATED, severity)
