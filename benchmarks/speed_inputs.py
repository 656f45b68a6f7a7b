"""Flights that `speed.py` measures: as given, one frame of them, longer ones, in a huge map."""

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rasterio
from rasterio.windows import Window, bounds
from rasterio.windows import transform as window_transform

from uasthn_cli.ingest.frames import list_frames
from uasthn_cli.synth.flight import render_flight
from uasthn_cli.synth.flight_config import FlightConfig

_BLOCK_PX = 512


@dataclass(frozen=True, slots=True)
class Flight:
    """What is geo-tagged: the files of a flight, its camera, how far to search, how many frames."""

    name: str
    log: Path
    frames: Path
    map: Path
    hfov_deg: float
    radius_m: float
    count: int


def flight_of(folder: Path, hfov_deg: float, radius_m: float) -> Flight:
    """Return the flight in a folder of ``flight.tlog``, ``frames/`` and ``map.tif``."""
    folder = folder.absolute()
    frames = folder / "frames"
    count = len(list_frames(frames))
    log, imagery = folder / "flight.tlog", folder / "map.tif"
    return Flight(folder.name, log, frames, imagery, hfov_deg, radius_m, count)


def one_frame(flight: Flight, folder: Path) -> Flight:
    """Return the same flight with the frame in its middle alone, as a link in a new folder."""
    frames = list_frames(flight.frames)
    middle = frames[len(frames) // 2]
    link = folder / middle.name
    link.parent.mkdir(parents=True)
    link.symlink_to(middle.path)
    return replace(flight, frames=folder, count=1)


def rendered_flight(folder: Path, frames: int) -> Flight:
    """Return a flight of so many small frames that overlap much, so that its map stays small.

    It is rendered unless the folder exists.
    """
    config = FlightConfig(
        frames=frames, frame_width_px=160, frame_height_px=128, overlap=0.9, drift_m=60.0
    )
    if not folder.exists():
        folder.parent.mkdir(parents=True, exist_ok=True)
        render_flight(folder, config)
    flight = flight_of(folder, config.hfov_deg, 100.0)
    return replace(flight, name=f"{frames} frames")


def in_huge_map(flight: Flight, path: Path, gigabytes: float, *, on_disk: bool) -> Flight:
    """Return the flight with its map in the middle of an otherwise empty one of so many gigabytes.

    What is empty takes no room: the GeoTIFF leaves these tiles out. With ``on_disk`` the file has
    its full length too, so that whoever reads it from end to end pays for that (where the file
    system knows holes, these still take no room).
    """
    with rasterio.open(flight.map) as source:
        pixels = source.read()
        bytes_px = source.count * np.dtype(source.dtypes[0]).itemsize
        side_px = math.isqrt(round(1e9 * gigabytes / bytes_px)) // _BLOCK_PX * _BLOCK_PX
        side_px = max(side_px, *(_BLOCK_PX * math.ceil(n / _BLOCK_PX) for n in source.shape))
        row, column = ((side_px - n) // 2 for n in source.shape)
        whole = Window(-column, -row, side_px, side_px)
        profile = {
            **{"driver": "GTiff", "count": source.count, "dtype": source.dtypes[0]},
            **{"crs": source.crs, "transform": window_transform(whole, source.transform)},
            **{"width": side_px, "height": side_px, "nodata": source.nodata or 0},
            **{"tiled": True, "blockxsize": _BLOCK_PX, "blockysize": _BLOCK_PX},
            **{"BIGTIFF": "YES", "SPARSE_OK": "TRUE", "photometric": source.photometric},
        }
        place = Window(column, row, source.width, source.height)
        assert np.allclose(bounds(place, profile["transform"]), source.bounds), (
            "the map stays where it is"
        )
    with rasterio.open(path, "w", **profile) as target:
        target.write(pixels, window=place)
    if on_disk:
        os.truncate(path, max(path.stat().st_size, side_px**2 * bytes_px))
    return replace(flight, map=path)
