"""A data set whose thermal images are drawn by a generator, for training on them."""

from dataclasses import replace

from uasthn_cli.datasets.samples import MatchDataset, MatchSample
from uasthn_cli.training.tgm.pairs import aligned_satellite, footprint_px, resized_thermal
from uasthn_cli.training.tgm.thermal_generator import ThermalGenerator


class GeneratedThermal:
    """The samples of another data set with the thermal image that a generator draws in its place.

    It is drawn of the satellite image on the true footprint, so the corners stay true.
    """

    def __init__(self, dataset: MatchDataset, generator: ThermalGenerator) -> None:
        """Wrap a data set."""
        self._dataset, self._generator = dataset, generator

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self._dataset)

    def __getitem__(self, index: int) -> MatchSample:
        """Return a sample; its thermal image has the size of the one it stands for.

        Raises:
            TrainingDataError: the sample's corners enclose no area.
        """
        sample = self._dataset[index]
        size_px = self._generator.pixels_of(footprint_px(sample) * sample.satellite_gsd_m)
        drawn = self._generator.render(aligned_satellite(sample, size_px))
        return replace(sample, thermal=resized_thermal(drawn, sample.thermal.shape[0]))
