"""The cron script: each flight once, gates and failures as exit codes, one run at a time."""

import fcntl
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "geotag_nightly.sh"

STUB = """\
#!/bin/sh
echo "$@" >>"$CALLS"
case "$1" in
    geotag)
        [ "${GEOTAG_CODE:-0}" -eq 0 ] || exit "$GEOTAG_CODE"
        while [ "$1" != --out ]; do shift; done
        mkdir -p "$2" && echo '{}' >"$2/run.json" ;;
    report)
        echo '[]'
        exit "${REPORT_CODE:-0}" ;;
esac
"""


@dataclass(frozen=True, slots=True)
class Night:
    """Folders of one installation with a stand-in for ``uasthn`` that notes its calls."""

    root: Path

    def run(self, **environment: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            ["/bin/sh", str(SCRIPT), str(self.root / "flights"), str(self.root / "results")],
            env={
                "PATH": os.environ["PATH"],
                "CALLS": str(self.root / "calls"),
                "UASTHN": str(self.root / "uasthn"),
                "MAP": "area.tif",
                "HFOV": "45",
                "SETTLE_MIN": "0",
                **environment,
            },
            capture_output=True,
            text=True,
            check=False,
        )

    @property
    def calls(self) -> list[str]:
        path = self.root / "calls"
        return path.read_text().splitlines() if path.exists() else []

    @property
    def log(self) -> str:
        return (self.root / "results" / "nightly.log").read_text()


@pytest.fixture
def night(tmp_path: Path) -> Night:
    for name in ("monday", "tuesday at dusk"):
        (tmp_path / "flights" / name / "frames").mkdir(parents=True)
        (tmp_path / "flights" / name / "flight.tlog").write_bytes(b"log")
    (tmp_path / "flights" / "notes").mkdir()
    (tmp_path / "uasthn").write_text(STUB)
    (tmp_path / "uasthn").chmod(0o755)
    return Night(tmp_path)


def test_every_flight_is_done_once(night: Night) -> None:
    assert night.run().returncode == 0
    assert [call.split()[0] for call in night.calls] == ["geotag", "report"] * 2
    assert "--map area.tif --search-radius 200" in night.calls[0]
    assert "--hfov 45" in night.calls[0]
    reports = sorted(path.name for path in (night.root / "results").glob("*.report.json"))
    assert reports == ["monday.report.json", "tuesday at dusk.report.json"]
    assert night.run().returncode == 0
    assert len(night.calls) == 4


def test_a_flight_may_bring_its_own_map_and_camera(night: Night) -> None:
    own = night.root / "flights" / "monday" / "map.tif"
    own.write_bytes(b"map")
    assert night.run(CAMERA="boson640-18mm").returncode == 0
    assert f"--map {own}" in night.calls[0]
    assert "--camera boson640-18mm" in night.calls[0]
    assert "--hfov" not in night.calls[0]


def test_missed_gates_are_told_but_not_repeated(night: Night) -> None:
    assert night.run(REPORT_CODE="4").returncode == 4
    assert "monday: gates missed" in night.log
    assert night.run().returncode == 0
    assert len(night.calls) == 4


def test_a_failed_flight_is_tried_again(night: Night) -> None:
    assert night.run(GEOTAG_CODE="17").returncode == 1
    assert "monday: failed with exit code 17" in night.log
    assert not list((night.root / "results").glob("*.report.json*"))
    assert night.run().returncode == 0


def test_without_a_map_a_flight_fails(night: Night) -> None:
    assert night.run(MAP="").returncode == 1
    assert night.calls == []
    assert "MAP is not set" in night.log


def test_a_lost_report_is_made_up_without_geotagging(night: Night) -> None:
    assert night.run(REPORT_CODE="22").returncode == 1
    before = len(night.calls)
    assert night.run().returncode == 0
    assert [call.split()[0] for call in night.calls[before:]] == ["report"] * 2


def test_uploads_that_still_change_wait(night: Night) -> None:
    assert night.run(SETTLE_MIN="10").returncode == 0
    assert night.calls == []
    assert "still being copied" in night.log


def test_a_second_run_gives_way(night: Night) -> None:
    (night.root / "results").mkdir()
    with (night.root / "results" / ".nightly.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert night.run().returncode == 75
    assert night.calls == []


def test_wrong_usage_says_how() -> None:
    result = subprocess.run(["/bin/sh", str(SCRIPT)], capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert result.stderr.startswith("usage:")
