"""Flights that are made for measuring show the same ground as the flight that they come from."""

from pathlib import Path

import numpy as np
import rasterio
from small_flight import HFOV_DEG, make_flight
from speed_inputs import flight_of, in_huge_map, one_frame, rendered_flight

from uasthn_cli.ingest.frames import list_frames


def test_one_frame_is_the_middle_one(tmp_path: Path) -> None:
    flight = flight_of(make_flight(tmp_path / "small", count=3).log.parent, HFOV_DEG, 40.0)
    alone = one_frame(flight, tmp_path / "one")
    assert (flight.count, alone.count) == (3, 1)
    assert [one.name for one in list_frames(alone.frames)] == [list_frames(flight.frames)[1].name]


def test_a_huge_map_has_the_same_pixels_at_the_same_place(tmp_path: Path) -> None:
    flight = flight_of(make_flight(tmp_path / "small", count=1).log.parent, HFOV_DEG, 40.0)
    sparse = in_huge_map(flight, tmp_path / "sparse.tif", 0.5, on_disk=False)
    full = in_huge_map(flight, tmp_path / "full.tif", 0.5, on_disk=True)
    assert sparse.map.stat().st_size < 2**20 < 4e8 < full.map.stat().st_size < 6e8
    with rasterio.open(flight.map) as small:
        for huge in (sparse, full):
            with rasterio.open(huge.map) as large:
                assert large.width * large.height * large.count > 4e8
                seen = large.read(window=large.window(*small.bounds))
            assert np.array_equal(seen, small.read())


def test_flights_are_rendered_once(tmp_path: Path) -> None:
    flight = rendered_flight(tmp_path / "flights" / "2", 2)
    assert (flight.name, flight.count) == ("2 frames", 2)
    written_s = flight.map.stat().st_mtime_ns
    assert rendered_flight(tmp_path / "flights" / "2", 2).map.stat().st_mtime_ns == written_s
