"""Pairs from overhead images alone: the thermal image is rendered by the data engine."""

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from uasthn_cli.datasets.overhead import Site
from uasthn_cli.datasets.samples import MatchSample
from uasthn_cli.datasets.spec import DatasetSpec
from uasthn_cli.datasets.windows import (
    draw_offset_m,
    sample_rng,
    satellite_u8,
    square_corners_px,
    thermal_u8,
)
from uasthn_cli.errors import DatasetError
from uasthn_cli.geometry.corners import homography_from_corners, image_corners_px
from uasthn_cli.training.degrade import degrade_map, degrade_thermal
from uasthn_cli.training.engine import EngineConfig
from uasthn_cli.training.pseudo_thermal import thermal_from_colour
from uasthn_cli.types import FloatArray, GridBox, ImageArray

DEFAULT_SAMPLES = 100

_TRIES = 40
_LEAST_VALID_SHARE = 0.9
_MARGIN_PX = 2
_MIN_THERMAL_PX = 32


@dataclass(frozen=True, slots=True)
class _Draw:
    """Where one pair lies: the satellite window, and the thermal image's corners in it."""

    site: Site
    box: GridBox
    corners_px: FloatArray


class RenderedDataset:
    """Windows of overhead images, each with a thermal view rendered from another or the same date.

    Sample ``index`` depends on the seed and the index alone. Windows lie on the map by at least
    nine tenths, thermal views altogether.
    """

    def __init__(
        self, sites: Sequence[Site], spec: DatasetSpec, engine: EngineConfig | None = None
    ) -> None:
        """Draw from ``sites`` by area.

        Raises:
            DatasetError: no site is as large as a window, or windows cannot hold the offsets.
        """
        self._spec, self._engine = spec, engine or EngineConfig()
        self._sites = [site for site in sites if _fits(site, spec)]
        if not self._sites:
            raise DatasetError(
                f"none of {len(sites)} places is {spec.satellite_m:g} m wide and high, or their"
                f" pixels are too large for thermal images of {spec.thermal_m:g} m:"
                " try a smaller --ws, or other images"
            )
        area = np.array([site.area_m2 for site in self._sites])
        self._shares = area / area.sum()

    def __getstate__(self) -> dict[str, Any]:
        """Leave open files of places behind: another process opens its own."""
        return self.__dict__ | {"_sites": [copy.copy(site) for site in self._sites]}

    def __len__(self) -> int:
        """Return the number of samples asked for."""
        return DEFAULT_SAMPLES if self._spec.samples is None else self._spec.samples

    def __getitem__(self, index: int) -> MatchSample:
        """Render one sample.

        Raises:
            IndexError: there are not so many.
            DatasetError: the images hold too little data.
        """
        if not 0 <= index < len(self):
            raise IndexError(index)
        rng = sample_rng(self._spec.seed, index)
        for _ in range(_TRIES):
            sample = self._try(rng, self._draw(rng), f"{index:06d}")
            if sample is not None:
                return sample
        raise DatasetError(
            f"no window of {self._spec.satellite_m:g} m found that the images fill in {_TRIES}"
            " draws: try a smaller --ws or --dc"
        )

    def _draw(self, rng: np.random.Generator) -> _Draw:
        """Return a random place, window, and thermal image in it."""
        site = self._sites[int(rng.choice(len(self._sites), p=self._shares))]
        side_px = round(self._spec.satellite_m / site.gsd_m)
        thermal_px = round(self._spec.thermal_m / site.gsd_m)
        extent = site.extent
        column = extent.column_px + int(rng.integers(0, max(extent.width_px - side_px, 0) + 1))
        row = extent.row_px + int(rng.integers(0, max(extent.height_px - side_px, 0) + 1))
        offset_px = draw_offset_m(rng, self._spec.largest_offset_m) / site.gsd_m
        centre_px = (side_px - 1) / 2 + offset_px
        yaw = math.radians(rng.normal() * self._spec.yaw_error_deg)
        scale = math.exp(rng.normal() * self._spec.scale_error)
        turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        corners_px = scale * square_corners_px(thermal_px, np.zeros(2)) @ turn.T + centre_px
        return _Draw(site, GridBox(column, row, side_px, side_px), corners_px)

    def _try(self, rng: np.random.Generator, draw: _Draw, name: str) -> MatchSample | None:
        """Return the pair; None where the images have too little data."""
        map_date, thermal_date = (int(date) for date in rng.integers(0, draw.site.dates, 2))
        if not self._engine.date_change:
            thermal_date = map_date
        rgb, valid = draw.site.read(map_date, draw.box)
        if valid.mean() < _LEAST_VALID_SHARE:
            return None
        thermal = self._thermal(rng, draw, thermal_date)
        if thermal is None:
            return None
        satellite = satellite_u8(degrade_map(rng, rgb, self._engine), valid)
        return MatchSample(name, satellite, thermal_u8(thermal), draw.corners_px, draw.site.gsd_m)

    def _thermal(self, rng: np.random.Generator, draw: _Draw, date: int) -> ImageArray | None:
        """Render what lies between the thermal image's corners; None where that is not known."""
        first_px = np.floor(draw.corners_px.min(axis=0)).astype(int) - _MARGIN_PX
        last_px = np.ceil(draw.corners_px.max(axis=0)).astype(int) + _MARGIN_PX
        field_px = int((last_px - first_px).max()) + 1
        box = GridBox(
            draw.box.column_px + int(first_px[0]),
            draw.box.row_px + int(first_px[1]),
            field_px,
            field_px,
        )
        rgb, valid = draw.site.read(date, box)
        if not valid.all():
            return None
        field = thermal_from_colour(rng, rgb, self._engine)
        side_px = round(self._spec.thermal_m / draw.site.gsd_m)
        H_thermal_field = homography_from_corners(
            image_corners_px(side_px, side_px), draw.corners_px - first_px
        )
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(field, H_thermal_field, (side_px, side_px), flags=flags)
        return degrade_thermal(rng, seen, np.ones(seen.shape, np.float32), self._engine)


def _fits(site: Site, spec: DatasetSpec) -> bool:
    """Tell whether windows fit into a site, and thermal images show more than a few pixels."""
    extent = site.extent
    shorter_m = min(extent.width_px, extent.height_px) * site.gsd_m
    return shorter_m >= spec.satellite_m and spec.thermal_m / site.gsd_m >= _MIN_THERMAL_PX
