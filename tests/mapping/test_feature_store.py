"""Kept features are those that would be computed now, or they are not used."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uasthn_cli.mapping.feature_store import (
    FeatureStore,
    default_cache_dir,
    open_store,
    window_key,
)
from uasthn_cli.pipeline.parallel import in_order
from uasthn_cli.types import GridBox, MapGrid, MapStatistics, MapWindow

KEYS = [f"{number:064x}" for number in range(8)]
VALUES = np.random.default_rng(5).normal(size=(3, 6, 8)).astype(np.float16)


def window(**changes: Any) -> MapWindow:
    image = np.linspace(0.0, 1.0, 8 * 6 * 3, dtype=np.float32).reshape(6, 8, 3)
    fields: dict[str, Any] = {
        "image": image,
        "valid": np.ones((6, 8), dtype=np.bool_),
        "box": GridBox(0, 0, 8, 6),
        "grid": MapGrid(2.0),
        "statistics": MapStatistics((0.5, 0.5, 0.5), 0.2),
    }
    return MapWindow(**(fields | changes))


def test_what_was_put_is_what_is_got(tmp_path: Path) -> None:
    store = FeatureStore(tmp_path / "not" / "there yet")
    assert store.get(KEYS[0]) is None
    store.put(KEYS[0], VALUES)
    got = FeatureStore(tmp_path / "not" / "there yet").get(KEYS[0])
    assert got is not None
    assert got.dtype == np.float16
    np.testing.assert_array_equal(got, VALUES)
    assert store.get(KEYS[1]) is None
    assert [path.name for path in (tmp_path / "not" / "there yet").iterdir()] == [
        f"{KEYS[0]}.features"
    ]


@pytest.mark.parametrize(
    "changes",
    [
        {"image": np.zeros((6, 8, 3), dtype=np.float32)},
        {"valid": np.zeros((6, 8), dtype=np.bool_)},
        {"grid": MapGrid(2.5)},
        {"statistics": MapStatistics((0.5, 0.5, 0.5), 0.2000001)},
    ],
    ids=["image", "valid", "gsd", "statistics"],
)
def test_the_name_says_all_that_shapes_features(changes: dict[str, Any]) -> None:
    assert window_key(window(**changes), "a") != window_key(window(), "a")
    assert window_key(window(), "b") != window_key(window(), "a")
    assert window_key(window(box=GridBox(8, 16, 8, 6)), "a") == window_key(window(), "a")


def test_the_least_recently_used_go_when_it_is_full(tmp_path: Path) -> None:
    FeatureStore(tmp_path).put(KEYS[0], VALUES)
    entry_bytes = next(tmp_path.iterdir()).stat().st_size
    store = FeatureStore(tmp_path, max_bytes=3 * entry_bytes)
    for key in KEYS[1:3]:
        time.sleep(0.01)
        store.put(key, VALUES)
    time.sleep(0.01)
    assert store.get(KEYS[0]) is not None
    time.sleep(0.01)
    store.put(KEYS[3], VALUES)
    assert [store.get(key) is not None for key in KEYS[:4]] == [True, False, True, True]
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 3 * entry_bytes


def test_what_is_larger_than_the_whole_store_is_not_kept(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    FeatureStore(tmp_path, max_bytes=100).put(KEYS[0], VALUES)
    assert list(tmp_path.iterdir()) == []
    assert caplog.records == []


def test_files_of_others_are_left_alone_and_abandoned_ones_removed(tmp_path: Path) -> None:
    (tmp_path / "holiday.jpg").write_bytes(b"x" * 10_000)
    old, new = tmp_path / f".{KEYS[5]}.aa.features.tmp", tmp_path / f".{KEYS[6]}.bb.features.tmp"
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (time.time() - 7200, time.time() - 7200))
    store = FeatureStore(tmp_path, max_bytes=1000)
    for key in KEYS[:5]:
        store.put(key, VALUES)
    assert (tmp_path / "holiday.jpg").exists()
    assert new.exists()
    assert not old.exists()


def test_a_full_disk_costs_one_warning_and_leaves_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    write = Path.write_bytes

    def write_half(self: Path, content: bytes) -> int:
        write(self, content[: len(content) // 2])
        raise OSError(28, "No space left on device")

    store = FeatureStore(tmp_path)
    store.put(KEYS[0], VALUES)
    monkeypatch.setattr(Path, "write_bytes", write_half)
    for key in KEYS[1:4]:
        store.put(key, VALUES)
    assert [record.message for record in caplog.records] == [
        f"map features are not kept for later runs: {tmp_path}: No space left on device"
    ]
    assert [path.name for path in tmp_path.iterdir()] == [f"{KEYS[0]}.features"]
    assert store.get(KEYS[0]) is not None


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes anywhere")
def test_a_folder_that_is_only_read_still_serves(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = FeatureStore(tmp_path)
    store.put(KEYS[0], VALUES)
    tmp_path.chmod(0o500)
    try:
        for key in KEYS[1:3]:
            store.put(key, VALUES)
        assert store.get(KEYS[0]) is not None
    finally:
        tmp_path.chmod(0o700)
    assert len(caplog.records) == 1


def test_an_entry_whose_use_cannot_be_noted_still_serves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    store = FeatureStore(tmp_path)
    store.put(KEYS[0], VALUES)
    for function in ("utime", "replace", "mkdir"):
        monkeypatch.setattr(os, function, refuse)
    monkeypatch.setattr(Path, "write_bytes", refuse)
    for key in KEYS[1:3]:
        store.put(key, VALUES)
    assert store.get(KEYS[0]) is not None
    assert len(caplog.records) == 1


def test_what_cannot_be_read_is_computed_with_one_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = FeatureStore(tmp_path)
    for key in KEYS[:2]:
        (tmp_path / f"{key}.features").mkdir()
    assert [store.get(key) for key in KEYS[:2]] == [None, None]
    assert len(caplog.records) == 1


def test_a_store_is_not_looked_through_for_every_entry(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    entry_bytes = 64 + VALUES.nbytes
    looks: list[Any] = []
    monkeypatch.setattr(os, "scandir", _counting(os.scandir, looks))
    store = FeatureStore(tmp_path, max_bytes=1024 * entry_bytes)
    for number in range(1500):
        store.put(f"{number:064x}", VALUES)
    assert 0 < len(looks) < 1500 // 5
    kept_bytes = sum(path.stat().st_size for path in tmp_path.iterdir())
    assert 0.9 * 1024 * entry_bytes < kept_bytes <= 1024 * entry_bytes
    assert store.get(f"{1499:064x}") is not None
    assert store.get(f"{0:064x}") is None


def _counting(scan: Callable[..., Any], looks: list[Any]) -> Callable[..., Any]:
    def counted(folder: Any) -> Any:
        looks.append(folder)
        return scan(folder)

    return counted


@pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux alone")
def test_processes_put_and_get_the_same_entries(tmp_path: Path) -> None:
    entry_bytes = 64 + VALUES.nbytes
    store = FeatureStore(tmp_path, max_bytes=4 * entry_bytes)

    def work(number: int) -> bool:
        key = KEYS[number % 8]
        store.put(key, VALUES + np.float16(number % 8))
        got = store.get(key)
        return got is None or bool((got == VALUES + np.float16(number % 8)).all())

    assert all(in_order(work, range(200), 4))
    assert not list(tmp_path.glob("*.tmp")) + list(tmp_path.glob(".*"))


_WRITER = """
import sys
from collections.abc import Callable
from pathlib import Path
import numpy as np
from uasthn_cli.mapping.feature_store import FeatureStore
from uasthn_cli.pipeline.parallel import in_order

store, key = FeatureStore(Path(sys.argv[1])), "a" * 64
values = np.linspace(0.0, 1.0, 98 * 64 * 64).reshape(98, 64, 64).astype(np.float16)
for _ in range(60):
    store.put(key, values)
    got = store.get(key)
    assert got is not None and got.tobytes() == values.tobytes()
"""


def test_two_processes_write_the_same_entry_at_once(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _WRITER, str(tmp_path)]
    both = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    for process in both:
        _, said = process.communicate(timeout=120)
        assert process.returncode == 0, said
        assert said == ""
    assert [path.name for path in tmp_path.iterdir()] == ["a" * 64 + ".features"]


def test_a_folder_has_one_store_in_a_process(tmp_path: Path) -> None:
    assert open_store(tmp_path) is open_store(tmp_path)
    assert open_store(tmp_path) is not open_store(tmp_path / "other")


def test_the_folder_is_the_users_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert default_cache_dir() == tmp_path / "uasthn" / "features"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_cache_dir() == tmp_path / ".cache" / "uasthn" / "features"
