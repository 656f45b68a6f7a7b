"""Features stitched from tiles are the features of the whole."""

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from uasthn_cli.mapping.tiles import FeatureTiles, aligned_box
from uasthn_cli.types import GridBox, MapGrid, MapStatistics, MapWindow

GRID = MapGrid(2.0)
STATISTICS = MapStatistics((0.5, 0.5, 0.5), 0.2)
WORLD = np.random.default_rng(3).uniform(0, 1, (300, 400, 3)).astype(np.float32)
WORLD_ROW, WORLD_COLUMN = -120, -170


class FakeMap:
    """A map in memory, counting what is asked of it; nothing is valid outside ``WORLD``."""

    def __init__(self) -> None:
        self.encoded: list[GridBox] = []

    def read(self, box: GridBox) -> MapWindow:
        rows = np.arange(box.row_px, box.row_px + box.height_px) - WORLD_ROW
        columns = np.arange(box.column_px, box.column_px + box.width_px) - WORLD_COLUMN
        valid = np.logical_and.outer(
            (rows >= 0) & (rows < WORLD.shape[0]), (columns >= 0) & (columns < WORLD.shape[1])
        )
        image = WORLD[np.clip(rows, 0, 299)[:, None], np.clip(columns, 0, 399)]
        return MapWindow(image * valid[..., None], valid, box, GRID, STATISTICS)

    def identity(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        self.encoded.append(window.box)
        return np.moveaxis(window.image, -1, 0)

    def pool(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        self.encoded.append(window.box)
        height, width = window.valid.shape
        blocks = window.image.reshape(height // 2, 2, width // 2, 2, 3)
        return np.asarray(np.moveaxis(blocks.mean(axis=(1, 3)), -1, 0))

    def convolve(self, window: MapWindow) -> NDArray[np.floating[Any]]:
        """Blur with 17 × 17 pixels: eight of context on every side."""
        self.encoded.append(window.box)
        blurred = cv2.blur(window.image, (17, 17), borderType=cv2.BORDER_CONSTANT)
        return np.asarray(np.moveaxis(blurred, -1, 0))


def two_tiles(world: FakeMap) -> FeatureTiles:
    """Return tiles of 32 × 32 pixels that have memory for two of them and a bit."""
    a_tile = 16 * 16 * (3 * 2 + 1)
    return FeatureTiles(
        world.read, world.pool, stride_px=2, halo_px=0, tile_px=32, max_bytes=5 * a_tile // 2
    )


boxes = st.builds(
    lambda column, row, width, height: GridBox(2 * column, 2 * row, 2 * width, 2 * height),
    st.integers(-90, 90),
    st.integers(-70, 70),
    st.integers(1, 80),
    st.integers(1, 60),
)


@settings(max_examples=40)
@given(boxes)
def test_identity_features_are_the_map(box: GridBox) -> None:
    world = FakeMap()
    tiles = FeatureTiles(world.read, world.identity, stride_px=1, halo_px=4, tile_px=32)
    features, direct = tiles.read(box), world.read(box)
    assert features.values.dtype == np.float16
    np.testing.assert_array_equal(features.valid, direct.valid)
    np.testing.assert_allclose(features.values, np.moveaxis(direct.image, -1, 0), atol=5e-4)
    assert (features.box, features.grid, features.stride_px) == (box, GRID, 1)


@settings(max_examples=40)
@given(boxes)
def test_pooled_features_are_the_pooled_map(box: GridBox) -> None:
    world = FakeMap()
    tiles = FeatureTiles(world.read, world.pool, stride_px=2, halo_px=4, tile_px=32)
    features, direct = tiles.read(box), world.read(box)
    assert features.values.shape == (3, box.height_px // 2, box.width_px // 2)
    np.testing.assert_allclose(features.values, world.pool(direct), atol=5e-4)
    whole_cells = direct.valid[::2, ::2] & direct.valid[1::2, ::2]
    whole_cells &= direct.valid[::2, 1::2] & direct.valid[1::2, 1::2]
    np.testing.assert_array_equal(features.valid, whole_cells)


def test_a_cell_is_valid_only_with_all_its_pixels() -> None:
    world = FakeMap()
    tiles = FeatureTiles(world.read, world.pool, stride_px=2, halo_px=0, tile_px=32)
    world_read = world.read

    def read_with_a_hole(box: GridBox) -> MapWindow:
        window = world_read(box)
        if box.column_px <= 5 < box.column_px + 32 and box.row_px <= 7 < box.row_px + 32:
            window.valid[7 - box.row_px, 5 - box.column_px] = False
        return window

    tiles = FeatureTiles(read_with_a_hole, world.pool, stride_px=2, halo_px=0, tile_px=32)
    valid = tiles.read(GridBox(0, 0, 12, 10)).valid
    expected = np.ones((5, 6), dtype=bool)
    expected[3, 2] = False
    np.testing.assert_array_equal(valid, expected)


def test_context_within_the_halo_leaves_no_seams() -> None:
    world = FakeMap()
    box = GridBox(-150, -100, 300, 200)
    margin = GridBox(-158, -108, 316, 216)
    whole = world.convolve(world.read(margin))[:, 8:-8, 8:-8]
    tiles = FeatureTiles(world.read, world.convolve, stride_px=1, halo_px=8, tile_px=64)
    np.testing.assert_allclose(tiles.read(box).values, whole, atol=5e-4)
    too_narrow = FeatureTiles(world.read, world.convolve, stride_px=1, halo_px=4, tile_px=64)
    assert np.abs(too_narrow.read(box).values - whole).max() > 0.01


def test_a_tile_is_encoded_once() -> None:
    world = FakeMap()
    tiles = FeatureTiles(world.read, world.pool, stride_px=2, halo_px=4, tile_px=32)
    tiles.read(GridBox(-10, 4, 50, 30))
    assert len(world.encoded) == 6
    tiles.read(GridBox(-32, 0, 96, 64))
    assert len(world.encoded) == 6
    assert all(box.width_px == box.height_px == 40 for box in world.encoded)
    assert {box.column_px % 32 for box in world.encoded} == {28}


def test_the_least_recent_tile_is_dropped() -> None:
    world = FakeMap()
    tiles = two_tiles(world)
    first, second, third = (GridBox(column, 0, 32, 32) for column in (0, 32, 64))
    for box in (first, second, first, third, first):
        tiles.read(box)
    assert world.encoded == [first, second, third]
    tiles.read(second)
    assert world.encoded[-1] == second


def test_a_box_larger_than_the_store_is_served_and_kept() -> None:
    world = FakeMap()
    tiles = two_tiles(world)
    box = GridBox(-64, -32, 128, 96)
    np.testing.assert_allclose(tiles.read(box).values, world.pool(world.read(box)), atol=5e-4)
    encoded = len(world.encoded)
    tiles.read(box)
    assert len(world.encoded) == encoded


def test_memory_for_a_large_box_is_given_back() -> None:
    world = FakeMap()
    tiles = two_tiles(world)
    tiles.read(GridBox(-64, -32, 128, 96))
    first, second = GridBox(0, 64, 32, 32), GridBox(32, 64, 32, 32)
    encoded = len(world.encoded)
    for box in (first, second, first, second):
        tiles.read(box)
    assert len(world.encoded) == encoded + 2
    tiles.read(GridBox(-64, -32, 32, 32))
    assert len(world.encoded) == encoded + 3


def test_a_tile_that_failed_is_tried_again() -> None:
    world = FakeMap()
    failures = [OSError("torn")]

    def read(box: GridBox) -> MapWindow:
        if failures:
            raise failures.pop()
        return world.read(box)

    tiles = FeatureTiles(read, world.pool, stride_px=2, halo_px=0, tile_px=32)
    with pytest.raises(OSError, match="torn"):
        tiles.read(GridBox(0, 0, 32, 32))
    assert tiles.read(GridBox(0, 0, 32, 32)).valid.all()


def test_tiles_without_map_are_zero_and_not_encoded() -> None:
    world = FakeMap()
    tiles = FeatureTiles(world.read, world.pool, stride_px=2, halo_px=0, tile_px=32)
    features = tiles.read(GridBox(192, 0, 128, 32))
    assert len(world.encoded) == 2
    assert features.valid[:, :19].all()
    assert not features.valid[:, 19:].any()
    assert not features.values[:, :, 32:].any()


def test_a_box_wholly_off_the_map_still_has_its_channels() -> None:
    world = FakeMap()
    tiles = FeatureTiles(world.read, world.pool, stride_px=2, halo_px=0, tile_px=32)
    features = tiles.read(GridBox(3200, 0, 64, 32))
    assert features.values.shape == (3, 16, 32)
    assert not features.valid.any()
    assert not features.values.any()


@pytest.mark.parametrize(
    "box", [GridBox(1, 0, 8, 8), GridBox(0, 1, 8, 8), GridBox(0, 0, 7, 8), GridBox(0, 0, 0, 8)]
)
def test_a_box_off_the_stride_is_refused(box: GridBox) -> None:
    world = FakeMap()
    tiles = FeatureTiles(world.read, world.pool, stride_px=2, halo_px=0, tile_px=32)
    with pytest.raises(ValueError, match="GridBox"):
        tiles.read(box)


def test_tiles_off_the_stride_are_refused() -> None:
    world = FakeMap()
    for halo_px, tile_px in ((3, 32), (4, 33), (4, 0)):
        with pytest.raises(ValueError, match="multiples"):
            FeatureTiles(world.read, world.pool, stride_px=2, halo_px=halo_px, tile_px=tile_px)


@given(
    st.floats(-1e4, 1e4),
    st.floats(-1e4, 1e4),
    st.floats(1, 500),
    st.floats(1, 500),
    st.sampled_from([1, 2, 8, 16]),
)
def test_aligned_boxes_enclose_and_waste_less_than_one_step(
    x: float, y: float, width_px: float, height_px: float, multiple_px: int
) -> None:
    box = aligned_box((x, y), width_px, height_px, multiple_px)
    for centre, size, first, length in (
        (x, width_px, box.column_px, box.width_px),
        (y, height_px, box.row_px, box.height_px),
    ):
        assert first % multiple_px == 0
        assert length % multiple_px == 0
        slack = 1e-4 * multiple_px
        before = (centre - size / 2) - (first - 0.5)
        after = (first + length - 0.5) - (centre + size / 2)
        assert -slack <= before < multiple_px + slack
        assert -slack <= after < multiple_px + slack


def test_convention_an_aligned_box_counts_pixel_areas() -> None:
    assert aligned_box((31.5, 23.5), 64, 48, 16) == GridBox(0, 0, 64, 48)
    assert aligned_box(np.array([31.5, 23.5]), 65, 48, 16) == GridBox(-16, 0, 96, 48)
    assert aligned_box((0.0, 0.0), 1, 1, 1) == GridBox(0, 0, 1, 1)
