import logging
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from frame_results import listing, make_failure, make_fix, make_rejected

from uasthn_cli.errors import OutputError
from uasthn_cli.outputs.journal import JOURNAL_NAME, Journal
from uasthn_cli.outputs.table import frames_csv
from uasthn_cli.types import FrameResult


def finished_names(folder: Path, fingerprint: str = "f") -> list[str]:
    with Journal(folder, fingerprint) as journal:
        return list(journal.finished)


def test_finished_frames_are_read_back_and_added_to(tmp_path: Path) -> None:
    with Journal(tmp_path, "f") as journal:
        journal.append(make_fix("1.png"))
        journal.append(make_failure("2.png"))
        assert list(journal.finished) == ["1.png", "2.png"]
    with Journal(tmp_path, "f") as journal:
        assert list(journal.finished) == ["1.png", "2.png"]
        journal.append(make_rejected("3.png"))
    assert finished_names(tmp_path) == ["1.png", "2.png", "3.png"]


def test_results_read_back_write_the_same_table(tmp_path: Path) -> None:
    results: list[FrameResult] = [
        make_fix("1.png", lat_deg=0.1 + 0.2),
        make_rejected("2.png"),
        make_failure("3.png"),
    ]
    with Journal(tmp_path, "f") as journal:
        for result in results:
            journal.append(result)
    with Journal(tmp_path, "f") as journal:
        again = [journal.finished[name] for name in ("1.png", "2.png", "3.png")]
    assert frames_csv(again, None, "EPSG:32640") == frames_csv(results, None, "EPSG:32640")


@pytest.mark.parametrize("torn_bytes", [1, 2, 40])
def test_a_torn_last_line_is_cut_off_and_written_over(tmp_path: Path, torn_bytes: int) -> None:
    with Journal(tmp_path, "f") as journal:
        journal.append(make_fix("1.png"))
        journal.append(make_fix("2.png"))
    path = tmp_path / JOURNAL_NAME
    path.write_bytes(path.read_bytes()[:-torn_bytes])
    with Journal(tmp_path, "f") as journal:
        assert list(journal.finished) == ["1.png"]
        journal.append(make_fix("3.png"))
    assert finished_names(tmp_path) == ["1.png", "3.png"]
    assert path.read_bytes().count(b"\n") == 3


def test_blocks_of_zeros_after_a_power_cut_are_cut_off(tmp_path: Path) -> None:
    with Journal(tmp_path, "f") as journal:
        journal.append(make_fix("1.png"))
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
    with caplog.at_level(logging.WARNING), Journal(tmp_path, "f") as journal:
        assert not journal.finished
        journal.append(make_fix("1.png"))
    assert "discarded" in caplog.text
    assert finished_names(tmp_path) == ["1.png"]


def test_other_arguments_start_afresh(tmp_path: Path) -> None:
    with Journal(tmp_path, "f") as journal:
        journal.append(make_fix("1.png"))
    assert finished_names(tmp_path, "g") == []
    assert finished_names(tmp_path, "f") == []


def test_a_new_journal_is_silent(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), Journal(tmp_path, "f"):
        assert caplog.text == ""


def test_removed_once_the_results_stand(tmp_path: Path) -> None:
    with Journal(tmp_path, "f") as journal:
        journal.append(make_fix())
        journal.remove()
    assert listing(tmp_path) == []


def test_an_error_in_the_run_keeps_the_journal(tmp_path: Path) -> None:
    def interrupted_run() -> None:
        with Journal(tmp_path, "f") as journal:
            journal.append(make_fix("1.png"))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted_run()
    assert finished_names(tmp_path) == ["1.png"]


def test_an_unwritable_folder_is_a_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="Not a directory"):
        Journal(tmp_path / "file", "f")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_is_a_clear_error_and_keeps_what_was_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run_until_full() -> None:
        with Path("/dev/full").open("wb") as full, Journal(tmp_path, "f") as journal:
            journal.append(make_fix("1.png"))
            monkeypatch.setattr(journal, "_file", full)
            journal.append(make_fix("2.png"))

    with pytest.raises(OutputError, match=r"cannot write .*jsonl: No space left on device"):
        run_until_full()
    assert finished_names(tmp_path) == ["1.png"]


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL does not exist on Windows")
def test_frames_finished_before_a_kill_survive_it(tmp_path: Path) -> None:
    program = textwrap.dedent(
        """
        import os, signal, sys
        from pathlib import Path
        from frame_results import listing, make_fix
        from uasthn_cli.outputs.journal import Journal
        journal = Journal(Path(sys.argv[1]), "f")
        for k in range(5):
            journal.append(make_fix(f"{k}.png", lat_deg=k / 3))
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
    with Journal(tmp_path, "f") as journal:
        latitudes = [getattr(result, "lat_deg", None) for result in journal.finished.values()]
    assert latitudes == [k / 3 for k in range(5)]
