"""Distillation: fewer channels for equal scores, and a small network that learns features."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tiny_training import TINY_SAMPLES, pattern_scenes, tiny_config, write_photo

from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.matching.torch_weights import load_xcorr, serialise_xcorr
from uasthn_cli.training import loop
from uasthn_cli.training.distil import distillation_loss, reduce_channels
from uasthn_cli.training.losses import encode_batch, search_scores
from uasthn_cli.training.run import TrainingJob, TrainingRun
from uasthn_cli.training.samples import SampleDataset
from uasthn_cli.training.scenes import RenderedShares

CHANNELS = 12


def teacher() -> XcorrModel:
    """Return a network whose twelve channels are mixtures of three, and a little of their own."""
    torch.manual_seed(1)
    model = XcorrModel(XcorrArchitecture(CHANNELS, (4, 6, 8, 8))).eval()
    for encoder in (model.satellite_encoder, model.thermal_encoder):
        weight = encoder.head.weight
        mixed = torch.randn(CHANNELS, 3) @ torch.randn(3, weight.shape[1])
        weight.data = (mixed + 1e-3 * torch.randn_like(mixed))[:, :, None, None]
    return model


def batches(count: int) -> Iterator[tuple[torch.Tensor, ...]]:
    dataset = SampleDataset(pattern_scenes(), TINY_SAMPLES, seed=4, batches=count)
    for index in range(count):
        batch = dataset[index]
        yield tuple(
            torch.from_numpy(array)
            for array in (
                batch.satellite,
                batch.satellite_valid,
                batch.thermal,
                batch.thermal_valid,
            )
        )


def test_scores_hardly_change_when_channels_that_say_nothing_go() -> None:
    model = teacher()
    reduced = reduce_channels(model, batches(2), 4)
    assert reduced.architecture == XcorrArchitecture(4, (4, 6, 8, 8))
    batch = next(batches(1))
    with torch.no_grad():
        before, after = (search_scores(one, *batch).flatten().numpy() for one in (model, reduced))
    assert np.corrcoef(before, after)[0, 1] > 0.999
    assert model.satellite_encoder.head.out_channels == CHANNELS


def test_a_network_has_nothing_to_learn_from_itself_and_much_from_another() -> None:
    batch = next(batches(1))
    with torch.no_grad():
        own = encode_batch(teacher(), *batch)
        torch.manual_seed(5)
        other = encode_batch(XcorrModel(XcorrArchitecture(CHANNELS, (4, 4, 4, 4))).eval(), *batch)
    assert float(distillation_loss(own, own)[0]) == 0.0
    loss, unexplained = distillation_loss(other, own)
    assert float(loss) > 0.5
    assert unexplained.shape == (2,)


def test_a_run_with_a_teacher_comes_nearer_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "_VALIDATION_BATCHES", 1)
    monkeypatch.setattr(loop, "_REDUCTION_BATCHES", 1)
    large = tmp_path / "large.safetensors"
    large.write_bytes(serialise_xcorr(teacher(), {}))
    for seed in range(2):
        write_photo(tmp_path / "photos" / f"{seed}.png", seed)
    config = replace(tiny_config(), steps=12, learning_rate=0.02)
    job = TrainingJob(
        out=tmp_path / "small.safetensors",
        images=((str(tmp_path / "photos" / "*.png"), 1.0),),
        rendered=RenderedShares(0.0, 0.0),
        config=config,
        validate_every=12,
        teacher=large,
    )
    run = TrainingRun(job)
    losses = [report.progress.loss for report in run.train(lambda _: None)]
    run.export()
    assert losses[-1] < 0.9 * losses[0]
    small = load_xcorr(job.out).model
    assert small.architecture == config.architecture
    assert float(small.log_temperature.detach()) == pytest.approx(3.0, abs=0.2)
    assert "learned the features of | `large.safetensors`" in run.paths.card.read_text("utf-8")
