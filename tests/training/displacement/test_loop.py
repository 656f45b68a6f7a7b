"""The loop of displacement networks: reproducible to the bit, interrupted or not, and it learns."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from small_displacement_models import FIRST, SECOND, small_model
from tiny_displacement import PatternPairs, TinyLocator, tiny_displacement_config
from torch import Tensor, nn

from uasthn_cli.errors import TrainingDataError, TrainingDivergedError
from uasthn_cli.matching.displacement.ihn import IterativeHomographyNetwork
from uasthn_cli.matching.displacement.sthn import TwoStageHomographyNetwork
from uasthn_cli.training.displacement import loop
from uasthn_cli.training.displacement.batches import MatchBatches
from uasthn_cli.training.displacement.config import DisplacementConfig
from uasthn_cli.training.displacement.loop import (
    Stages,
    lesson,
    stages_of,
    train_displacement_steps,
    validate_displacement,
)
from uasthn_cli.training.displacement.losses import direct_modeling_loss
from uasthn_cli.training.displacement.trainee import open_displacement_trainee
from uasthn_cli.training.trainee import Trainee

PAIRS = PatternPairs(5)
CONFIG = tiny_displacement_config(plain_steps=2, views=3)
ORIGINS = {"data": "data", "initial": "", "generator": ""}


@pytest.fixture(autouse=True)
def _keep_malloc(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("uasthn_cli.training.displacement.trainee.keep_freed_memory", lambda: None)


def opened(path: Path, config: DisplacementConfig = CONFIG) -> Trainee[nn.Module]:
    torch.manual_seed(config.seed)
    return open_displacement_trainee(TinyLocator(), config, path, ORIGINS)


def trained(path: Path, config: DisplacementConfig = CONFIG) -> dict[str, Tensor]:
    trainee = opened(path, config)
    list(train_displacement_steps(trainee, PAIRS, config, path))
    return {name: value.clone() for name, value in trainee.model.state_dict().items()}


def assert_identical(a: dict[str, Tensor], b: dict[str, Tensor]) -> None:
    assert a.keys() == b.keys()
    assert [name for name in a if not torch.equal(a[name], b[name])] == []


def small_two_stages() -> TwoStageHomographyNetwork:
    torch.manual_seed(0)
    return TwoStageHomographyNetwork(FIRST, SECOND)


def test_the_same_seed_trains_the_same_weights(tmp_path: Path) -> None:
    first = trained(tmp_path / "a.pt")
    assert_identical(trained(tmp_path / "b.pt"), first)
    other = trained(tmp_path / "c.pt", replace(CONFIG, seed=1))
    assert not torch.equal(other["layers.1.weight"], first["layers.1.weight"])


@pytest.mark.parametrize("stop_at", [1, 3])
def test_a_resumed_run_ends_with_the_same_bits(stop_at: int, tmp_path: Path) -> None:
    path = tmp_path / "c.pt"
    config = replace(CONFIG, checkpoint_every=stop_at)
    next(train_displacement_steps(opened(path), PAIRS, config, path))
    resumed = opened(path)
    assert resumed.step == stop_at
    list(train_displacement_steps(resumed, PAIRS, CONFIG, path))
    assert_identical(dict(resumed.model.state_dict()), trained(tmp_path / "unbroken.pt"))


def test_a_checkpoint_of_another_run_is_refused_by_the_options_name(tmp_path: Path) -> None:
    trained(tmp_path / "c.pt")
    with pytest.raises(TrainingDataError, match=r"another --croptta \(3, now 5\)"):
        opened(tmp_path / "c.pt", replace(CONFIG, views=5))
    with pytest.raises(TrainingDataError, match="another --plain-steps"):
        opened(tmp_path / "c.pt", replace(CONFIG, plain_steps=1))


def test_one_sample_is_learnt_by_heart(tmp_path: Path) -> None:
    config = tiny_displacement_config(
        steps=150, batch=1, checkpoint_every=10, learning_rate=5e-3, weight_decay=0.0
    )
    trainee = opened(tmp_path / "c.pt", config)
    reports = list(train_displacement_steps(trainee, PatternPairs(1), config, tmp_path / "c.pt"))
    assert reports[0].median_error_px > 30
    assert reports[-1].median_error_px < 0.2 * reports[0].median_error_px
    assert validate_displacement(trainee.model, PatternPairs(1), config).median_error_px < 8


@pytest.mark.slow
def test_a_small_ihn_learns_one_sample_by_heart(tmp_path: Path) -> None:
    config = tiny_displacement_config(
        steps=30, batch=1, checkpoint_every=5, learning_rate=0.1, weight_decay=0.0
    )
    torch.manual_seed(0)
    network = IterativeHomographyNetwork(replace(FIRST, levels=1, update_channels=64))
    trainee = open_displacement_trainee(network, config, tmp_path / "c.pt", ORIGINS)
    reports = list(train_displacement_steps(trainee, PatternPairs(1), config, tmp_path / "c.pt"))
    assert reports[-1].median_error_px < 0.2 * reports[0].median_error_px


def test_both_stages_learn_and_the_boxes_pass_no_gradient() -> None:
    config = tiny_displacement_config(network="sthn", batch=1, iterations=1)
    network, batch = small_two_stages(), MatchBatches(PAIRS, config)[0]
    both = lesson(stages_of(network), batch, config)
    both.loss.backward()  # type: ignore[no-untyped-call]
    assert all(value.grad is not None for value in network.parameters())
    coarse_grads = [
        value.grad.clone() for value in network.netG.parameters() if value.grad is not None
    ]
    alone = lesson(Stages(network.netG, None), batch, config)
    network.zero_grad()
    alone.loss.backward()  # type: ignore[no-untyped-call]
    again = [value.grad for value in network.netG.parameters() if value.grad is not None]
    assert all(torch.allclose(a, b, atol=1e-4) for a, b in zip(coarse_grads, again, strict=True))
    assert both.loss > alone.loss


def test_a_frozen_first_stage_stays_and_the_second_one_learns(tmp_path: Path) -> None:
    config = tiny_displacement_config(network="sthn", first_stage="frozen", steps=1, batch=1)
    network = small_two_stages()
    before = {name: value.clone() for name, value in network.state_dict().items()}
    trainee = open_displacement_trainee(network, config, tmp_path / "c.pt", ORIGINS)
    list(train_displacement_steps(trainee, PAIRS, config, tmp_path / "c.pt"))
    moved = {
        name for name, value in network.state_dict().items() if not torch.equal(value, before[name])
    }
    assert moved
    assert all(name.startswith("netG_fine.") for name in moved)


def test_direct_modeling_trains_both_heads() -> None:
    config = tiny_displacement_config(direct_modeling=True, batch=1)
    torch.manual_seed(0)
    network = IterativeHomographyNetwork(replace(FIRST, has_uncertainty_head=True))
    batch = MatchBatches(PAIRS, config)[0]
    lesson(stages_of(network), batch, config).loss.backward()  # type: ignore[no-untyped-call]
    heads = [network.update_block_4, network.ue_update_block_4]
    assert all(value.grad is not None for head in heads for value in head.parameters())


def test_a_dhn_learns_one_sample_and_becomes_sure_of_it(tmp_path: Path) -> None:
    config = tiny_displacement_config(
        **{"network": "dhn", "direct_modeling": True, "steps": 60, "batch": 1},
        **{"checkpoint_every": 60, "learning_rate": 0.01, "weight_decay": 0.0},
    )
    network, batch = small_model("dhn+dm").network, MatchBatches(PatternPairs(1), config)[0]

    def judged() -> tuple[float, float]:
        """Return how unlikely the network has the truth, and its mean deviation."""
        with torch.inference_mode():
            seen = network.eval()(batch.satellite, batch.thermal)
        return float(direct_modeling_loss(seen, batch.displacement, 1.0)), seen.deviations.mean()

    loss, deviation_px = judged()
    trainee = open_displacement_trainee(network, config, tmp_path / "c.pt", ORIGINS)
    list(train_displacement_steps(trainee, PatternPairs(1), config, tmp_path / "c.pt"))
    loss_then, deviation_then_px = judged()
    assert loss_then < 0.5 * loss
    assert 20 < deviation_px < 50
    assert deviation_then_px < 0.7 * deviation_px


def test_half_precision_leaves_displacements_exact() -> None:
    torch.manual_seed(0)
    network = IterativeHomographyNetwork(FIRST)
    batch = MatchBatches(PAIRS, CONFIG)[0]
    with torch.autocast("cpu", torch.bfloat16):
        seen = network(batch.satellite, batch.thermal, 2)
    assert seen.displacements.dtype == torch.float32


def test_validation_changes_nothing_and_is_reproducible() -> None:
    config = tiny_displacement_config(network="sthn", iterations=1)
    network, pairs = small_two_stages().train(), PatternPairs(2)
    first = validate_displacement(network, pairs, config)
    assert network.training
    assert validate_displacement(network, pairs, config) == first
    assert first.median_error_px > 0 and 0 <= first.within_4_px <= 1


def test_a_loss_that_is_no_number_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "croptta_loss", lambda *_: torch.tensor(torch.nan))
    with pytest.raises(TrainingDivergedError, match="step 1"):
        trained(tmp_path / "c.pt")
