import json
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from frame_results import make_failure, make_fix, make_record, make_rejected, truth_table
from report_runs import FIVE_ROWS, fused_rows, write_folder

from uasthn_cli.commands.report import report
from uasthn_cli.errors import GateMissedError, MissingExtraError, OutputError, ResultsError
from uasthn_cli.outputs.run_writer import write_run
from uasthn_cli.outputs.truth import read_truth
from uasthn_cli.types import FrameResult


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(report, [str(argument) for argument in arguments])


def test_table_of_two_runs_is_plain_uncut_text(tmp_path: Path) -> None:
    long = tmp_path / "a_folder_with_quite_a_long_name_that_a_narrow_terminal_would_cut_[bold]"
    result = run(write_folder(long), write_folder(tmp_path / "two"))
    assert result.exit_code == 0
    assert result.stderr == ""
    assert "\x1b" not in result.stdout
    header = result.stdout.splitlines()[0]
    assert str(long) in header
    assert str(tmp_path / "two") in header
    (line,) = (line for line in result.stdout.splitlines() if "CE median, accepted" in line[:20])
    assert line.count("17.00") == 2


def test_json_list_is_all_that_stdout_holds(tmp_path: Path) -> None:
    result = run(write_folder(tmp_path / "out"), "--json", "--tolerance-m", "30")
    (summary,) = json.loads(result.stdout)
    assert summary["run"] == str(tmp_path / "out")
    assert summary["tolerance_m"] == 30.0
    assert summary["accuracy"]["within_accepted"] == 1.0
    assert summary["baseline_prior"] is None


def test_baseline_prior(tmp_path: Path) -> None:
    result = run(write_folder(tmp_path / "out"), "--baseline", "prior", "--json")
    assert json.loads(result.stdout)[0]["baseline_prior"]["ce_all"]["median_m"] == 40.0
    assert "prior of" in run(tmp_path / "out", "--baseline", "prior").stdout


def test_a_run_without_a_baseline_is_named_on_stderr(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "out", with_truth=False)
    result = run(folder, "--baseline", "prior", "--json")
    assert result.exit_code == 0
    assert result.stderr == f"{folder}: no baseline, there are no true camera positions\n"
    assert json.loads(result.stdout)[0]["baseline_prior"] is None


def test_missed_gates_of_all_runs_end_in_one_error_after_the_figures(tmp_path: Path) -> None:
    bad = write_folder(tmp_path / "bad")
    good = write_folder(tmp_path / "good", FIVE_ROWS[:1])
    result = run(good, bad, "--json", "--min-accepted", "0.5", "--max-ce", "10")
    assert isinstance(result.exception, GateMissedError)
    assert result.exception.exit_code == 4
    assert str(result.exception) == (
        f"{bad}: accepted fraction 0.400 is below --min-accepted 0.5; "
        f"{bad}: median CE of accepted frames 17.00 m exceeds --max-ce 10"
    )
    assert len(json.loads(result.stdout)) == 2


def test_within25_is_judged_at_25_m_whatever_the_tolerance(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "out")
    result = run(folder, "--tolerance-m", "1000", "--min-within25", "0.95")
    assert isinstance(result.exception, GateMissedError)
    assert run(folder, "--tolerance-m", "1", "--min-within25", "0.5").exit_code == 0


def test_a_bad_folder_is_an_error_before_anything_is_printed(tmp_path: Path) -> None:
    result = run(write_folder(tmp_path / "out"), tmp_path / "absent")
    assert isinstance(result.exception, ResultsError)
    assert result.stdout == ""


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["DIR", "--min-accepted", "50"],
        ["DIR", "--min-within25", "nan"],
        ["DIR", "--max-ce", "nan"],
        ["DIR", "--tolerance-m", "0"],
        ["DIR", "--baseline", "magic"],
        ["DIR", "--max-risk", "5"],
        ["DIR", "--min-ce90-coverage", "-0.1"],
        ["DIR", "--figure-format", "gif"],
    ],
)
def test_nonsense_is_a_usage_error(options: list[str]) -> None:
    assert run(*options).exit_code == 2


def test_help_states_what_the_gates_judge_and_shows_examples() -> None:
    text = " ".join(run("--help").stdout.split())
    assert "Largest median CE of accepted frames" in text
    assert "uasthn report out/radius200 out/radius450 --baseline prior" in text


