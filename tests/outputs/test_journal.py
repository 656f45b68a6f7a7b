import logging
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from frame_results import (
    listing,
    located,
    make_failure,
    make_fix,
    make_located,
    make_refined_frame,
    make_rejected,
)

from uasthn_cli.errors import OutputError
from uasthn_cli.outputs.journal import JOURNAL_NAME, LOCATED, REFINED, Journal
from uasthn_cli.outputs.result_json import encode_located
from uasthn_cli.outputs.table import frames_csv
from uasthn_cli.types import FrameResult, RefinedFrame


def finished_names(folder: Path, fingerprint: str = "f") -> list[str]:
    with Journal(folder, fingerprint, LOCATED) as journal:
        return list(journal.finished)


def test_finished_frames_are_read_back_and_added_to(tmp_path: Path) -> None:
    with Journal(tmp_path, "f", LOCATED) as journal:
        journal.append(located(make_fix("1.png")))
        journal.append(located(make_failure("2.png")))
        assert list(journal.finished) == ["1.png", "2.png"]
    with Journal(tmp_path, "f", LOCATED) as journal:
        assert list(journal.finished) == ["1.png", "2.png"]
        journal.append(located(make_rejected("3.png")))
    assert finished_names(tmp_path) == ["1.png", "2.png", "3.png"]


def test_results_read_back_write_the_same_table(tmp_path: Path) -> None:
    results: list[FrameResult] = [
        make_fix("1.png", lat_deg=0.1 + 0.2),
        make_rejected("2.png"),
        make_failure("3.png"),
    ]
    with Journal(tmp_path, "f", LOCATED) as journal:
        for result in results:
            journal.append(located(result))
    with Journal(tmp_path, "f", LOCATED) as journal:
        again = [journal.finished[name].result for name in ("1.png", "2.png", "3.png")]
    lines = [list(frames_csv(these, None, "EPSG:32640")) for these in (again, results)]
    assert lines[0] == lines[1]


def test_both_kinds_are_kept_side_by_side(tmp_path: Path) -> None:
    with Journal(tmp_path, "f", LOCATED) as alone, Journal(tmp_path, "f", REFINED) as refined:
        alone.append(make_located("1.png"))
        alone.append(make_located("2.png"))
        refined.append(make_refined_frame("1.png"))
    with Journal(tmp_path, "f", LOCATED) as alone, Journal(tmp_path, "f", REFINED) as refined:
        assert list(alone.finished) == ["1.png", "2.png"]
        assert list(refined.finished) == ["1.png"]
        refined.remove()
    assert listing(tmp_path) == [JOURNAL_NAME]


def test_a_second_look_is_read_back_to_the_bit(tmp_path: Path) -> None:
    frames: dict[str, RefinedFrame] = {
        "seen.png": make_refined_frame("seen.png"),
        "blank.png": make_refined_frame("blank.png", likelihood=None),
        "gone.png": make_refined_frame("gone.png", likelihood=None, camera=None),
    }
    with Journal(tmp_path, "f", REFINED) as journal:
        for refined in frames.values():
            journal.append(refined)
    with Journal(tmp_path, "f", REFINED) as journal:
        again = dict(journal.finished)
    assert list(again) == list(frames)
    for name, refined in frames.items():
        assert (again[name].frame, again[name].camera) == (refined.frame, refined.camera)
        mine, theirs = refined.likelihood, again[name].likelihood
        if mine is None or theirs is None:
            assert mine is theirs
        else:
            assert theirs.log_likelihood.tobytes() == mine.log_likelihood.tobytes()
            assert theirs.centre_m.tolist() == mine.centre_m.tolist()
            assert theirs.cell_m == mine.cell_m


def test_entries_are_read_when_asked_for_while_others_are_written(tmp_path: Path) -> None:
    with Journal(tmp_path, "f", LOCATED) as journal:
        journal.append(make_located("1.png"))
        first = journal.finished["1.png"]
        journal.append(make_located("2.png", likelihood=None))
        assert journal.finished["1.png"] is not first, "memory keeps none"
        assert encode_located(journal.finished["1.png"]) == encode_located(make_located("1.png"))
        assert journal.finished["2.png"].likelihood is None
        with pytest.raises(KeyError):
            journal.finished["3.png"]
    assert finished_names(tmp_path) == ["1.png", "2.png"]


def test_a_line_that_changes_under_way_is_a_clear_error(tmp_path: Path) -> None:
    with Journal(tmp_path, "f", LOCATED) as journal:
        journal.append(make_located("1.png"))
        flip_a_digit(tmp_path / JOURNAL_NAME, 1)
        with pytest.raises(OutputError, match="can no longer be read"):
            journal.finished["1.png"]


def test_an_entry_of_the_other_kind_is_not_taken_over(tmp_path: Path) -> None:
    with Journal(tmp_path, "f", LOCATED) as journal:
        journal.append(make_located("1.png"))
    (tmp_path / JOURNAL_NAME).rename(tmp_path / REFINED.file_name)
    with Journal(tmp_path, "f", REFINED) as refined:
        assert not refined.finished


