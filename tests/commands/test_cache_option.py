"""Features kept on disk make runs faster and change nothing else."""

from pathlib import Path

import pytest
from click.testing import CliRunner
from small_flight import Flight

from uasthn_cli.commands.main import main
from uasthn_cli.matching.xcorr import XcorrEstimator


def geotag(flight: Flight, out: Path, *options: str) -> dict[str, bytes]:
    """Run the learned estimator and return the files of results."""
    arguments = flight.arguments(out, "--estimator", "xcorr", "--symmetries", "1", *options)
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.stderr
    return {name: (out / name).read_bytes() for name in ("frames.csv", "frames.geojson")}


def test_results_are_the_same_without_a_cache_with_a_cold_and_a_warm_one(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = tmp_path / "cache"
    without = geotag(flight, tmp_path / "without", "--cache", "none")
    cold = geotag(flight, tmp_path / "cold", "--cache", str(cache))
    assert list(cache.glob("*.features"))

    def refuse(*_: object) -> None:
        raise AssertionError("encoded again")

    monkeypatch.setattr(XcorrEstimator, "encode_map", refuse)
    warm = geotag(flight, tmp_path / "warm", "--cache", str(cache))
    assert without == cold == warm


def test_the_environment_says_where(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UASTHN_CACHE", str(tmp_path / "there"))
    geotag(flight, tmp_path / "first")
    assert list((tmp_path / "there").glob("*.features"))
    monkeypatch.setenv("UASTHN_CACHE", "none")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    geotag(flight, tmp_path / "second")
    assert not (tmp_path / "home").exists()


def test_a_file_is_no_folder_to_keep_features_in(flight: Flight, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    arguments = flight.arguments(tmp_path / "out", "--cache", str(tmp_path / "file"))
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert "is a file; give a folder, or none" in result.stderr
    assert not (tmp_path / "out").exists()