def test_trust_is_in_the_table_when_asked_for_and_in_json_always(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "out", fused_rows())
    assert "AUC" not in run(folder).stdout
    assert "single: CE median" in run(folder).stdout
    table = run(folder, "--trust").stdout
    (figures,) = json.loads(run(folder, "--json").stdout)
    for answer, label in ((figures, "AUC of risk"), (figures["single"], "single: AUC of risk")):
        auc = answer["trust"]["signals"]["risk"]["auc"]
        (line,) = (line for line in table.splitlines() if line.startswith(label))
        assert f"{auc:.3f}" in line
    assert len(figures["trust"]["reliability"]) == 6


def test_gates_of_trust(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "out", fused_rows())
    assert run(folder, "--max-risk", "1", "--min-ce90-coverage", "0").exit_code == 0
    result = run(folder, "--max-risk", "0", "--min-ce90-coverage", "1", "--tolerance-m", "5")
    assert isinstance(result.exception, GateMissedError)
    assert "beyond 5 m" in str(result.exception)
    assert "--min-ce90-coverage 1" in str(result.exception)


def test_figures_of_fused_and_single_answers_beside_the_table(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "out", fused_rows())
    pictures = tmp_path / "new" / "pictures"
    result = run(folder, "--figures", pictures)
    assert result.exit_code == 0
    assert result.stdout == run(folder).stdout
    names = ("errors", "reliability", "risk-coverage", "roc")
    written = sorted(path.name for path in pictures.iterdir())
    assert written == sorted(f"out{kind}-{name}.png" for kind in ("", "-single") for name in names)


def test_figures_that_exist_are_replaced_only_when_asked(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "out")
    assert run(folder, "--figures", tmp_path).exit_code == 0
    picture = tmp_path / "out-errors.png"
    content = picture.read_bytes()
    picture.write_bytes(b"other")
    refused = run(folder, "--figures", tmp_path)
    assert isinstance(refused.exception, OutputError)
    assert "--overwrite" in str(refused.exception)
    assert picture.read_bytes() == b"other"
    assert run(folder, "--figures", tmp_path, "--overwrite").exit_code == 0
    assert picture.read_bytes() == content


def test_runs_of_the_same_name_do_not_share_files_and_missing_figures_are_told(
    tmp_path: Path,
) -> None:
    folders = [write_folder(tmp_path / place / "results") for place in ("a", "b")]
    pictures = tmp_path / "pictures"
    result = run(*folders, "--figures", pictures, "--figure-format", "svg")
    written = sorted(path.name for path in pictures.iterdir())
    assert written == ["results-2-errors.svg", "results-errors.svg"]
    assert f"{folders[0]}: no roc figure, it needs uncertainties of answers" in result.stderr
    untrue = write_folder(tmp_path / "untrue", with_truth=False)
    assert run(untrue, "--figures", tmp_path / "none").exit_code == 0
    assert not (tmp_path / "none").exists()


def test_a_folder_of_figures_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "out")
    result = run(folder, "--figures", folder / "frames.csv" / "pictures")
    assert isinstance(result.exception, OutputError)
    assert "cannot make" in str(result.exception)


def test_figures_without_matplotlib_are_refused_before_anything_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("report.drawing", "report.figures", "commands.report_figures"):
        monkeypatch.delitem(sys.modules, f"uasthn_cli.{module}", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    folder = write_folder(tmp_path / "out")
    result = run(folder, "--figures", tmp_path / "pictures")
    assert isinstance(result.exception, MissingExtraError)
    assert result.stdout == ""
    assert run(folder, "--trust").exit_code == 0


def test_a_folder_as_the_writer_leaves_it(tmp_path: Path) -> None:
    (tmp_path / "truth.csv").write_text(truth_table({"frame": "a.png"}, {"frame": "b.png"}))
    truth = read_truth(tmp_path / "truth.csv")
    results: list[FrameResult] = [make_fix(), make_rejected(), make_failure()]
    write_run(tmp_path, results, make_record(), truth, None)
    result = run(tmp_path, "--json", "--baseline", "prior", "--min-accepted", "0.3")
    (summary,) = json.loads(result.stdout)
    assert (summary["frames"], summary["accepted"]) == (3, 1)
    assert summary["accuracy"]["ce_accepted"]["median_m"] == 0.0
    assert summary["accuracy"]["within_all"] == pytest.approx(2 / 3)
    assert summary["baseline_prior"]["ce_all"]["median_m"] == pytest.approx(75.25, abs=0.2)