@pytest.mark.parametrize("torn_bytes", [1, 2, 40])
def test_a_torn_last_line_is_cut_off_and_written_over(tmp_path: Path, torn_bytes: int) -> None:
    with Journal(tmp_path, "f", LOCATED) as journal:
        journal.append(located(make_fix("1.png")))
        journal.append(located(make_fix("2.png")))
    path = tmp_path / JOURNAL_NAME
    path.write_bytes(path.read_bytes()[:-torn_bytes])
    with Journal(tmp_path, "f", LOCATED) as journal:
        assert list(journal.finished) == ["1.png"]
        journal.append(located(make_fix("3.png")))
    assert finished_names(tmp_path) == ["1.png", "3.png"]
    assert path.read_bytes().count(b"\n") == 3


def test_blocks_of_zeros_after_a_power_cut_are_cut_off(tmp_path: Path) -> None:
    with Journal(tmp_path, "f", LOCATED) as journal:
        journal.append(located(make_fix("1.png")))
    path = tmp_path / JOURNAL_NAME
    path.write_bytes(path.read_bytes() + b"\0" * 100 + b"\n")
    assert finished_names(tmp_path) == ["1.png"]
    assert b"\0" not in path.read_bytes()


@pytest.mark.parametrize(
    "content", [b"", b'{"finger', b"\0\0\0\n", b'{"fingerprint": "other"}\n{"kind": "fix"}\n']
)
def test_anything_but_the_own_first_line_is_discarded_with_a_log_line(
    tmp_path: Path, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / JOURNAL_NAME).write_bytes(content)
    with caplog.at_level(logging.WARNING), Journal(tmp_path, "f", LOCATED) as journal:
        assert not journal.finished
        journal.append(located(make_fix("1.png")))
    assert "discarded" in caplog.text
    assert finished_names(tmp_path) == ["1.png"]


def test_other_arguments_start_afresh(tmp_path: Path) -> None:
    with Journal(tmp_path, "f", LOCATED) as journal:
        journal.append(located(make_fix("1.png")))
    assert finished_names(tmp_path, "g") == []
    assert finished_names(tmp_path, "f") == []


def test_a_new_journal_is_silent(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), Journal(tmp_path, "f", LOCATED):
        assert caplog.text == ""


def test_removed_once_the_results_stand(tmp_path: Path) -> None:
    with Journal(tmp_path, "f", LOCATED) as journal:
        journal.append(located(make_fix()))
        journal.remove()
    assert listing(tmp_path) == []


def test_an_error_in_the_run_keeps_the_journal(tmp_path: Path) -> None:
    def interrupted_run() -> None:
        with Journal(tmp_path, "f", LOCATED) as journal:
            journal.append(located(make_fix("1.png")))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted_run()
    assert finished_names(tmp_path) == ["1.png"]


def test_an_unwritable_folder_is_a_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="Not a directory"):
        Journal(tmp_path / "file", "f", LOCATED)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_is_a_clear_error_and_keeps_what_was_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run_until_full() -> None:
        with Path("/dev/full").open("wb") as full, Journal(tmp_path, "f", LOCATED) as journal:
            journal.append(located(make_fix("1.png")))
            monkeypatch.setattr(journal, "_file", full)
            journal.append(located(make_fix("2.png")))

    with pytest.raises(OutputError, match=r"cannot write .*jsonl: No space left on device"):
        run_until_full()
    assert finished_names(tmp_path) == ["1.png"]


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL does not exist on Windows")
def test_frames_finished_before_a_kill_survive_it(tmp_path: Path) -> None:
    program = textwrap.dedent(
        """
        import os, signal, sys
        from pathlib import Path
        from frame_results import located, make_fix
        from uasthn_cli.outputs.journal import LOCATED, Journal
        journal = Journal(Path(sys.argv[1]), "f", LOCATED)
        for k in range(5):
            journal.append(located(make_fix(f"{k}.png", lat_deg=k / 3)))
        os.kill(os.getpid(), signal.SIGKILL)
        """
    )
    support = str(Path(__file__).parents[1] / "support")
    killed = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)],
        env=os.environ | {"PYTHONPATH": support},
        check=False,
    )
    assert killed.returncode == -signal.SIGKILL
    with Journal(tmp_path, "f", LOCATED) as journal:
        latitudes = [getattr(entry.result, "lat_deg", None) for entry in journal.finished.values()]
    assert latitudes == [k / 3 for k in range(5)]


def flip_a_digit(path: Path, line_number: int) -> None:
    """Change one digit in the middle of a line."""
    lines = path.read_bytes().splitlines(keepends=True)
    line = bytearray(lines[line_number])
    place = next(k for k in range(len(line) // 2, len(line)) if line[k : k + 1].isdigit())
    line[place] = ord("7") if line[place] != ord("7") else ord("3")
    lines[line_number] = bytes(line)
    path.write_bytes(b"".join(lines))


@pytest.mark.parametrize("damaged", [1, 2, 3])
def test_a_line_with_one_flipped_digit_is_computed_anew_and_the_others_stay(
    tmp_path: Path, damaged: int, caplog: pytest.LogCaptureFixture
) -> None:
    names = ["1.png", "2.png", "3.png"]
    with Journal(tmp_path, "f", LOCATED) as journal:
        for name in names:
            journal.append(make_located(name))
    flip_a_digit(tmp_path / JOURNAL_NAME, damaged)
    missing = names[damaged - 1]
    with caplog.at_level(logging.WARNING), Journal(tmp_path, "f", LOCATED) as journal:
        assert list(journal.finished) == [name for name in names if name != missing]
        journal.append(make_located(missing))
    assert "1 damaged lines" in caplog.text
    assert sorted(finished_names(tmp_path)) == names
