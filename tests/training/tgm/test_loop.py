"""Training moves towards what it is shown."""

from pathlib import Path

import numpy as np
import pytest
import torch
from tiny_tgm import TINY_RESNET, TINY_UNET, ListedPairs, listed_pairs, pair, tiny_tgm_config

from uasthn_cli.errors import TrainingDivergedError
from uasthn_cli.training.tgm.generators import GeneratorArchitecture
from uasthn_cli.training.tgm.loop import (
    learning_rate_at,
    train_tgm_steps,
    validation_l1_grey,
)
from uasthn_cli.training.tgm.trainee import open_tgm_trainee


@pytest.mark.parametrize("architecture", [TINY_UNET, TINY_RESNET])
def test_sixty_steps_on_one_pair_lower_its_error(
    architecture: GeneratorArchitecture, tmp_path: Path
) -> None:
    one = ListedPairs([pair(0)])
    config = tiny_tgm_config(
        steps=60, checkpoint_every=60, jitter_px=0, learning_rate=2e-3, architecture=architecture
    )
    trainee = open_tgm_trainee(config, tmp_path / "c.pt", "one")
    before = validation_l1_grey(trainee, one, config)
    (progress,) = train_tgm_steps(trainee, one, config, tmp_path / "c.pt")
    after = validation_l1_grey(trainee, one, config)
    assert after < 0.5 * before
    assert progress.step == 60
    assert 0 < progress.losses.discriminator < 2
    assert after < progress.losses.l1_grey < before + 5


def test_both_networks_learn_and_the_generator_does_not_move_the_discriminator(
    tmp_path: Path,
) -> None:
    config = tiny_tgm_config(steps=1)
    trainee = open_tgm_trainee(config, tmp_path / "c.pt", "")
    networks = (trainee.generator, trainee.discriminator)
    before = [[p.clone() for p in network.parameters()] for network in networks]
    list(train_tgm_steps(trainee, listed_pairs(), config, tmp_path / "c.pt"))
    for network, old in zip(networks, before, strict=True):
        moved = [(p - q).abs().max().item() for p, q in zip(network.parameters(), old, strict=True)]
        assert max(moved) == pytest.approx(config.learning_rate, rel=0.1)  # one step of Adam
        assert all(parameter.requires_grad for parameter in network.parameters())


def test_the_rate_is_held_and_then_falls() -> None:
    config = tiny_tgm_config(steps=200)
    rates = [learning_rate_at(step, config) for step in range(200)]
    assert set(rates[:101]) == {2e-4}
    assert np.allclose(np.diff(rates[100:]), -2e-4 / 100)
    assert rates[-1] == pytest.approx(2e-6)


def test_a_loss_that_is_no_number_ends_the_run(tmp_path: Path) -> None:
    config = tiny_tgm_config()
    trainee = open_tgm_trainee(config, tmp_path / "c.pt", "")
    with torch.no_grad():
        next(trainee.generator.parameters()).fill_(torch.nan)
    with pytest.raises(TrainingDivergedError, match="no longer finite at step 1"):
        list(train_tgm_steps(trainee, listed_pairs(), config, tmp_path / "c.pt"))
