import re
from pathlib import Path

import pytest
from answer_tables import make_answers, write_results
from click.testing import CliRunner, Result

from uasthn_cli.commands.calibrate import calibrate
from uasthn_cli.errors import CalibrationError, OutputError, ResultsError
from uasthn_cli.uncertainty.calibration import load_calibration


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(calibrate, [str(argument) for argument in arguments])


@pytest.fixture
def flights(tmp_path: Path) -> list[Path]:
    return [
        write_results(
            tmp_path / name,
            make_answers(400, seed, wrong=0.02, agreement=True),
            make_answers(400, seed + 10, wrong=0.05),
        )
        for seed, name in enumerate(("a", "b"))
    ]


def test_file_and_table_agree(flights: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "calibration.json"
    result = run(*flights, "--out", out, "--risk", "0.06")
    assert result.exit_code == 0, result.output
    calibration = load_calibration(out)
    fused = calibration.fused
    assert fused is not None
    assert calibration.target_risk == 0.06
    assert "true positions of a, b; seed 0" in calibration.note
    lines = {
        line[:40].split("  ")[0]: re.split(r"\s{2,}", line)[1:]
        for line in result.stdout.splitlines()
    }
    assert lines["answers"] == ["single", "fused"]
    single = calibration.single
    assert lines["accepted beyond 25 m"] == [
        f"{single.errors} of {single.accepted}",
        f"{fused.errors} of {fused.accepted}",
    ]
    assert lines["CE90 scale"] == [f"{single.ce90_scale:.3f}", f"{fused.ce90_scale:.3f}"]
    assert lines["certified risk, confidence 0.9"] == ["<= 0.06", "<= 0.06"]


def test_same_seed_same_bytes_another_seed_others(tmp_path: Path) -> None:
    single = write_results(tmp_path / "c", make_answers(800, 5, wrong=0.02))
    contents = []
    for name, seed in (("1", "0"), ("2", "0"), ("3", "1")):
        assert run(single, "--seed", seed, "--out", tmp_path / name).exit_code == 0
        contents.append((tmp_path / name).read_bytes())
    assert contents[0] == contents[1] != contents[2]


def test_a_file_that_is_there_is_kept_unless_told(flights: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "calibration.json"
    out.write_text("mine")
    result = run(*flights, "--out", out)
    assert isinstance(result.exception, OutputError)
    assert out.read_text() == "mine"
    assert run(*flights, "--out", out, "--overwrite").exit_code == 0
    load_calibration(out)


def test_from_gps_takes_a_stretch(flights: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "calibration.json"
    # frames begin at 2025-11-22T08:26:40Z, one a second: 301 of 400
    stretch = "2025-11-22T08:26:40Z..2025-11-22T08:31:40Z"
    result = run(*flights, "--from-gps", stretch, "--out", out)
    assert result.exit_code == 0, result.output
    calibration = load_calibration(out)
    assert calibration.single.frames == calibration.single.fit_frames == 301
    assert "logged GPS positions of a, b" in calibration.note


def test_what_cannot_be_certified_writes_nothing(tmp_path: Path) -> None:
    out = tmp_path / "calibration.json"
    result = run(write_results(tmp_path / "a", make_answers(40, 1)), "--out", out)
    assert isinstance(result.exception, CalibrationError)
    assert result.exception.exit_code == 25
    assert not out.exists()
    assert result.stdout == ""


def test_a_bad_folder(tmp_path: Path) -> None:
    result = run(tmp_path / "absent", "--out", tmp_path / "calibration.json")
    assert isinstance(result.exception, ResultsError)


@pytest.mark.parametrize(
    "options",
    [
        ["DIR"],
        ["--out", "c.json"],
        ["DIR", "--out", "c.json", "--risk", "0"],
        ["DIR", "--out", "c.json", "--risk", "nan"],
        ["DIR", "--out", "c.json", "--confidence", "1"],
        ["DIR", "--out", "c.json", "--thin", "0"],
        ["DIR", "--out", "c.json", "--from-gps", "sometimes"],
        ["DIR", "--out", "c.json", "--from-gps", ".."],
        ["DIR", "--out", "c.json", "--from-gps", "noon.."],
        ["DIR", "--out", "c.json", "--from-gps", "2025-11-22T09:00:00Z..2025-11-22T08:00:00Z"],
    ],
)
def test_nonsense_is_a_usage_error(options: list[str]) -> None:
    assert run(*options).exit_code == 2


def test_help_shows_examples() -> None:
    text = run("--help").stdout
    assert "uasthn calibrate out/a out/b --out calibration.json" in text
    assert "--from-gps 2025-11-22T08:40:00Z..2025-11-22T08:52:00Z" in text
