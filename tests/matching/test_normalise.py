"""What the encoders see: nothing of invalid pixels, nothing of exposure."""

import pytest
import torch
from torch import Tensor

from uasthn_cli.matching.architecture import LOCAL_WINDOW_PX
from uasthn_cli.matching.normalise import (
    local_contrast,
    local_mean,
    satellite_input,
    thermal_input,
)

SIZE = (48, 80)
MEAN, DEVIATION = torch.tensor([[0.4, 0.5, 0.6]]), torch.tensor([0.2])


def picture(channels: int, seed: int = 0) -> Tensor:
    return torch.rand(1, channels, *SIZE, generator=torch.Generator().manual_seed(seed))


@pytest.fixture
def valid() -> Tensor:
    mask = torch.ones(1, 1, *SIZE)
    mask[..., :13] = 0.0
    mask[..., 30:, 50:60] = 0.0
    return mask


def test_invalid_pixels_of_the_map_have_no_influence(valid: Tensor) -> None:
    rgb = picture(3)
    soiled = torch.where(valid > 0, rgb, torch.tensor(9.0))
    assert torch.equal(
        satellite_input(rgb, valid, MEAN, DEVIATION),
        satellite_input(soiled, valid, MEAN, DEVIATION),
    )


def test_invalid_pixels_of_the_frame_have_no_influence(valid: Tensor) -> None:
    thermal = picture(1)
    soiled = torch.where(valid > 0, thermal, torch.tensor(-7.0))
    assert torch.equal(thermal_input(thermal, valid), thermal_input(soiled, valid))


def test_invalid_pixels_are_zero_in_every_channel(valid: Tensor) -> None:
    outside = valid == 0
    seen = satellite_input(picture(3), valid, MEAN, DEVIATION)
    assert seen.shape == (1, 6, *SIZE)
    assert (seen.masked_select(outside) == 0).all()
    assert (thermal_input(picture(1), valid).masked_select(outside) == 0).all()


def test_a_frame_looks_the_same_at_any_gain_and_offset(valid: Tensor) -> None:
    thermal = picture(1)
    again = thermal_input(0.25 * thermal + 0.6, valid)
    torch.testing.assert_close(again, thermal_input(thermal, valid), atol=0.02, rtol=0.0)


def test_large_structures_survive_in_the_second_channel_only(valid: Tensor) -> None:
    ramp = torch.linspace(0.0, 1.0, SIZE[1]).expand(1, 1, *SIZE)
    local, large = thermal_input(ramp, torch.ones_like(valid)).unbind(dim=1)
    assert large[0, 24, 0] < -1.5
    assert large[0, 24, -1] > 1.5
    assert local[0, 24, 40].abs() < 0.1


def test_a_local_mean_is_that_of_the_valid_pixels_around(valid: Tensor) -> None:
    image = torch.where(valid > 0, torch.tensor(0.7), torch.tensor(0.0))
    mean = local_mean(image, valid)
    torch.testing.assert_close(mean[..., 13:], torch.full_like(mean[..., 13:], 0.7))


def test_a_flat_picture_has_no_local_contrast(valid: Tensor) -> None:
    flat = torch.full((1, 3, *SIZE), 0.3)
    assert local_contrast(flat, valid, 1e-4).abs().max() < 1e-3


def test_a_tile_normalises_like_the_whole_away_from_its_edges() -> None:
    image = torch.rand(1, 1, 192, 256, generator=torch.Generator().manual_seed(1))
    tile = image[..., 32:160, 64:224]
    whole = local_mean(image, torch.ones_like(image))[..., 32:160, 64:224]
    alone = local_mean(tile, torch.ones_like(tile))
    reach = LOCAL_WINDOW_PX // 2 + 8
    inner = (..., slice(reach, -reach), slice(reach, -reach))
    torch.testing.assert_close(alone[inner], whole[inner])
