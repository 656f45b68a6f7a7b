"""Samples whose thermal image was drawn."""

from dataclasses import replace

import numpy as np
import pytest
from tiny_tgm import ListedPairs, listed_pairs, pair, tiny_generator

from uasthn_cli.training.tgm.generated_thermal import GeneratedThermal
from uasthn_cli.training.tgm.pairs import aligned_satellite


def test_only_the_thermal_image_is_another() -> None:
    dataset = listed_pairs()
    drawn = GeneratedThermal(dataset, tiny_generator())
    assert len(drawn) == 3
    for index in range(3):
        before, after = dataset[index], drawn[index]
        assert after.thermal.shape == before.thermal.shape
        assert (after.thermal != before.thermal).mean() > 0.5
        assert replace(after, thermal=before.thermal) == before


def test_it_is_drawn_of_the_true_footprint_at_the_generators_own_scale() -> None:
    generator = tiny_generator(gsd_m=2.0)  # that of the pair: nothing is resized
    drawn = GeneratedThermal(ListedPairs([pair(1)]), generator)[0]
    assert (drawn.thermal == generator.render(aligned_satellite(pair(1), 80))).all()
    coarse = GeneratedThermal(ListedPairs([pair(1)]), tiny_generator(gsd_m=4.0))[0]
    assert coarse.thermal.shape == (80, 80)
    assert not np.array_equal(coarse.thermal, drawn.thermal)


def test_beyond_the_end_is_an_index_error() -> None:
    with pytest.raises(IndexError):
        GeneratedThermal(listed_pairs(), tiny_generator())[3]
