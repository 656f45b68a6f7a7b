"""``uasthn models``: list, info, pull and convert."""

import hashlib
import json
import sys
from pathlib import Path

import pytest
import torch
from click.testing import CliRunner, Result
from fake_hub import FakeHub, forget, pretend_hub
from small_displacement_models import small_model, small_weights

from uasthn_cli.commands.main import main
from uasthn_cli.matching.displacement.checkpoints import (
    load_displacement,
    serialise_checkpoint,
    serialise_folder,
)
from uasthn_cli.matching.registry import XCORR

REPOSITORY = "xjh19972/UASTHN"
COMMIT, LATER = "a" * 40, "b" * 40


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch) -> FakeHub:
    fake = pretend_hub(monkeypatch)
    fake.publish(REPOSITORY, COMMIT, serialise_folder(small_model("sthn")))
    return fake


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["models", *map(str, arguments)])


def pull(cache: Path, *arguments: str) -> Result:
    return run("pull", "uasthn", "--cache", cache, *arguments)


def test_what_is_in_the_box_and_what_is_not(tmp_path: Path, hub: FakeHub) -> None:
    listed = run("list", "--cache", tmp_path)
    assert listed.exit_code == 0
    assert listed.stdout.count("uasthn-xcorr-2") == 3
    assert f"{REPOSITORY} (not pulled yet)" in listed.stdout
    assert pull(tmp_path).exit_code == 0
    assert f"(pulled at {COMMIT[:12]})" in run("list", "--cache", tmp_path).stdout


@pytest.mark.parametrize("name", ["dhn", "ihn", "sthn"])
def test_info_of_our_own_weights(name: str, tmp_path: Path) -> None:
    path = small_weights(tmp_path, name)
    shown = json.loads(run("info", path, "--json").stdout)
    assert shown["estimator"] == name
    assert shown["layout"] == f"uasthn-{name}-1"
    assert shown["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert shown["size_bytes"] == path.stat().st_size
    tensors = load_displacement(path).tensors()
    assert shown["parameters"] == sum(value.numel() for value in tensors.values())
    text = run("info", path).stdout
    assert f"uasthn-{name}-1" in text
    assert "architecture: netG" in text


def test_info_of_the_weights_in_the_box_and_of_the_authors_layout(tmp_path: Path) -> None:
    assert (
        json.loads(run("info", XCORR.bundled_weights[0], "--json").stdout)["estimator"] == "xcorr"
    )
    path = tmp_path / "STHN_best_model.pth"
    path.write_bytes(serialise_checkpoint(small_model("sthn")))
    shown = json.loads(run("info", path, "--json").stdout)
    assert (shown["estimator"], shown["layout"]) == ("sthn", "authors' checkpoint")


def test_info_of_what_is_none(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "missing.pth", tmp_path / "missing.safetensors"):
        result = run("info", path)
        assert result.exit_code == 19
        assert result.stderr.startswith(f"uasthn: error: {path}")


def test_the_first_pull_is_recorded_and_later_ones_are_held_to_it(
    tmp_path: Path, hub: FakeHub
) -> None:
    first = pull(tmp_path)
    assert first.exit_code == 0
    folder = Path(first.stdout.strip())
    assert load_displacement(folder).name == "sthn"
    lock = json.loads((tmp_path / "models.lock.json").read_text())
    assert lock[REPOSITORY]["revision"] == COMMIT
    assert lock[REPOSITORY]["sha256"].keys() == {"config.json", "model.safetensors"}

    hub.publish(REPOSITORY, LATER, serialise_folder(small_model("ihn")))
    assert pull(tmp_path).stdout == first.stdout
    hub.is_online = False
    assert pull(tmp_path).stdout == first.stdout

    hub.is_online = True
    newer = pull(tmp_path, "--revision", LATER)
    assert newer.stdout.strip().endswith(LATER)
    assert json.loads((tmp_path / "models.lock.json").read_text())[REPOSITORY]["revision"] == LATER


def test_other_bytes_under_the_same_commit_are_refused(tmp_path: Path, hub: FakeHub) -> None:
    assert pull(tmp_path).exit_code == 0
    forget(tmp_path)
    hub.repositories.clear()
    hub.publish(REPOSITORY, COMMIT, serialise_folder(small_model("sthn", seed=2)))
    result = pull(tmp_path)
    assert result.exit_code == 19
    assert "not the file that was first pulled" in result.stderr


def test_a_hash_that_is_known_is_checked(tmp_path: Path, hub: FakeHub) -> None:
    weights = serialise_folder(small_model("sthn"))["model.safetensors"]
    result = pull(tmp_path, "--sha256", "0" * 64)
    assert result.exit_code == 19
    assert "SHA-256" in result.stderr
    assert not (tmp_path / "models.lock.json").exists()
    known = hashlib.sha256(weights).hexdigest().upper()
    assert pull(tmp_path, "--revision", COMMIT, "--sha256", known).exit_code == 0


def test_pickled_weights_are_taken_only_where_there_are_no_others(
    tmp_path: Path, hub: FakeHub
) -> None:
    content = serialise_checkpoint(small_model("ihn"))
    hub.publish("someone/else", COMMIT, {"pytorch_model.bin": content})
    result = run("pull", "someone/else", "--cache", tmp_path)
    assert result.exit_code == 0
    assert (Path(result.stdout.strip()) / "pytorch_model.bin").is_file()


def test_what_cannot_be_pulled_is_told_in_one_line(
    tmp_path: Path, hub: FakeHub, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "neither OWNER/REPOSITORY" in run("pull", "nothing", "--cache", tmp_path).stderr
    hub.publish("no/weights", COMMIT, {"README.md": b""})
    assert "holds neither" in run("pull", "no/weights", "--cache", tmp_path).stderr
    hub.is_online = False
    offline = pull(tmp_path)
    assert (offline.exit_code, offline.stderr.count("\n")) == (19, 1)
    assert "check your internet connection and try again" in offline.stderr
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    missing = pull(tmp_path)
    assert missing.exit_code == 26
    assert "pip install 'uasthn[hub]'" in missing.stderr


def test_a_damaged_lock_is_told(tmp_path: Path, hub: FakeHub) -> None:
    for content in ("{", "[]", '{"a/b": {}}'):
        (tmp_path / "models.lock.json").write_text(content)
        result = pull(tmp_path)
        assert result.exit_code == 19
        assert "models.lock.json: damaged" in result.stderr


@pytest.mark.parametrize("out", ["own.safetensors", "theirs.pth", "folder"])
def test_conversion_keeps_every_number(out: str, tmp_path: Path) -> None:
    source = small_weights(tmp_path, "sthn")
    result = run("convert", source, tmp_path / "new" / out)
    assert result.exit_code == 0, result.stderr
    ours = load_displacement(source).tensors()
    theirs = load_displacement(tmp_path / "new" / out).tensors()
    assert ours.keys() == theirs.keys()
    assert all(torch.equal(ours[name], theirs[name]) for name in ours)


def test_conversions_that_are_refused(tmp_path: Path) -> None:
    source = small_weights(tmp_path, "dhn")
    assert run("convert", source, source).exit_code == 18
    assert run("convert", source, source, "--overwrite").exit_code == 0
    assert "no dhn" in run("convert", source, tmp_path / "dhn.pth").stderr
    assert "must end in" in run("convert", source, tmp_path / "dhn.onnx").stderr
