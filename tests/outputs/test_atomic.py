import os
from pathlib import Path

import pytest
from frame_results import listing

from uasthn_cli.errors import OutputError
from uasthn_cli.outputs import atomic


def test_writes_text_as_utf8_with_its_own_line_ends(tmp_path: Path) -> None:
    atomic.write_text(tmp_path / "a.txt", "ä\n°\r\n")
    assert (tmp_path / "a.txt").read_bytes() == b"\xc3\xa4\n\xc2\xb0\r\n"


def test_replaces_and_leaves_nothing_else_behind(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old and longer")
    atomic.write_bytes(target, b"new")
    assert target.read_bytes() == b"new"
    assert listing(tmp_path) == ["a.txt"]


def test_file_gets_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("x")
    atomic.write_text(tmp_path / "atomic", "x")
    assert (tmp_path / "atomic").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_failing_rename_leaves_the_old_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")

    def full_disk(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OutputError, match="No space left on device") as raised:
        atomic.write_text(target, "new")
    assert str(tmp_path) in str(raised.value)
    assert target.read_text() == "old"
    assert listing(tmp_path) == ["a.txt"]


def test_interrupt_while_staging_leaves_no_temporary_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(handle: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        atomic.write_text(tmp_path / "a.txt", "new")
    assert listing(tmp_path) == []


def test_a_set_is_staged_in_full_before_anything_is_replaced(tmp_path: Path) -> None:
    first, marker = tmp_path / "first", tmp_path / "marker"
    first.write_text("old")
    marker.write_text("old")
    unwritable = tmp_path / "missing" / "second"
    with pytest.raises(OutputError):
        atomic.write_files([(first, b"new"), (unwritable, b"x"), (marker, b"new")], marker)
    assert first.read_text() == marker.read_text() == "old"
    assert listing(tmp_path) == ["first", "marker"]


def test_the_marker_is_absent_while_the_set_is_mixed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, marker = tmp_path / "first", tmp_path / "marker"
    marker.write_text("old")
    seen: list[bool] = []
    rename = Path.replace

    def watched(self: Path, target: Path) -> Path:
        seen.append(marker.exists())
        return rename(self, target)

    monkeypatch.setattr(Path, "replace", watched)
    atomic.write_files([(first, b"new"), (marker, b"new")], marker)
    assert seen == [False, False]
    assert marker.read_text() == "new"


def test_below_a_regular_file_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="Not a directory"):
        atomic.write_text(tmp_path / "file" / "a.txt", "x")


def test_leftovers_of_a_killed_process_are_removed_and_nothing_else(tmp_path: Path) -> None:
    for name in (".a.csv.123.tmp", ".b.csv.123.tmp", "a.csv"):
        (tmp_path / name).write_text("")
    atomic.remove_leftovers(tmp_path / "a.csv")
    assert listing(tmp_path) == [".b.csv.123.tmp", "a.csv"]
