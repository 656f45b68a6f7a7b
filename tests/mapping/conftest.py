"""Small maps, written as the tests need them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine
from numpy.typing import NDArray

from uasthn_cli.geometry.geodesy import LocalFrame

WriteMap = Callable[..., Path]


@pytest.fixture
def frame() -> LocalFrame:
    """A place well away from any meridian on which UTM and true north agree."""
    return LocalFrame(47.05, -99.2)


@pytest.fixture
def write_map(tmp_path: Path, frame: LocalFrame) -> WriteMap:
    """Return a writer of GeoTIFFs ``(h, w)`` or ``(h, w, bands)``.

    By default 2 m pixels in the flight's own CRS, raster pixel (0, 0) on grid pixel (-20, -10).
    """

    def write(
        pixels: NDArray[Any],
        name: str = "map.tif",
        *,
        crs: str | None = "local",
        transform: Affine | None = None,
        interpretation: Any = None,
        mask: NDArray[np.bool_] | None = None,
        colormap: dict[int, tuple[int, int, int]] | None = None,
        overviews: tuple[int, ...] = (),
        **profile: Any,
    ) -> Path:
        planes = pixels[:, :, None] if pixels.ndim == 2 else pixels
        height_px, width_px, count = planes.shape
        path = tmp_path / name
        place: dict[str, Any] = {"crs": frame.wkt() if crs == "local" else crs}
        place["transform"] = transform or local_transform(2.0, -20, -10)
        shape = {"width": width_px, "height": height_px, "count": count}
        with (
            rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True),
            rasterio.open(
                path, "w", driver="GTiff", dtype=planes.dtype, **shape, **place, **profile
            ) as target,
        ):
            if interpretation is not None:
                target.colorinterp = interpretation
            if colormap is not None:
                target.write_colormap(1, colormap)
            target.write(np.moveaxis(planes, -1, 0))
            if mask is not None:
                target.write_mask(mask)
        if overviews:
            with rasterio.open(path, "r+") as target:
                target.build_overviews(overviews, rasterio.enums.Resampling.average)
        return path

    return write


def local_transform(gsd_m: float, column_px: int, row_px: int) -> Affine:
    """Return the transform of a raster whose first pixel is a pixel of the flight's grid."""
    west_m, north_m = (column_px - 0.5) * gsd_m, -(row_px - 0.5) * gsd_m
    return Affine(gsd_m, 0.0, west_m, 0.0, -gsd_m, north_m)
