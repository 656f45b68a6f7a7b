import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from frame_results import make_failure, make_fix, make_record, make_rejected

from uasthn_cli.config import CropTtaConfig, GeotagConfig
from uasthn_cli.outputs import run_record
from uasthn_cli.outputs.run_record import (
    counts,
    file_identity,
    file_sha256,
    fingerprint_of,
    frames_sha256,
    peak_memory_mib,
    plain,
    run_json,
)
from uasthn_cli.types import FrameFile, FrameResult, Reason
from uasthn_cli.uncertainty.calibration import Calibration, Judgement
from uasthn_cli.uncertainty.risk_model import RiskModel
from uasthn_cli.version import code_version

RESULTS: list[FrameResult] = [
    make_fix("1.png"),
    make_rejected("2.png"),
    make_failure("3.png"),
    make_failure("4.png", reason=Reason.NO_TIME),
    make_failure("5.png", reason=Reason.NO_TIME),
]


def test_counts_by_reason() -> None:
    assert counts(RESULTS) == {
        "frames": 5,
        "with_estimate": 2,
        "accepted": 1,
        "reasons": {"no-time": 2, "uncertain": 1, "unreadable": 1},
    }
    assert counts([]) == {"frames": 0, "with_estimate": 0, "accepted": 0, "reasons": {}}


def test_sections_and_rates() -> None:
    record = json.loads(run_json(make_record(notes={"map": "one window padded"}), RESULTS))
    assert list(record) == [
        *("version", "arguments", "time_base", "frame_times", "camera", "inputs"),
        *("calibration", "flight", "counts", "notes", "timing"),
    ]
    assert record["version"] == code_version()
    assert record["notes"] == {"map": "one window padded"}
    timing = record["timing"]
    assert timing["stages"]["decode"] == {"seconds": 0.5, "frames_per_s": 6.0}
    assert timing["frames_per_s"] == 1.5
    assert timing["started_utc"] == "2026-01-02T03:04:05.000Z"
    assert timing["peak_memory_mib"] > 1.0


def test_what_judged_and_what_the_flight_taught_are_recorded() -> None:
    judgement = Judgement(RiskModel((), -2.0), 0.1, 1.25, 90, 100, 80, 1, 80)
    calibration = Calibration(25.0, 0.05, 0.9, judgement, None, note="two flights")
    flight = {"mount_yaw_deg": {"value": 1.5, "error": math.nan}, "clock_s": None}
    record = json.loads(run_json(make_record(calibration=calibration, flight=flight), RESULTS))
    assert record["calibration"]["single"]["max_risk"] == 0.1
    assert record["calibration"]["fused"] is None
    assert record["flight"] == {"mount_yaw_deg": {"value": 1.5, "error": None}, "clock_s": None}
    alone = json.loads(run_json(make_record(), RESULTS))
    assert (alone["calibration"], alone["flight"]) == (None, None)


def test_runs_that_took_longer_differ_in_timing_alone() -> None:
    record = make_record()
    slower = replace(record, timing=replace(record.timing, wall_s=9.0, started_utc_s=0.0))
    one, two = (json.loads(run_json(r, RESULTS)) for r in (record, slower))
    assert one.pop("timing") != two.pop("timing")
    assert one == two


def test_untimed_stages_have_no_rate() -> None:
    record = make_record()
    untimed = replace(record, timing=replace(record.timing, wall_s=0.0, stage_s={"map": 0.0}))
    timing = json.loads(run_json(untimed, []))["timing"]
    assert timing["frames_per_s"] is None
    assert timing["stages"]["map"] == {"seconds": 0.0, "frames_per_s": None}


