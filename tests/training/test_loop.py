"""The training loop: reproducible to the bit, interrupted or not, and it learns."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import torch
from tiny_training import TINY_SAMPLES, pattern_scenes, tiny_config
from torch import Tensor

from uasthn_cli.errors import TrainingDataError, TrainingDivergedError
from uasthn_cli.matching.architecture import XcorrArchitecture
from uasthn_cli.matching.networks import XcorrModel
from uasthn_cli.training import loop
from uasthn_cli.training.checkpoint import load_checkpoint
from uasthn_cli.training.loop import learning_rate_at, train, train_steps, validate
from uasthn_cli.training.samples import SampleDataset
from uasthn_cli.training.trainee import TrainingConfig, open_trainee

SCENES = pattern_scenes()


def trained(path: Path, config: TrainingConfig) -> dict[str, Tensor]:
    """Train to the end and return weights and batch-norm statistics."""
    *_, (_, model) = train(SCENES, config, path)
    return {name: value.clone() for name, value in model.state_dict().items()}


def stop_after_first_checkpoint(path: Path, config: TrainingConfig) -> None:
    next(train(SCENES, config, path))


def assert_identical(a: dict[str, Tensor], b: dict[str, Tensor]) -> None:
    assert a.keys() == b.keys()
    different = [name for name in a if not torch.equal(a[name], b[name])]
    assert different == []


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Tensor]:
    return trained(tmp_path_factory.mktemp("unbroken") / "c.pt", tiny_config())


def test_the_same_seed_trains_the_same_weights(unbroken: dict[str, Tensor], tmp_path: Path) -> None:
    assert_identical(trained(tmp_path / "c.pt", tiny_config()), unbroken)
    other = trained(tmp_path / "d.pt", tiny_config(seed=1))
    assert not torch.equal(other["log_temperature"], unbroken["log_temperature"])


def test_a_resumed_run_ends_with_the_same_bits(unbroken: dict[str, Tensor], tmp_path: Path) -> None:
    stop_after_first_checkpoint(tmp_path / "c.pt", tiny_config())
    saved = load_checkpoint(tmp_path / "c.pt")
    assert saved.step == 2
    assert any(name.endswith("running_mean") for name in saved.model)
    assert {"exp_avg", "exp_avg_sq", "step"} <= set(saved.optimiser["state"][0])
    assert_identical(trained(tmp_path / "c.pt", tiny_config()), unbroken)


def test_how_often_checkpoints_are_written_changes_nothing(
    unbroken: dict[str, Tensor], tmp_path: Path
) -> None:
    every_third = tiny_config(checkpoint_every=3)
    stop_after_first_checkpoint(tmp_path / "c.pt", every_third)
    assert load_checkpoint(tmp_path / "c.pt").step == 3
    assert_identical(trained(tmp_path / "c.pt", tiny_config(checkpoint_every=1)), unbroken)


@pytest.mark.slow
def test_workers_change_nothing(unbroken: dict[str, Tensor], tmp_path: Path) -> None:
    assert_identical(trained(tmp_path / "c.pt", tiny_config(workers=1)), unbroken)


def test_validation_changes_nothing_and_is_reproducible(
    unbroken: dict[str, Tensor], tmp_path: Path
) -> None:
    config = tiny_config()
    figures = []
    for _, model in train(SCENES, config, tmp_path / "c.pt"):
        figures.append(validate(model, SCENES, config))
        assert model.training
        assert validate(model, SCENES, config) == figures[-1]
    assert_identical(dict(model.state_dict()), unbroken)
    assert all(0 <= figure.within_4_px <= 1 and figure.median_error_px > 0 for figure in figures)


def test_validation_batches_are_never_trained_on(monkeypatch: pytest.MonkeyPatch) -> None:
    seeds = []

    def remember(*arguments: Any, seed: int, batches: int) -> Any:
        seeds.append(seed)
        return SampleDataset(*arguments, seed=seed, batches=batches)

    monkeypatch.setattr(loop, "SampleDataset", remember)
    monkeypatch.setattr(loop, "_VALIDATION_BATCHES", 1)
    config = tiny_config(seed=5)
    list(loop._batches(SCENES, replace(config, steps=1), 0))
    validate(XcorrModel(config.architecture), SCENES, config)
    assert seeds[0] == 5
    assert seeds[1] != 5


def test_progress_is_told_with_every_checkpoint_and_every_step(tmp_path: Path) -> None:
    config = tiny_config(steps=5)
    trainee = open_trainee(config, tmp_path / "c.pt", "data")
    steps: list[int] = []
    reports = list(train_steps(trainee, SCENES, config, tmp_path / "c.pt", steps.append))
    assert steps == [1, 2, 3, 4, 5]
    assert [report.step for report in reports] == [2, 4, 5]
    assert load_checkpoint(tmp_path / "c.pt").step == 5
    assert all(report.loss > 0 and report.median_error_px > 0 for report in reports)
    assert [report.seconds for report in reports] == sorted(report.seconds for report in reports)


def test_a_finished_run_has_nothing_left_to_do(unbroken: dict[str, Tensor], tmp_path: Path) -> None:
    trained(tmp_path / "c.pt", tiny_config())
    trainee = open_trainee(tiny_config(), tmp_path / "c.pt", SCENES.fingerprint())
    assert trainee.step == 4
    assert list(train_steps(trainee, SCENES, tiny_config(), tmp_path / "c.pt")) == []
    assert_identical(dict(trainee.model.state_dict()), unbroken)


def test_a_longer_run_goes_on_and_says_so(tmp_path: Path) -> None:
    trained(tmp_path / "c.pt", tiny_config())
    trained(tmp_path / "c.pt", tiny_config(steps=6))
    saved = load_checkpoint(tmp_path / "c.pt")
    assert saved.step == 6
    assert saved.settings["changes"] == ["from step 4: steps 6 instead of 4"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"seed": 9}, "--seed"),
        ({"architecture": XcorrArchitecture(4, (4, 4, 4, 8))}, "--widths"),
        ({"samples": replace(TINY_SAMPLES, canvases=2)}, "--canvases"),
        ({"steps": 1}, "already at step 2; give --steps of at least that"),
    ],
)
def test_a_checkpoint_of_another_run_is_refused(
    changes: dict[str, Any], words: str, tmp_path: Path
) -> None:
    stop_after_first_checkpoint(tmp_path / "c.pt", tiny_config())
    with pytest.raises(TrainingDataError) as refused:
        trained(tmp_path / "c.pt", tiny_config(**changes))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
    assert load_checkpoint(tmp_path / "c.pt").step == 2


def test_other_images_are_refused(tmp_path: Path) -> None:
    stop_after_first_checkpoint(tmp_path / "c.pt", tiny_config())
    with pytest.raises(TrainingDataError, match="--images"):
        next(train(pattern_scenes(3), tiny_config(), tmp_path / "c.pt"))


def test_a_checkpoint_without_all_weights_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.pt"
    stop_after_first_checkpoint(path, tiny_config())
    content = torch.load(path, weights_only=True)
    del content["settings"]["data"]
    torch.save(content, path)
    assert open_trainee(tiny_config(), path, "any").step == 2
    del content["model"]["log_temperature"]
    torch.save(content, path)
    with pytest.raises(TrainingDataError, match="another architecture"):
        open_trainee(tiny_config(), path, "any")


def test_a_loss_that_is_no_number_ends_the_run_and_keeps_the_last_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = tiny_config()
    trainee = open_trainee(config, tmp_path / "c.pt", "data")
    steps = train_steps(trainee, SCENES, config, tmp_path / "c.pt")
    next(steps)
    monkeypatch.setattr(loop, "search_loss", lambda *_: (torch.tensor(torch.nan), torch.zeros(1)))
    with pytest.raises(TrainingDivergedError, match="at step 3; start anew with a smaller"):
        next(steps)
    assert load_checkpoint(tmp_path / "c.pt").step == 2
    assert all(torch.isfinite(value).all() for value in trainee.model.state_dict().values())


def test_bfloat16_trains_too(tmp_path: Path) -> None:
    weights = trained(tmp_path / "c.pt", tiny_config(steps=1, bfloat16=True))
    assert all(torch.isfinite(value).all() for value in weights.values())
    assert {value.dtype for name, value in weights.items() if "num_batches" not in name} == {
        torch.float32
    }


def test_every_part_of_the_model_is_trained(unbroken: dict[str, Tensor]) -> None:
    torch.manual_seed(0)
    fresh = XcorrModel(tiny_config().architecture).state_dict()
    assert [name for name in unbroken if torch.equal(fresh[name], unbroken[name])] == []


def test_learning_rate_warms_up_holds_and_falls_to_zero() -> None:
    config = TrainingConfig(steps=1000, learning_rate=0.5)
    rates = [learning_rate_at(step, config) for step in range(1000)]
    assert rates[0] == pytest.approx(0.005)
    assert rates[99:701] == [0.5] * 602
    assert all(later < earlier for earlier, later in pairwise(rates[701:]))
    assert rates[-1] == pytest.approx(0.5 / 300)
    assert learning_rate_at(1000, config) == 0


@pytest.mark.slow
def test_training_learns_to_find_a_pattern(tmp_path: Path) -> None:
    config = tiny_config(steps=60, checkpoint_every=20, learning_rate=0.02)
    config = replace(config, samples=replace(TINY_SAMPLES, canvases=2))
    losses = [progress.loss for progress, _ in train(pattern_scenes(1), config, tmp_path / "c.pt")]
    assert losses[2] < losses[0] - 0.5
