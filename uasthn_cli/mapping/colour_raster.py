"""A map in its own pixels, read piece by piece as 8-bit colour."""

from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray
from rasterio.enums import Resampling
from rasterio.windows import Window

from uasthn_cli.mapping.georeference import Georeference
from uasthn_cli.mapping.radiometry import Scaling, find_scaling, sample_boxes
from uasthn_cli.mapping.raster import gdal_errors, open_source
from uasthn_cli.types import BoolArray, GridBox, ImageArray


class ColourRaster:
    """A georeferenced map, open for reading; a context manager.

    Boxes are of the raster's own pixels. Values of more than 8 bits are scaled by the robust range
    of a bounded sample of the map, the same throughout.
    """

    def __init__(self, path: Path) -> None:
        """Open the map and find how its values become colours.

        Raises:
            MapUnreadableError: missing, corrupt, or not a raster that GDAL reads.
            MapWithoutCrsError: the map does not say where on earth it lies.
        """
        self._path = path
        self._source = open_source(path)
        self._scaling = self._find_scaling()

    def __enter__(self) -> "ColourRaster":
        """Return the raster itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file."""
        self._source.dataset.close()

    @property
    def place(self) -> Georeference:
        """Where the map lies, and its size."""
        return self._source.place

    def gsd_m(self) -> float:
        """Return the ground metres per pixel in the map's middle."""
        return self.place.gsd_m(self.place.middle_deg())

    def read(self, box: GridBox, size_px: tuple[int, int]) -> NDArray[np.uint8]:
        """Return colours ``(h, w, 3)`` of a box inside the map, at ``size_px`` (width, height).

        Averaged from the overview that fits where that is smaller than the box; black where there
        is no data.

        Raises:
            MapUnreadableError: the file is damaged where it was read.
        """
        colours = self._scaling.apply(self._raw(box, size_px))
        colours[~self._valid(box, size_px)] = 0.0
        pixels = np.rint(np.nan_to_num(colours) * 255.0).astype(np.uint8)
        return np.repeat(pixels, 3, axis=-1) if pixels.shape[-1] == 1 else pixels

    def valid(self, box: GridBox) -> BoolArray:
        """Tell which pixels ``(h, w)`` of a box inside the map hold data.

        Raises:
            MapUnreadableError: the file is damaged where it was read.
        """
        return self._valid(box, (box.width_px, box.height_px))

    def _raw(self, box: GridBox, size_px: tuple[int, int]) -> ImageArray:
        bands = list(self._source.colour_bands)
        is_smaller = size_px[0] < box.width_px or size_px[1] < box.height_px
        with gdal_errors(self._path, "read"):
            planes = self._source.dataset.read(
                bands,
                window=_window(box),
                out_shape=(len(bands), size_px[1], size_px[0]),
                resampling=Resampling.average if is_smaller else Resampling.bilinear,
            )
        return np.asarray(np.moveaxis(planes, 0, -1), dtype=np.float32)

    def _valid(self, box: GridBox, size_px: tuple[int, int]) -> BoolArray:
        with gdal_errors(self._path, "read"):
            mask = self._source.dataset.dataset_mask(
                window=_window(box), out_shape=(size_px[1], size_px[0])
            )
        return np.asarray(mask > 0, dtype=np.bool_)

    def _find_scaling(self) -> Scaling:
        dtype = self._source.dataset.dtypes[self._source.colour_bands[0] - 1]
        if dtype == "uint8":
            return find_scaling(dtype, np.zeros((0, 3), np.float32), str(self._path))
        whole = GridBox(0, 0, self.place.width_px, self.place.height_px)
        samples = []
        for box in sample_boxes(whole, 1.0):
            raw = self._raw(box, (box.width_px, box.height_px))
            samples.append(raw[self.valid(box) & np.isfinite(raw).all(axis=-1)])
        return find_scaling(dtype, np.concatenate(samples), str(self._path))


def _window(box: GridBox) -> Window:
    return Window(box.column_px, box.row_px, box.width_px, box.height_px)
