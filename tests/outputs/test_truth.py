from pathlib import Path

import numpy as np
import pytest
from frame_results import make_fix, make_prior, truth_table

from uasthn_cli.errors import TruthError
from uasthn_cli.outputs.truth import (
    TrueFrame,
    camera_error_m,
    center_error_m,
    mean_corner_error_m,
    prior_error_m,
    read_truth,
)

M_PER_DEG_LON_AT_EQUATOR = 111_319.4908  # 2 pi 6378137 m / 360
M_PER_DEG_LAT_AT_EQUATOR = 110_574.2758  # meridian radius a (1 - e2) = 6335439.327 m


def true_frame(center: tuple[float, float]) -> TrueFrame:
    corners = np.array([[0.01, 0.0], [0.01, 0.01], [0.0, 0.0], [0.0, 0.01]])
    return TrueFrame(np.array(center), corners, np.array(center))


def written(folder: Path, text: str) -> Path:
    path = folder / "truth.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_center_error_by_hand() -> None:
    fix = make_fix(center_lat_deg=0.0, center_lon_deg=0.003)
    east = center_error_m(fix, true_frame((0.0, 0.002)))
    assert east == pytest.approx(0.001 * M_PER_DEG_LON_AT_EQUATOR, rel=1e-6)
    fix = make_fix(center_lat_deg=0.0005, center_lon_deg=0.002)
    north = center_error_m(fix, true_frame((-0.0005, 0.002)))
    assert north == pytest.approx(0.001 * M_PER_DEG_LAT_AT_EQUATOR, rel=1e-6)


def test_mean_corner_error_averages_distances_not_coordinates() -> None:
    true = true_frame((0.0, 0.0))
    moved = true.corners_deg.copy()
    moved[0, 1] += 0.001
    moved[1, 1] -= 0.003
    expected = (0.001 + 0.003) / 4 * M_PER_DEG_LON_AT_EQUATOR
    assert mean_corner_error_m(make_fix(corners_deg=moved), true) == pytest.approx(
        expected, rel=1e-6
    )


def test_prior_error_is_of_the_camera_and_needs_one() -> None:
    true = TrueFrame(np.zeros(2), np.zeros((4, 2)), np.array([0.0, 0.001]))
    error_m = prior_error_m(make_prior(lat_deg=0.0, lon_deg=0.0), true)
    assert error_m == pytest.approx(0.001 * M_PER_DEG_LON_AT_EQUATOR, rel=1e-6)
    assert prior_error_m(make_prior(), TrueFrame(np.zeros(2), np.zeros((4, 2)), None)) is None


def test_camera_error_is_of_the_estimate() -> None:
    true = TrueFrame(np.zeros(2), np.zeros((4, 2)), np.array([0.0, 0.001]))
    error_m = camera_error_m(make_fix(lat_deg=0.0, lon_deg=0.003), true)
    assert error_m == pytest.approx(0.002 * M_PER_DEG_LON_AT_EQUATOR, rel=1e-6)
    assert camera_error_m(make_fix(), TrueFrame(np.zeros(2), np.zeros((4, 2)), None)) is None


def test_error_across_the_antimeridian_is_short() -> None:
    fix = make_fix(center_lat_deg=0.0, center_lon_deg=-179.9995)
    error_m = center_error_m(fix, true_frame((0.0, 179.9995)))
    assert error_m == pytest.approx(0.001 * M_PER_DEG_LON_AT_EQUATOR, rel=1e-6)


def test_estimate_that_is_not_finite_has_no_error() -> None:
    fix = make_fix(center_lat_deg=float("nan"))
    assert np.isnan(center_error_m(fix, true_frame((0.0, 0.0))))


def test_convention_corners_are_read_by_name_as_lat_lon(tmp_path: Path) -> None:
    row = {"frame": "a", "tl_lat": 1, "tl_lon": 2, "tr_lat": 3, "tr_lon": 4}
    row |= {"bl_lat": 5, "bl_lon": 6, "br_lat": 7, "br_lon": 8}
    truth = read_truth(written(tmp_path, truth_table(row)))
    assert truth.frames["a"].corners_deg.tolist() == [[1, 2], [3, 4], [5, 6], [7, 8]]


def test_reads_bom_quoted_names_and_ignores_other_columns(tmp_path: Path) -> None:
    header, row = truth_table({"frame": '"ä, 1.png"'}, with_camera=False).splitlines()
    path = written(tmp_path, f"\ufeff{header},weather\r\n{row},fog\r\n")
    truth = read_truth(path)
    assert list(truth.frames) == ["ä, 1.png"]
    assert not truth.has_camera
    assert truth.frames["ä, 1.png"].camera_deg is None


def test_camera_may_be_unknown_for_single_frames(tmp_path: Path) -> None:
    rows = {"frame": "a"}, {"frame": "b", "lat": "", "lon": ""}
    truth = read_truth(written(tmp_path, truth_table(*rows)))
    camera = truth.frames["a"].camera_deg
    assert camera is not None
    assert camera.tolist() == [24.001, 56.0025]
    assert truth.frames["b"].camera_deg is None


def test_missing_columns_are_named(tmp_path: Path) -> None:
    text = truth_table({"frame": "a"}).replace("center_lon", "centre_lon").replace("br_lat", "x")
    with pytest.raises(TruthError, match="column center_lon, br_lat is missing"):
        read_truth(written(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "column frame, .* is missing"),
        (truth_table(), "no rows"),
        (truth_table({"frame": "a"}, {"frame": "a"}), ":3: 'a' is listed twice"),
        (truth_table({"frame": "a", "tr_lon": "east"}), ":2: tr_lon is 'east'"),
        (truth_table({"frame": "a", "tr_lon": ""}), ":2: tr_lon is ''"),
        (truth_table({"frame": "a", "tr_lon": "nan"}), ":2: tr_lon is 'nan'"),
        (truth_table({"frame": "a", "center_lat": 91}), "center_lat is '91', .* within ±90"),
        (truth_table({"frame": "a", "lon": -181}), "lon is '-181', .* within ±180"),
        (truth_table({"frame": "a"}).rsplit(",", 1)[0], ":2: br_lon is None"),
    ],
)
def test_unusable_tables_are_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(TruthError, match=message) as raised:
        read_truth(written(tmp_path, text))
    assert "truth.csv" in str(raised.value)
    assert "\n" not in str(raised.value)


def test_missing_file_folder_and_binary_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TruthError, match="No such file"):
        read_truth(tmp_path / "absent.csv")
    with pytest.raises(TruthError, match="Is a directory"):
        read_truth(tmp_path)
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(TruthError, match="not a CSV table in UTF-8"):
        read_truth(tmp_path / "binary.csv")


def test_a_table_of_another_flight_is_told_apart_from_a_partial_one(tmp_path: Path) -> None:
    truth = read_truth(written(tmp_path, truth_table({"frame": "a.png"})))
    truth.require_match(["z.png", "a.png"])
    truth.require_match([])
    with pytest.raises(TruthError, match=r"it lists 'a\.png', the flight has 'z\.png'"):
        truth.require_match(["z.png"])


def test_reads_the_real_tables(shared_dir: Path) -> None:
    for flight in ("farms_bing", "dunes_east"):
        truth = read_truth(shared_dir / "flights" / flight / "truth.csv")
        frames = sorted(p.name for p in (shared_dir / "flights" / flight / "frames").iterdir())
        assert truth.has_camera
        assert set(frames) <= set(truth.frames)
