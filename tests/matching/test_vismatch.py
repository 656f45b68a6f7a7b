"""Matchers of the vismatch package behind the common seam, by a package that looks like it."""

import logging
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from matching_scene import centred_origin, encoded, full_view, map_window, thermal_cut
from safetensors.torch import save_file
from small_flight import ground_texture

from uasthn_cli.errors import MissingExtraError, WeightsError
from uasthn_cli.geometry.corners import DegenerateHomographyError
from uasthn_cli.matching.registry import open_estimator
from uasthn_cli.matching.vismatch import VismatchEstimator, open_vismatch
from uasthn_cli.seam import Estimate

GREY = ground_texture(3)
CORNER_PX, SIZE_PX = (120, 90), (160, 128)


def estimate(estimator: VismatchEstimator) -> Estimate:
    window = map_window(GREY)
    thermal = thermal_cut(0.5 * GREY + 40.0, CORNER_PX, SIZE_PX, inset_px=7)
    origin = centred_origin(window, thermal)
    return estimator.estimate(encoded(estimator, window), thermal, full_view(thermal), origin)


@pytest.mark.usefixtures("fake_vismatch")
def test_a_matcher_finds_what_it_sees() -> None:
    estimator = open_vismatch("vismatch:grid", None, "cpu")
    assert estimator.name == "vismatch:grid"
    found = estimate(estimator)
    expected = full_view(thermal_cut(GREY, CORNER_PX, SIZE_PX)) + CORNER_PX
    assert found.corners_px == pytest.approx(expected, abs=0.05)
    assert found.confidence > 0.99
    frame, window = estimator._matcher.seen
    assert frame.shape == (3, 128, 160)
    assert window.shape == (3, *GREY.shape)
    assert frame.dtype == window.dtype == np.float32
    assert (float(frame.min()), float(frame.max())) == (0.0, 1.0)
    assert 0.0 <= window.min() <= window.max() <= 1.0


@pytest.mark.usefixtures("fake_vismatch")
def test_what_a_matcher_prints_is_logged(
    capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        estimate(open_vismatch("vismatch:grid", None, "cpu"))
    assert capsys.readouterr().out == ""
    assert "no connection to the hub" in caplog.text
    assert "a matcher that talks" in caplog.text


@pytest.mark.usefixtures("fake_vismatch")
def test_a_matcher_that_fails_has_no_answer() -> None:
    with pytest.raises(DegenerateHomographyError, match="vismatch:blind failed: not enough values"):
        estimate(open_vismatch("vismatch:blind", None, "cpu"))


def test_without_the_package_the_command_to_install_it_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "vismatch", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'uasthn\[vismatch\]'"):
        open_estimator("vismatch:xfeat", device="cpu")


@pytest.mark.usefixtures("fake_vismatch")
@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("gird", MissingExtraError, "no matcher 'gird'; it has, say, grid"),
        ("needy", MissingExtraError, "needs a package that is not installed: .*tensorflow"),
        ("unfetched", WeightsError, "cannot be loaded .no snapshot on the local disk"),
    ],
)
def test_what_cannot_be_opened_is_told_in_one_line(
    name: str, kind: type[Exception], words: str
) -> None:
    with pytest.raises(kind, match=words) as caught:
        open_vismatch(f"vismatch:{name}", None, "cpu")
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("fake_vismatch")
def test_a_checkpoint_is_handed_on_where_a_matcher_takes_one(tmp_path: Path) -> None:
    path = tmp_path / "own.tar"
    path.write_bytes(b"a checkpoint")
    estimator = open_vismatch("vismatch:upal", path, "cpu")
    assert estimator._matcher.arguments == {"weights_path": path, "device": "cpu"}


@pytest.mark.usefixtures("fake_vismatch")
def test_weights_of_ones_own_replace_those_of_the_matcher(tmp_path: Path) -> None:
    own = {"model.weight": torch.tensor([[3.0, 4.0]]), "model.bias": torch.tensor([5.0])}
    path = tmp_path / "own.safetensors"
    save_file(own, path)
    loaded = open_vismatch("vismatch:weighted", path, "cpu")._matcher.state_dict()
    assert loaded.keys() == own.keys()
    assert all(torch.equal(loaded[key], own[key]) for key in own)


@pytest.mark.usefixtures("fake_vismatch")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("weighted", "these weights are not for vismatch:weighted"),
        ("grid", "no weights that could be replaced; leave out --weights"),
    ],
)
def test_weights_that_do_not_fit_are_refused(name: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "other.safetensors"
    save_file({"other.weight": torch.ones(1)}, path)
    with pytest.raises(WeightsError, match=words):
        open_vismatch(f"vismatch:{name}", path, "cpu")


@pytest.mark.usefixtures("fake_vismatch")
def test_weights_that_are_none_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "own.safetensors"
    with pytest.raises(WeightsError, match="no such weights file"):
        open_vismatch("vismatch:weighted", path, "cpu")
    path.write_text("not weights")
    with pytest.raises(WeightsError, match="not a readable safetensors file"):
        open_vismatch("vismatch:weighted", path, "cpu")


def test_a_matcher_of_the_real_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    pytest.importorskip("vismatch", reason="the extra 'vismatch' is not installed")
    found = estimate(open_vismatch("vismatch:sift-nn", None, "cpu"))
    expected = full_view(thermal_cut(GREY, CORNER_PX, SIZE_PX)) + CORNER_PX
    assert found.corners_px == pytest.approx(expected, abs=0.5)
    assert found.confidence > 0.99
