"""``uasthn synth`` from the command line."""

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from uasthn_cli.commands.main import main
from uasthn_cli.commands.synth import synth
from uasthn_cli.errors import OutputError, SyntheticFlightError

SMALL = ("--frames", "2", "--frame-size", "96", "64", "--height-m", "60", "--drift-m", "10")


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(synth, [str(argument) for argument in arguments])


def test_a_flight_is_rendered_and_its_path_printed(tmp_path: Path) -> None:
    out = tmp_path / "flight"
    result = run(out, *SMALL, "--kind", "dunes", "--seed", "3")
    assert result.exit_code == 0
    assert result.stdout == f"{out}\n"
    assert f"--map {out / 'map.tif'} --hfov 45" in result.stderr
    assert {path.name for path in out.iterdir()} == {
        "map.tif",
        "frames",
        "flight.tlog",
        "truth.csv",
    }
    assert len(list((out / "frames").glob("frame_*.png"))) == 2


def test_an_existing_flight_needs_overwrite(tmp_path: Path) -> None:
    out = tmp_path / "flight"
    run(out, *SMALL)
    refused = run(out, *SMALL)
    assert isinstance(refused.exception, OutputError)
    assert run(out, *SMALL, "--overwrite").exit_code == 0


def test_an_impossible_flight_ends_with_its_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["synth", str(tmp_path / "flight"), *SMALL, "--crs", "EPSG:1"])
    assert ended.value.code == SyntheticFlightError.exit_code
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.startswith("uasthn: error: cannot write a map in EPSG:1")


def test_errors_of_the_aircraft_reach_the_flight(tmp_path: Path) -> None:
    out = tmp_path / "flight"
    aircraft = ("--mount-pitch", "-2", "--relief-m", "15", "--lose-frames", "0.5", "--renumber")
    result = run(out, *SMALL, *aircraft)
    assert result.exit_code == 0
    assert (out / "dem.tif").is_file()
    assert [path.name for path in (out / "frames").iterdir()] == ["frame_0001.png"]
    assert "alt_amsl_m,roll_deg,pitch_deg,yaw_deg\n" in (out / "truth.csv").read_text()


def test_contradicting_errors_end_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["synth", str(tmp_path / "flight"), *SMALL, "--lose-messages", "0.1"])
    assert ended.value.code == SyntheticFlightError.exit_code
    assert "--camera-messages" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "wrong",
    [
        ("--kind", "moon"),
        ("--overlap", "1.5"),
        ("--frames", "0"),
        ("--mount-roll", "31"),
        ("--lens-k1", "nan"),
        ("--relief-m", "-1"),
    ],
)
def test_wrong_values_are_refused_before_rendering(wrong: tuple[str, str], tmp_path: Path) -> None:
    result = run(tmp_path / "flight", *wrong)
    assert result.exit_code == 2
    assert wrong[0] in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_stressed_flight_is_another_flight(tmp_path: Path) -> None:
    assert run(tmp_path / "healthy", *SMALL).exit_code == 0
    result = run(tmp_path / "faded", *SMALL, "--stress", "textureless=0.5")
    assert result.exit_code == 0
    names = sorted(path.name for path in (tmp_path / "healthy" / "frames").iterdir())
    for name in names:
        frames = [(tmp_path / kind / "frames" / name).read_bytes() for kind in ("healthy", "faded")]
        assert frames[0] != frames[1]
    for part in ("map.tif", "flight.tlog", "truth.csv"):
        parts = [(tmp_path / kind / part).read_bytes() for kind in ("healthy", "faded")]
        assert parts[0] == parts[1]


@pytest.mark.parametrize("wrong", ["haunted", "outdated=1.5", "outdated=", "outdated=much"])
def test_unknown_stress_is_refused(wrong: str, tmp_path: Path) -> None:
    result = run(tmp_path / "flight", *SMALL, "--stress", wrong)
    assert result.exit_code == 2
    assert "--stress" in result.stderr
    assert list(tmp_path.iterdir()) == []
