import csv
import io
import math
from pathlib import Path

import numpy as np
import pytest
from frame_results import (
    UNCERTAIN_DETAIL,
    make_failure,
    make_fix,
    make_fused,
    make_prior,
    make_rejected,
    make_trust,
    truth_table,
)

from uasthn_cli.outputs.table import (
    columns,
    frames_csv,
    has_single,
    to_rows,
)
from uasthn_cli.outputs.truth import Truth, read_truth
from uasthn_cli.types import FrameResult, Reason

REQUIRED_START = (
    "frame,time_utc,lat,lon,center_lat,center_lon,accepted,reason,u_m,offset_m,"
    "tl_lat,tl_lon,tr_lat,tr_lon,bl_lat,bl_lon,br_lat,br_lon,"
    "prior_lat,prior_lon,agl_m,alt_amsl_m,roll_deg,pitch_deg,yaw_deg,gsd_m,source,"
    "u_tl_x_m,u_tl_y_m,u_tr_x_m,u_tr_y_m,u_bl_x_m,u_bl_y_m,u_br_x_m,u_br_y_m"
)

TRUST = (
    "ce90_m,risk,cov_xx_m2,cov_xy_m2,cov_yy_m2,"
    "camera_ce90_m,camera_cov_xx_m2,camera_cov_xy_m2,camera_cov_yy_m2,"
    "confidence,entropy,sigma_m,agreement_m,support"
)
SINGLE = (
    "single_accepted,single_reason,single_lat,single_lon,single_center_lat,single_center_lon,"
    "single_u_m,single_offset_m,single_tl_lat,single_tl_lon,single_tr_lat,single_tr_lon,"
    "single_bl_lat,single_bl_lon,single_br_lat,single_br_lon,"
    "single_ce90_m,single_risk,single_confidence,single_entropy,single_sigma_m"
)


@pytest.fixture
def truth(tmp_path: Path) -> Truth:
    path = tmp_path / "truth.csv"
    path.write_text(truth_table({"frame": "a.png"}, {"frame": "c.png"}))
    return read_truth(path)


def cells(
    result: FrameResult, truth: Truth | None = None, crs: str | None = None
) -> dict[str, str]:
    names = columns(truth, crs, has_single([result]))
    return dict(zip(names, next(to_rows([result], truth, crs)), strict=True))


def filled(row: dict[str, str]) -> dict[str, str]:
    return {name: cell for name, cell in row.items() if cell}


def test_header_without_and_with_truth_and_crs(tmp_path: Path, truth: Truth) -> None:
    assert ",".join(columns(None, None)) == f"{REQUIRED_START},{TRUST},detail"
    assert ",".join(columns(truth, "EPSG:32640")) == (
        f"{REQUIRED_START},ce_m,mace_m,camera_ce_m,prior_ce_m,{TRUST},detail,x,y,center_x,center_y"
    )
    path = tmp_path / "no_camera.csv"
    path.write_text(truth_table({"frame": "a.png"}, with_camera=False))
    assert ",".join(columns(read_truth(path), None)) == (
        f"{REQUIRED_START},ce_m,mace_m,{TRUST},detail"
    )


def test_header_of_a_fused_run_has_each_frames_own_answer_too(truth: Truth) -> None:
    assert ",".join(columns(None, None, with_single=True)) == (
        f"{REQUIRED_START},{TRUST},{SINGLE},detail"
    )
    assert ",".join(columns(truth, "EPSG:32640", with_single=True)) == (
        f"{REQUIRED_START},ce_m,mace_m,camera_ce_m,prior_ce_m,{TRUST},{SINGLE},"
        "single_ce_m,single_mace_m,detail,x,y,center_x,center_y"
    )


