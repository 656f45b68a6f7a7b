"""Presets, schedules, and what makes no sense together."""

from itertools import pairwise
from typing import Any, get_args

import pytest
from tiny_displacement import tiny_displacement_config

from uasthn_cli.commands import displacement_options
from uasthn_cli.matching.registry import TRAINED_HERE
from uasthn_cli.training.displacement.config import (
    PRESETS,
    DisplacementConfig,
    NetworkName,
)


def test_presets_are_complete_and_those_of_the_command() -> None:
    assert tuple(PRESETS) == displacement_options.PRESETS
    assert ("xcorr", *get_args(NetworkName)) == TRAINED_HERE
    for network in get_args(NetworkName):
        preset = PRESETS[f"paper-{network}"]
        assert preset.network == network
        assert preset.steps == 300_000
        assert round(preset.plain_share * preset.steps) == 100_000
        assert preset.views == 5
        assert preset.fine_satellite_px == 1536
    assert PRESETS["laptop"].network is None
    assert PRESETS["laptop"].steps <= 500


def test_the_papers_numbers() -> None:
    config = DisplacementConfig("sthn", 300_000)
    assert (config.iterations, config.fine_iterations, config.decay) == (6, 6, 0.85)
    assert config.learning_rate == 1e-4
    assert config.crop_offset_fraction == 32 / 512
    assert (config.box_augmentation_px, config.box_expansion_px) == (64, 64)
    assert config.width_ratio == 3


def test_the_rate_falls_to_zero_before_the_crops_and_with_them() -> None:
    config = tiny_displacement_config(steps=300, plain_steps=100, views=5, learning_rate=1.0)
    rates = [config.learning_rate_at(step) for step in range(300)]
    assert rates[0] == rates[100] == 1.0
    assert rates[99] == pytest.approx(0.01) and rates[299] == pytest.approx(1 / 200)
    assert all(later < earlier for earlier, later in pairwise(rates[:100]))
    assert all(later < earlier for earlier, later in pairwise(rates[100:]))
    assert [config.views_at(step) for step in (0, 99, 100, 299)] == [1, 1, 5, 5]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"direct_modeling": True, "views": 5}, "choose one"),
        ({"network": "ihn", "first_stage": "frozen"}, "nothing to freeze"),
        ({"network": "dhn", "first_stage": "frozen"}, "nothing to freeze"),
    ],
)
def test_what_makes_no_sense_is_refused(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        tiny_displacement_config(**settings)
