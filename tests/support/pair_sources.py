"""Miniature data sets, written by the tests in the layouts that are read."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import h5py
import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.transform import from_origin

BOSON_SIZE_PX = (2400, 1700)
"""Width and height of the miniature's map, at 1 m a pixel."""


def texture(seed: int, width_px: int, height_px: int) -> NDArray[np.uint8]:
    """Return a grey picture with structure at several scales that repeats nowhere."""
    random = np.random.default_rng(seed)
    picture = np.zeros((height_px, width_px))
    for sigma in (3.0, 8.0, 25.0):
        layer = cv2.GaussianBlur(random.standard_normal((height_px, width_px)), (0, 0), sigma)
        picture += layer / layer.std()
    return np.asarray(np.clip(128.0 + 40.0 * picture / picture.std(), 1, 255), np.uint8)


def write_geotiff(
    path: Path, grey: NDArray[np.uint8], gsd_m: float, west_m: float = 500_000.0
) -> Path:
    """Write a picture as a map in UTM zone 40."""
    height_px, width_px = grey.shape
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=width_px,
        height=height_px,
        count=3,
        dtype="uint8",
        crs="EPSG:32640",
        transform=from_origin(west_m, 2_650_000.0, gsd_m, gsd_m),
    ) as raster:
        raster.write(np.repeat(grey[None], 3, axis=0))
    return path


def write_boson(
    root: Path,
    centres_px: Mapping[str, Sequence[tuple[int, int]]],
    *,
    name: str = "@{x}@{y}@",
    channels: int = 0,
) -> tuple[Path, NDArray[np.uint8]]:
    """Write map and queries; ``centres_px`` are the queries' middles on the map by split.

    Returns the folder to name and the map's grey values. A query shows the map itself, so that it
    is plain to see where it lies.
    """
    width_px, height_px = BOSON_SIZE_PX
    ground = texture(5, width_px, height_px)
    maps = root / "maps" / "satellite"
    maps.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(maps / "20201117_BingSatellite.png"), np.repeat(ground[..., None], 3, axis=2))
    folder = root / "satellite_0_thermalmapping_135"
    folder.mkdir(exist_ok=True)
    padded = np.pad(ground, 384)
    for split, places in centres_px.items():
        images = np.stack([padded[y : y + 768, x : x + 768] for x, y in places])
        if channels:
            images = np.repeat(images[..., None], channels, axis=-1)
        with h5py.File(folder / f"{split}_queries.h5", "w") as opened:
            opened["image_data"] = images
            opened["image_size"] = np.full((len(places), 2), 768)
            opened["image_name"] = [name.format(x=x, y=y) for x, y in places]
    return folder, ground
