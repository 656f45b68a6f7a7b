"""Thermal images that a generator draws (``--tgm`` of ``uasthn train`` and ``uasthn evaluate``)."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from uasthn_cli.datasets.samples import MatchDataset
    from uasthn_cli.training.displacement.config import DisplacementConfig
    from uasthn_cli.training.tgm.thermal_generator import GeneratorFile, ThermalGenerator

_REAL_PAIRS_SHARE: Final = 0.5
"""Half of what is learnt keeps the thermal images that pairs come with."""


def open_for_training(weights: Path, config: "DisplacementConfig") -> "GeneratorFile":
    """Open a generator where batches are made.

    Raises:
        WeightsError: it cannot be used.
    """
    from uasthn_cli.training.tgm.thermal_generator import open_generator_file

    # forked workers cannot use a GPU
    return open_generator_file(weights, "cpu" if config.workers else config.device)


def usual_share(dataset: "MatchDataset") -> float:
    """Return how much is drawn unless the user says."""
    return 1.0 if _is_rendered(dataset) else _REAL_PAIRS_SHARE


def drawn_if_rendered(
    dataset: "MatchDataset | None", generator: "ThermalGenerator"
) -> "MatchDataset | None":
    """Return pairs to judge by: drawn ones of overhead images, others with their real images."""
    from uasthn_cli.training.tgm.generated_thermal import GeneratedThermal

    if dataset is None or not _is_rendered(dataset):
        return dataset
    return GeneratedThermal(dataset, generator)


def drawn_to_judge_by(
    source: str, dataset: "MatchDataset", weights: Path, device: str
) -> "MatchDataset":
    """Return overhead images with drawn thermal views.

    Raises:
        click.UsageError: the data set has thermal images of its own.
        WeightsError: the generator cannot be used.
    """
    from uasthn_cli.training.tgm.generated_thermal import GeneratedThermal
    from uasthn_cli.training.tgm.thermal_generator import ThermalGenerator

    if not _is_rendered(dataset):
        raise click.UsageError(
            f"{source} has thermal images of its own, and only those tell how well they are found:"
            " --tgm is for overhead images"
        )
    return GeneratedThermal(dataset, ThermalGenerator.open(weights, device))


def _is_rendered(dataset: "MatchDataset") -> bool:
    from uasthn_cli.datasets.rendered import RenderedDataset

    return isinstance(dataset, RenderedDataset)