def test_an_accepted_frame_fills_all_but_reason_detail_and_what_the_flight_says() -> None:
    row = cells(make_fix())
    assert set(row) - set(filled(row)) == {"reason", "detail", "agreement_m", "support"}
    assert row["time_utc"] == "2025-11-22T08:26:42.000Z"
    assert (row["lat"], row["center_lon"]) == ("24.00100000", "56.00251000")
    assert (row["accepted"], row["source"]) == ("true", "fix")
    assert (row["u_m"], row["offset_m"]) == ("4.500", "75.250")
    assert (row["agl_m"], row["alt_amsl_m"]) == ("270.250", "317.625")  # what placed the frame
    assert (row["roll_deg"], row["pitch_deg"], row["yaw_deg"]) == ("0.573", "-1.146", "85.944")
    assert row["gsd_m"] == "0.34568"
    assert [row[name] for name in TRUST.split(",")] == [
        *("7.125", "0.012346", "10.000", "-1.500", "12.000"),
        *("10.065", "20.000", "-2.500", "24.000"),
        *("0.8765", "3.2500", "12.500", "", ""),
    ]


def test_an_altitude_that_the_log_does_not_know_stays_empty() -> None:
    row = cells(make_fix(alt_amsl_m=math.nan))
    assert (row["alt_amsl_m"], row["agl_m"]) == ("", "270.250")


def test_without_a_calibration_there_is_no_risk() -> None:
    row = cells(make_fix(trust=make_trust(risk=math.nan)))
    assert (row["risk"], row["ce90_m"]) == ("", "7.125")


def test_a_fused_frame_shows_its_own_answer_beside_the_flights(truth: Truth) -> None:
    own = make_rejected("a.png", center_lat_deg=24.00201, trust=make_trust(risk=0.5))
    row = cells(make_fused(single=own), truth)
    assert (row["source"], row["accepted"], row["reason"]) == ("fused", "true", "")
    assert (row["agreement_m"], row["support"], row["risk"]) == ("4.000", "0.8888", "0.001000")
    assert (row["single_accepted"], row["single_reason"]) == ("false", "uncertain")
    assert (row["single_center_lat"], row["center_lat"]) == ("24.00201000", "24.00101000")
    assert row["single_risk"] == "0.500000"
    assert row["ce_m"] == "0.000"
    assert float(row["single_ce_m"]) == pytest.approx(110.76, abs=0.05)


def test_a_fused_frame_without_an_own_answer_says_why() -> None:
    row = cells(make_fused(single=None, accepted=False, reason=Reason.TEXTURELESS))
    assert (row["single_accepted"], row["single_reason"]) == ("false", "textureless")
    assert row["single_lat"] == row["single_risk"] == ""
    assert row["lat"] == "24.00100000"


def test_failures_of_a_fused_run_have_no_own_answer_either() -> None:
    results: list[FrameResult] = [make_fused(), make_failure()]
    names = columns(None, None, has_single(results))
    _, failure = (dict(zip(names, row, strict=True)) for row in to_rows(results, None, None))
    assert (failure["accepted"], failure["single_accepted"]) == ("false", "false")
    assert failure["single_reason"] == failure["reason"] == "unreadable"


def test_convention_corner_cells_follow_the_corner_order() -> None:
    row = cells(make_fix(corners_deg=np.arange(8.0).reshape(4, 2)))
    names = [f"{corner}_{axis}" for corner in ("tl", "tr", "bl", "br") for axis in ("lat", "lon")]
    assert [row[name] for name in names] == [f"{k}.00000000" for k in range(8)]
    names = [f"u_{corner}_{axis}_m" for corner in ("tl", "tr", "bl", "br") for axis in ("x", "y")]
    assert [row[name] for name in names] == [f"{k + 1}.000" for k in range(8)]


def test_a_rejected_frame_keeps_its_estimate() -> None:
    accepted, rejected = cells(make_fix("b.png")), cells(make_rejected("b.png"))
    verdict = {"accepted": "false", "reason": "uncertain", "detail": UNCERTAIN_DETAIL}
    assert rejected == accepted | verdict


def test_a_frame_without_anything_keeps_its_row() -> None:
    assert filled(cells(make_failure())) == {
        "frame": "c.png",
        "accepted": "false",
        "reason": "unreadable",
        "detail": "truncated PNG",
    }


def test_a_failure_shows_time_and_prior_if_known() -> None:
    failure = make_failure(reason=Reason.OFF_MAP, prior=make_prior("c.png"), time_utc_s=0.25)
    assert filled(cells(failure)) == {
        "frame": "c.png",
        "time_utc": "1970-01-01T00:00:00.250Z",
        "accepted": "false",
        "reason": "off-map",
        "prior_lat": "24.00050000",
        "prior_lon": "56.00200000",
        "agl_m": "267.730",
        "alt_amsl_m": "317.500",
        "detail": "truncated PNG",
    }


