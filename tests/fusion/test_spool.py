"""What lies in a file comes back as it was, one entry at a time, and leaves no trace."""

import gc
import tempfile
from pathlib import Path

import numpy as np
import pytest

from uasthn_cli.errors import OutputError
from uasthn_cli.fusion.spool import LikelihoodSpool, Spool
from uasthn_cli.types import OffsetLikelihood


def numbered(number: int) -> np.ndarray:
    return np.arange(6, dtype=np.float32).reshape(2, 3) + 10 * number


def filled(count: int) -> Spool[np.float32]:
    spool = Spool((2, 3), np.float32)
    for number in range(count):
        spool.append(numbered(number))
    return spool


def test_arrays_are_read_by_place_and_in_order() -> None:
    spool = filled(5)
    assert len(spool) == 5
    assert spool[3].tolist() == numbered(3).tolist()
    assert spool[-1].tolist() == numbered(4).tolist()
    assert [values[0, 0] for values in spool] == [0.0, 10.0, 20.0, 30.0, 40.0]
    assert [values[0, 0] for values in spool[::-2]] == [40.0, 20.0, 0.0]
    with pytest.raises(IndexError):
        spool[5]


def test_an_array_is_written_over_another() -> None:
    spool = filled(3)
    spool.replace(1, numbered(7))
    spool.append(numbered(9))
    assert [values[0, 0] for values in spool] == [0.0, 70.0, 20.0, 90.0]


def test_what_was_read_does_not_change_the_file() -> None:
    spool = filled(1)
    spool[0].fill(5.0)
    assert spool[0].tolist() == numbered(0).tolist()


def test_only_arrays_of_its_shape_are_taken() -> None:
    with pytest.raises(AssertionError, match="one shape"):
        filled(1).append(np.zeros((3, 2), np.float32))


def test_nothing_is_left_in_the_temporary_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    spool = filled(100)
    assert len(spool[99]) == 2
    del spool
    gc.collect()
    assert list(tmp_path.iterdir()) == []


def test_no_room_is_a_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    with pytest.raises(OutputError, match="TMPDIR names another place"):
        filled(1)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_is_a_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(**_: object) -> object:
        return Path("/dev/full").open("r+b", buffering=0)

    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    with pytest.raises(OutputError, match="No space left on device"):
        filled(1)


def said(level: int, east_m: float) -> OffsetLikelihood:
    return OffsetLikelihood(np.full((3, 3), level, np.uint8), 2.0, np.array([east_m, 0.0]))


def test_likelihoods_keep_their_centres_and_silence_in_any_order() -> None:
    spool = LikelihoodSpool([said(1, 10.0), None, said(3, 30.0)])
    assert spool.says_anything
    seen = [None if e is None else (e.levels[1, 1], e.centre_m[0], e.cell_m) for e in spool]
    assert seen == [(1, 10.0, 2.0), None, (3, 30.0, 2.0)]
    turned = spool.in_order([2, 0, 1])
    assert [None if e is None else e.centre_m[0] for e in turned] == [30.0, 10.0, None]


def test_frames_that_say_nothing_need_no_file() -> None:
    silent = LikelihoodSpool([None, None])
    assert not silent.says_anything
    assert list(silent) == [None, None]
