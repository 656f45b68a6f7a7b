"""``--jobs``: how many processes there are changes how long a run takes, and nothing else."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from small_flight import Flight, make_flight

from uasthn_cli.commands.main import main

EXAMPLE = Path(__file__).parents[2] / "examples" / "flight"


def geotag(flight: Flight, out: Path, *extra: str) -> "subprocess.CompletedProcess[str]":
    """Run the command in a process of its own, in which nothing else was loaded."""
    arguments = flight.arguments(out, *extra)
    command = [sys.executable, "-m", "uasthn_cli", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_any_number_of_jobs_gives_the_same_bytes(tmp_path: Path) -> None:
    flight = make_flight(tmp_path / "flight", count=13)
    for jobs in ("1", "2", "3", "auto"):
        result = geotag(flight, tmp_path / jobs, "--jobs", jobs)
        assert result.returncode == 0, result.stderr
    for name in ("frames.csv", "frames.geojson"):
        contents = {(tmp_path / jobs / name).read_bytes() for jobs in ("1", "2", "3", "auto")}
        assert len(contents) == 1
    records = [json.loads((tmp_path / jobs / "run.json").read_text("utf-8")) for jobs in ("1", "2")]
    timings = [record.pop("timing") for record in records]
    assert records[0] == records[1]
    assert timings[0]["stages"].keys() == timings[1]["stages"].keys()
    assert [timing["jobs"] for timing in timings] == [1, 2 if sys.platform == "linux" else 1]


@pytest.mark.slow
def test_the_learned_estimator_gives_the_same_bytes_too(tmp_path: Path) -> None:
    inputs = [str(EXAMPLE / "flight.tlog"), str(EXAMPLE / "frames")]
    options = ["--map", str(EXAMPLE / "map.tif"), "--hfov", "45", "--search-radius", "120"]
    for jobs, threads in (("1", "1"), ("2", "2")):
        command = [sys.executable, "-m", "uasthn_cli", "-q", "geotag", *inputs, *options]
        command += ["--out", str(tmp_path / jobs), "--jobs", jobs]
        environment = {**os.environ, "OMP_NUM_THREADS": threads}
        subprocess.run(command, env=environment, check=True)
    contents = {(tmp_path / jobs / "frames.csv").read_bytes() for jobs in ("1", "2")}
    assert len(contents) == 1


@pytest.mark.parametrize("jobs", ["0", "-1", "2.5", "many"])
def test_nonsense_is_refused(flight: Flight, tmp_path: Path, jobs: str) -> None:
    result = CliRunner().invoke(main, flight.arguments(tmp_path / "out", "--jobs", jobs))
    assert result.exit_code == 2
    assert "neither auto nor a number" in result.stderr


def test_a_network_that_looks_at_one_frame_at_a_time_takes_no_jobs(
    flight: Flight, tmp_path: Path
) -> None:
    arguments = flight.arguments(tmp_path / "out", "--jobs", "2")
    arguments[arguments.index("ncc")] = "ihn"
    weights = tmp_path / "ihn.safetensors"
    result = CliRunner().invoke(main, [*arguments, "--weights", str(weights)])
    assert result.exit_code == 2
    assert "looks at one frame at a time" in result.stderr


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux alone")
def test_workers_end_with_a_run_that_is_killed(tmp_path: Path) -> None:
    inputs = [str(EXAMPLE / "flight.tlog"), str(EXAMPLE / "frames")]
    options = ["--map", str(EXAMPLE / "map.tif"), "--hfov", "45", "--out", str(tmp_path / "out")]
    command = [sys.executable, "-m", "uasthn_cli", "-q", "geotag", *inputs, *options, "--jobs", "2"]
    with subprocess.Popen(command) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        workers: list[str] = []
        while process.poll() is None and not workers:
            workers = children.read_text("ascii").split()
            time.sleep(0.01)
        assert workers
        process.send_signal(signal.SIGKILL)
    deadline_s = time.monotonic() + 20
    while any(Path(f"/proc/{worker}").exists() for worker in workers):
        assert time.monotonic() < deadline_s, "workers are left behind"
        time.sleep(0.05)