def test_values_that_are_not_finite_leave_empty_cells() -> None:
    row = cells(make_rejected(uncertainty_m=math.inf, corner_std_m=np.full((4, 2), math.nan)))
    assert row["u_m"] == row["u_br_y_m"] == ""
    assert row["lat"] == "24.00100000"


def test_errors_against_truth(truth: Truth) -> None:
    exact = cells(make_fix("a.png"), truth)
    assert (exact["ce_m"], exact["mace_m"]) == ("0.000", "0.000")
    moved = cells(make_rejected("a.png", center_lat_deg=24.00201), truth)
    assert float(moved["ce_m"]) == pytest.approx(110.76, abs=0.05)  # 0.001° of latitude at 24° N
    assert float(moved["prior_ce_m"]) == pytest.approx(75.25, abs=0.2)  # 55.4 m north, 50.9 m east
    assert moved["camera_ce_m"] == "0.000"
    aside = cells(make_fix("a.png", lat_deg=24.002), truth)
    assert float(aside["camera_ce_m"]) == pytest.approx(110.76, abs=0.05)
    assert aside["ce_m"] == "0.000"
    assert moved["mace_m"] == "0.000"


def test_truth_of_frames_without_an_estimate_judges_the_prior_alone(truth: Truth) -> None:
    row = cells(make_failure("c.png", prior=make_prior("c.png")), truth)
    assert (row["ce_m"], row["mace_m"]) == ("", "")
    assert float(row["prior_ce_m"]) > 0
    assert cells(make_failure("c.png"), truth)["prior_ce_m"] == ""


def test_frames_that_the_truth_does_not_list_have_no_errors(truth: Truth) -> None:
    row = cells(make_fix("z.png"), truth)
    assert (row["ce_m"], row["mace_m"], row["prior_ce_m"]) == ("", "", "")


def test_positions_in_a_projected_crs_by_hand() -> None:
    fix = make_fix(lat_deg=0.0, lon_deg=57.0, center_lat_deg=0.0, center_lon_deg=57.0)
    row = cells(fix, None, "EPSG:32640")  # UTM 40 N: central meridian 57° E, false easting 500 km
    assert (row["x"], row["y"]) == ("500000.000", "0.000")
    assert (row["center_x"], row["center_y"]) == ("500000.000", "0.000")


def test_positions_in_degrees_keep_eight_decimals_as_lon_lat() -> None:
    row = cells(make_fix(), None, "EPSG:4326")
    assert (row["x"], row["y"]) == ("56.00250000", "24.00100000")


def test_failures_stay_in_step_with_projected_positions() -> None:
    results: list[FrameResult] = [make_failure(), make_fix(lon_deg=57.0), make_failure("d.png")]
    rows = list(to_rows(results, None, "EPSG:32640"))
    assert [bool(row[-1]) for row in rows] == [False, True, False]
    assert rows[1][-4] == "500000.000"
    assert next(to_rows([make_failure()], None, "EPSG:32640"))[-4:] == ["", "", "", ""]


def test_unknown_crs_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown coordinate reference system"):
        list(to_rows([make_fix()], None, "EPSG:999999"))


@pytest.mark.parametrize("name", ["a, b.png", 'q"uote.png', "größe 日本.png", "NA", "l\nf.png"])
def test_any_name_survives_a_csv_reader(name: str) -> None:
    text = "".join(frames_csv([make_fix(name)], None, None))
    (row,) = csv.DictReader(io.StringIO(text, newline=""))
    assert row["frame"] == name


def test_the_table_is_the_same_each_time_and_ends_lines_with_line_feeds(truth: Truth) -> None:
    results: list[FrameResult] = [make_fix(), make_rejected(), make_failure("bad\udcff.png")]
    first, second = (
        "".join(frames_csv(results, truth, "EPSG:32640")).encode("utf-8") for _ in range(2)
    )
    assert first == second
    assert b"\r" not in first
    assert first.count(b"\n") == 4


def test_no_frames_give_a_header_alone() -> None:
    assert "".join(frames_csv([], None, "EPSG:32640")).count("\n") == 1
