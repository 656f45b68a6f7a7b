"""The refiner's training: its labels, its loss, and that it leaves the encoders alone."""

from dataclasses import astuple, replace

import numpy as np
import pytest
import torch
from tiny_training import TINY_SAMPLES, pattern_scenes, tiny_config
from torch import Tensor

from uasthn_cli.errors import TrainingDivergedError
from uasthn_cli.geometry.corners import (
    homography_from_corners,
    image_corners_px,
    transform_points,
)
from uasthn_cli.matching.networks import STRIDE_PX, XcorrModel
from uasthn_cli.training import refine_loop
from uasthn_cli.training.refine_loop import (
    RefineConfig,
    corner_error_px,
    refine_inputs,
    sequence_loss,
    train_refiner,
)
from uasthn_cli.training.samples import CANVAS_PX, SampleConfig, SampleDataset

CONFIG = RefineConfig(steps=3, bfloat16=False, workers=0, samples=TINY_SAMPLES)


def model(seed: int = 0) -> XcorrModel:
    torch.manual_seed(seed)
    return XcorrModel(tiny_config().architecture)


def refined(config: RefineConfig) -> dict[str, Tensor]:
    trained = model()
    list(train_refiner(trained, pattern_scenes(), config))
    return {name: value.clone() for name, value in trained.state_dict().items()}


def test_convention_true_corners_are_centres_of_corner_cells() -> None:
    samples = SampleConfig(windows=3, canvases=2, yaw_error_deg=10, corner_error_px=3)
    batch = SampleDataset(pattern_scenes(), samples, seed=0, batches=1)[0]
    window, template, mask, truth, start = refine_inputs(
        model(), batch, torch.Generator().manual_seed(0), device="cpu", bfloat16=False
    )
    cells = CANVAS_PX // STRIDE_PX
    assert window.shape[0] == template.shape[0] == mask.shape[0] == len(truth) == len(start) == 6
    assert template.shape[-2:] == mask.shape[-2:] == (cells, cells)
    corners_px = batch.corners_px.reshape(6, 4, 2).astype(np.float64)
    first, last = 0.5, 2 * (cells - 1) + 0.5  # the centre of a cell of two pixels
    centres = np.array([[first, first], [last, first], [first, last], [last, last]])
    for k in range(6):
        H = homography_from_corners(image_corners_px(CANVAS_PX, CANVAS_PX), corners_px[k])
        expected = (transform_points(H, centres) - 0.5) / STRIDE_PX
        assert truth[k].numpy() == pytest.approx(expected, abs=1e-3)
    assert torch.equal(window[0], window[1]), "both canvases of a window search the same map"
    assert not torch.equal(window[1], window[2])


def test_the_start_is_an_upright_square_about_a_cell_off() -> None:
    samples = SampleConfig(windows=1, canvases=40, yaw_error_deg=0, scale_error=0)
    batch = SampleDataset(pattern_scenes(), samples, seed=0, batches=1)[0]
    *_, truth, start = refine_inputs(
        model(), batch, torch.Generator().manual_seed(0), device="cpu", bfloat16=False
    )
    offset = start.mean(dim=1) - truth.mean(dim=1)
    assert float(offset.abs().max()) < 5
    assert 0.7 < float(offset.std()) < 1.3
    assert abs(float(offset.mean())) < 0.3
    size = CANVAS_PX / STRIDE_PX - 1
    top_left, top_right, bottom_left, _ = start.unbind(dim=1)
    assert torch.allclose(top_right - top_left, torch.tensor([size, 0.0]), atol=1e-4)
    assert torch.allclose(bottom_left - top_left, torch.tensor([0.0, size]), atol=1e-4)


def test_the_loss_weighs_later_iterations_more_and_is_nothing_at_the_truth() -> None:
    truth = torch.rand(3, 4, 2)
    off = truth + 1
    assert float(sequence_loss([truth, truth], truth)) == 0
    assert float(sequence_loss([off, truth], truth)) < float(sequence_loss([truth, off], truth))
    assert float(sequence_loss([truth, off], truth)) == pytest.approx(1, abs=1e-5)


def test_corner_error_is_the_median_distance_in_pixels() -> None:
    truth = torch.zeros(3, 4, 2)
    corners = truth.clone()
    corners[0] += torch.tensor([3.0, 4.0])
    corners[1] += torch.tensor([0.6, 0.8])
    assert corner_error_px(corners, truth) == pytest.approx(1.0 * STRIDE_PX)


def test_the_same_seed_trains_the_same_refiner_and_leaves_the_encoders() -> None:
    before, first, second = model().state_dict(), refined(CONFIG), refined(CONFIG)
    assert all(torch.equal(first[name], second[name]) for name in first)
    moved = {name for name in before if not torch.equal(before[name], first[name])}
    assert moved
    assert all(name.startswith("refiner.") for name in moved)
    other = refined(replace(CONFIG, seed=1))
    assert any(not torch.equal(first[name], other[name]) for name in moved)


@pytest.mark.parametrize("steps", [1, 2, 10, 11])
def test_runs_of_any_length_end_with_a_report(steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(refine_loop, "_REPORT_EVERY", 4)
    batch = SampleDataset(pattern_scenes(), SampleConfig(1, 1), seed=0, batches=1)[0]
    monkeypatch.setattr(refine_loop, "_batches", lambda *_: iter([batch] * steps))
    reports = list(train_refiner(model(), pattern_scenes(), replace(CONFIG, steps=steps)))
    assert [report.step for report in reports] == [*range(4, steps, 4), steps]
    assert all(np.isfinite(astuple(report)).all() for report in reports)


def test_a_loss_that_is_no_number_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(refine_loop, "sequence_loss", lambda *_: torch.tensor(torch.nan))
    with pytest.raises(TrainingDivergedError, match="at step 1"):
        list(train_refiner(model(), pattern_scenes(), CONFIG))
