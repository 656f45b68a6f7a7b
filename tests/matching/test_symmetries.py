"""The eight symmetries of a square, on images that are not square."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from uasthn_cli.matching.symmetries import SYMMETRIES, encode_symmetric
from uasthn_cli.types import BoolArray, ImageArray

Encode = Callable[[ImageArray, BoolArray], ImageArray]


def image_and_valid() -> tuple[ImageArray, BoolArray]:
    draw = np.random.default_rng(0)
    return draw.random((3, 12, 20), np.float32), draw.random((12, 20)) > 0.2


def convolved(kernel: ImageArray) -> Encode:
    """Return an encoder of one channel that correlates the first plane with a kernel."""

    def encode(image: ImageArray, _: BoolArray) -> ImageArray:
        filtered = cv2.filter2D(image[0], -1, kernel, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(filtered, np.float32)[None]

    return encode


def stacks(encode: Encode) -> list[ImageArray]:
    image, valid = image_and_valid()
    return np.split(encode_symmetric(encode, image, valid, SYMMETRIES), SYMMETRIES)


def test_turning_and_turning_back_is_the_identity() -> None:
    image, valid = image_and_valid()
    for turned_back in stacks(lambda x, mask: x * mask):
        np.testing.assert_array_equal(turned_back, image * valid)


def test_an_encoder_without_preferred_direction_gives_equal_stacks() -> None:
    def pooled(x: ImageArray, mask: BoolArray) -> ImageArray:
        rows, columns = mask.shape
        blocks = (x * mask).reshape(3, rows // 2, 2, columns // 2, 2)
        return np.asarray(blocks.mean(axis=(2, 4)) ** 2, np.float32)

    first, *others = stacks(pooled)
    assert first.shape == (3, 6, 10)
    for other in others:
        np.testing.assert_allclose(other, first, rtol=1e-6)


def test_an_encoder_with_a_preferred_direction_is_seen_eight_ways() -> None:
    found = stacks(convolved(np.arange(9, dtype=np.float32).reshape(3, 3)))
    for index, one in enumerate(found):
        for other in found[index + 1 :]:
            assert not np.allclose(one, other)


def test_convention_a_turned_kernel_does_what_turning_the_image_does() -> None:
    image, valid = image_and_valid()
    kernel = np.zeros((3, 3), np.float32)
    kernel[1, 2] = 1.0  # each pixel takes the value of its right neighbour
    found = encode_symmetric(convolved(kernel), image, valid, SYMMETRIES)
    inside = (slice(1, -1), slice(1, -1))
    directions = {
        name: np.roll(image[0], shift, axis)[inside]
        for name, shift, axis in (
            ("right", -1, 1),
            ("left", 1, 1),
            ("below", -1, 0),
            ("above", 1, 0),
        )
    }
    # turned a quarter counter-clockwise, the right neighbour is what lay below
    expected = ("right", "left", "below", "above", "left", "right", "above", "below")
    for plane, name in zip(found, expected, strict=True):
        np.testing.assert_array_equal(plane[inside], directions[name], name)


@pytest.mark.parametrize("count", [1, 4])
def test_fewer_symmetries_are_the_first_of_them(count: int) -> None:
    image, valid = image_and_valid()
    encode = convolved(np.arange(9, dtype=np.float32).reshape(3, 3))
    few = encode_symmetric(encode, image, valid, count)
    np.testing.assert_array_equal(few, encode_symmetric(encode, image, valid, SYMMETRIES)[:count])
