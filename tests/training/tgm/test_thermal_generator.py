"""Single windows, of any size."""

import numpy as np
import pytest
from tiny_tgm import TINY_RESNET, TINY_UNET, tiny_generator

from uasthn_cli.training.tgm.generators import GeneratorArchitecture


def colours(height_px: int, width_px: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return np.random.default_rng(0).integers(0, 256, (height_px, width_px, 3), dtype=np.uint8)


@pytest.mark.parametrize("architecture", [TINY_UNET, TINY_RESNET])
@pytest.mark.parametrize("shape_px", [(50, 90), (64, 64), (97, 33), (7, 9), (1, 1)])
def test_any_size_comes_back_as_grey(
    architecture: GeneratorArchitecture, shape_px: tuple[int, int]
) -> None:
    generator = tiny_generator(architecture=architecture)
    window = colours(*shape_px)
    drawn = generator.render(window)
    assert drawn.shape == shape_px
    assert drawn.dtype == np.uint8
    assert (generator.render(window) == drawn).all()
    if min(shape_px) > 30:
        assert drawn.std() > 5


@pytest.mark.parametrize(
    "wrong",
    [
        np.zeros((8, 8), np.uint8),
        np.zeros((8, 8, 4), np.uint8),
        np.zeros((8, 8, 3), np.float32),
        np.zeros((0, 8, 3), np.uint8),
    ],
)
def test_no_colours_are_refused(wrong: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> None:
    with pytest.raises(ValueError, match="not a window of 8-bit colours"):
        tiny_generator().render(wrong)


def test_scale() -> None:
    generator = tiny_generator(gsd_m=2.0)
    assert (generator.pixels_of(512.0), generator.pixels_of(0.1)) == (256, 1)
    assert generator.is_own_scale(2.05)
    assert not generator.is_own_scale(2.2)
    assert not generator.is_own_scale(1.8)
