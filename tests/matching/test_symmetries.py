"""The eight symmetries of a square, on images that are not square."""

from collections.abc import Callable

import pytest
import torch
import torch.nn.functional as F  # noqa: N812 (the name everyone knows)
from torch import Tensor

from uasthn_cli.matching.symmetries import SYMMETRIES, encode_symmetric

Encode = Callable[[Tensor, Tensor], Tensor]


def image_and_valid() -> tuple[Tensor, Tensor]:
    draw = torch.Generator().manual_seed(0)
    image = torch.rand(2, 3, 12, 20, generator=draw)
    valid = (torch.rand(2, 1, 12, 20, generator=draw) > 0.2).float()
    return image, valid


def stacks(encode: Encode) -> tuple[Tensor, ...]:
    image, valid = image_and_valid()
    return encode_symmetric(encode, image, valid, SYMMETRIES).chunk(SYMMETRIES, dim=1)


def test_turning_and_turning_back_is_the_identity() -> None:
    image, valid = image_and_valid()
    for turned_back in stacks(lambda x, mask: x * mask):
        assert torch.equal(turned_back, image * valid)


def test_an_encoder_without_preferred_direction_gives_equal_stacks() -> None:
    first, *others = stacks(lambda x, mask: F.avg_pool2d(x * mask, 2) ** 2)
    assert first.shape == (2, 3, 6, 10)
    for other in others:
        torch.testing.assert_close(other, first)


def test_an_encoder_with_a_preferred_direction_is_seen_eight_ways() -> None:
    weight = torch.arange(9.0).reshape(1, 1, 3, 3)
    found = stacks(lambda x, mask: F.conv2d(x[:, :1], weight, padding=1))
    for index, one in enumerate(found):
        for other in found[index + 1 :]:
            assert not torch.allclose(one, other)


def test_convention_a_turned_kernel_does_what_turning_the_image_does() -> None:
    image, valid = image_and_valid()
    kernel = torch.zeros(1, 1, 3, 3)
    kernel[0, 0, 1, 2] = 1.0  # each pixel takes the value of its right neighbour

    def from_the_right(x: Tensor, mask: Tensor) -> Tensor:
        return F.conv2d(x[:, :1], kernel, padding=1)

    found = encode_symmetric(from_the_right, image, valid, SYMMETRIES)
    inside = (slice(None), slice(1, -1), slice(1, -1))
    directions = {
        name: torch.roll(image[:, 0], shift, dims)[inside]
        for name, shift, dims in (
            ("right", -1, 2),
            ("left", 1, 2),
            ("below", -1, 1),
            ("above", 1, 1),
        )
    }
    # turned a quarter counter-clockwise, the right neighbour is what lay below
    expected = ("right", "below", "left", "above", "left", "above", "right", "below")
    for index, name in enumerate(expected):
        assert torch.equal(found[:, index][inside], directions[name]), (index, name)


@pytest.mark.parametrize("count", [1, 4])
def test_fewer_symmetries_are_the_first_of_them(count: int) -> None:
    image, valid = image_and_valid()
    weight = torch.arange(9.0).reshape(1, 1, 3, 3)

    def encode(x: Tensor, mask: Tensor) -> Tensor:
        return F.conv2d(x[:, :1], weight, padding=1)

    few = encode_symmetric(encode, image, valid, count)
    assert torch.equal(few, encode_symmetric(encode, image, valid, SYMMETRIES)[:, :count])
