"""Tiles with a cache on disk are those without one, whatever becomes of map and cache."""

import logging
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray

from uasthn_cli.geometry.geodesy import LocalFrame
from uasthn_cli.mapping.content import content_sha256
from uasthn_cli.mapping.feature_store import FeatureStore
from uasthn_cli.mapping.reader import MapReader
from uasthn_cli.mapping.tiles import EncodingCache, FeatureTiles
from uasthn_cli.types import GridBox, MapWindow

BOX = GridBox(-20, -10, 40, 24)


class Encoder:
    """Halves the resolution, counts, and says who it is."""

    def __init__(self, encoding_id: str = "one") -> None:
        self.encoding_id, self.encoded = encoding_id, 0

    def encode_map(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        self.encoded += 1
        height, width = window.valid.shape
        blocks = window.image.reshape(height // 2, 2, width // 2, 2, 3)
        return np.asarray(np.moveaxis(blocks.mean(axis=(1, 3)), -1, 0))


RECOGNISED = {"whole": True}


@pytest.fixture(params=[True, False], ids=["map known whole", "window by window"], autouse=True)
def _recognised(request: pytest.FixtureRequest) -> None:
    RECOGNISED["whole"] = request.param


def windows_id(path: Path, reader: MapReader) -> str | None:
    """Return what a map's windows show; None for maps that are not recognised as a whole."""
    content = content_sha256(path)
    return None if content is None else reader.windows_id(content)


def features_of(path: Path, frame: LocalFrame, encoder: Encoder, store: FeatureStore) -> Any:
    """Return the features of a map's first tiles, as a new run would have them."""
    with MapReader(path, frame, 2.0) as reader:
        tiles = FeatureTiles(
            reader.read,
            encoder.encode_map,
            stride_px=2,
            halo_px=4,
            tile_px=32,
            cache=EncodingCache(
                store,
                encoder,
                reader.grid,
                windows_id(path, reader) if RECOGNISED["whole"] else None,
            ),
        )
        return tiles.read(BOX)


def noise(seed: int = 1) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(1, 255, (48, 80, 3)).astype(np.uint8)


def test_a_second_run_encodes_nothing_and_sees_the_same(
    tmp_path: Path, write_map: Any, frame: LocalFrame
) -> None:
    path, first, second = write_map(noise()), Encoder(), Encoder()
    plain = FeatureStore(tmp_path / "other")
    cold = features_of(path, frame, first, FeatureStore(tmp_path / "cache"))
    warm = features_of(path, frame, second, FeatureStore(tmp_path / "cache"))
    without = features_of(path, frame, Encoder(), plain)
    assert first.encoded > 0
    assert second.encoded == 0
    for features in (warm, without):
        assert features.values.dtype == cold.values.dtype
        np.testing.assert_array_equal(features.values, cold.values)
        np.testing.assert_array_equal(features.valid, cold.valid)


def test_a_map_changed_in_place_is_seen_anew(
    tmp_path: Path, write_map: Any, frame: LocalFrame
) -> None:
    store = FeatureStore(tmp_path / "cache")
    path = write_map(noise(1))
    features_of(path, frame, Encoder(), store)
    before = path.stat()
    changed = noise(1)
    changed[20, 31] = 255 - changed[20, 31]
    write_map(changed)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (path.stat().st_size, path.stat().st_mtime_ns) == (before.st_size, before.st_mtime_ns)
    seen = features_of(path, frame, Encoder(), store)
    expected = features_of(path, frame, Encoder(), FeatureStore(tmp_path / "other"))
    np.testing.assert_array_equal(seen.values, expected.values)


def test_overviews_added_later_are_seen_anew(
    tmp_path: Path, write_map: Any, frame: LocalFrame
) -> None:
    store, path = FeatureStore(tmp_path / "cache"), write_map(noise())
    box = GridBox(-10, -6, 20, 12)

    def features() -> Any:
        encoder = Encoder()
        with MapReader(path, frame, 4.0) as reader:
            cache = EncodingCache(store, encoder)
            tiles = FeatureTiles(
                reader.read, encoder.encode_map, stride_px=2, halo_px=4, tile_px=32, cache=cache
            )
            seen, expected = (
                tiles.read(box),
                FeatureTiles(
                    reader.read, encoder.encode_map, stride_px=2, halo_px=4, tile_px=32
                ).read(box),
            )
        np.testing.assert_array_equal(seen.values, expected.values)
        return seen.values

    before = features()
    with rasterio.open(path, "r+") as target:
        target.build_overviews((2,), rasterio.enums.Resampling.nearest)
    assert (features() != before).any()


def test_another_encoder_or_cut_has_its_own_features(
    tmp_path: Path, write_map: Any, frame: LocalFrame
) -> None:
    store, path = FeatureStore(tmp_path / "cache"), write_map(noise())
    features_of(path, frame, Encoder("one"), store)
    other = Encoder("two")
    features_of(path, frame, other, store)
    assert other.encoded > 0


@pytest.mark.parametrize("damage", ["empty", "cut", "longer", "flipped", "swapped", "text"])
def test_a_damaged_entry_is_computed_anew_and_replaced(
    tmp_path: Path, write_map: Any, frame: LocalFrame, damage: str
) -> None:
    folder, path = tmp_path / "cache", write_map(noise())
    cold = features_of(path, frame, Encoder(), FeatureStore(folder))
    entries = sorted(folder.iterdir())
    whole = entries[0].read_bytes()
    flipped = bytearray(whole)
    flipped[-7] ^= 1
    content = {
        "empty": b"",
        "cut": whole[:-10],
        "longer": whole + b"more",
        "flipped": bytes(flipped),
        "swapped": entries[1].read_bytes(),
        "text": b"no features" * 20,
    }[damage]
    entries[0].write_bytes(content)
    encoder = Encoder()
    again = features_of(path, frame, encoder, FeatureStore(folder))
    assert encoder.encoded == 1
    np.testing.assert_array_equal(again.values, cold.values)
    assert entries[0].read_bytes() == whole


def test_a_folder_that_cannot_be_made_costs_one_warning(
    tmp_path: Path, write_map: Any, frame: LocalFrame, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("in the way")
    store, encoder = FeatureStore(tmp_path / "file" / "cache"), Encoder()
    with caplog.at_level(logging.WARNING):
        features = features_of(write_map(noise()), frame, encoder, store)
    assert encoder.encoded > 1
    assert features.valid.any()
    assert len([record for record in caplog.records if "not kept" in record.message]) == 1


def test_a_known_map_is_not_read_again_where_it_shows_something_or_nothing(
    tmp_path: Path, write_map: Any, frame: LocalFrame
) -> None:
    path, store = write_map(noise()), FeatureStore(tmp_path / "cache")
    box = GridBox(-96, -64, 192, 128)
    seen = []
    for reads in (True, False):
        with MapReader(path, frame, 2.0) as reader:

            def read(window: GridBox, reader: MapReader = reader, reads: bool = reads) -> MapWindow:
                assert reads, "the map was read"
                return reader.read(window)

            cache = EncodingCache(store, Encoder(), reader.grid, windows_id(path, reader))
            assert cache.map_id is not None
            tiles = FeatureTiles(
                read, Encoder().encode_map, stride_px=2, halo_px=4, tile_px=32, cache=cache
            )
            tiles.read(GridBox(0, 0, 32, 32))  # learns how many channels there are
            seen.append(tiles.read(box))
    assert not seen[0].valid.all()
    np.testing.assert_array_equal(seen[0].values, seen[1].values)
    np.testing.assert_array_equal(seen[0].valid, seen[1].valid)
