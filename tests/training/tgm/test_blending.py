"""Tiles cover an image once, and blend where they overlap."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uasthn_cli.training.tgm.blending import FloatImage, blend, tile_side, tiles_to_render
from uasthn_cli.types import GridBox

sides = st.tuples(st.integers(1, 400), st.integers(2, 60), st.floats(0, 0.5)).map(
    lambda side: (side[0], side[1], int(side[1] * side[2]))
)


@given(side=sides)
def test_weights_add_up_to_one_and_no_tile_sticks_out(side: tuple[int, int, int]) -> None:
    length_px, tile_px, overlap_px = side
    tiling = tile_side(length_px, tile_px, overlap_px)
    total = np.zeros(length_px)
    for start, weights in zip(tiling.starts_px, tiling.weights, strict=True):
        total[start : start + tiling.tile_px] += weights
        assert (weights >= 0).all()
    assert np.allclose(total, 1, atol=1e-6)
    assert tiling.starts_px[0] == 0
    assert tiling.starts_px[-1] + tiling.tile_px == length_px
    steps = np.diff(tiling.starts_px)
    assert (steps > 0).all()
    assert (steps <= tiling.tile_px - overlap_px).all()


@settings(max_examples=40, deadline=None)
@given(columns=sides, rows=sides)
def test_pieces_cover_the_image_once_and_give_back_what_was_cut(
    columns: tuple[int, int, int], rows: tuple[int, int, int]
) -> None:
    across, down = tile_side(*columns), tile_side(*rows)
    rng = np.random.default_rng(0)
    image = rng.random((down.length_px, across.length_px), dtype=np.float32)
    rendered = []

    def cut(box: GridBox) -> FloatImage:
        rendered.append(box)
        bottom, right = box.row_px + box.height_px, box.column_px + box.width_px
        return image[box.row_px : bottom, box.column_px : right]

    covered = np.zeros(image.shape, int)
    for box, piece in blend(across, down, cut):
        place = np.s_[
            box.row_px : box.row_px + box.height_px, box.column_px : box.column_px + box.width_px
        ]
        covered[place] += 1
        assert np.allclose(piece, image[place], atol=1e-5)
    assert (covered == 1).all()
    assert len(rendered) == tiles_to_render(across, down)


def test_tiles_fade_into_each_other() -> None:
    across, down = tile_side(40, 24, 8), tile_side(24, 24, 8)
    pieces = blend(across, down, lambda box: np.full((24, 24), box.column_px, dtype=np.float32))
    ((_, piece),) = pieces
    assert (piece == piece[0]).all()
    assert (piece[0, :16] == 0).all()
    assert (piece[0, 24:] == 16).all()
    assert np.allclose(np.diff(piece[0, 16:24]), 2.0)


@pytest.mark.parametrize("side", [(0, 8, 2), (20, 8, 5), (20, 8, -1)])
def test_impossible_tiles(side: tuple[int, int, int]) -> None:
    with pytest.raises(ValueError, match="no tiles"):
        tile_side(*side)