def test_plain_types() -> None:
    value = {
        Path("a/b"): GeotagConfig(crops=CropTtaConfig(seed=3)),
        "array": np.array([[1.0, math.nan]]),
        "scalars": (np.float32(0.5), np.int64(2), np.bool_(True), math.inf, None),
        "mapping": MappingProxyType({Reason.NO_TIME: 1}),
        "name": "bad\udcff",
    }
    plain_value = plain(value)
    assert json.loads(json.dumps(plain_value, allow_nan=False)) == plain_value
    assert plain_value["a/b"]["crops"] == {
        "views": 5,
        "sampling": "random",
        "offset_fraction": 0.0625,
        "seed": 3,
    }
    assert plain_value["array"] == [[1.0, None]]
    assert plain_value["scalars"] == [0.5, 2, True, None, None]
    assert plain_value["mapping"] == {"no-time": 1}
    assert plain_value["name"] == "bad\\udcff"
    with pytest.raises(TypeError, match="set has no place"):
        plain({"x": {1}})


def test_fingerprint_knows_every_section_and_no_order_of_keys() -> None:
    base = fingerprint_of({"a": 1, "b": 2.0}, {"map": "00"})
    assert base == fingerprint_of({"b": 2.0, "a": 1}, {"map": "00"})
    assert base != fingerprint_of({"a": 1, "b": 2.0000000000000004}, {"map": "00"})
    assert base != fingerprint_of({"a": 1, "b": 2.0}, {"map": "01"})
    assert base != fingerprint_of({"a": 1, "b": 2.0})


def test_fingerprint_knows_the_code(monkeypatch: pytest.MonkeyPatch) -> None:
    before = fingerprint_of({"a": 1})
    monkeypatch.setattr(run_record, "code_version", lambda: "0.2.0+src.00000000")
    assert fingerprint_of({"a": 1}) != before


def test_file_hash(tmp_path: Path) -> None:
    path = tmp_path / "map.tif"
    path.write_bytes(b"abc")
    assert file_sha256(path) == hashlib.sha256(b"abc").hexdigest()
    assert file_sha256(str(path)) == file_sha256(path)
    assert file_sha256(tmp_path) is None
    assert file_sha256("/vsicurl/https://example.org/map.tif") is None


def test_frames_hash_sees_names_contents_order_and_gaps(tmp_path: Path) -> None:
    def frames(*contents: tuple[str, bytes]) -> list[FrameFile]:
        for name, content in contents:
            (tmp_path / name).write_bytes(content)
        return [FrameFile(name, tmp_path / name) for name, _ in contents]

    hashes = {
        frames_sha256(frames(("a", b"12"), ("b", b"3"))),
        frames_sha256(frames(("a", b"1"), ("b", b"23"))),
        frames_sha256(frames(("b", b"23"), ("a", b"1"))),
        frames_sha256(frames(("a", b"1"))),
        frames_sha256([*frames(("a", b"1")), FrameFile("gone", tmp_path / "gone")]),
        frames_sha256([]),
    }
    assert len(hashes) == 6
    again = frames(("a", b"12"), ("b", b"3"))
    assert frames_sha256(again) in hashes


def test_peak_memory_is_that_of_this_process() -> None:
    block = np.ones(40 * 1024 * 1024 // 8)
    peak_mib = peak_memory_mib()
    assert block.nbytes == 40 * 1024 * 1024
    assert peak_mib is None or 40.0 < peak_mib < 1e6


def test_a_very_large_file_is_told_from_others_by_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "map.tif"
    path.write_bytes(b"abc" * 1000)
    assert file_identity(path) == {"sha256": file_sha256(path)}
    monkeypatch.setattr(run_record, "MAX_HASHED_BYTES", 100)
    monkeypatch.setattr(run_record, "_SAMPLE_BYTES", 40)
    first = file_identity(path)
    assert first["sha256"] is None
    assert first["size_bytes"] == 3000
    content = bytearray(path.read_bytes())
    content[-1] = 0
    path.write_bytes(content)
    assert file_identity(path)["sampled_sha256"] != first["sampled_sha256"]
    assert file_identity(tmp_path / "missing") == {"sha256": None}
